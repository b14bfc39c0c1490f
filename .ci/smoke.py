"""What a wheel without the checkout must do: fly and crawl a second, rank a policy, draw nothing, import no torch."""

import sys
from pathlib import Path

import gymnasium
import numpy as np

import spidar_gym
from spidar_gym.benchmark.row import committed_row, read_row
from spidar_gym.cli.main import main

for control in ("python", "core"):  # the latter is compiled, and has come with the wheel
    env = gymnasium.make("spidar_gym/Hover-v0", forms="form2", perturbation=0.0, control=control)
    env.reset(seed=0)
    for _ in range(40):
        _, reward, terminated, _, info = env.step(np.zeros(6))
    assert not terminated, info
    assert np.linalg.norm(info["position_error"]) < 0.01, info
    env.close()
    crawl = gymnasium.make("spidar_gym/Crawl-v0", control=control)
    crawl.reset(seed=0)
    for _ in range(40):
        _, reward, terminated, _, info = crawl.step(np.zeros(crawl.action_space.shape))
    assert not terminated, info
    crawl.close()
assert not {"torch", "stable_baselines3", "matplotlib"} & sys.modules.keys()
main(["list"])
Path("mine.py").write_text(
    "import numpy as np\n"
    "class Zero:\n"
    "    def arguments(self, env_id): return {'action_mode': 'residual_wrench'} if 'Hover' in env_id else None\n"
    "    def reset(self, seed): pass\n"
    "    def act(self, observation): return np.zeros(6)\n"
)
main(["eval", "--policy", "mine:Zero", "--tracks", "flight-fast5", "--scenarios", "2", "--workers", "1"])
row = read_row(Path("out/scores/zero.json"))
assert committed_row() is not None, "the wheel has what scores refer to"
np.testing.assert_allclose(row.errors("flight-fast5")[0], committed_row().errors("flight-fast5")[0, :2], rtol=0.02)
main(["assets", "--check"])
print("spidar_gym", spidar_gym.__version__, "flies from", spidar_gym.__file__)
