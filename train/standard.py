"""Train a standard algorithm of Stable-Baselines3 on a task of the suite; all tasks have the same hyperparameters.

    python -m train.standard Hover ppo --seed 0

The run is cut into pieces. Each begins with new episodes and its own seed, and ends with an evaluation and a
checkpoint, so that an interrupted run resumes with the result of one that was not interrupted. The evaluations are rows
of a table, `algorithm, task, seed, step, seconds, metric, value`; `spidar suite --runs` collects the tables of runs.
"""

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import tyro

from spidar_gym.benchmark.suite import EPISODES, METRICS, SEED, find_task, play
from spidar_gym.benchmark.suite_results import Result, read_results, results_text
from spidar_gym.cli.run import run as film
from spidar_gym.console import kept, progress, run_cli
from spidar_gym.envs.suite import CLASSICAL, LAZY, SUITE, read_anchors
from spidar_gym.errors import InvalidValueError, require_least, require_name
from spidar_gym.files import output_folder, write_text
from spidar_gym.policies.artifact import ARGUMENT_FORMS, Artifact, LearnedPolicy, write_artifact
from train.lib.run import command_line, require_frameworks

if TYPE_CHECKING:
    from stable_baselines3 import PPO, SAC
    from stable_baselines3.common.vec_env import VecNormalize

NETWORK = {"net_arch": [128, 128]}
NOISE = -1.0
"""Logarithm of the largest deviation of PPO's actions, and of the first."""
ALGORITHMS: Mapping[str, Mapping[str, Any]] = {
    "ppo": {
        "robots": 64, "n_steps": 32, "batch_size": 512, "n_epochs": 5, "gamma": 0.99, "gae_lambda": 0.95,
        "learning_rate": 3e-4, "policy_kwargs": {**NETWORK, "log_std_init": NOISE},
    },
    "sac": {
        "robots": 16, "batch_size": 256, "buffer_size": 300_000, "learning_starts": 5000, "train_freq": 1,
        "gradient_steps": 4, "gamma": 0.99, "tau": 0.005, "ent_coef": 0.001, "learning_rate": 3e-4,
        "policy_kwargs": NETWORK,
    },
}  # fmt: skip
"""Hyperparameters by algorithm, the same for all tasks: number of robots, and arguments of Stable-Baselines3.

Rewards are divided by the deviation of the return (`VecNormalize`); observations are scaled by the tasks. The learning
rate falls to zero in a straight line, piece by piece, and so does the largest deviation of PPO's actions: noise alone
moves a crawling robot, and the policy without noise, which is evaluated and exported, has to learn to do so.

The entropy of SAC's actions has a fixed weight. The automatic one of 40 actions first outweighs the rewards and later
vanishes: on Hover it led to no success in 0.3 M ticks, and this one to 85 % after 0.14 M."""
OUTPUT = {"ppo": "clip", "sac": "tanh"}
"""Conversion of the last layer to an action, by algorithm."""
ACTIVATION = {"ppo": "tanh", "sac": "relu"}
"""Activation of the hidden layers, the default of Stable-Baselines3."""
PIECES = 20
"""Evaluations of a run."""
EVALUATED = 20
"""Episodes of an evaluation before the last one, which has all."""


@dataclass(frozen=True)
class Args:
    """Train one algorithm on one task."""

    task: tyro.conf.Positional[str]
    """Task of the suite: HoverResidual, Hover, Path, Crawl, Steps, Course, HoverCalibrated or CrawlCalibrated."""
    algorithm: tyro.conf.Positional[str]
    """Algorithm: ppo or sac."""
    seed: int = 0
    """Seed of the learner and of the robots."""
    steps: int | None = None
    """Length of training [control ticks of 25 ms, summed over all robots]; the task's budget by default."""
    mode: str | None = None
    """Action mode in place of the task's, such as direct, to see what it is worth."""
    reward: str | None = None
    """Reward of the training in place of the task's, such as narrow; evaluations have the task's."""
    threads: int = 1
    """Threads that simulate robots; they change the time alone."""
    film: Path | None = None
    """Video file of the first evaluated episode (.mp4), written after the training; needs the extra viz."""
    out: Path = Path("out/standard")
    """Folder of the run's folder TASK/ALGORITHM-SEED: results.csv, policy.npz, and the last checkpoint."""

    def __post_init__(self) -> None:
        find_task(self.task)
        require_name("algorithm", self.algorithm, ALGORITHMS)
        if not 0 <= self.seed < 500:
            raise InvalidValueError("seed", self.seed, "0 … 499")
        if self.steps is not None:
            require_least(PIECES * 1000, steps=self.steps)
        require_least(1, threads=self.threads)
        if self.film is not None and self.film.suffix != ".mp4":
            raise InvalidValueError("film", str(self.film), "a path of a file that ends in .mp4")


class Run:
    """The folder of one run, and its learner."""

    def __init__(self, args: Args) -> None:
        """Make the learner, or restore it from the last checkpoint."""
        self.args, self.task = args, SUITE[args.task]
        self.name = "-".join(word for word in (args.task, args.mode, args.reward) if word)
        self.folder = output_folder(args.out / self.name / f"{args.algorithm}-{args.seed}")
        self.steps = args.steps or self.task.budget(args.algorithm)
        self.known = dict(ALGORITHMS[args.algorithm])
        self.robots = self.known.pop("robots")
        self.options = dict(self.task.options)
        """Arguments of the environment, the variant's mode included."""
        if args.mode not in (None, self.options.get("action_mode")):
            self.options = {**self.options, "action_mode": args.mode, "action_scale": None}
        self.rows = self._read()
        self.done = len({row.step for row in self.rows})
        """Number of finished pieces."""
        self.seconds = max((row.seconds for row in self.rows), default=0.0)
        self.env = self._make_env()
        self.model = self._make_model()

    def _read(self) -> list[Result]:
        """Read the rows of the finished pieces; refuse those of a run of another length."""
        path = self.folder / "results.csv"
        rows = read_results(path) if path.exists() else []
        if rows and rows[0].step != self._end(0):
            raise InvalidValueError("steps", self.steps, f"that of the run in {self.folder}, or another --out")
        return rows

    def _end(self, piece: int) -> int:
        """Return the number of ticks at the end of a piece; all robots take whole rollouts."""
        whole = self.robots * self.known.get("n_steps", 1)
        decisions = (piece + 1) * self.steps // (PIECES * self.task.hold)
        return max(piece + 1, -(-decisions // whole)) * whole * self.task.hold

    def _make_env(self) -> "VecNormalize":
        import gymnasium
        from stable_baselines3.common.vec_env import VecNormalize

        from spidar_gym.plugins import StableVecEnv

        options = self.options if self.args.reward is None else {**self.options, "reward": self.args.reward}
        robots = StableVecEnv(
            gymnasium.make_vec(self.task.env_id, num_envs=self.robots, num_threads=self.args.threads, **options)  # pyright: ignore[reportArgumentType] - native
        )
        if self.done:
            return VecNormalize.load(str(self._part("scaling.pkl")), robots)
        return VecNormalize(robots, norm_obs=False, gamma=self.known["gamma"])

    def _make_model(self) -> "PPO | SAC":
        import stable_baselines3
        import torch

        torch.set_num_threads(1)  # the products are small; a second thread would spin between them
        kind = getattr(stable_baselines3, self.args.algorithm.upper())
        if not self.done:
            return kind("MlpPolicy", self.env, seed=self.args.seed, device="cpu", **self.known)
        model = kind.load(self._part("model.zip"), self.env, device="cpu")
        if self._part("buffer.pkl").exists():
            model.load_replay_buffer(self._part("buffer.pkl"))
        return model

    def _part(self, name: str) -> Path:
        """Return the path of a part of the checkpoint after the last piece."""
        return self.folder / f"{self.done:02}-{name}"

    def learn(self) -> None:
        """Train and evaluate until the budget is used."""
        ticks = progress(total=self.steps, initial=self.done * self.steps // PIECES, unit="tick", unit_scale=True)
        with (
            ticks as bar,
            kept(lambda: f"{self.done} of {PIECES} pieces kept in {self.folder}; the same command resumes"),
        ):
            while self.done < PIECES:
                began = time.monotonic()
                self._piece()
                self.seconds += time.monotonic() - began
                self._keep()
                bar.update(self.done * self.steps // PIECES - bar.n)
                bar.set_postfix(self.last)

    @property
    def last(self) -> dict[str, str]:
        """The last evaluation in words."""
        final = [row for row in self.rows if row.step == self.rows[-1].step]
        return {row.metric: f"{row.value:.3g}" for row in final}

    def _piece(self) -> None:
        """Train for a piece, from new episodes with its own seeds."""
        import torch

        model, end, left = self.model, self._end(self.done) // self.task.hold, 1.0 - self.done / PIECES
        model.learning_rate = self.known["learning_rate"] * left
        model._setup_lr_schedule()  # pyright: ignore[reportPrivateUsage] - reads `learning_rate`
        if self.args.algorithm == "ppo":
            with torch.no_grad():
                model.policy.log_std.clamp_(max=NOISE + math.log(left))  # pyright: ignore[reportCallIssue, reportAttributeAccessIssue] - of PPO
        first = (self.args.seed * PIECES + self.done) * self.robots
        assert first + self.robots <= SEED
        model.set_random_seed(first)
        self.env.seed(first)
        model._last_obs = None  # pyright: ignore[reportPrivateUsage] - so that `learn` resets the robots
        model.learn(end - model.num_timesteps, reset_num_timesteps=self.done == 0)

    def artifact(self) -> Artifact:
        """Return the present policy: the mean action."""
        from train.lib.agent import actor_layers

        args, layers, size = self.args, actor_layers(self.model), self.env.observation_space.shape
        assert size is not None
        return Artifact(
            name=f"{self.name}-{args.algorithm}",
            kind="residual" if str(self.options.get("action_mode", "")).startswith("residual") else "learned",
            doc=f"{args.algorithm.upper()} of Stable-Baselines3 on the suite's task {args.task}.",
            env_id=self.task.env_id,
            arguments={name: self.options[name] for name in ARGUMENT_FORMS if self.options.get(name) is not None},
            weights=tuple(weight for weight, _ in layers),
            biases=tuple(bias for _, bias in layers),
            mean=np.zeros(size),
            variance=np.ones(size),
            clip=float(self.env.observation_space.high.max()),  # pyright: ignore[reportAttributeAccessIssue] - a Box
            activation=ACTIVATION[args.algorithm],
            output=OUTPUT[args.algorithm],
            training={
                "command": command_line(), "seed": args.seed, "steps": self.steps,
                "chosen_at": self.model.num_timesteps * self.task.hold,
            },
        )  # fmt: skip

    def _keep(self) -> None:
        """Evaluate the policy, and write the checkpoint and then the table that counts it."""
        args, artifact = self.args, self.artifact()
        found = play(args.task, LearnedPolicy(artifact), EPISODES if self.done + 1 == PIECES else EVALUATED).means
        step = self.model.num_timesteps * self.task.hold
        self.rows += [
            Result(args.algorithm, self.name, args.seed, step, round(self.seconds, 1), metric, value)
            for metric, value in found.items()
        ]
        before = [*self.folder.glob("[0-9][0-9]-*")]
        self.done += 1
        self.model.save(self._part("model.zip"))
        self.env.save(str(self._part("scaling.pkl")))
        if hasattr(self.model, "save_replay_buffer") and self.done < PIECES:
            self.model.save_replay_buffer(self._part("buffer.pkl"))  # pyright: ignore[reportAttributeAccessIssue]
        write_artifact(artifact, self.folder / "policy.npz")
        write_text(self.folder / "results.csv", results_text(self.rows))  # from here on the new checkpoint counts
        for path in before:
            path.unlink()


def verdict(run: Run) -> str:
    """Return the last evaluation in words, beside the policies that anchor the scale."""
    last = {row.metric: row.value for row in run.rows[-len(METRICS) :]}
    scale, task = read_anchors()[run.task.name], run.task
    others = ", ".join(
        f"{name} {found['return']:.0f} in {found['duration_s']:.1f} s"
        for name, found in ((task.classical, scale[CLASSICAL]), *((name, scale[name]) for name in LAZY))
    )
    return (
        f"{task.id} after {run.rows[-1].step / 1e6:.1f} M ticks in {run.seconds / 60.0:.0f} min: success "
        f"{last['success']:.0%}, failure {last['failure']:.0%}, episodes of {last['duration_s']:.1f} s; return "
        f"{last['return']:.0f}, {float(task.normalised(last['return'])):.2f} of the scale ({others})"
    )


def main() -> None:
    """Entry point."""
    args = tyro.cli(Args, description=__doc__, prog="python -m train.standard")
    require_frameworks()
    run = Run(args)
    run.learn()
    print(verdict(run))
    path = str(run.folder / "policy.npz")
    if args.film is None:
        print(f"spidar run {run.task.id} --policy {path} --seed {SEED} --out {run.name}.mp4")
    else:
        film(run.task.id, policy=path, seed=SEED, out=args.film)
        print(args.film)


if __name__ == "__main__":
    run_cli("train.standard", main)
