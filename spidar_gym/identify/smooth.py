"""Smooth curves through samples: least-squares splines with knots farther apart than the samples."""

import numpy as np
from scipy.interpolate import BSpline, make_lsq_spline


def smoothed(time: np.ndarray, values: np.ndarray, knots: float) -> BSpline:
    """Return a cubic spline through samples.

    Args:
        time: Times (n,), rising [s].
        values: Samples (n, …).
        knots: Distance of the knots [s]; where samples are missing for longer, knots are left out.
    """
    inner = np.arange(time[0], time[-1], knots)[1:-1]
    places = np.searchsorted(time, inner)
    inner = inner[np.diff(places, append=len(time)) > 0]  # each interval needs a sample
    ends = np.repeat([time[0], time[-1]], 4).reshape(2, 4)
    return make_lsq_spline(time, values, np.concatenate([ends[0], inner, ends[1]]), 3)
