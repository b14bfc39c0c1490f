"""Network of imitation learning: its optimisation, its buffer of lessons, and its state as arrays for checkpoints.

Torch is imported when a student is created, so that `--help` works without it.
"""

import copy
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from spidar_gym.errors import InvalidValueError, require_above, require_least
from spidar_gym.policies import torso
from spidar_gym.robot import N_LEGS, N_ROTORS
from train.lib.envs import Scaling, scaling_of

if TYPE_CHECKING:
    import torch

    from train.lib.taught import Lessons

FORCE, NET_FORCE, NET_TORQUE = 2.0, 0.5, 0.1
"""Units of the loss, errors that count alike: of a rotor's force [N], the total force [N] and the total torque [Nm].

The joint outputs are not learned; joints move to their form automatically. Learned changes of 5 mrad per tick were not
accurate enough to reach the form.
"""
REMEMBERED = (("momentum_buffer",), ("step", "exp_avg", "exp_avg_sq"))
"""State of the two optimisers, Muon and Adam, for a parameter."""


@dataclass(frozen=True)
class StudyConfig:
    """Network and optimisation."""

    hidden: int = 64
    """Width of the two hidden layers."""
    lr: float = 2e-3
    """Initial learning rate; it falls to a fiftieth along a cosine."""
    batch: int = 1024
    """Samples in an optimiser step."""
    first_updates: int = 1500
    """Optimiser steps on the controller's own flights, before the first round."""
    updates: int = 120
    """Optimiser steps per round."""
    room: int = 1_000_000
    """Size of the buffer [samples]; the oldest are overwritten."""
    average: int = 500
    """Optimiser steps over which the weights are averaged."""
    symmetric: bool = True
    """Whether the network is equivariant to 90° rotations of the robot."""

    def __post_init__(self) -> None:
        require_least(1, hidden=self.hidden, batch=self.batch, updates=self.updates, room=self.room)
        require_least(1, first_updates=self.first_updates, average=self.average)
        require_above("1", lr=self.lr)
        if self.symmetric and self.hidden % N_LEGS:
            raise InvalidValueError("hidden", self.hidden, f"a multiple of {N_LEGS}: each leg has as many units")


class Shelf:
    """Ring buffer of lessons."""

    def __init__(self, room: int, first: "Lessons") -> None:
        """Allocate the buffer and add the first lessons."""
        self._columns = [np.zeros((room, *column.shape[1:]), np.float32) for column in _columns(first)]
        self._next, self.count = 0, 0
        self.add(first)

    def add(self, lessons: "Lessons") -> None:
        """Add lessons, overwriting the oldest if the buffer is full."""
        room, rows = len(self._columns[0]), len(lessons.weights)
        ids = (self._next + np.arange(rows)) % room
        for column, new in zip(self._columns, _columns(lessons), strict=True):
            column[ids] = new
        self._next, self.count = int((self._next + rows) % room), min(room, self.count + rows)

    def draw(self, rng: np.random.Generator, count: int) -> list["torch.Tensor"]:
        """Sample lessons with replacement: inputs, answers, levers, weights."""
        import torch

        ids = rng.integers(0, self.count, count)
        return [torch.from_numpy(column[ids]) for column in self._columns]


def _columns(lessons: "Lessons") -> tuple[np.ndarray, ...]:
    return lessons.inputs, lessons.answers, lessons.levers, lessons.weights


def loss_of(said: "torch.Tensor", answers: "torch.Tensor", levers: "torch.Tensor", weights: "torch.Tensor") -> Any:  # noqa: ANN401 - torch's
    """Compute the loss: errors of the rotors' forces and of the total wrench, each in its unit.

    The wrench has its own term because only the wrench moves the robot; force errors that cancel each other cost only
    thrust. The loss grows linearly for large errors, so that rare large errors do not outweigh all others.
    """
    import torch

    forces = torso.FORCE * (said - answers)[:, : 3 * N_ROTORS].reshape(levers.shape)
    torque = torch.cross(levers, forces, dim=-1).sum(1)
    total = (
        (forces**2).sum((1, 2)) / FORCE**2
        + (forces.sum(1) ** 2).sum(1) / NET_FORCE**2
        + (torque**2).sum(1) / NET_TORQUE**2
    )
    return (weights * (torch.sqrt(1.0 + total / 4.0) - 1.0)).mean()


class Student:
    """Network, its optimisers, and its averaged weights, which are used for flying."""

    def __init__(self, config: StudyConfig, scaling: Scaling, answer: np.ndarray, updates: int) -> None:
        """Create a network with a constant initial output.

        Args:
            config: Network and optimiser.
            scaling: Scaling of the inputs, from `scaling_for`.
            answer: Initial output, the mean of the teacher's first answers, (40,).
            updates: Total number of optimiser steps.
        """
        import torch
        from torch import nn

        from train.lib.symmetry import tie, tie_layers

        self._config, self._updates, self.done = config, updates, 0
        self.scaling = scaling
        self._mean = torch.tensor(scaling.mean, dtype=torch.float32)
        self._deviation = torch.tensor(np.sqrt(scaling.variance), dtype=torch.float32)
        sizes = (len(scaling.mean), config.hidden, config.hidden, len(answer))
        self.network: Any = nn.ModuleList([nn.Linear(n, m) for n, m in pairwise(sizes)])
        self.network.append(nn.Linear(sizes[0], sizes[-1], bias=False))
        *hidden, last, skip = self.network
        assert isinstance(last, nn.Linear)
        assert isinstance(skip, nn.Linear)
        with torch.no_grad():
            skip.weight.zero_()
            nn.init.normal_(last.weight, std=0.01)
            last.weight[3 * N_ROTORS :] = 0.0  # joint outputs stay 0: the loss does not include them
            last.bias.copy_(torch.from_numpy(answer))
        self._tie_again: list[Callable[[], None]] = []
        if config.symmetric:
            turn = shown_turn(len(scaling.mean))
            self._tie_again += tie_layers([*hidden, last], turn, torso.SAID_TURN)
            self._tie_again.append(tie(skip.weight, torso.SAID_TURN, turn))
        matrices = [layer.weight for layer in (*hidden, last)]
        rest = [p for p in self.network.parameters() if all(p is not m for m in matrices)]
        # Muon (Jordan et al. 2024) takes steps of equal size in all directions of a matrix; rare ones are learned, too.
        self._optimizers = [
            torch.optim.Muon(matrices, lr=config.lr, weight_decay=0.0, adjust_lr_fn="match_rms_adamw"),
            torch.optim.Adam(rest, lr=config.lr),
        ]
        self.average: Any = copy.deepcopy(self.network)

    def _say(self, layers: Any, inputs: "torch.Tensor") -> "torch.Tensor":  # noqa: ANN401 - torch's
        import torch

        x = ((inputs - self._mean) / self._deviation).clamp(-self.scaling.clip, self.scaling.clip)
        first, second, last, skip = layers
        return last(torch.relu(second(torch.relu(first(x))))) + skip(x)

    def learn(self, lessons: list["torch.Tensor"]) -> float:
        """Take an optimiser step; return the loss before it."""
        import torch

        config = self._config
        lr = config.lr * max(0.02, 0.5 * (1.0 + np.cos(np.pi * self.done / self._updates)))
        inputs, answers, levers, weights = lessons
        loss = loss_of(self._say(self.network, inputs), answers, levers, weights)
        for optimizer in self._optimizers:
            for group in optimizer.param_groups:
                group["lr"] = lr
            optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), 1.0)
        for optimizer in self._optimizers:
            optimizer.step()
        for tie_again in self._tie_again:
            tie_again()
        self.done += 1
        with torch.no_grad():
            share = 1.0 / min(self.done, config.average)
            for mean, now in zip(self.average.parameters(), self.network.parameters(), strict=True):
                mean.lerp_(now, share)
        return loss.item()

    def frozen(self) -> Callable[[np.ndarray], np.ndarray]:
        """Return a copy of the averaged network as a function: inputs → outputs."""
        import torch

        layers = copy.deepcopy(self.average)

        def say(inputs: np.ndarray) -> np.ndarray:
            with torch.no_grad():
                return self._say(layers, torch.from_numpy(inputs)).numpy()

        return say

    def _tensors(self) -> "Iterator[tuple[str, torch.Tensor]]":
        """Yield all tensors that training changes, by name; missing optimiser states are initialised to zeros."""
        import torch

        for name, layers in (("network", self.network), ("average", self.average)):
            yield from ((f"{name}/{key}", tensor) for key, tensor in layers.state_dict().items())
        for optimizer, names in zip(self._optimizers, REMEMBERED, strict=True):
            for k, parameter in enumerate(optimizer.param_groups[0]["params"]):
                memory = optimizer.state[parameter]
                for name in names:
                    if name not in memory:
                        memory[name] = torch.zeros(()) if name == "step" else torch.zeros_like(parameter)
                    yield f"{type(optimizer).__name__}/{k}/{name}", memory[name]

    def save(self) -> dict[str, Any]:
        """Return network, average and optimisers as arrays by name, and the number of steps done."""
        return {name: tensor.detach().numpy().copy() for name, tensor in self._tensors()} | {"done": self.done}

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Restore a state from `save` of a student with the same settings."""
        import torch

        with torch.no_grad():
            for name, tensor in self._tensors():
                tensor.copy_(torch.from_numpy(saved[name]))
        self.done = int(saved["done"])


def shown_turn(inputs: int) -> torso.Turn:
    """Return the effect of a 90° rotation on the inputs of a network with this number of inputs."""
    return torso.shown_turn(inputs - torso.FEATURES)


def scaling_for(config: StudyConfig, lessons: "Lessons") -> Scaling:
    """Compute the input scaling from the teacher's flights; equal for all legs if the network is symmetric."""
    bound = np.maximum(np.abs(lessons.inputs).max(axis=0), 1.0)
    found = scaling_of(lessons.inputs, bound)
    return found.alike(shown_turn(len(found.mean))) if config.symmetric else found
