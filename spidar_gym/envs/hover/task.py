"""Ranges of sampled forms, imported from here by `baselines/planning.py`, whose bytes are pinned in its row."""

from spidar_gym.tasks.hover import DRAWN_FORMS

__all__ = ["DRAWN_FORMS"]
