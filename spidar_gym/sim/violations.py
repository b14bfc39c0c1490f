"""Constraints that apply to every task; `info` reports their violations as costs.

The engine evaluates them at the end of every control period; a step of several periods collects the violations of all.
"""

from collections.abc import Collection

VIOLATIONS = ("foot", "duct", "part", "torque", "blown")
"""Contact of a foot or a peg, of a duct, of another part; a joint servo at its limit; a rotor in a jet."""
COSTS = ("contact", "torque", "duct", "blown")
"""Names of the costs; each is 1 for a violation, else 0."""
AT_LIMIT = 0.01
"""A joint servo is at its limit within this distance of its allowed torque [Nm]."""
BLOWN_FACTOR = 0.9
"""A rotor is in a jet, another's or its own, if its thrust is below this share of that in still air."""


def costs(violated: int, untouchable: Collection[str]) -> dict[str, float]:
    """Return the entries of `info` for violated constraints: `cost`, the sum, and `cost_contact`, … as in `COSTS`.

    Args:
        violated: Bit mask; bit k is the k-th of `VIOLATIONS`.
        untouchable: Parts whose contact is a violation.
    """
    found = {name for k, name in enumerate(VIOLATIONS) if violated >> k & 1}
    each = {f"cost_{name}": float(name in found) for name in COSTS}
    each["cost_contact"] = float(not found.isdisjoint(untouchable))
    return {"cost": sum(each.values()), **each}
