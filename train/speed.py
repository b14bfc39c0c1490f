"""Speed in three columns: the simulation alone, with the allocator, with a learner; takes minutes.

python -m train.speed
"""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
import tyro

from spidar_gym.cli.arguments import Flag
from spidar_gym.cli.bench import ROUNDS, machine
from spidar_gym.cli.console import named_steps, progress, run_cli
from spidar_gym.envs.env import SpidarEnv
from spidar_gym.errors import require_above
from spidar_gym.files import json_text
from spidar_gym.native.plant import Plant, Saved
from spidar_gym.policies.rollout import rollout
from spidar_gym.state import Command
from spidar_gym.text import format_table
from train import residual
from train.lib.config import CONTROL, override
from train.lib.envs import NOMINAL, make_track_env, training_seed
from train.lib.run import FRAMEWORKS, require_frameworks
from train.residual import make_agent, make_robots, make_scaling

ROWS: dict[str, tuple[str, tuple[str, ...]]] = {
    "flight": ("hover-paper-ppo", NOMINAL),
    "flight, drawn robots, sensors": ("hover-paper-ppo", ("flight-randomised",)),
    "crawl, the paper's 0.6 m": ("crawl-ppo", ("ground-paper",)),
    "crawl, drawn robots, sensors": ("crawl-ppo", ("ground-randomised",)),
}
"""Preset of `train.residual` and tracks of each row; the preset's own tracks are the first and the last row's."""
PARTS = len(ROWS) * ROUNDS
"""Parts of `run_speed`."""
COLUMNS = ("simulation", "allocator_python", "allocator_core", "learner")
"""Figures of a row, each with all that the one before it has."""
HEADS = ("control ticks/s, 40 are real time", "simulation", "+ allocator, python", "… core", "+ learner")


def settings(preset: str, tracks: tuple[str, ...]) -> residual.Args:
    """A preset that learns from the first tick on, in segments of one batch: the same work a tick as in a long one."""
    args = override(residual.PRESETS[preset], tracks=tracks, critic_first=0)
    n_steps = args.learner.batch_size // args.schedule.envs
    return override(args, n_steps=n_steps, segment=n_steps * args.schedule.envs * args.env.hold)


def play(env: gymnasium.Env, seed: int, ticks: int) -> tuple[float, Saved, list[Command]]:
    """Steps of the zero action: how long they take [s], the plant before them, and what it was told in each."""
    inner = env.unwrapped
    assert isinstance(inner, SpidarEnv)
    steps = rollout(env, seed=seed, ticks=ticks, until_finished=False)
    saved, seconds, commands = inner.plant.save(), 0.0, []
    for step in steps:
        seconds += step.seconds
        commands.append(inner.command)
    return seconds, saved, commands


def plant_of(env: gymnasium.Env) -> Plant:
    """The simulated robot in an environment."""
    inner = env.unwrapped
    assert isinstance(inner, SpidarEnv)
    return inner.plant


def replay(plant: Plant, saved: Saved, commands: Sequence[Command]) -> float:
    """How long the very same ticks take without controller and environment [s]: physics, air, actuators, sensors."""
    plant.restore(saved)
    began = time.perf_counter()
    for command in commands:
        plant.step(command)
    return time.perf_counter() - began


def make_learner(args: residual.Args) -> Callable[[int], float]:
    """A function that learns for one segment and returns how long that took [s]; it is given the segment's index."""
    from train.lib import agent  # with torch, which help does without

    envs = make_robots(args, make_scaling(args))
    model = make_agent(args, envs)
    actor = agent.ActorSchedule(args.learner, agent.actor_layers(model))
    steps, lr = args.schedule.segment // args.env.hold, args.learner.lr

    def learn(k: int) -> float:
        seed, began = training_seed(args.seed, 1, k), time.perf_counter()
        agent.learn_segment(model, envs, actor, steps=steps, seed=seed, lr=lr, first=k == 0)
        return time.perf_counter() - began

    return learn


def measure_row(args: residual.Args, ticks: int, on_round: Callable[[], object]) -> dict[str, float | None]:
    """Ticks a second of each column, medians over interleaved rounds.

    Args:
        args: Settings of the learner.
        ticks: Control ticks of each track in a round, without a learner.
        on_round: Called after each round.
    """
    learn = make_learner(args)
    # The compiled core, where there is one, beside the readable controller.
    envs = {
        control: [make_track_env(track, args.env.arguments, control) for track in args.env.tracks]
        for control in dict.fromkeys(("python", CONTROL))
    }
    rates = []
    for k in range(ROUNDS):
        seed = training_seed(args.seed, 2, k)
        played = {control: [play(env, seed, ticks) for env in own] for control, own in envs.items()}
        alone = sum(replay(plant_of(env), *of[1:]) for env, of in zip(envs["python"], played["python"], strict=True))
        # An episode may end before its ticks are up.
        total = sum(len(commands) for _, _, commands in played["python"])
        python, core = (sum(of[0] for of in played.get(control, ())) for control in ("python", "core"))
        segment = args.schedule.segment
        rates.append([total / alone, total / python, total / core if core else math.nan, segment / learn(k)])
        on_round()
    medians = np.median(np.array(rates), axis=0).tolist()
    return {name: None if math.isnan(rate) else rate for name, rate in zip(COLUMNS, medians, strict=True)}


def run_speed(*, seconds: float = 0.5, on_step: Callable[[str], object] = lambda _: None) -> dict[str, Any]:
    """All rows as one dictionary, in control ticks a second.

    Args:
        seconds: About how long the environment is stepped in a round [s]; a learner takes a batch, however long.
        on_step: Called with a row's name, `PARTS` times.
    """
    ticks, rows = max(4, round(800 * seconds)), {}
    for name, (preset, tracks) in ROWS.items():
        args = settings(preset, tracks)
        found = measure_row(args, ticks, lambda name=name: on_step(name))
        rows[name] = {
            "preset": preset,
            "tracks": list(tracks),
            "learner_control": CONTROL,
            "ticks_per_s": found,
        }
    return {"machine": machine(*FRAMEWORKS), "rounds": ROUNDS, "ticks_a_round": ticks, "speed": rows}


def speed_table(result: dict[str, Any]) -> str:
    """The rows as text."""
    cells = [
        [name, *("–" if rate is None else f"{rate:.0f}" for rate in row["ticks_per_s"].values())]
        for name, row in result["speed"].items()
    ]
    controls = sorted({row["learner_control"] for row in result["speed"].values()})
    return "\n".join(
        [
            ", ".join(f"{name} {value}" for name, value in result["machine"].items()),
            "",
            format_table([list(HEADS), *cells]),
            "",
            f"one process on one core, medians of {result['rounds']} rounds; the learner: PPO without validations, "
            f"in environments with control = {', '.join(controls)}",
        ]
    )


@dataclass(frozen=True)
class Args:
    """Measure control ticks a second of the simulation alone, with the allocator, and with a learner."""

    seconds: float = 0.5
    """Time for which the environment is stepped in a round [s]; a learner takes a batch, however long."""
    json: Flag = False
    """Print one JSON object on stdout and nothing else there."""

    def __post_init__(self) -> None:
        require_above(seconds=self.seconds)


def main() -> None:
    """Entry point."""
    args = tyro.cli(Args, description=__doc__, prog="python -m train.speed")
    require_frameworks()
    with progress(total=PARTS, unit="part", desc="speed", leave=False) as bar:
        result = run_speed(seconds=args.seconds, on_step=named_steps(bar))
    print(json_text(result) if args.json else speed_table(result))


if __name__ == "__main__":
    run_cli("train.speed", main)
