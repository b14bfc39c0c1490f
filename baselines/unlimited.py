"""`unlimited`: the least thrust that gives the wrench, whatever the joint servos have to bear."""

from collections.abc import Mapping
from dataclasses import replace

from spidar_gym.benchmark import HOVER, PresetPolicy
from spidar_gym.control import Allocator
from spidar_gym.control.allocation.allocator import AllocatorConfig
from spidar_gym.control.allocation.blocks import JointTorqueEffort, JointTorqueLimit
from spidar_gym.control.allocation.problem import Mode


class WithoutTorques(Allocator):
    """[Zhao2025, Eq. 9-13, 30-32] without the joint torques: neither their cost nor their bound."""

    def __init__(self, modes: Mapping[str, Mode], config: AllocatorConfig | None = None) -> None:
        """Take the modes by name, and leave the torques out of them."""
        super().__init__({name: _without_torques(mode) for name, mode in modes.items()}, config)


def _without_torques(mode: Mode) -> Mode:
    """The same mode, to which a joint torque is nothing."""
    return replace(
        mode,
        costs=tuple(cost for cost in mode.costs if not isinstance(cost, JointTorqueEffort)),
        constraints=tuple(rows for rows in mode.constraints if not isinstance(rows, JointTorqueLimit)),
    )


class Unlimited(PresetPolicy):
    """The paper's controller whose QP knows no joint torque: least ‖f‖², every other row kept; flights only."""

    presets = {HOVER: {"preset": "paper", "allocator": WithoutTorques}}  # noqa: RUF012
