"""The air: sixteen ducted jets, what they do to other rotors, links and torso, ram drag, ground effect, wind.

A module's two ducts lie side by side, so the robot blows sixteen jets. Each is the momentum-conserving two-zone jet of
a round nozzle; a duct that stands in it loses lift by blade-element and momentum theory at fixed motor speed. The
forces are evaluated at a fixed rate and held in between.
"""

# pyright: reportAttributeAccessIssue=false
# The compiled modules below come without stubs.

import math
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float

from spidar_gym.arrays import RotorVector, Vector3
from spidar_gym.errors import InvalidValueError
from spidar_gym.robot import N_LINKS, N_ROTORS, ROBOT
from spidar_gym.so3 import CROSS

AIR_DENSITY = 1.225
"""ρ [kg/m³]."""
N_DUCTS = 2 * N_ROTORS
DUCT_AREA = math.pi * ROBOT.propeller_radius**2
"""Disc area A of a duct [m²]."""
NEAR = 0.01
"""A jet is felt from this distance behind the exit on [m]."""
LEAST_THRUST = 0.02
"""A duct with less thrust than this [N] is treated as if it had this: its jet is then below 1.2 m/s."""
REACH, SPREAD = 0.16, 0.55
"""Half-width [m] and its growth per metre of the cone outside of which no duct feels a jet: 1 % of it at most."""


@dataclass(frozen=True)
class AeroConfig:
    """Parameters of the air; nominal values fitted to the paper's descent in form ③, ranges in `randomize`."""

    wake: bool = True
    """Whether there is air while there is no wind: jets, drag, inflow by the robot's motion, ground effect."""
    zero_thrust_speed: float = 2.6
    """χ: axial inflow at which a duct's thrust vanishes, in units of its own jet speed [Leishman]."""
    core_length: float = 4.0
    """Length of a jet's potential core in duct diameters: 3.25 … 6.2 in the literature [Hamill]."""
    duct_drag_area: float = 0.0015
    """C_d A of one duct in a stream [m²]."""
    ground_effect: float = 1.0
    """a in T ← T (1 + a (R / 4h)²): 1 is Cheeseman and Bennett's open rotor; ducts have either sign."""

    def __post_init__(self) -> None:
        """Refuse what is not a jet."""
        for name, least in (("zero_thrust_speed", 1.0), ("core_length", 0.0), ("duct_drag_area", -1e-12)):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > least):
                raise InvalidValueError(name, value, f"a number above {max(least, 0.0):g}")
        if not math.isfinite(self.ground_effect):
            raise InvalidValueError("ground_effect", self.ground_effect, "a finite number")


def jet_profile(
    s: np.ndarray, r: np.ndarray, w: np.ndarray | float, *, core_length: float, radius: float = ROBOT.propeller_radius
) -> np.ndarray:
    """Speed of the air in a ducted jet [m/s]; zero upstream of `NEAR`.

    A core of the exit speed w shrinks to a point over `core_length` diameters inside a Gaussian shear layer, whose
    width follows from ∫ρ u² dA = T at every s; beyond the core the jet spreads and slows down with 1/s.

    Args:
        s: Distance from the exit along the jet [m].
        r: Distance from the axis [m].
        w: Speed at the exit, √(T / (ρ A)) [m/s].
        core_length: In diameters.
        radius: Radius R of the exit [m].
    """
    core = 2.0 * core_length * radius
    stretch = np.maximum(s, core) / core
    r_core = np.maximum(radius - (radius / core) * np.maximum(s, 0.0), 0.0)
    square = r_core * r_core
    width = np.sqrt((0.5 * math.pi - 2.0) * square + 2.0 * radius * radius) - math.sqrt(0.5 * math.pi) * r_core
    # Inside the core r < r_core; at the exit the shear layer has no width yet.
    beyond = np.maximum(r - r_core, 0.0) / np.maximum(width * stretch, 1e-9)
    return np.where(s > NEAR, w / stretch * np.exp(-beyond * beyond), 0.0)


def thrust_factor(inflow: np.ndarray, *, zero_thrust_speed: float) -> np.ndarray:
    """Thrust over the thrust at rest, of a duct whose motor keeps its speed, within 0 … 1.5 (1.3 in upwash).

    Linear-lift blade element T = K (V_z − V_d) with the duct's momentum balance T = ρ A V_e (V_e − V): with
    μ = V / w, ε = V_e / w, χ = V_z / w: ε = ½ [(μ − g) + √((μ − g)² + 4 χ g)], g = 1 / (χ − 1), τ = ε (ε − μ).

    Args:
        inflow: μ, mean axial speed of the air that comes down on the disc over the jet speed w at rest.
        zero_thrust_speed: χ.
    """
    g = 1.0 / (zero_thrust_speed - 1.0)
    m = inflow - g
    epsilon = 0.5 * (m + np.sqrt(m * m + 4.0 * zero_thrust_speed * g))
    factor = epsilon * (epsilon - inflow)
    return np.minimum(np.maximum(factor, 0.0), np.where(inflow < 0.0, 1.3, 1.5))


@dataclass(frozen=True, slots=True)
class AirForces:
    """What the air did at one evaluation."""

    generalized: Float[np.ndarray, " nv"]
    """Generalised force [N, Nm] for `qfrc_applied`."""
    thrust_factor: Float[np.ndarray, "16"]
    """Thrust of each duct over its thrust in still air; the ducts of module 1 first."""
    forces_w: Float[np.ndarray, "m 3"]
    """Force at each of the points below, world [N]."""
    points_w: Float[np.ndarray, "m 3"]
    """Duct centres, then link and torso points [m]."""


_DISC = math.sqrt(2.0 / 3.0) * ROBOT.propeller_radius
DISC_POINTS = np.array([[0, 0, 0], [_DISC, 0, 0], [0, _DISC, 0], [-_DISC, 0, 0], [0, -_DISC, 0]])
"""Points of a duct's disc: with the weights below exact for the mean of any polynomial of degree three [m]."""
DISC_WEIGHTS = np.array([4, 3, 3, 3, 3]) / 16
LINK_STATIONS = ((0.09, 0.05), (0.26, 0.05), (0.43, 0.07))
"""Stations along a link and the width of what stands in the wind there: rod, rod, battery [m]."""
LINK_SEGMENT = 0.18
"""Length of a link that a station stands for [m]."""
TORSO_STATIONS = 0.7 * ROBOT.torso_radius * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]])
"""Stations on the torso's disc [m]."""
BLUFF = 1.1
"""Drag coefficient of cylinders in cross flow and of discs at these Reynolds numbers."""
TORSO_FACE = math.pi * ROBOT.torso_radius**2
"""Area of the torso seen from above [m²]."""
TORSO_EDGE = 2.0 * ROBOT.torso_radius * ROBOT.torso_height
"""Area of the torso seen from the side [m²]."""


class Aero:
    """Forces of the air on one robot; it keeps where the air is looked at, and nothing that changes.

    The stations are the sixteen duct centres, three on each link and five on the torso. The wake is averaged over the
    disc of a duct and taken at a point elsewhere.
    """

    def __init__(self, model: mujoco.MjModel, config: AeroConfig | None = None) -> None:
        """Place the stations and note how each is carried by the tree of bodies."""
        self.config = config or AeroConfig()
        modules = [model.body(f"gimbal{i}_pitch_module").id for i in range(1, N_ROTORS + 1)]
        links = [model.body(f"link{i}").id for i in range(1, N_LINKS + 1)]
        self._torso = model.body("torso").id
        d = ROBOT.duct_offset_y
        n_links, n_torso = len(links) * len(LINK_STATIONS), len(TORSO_STATIONS)
        self._body = np.concatenate(
            [np.repeat(modules, 2), np.repeat(links, len(LINK_STATIONS)), np.full(n_torso, self._torso)]
        )
        local = [(0.0, y, 0.0) for _ in modules for y in (d, -d)] + [
            (x, 0.0, 0.0) for _ in links for x, _ in LINK_STATIONS
        ]
        self._local = np.concatenate([local, TORSO_STATIONS])[:, :, None]
        n = len(self._body)
        self._offsets, self._weights = np.zeros((n, 3, len(DISC_POINTS))), np.zeros((n, len(DISC_POINTS)))
        self._offsets[:N_DUCTS], self._weights[:N_DUCTS] = DISC_POINTS.T, DISC_WEIGHTS
        self._weights[N_DUCTS:, 0] = 1.0
        # A jet acts neither on its own module nor on the rod that carries it: both stand beside it.
        owner = np.concatenate(
            [np.arange(N_DUCTS) // 2, np.repeat(np.arange(N_LINKS), len(LINK_STATIONS)), [-1] * n_torso]
        )
        self._foreign = owner[:, None] != np.arange(N_DUCTS) // 2
        # Drag in the station's own axes, F = (c |V⊥| + ram) V: a rod feels no flow along itself.
        half = 0.5 * AIR_DENSITY
        drag, across = np.zeros((n, 3)), np.ones((n, 3))
        drag[:N_DUCTS] = half * self.config.duct_drag_area
        widths = np.tile([width for _, width in LINK_STATIONS], len(links))
        drag[N_DUCTS : N_DUCTS + n_links, 1:] = (half * BLUFF * LINK_SEGMENT * widths)[:, None]
        across[N_DUCTS : N_DUCTS + n_links, 0] = 0.0
        drag[N_DUCTS + n_links :] = half * BLUFF / n_torso * np.array([TORSO_EDGE, TORSO_EDGE, TORSO_FACE])
        self._drag, self._across = drag, across
        # Which degree of freedom moves which station.
        self._moves = np.zeros((model.nv, n))
        for k, body in enumerate(self._body.tolist()):
            while body > 0:
                first = model.body_dofadr[body]
                self._moves[first : first + model.body_dofnum[body], k] = 1.0
                body = model.body_parentid[body]

    def evaluate(
        self, data: mujoco.MjData, thrust: RotorVector, *, wind_w: Vector3, noise: RotorVector, push_w: Vector3
    ) -> AirForces:
        """Forces of the air at the positions and velocities of the latest kinematics in `data`.

        Args:
            data: Simulation; `mj_step` leaves everything that is read here (one physics step old).
            thrust: What the modules' motors deliver in still air [N].
            wind_w: Velocity of the air far away, world [m/s].
            noise: Thrust noise of each module [N].
            push_w: Force of a push at the torso's centre, world [N].
        """
        config = self.config
        R = data.xmat.take(self._body, axis=0).reshape(-1, 3, 3)
        origin = data.subtree_com[self._torso]
        points = (R @ self._local)[:, :, 0]
        points += data.xpos.take(self._body, axis=0)
        points -= origin
        lever = (points @ CROSS).reshape(-1, 3, 3)
        twist = data.cvel.take(self._body, axis=0)
        air = (lever @ twist[:, :3, None])[:, :, 0]
        air -= twist[:, 3:]
        air += wind_w
        up, ducts = R[:N_DUCTS, :, 2], points[:N_DUCTS]
        duct_thrust = np.maximum(0.5 * np.repeat(thrust, 2), LEAST_THRUST)
        w = np.sqrt(duct_thrust / (AIR_DENSITY * DUCT_AREA))
        if not config.wake and not wind_w.any():
            air[:] = 0.0
        if config.wake:
            self._add_wake(air, points, ducts + ROBOT.duct_z[0] * up, up, w, R)
        V = (air[:, None] @ R)[:, 0]
        speed = np.sqrt((V * V * self._across).sum(axis=1))
        coefficient = self._drag * speed[:, None]
        # The air that a duct swallows leaves along its axis: ram drag ρ A w V⊥.
        coefficient[:N_DUCTS, :2] += (AIR_DENSITY * DUCT_AREA * w)[:, None]
        F = coefficient * V
        factor = thrust_factor(-V[:N_DUCTS, 2] / w, zero_thrust_speed=config.zero_thrust_speed)
        if config.wake and config.ground_effect:
            factor = self._ground(factor, ducts + origin, up)
        F[:N_DUCTS, 2] += duct_thrust * (factor - 1.0) + 0.5 * np.repeat(noise, 2)
        forces = (R @ F[:, :, None])[:, :, 0]
        forces[-len(TORSO_STATIONS)] += push_w
        wrenches = np.concatenate(((lever @ forces[:, :, None])[:, :, 0], forces), axis=1)
        generalized = ((self._moves @ wrenches) * data.cdof).sum(axis=1)
        return AirForces(generalized, factor, forces, points + origin)

    def _add_wake(
        self, air: np.ndarray, points: np.ndarray, exits: np.ndarray, up: np.ndarray, w: np.ndarray, R: np.ndarray
    ) -> None:
        """Add to `air` the velocity that the jets of other modules give it at each station [m/s]."""
        # Which stations a jet can reach at all: few, so the profile is computed for those only.
        s = (exits * up).sum(axis=1) - points @ up.T
        square = (points * points).sum(axis=1)[:, None] - 2.0 * (points @ exits.T) + (exits * exits).sum(axis=1)
        reach = REACH + SPREAD * s
        stations, jets = np.nonzero((square - s * s < reach * reach) & (s > -REACH) & self._foreign)
        if not len(jets):
            return
        x = R[stations] @ self._offsets[stations]
        x += (points[stations] - exits[jets])[:, :, None]
        s = -(up[jets, None] @ x)[:, 0]
        r = np.sqrt(np.maximum((x * x).sum(axis=1) - s * s, 0.0))
        u = jet_profile(s, r, w[jets, None], core_length=self.config.core_length)
        speeds = np.zeros((len(points), N_DUCTS))
        speeds[stations, jets] = (u * self._weights[stations]).sum(axis=1)
        flow = speeds @ up
        # Jets side by side add up; jets on one line do not blow faster than the fastest of them by more than a fifth.
        total = np.sqrt((flow * flow).sum(axis=1))
        flow *= np.minimum(1.0, 1.2 * speeds.max(axis=1) / np.maximum(total, 1e-9))[:, None]
        air -= flow

    def _ground(self, factor: np.ndarray, centre_w: np.ndarray, up: np.ndarray) -> np.ndarray:
        """`factor` with ground effect: within four radii of the floor along the jet, tilted by less than 60°."""
        height = centre_w[:, 2] + ROBOT.duct_z[0] * up[:, 2]
        R = ROBOT.propeller_radius
        if height.min() > 4.0 * R:
            return factor
        h = np.maximum(height / np.maximum(up[:, 2], 0.5), 0.25 * R)
        near = (up[:, 2] > 0.5) & (h < 4.0 * R)
        return np.where(near, factor * (1.0 + self.config.ground_effect * (R / (4.0 * h)) ** 2), factor)
