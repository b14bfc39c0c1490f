"""Networks of learned policies in the core's order of numbers, and their evaluation in the core."""

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np

from spidar_gym.native.constants import NETWORK_BLOCK
from spidar_gym.native.library import load_core, pointer


def padded(width: int) -> int:
    """Return a number of outputs as whole blocks of `NETWORK_BLOCK`."""
    return -(-width // NETWORK_BLOCK) * NETWORK_BLOCK


class Network:
    """Layers y = σ(W x + b), the last without σ, plus an optional matrix from the input to the last layer.

    The core sums in the order of the inputs, in single precision and without fused operations: the answer has the same
    bits on every processor and on the robot, unlike a product of NumPy's or torch's libraries.
    """

    def __init__(
        self, layers: Sequence[tuple[np.ndarray, np.ndarray]], *, relu: bool = False, skip: np.ndarray | None = None
    ) -> None:
        """Store a network.

        Args:
            layers: W, shape (out, in), and b, (out,), of each layer.
            relu: Whether σ is max(0, x); tanh otherwise.
            skip: Matrix from the input to the last layer, (out, in); none or empty for none.
        """
        self.sizes = np.array([layers[0][0].shape[1], *(len(bias) for _, bias in layers)], np.int32)
        """Number of inputs, and of each layer's outputs."""
        parts = [_blocks(w, b) for w, b in layers]
        self._relu, self._skips = relu, skip is not None and skip.size > 0
        if skip is not None and skip.size:
            parts.append(_blocks(skip, np.zeros(len(skip), np.float32)))
        self.numbers = np.concatenate(parts)
        """All layers in the core's order: weights of every block of outputs by input, then biases, padded with 0."""

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """Return the last layer for inputs of shape (…, in), in single precision: shape (…, out)."""
        x = np.ascontiguousarray(x, np.float32)
        answer = np.empty((*x.shape[:-1], int(self.sizes[-1])), np.float32)
        width = padded(int(self.sizes.max()))
        work = np.empty(2 * width, np.float32)
        evaluate, layers = _evaluation(), len(self.sizes) - 1
        w, sizes, room = pointer(self.numbers), pointer(self.sizes), pointer(work)
        for row, to in zip(x.reshape(-1, x.shape[-1]), answer.reshape(-1, answer.shape[-1]), strict=True):
            evaluate(w, sizes, layers, self._relu, self._skips, pointer(row), room, width, pointer(to))
        return answer


@cache
def _evaluation() -> Callable[..., None]:
    """Return the core's function; pointers are given as such, all else are C's integers."""
    function = load_core().sp_network
    function.restype = None
    return function


def _blocks(weights: np.ndarray, biases: np.ndarray) -> np.ndarray:
    """Return a layer in the core's order."""
    out, size = weights.shape
    whole, last = np.zeros((padded(out), size), np.float32), np.zeros(padded(out), np.float32)
    whole[:out], last[:out] = weights, biases
    return np.concatenate([whole.reshape(-1, NETWORK_BLOCK, size).transpose(0, 2, 1).reshape(-1), last])
