"""Golden vectors: inputs of a flight and a crawl, and the outputs of the Python controller."""

import dataclasses
from collections.abc import Iterable
from typing import Any

import numpy as np

from spidar_gym.control.allocation.allocator import Allocation
from spidar_gym.envs.crawl_env import CrawlEnv
from spidar_gym.envs.hover_env import HoverEnv
from spidar_gym.native.constants import ONBOARD_ITERATIONS
from spidar_gym.native.library import STATUS
from spidar_gym.native.structs import fill
from spidar_gym.onboard.runner_header import runner_hash
from spidar_gym.onboard.runner_structs import DIGEST, MAGIC, LogKind, log_layouts
from spidar_gym.policies.presets import PresetPolicy
from spidar_gym.policies.rollout import rollout
from spidar_gym.robot import ROBOT, RobotSpec
from spidar_gym.robot.description import model_hash
from spidar_gym.state import NO_RESIDUAL, Command, Reference, RobotState

FLIGHT_TICKS, CRAWL_TICKS = 200, 500
"""Length of the golden logs: five seconds of fast legs, one and a half gait phases."""


def _struct(name: str, value: object = None, **members: Any) -> bytes:  # noqa: ANN401 - any struct's members
    """Return a struct of the runner as bytes, from a dataclass or from members; other members are zero."""
    record = np.zeros((), log_layouts()[name])
    if value is not None:
        fill(record, value)
    for member, given in members.items():
        if dataclasses.is_dataclass(given):
            fill(record[member], given)
        else:
            record[member] = given
    return record.tobytes()


class Log:
    """A log in memory: inputs, and the outputs of a controller."""

    def __init__(self, kind: LogKind, config: object, struct: str, robot: RobotSpec = ROBOT) -> None:
        """Begin with a configuration, as the struct `struct`, for a robot."""
        self._kind, self._robot, self._inputs, self._outputs = kind, robot, [], []
        self._front = [_struct(struct, config)]

    def start(self, state: RobotState, joint_position: np.ndarray, trim: np.ndarray | None) -> None:
        """Add a flight's first state."""
        known = {} if trim is None else {"has_trim": 1, "trim": trim}
        self._front.append(_struct("log_start", state=state, joint_position=joint_position, **known))

    def move(self, state: RobotState, way: tuple[float, ...]) -> None:
        """Add a crawl's first state and displacement: x, y [m], yaw [rad]."""
        self._front += [_struct("robot_state", state), _struct("move", way=way), _struct("move", cycles=-1)]

    def add(self, state: RobotState, reference: Reference | None) -> None:
        """Add the input of a tick."""
        known = {} if reference is None else {"reference": reference}
        self._inputs.append(_struct("log_input", state=state, residual=NO_RESIDUAL, **known))

    def answer(self, command: Command, allocation: Allocation) -> None:
        """Add the output of a tick."""
        forces, status = allocation.forces_l.reshape(-1), STATUS.index(allocation.status)
        self._outputs.append(
            _struct("log_output", command=command, forces_l=forces, status=status, iterations=allocation.iterations)
        )

    def inputs(self) -> bytes:
        """Return the file that `runner replay` reads."""
        words = {"magic": MAGIC, "interface": runner_hash(), "model": model_hash(self._robot).ljust(DIGEST, "\0")}
        text = {name: list(word.encode()) for name, word in words.items()}
        head = _struct("log_head", **text, kind=self._kind, ticks=len(self._inputs))
        return b"".join([head, *self._front, *self._inputs])

    def outputs(self) -> bytes:
        """Return the file that `runner replay` should write, up to rounding."""
        return b"".join(self._outputs)


class _Recorded(PresetPolicy):
    """The controller alone; logs the input of each tick before the tick."""

    def __init__(self, env: HoverEnv | CrawlEnv, log: Log) -> None:
        self._env, self._log = env, log
        self.begin((env.action_space.shape or (0,))[0])

    def act(self, observation: np.ndarray) -> np.ndarray:
        self._log.add(self._env.seen, self._env.reference() if isinstance(self._env, HoverEnv) else None)
        return super().act(observation)


def _finished(log: Log, env: HoverEnv | CrawlEnv, steps: Iterable[object]) -> Log:
    """Run the rest of the episode, log the outputs, and return the log."""
    for _ in steps:
        last = env.controller.last_step
        assert last is not None
        log.answer(env.command, last.allocation)
    return log


def record_flight(ticks: int = FLIGHT_TICKS, robot: RobotSpec = ROBOT) -> Log:
    """Record a flight of the Python controller, with the robot's iteration cap."""
    env = HoverEnv(
        preset="tuned", forms="independent", joint_speed=1.0, sensors=True, control="python",
        max_iter=ONBOARD_ITERATIONS, robot=robot,
    )  # fmt: skip
    log = Log(LogKind.FLIGHT, env.controller.config, "controller_config", robot)
    steps = rollout(env, _Recorded(env, log), seed=1, ticks=ticks)
    log.start(env.seen, env.progress.goal.joint_target, env.trim)
    return _finished(log, env, steps)


def record_crawl(ticks: int = CRAWL_TICKS, robot: RobotSpec = ROBOT) -> Log:
    """Record a crawl of the Python controller, with the robot's iteration cap."""
    env = CrawlEnv(
        preset="published", distance=0.2, direction=0.3, turn=0.2, sensors=True, control="python",
        max_iter=ONBOARD_ITERATIONS, robot=robot,
    )  # fmt: skip
    log = Log(LogKind.CRAWL, env.controller.config, "crawler_config", robot)
    steps = rollout(env, _Recorded(env, log), seed=1, ticks=ticks)
    log.move(env.seen, tuple(env.way))
    return _finished(log, env, steps)


def golden_files(robot: RobotSpec = ROBOT) -> dict[str, bytes]:
    """Return the inputs and the Python controller's outputs, as files of a robot's export."""
    logs = {"flight": record_flight(robot=robot), "crawl": record_crawl(robot=robot)}
    return {
        f"golden/{name}.{what}": data
        for name, log in logs.items()
        for what, data in (("in", log.inputs()), ("out", log.outputs()))
    }
