"""The session: one robot that flies or crawls without end, and all inputs of users; has no page and no threads."""

import inspect
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from spidar_gym.arrays import JointVector
from spidar_gym.benchmark.scoring import ACT_LIMIT_S
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.control.presets import CRAWL_PRESETS, PRESETS, controller_config, crawler_config
from spidar_gym.envs.course_env import CourseEnv
from spidar_gym.envs.crawl_env import CrawlEnv
from spidar_gym.envs.env import SpidarEnv
from spidar_gym.envs.grasp_env import GraspEnv
from spidar_gym.envs.hover_env import HoverEnv
from spidar_gym.envs.registry import COURSE, CRAWL, GRASP, HOVER, PATH, environment
from spidar_gym.errors import InvalidValueError, require_name, require_within
from spidar_gym.policies.actor import Actor
from spidar_gym.policies.load import load_policy
from spidar_gym.policies.policy import policy_arguments, policy_name, require_spaces
from spidar_gym.policies.presets import PresetPolicy
from spidar_gym.policies.source import PolicyError
from spidar_gym.robot import FORMS, N_LEGS
from spidar_gym.sim.disturbances import Disturbances
from spidar_gym.sim.ground import GroundConfig
from spidar_gym.sim.object import ObjectConfig
from spidar_gym.tasks.hover import SEQUENCES
from spidar_gym.viz.live.steered import SteeredHover, SteeredPath
from spidar_gym.viz.live.traces import Traces, row

ALONE = ""
"""Name of the empty policy: the preset alone."""
BY_HAND = "by hand"
"""Sequence option without sampled forms: the robot keeps the form that the user chose."""
INNER, OUTER = (math.radians(-10.0), math.radians(50.0)), (0.0, math.radians(90.0))
"""Ranges of the pitches of the legs' inner and outer joints [rad]."""
ENDLESS, PATHS_END = 3600.0, 60.0
"""Length of an episode of a hover and of a path [s]; then the next begins."""
REST = 2.0
"""Time for which an ended episode stays visible before the next begins [s]."""
_KINDS: dict[str, type[SpidarEnv]] = {
    HOVER: SteeredHover, PATH: SteeredPath, CRAWL: CrawlEnv, COURSE: CourseEnv, GRASP: GraspEnv,
}  # fmt: skip
_PRESETS: dict[str, str] = {
    env_id: inspect.signature(kind).parameters["preset"].default
    for env_id, kind in {**_KINDS, HOVER: HoverEnv, PATH: HoverEnv}.items()
}
"""The environments' default presets."""


@dataclass(frozen=True)
class Frame:
    """Visible state of the robot at one time."""

    time: float
    """Time since the episode began [s]."""
    qpos: np.ndarray
    """Configuration of the simulated robot, (39,), and of the object, if there is one, (46,)."""
    thrust: np.ndarray
    """Thrust of the rotors, (8,) [N]."""
    contacts: np.ndarray
    """Contact points and forces, world axes, (k, 6) [m, N]."""
    reference_w: np.ndarray | None
    """Reference of the CoG in flight, (3,) [m]; None on the ground."""
    wind_w: np.ndarray
    """Present wind, world axes, (3,) [m/s]."""
    phase: str
    """Phase of the robot, as text."""
    over: str
    """Why the episode has ended; empty during the episode."""


class Session:
    """A robot that flies or crawls through successive episodes."""

    def __init__(
        self,
        env_id: str = HOVER,
        options: Mapping[str, Any] | None = None,
        *,
        policy: str = ALONE,
        trust: bool = False,
        seed: int = 0,
        form: str = "form1",
        disturbances: Disturbances | None = None,
    ) -> None:
        """Start the first episode.

        Args:
            env_id: Environment.
            options: Arguments of the environment except its length; a flight holds its form unless `forms` is given.
            policy: module:Class, an artifact's path, or empty for the controller alone.
            trust: Whether the policy may be a zip of Stable-Baselines3.
            seed: Seed of the first episode; later episodes use the following seeds.
            form: Initial form of a flight, one of the paper's.
            disturbances: Initial disturbances.

        Raises:
            SpidarError: For arguments that the environment or the policy refuses.
        """
        environment(env_id)
        self.env_id, self._trust = env_id, trust
        self._options = dict(options or {})
        self.forms = str(self._options.pop("forms", BY_HAND)) if self.flies else ""
        """Sequence of forms that a flight goes through, or `BY_HAND`."""
        require_name("form", form, FORMS)
        self.form = FORMS[form]
        """The form that was chosen last [rad]."""
        self.disturbances, self.towards = disturbances or Disturbances(), 0.0
        """Disturbances, and the direction in which the wind blows [rad]."""
        self._is_changed = False
        self.seed = seed - 1
        """Seed of this episode."""
        self.traces, self.passed = Traces(), 0
        """Curves of the last seconds, and the total number of ticks."""
        self._set(*self._make(policy, str(self._options.pop("preset", _PRESETS[env_id]))))

    # ---- controller and policy ----

    @property
    def flies(self) -> bool:
        """Whether there is a reference to steer and a form to choose."""
        return self.env_id in (HOVER, PATH)

    @property
    def presets(self) -> tuple[str, ...]:
        """Presets of the environment."""
        listed = tuple(CRAWL_PRESETS if self.env_id == CRAWL else PRESETS)
        return listed if self.preset in listed else (*listed, self.preset)  # a former one may be flying

    def choose(self, *, policy: str | None = None, preset: str | None = None) -> None:
        """Change the policy or the preset, and start an episode; nothing changes if the choice is refused.

        Args:
            policy: Policy, as in the constructor; the present one if None.
            preset: Preset of the controller; the present one if None. A policy may replace it.

        Raises:
            SpidarError: For a policy that is not for this environment, or an unknown preset.
        """
        made = self._make(self.policy if policy is None else policy, self.preset if preset is None else preset)
        before = self.env
        self._set(*made)
        before.close()

    def _make(self, policy: str, preset: str) -> tuple[SpidarEnv, Actor, str, str, bool]:
        loaded = load_policy(policy, trust=self._trust) if policy else PresetPolicy()
        chosen = policy_arguments(loaded, self.env_id) if policy else {}
        if chosen is None:
            raise PolicyError(f"policy {policy_name(loaded)}: not for {self.env_id}; valid: one that is")
        (crawler_config if self.env_id == CRAWL else controller_config)(preset)  # refuses an unknown name
        is_own = bool(chosen.keys() & {"preset", "controller", "law"})
        given = {name: value for name, value in self._options.items() if name not in chosen} | dict(chosen)
        if self.env_id == COURSE:
            given["hold"] = 1
            if not policy:  # without a policy the residual is zero and the rule decides
                given.setdefault("action_mode", "residual")
        if not is_own:
            given["preset"] = preset
        if self.flies:
            given["forms"] = self._first_forms
            given["horizon_s"] = ENDLESS if self.env_id == HOVER else PATHS_END
        env = _KINDS[self.env_id](**given, disturbances=self.disturbances)
        try:
            require_spaces(loaded, self.env_id, env)
            actor = Actor(loaded, env.action_space.shape or (), self.env_id, limit_s=ACT_LIMIT_S)
        except BaseException:
            env.close()
            raise
        return env, actor, policy, preset, is_own

    def _set(self, env: SpidarEnv, actor: Actor, policy: str, preset: str, is_own: bool) -> None:
        self.env, self._actor, self.policy, self.preset, self.preset_is_the_policys = env, actor, policy, preset, is_own
        self.reset()

    @property
    def _first_forms(self) -> str:
        """Argument `forms` at a reset: the sequence, the name of the held form, or form1 where it has no name."""
        if self.forms != BY_HAND:
            return self.forms
        return next((name for name, form in FORMS.items() if form is self.form), "form1")

    # ---- time ----

    def reset(self, seed: int | None = None, options: Mapping[str, Any] | None = None) -> None:
        """Start an episode, with a given seed or the next one, and reset the helm.

        Args:
            seed: Seed of the episode.
            options: As in the environment's `reset`.

        Raises:
            SpidarError: For an invalid option; nothing has changed then.
        """
        seed = self.seed + 1 if seed is None else seed
        forms = {"forms": self._first_forms} if self.flies else {}
        self._observation, self.info = self.env.reset(seed=seed, options=forms | dict(options or {}))
        """The environment's present `info`."""
        self.seed = seed
        self._actor.reset(seed)
        self.over, self._rested = "", 0
        """Why the episode has ended; empty during the episode."""
        if self.forms == BY_HAND and self.form is not FORMS[self._first_forms]:
            self._flight.take_form(self.form)
        if self._is_changed:
            self.env.disturb(replace(self.disturbances, fault_time=0.0), self.towards)

    def tick(self) -> None:
        """Run one control period; an ended episode stays as it is for `REST`, and then the next one begins.

        Raises:
            PolicyError: If the policy fails; the next call starts an episode.
        """
        self.passed += 1
        if self.over:
            self._rested += 1
            if self._rested >= REST * CONTROL_RATE:
                self.reset()
        else:
            try:
                action = self._actor.act(self._observation.copy())
            except PolicyError:
                self.over, self._rested = "the policy failed", round(REST * CONTROL_RATE)
                raise
            self._observation, _, terminated, _, self.info = self.env.step(action)
            if terminated:
                self.over = self.info["failure"]
            elif self.info.get("finished"):
                self.over = "delivered" if self.env_id == GRASP else "arrived"
            elif self.env.ticks >= self.env.horizon:
                self.over = "time is up"
        if np.isfinite(self.env.plant.data.qpos).all():
            self.traces.add(self.passed / CONTROL_RATE, row(self.env_id, self.info, self.env.plant))

    @property
    def frame(self) -> Frame:
        """The present frame."""
        env, plant = self.env, self.env.plant
        weather = plant.record["weather"]
        return Frame(
            time=env.ticks * env.hold / CONTROL_RATE,
            qpos=plant.data.qpos.copy(),
            thrust=self.info["thrust"].copy(),
            contacts=plant.contact_forces() if plant.in_contact else np.zeros((0, 6)),
            reference_w=self._flight.reference().position_w.copy() if self.flies else None,
            wind_w=weather["mean_w"] + weather["gust_w"],
            phase=self._phase(),
            over=self.over,
        )

    @property
    def ground(self) -> GroundConfig:
        """The floor of this episode."""
        return self.env.plant.config.ground

    @property
    def thing(self) -> ObjectConfig:
        """The object of this episode."""
        return self.env.plant.config.object

    @property
    def way(self) -> np.ndarray | None:
        """Points of this episode's path, (n, 3) [m]; None without a path."""
        path = self._flight.path if self.flies else None
        if path is None:
            return None
        joints = FORMS["form1"]
        times = np.arange(0.0, min(float(path.times[-1]), PATHS_END), 0.1).tolist()
        return np.array([path.reference(time, joints, "flight").position_w for time in times])

    @property
    def goal(self) -> tuple[float, float, float] | None:
        """Goal of a robot on the ground, or of an object: x, y [m], heading [rad]; None in flight."""
        if isinstance(self.env, GraspEnv):
            pose = self.env.scene.goal
        elif isinstance(self.env, CourseEnv):
            pose = self.env.course.goal
        elif isinstance(self.env, CrawlEnv):
            pose = self.env.progress.goal
        else:
            return None
        return pose.x, pose.y, pose.yaw

    def _phase(self) -> str:
        if not self.flies:
            phase = str(self.info["phase"])
            return str(self.info["grasp_phase"]).replace("_", " ") if phase == "grasp" else phase
        progress = self._flight.progress
        return "hovers" if np.array_equal(progress.plan(), progress.goal.joint_target) else "legs move"

    # ---- inputs of users ----

    @property
    def _flight(self) -> SteeredHover:
        assert isinstance(self.env, SteeredHover)
        return self.env

    def _require_flight(self, what: str) -> None:
        if not self.flies:
            raise InvalidValueError(what, self.env_id, f"a flight, {HOVER} or {PATH}")

    def take_form(self, inner: float, outer: float) -> None:
        """Move all legs to these pitches of their inner and outer joints [rad]."""
        self._require_flight("form")
        require_within(*INNER, "rad", inner=inner)
        require_within(*OUTER, "rad", outer=outer)
        self._take(np.tile([0.0, inner, 0.0, outer], N_LEGS))

    def take_named_form(self, name: str) -> None:
        """Move all legs to one of the paper's forms."""
        self._require_flight("form")
        require_name("form", name, FORMS)
        self._take(FORMS[name])

    def _take(self, form: JointVector) -> None:
        self.form, self.forms = form, BY_HAND
        self._flight.take_form(form)

    def take_forms(self, sequence: str) -> None:
        """Move the legs through a sequence of forms, one of `SEQUENCES`, or to the form chosen last (`BY_HAND`)."""
        self._require_flight("forms")
        require_name("form sequence", sequence, (BY_HAND, *SEQUENCES))
        self.forms = sequence
        if sequence == BY_HAND:
            self._flight.take_form(self.form)
        else:
            self.env.task = replace(self._flight.task, forms=sequence)
            self._flight.take_forms()

    def nudge(self, forward: float = 0.0, left: float = 0.0, up: float = 0.0, turn: float = 0.0) -> None:
        """Move the reference's goal in its heading frame [m], and turn it to the left [rad]."""
        self._require_flight("nudge")
        self._flight.helm.nudge(forward, left, up, turn)

    def home(self) -> None:
        """Return the reference to that of the task."""
        self._require_flight("home")
        self._flight.helm.home()

    def disturb(self, towards: float | None = None, **changes: Any) -> None:  # noqa: ANN401 - fields of `Disturbances`
        """Change the disturbances from now on.

        Args:
            towards: Direction in which the wind blows [rad]; unchanged if None.
            changes: Fields of `Disturbances`; the others do not change, and a rotor is lost at once.
        """
        chosen = replace(self.disturbances, **{"fault_time": 0.0, **changes})
        self.env.disturb(chosen, self.towards if towards is None else towards)
        self.disturbances, self._is_changed = chosen, True
        self.towards = self.towards if towards is None else towards

    def shove(self, newtons: float, towards: float) -> None:
        """Push the torso horizontally for 0.2 s with a force [N] in a direction [rad]."""
        require_within(0.0, 1e3, "N", newtons=newtons)
        require_within(-math.tau, math.tau, "rad", towards=towards)
        self.env.plant.shove(newtons * np.array([math.cos(towards), math.sin(towards), 0.0]))

    def crawl_to(self, distance: float, direction: float, turn: float) -> None:
        """Start a crawl to a goal given by its distance [m], its direction [rad] and its turn [rad]."""
        if not isinstance(self.env, CrawlEnv):
            raise InvalidValueError("goal", self.env_id, f"a crawl, {CRAWL}")
        goal = {"distance": distance, "direction": direction, "turn": turn}
        self.reset(options=goal)
        self._options |= goal

    def close(self) -> None:
        """Release the robot; a second call does nothing."""
        self.env.close()
