"""Smoke test of a wheel without the checkout: fly, crawl, rank, run committed policies, export; no torch."""

import importlib.util
import multiprocessing
import sys
from pathlib import Path

import gymnasium
import numpy as np

import spidar_gym
from spidar_gym.benchmark.row import committed_row, committed_rows, read_row
from spidar_gym.cli.main import main
from spidar_gym.committed import committed_artifacts
from spidar_gym.policies.load import load_policy


def fly_and_crawl() -> None:
    """Run both environments with both controllers."""
    for control in ("python", "core"):  # the C core is part of the wheel
        env = gymnasium.make("spidar_gym/Hover-v0", forms="form2", perturbation=0.0, control=control)
        env.reset(seed=0)
        for _ in range(40):
            *_, terminated, _, info = env.step(np.zeros(6))
        assert not terminated, info
        assert np.linalg.norm(info["position_error"]) < 0.01, info
        env.close()
        crawl = gymnasium.make("spidar_gym/Crawl-v0", control=control)
        crawl.reset(seed=0)
        for _ in range(40):
            *_, terminated, _, info = crawl.step(np.zeros(crawl.action_space.shape))
        assert not terminated, info
        crawl.close()


def rank() -> None:
    """Evaluate a custom policy and the committed ones, by their names in a checkout."""
    Path("mine.py").write_text(
        "import numpy as np\n"
        "class Zero:\n"
        "    def arguments(self, env_id):\n"
        "        return {'action_mode': 'residual_wrench'} if 'Hover' in env_id else None\n"
        "    def reset(self, seed): pass\n"
        "    def act(self, observation): return np.zeros(6)\n"
    )
    main(["eval", "--policy", "mine:Zero", "--tracks", "flight-fast5", "--scenarios", "2", "--workers", "1"])
    row, reference = read_row(Path("out/scores/zero.json")), committed_row()
    assert reference is not None, "the wheel contains the reference row"
    np.testing.assert_allclose(row.errors("flight-fast5")[0], reference.errors("flight-fast5")[0, :2], rtol=0.02)
    main(["leaderboard", "show", "--rows", "out/scores", "--tracks", "flight-fast5"])
    main(["leaderboard", "compare", "--row", "baselines/scores/qp_tuned.json"])
    # In spawned processes, which share no state with this one.
    main(["leaderboard", "verify", "--sample", "3", "--seed", "1", "--workers", "2"])


def committed() -> None:
    """Load every committed policy, and fly two of them."""
    specs = {spec for row in committed_rows().values() for spec in row.policies}
    assert set(committed_artifacts()) <= specs
    for spec in specs:
        load_policy(spec)
    for spec in ("baselines.adrc:Adrc", "baselines/learned/memory/seed0.npz"):
        main(["run", "--policy", spec, "--seconds", "0.5"])


if __name__ == "__main__":
    multiprocessing.set_start_method("spawn")
    assert importlib.util.find_spec("baselines") is None, "no package `baselines` is installed"
    fly_and_crawl()
    assert not {"torch", "stable_baselines3", "matplotlib"} & sys.modules.keys()
    main(["list"])
    rank()
    committed()
    main(["export", "--out", "onboard"])
    main(["assets", "--check"])
    print("spidar_gym", spidar_gym.__version__, "flies from", spidar_gym.__file__, "on Python", sys.version.split()[0])
