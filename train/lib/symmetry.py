"""Networks equivariant to 90° rotations of the robot, whose four legs are identical. This module imports torch.

The weights are shared in groups of four, so one flight trains the network as much as four rotated ones would.
"""

from collections.abc import Callable, Sequence

import numpy as np
import torch
from torch import nn

from spidar_gym.policies.torso import Turn
from spidar_gym.robot import N_LEGS


def tie_layers(layers: Sequence[nn.Linear], shown: Turn, said: Turn) -> list[Callable[[], None]]:
    """Make a network equivariant, and keep it so under gradient updates.

    A rotation by 90° permutes the four groups of units of each hidden layer. The last bias is not tied: the flight
    controller and the computer are mounted off the torso's axis, which causes a constant torque.

    Args:
        layers: Layers from input to output. A layer with a skip connection has the network's input after its units.
        shown: Effect of the rotation on the input.
        said: Effect of the rotation on the output.

    Returns:
        Functions that tie the parameters again, one for each parameter; see `tie`.
    """
    before, again = shown, []
    for layer in layers:
        last = layer is layers[-1]
        after = said if last else Turn.passed_on(layer.out_features)
        if layer.in_features > len(before.places):
            before = Turn.joined([before, shown])
        again.append(tie(layer.weight, after, before))
        if not last:
            again.append(tie(layer.bias, after))
        before = after
    return again


def tie(parameter: torch.Tensor, *turns: Turn) -> Callable[[], None]:
    """Make a parameter, and all later gradients of it, invariant to rotations of its axes.

    Returns:
        A function that ties the parameter again after optimiser steps with rounding errors: Muon keeps only eight
        significant bits of each number on some processors.
    """
    places = np.ix_(*(turn.places for turn in turns))
    flat = torch.from_numpy(np.arange(parameter.numel()).reshape(parameter.shape)[places])
    signs = turns[0].signs if len(turns) == 1 else np.multiply.outer(*(turn.signs for turn in turns))
    factor = torch.tensor(signs, dtype=torch.float32)

    def alike(values: torch.Tensor) -> torch.Tensor:
        total = turned = values
        for _ in range(N_LEGS - 1):
            turned = factor * turned.flatten()[flat]
            total = total + turned
        return total / N_LEGS

    with torch.no_grad():
        # The mean of four independent weights has half the standard deviation of each; the factor 2 restores it.
        parameter.copy_(alike(parameter) * (2.0 if parameter.dim() == 2 else 1.0))
    parameter.register_hook(alike)

    def again() -> None:
        with torch.no_grad():
            parameter.copy_(alike(parameter))

    return again
