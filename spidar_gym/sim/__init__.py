"""The simulated robot: MuJoCo and everything that imitates hardware. It knows no controller."""

import ctypes.util
import os
import sys

if sys.platform == "linux" and not {"MUJOCO_GL", "DISPLAY", "WAYLAND_DISPLAY"} & os.environ.keys():
    # Without a screen MuJoCo needs to be told which off-screen library to draw with, before its first import.
    for library, backend in (("EGL", "egl"), ("OSMesa", "osmesa")):
        if ctypes.util.find_library(library):
            os.environ["MUJOCO_GL"] = backend
            break
