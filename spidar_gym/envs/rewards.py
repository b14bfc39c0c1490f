"""Reward terms that tasks share: every one lies in [0, 1]."""

import math

import numpy as np


def tolerance(error: float, margin: float) -> float:
    """1 at no error, ½ at `margin`, falling towards 0: 1 / (1 + (error / margin)²)."""
    ratio = error / margin
    return 1.0 / (1.0 + ratio * ratio)


def norm(v: np.ndarray) -> float:
    """Euclidean length."""
    return math.sqrt(float(v @ v))
