"""What a wheel without the checkout must do: register, fly a second, draw nothing, import no learning framework."""

import sys

import gymnasium
import numpy as np

import spidar_gym
from spidar_gym.cli import main

env = gymnasium.make("spidar_gym/Hover-v0", forms="form2", perturbation=0.0)
env.reset(seed=0)
for _ in range(40):
    _, reward, terminated, _, info = env.step(np.zeros(6))
assert not terminated, info
assert np.linalg.norm(info["position_error"]) < 0.01, info
assert not {"torch", "stable_baselines3", "matplotlib"} & sys.modules.keys()
main(["list"])
main(["assets", "--check"])
print("spidar_gym", spidar_gym.__version__, "flies from", spidar_gym.__file__)
