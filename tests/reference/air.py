"""NumPy reference of the aerodynamics in native/engine/air.c, with the equations beside the lines.

Models sixteen ducted jets, their effect on other rotors, links and the torso, ram drag, ground effect and wind. A
module's two ducts lie side by side. Each jet is the momentum-conserving two-zone jet of a round nozzle. A duct inside
another jet loses lift by blade-element and momentum theory at fixed motor speed. The forces are evaluated at a fixed
rate and held in between.
"""

import math
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float

from spidar_gym.arrays import RotorVector, Vector3
from spidar_gym.robot import N_LINKS, N_ROTORS, ROBOT
from spidar_gym.sim.air import (
    AIR_DENSITY,
    BLUFF,
    DUCT_AREA,
    LEAST_THRUST,
    LINK_SEGMENT,
    LINK_STATIONS,
    N_DUCTS,
    NEAR,
    REACH,
    SPREAD,
    STACKING_RADIUS,
    AeroConfig,
)
from spidar_gym.sim.recirculation import NEAR_LENGTH, RecirculationConfig


def jet_profile(
    s: np.ndarray, r: np.ndarray, w: np.ndarray | float, *, core_length: float, radius: float = ROBOT.propeller_radius
) -> np.ndarray:
    """Air speed in a ducted jet [m/s]; zero upstream of `NEAR`.

    A core with the exit speed w shrinks to a point over `core_length` diameters inside a Gaussian shear layer. The
    layer's width follows from ∫ρ u² dA = T at every s. Beyond the core the jet spreads and its speed decays with 1/s.

    Args:
        s: Distance from the exit along the jet [m].
        r: Distance from the axis [m].
        w: Speed at the exit, √(T / (ρ A)) [m/s].
        core_length: Length of the core, in exit diameters.
        radius: Radius R of the exit [m].
    """
    core = 2.0 * core_length * radius
    stretch = np.maximum(s, core) / core
    r_core = np.maximum(radius - (radius / core) * np.maximum(s, 0.0), 0.0)
    square = r_core * r_core
    width = np.sqrt((0.5 * math.pi - 2.0) * square + 2.0 * radius * radius) - math.sqrt(0.5 * math.pi) * r_core
    # Inside the core r < r_core; at the exit the shear layer has no width yet.
    beyond = np.maximum(r - r_core, 0.0) / np.maximum(width * stretch, 1e-9)
    return (s > NEAR) * (w / stretch * np.exp(-beyond * beyond))


def thrust_factor(inflow: np.ndarray, *, zero_thrust_speed: float) -> np.ndarray:
    """Thrust of a duct at fixed motor speed over its thrust without inflow, clipped to 0 … 1.3.

    Linear-lift blade element T = K (V_z − V_d) with the duct's momentum balance T = ρ A V_e (V_e − V): with
    μ = V / w, ε = V_e / w, χ = V_z / w: ε = ½ [(μ − g) + √((μ − g)² + 4 χ g)], g = 1 / (χ − 1), τ = ε (ε − μ).

    Args:
        inflow: μ, mean axial speed of the air flowing down onto the disc over the jet speed w without inflow.
        zero_thrust_speed: χ.
    """
    g = 1.0 / (zero_thrust_speed - 1.0)
    m = inflow - g
    epsilon = 0.5 * (m + np.sqrt(m * m + 4.0 * zero_thrust_speed * g))
    factor = epsilon * (epsilon - inflow)
    return np.minimum(np.maximum(factor, 0.0), 1.3)


@dataclass(frozen=True, slots=True)
class AirForces:
    """Forces of the air at one evaluation."""

    generalized: Float[np.ndarray, " nv"]
    """Generalised force [N, Nm] for `qfrc_applied`."""
    thrust_factor: Float[np.ndarray, "16"]
    """Thrust of each duct over its thrust in still air; the ducts of module 1 first."""
    forces_w: Float[np.ndarray, "m 3"]
    """Force at each of the points below, world [N]."""
    points_w: Float[np.ndarray, "m 3"]
    """Duct centres, then link and torso points [m]."""


_YZX, _ZXY, _SUM = np.array([1, 2, 0]), np.array([2, 0, 1]), np.ones(3)
_SUM_6 = np.ones(6)
_DISC = math.sqrt(2.0 / 3.0) * ROBOT.propeller_radius
DISC_POINTS = np.array([[0, 0, 0], [_DISC, 0, 0], [0, _DISC, 0], [-_DISC, 0, 0], [0, -_DISC, 0]])
"""Points on a duct's disc [m]. With the weights below, the mean of any polynomial of degree three is exact."""
DISC_WEIGHTS = np.array([4, 3, 3, 3, 3]) / 16
TORSO_STATIONS = 0.7 * ROBOT.torso_radius * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]])
"""Stations on the torso's disc [m]."""
TORSO_FACE = math.pi * ROBOT.torso_radius**2
"""Area of the torso seen from above [m²]."""
TORSO_EDGE = 2.0 * ROBOT.torso_radius * ROBOT.torso_height
"""Area of the torso seen from the side [m²]."""


class Aero:
    """Forces of the air on one robot; stores the stations where the air is evaluated, and no changing state.

    The stations are the sixteen duct centres, three points on each link and five on the torso. The wake is averaged
    over the disc of a duct and sampled at a single point elsewhere.
    """

    def __init__(
        self,
        model: mujoco.MjModel,  # pyright: ignore[reportAttributeAccessIssue] - compiled, without stubs
        data: mujoco.MjData,  # pyright: ignore[reportAttributeAccessIssue] - as above
        config: AeroConfig | None = None,
        recirculation: RecirculationConfig | None = None,
    ) -> None:
        """Place the stations and record which degrees of freedom move each of them."""
        self.config, self._recirculation = config or AeroConfig(), recirculation or RecirculationConfig()
        modules = [model.body(f"gimbal{i}_pitch_module").id for i in range(1, N_ROTORS + 1)]
        links = [model.body(f"link{i}").id for i in range(1, N_LINKS + 1)]
        torso = model.body("torso").id
        # Views into MuJoCo's memory, created once, because every access to an attribute of MjData creates a new view.
        self._xpos, self._xmat, self._cvel, self._cdof = data.xpos, data.xmat, data.cvel, data.cdof
        self._origin, self._torso_xmat = data.subtree_com[torso], data.xmat[torso].reshape(3, 3)
        n_links, n_torso = len(links) * len(LINK_STATIONS), len(TORSO_STATIONS)
        self._body = np.concatenate(
            [np.repeat(modules, 2), np.repeat(links, len(LINK_STATIONS)), np.full(n_torso, torso)]
        )
        n = len(self._body)
        self._ducts, self._links, self._plate = slice(N_DUCTS), slice(N_DUCTS, N_DUCTS + n_links), slice(-n_torso, n)
        self._side = np.tile([ROBOT.duct_offset_y, -ROBOT.duct_offset_y], N_ROTORS)[:, None]
        self._along = np.tile([x for x, _ in LINK_STATIONS], len(links))[:, None]
        self._offsets, self._weights = np.zeros((n, 3, len(DISC_POINTS))), np.zeros((n, len(DISC_POINTS)))
        self._offsets[:N_DUCTS], self._weights[:N_DUCTS] = DISC_POINTS.T, DISC_WEIGHTS
        self._weights[N_DUCTS:, 0] = 1.0
        # A jet acts neither on its own module nor on that module's link: both are beside the jet.
        owner = np.concatenate(
            [np.arange(N_DUCTS) // 2, np.repeat(np.arange(N_LINKS), len(LINK_STATIONS)), [-1] * n_torso]
        )
        self._foreign = owner[:, None] != np.arange(N_DUCTS) // 2
        half = 0.5 * AIR_DENSITY
        self._duct_drag = half * self.config.duct_drag_area
        widths = np.tile([width for _, width in LINK_STATIONS], len(links))
        self._link_drag = half * BLUFF * LINK_SEGMENT * widths
        self._torso_drag = half * BLUFF / n_torso * np.array([TORSO_EDGE, TORSO_EDGE, TORSO_FACE])
        # The thrust factor as a table: one look-up is five times as fast and accurate to 1e-6.
        self._inflows = np.arange(-2000, round(1200 * self.config.zero_thrust_speed)) / 1000.0
        self._factors = thrust_factor(self._inflows, zero_thrust_speed=self.config.zero_thrust_speed)
        # 1 where a degree of freedom (row) moves a station (column).
        self._moves = np.zeros((model.nv, n))
        for k, body in enumerate(self._body.tolist()):
            while body > 0:
                first = model.body_dofadr[body]
                self._moves[first : first + model.body_dofnum[body], k] = 1.0
                body = model.body_parentid[body]

    def evaluate(
        self, thrust: RotorVector, *, wind_w: Vector3, noise: RotorVector, push_w: Vector3,
        eddy: np.ndarray | None = None,
    ) -> AirForces:  # fmt: skip
        """Forces of the air at the positions and velocities of the latest kinematics (one physics step old).

        Args:
            thrust: Thrust of the modules in still air [N].
            wind_w: Velocity of the undisturbed air, world [m/s].
            noise: Thrust noise of each module [N].
            push_w: Force of a push at the torso's centre, world [N].
            eddy: State of the recirculation's eddy, (6,); none without it.
        """
        config, origin, ducts, links, plate = self.config, self._origin, self._ducts, self._links, self._plate
        R = self._xmat.take(self._body, axis=0).reshape(-1, 3, 3)
        up, rod = R[ducts, :, 2], R[links, :, 0]
        points = self._xpos.take(self._body, axis=0)
        points[ducts] += self._side * R[ducts, :, 1]
        points[links] += self._along * rod
        points[plate] += TORSO_STATIONS @ self._torso_xmat.T
        points -= origin
        # p × a, component by component: np.cross is five times slower.
        p_yzx, p_zxy = points.take(_YZX, axis=1), points.take(_ZXY, axis=1)
        omega = self._cvel.take(self._body, axis=0)
        # Air velocity relative to a station: wind − (v + ω × p) = wind − v + p × ω.
        air = wind_w - omega[:, 3:]
        air += p_yzx * omega.take(_ZXY, axis=1) - p_zxy * omega.take(_YZX, axis=1)
        duct_thrust = 0.5 * np.repeat(np.maximum(thrust, 2.0 * LEAST_THRUST), 2)
        w = np.sqrt(duct_thrust * (1.0 / (AIR_DENSITY * DUCT_AREA)))
        if eddy is not None:
            speed = math.sqrt(float(duct_thrust.sum()) / (N_DUCTS * AIR_DENSITY * DUCT_AREA))
            air += self._eddy_flow(eddy, speed, points)
        if config.wake:
            self._add_wake(air, points, points[ducts] + ROBOT.duct_z[0] * up, up, w, R)
        elif eddy is None and not wind_w.any():
            air[:] = 0.0
        F = np.empty_like(air)
        # Ducts: drag of the shroud, lift lost to the inflow, and ram drag ρ A w V⊥, because the ingested air leaves
        # along the duct's axis.
        V = air[ducts]
        axial, ram = (V * up) @ _SUM, (AIR_DENSITY * DUCT_AREA) * w
        factor = np.interp(-axial / w, self._inflows, self._factors)
        if config.wake and config.ground_effect:
            factor = self._ground(factor, points[ducts, 2] + origin[2], up)
        factor = factor * np.repeat(self._stacked(points[ducts], up[::2]), 2)
        lift = duct_thrust * (factor - 1.0) + 0.5 * np.repeat(noise, 2) - ram * axial
        F[ducts] = (self._duct_drag * np.sqrt((V * V) @ _SUM) + ram)[:, None] * V + lift[:, None] * up
        # Links: the flow along a rod exerts no force.
        V = air[links]
        V = V - ((V * rod) @ _SUM)[:, None] * rod
        F[links] = (self._link_drag * np.sqrt((V * V) @ _SUM))[:, None] * V
        V = air[plate] @ self._torso_xmat
        speed = np.sqrt((V * V) @ _SUM)
        F[plate] = (self._torso_drag * speed[:, None] * V) @ self._torso_xmat.T
        F[plate.start] += push_w
        torque = p_yzx * F.take(_ZXY, axis=1) - p_zxy * F.take(_YZX, axis=1)
        wrenches = np.concatenate((torque, F), axis=1)
        generalized = ((self._moves @ wrenches) * self._cdof) @ _SUM_6
        return AirForces(generalized, factor, F, points + origin)

    def _stacked(self, ducts: np.ndarray, up: np.ndarray) -> np.ndarray:
        """Share of its thrust that each module keeps below others (8,)."""
        if self.config.stacking_loss == 0.0:
            return np.ones(N_ROTORS)
        centres = ducts.reshape(N_ROTORS, 2, 3).mean(axis=1)
        between = centres[None] - centres[:, None]
        above = np.einsum("mjx,mx->mj", between, up)
        square = (between**2).sum(axis=2) - above**2
        lost = np.where(above > 0.0, np.exp(-square / STACKING_RADIUS**2), 0.0)
        np.fill_diagonal(lost, 0.0)
        return np.maximum(1.0 - self.config.stacking_loss * lost.sum(axis=1), 0.0)

    def _eddy_flow(self, eddy: np.ndarray, speed: float, points: np.ndarray) -> np.ndarray:
        """Velocity U + Ω × p of the recirculating air [m/s] at points p from the CoG, over a floor without boxes."""
        c = self._recirculation
        scale = speed * (1.0 + c.near * math.exp(-max(float(self._origin[2]), 0.0) / NEAR_LENGTH))
        U = c.mean_flow + np.array([c.flow_xy, c.flow_xy, c.flow_z]) * eddy[:3]
        turn = c.mean_turn + np.array([c.turn_xy, c.turn_xy, c.turn_z]) * eddy[3:]
        return scale * (U + np.cross(turn, points))

    def _add_wake(
        self, air: np.ndarray, points: np.ndarray, exits: np.ndarray, up: np.ndarray, w: np.ndarray, R: np.ndarray
    ) -> None:
        """Add the velocity [m/s] induced at each station by the jets of other modules to `air`."""
        # The profile is computed only for the few stations within reach of a jet.
        products = points @ np.concatenate((up, exits)).T
        s = (exits * up) @ _SUM - products[:, :N_DUCTS]
        square = ((points * points) @ _SUM)[:, None] + (exits * exits) @ _SUM - 2.0 * products[:, N_DUCTS:]
        reach = REACH + SPREAD * s
        near = (square - s * s < reach * reach) & self._foreign
        near &= s > -REACH
        stations, jets = np.divmod(np.flatnonzero(near), N_DUCTS)
        if not len(jets):
            return
        x = R.take(stations, axis=0) @ self._offsets.take(stations, axis=0)
        x += (points.take(stations, axis=0) - exits.take(jets, axis=0))[:, :, None]
        s = -(up.take(jets, axis=0)[:, None] @ x)[:, 0]
        r = np.sqrt(np.maximum(x[:, 0] ** 2 + x[:, 1] ** 2 + x[:, 2] ** 2 - s * s, 0.0))
        u = jet_profile(s, r, w.take(jets)[:, None], core_length=self.config.core_length)
        speeds = np.zeros((len(points), N_DUCTS))
        speeds[stations, jets] = (u * self._weights.take(stations, axis=0)) @ np.ones(len(DISC_POINTS))
        flow = speeds @ up
        # Overlapping jets add up, but to at most 1.2 times the fastest of them: jets on one line would otherwise count
        # twice.
        total = np.sqrt((flow * flow) @ _SUM)
        flow *= np.minimum(1.0, 1.2 * speeds.max(axis=1) / np.maximum(total, 1e-9))[:, None]
        air -= flow

    def _ground(self, factor: np.ndarray, centre_z: np.ndarray, up: np.ndarray) -> np.ndarray:
        """Apply the ground effect to ducts within four radii of the floor along the jet, tilted by less than 60°."""
        height = centre_z + ROBOT.duct_z[0] * up[:, 2]
        R = ROBOT.propeller_radius
        if height.min() > 4.0 * R:
            return factor
        h = np.maximum(height / np.maximum(up[:, 2], 0.5), 0.5 * R)
        near = (up[:, 2] > 0.5) & (h < 4.0 * R)
        return np.where(near, factor * (1.0 + self.config.ground_effect * (R / (4.0 * h)) ** 2), factor)
