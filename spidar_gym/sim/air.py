"""Parameters of the air around the robot and of the jets; native/engine/air.c computes their forces.

`spidar_gym.native.formulas` calls that code from Python: `jet_profile`, `thrust_factor`, `evaluate_air`.
"""

import math
from dataclasses import dataclass

from spidar_gym.errors import InvalidValueError
from spidar_gym.robot import N_ROTORS, ROBOT

AIR_DENSITY = 1.225
"""Density ρ of the air [kg/m³]."""
N_DUCTS = 2 * N_ROTORS
DUCT_AREA = math.pi * ROBOT.propeller_radius**2
"""Disc area A of a duct [m²]."""
NEAR = 0.01
"""Distance behind the exit from which on a jet acts [m]."""
LEAST_THRUST = 0.02
"""Least thrust of a duct in the jet model [N]; its jet is then slower than 1.2 m/s."""
REACH, SPREAD = 0.13, 0.42
"""Half-width [m], and its growth per metre, of the cone outside of which a jet is neglected: 1 % of it at most."""
LINK_STATIONS = ((0.09, 0.05), (0.26, 0.05), (0.43, 0.07))
"""Stations along a link and the width of the part exposed to the wind there: rod, rod, battery [m]."""
LINK_SEGMENT = 0.18
"""Length of a link that a station represents [m]."""
STACKING_RADIUS = 0.22
"""Distance between the axes of two stacked modules at which `stacking_loss` falls by a factor of e [m]: half a module's
width [chosen]."""
BLUFF = 1.1
"""Drag coefficient of cylinders in cross flow and of discs at these Reynolds numbers."""


@dataclass(frozen=True)
class AeroConfig:
    """Parameters of the air; nominal values fitted to the paper's descent in form ③, ranges in `randomize`."""

    wake: bool = True
    """Whether air is simulated without wind: jets, drag, inflow by the robot's motion, ground effect."""
    zero_thrust_speed: float = 2.6
    """χ: axial inflow at which a duct's thrust vanishes, in units of its own jet speed [Leishman]."""
    core_length: float = 4.0
    """Length of a jet's potential core in duct diameters: 3.25 … 6.2 in the literature [Hamill]."""
    stacking_loss: float = 0.0
    """Share of its thrust that a module loses directly below another one, in addition to the jets' effect; 0 … 0.2
    [chosen]. It decreases as exp[−(d / 0.22 m)²] with the distance d from the lower module's axis."""
    duct_drag_area: float = 0.0015
    """C_d A of one duct in a stream [m²]."""
    ground_effect: float = 1.0
    """a in T ← T (1 + a (R / 4h)²): 1 is Cheeseman and Bennett's open rotor; ducts have either sign."""

    def __post_init__(self) -> None:
        """Validate the parameters."""
        for name, least in (("zero_thrust_speed", 1.0), ("core_length", 0.0)):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > least):
                raise InvalidValueError(name, value, f"a number above {least:g}")
        if not 0.0 <= self.stacking_loss <= 1.0:
            raise InvalidValueError("stacking_loss", self.stacking_loss, "a share within 0 … 1")
        if not 0.0 <= self.duct_drag_area < math.inf:
            raise InvalidValueError("duct_drag_area", self.duct_drag_area, "a number of at least 0 [m²]")
        if not math.isfinite(self.ground_effect):
            raise InvalidValueError("ground_effect", self.ground_effect, "a finite number")
