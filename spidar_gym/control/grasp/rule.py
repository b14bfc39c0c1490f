"""The rule: which orders carry an object to its goal, and when to try again."""

import math
from dataclasses import dataclass

from spidar_gym.control.grasp.phases import Seen
from spidar_gym.control.grasp.scene import GraspScene
from spidar_gym.control.locomotion.commands import CarryTo, Grasp, LocomotionCommand, Place, Release

TRIES = 3
"""Number of times that the rule grasps."""
ABOVE_GOAL = 0.35
"""Height over its place on the goal at which the object arrives [m]."""
FIRST_MASS = 0.5
"""Mass that is assumed before the first test lift [kg]."""
LIFT = 0.7
"""Height of the lift [m]."""
CARRY_SPEED = 0.5
"""Largest speed of the way to the goal [m/s]."""
TESTED, TOLD = "tested", "told"
"""How the rule grips: as the test lift finds, or so but with the true mass and friction, which no robot knows."""
DELIVERED = 0.1
"""The object is delivered if it is this close to the goal [m]."""


@dataclass(slots=True)
class RuleMemory:
    """State of the rule between decisions."""

    tries: int = 0
    """Number of times that it has ordered a grasp."""
    mass: float = FIRST_MASS
    """Mass that the last test lift measured, or that is assumed [kg]."""


def grasp_orders(scene: GraspScene, mass: float, grip: float | str = TESTED) -> list[LocomotionCommand]:
    """Return the orders that carry an object to its goal and release it there.

    Args:
        scene: The scene; of the object only what can be known is used.
        mass: Mass that is assumed until the test lift has measured it [kg].
        grip: Force of each foot [N], `TESTED` or `TOLD`.
    """
    force = float(grip) if isinstance(grip, int | float) else 0.0
    mass, friction = (scene.mass, scene.friction) if grip == TOLD else (mass, 0.0)
    z = scene.floor + scene.top + ABOVE_GOAL
    grasp = Grasp(scene.shape, scene.half_size, scene.most_force, mass, LIFT, force, friction)
    carry = CarryTo((scene.goal.x, scene.goal.y, z), scene.goal.yaw, CARRY_SPEED)
    return [grasp, carry, Place(scene.floor), Release()]


def decide(
    memory: RuleMemory, scene: GraspScene, seen: Seen | None, grip: float | str = TESTED, *, idle: bool
) -> list[LocomotionCommand]:
    """Return the orders that the manager is to execute now; none while it works or the object is delivered.

    Args:
        memory: The rule's memory, which is changed.
        scene: The scene.
        seen: The object, if it is seen.
        grip: Force of each foot [N], `TESTED` or `TOLD`.
        idle: Whether the manager hovers without orders.
    """
    if not idle or memory.tries >= TRIES or seen is None:
        return []
    x, y, _ = seen.position_w.tolist()
    if memory.tries and math.hypot(x - scene.goal.x, y - scene.goal.y) < DELIVERED:
        return []
    memory.tries += 1
    return grasp_orders(scene, memory.mass, grip)
