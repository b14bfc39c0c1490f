"""Measure the speed of the bare physics, the engine, and the engine with a learner; takes minutes.

python -m train.speed
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import tyro

from spidar_gym.arguments import Flag
from spidar_gym.cli.bench import ROUNDS, machine
from spidar_gym.console import named_steps, progress, run_cli
from spidar_gym.errors import require_above
from spidar_gym.files import json_text
from spidar_gym.native.bare import BarePhysics
from spidar_gym.text import format_table
from train import residual
from train.lib.config import override
from train.lib.envs import NOMINAL, training_seed
from train.lib.run import FRAMEWORKS, require_frameworks
from train.residual import make_agent, make_robots, make_scaling

ROWS: dict[str, tuple[str, tuple[str, ...]]] = {
    "flight": ("hover-paper-ppo", NOMINAL),
    "flight, drawn robots, sensors": ("hover-paper-ppo", ("flight-randomised",)),
    "crawl, the paper's 0.6 m": ("crawl-ppo", ("ground-paper",)),
    "crawl, drawn robots, sensors": ("crawl-ppo", ("ground-randomised",)),
}
"""Row → preset of `train.residual` and its tracks; the first and the last row have the preset's own tracks."""
TURN, WARM = 4, 60
"""Control ticks of a turn of engine or bare physics, short as a machine's speed varies; warm-up ticks."""
PARTS = len(ROWS) * ROUNDS
"""Number of steps that `run_speed` reports."""
COLUMNS = ("bare", "engine", "learner")
"""Keys of a row's results."""
HEADS = ("control ticks/s, 40 are real time", "robots", "bare physics", "the engine", "+ learner")


def settings(preset: str, tracks: tuple[str, ...]) -> residual.Args:
    """Return a preset's settings with a learning actor from the first tick, and segments of one rollout."""
    args = override(residual.PRESETS[preset], tracks=tracks, critic_first=0)
    rollout = args.learner.ppo.n_steps * args.schedule.envs
    return override(args, segment=rollout * args.env.hold)


def measure_row(args: residual.Args, turns: int, on_round: Callable[[], object]) -> dict[str, float]:
    """Measure control ticks per second of each column for all robots together: medians over interleaved rounds.

    Args:
        args: Settings of the learner.
        turns: Number of turns of engine and bare physics in a round.
        on_round: Called after each round.
    """
    from train.lib import agent  # imported late so that `--help` works without torch

    robots = make_robots(args, make_scaling(args))
    model = make_agent(args, robots)
    actor = agent.ActorSchedule(args.learner, agent.actor_layers(model))
    schedule, rates = args.schedule, []
    bare = [BarePhysics(vector.fleet.engine, schedule.threads) for vector in robots.vectors]

    def play(ticks: int) -> None:
        for vector in robots.vectors:
            action = np.zeros(vector.action_space.shape)
            for _ in range(ticks):
                vector.advance(action)

    def fall() -> None:
        for each in bare:
            each.step(TURN)

    for k in range(ROUNDS):
        robots.seed(training_seed(args.seed, 2, k))
        robots.reset()
        engine = alone = 0.0
        play(WARM)
        for _ in range(turns):
            engine += _seconds(lambda: play(TURN))
            for each, vector in zip(bare, robots.vectors, strict=True):
                each.take(vector.fleet.engine)
            alone += _seconds(fall)
        seed, steps = training_seed(args.seed, 1, k), schedule.segment // args.env.hold
        learner = _seconds(
            lambda seed=seed, steps=steps, first=k == 0: agent.learn_segment(
                model, robots, actor, steps=steps, seed=seed, lr=args.learner.lr, first=first
            )
        )
        played = turns * TURN * schedule.envs
        rates.append([played / alone, played / engine, schedule.segment / learner])
        on_round()
    for each in (*bare, robots):
        each.close()
    return dict(zip(COLUMNS, np.median(np.array(rates), axis=0).tolist(), strict=True))


def _seconds(work: Callable[[], object]) -> float:
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def run_speed(*, seconds: float = 0.5, on_step: Callable[[str], object] = lambda _: None) -> dict[str, Any]:
    """Measure all rows [control ticks/s].

    Args:
        seconds: Approximate time per round in which the robots are stepped [s]; a learner takes a whole rollout.
        on_step: Called `PARTS` times, with a row's name.
    """
    rows = {}
    for name, (preset, tracks) in ROWS.items():
        args = settings(preset, tracks)
        turns = max(1, round(4000 * seconds / args.schedule.envs / TURN))
        found = measure_row(args, turns, lambda name=name: on_step(name))
        rows[name] = {
            "preset": preset,
            "tracks": list(tracks),
            "robots": args.schedule.envs,
            "threads": args.schedule.threads,
            "ticks_per_s": found,
        }
    return {"machine": machine(*FRAMEWORKS), "rounds": ROUNDS, "speed": rows}


def speed_table(result: dict[str, Any]) -> str:
    """Format the results as text."""
    rows = result["speed"]
    cells = [
        [name, str(row["robots"]), *(f"{rate:.0f}" for rate in row["ticks_per_s"].values())]
        for name, row in rows.items()
    ]
    threads = sorted({row["threads"] for row in rows.values()})
    return "\n".join(
        [
            ", ".join(f"{name} {value}" for name, value in result["machine"].items()),
            "",
            format_table([list(HEADS), *cells]),
            "",
            f"threads: {', '.join(map(str, threads))}; wall-clock times, medians of {result['rounds']} rounds; bare "
            "physics: 10 × mj_step of the same robots; the learner: PPO without validations",
        ]
    )


@dataclass(frozen=True)
class Args:
    """Measure control ticks per second of the bare physics, of the engine, and of the engine with a learner."""

    seconds: float = 0.5
    """Approximate time per round in which the robots are stepped [s]; a learner takes a whole rollout."""
    json: Flag = False
    """Print one JSON object, and nothing else, on stdout."""

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
