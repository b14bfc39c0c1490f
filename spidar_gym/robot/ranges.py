"""Ranges of the robot's numbers that are simulated accurately; `python -m tests.robot.ranges` measures them."""

from dataclasses import dataclass

from spidar_gym.errors import InvalidValueError


@dataclass(frozen=True)
class Range:
    """Allowed range of numbers of one kind."""

    least: float
    """Lower limit."""
    most: float
    """Upper limit."""
    unit: str
    """Unit of both limits."""

    def require(self, name: str, *values: float) -> None:
        """Raise `InvalidValueError` for a number outside the range; `name` is its name in the message."""
        for value in values:
            if not self.least <= value <= self.most:
                words = f"a number within {self.least:g} … {self.most:g} {self.unit}, which is simulated well"
                raise InvalidValueError(name, value, words)


LENGTHS = Range(1e-4, 10.0, "m")
"""Edges, radii and distances."""
PLACES = Range(-10.0, 10.0, "m")
"""Coordinates."""
MASSES = Range(1e-6, 1e4, "kg")
"""Masses of a part, a payload, and the robot as described."""
INERTIAS = Range(1e-12, 1e6, "kg m²")
"""Principal moments of inertia of every moving body and of a payload."""
FACTORS = Range(1e-3, 1e3, "times")
"""Factors on the mass and the inertia of a link."""
OTHERS = Range(0.0, 1e6, "in its unit")
"""Forces, torques, speeds, stiffnesses, times and friction; the upper limit prevents overflow."""
