"""Constants and a comparison shared by the tests of the compensations."""

import numpy as np

DT = 0.025
LEVEL = np.zeros((8, 2))
STILL = np.zeros(3)


def close(actual, desired, *, atol=1e-9):
    np.testing.assert_allclose(actual, desired, rtol=0, atol=atol)
