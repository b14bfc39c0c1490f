"""What `baselines/planning.py`, whose bytes its row holds, imports from here: ranges of drawn forms."""

from spidar_gym.tasks.hover import DRAWN_FORMS

__all__ = ["DRAWN_FORMS"]
