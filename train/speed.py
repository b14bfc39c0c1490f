"""Speed in three columns: the simulation alone, with the allocator, with a learner; `spidar bench --train`."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import torch

from spidar_gym.bench import ROUNDS, machine
from spidar_gym.benchmark.tables import aligned
from spidar_gym.control.core import core_path
from spidar_gym.envs.env import SpidarEnv
from spidar_gym.sim.memory import Saved
from spidar_gym.sim.plant import Plant
from spidar_gym.state import Command
from train import presets
from train.kinds import baseline_scaling, training_seed
from train.learner import Coach, actor_layers, build, learn_segment
from train.residual import Args, hidden, make_env, make_envs, still
from train.run import learner_versions

ROWS: dict[str, tuple[str, tuple[str, ...]]] = {
    "flight": ("hover-paper-ppo", presets.NOMINAL),
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


def settings(preset: str, tracks: tuple[str, ...]) -> Args:
    """A preset that learns from the first tick on, in segments of one batch: the same work a tick as in a long one."""
    args = replace(Args(**presets.RESIDUAL[preset]), tracks=tracks, critic_first=0)
    args = replace(args, control="core" if core_path().is_file() else "python", n_steps=args.batch_size // args.envs)
    return replace(args, segment=args.n_steps * args.envs * args.hold)


def play(env: gymnasium.Env, seed: int, ticks: int) -> tuple[float, Saved, list[Command]]:
    """Steps of the zero action: how long they take [s], the plant before them, and what it was told in each."""
    env.reset(seed=seed)
    inner = env.unwrapped
    assert isinstance(inner, SpidarEnv)
    saved, zero, commands = inner.plant.save(), np.zeros(env.action_space.shape or ()), []
    began = time.perf_counter()
    for _ in range(ticks):
        env.step(zero)
        commands.append(inner.command)
    return time.perf_counter() - began, saved, commands


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


def teacher(args: Args) -> Callable[[int], float]:
    """A function that learns for one segment and says how long that took [s]; it is given the segment's number."""
    kinds = [make_env(args, track) for track in args.tracks]
    scaling = baseline_scaling(kinds, args.seed, args.scaling_ticks // args.hold)
    envs = make_envs(args, scaling)
    model = build(args, envs, None, hidden(args), still(args))
    coach = Coach(args.average, args.critic_first, actor_layers(model))

    def teach(k: int) -> float:
        seed, began = training_seed(args.seed, 1, k), time.perf_counter()
        learn_segment(model, envs, coach, steps=args.segment // args.hold, seed=seed, lr=args.lr, first=k == 0)
        return time.perf_counter() - began

    return teach


def measure_row(args: Args, ticks: int, on_round: Callable[[], object]) -> dict[str, float | None]:
    """Ticks a second of each column, medians over interleaved rounds.

    Args:
        args: Settings of the learner.
        ticks: Control ticks of each track in a round, without a learner.
        on_round: Called after each round.
    """
    teach, whole = teacher(args), ticks * len(args.tracks)
    # The compiled core, where there is one, beside the readable controller.
    envs = {
        control: [make_env(replace(args, control=control), track).env for track in args.tracks]
        for control in dict.fromkeys(("python", args.control))
    }
    rates = []
    for k in range(ROUNDS):
        seed = training_seed(args.seed, 2, k)
        played = {control: [play(env, seed, ticks) for env in own] for control, own in envs.items()}
        alone = sum(replay(plant_of(env), *of[1:]) for env, of in zip(envs["python"], played["python"], strict=True))
        python, core = (sum(of[0] for of in played.get(control, ())) for control in ("python", "core"))
        rates.append([whole / alone, whole / python, whole / core if core else math.nan, args.segment / teach(k)])
        on_round()
    medians = np.median(np.array(rates), axis=0).tolist()
    return {name: None if math.isnan(rate) else rate for name, rate in zip(COLUMNS, medians, strict=True)}


def run_speed(*, seconds: float = 0.5, on_step: Callable[[str], object] = lambda _: None) -> dict[str, Any]:
    """All rows as one dictionary, in control ticks a second.

    Args:
        seconds: About how long the environment is stepped in a round [s]; a learner takes a batch, however long.
        on_step: Called with a row's name, `PARTS` times.
    """
    torch.set_num_threads(1)
    ticks, rows = max(4, round(800 * seconds)), {}
    for name, (preset, tracks) in ROWS.items():
        args = settings(preset, tracks)
        found = measure_row(args, ticks, lambda name=name: on_step(name))
        rows[name] = {"preset": preset, "tracks": list(tracks), "learner_control": args.control, "ticks_per_s": found}
    return {"machine": machine() | learner_versions(), "rounds": ROUNDS, "ticks_a_round": ticks, "speed": rows}


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
            aligned([list(HEADS), *cells]),
            "",
            f"one process on one core, medians of {result['rounds']} rounds; the learner: PPO without validations, "
            f"in environments with control = {', '.join(controls)}",
        ]
    )
