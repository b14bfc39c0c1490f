"""Modes as data: the blocks of the paper's allocation and of the one that was flown."""

from spidar_gym.control.allocation.blocks import (
    InterferenceBound,
    JointTorqueEffort,
    JointTorqueLimit,
    ThrustBox,
    ThrustEffort,
    VectoringLock,
    WrenchBalance,
)
from spidar_gym.control.allocation.contact import ContactWrenchRange, FootEffort, FrictionPyramid, PowerEffort
from spidar_gym.control.allocation.problem import Constraint, Cost, Mode
from spidar_gym.errors import UnknownNameError

AS_FLOWN_THRUST = 40.0
"""Half the side of the box to which the lab's flight controller limited a force [JSK] [N]."""
FORCE_ROWS = (VectoringLock(), InterferenceBound())
"""[Zhao2025, Eq. 30-32]; without interference avoidance they still enforce the φ lock near a vertical link."""


def _flight(costs: tuple[Cost, ...], constraints: tuple[Constraint, ...]) -> dict[str, Mode]:
    """Build the two flight modes of an allocation: with interference avoidance, and the paper's baseline without."""
    return {
        mode.name: mode
        for mode in (
            Mode("flight", costs, (*constraints, *FORCE_ROWS)),
            Mode("flight_unrestricted", costs, (*constraints, *FORCE_ROWS), avoid_interference=False),
        )
    }


ALLOCATIONS: dict[str, dict[str, Mode]] = {
    # [Zhao2025, Eq. 9-13, 30-32] with w₁ = 1 N⁻² and w₂ = 1 (Nm)⁻²; the paper does not state its weights.
    "paper": _flight(
        costs=(ThrustEffort(1.0), JointTorqueEffort(1.0)),
        constraints=(WrenchBalance(), ThrustBox(), JointTorqueLimit()),
    ),
    # The allocation of the lab's flight controller [JSK]: ‖f‖² alone, no joint torque rows, a box of 40 N.
    "as_flown": _flight(costs=(ThrustEffort(1.0),), constraints=(WrenchBalance(), ThrustBox(AS_FLOWN_THRUST))),
}
"""Allocations by name; each maps names to modes."""

PROJECTION = Mode("projection", costs=(ThrustEffort(),), constraints=(ThrustBox(), JointTorqueLimit(), *FORCE_ROWS))
"""The mode that makes learned forces valid in every allocation: [Zhao2025, Eq. 12, 13, 30-32]."""


def find_allocation(name: str) -> dict[str, Mode]:
    """Return the modes of an allocation by name (`UnknownNameError` lists the valid ones)."""
    if name not in ALLOCATIONS:
        raise UnknownNameError("allocation", name, ALLOCATIONS)
    return ALLOCATIONS[name]


def ground_modes(
    *, power: bool, torque_weight: float, torque_limit: float, foot_friction: float, peg_friction: float,
    min_normal: float,
) -> dict[str, Mode]:  # fmt: skip
    """Build the modes of the crawl by name.

    `rest`: torso and feet are on the floor, no thrust. `leg`: some legs are lifted, [Zhao2025, Eq. 9, 11-13] for their
    rotors. `legs`: all legs are lifted, the torso is on its pegs, with [Zhao2025, Eq. 37]. `stance`: the feet carry the
    robot while the torso moves or stands, with the floor's forces as unknowns.

    Args:
        power: Whether to minimise Σ λ^1.5 instead of the paper's Σ ‖f‖².
        torque_weight: w₂ of [Zhao2025, Eq. 9] [1/(Nm)²].
        torque_limit: τ̄_q of the allocation, below the servo's limit by a margin [Nm].
        foot_friction: Planned friction of the feet.
        peg_friction: Planned friction of the pegs.
        min_normal: Smallest normal force of all pegs together [N].
    """
    effort = PowerEffort() if power else ThrustEffort()
    costs = (effort, JointTorqueEffort(torque_weight))
    links = (ThrustBox(), JointTorqueLimit(torque_limit), VectoringLock())
    pegs, feet = ContactWrenchRange(peg_friction, min_normal), FrictionPyramid(foot_friction)
    return {
        mode.name: mode
        for mode in (
            Mode("rest", (ThrustEffort(),), (ThrustBox(),), avoid_interference=False),
            Mode("leg", costs, links, avoid_interference=False),
            Mode("legs", costs, (pegs, *links), avoid_interference=False),
            Mode("stance", (*costs, FootEffort()), (WrenchBalance(), feet, *links), False, feet_carry=True),
        )
    }
