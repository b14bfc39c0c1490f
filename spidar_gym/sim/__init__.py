"""The simulated robot: MuJoCo and models of the hardware, independent of any controller."""

from spidar_gym.sim.opengl import import_mujoco

import_mujoco()  # before any module of this package imports it
