"""Modes as data: which blocks make the paper's allocation, and which the one that was flown."""

from spidar_gym.control.blocks import (
    InterferenceBound,
    JointTorqueEffort,
    JointTorqueLimit,
    ThrustBox,
    ThrustEffort,
    VectoringLock,
    WrenchBalance,
)
from spidar_gym.control.qp import Constraint, Cost, Mode
from spidar_gym.errors import UnknownNameError

FORCE_ROWS = (VectoringLock(), InterferenceBound())
"""[Zhao2025, Eq. 30-32]; a mode that drops them still keeps φ locked near a vertical link."""


def _flight(costs: tuple[Cost, ...], constraints: tuple[Constraint, ...]) -> dict[str, Mode]:
    """The two flight modes of an allocation: with interference avoidance, and the paper's baseline without."""
    return {
        mode.name: mode
        for mode in (
            Mode("flight", costs, (*constraints, *FORCE_ROWS)),
            Mode("flight_unrestricted", costs, (*constraints, *FORCE_ROWS), avoid_interference=False),
        )
    }


ALLOCATIONS: dict[str, dict[str, Mode]] = {
    # [Zhao2025, Eq. 9-13, 30-32] with w₁ = 1 N⁻² and w₂ = 1 (Nm)⁻²; the paper gives no weights.
    "paper": _flight(
        costs=(ThrustEffort(1.0), JointTorqueEffort(1.0)),
        constraints=(WrenchBalance(), ThrustBox(), JointTorqueLimit()),
    ),
    # What the lab's flight controller ran [JSK]: ‖f‖² alone, no joint torque rows, a box of 40 N.
    "as_flown": _flight(costs=(ThrustEffort(1.0),), constraints=(WrenchBalance(), ThrustBox(40.0))),
}
"""Allocations by name; each maps the names of its modes to them."""

PROJECTION = Mode("projection", costs=(ThrustEffort(),), constraints=(ThrustBox(), JointTorqueLimit(), *FORCE_ROWS))
"""The rows that a learned force is moved into, whatever the allocation: [Zhao2025, Eq. 12, 13, 30-32]."""


def find_allocation(name: str) -> dict[str, Mode]:
    """The modes of an allocation by name (`UnknownNameError` lists the valid ones)."""
    if name not in ALLOCATIONS:
        raise UnknownNameError("allocation", name, ALLOCATIONS)
    return ALLOCATIONS[name]
