"""Environments that `spidar bench` times in turn: effects of the calibrated world, and the parts of a grasp."""

import os
import time
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np

from spidar_gym.benchmark.track import WORLD
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.control.grasp.scene import GraspScene
from spidar_gym.envs.registry import CRAWL, GRASP, HOVER
from spidar_gym.robot import N_JOINTS
from spidar_gym.sim.actuators import ActuatorConfig
from spidar_gym.sim.air import AeroConfig
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.recirculation import RecirculationConfig

TURNS = 31
"""Repetitions of what is timed in turn, each short, since the speed of a machine changes within a second."""
WARM = 60
"""Control steps before timing."""
_EDDIES = RecirculationConfig(flow_xy=0.02, flow_z=0.04, turn_xy=0.05, turn_z=0.02, near=1.0)
_EFFECTS: dict[str, dict[str, Any]] = {
    "servo speed": {"servo_speed": np.full(N_JOINTS, 0.94)},
    "jitter and loss of commands": {"jitter": 0.01, "loss": 0.02},
    "play of the vectoring axes": {"vectoring_backlash": 0.005},
    "friction of the vectoring axes": {"vectoring_friction": 0.05},
    "board at low voltage": {"battery": True, "battery_spent": 0.5, "board_scaling": True},
}
EFFECTS: dict[str, PlantConfig] = {
    "recirculation": PlantConfig(recirculation=_EDDIES),
    "loss of stacked modules": PlantConfig(aero=AeroConfig(stacking_loss=0.06)),
    **{name: PlantConfig(actuators=ActuatorConfig(**options)) for name, options in _EFFECTS.items()},
    "all of them": PlantConfig(
        actuators=ActuatorConfig(**{name: value for options in _EFFECTS.values() for name, value in options.items()}),
        aero=AeroConfig(stacking_loss=0.06), recirculation=_EDDIES,
    ),
}  # fmt: skip
"""Effects of the calibrated world that no other environment has; each is timed on randomised robots."""
MOVING: dict[str, Any] = {
    "id": HOVER, "randomization": 1.0, "sensors": True, "forms": "narrow", "joint_speed": 1.0,
}  # fmt: skip
"""Environment of the effects: legs that move, with rotors above each other."""
OFF = "none"
"""Name of the randomised robots without any of `EFFECTS`."""
CROWD = 16
"""Number of robots on which an effect is timed."""
_SCENE = GraspScene(start=Pose2(0.3), goal=Pose2(3.0))
_FAR = GraspScene(start=Pose2(4.0), goal=Pose2(1.0))
_GRASP: dict[str, Any] = {"id": GRASP, "randomization": WORLD}
GRASPS: dict[str, tuple[dict[str, Any], int]] = {
    "Hover": ({"id": HOVER, "randomization": WORLD}, 100),
    "Crawl": ({"id": CRAWL, "randomization": WORLD}, 100),
    "Grasp, object far away": (_GRASP | {"scene": _FAR}, 100),
    "Grasp, over the object": (_GRASP | {"scene": _SCENE}, 200),
    "Grasp, object held": (_GRASP | {"scene": _SCENE}, 640),
}
"""Environments on robots of the calibrated world, each with the control steps before timing."""
HERDS = (64, 256)
"""Numbers of robots on which the parts of a grasp are timed."""


def effects(seconds: float) -> list[dict[str, Any]]:
    """Time a control step of randomised robots with each effect, in turn; medians over `TURNS` of the CPU time [µs]."""
    options: dict[str, dict[str, Any]] = {OFF: {}, **{name: {"plant": plant} for name, plant in EFFECTS.items()}}
    options[WORLD] = {"randomization": WORLD}
    envs = {
        name: gymnasium.make_vec(num_envs=CROWD, num_threads=1, **(MOVING | own)) for name, own in options.items()
    }  # fmt: skip
    action = np.zeros(next(iter(envs.values())).action_space.shape or ())
    for env in envs.values():
        env.reset(seed=0)
        for _ in range(WARM):
            env.step(action)
    ticks = max(1, round(32 * seconds))
    times = np.array([
        [took(lambda env=env: [env.step(action) for _ in range(ticks)], ticks * CROWD)[1] for env in envs.values()]
        for _ in range(TURNS)
    ])  # fmt: skip
    for env in envs.values():
        env.close()
    return [
        {"effect": name, "cpu_us": float(np.median(times[:, k])), "ratio": float(np.median(times[:, k] / times[:, 0]))}
        for k, name in enumerate(envs)
    ]


def effect_lines(rows: list[dict[str, Any]]) -> list[list[str]]:
    """Return the table of the costs of effects, as CPU time of a randomised robot's control step."""
    lines = [["effect", "CPU [µs]", "more than without"]]
    return lines + [[row["effect"], f"{row['cpu_us']:.0f}", f"{row['ratio'] - 1.0:+.1%}"] for row in rows]


def took(work: Callable[[], object], steps: int) -> tuple[float, float]:
    """Return wall and CPU time of a step [µs]."""
    wall, cpu = time.perf_counter(), time.process_time()
    work()
    return 1e6 * (time.perf_counter() - wall) / steps, 1e6 * (time.process_time() - cpu) / steps


def grasps(seconds: float) -> list[dict[str, Any]]:
    """Time a control step of robots in flight, in a crawl and in the parts of a grasp, in turn, on one thread.

    Every turn begins with the same saved robots. Medians over half of `TURNS` of CPU times [µs], and their ratios to
    the first two environments of `GRASPS`.
    """
    rows: list[dict[str, Any]] = []
    for robots in HERDS:
        ticks = max(2, round(512 * seconds / robots))
        pairs = [_warm(arguments, warm, robots) for arguments, warm in GRASPS.values()]
        times = np.array([[_resumed(env, saved, ticks, robots) for env, saved in pairs] for _ in range(TURNS // 2)])
        for env, _ in pairs:
            env.close()
        for k, name in enumerate(GRASPS):
            hover, crawl = (float(np.median(times[:, of] / times[:, k])) for of in (0, 1))
            cpu = float(np.median(times[:, k]))
            rows.append({"part": name, "robots": robots, "cpu_us": cpu, "of_hover": hover, "of_crawl": crawl})
    return rows


def _warm(arguments: dict[str, Any], warm: int, robots: int) -> tuple[Any, bytes]:
    """Return a vector on one thread, and its robots after `warm` control steps, which all processors simulated."""
    fast: Any = gymnasium.make_vec(num_envs=robots, num_threads=os.cpu_count() or 1, **arguments).unwrapped
    fast.reset(seed=0)
    action = np.zeros(fast.action_space.shape)
    for _ in range(warm):
        fast.step(action)
    saved = fast.save()
    fast.close()
    env: Any = gymnasium.make_vec(num_envs=robots, num_threads=1, **arguments).unwrapped
    env.reset(seed=0)
    return env, saved


def _resumed(env: Any, saved: bytes, ticks: int, robots: int) -> float:  # noqa: ANN401 - a vector
    """Return the CPU time of a control step of a robot after the saved moment [µs]."""
    env.restore(saved)
    action = np.zeros(env.action_space.shape)
    env.step(action)
    return took(lambda: [env.step(action) for _ in range(ticks)], ticks * robots)[1]


def grasp_lines(rows: list[dict[str, Any]]) -> list[list[str]]:
    """Return the table of the costs of a grasp; ratios are rates over that of Hover and of Crawl."""
    lines = [["", "robots", "CPU [µs]", "rate over Hover's", "rate over Crawl's"]]
    return lines + [
        [row["part"], str(row["robots"]), f"{row['cpu_us']:.0f}", f"{row['of_hover']:.2f}", f"{row['of_crawl']:.2f}"]
        for row in rows
    ]
