"""The grasp environment: by residuals on a rule's orders, by steering torso, legs and grip, or without a controller."""

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np

from spidar_gym.control.flight.observation import Field
from spidar_gym.control.grasp.observation import grasp_layout
from spidar_gym.control.grasp.phases import GRASP_PHASES, GraspConfig, Seen
from spidar_gym.control.grasp.rule import TESTED, TOLD
from spidar_gym.control.grasp.scene import GraspScene, parse_scene
from spidar_gym.control.locomotion.manager import Manager
from spidar_gym.control.locomotion.orders import PHASES, ManagerConfig
from spidar_gym.control.presets import controller_config, crawler_config, for_robot
from spidar_gym.envs.actions import AIR, TorsoScale, grasp_modes, scaled_action_mode
from spidar_gym.envs.commander import GraspCommander
from spidar_gym.envs.controllers import CONTROLS, make_manager
from spidar_gym.envs.env import SpidarEnv
from spidar_gym.envs.fleet import Fleet
from spidar_gym.envs.locking import in_turn
from spidar_gym.envs.options import described_robot, make_task, own_robot
from spidar_gym.envs.progress import GraspProgress
from spidar_gym.envs.view import fps
from spidar_gym.errors import InvalidValueError, require_instance, require_name
from spidar_gym.native.core_manager import CoreManager
from spidar_gym.native.engine_structs import engine_layouts
from spidar_gym.native.grasp_records import read_scene
from spidar_gym.native.structs import fill
from spidar_gym.sim.ground import NOWHERE, GroundConfig, with_boxes
from spidar_gym.sim.object import ObjectConfig
from spidar_gym.sim.randomize import Randomization
from spidar_gym.tasks.grasp import DECIDE, GraspTask


class GraspEnv(SpidarEnv[GraspTask, CoreManager, GraspProgress]):
    """SPIDAR grasps an object; `spidar list spidar_gym/Grasp-v0` prints its page."""

    metadata: dict[str, Any] = SpidarEnv.metadata | {"render_fps": fps(1)}
    reset_options = ("scene", "disturbances")
    task_type = GraspTask
    words = MappingProxyType({"phase": PHASES, "grasp_phase": GRASP_PHASES})
    no_goal = "its goal is a part of the scene, which is observed"
    true_fields = (
        Field("object_mass", 1, 20.0, "kg", "of the object"),
        Field("object_friction", 1, 10.0, "", "of its surface"),
        Field("object_com", 3, 1.0, "m", "its centre of mass from its middle"),
        Field("object_force", 4, 100.0, "N", "of each foot on it"),
        Field("object_air", 3, 200.0, "N", "force of the air on it, world"),
    )
    _kept = ("_given",)

    def __init__(
        self,
        *,
        action_mode: str = "residual",
        action_scale: Mapping[str, float] | TorsoScale | None = None,
        preset: str = "steady",
        manager: ManagerConfig | None = None,
        control: str = "core",
        grip: float | str = TESTED,
        grasp: GraspConfig | None = None,
        hold: int | None = None,
        **options: Any,  # noqa: ANN401 - fields of the task and arguments of `SpidarEnv`
    ) -> None:
        """Build the task and the controller.

        Args:
            action_mode: Name of the action mode.
            action_scale: Share of a residual's authority, `{"share": 0.001 … 1}`; or zero and scale of
                `torso_forces`: `{"force": N, "joint": rad, "trim": share of weight}`, by default 3 N, 0.1 rad, 1.
            preset: Name of the flight controller.
            manager: Custom configuration of the controller, the grasp and the transitions between both, in place of a
                preset; the task's joint speed overrides the one in it.
            control: `core`, the manager that is compiled for the robot, or `python`, the Python manager.
            grip: How the rule grips: `tested`, as the test lift finds, a force of each foot [N], or `told`, by the true
                mass and friction, which no robot knows: a ceiling.
            grasp: Custom heights, speeds and thresholds of the grasp.
            hold: Control periods of 25 ms per step: 20 by default with `order`, whose actions are read every 20
                periods, and 1 with the others.
            **options: Arguments of the task and of `SpidarEnv`.

        Raises:
            UnknownNameError: For a mode, preset or camera that does not exist; it lists the valid ones.
            UnknownArgumentError: For an argument that does not exist; it lists the valid ones.
            InvalidValueError: For a value out of range, and a scene that cannot be.
        """
        described = described_robot(options)
        task, shared = make_task(SpidarEnv, GraspEnv, self.task_type, options)
        mode = scaled_action_mode(action_mode, action_scale, AIR, grasp_modes, described)
        self._is_order = action_mode == "order"
        if hold is None:
            hold = DECIDE if self._is_order else 1
        base = manager or ManagerConfig(
            flight=controller_config(preset, described), crawl=crawler_config("robust_overlapped", robot=described)
        )
        require_instance(ManagerConfig, manager=base)
        if grasp is not None:
            require_instance(GraspConfig, grasp=grasp)
            base = replace(base, grasp=grasp)
        if base.crawl.gait.robot != described:
            base = replace(base, flight=for_robot(base.flight, described), crawl=for_robot(base.crawl, described))
        self._config = replace(base, flight=replace(base.flight, joint_speed=task.joint_speed))
        require_name("control", control, CONTROLS)
        if isinstance(grip, bool) or not (
            grip in (TESTED, TOLD) or (isinstance(grip, int | float) and 1.0 <= grip <= 100.0)
        ):
            raise InvalidValueError("grip", grip, "tested, told, or a force of each foot within 1 … 100 N")
        self._grip = grip
        self._given: GraspScene | None = None
        shared["randomization"] = Randomization.parse(shared.get("randomization", 0.0)).on_level_floors()
        robot = own_robot(shared.pop("plant", None), described)
        if robot.ground.uneven or robot.ground.boxed or robot.ground.slope or robot.object.exists:
            raise InvalidValueError("plant", "an own floor or object", "an even floor without an object")
        # The model needs an object, and boxes where there are stands; each reset sets their sizes and places.
        floor = with_boxes(GroundConfig(), [(*NOWHERE, 0.0)]) if task.has_stands else robot.ground
        robot = replace(robot, ground=floor, object=ObjectConfig(shape="box"))
        super().__init__(
            mode, grasp_layout(mode.size, described), task=task, joint_speed=task.joint_speed,
            control=control, plant=robot, hold=hold, **shared,
        )  # fmt: skip

    def _look_at_controller(self) -> CoreManager:
        manager = make_manager(self._config, self._control, self.fleet)
        assert isinstance(manager, CoreManager)
        return manager

    def _make_commander(self) -> GraspCommander:
        manager = make_manager(self._config, self._control)
        assert isinstance(manager, Manager)
        return GraspCommander(
            manager, self.fleet, self.plant, self._mode, self._bound, grip=self._grip, is_order=self._is_order
        )

    @property
    def scene(self) -> GraspScene:
        """Scene of the episode, hidden numbers included (`SpidarError` before the first reset)."""
        return self._known("scene")

    @property
    @in_turn
    def object_seen(self) -> Seen:
        """The object as motion capture sees it."""
        record = self.fleet.robots[0]["seen"]
        return Seen(record["position_w"].copy(), record["quat_wo"].copy())

    def rules(self, *, truncates: bool = False, autoreset: str = "disabled") -> np.ndarray:
        """Return the engine's rules, an `sp_grasp_rules`."""
        record = np.zeros((), engine_layouts()["grasp_rules"])
        fill(record["manager"], self._config)
        record["is_order"] = self._is_order
        record["grip"] = {TESTED: 0.0, TOLD: -1.0}.get(str(self._grip), self._grip)
        self._fill_rules(record, truncates=truncates, autoreset=autoreset)
        return record

    def _prepare(self, fleet: Fleet) -> None:
        given = self._given or self.task.scene
        if given is not None:
            require_stands(given, self.plant.config.ground)
        fleet.set_scene(0, given)

    def _read(self, name: str) -> Any:  # noqa: ANN401 - any value
        robot = self.fleet.robots[0]
        if name == "scene":
            return read_scene(robot["scene"])
        return GraspProgress.read(robot) if name == "episode" else super()._read(name)

    def make_fleet(
        self, robots: int, threads: int = 1, *, autoreset: str = "disabled", truncates: bool = False,
        rules: np.ndarray | None = None,
    ) -> Fleet:  # fmt: skip
        """Make robots of this environment in the engine, before their first reset."""
        record = self.rules(truncates=truncates, autoreset=autoreset) if rules is None else rules
        fleet = Fleet(self.task, record, self._nominal, robots, threads, alike=False)
        for robot in range(robots):
            fleet.disturb(robot, self._disturbances)
            fleet.set_scene(robot, self.task.scene)
        return fleet

    def _chosen(self, name: str, value: Any) -> dict[str, object]:  # noqa: ANN401 - user input
        if name != "scene":
            return super()._chosen(name, value)
        scene = parse_scene(value)
        if scene is not None:
            require_stands(scene, self._nominal.ground)
        return {"_given": scene}


def require_stands(scene: GraspScene, ground: GroundConfig) -> None:
    """Require a floor with boxes for a scene with stands or a ball (`InvalidValueError`)."""
    if (scene.shape == "ball" or max(scene.stand, scene.floor) > 0.0) and not ground.boxed:
        raise InvalidValueError(
            "scene", "stands or blocks", "a scene on the plain floor, or an environment with stands: floor=(0, 0.4)"
        )
