"""`mpc`: linear model predictive control of the centroidal motion, at 40 Hz with 0.6 s of preview.

Each axis is a double integrator behind rotors that lag and a command that is a tick under way. The legs' planned
angular momentum, the reference's acceleration and the observed external wrench are known over the horizon; what is
asked for stays within what the rotors can give, and in the first step within the allocation's rows. OSQP solves it.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import osqp
from scipy import sparse
from scipy.linalg import solve_discrete_are

from spidar_gym.arrays import JointVector, Vector3, Wrench
from spidar_gym.benchmark import HOVER, PresetPolicy
from spidar_gym.control.flight.centroidal import Integrals
from spidar_gym.control.flight.compensation import CompensationMemory, ramp_joints, servo_response
from spidar_gym.control.flight.controller import CONTROL_RATE, ControllerConfig, FlightController
from spidar_gym.control.flight.margins import DELAY, FREQUENCIES, LAG, margins_of
from spidar_gym.control.flight.memory import ControlState
from spidar_gym.control.presets import TUNED
from spidar_gym.robot import GRAVITY
from spidar_gym.state import Reference, RobotState
from spidar_gym.tune.flight import BOUNDS
from spidar_gym.tune.parameter import Parameter
from spidar_gym.tune.search import Search

AXES = 6
"""Three of the position, world axes, and three of the attitude, torso axes."""
STATES = 4
"""e, ė, the acceleration that the rotors give, and the one that was asked for last."""
_LIFT = np.array([0.0, 0.0, GRAVITY])


HORIZON = 24
"""Ticks that are looked ahead."""
MOST = (6.0, 12.0)
"""Largest asked acceleration along an axis [m/s²] and about one [rad/s²]."""


@dataclass(frozen=True)
class Settings:
    """What is tuned: weights, and the model of the rotors."""

    speed_weight: tuple[float, ...]
    """What ė² costs beside e², of x and y, z, roll and pitch, yaw [s²]."""
    change_weight: tuple[float, ...]
    """What the square of a tick's change of the asked acceleration costs [s⁴]."""
    lag: float
    """Time constant of the rotors [s]."""
    legs: float
    """Share of the legs' planned change of momentum that is believed."""


class Prediction(NamedTuple):
    """One axis over the horizon, condensed: what the changes v of the asked acceleration cost is ½ vᵀ H v + vᵀ g."""

    H: np.ndarray
    """Hessian (N, N)."""
    inverse: np.ndarray
    """H⁻¹."""
    from_state: np.ndarray
    """g = from_state x₀ + from_known w: (N, 4)."""
    from_known: np.ndarray
    """The same from the known accelerations w₀ … w_N (N, N + 1)."""


@cache
def prediction(horizon: int, speed_weight: float, change_weight: float, lag: float, dt: float) -> Prediction:
    """Condense ë = w − a, a ← a + (1 − e^{−dt/τ}) (b − a), b ← b + v; behind the horizon the LQR takes over."""
    s = 1.0 - math.exp(-dt / lag)
    A = np.array([[1.0, dt, -0.5 * dt * dt, 0.0], [0.0, 1.0, -dt, 0.0], [0.0, 0.0, 1.0 - s, s], [0.0, 0.0, 0.0, 1.0]])
    B, E = np.array([0.0, 0.0, 0.0, 1.0]), np.array([0.5 * dt * dt, dt, 0.0, 0.0])
    Q = np.diag([1.0, speed_weight, 0.0, 0.0])
    P = solve_discrete_are(A, B[:, None], Q + 1e-9 * np.eye(STATES), np.array([[change_weight]]))
    free, changed, known = np.eye(STATES), np.zeros((STATES, horizon)), np.zeros((STATES, horizon + 1))
    H, of_state = change_weight * np.eye(horizon), np.zeros((horizon, STATES))
    of_known = np.zeros((horizon, horizon + 1))
    for k in range(horizon):
        free, changed, known = A @ free, A @ changed, A @ known
        changed[:, k] += B
        known[:, k] += E
        # Behind the horizon w stays: there a and b come to rest at it.
        weight, shown = (P, known - _at_rest(horizon)) if k == horizon - 1 else (Q, known)
        H += changed.T @ weight @ changed
        of_state += changed.T @ weight @ free
        of_known += changed.T @ weight @ shown
    return Prediction(H, np.linalg.inv(H), of_state, of_known)


def _at_rest(horizon: int) -> np.ndarray:
    """The state that the last known acceleration asks for (4, N + 1)."""
    found = np.zeros((STATES, horizon + 1))
    found[2:, -1] = 1.0
    return found


class PredictiveController(FlightController):
    """The paper's controller whose PIDs are a linear prediction; allocation, joints and modes are its own."""

    settings: Settings
    """Its weights."""

    def __init__(self, config: ControllerConfig | None = None, **how: object) -> None:
        """Take what a flight controller takes, and set up the program."""
        super().__init__(config, **how)  # type: ignore[arg-type]
        c = self.settings
        kinds = (0, 0, 1, 2, 2, 3)
        self._axes = [
            prediction(HORIZON, c.speed_weight[kind], c.change_weight[kind], c.lag, self.dt) for kind in kinds
        ]
        self._bound = np.repeat(MOST, 3)
        self._solver = osqp.OSQP()
        sums = sparse.csc_matrix(np.tril(np.ones((HORIZON, HORIZON))))
        self._solver.setup(
            sparse.triu(sparse.block_diag([axis.H for axis in self._axes]), format="csc"),
            np.zeros(AXES * HORIZON), sparse.block_diag([sums] * AXES, format="csc"),
            *(sign * np.repeat(self._bound, HORIZON) for sign in (-1.0, 1.0)),
            verbose=False, eps_abs=1e-5, eps_rel=1e-5, max_iter=200, polishing=False,
        )  # fmt: skip
        self._asked = self._given = np.zeros(AXES)

    def compute_wrench(
        self, state: RobotState, reference: Reference, control_state: ControlState, joints: JointVector
    ) -> tuple[Wrench, Integrals, CompensationMemory]:
        """The first step of the best plan; it has no integrals, for the observer says what lasts."""
        c, snapshot, R_wb, error = self.settings, control_state.snapshot, control_state.R_wb, control_state.error
        compensation, _ = self.compensate(state, reference, control_state, joints)
        inverse = np.linalg.inv(snapshot.inertia_c)
        external = self.config.compensation.observer_gain * compensation.external_w
        w = np.empty((AXES, HORIZON + 1))
        coming = [reference] * (HORIZON + 1)
        if self.preview is not None:
            coming[1:] = [self.preview(k * self.dt) for k in range(1, HORIZON + 1)]
        w[:3] = np.stack([one.acceleration_w for one in coming], axis=1) - (external[:3] / snapshot.mass)[:, None]
        w[3:] = np.stack([one.alpha_b for one in coming], axis=1) - (inverse @ (R_wb.T @ external[3:]))[:, None]
        w[3:] += inverse @ (c.legs * self._leg_torque(control_state, compensation, state.omega_b, coming, joints))
        if self.last_step is None:
            self._asked = self._given = w[:, 0]  # what is known to be needed has been given for long
        e = np.concatenate((error.position_w, error.attitude))
        rate = np.concatenate((error.velocity_w, error.omega_b))
        x = np.stack((e, rate, self._given, self._asked), axis=1)
        g = np.concatenate([a.from_state @ x[k] + a.from_known @ w[k] for k, a in enumerate(self._axes)])
        change = self._solve(g)
        smoothing = 1.0 - math.exp(-self.dt / c.lag)
        self._given = self._given + smoothing * (self._asked - self._given)
        self._asked = np.clip(self._asked + change, -self._bound, self._bound)
        wrench = np.empty(6)
        wrench[:3] = snapshot.mass * ((self._asked[:3] + _LIFT) @ R_wb)
        wrench[3:] = snapshot.inertia_c @ self._asked[3:]
        wrench[3:] += np.cross(state.omega_b, snapshot.inertia_c @ state.omega_b)
        return wrench, self.memory.integrals, compensation

    def _solve(self, g: np.ndarray) -> np.ndarray:
        """The first change of every axis in the best plan (6,)."""
        # Where nothing is at its bound the plan is linear in g.
        plan = np.concatenate([-k.inverse @ own for k, own in zip(self._axes, g.reshape(AXES, HORIZON), strict=True)])
        asked = self._asked[:, None] + np.cumsum(plan.reshape(AXES, HORIZON), axis=1)
        if (np.abs(asked) > self._bound[:, None]).any():
            lower, upper = (np.repeat(sign * self._bound - self._asked, HORIZON) for sign in (-1.0, 1.0))
            self._solver.update(q=g, l=lower, u=upper)
            within = self._solver.solve(raise_error=False).x
            if np.isfinite(within).all():
                plan = within
        return plan.reshape(AXES, HORIZON)[:, 0]

    def _leg_torque(
        self, control_state: ControlState, compensation: CompensationMemory, omega_b: Vector3,
        coming: Sequence[Reference], joints: JointVector,
    ) -> np.ndarray:  # fmt: skip
        """ḣ + ω × h of the legs' motion as it is planned, over the horizon (3, N + 1) [Nm]."""
        config, options = self.config, self.config.compensation
        position, velocity = compensation.servo_position, compensation.servo_velocity
        command, rate = joints, (joints - self.memory.joint_position) / self.dt
        velocities = [self.memory.compensation.servo_velocity, velocity]
        for later in coming[1:]:
            command, rate = ramp_joints(
                command, rate, later.joint_target, speed=config.joint_speed, ramp=options.joint_ramp, dt=self.dt
            )
            position, velocity = servo_response(
                position, velocity, command, bandwidth=options.servo_bandwidth, dt=self.dt
            )
            velocities.append(velocity)
        h = control_state.snapshot.momentum_map[3:] @ np.array(velocities).T
        return np.diff(h, axis=1) / self.dt + np.cross(omega_b, h[:, :-1], axisb=0).T


def configuration(values: Mapping[str, float]) -> ControllerConfig:
    """Allocation, observer and joints with these parameters."""
    own = {name: values[name] for name in OWN}
    return ControllerConfig(compensation=replace(TUNED.compensation, momentum_gain=0.0, observer_order=1, **own))


def settings(values: Mapping[str, float]) -> Settings:
    """Weights and model with these parameters."""
    speed, change = ([values[f"{axis}_{what}"] for axis in WEIGHED] for what in ("speed", "change"))
    return Settings(tuple(speed), tuple(change), values["lag"], values["legs"])


def arguments(values: Mapping[str, float]) -> dict[str, Any]:
    """What `gym.make` is told of these parameters."""
    law = type("Law", (PredictiveController,), {"settings": settings(values), "__doc__": PredictiveController.__doc__})
    return {"controller": configuration(values), "law": law}


def loop(values: Mapping[str, float], axis: int) -> np.ndarray:
    """L(iω) of one of `AXES` at `FREQUENCIES` while no bound is met: then the plan is linear in what is known.

    With z = e^{s dt}, the asked acceleration b and the row k of the plan's first step: (1 − z⁻¹) b = −(k₀ e + k₁ ė +
    k₂ a + k₃ z⁻¹ b + k_w w), a = σ z⁻¹ b / (z − 1 + σ), and w is what the observer believes, −g F (s² x − D_m b).
    """
    c, options, dt = settings(values), configuration(values).compensation, 1.0 / CONTROL_RATE
    own = prediction(HORIZON, c.speed_weight[axis], c.change_weight[axis], c.lag, dt)
    k, k_w = (own.inverse @ own.from_state)[0], float((own.inverse @ own.from_known)[0].sum())
    s = 1j * FREQUENCIES
    z, share = np.exp(s * dt), 1.0 - math.exp(-dt / c.lag)
    D = np.exp(-s * DELAY) / (1.0 + LAG * s)
    F = options.observer_gain / (1.0 + options.observer_time * s) ** options.observer_order
    believed = 1.0 / (1.0 + options.observer_lag * s)
    below = 1.0 - 1.0 / z + k[2] * share / z / (z - 1.0 + share) + k[3] / z + k_w * F * believed
    return -D * (k[0] + k[1] * s + k_w * F * s * s) / below / (s * s)


WEIGHED = ("xy", "z", "roll_pitch", "yaw")
"""Axes that differ, by the name that parameters begin with."""
OWN = ("servo_bandwidth", "vectoring_lead", "observer_gain", "observer_time", "observer_lag")
"""Fields of `CompensationConfig` that are tuned with it."""
PARAMETERS = (
    *(Parameter(f"{axis}_speed", 0.03, 0.001, 0.5) for axis in WEIGHED),
    *(Parameter(f"{axis}_change", 3e-3, 1e-4, 5e-2) for axis in WEIGHED),
    Parameter("lag", 0.05, 0.01, 0.3),
    Parameter("legs", 1.0, 0.5, 2.0),
    Parameter("servo_bandwidth", TUNED.compensation.servo_bandwidth, *BOUNDS["servo_bandwidth"]),
    Parameter("vectoring_lead", TUNED.compensation.vectoring_lead, *BOUNDS["vectoring_lead"]),
    Parameter("observer_gain", 0.9, 0.3, 1.0),
    Parameter("observer_time", 0.4, 0.02, 2.0),
    Parameter("observer_lag", 0.1, 0.01, 0.4),
)
"""Weights, the model of the rotors, what is believed of the legs, the observer."""
SEARCH = Search(
    "mpc", "mpc", "flight", "tuned", PARAMETERS, arguments,
    lambda values: [margins_of(loop(values, axis)) for axis in range(len(WEIGHED))],
)  # fmt: skip
"""`spidar tune baselines.mpc:SEARCH`."""
FOUND = {p.name: p.start for p in PARAMETERS}
"""What it flies with: where the search begins, as long as none is committed."""


class MPC(PresetPolicy):
    """Linear predictive control of the centroidal motion with the legs' momentum in its preview; flights only."""

    training = {"command": "spidar tune baselines.mpc:SEARCH --generations 40", "seed": 0}  # noqa: RUF012
    presets = {HOVER: arguments(FOUND)}  # noqa: RUF012
