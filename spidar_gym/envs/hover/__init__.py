"""An import path that a committed baseline names; the environment is `envs/hover_env.py`, its task `tasks/hover.py`."""
