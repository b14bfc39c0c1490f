"""What a robot had better not do, whatever its task: constraints, whose violations `info` tells as costs.

The engine looks at the end of every control period; of a step of several periods the worst counts.
"""

from collections.abc import Collection

VIOLATIONS = ("foot", "duct", "part", "torque", "blown")
"""A foot or a peg touches, a duct does, another part does; a joint servo is at its limit; a rotor is blown on."""
COSTS = ("contact", "torque", "duct", "blown")
"""Violations that cost: 1 each where there is one, else 0."""
AT_LIMIT = 0.01
"""A joint servo this close to the largest torque that it may use is at its limit [Nm]."""
BLOWN_FACTOR = 0.9
"""A rotor whose thrust is less than this share of the one in still air is blown on: by another's jet, or by its own."""


def costs(violated: int, untouchable: Collection[str]) -> dict[str, float]:
    """What `info` tells of violated constraints: `cost`, the sum, and `cost_contact`, … in the order of `COSTS`.

    Args:
        violated: Bit k is the k-th of `VIOLATIONS`.
        untouchable: Parts whose contact is a violation.
    """
    found = {name for k, name in enumerate(VIOLATIONS) if violated >> k & 1}
    each = {f"cost_{name}": float(name in found) for name in COSTS}
    each["cost_contact"] = float(not found.isdisjoint(untouchable))
    return {"cost": sum(each.values()), **each}
