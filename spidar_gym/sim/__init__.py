"""The simulated robot: MuJoCo and everything that imitates hardware. It knows no controller."""

from spidar_gym.sim.opengl import import_mujoco

import_mujoco()  # before any module of this package does
