"""Networks that do with what is turned by 90° what they do, turned: the robot's four legs are alike. It loads torch.

A network of whose weights four and four are the same learns from one flight what it would from four.
"""

from collections.abc import Callable, Sequence

import numpy as np
import torch
from torch import nn

from spidar_gym.policies.torso import Turn
from spidar_gym.robot import N_LEGS


def tie_layers(layers: Sequence[nn.Linear], shown: Turn, said: Turn) -> list[Callable[[], None]]:
    """Make a network symmetric, now and as long as only gradients change it; calls that do it again, see `tie`.

    The units of a hidden layer are four groups that take turns. The last bias is free: the torso carries a flight
    controller and a computer beside its axis, which is a constant torque.

    Args:
        layers: From what is shown to what is said; a layer that sees what is shown again has it behind its units.
        shown: The turn of what is shown.
        said: That of what is said.
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
    """Make a parameter, and its gradients from now on, the same whichever way its axes are turned.

    Returns:
        A call that makes the parameter the same again, for after steps that round: Muon works with eight bits of every
        number, on some processors.
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
        # Of independent weights, the mean of four is half as large as each.
        parameter.copy_(alike(parameter) * (2.0 if parameter.dim() == 2 else 1.0))
    parameter.register_hook(alike)

    def again() -> None:
        with torch.no_grad():
            parameter.copy_(alike(parameter))

    return again
