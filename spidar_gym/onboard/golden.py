"""Golden vectors: a recorded flight and crawl, what went in and what the readable controller answered."""

from typing import Any

import gymnasium
import numpy as np

import spidar_gym.envs.registry
from spidar_gym.control.allocation.allocator import Allocation
from spidar_gym.envs.crawl.env import CrawlEnv
from spidar_gym.envs.hover.env import HoverEnv
from spidar_gym.native.codegen.solvers import ONBOARD_ITERATIONS
from spidar_gym.native.core_structs import core_layouts
from spidar_gym.native.library import STATUS
from spidar_gym.native.structs import fill
from spidar_gym.onboard.runner_structs import MAGIC, LogKind, log_layouts, runner_hash
from spidar_gym.policies.presets import PresetPolicy
from spidar_gym.policies.rollout import rollout
from spidar_gym.state import NO_RESIDUAL, Command, Reference, Residual, RobotState

FLIGHT_TICKS, CRAWL_TICKS = 200, 500
"""Length of the golden logs: five seconds of fast legs, one and a half gait phases."""


class Log:
    """A log that is being written: inputs, and what somebody answered."""

    def __init__(self, kind: LogKind, config: object, struct: str) -> None:
        """Begin with a configuration, of the struct named."""
        self._kind, self._inputs, self._outputs = kind, [], []
        record = np.zeros((), core_layouts()[struct])
        fill(record, config)
        self._front = [record.tobytes()]

    def start(self, state: RobotState, joint_position: np.ndarray, trim: np.ndarray | None) -> None:
        """A flight's first state."""
        record = np.zeros((), log_layouts()["log_start"])
        fill(record["state"], state)
        record["joint_position"], record["has_trim"] = joint_position, trim is not None
        record["trim"] = 0.0 if trim is None else trim
        self._front.append(record.tobytes())

    def moves(self, state: RobotState, moves: list[tuple[float, float, float, int]]) -> None:
        """A crawl's first state and its moves: x, y, yaw, cycles."""
        first = np.zeros((), core_layouts()["robot_state"])
        fill(first, state)
        self._front.append(first.tobytes())
        for x, y, yaw, cycles in [*moves, (0.0, 0.0, 0.0, -1)]:
            record = np.zeros((), log_layouts()["move"])
            record["way"]["x"], record["way"]["y"], record["way"]["yaw"], record["cycles"] = x, y, yaw, cycles
            self._front.append(record.tobytes())

    def add(self, state: RobotState, reference: Reference | None, residual: Residual = NO_RESIDUAL) -> None:
        """What went into a tick."""
        record = np.zeros((), log_layouts()["log_input"])
        fill(record["state"], state)
        if reference is not None:
            fill(record["reference"], reference)
        record["has_residual"] = residual is not NO_RESIDUAL
        fill(record["residual"], residual)
        self._inputs.append(record.tobytes())

    def answer(self, command: Command, allocation: Allocation) -> None:
        """What came out of it."""
        record = np.zeros((), log_layouts()["log_output"])
        fill(record["command"], command)
        record["forces_l"] = allocation.forces_l.reshape(-1)
        record["status"], record["iterations"] = STATUS.index(allocation.status), allocation.iterations
        self._outputs.append(record.tobytes())

    def inputs(self) -> bytes:
        """The file that `runner replay` reads."""
        head = np.zeros((), log_layouts()["log_head"])
        head["kind"], head["ticks"] = self._kind, len(self._inputs)
        data = bytearray(head.tobytes())
        data[:40] = (MAGIC + runner_hash()).encode()
        return bytes(data) + b"".join(self._front + self._inputs)

    def outputs(self) -> bytes:
        """What it should write, to rounding."""
        return b"".join(self._outputs)


class _Recorded(PresetPolicy):
    """The controller alone; what goes into each of its ticks is logged before it."""

    def __init__(self, env: HoverEnv | CrawlEnv, log: Log) -> None:
        self._env, self._log = env, log
        self.begin((env.action_space.shape or (0,))[0])

    def act(self, observation: np.ndarray) -> np.ndarray:
        self._log.add(self._env.seen, self._env.reference() if isinstance(self._env, HoverEnv) else None)
        return super().act(observation)


def record_flight(ticks: int = FLIGHT_TICKS, **options: Any) -> Log:  # noqa: ANN401 - arguments of the environment
    """A flight of the readable controller, at the robot's iteration cap."""
    spidar_gym.envs.registry.register()
    given = {"preset": "tuned", "forms": "independent", "joint_speed": 1.0, "sensors": True, **options}
    env = gymnasium.make("spidar_gym/Hover-v0", max_iter=ONBOARD_ITERATIONS, **given).unwrapped
    assert isinstance(env, HoverEnv)
    log = Log(LogKind.FLIGHT, env.controller.config, "controller_config")
    steps = rollout(env, _Recorded(env, log), seed=1, ticks=ticks)
    log.start(env.seen, env.progress.goal.joint_target, env.preload)
    for _ in steps:
        last = env.controller.last_step
        assert last is not None
        log.answer(env.command, last.allocation)
    return log


def record_crawl(ticks: int = CRAWL_TICKS, **options: Any) -> Log:  # noqa: ANN401 - arguments of the environment
    """A crawl of the readable controller, at the robot's iteration cap."""
    spidar_gym.envs.registry.register()
    given = {"preset": "published", "distance": 0.2, "direction": 0.3, "turn": 0.2, "sensors": True, **options}
    env = gymnasium.make("spidar_gym/Crawl-v0", max_iter=ONBOARD_ITERATIONS, **given).unwrapped
    assert isinstance(env, CrawlEnv)
    log = Log(LogKind.CRAWL, env.controller.config, "crawler_config")
    steps = rollout(env, _Recorded(env, log), seed=1, ticks=ticks)
    log.moves(env.seen, [(*env.way, 0)])
    for _ in steps:
        last = env.controller.last_step
        assert last is not None
        log.answer(env.command, last.allocation)
    return log


def golden_files() -> dict[str, bytes]:
    """Inputs and the readable controller's outputs, as the export holds them."""
    logs = {"flight": record_flight(), "crawl": record_crawl()}
    return {
        f"golden/{name}.{what}": data
        for name, log in logs.items()
        for what, data in (("in", log.inputs()), ("out", log.outputs()))
    }
