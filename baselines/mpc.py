"""`mpc`: linear model predictive control of the centroidal motion, with what legs, path and actuators are going to do.

Per axis, in accelerations, a tick of Δt long: the error e and its rate v, what the rotors give a, and what they were
last asked for u; c = (1 − γ) u⁺ + γ u is what reaches them, u⁺ the new one, within a time constant τ:

    a⁺ = a + β (c − a),  v⁺ = v + ∫ a − s Δt,  e⁺ = e + v Δt + ∫∫ a − ½ s Δt².

s is the acceleration that is needed: the reference's, the legs' (the momentum that they are going to have, h, by the
model of the servos), and −d against the wrench that nobody knows of. A plan that needs it has a target, a = s and u = σ
for all times, σ what makes τ and γ forget themselves; the cost is Σ e² + q v² + r (u − σ)² from here to infinity
[Rawlings2017, Sec. 1.5]. So without bounds the optimum is u⁺ = σ − K (e, v, a − s, u − σ), K from a Riccati equation,
and of what comes only the ticks matter that τ and γ span: a longer preview changes nothing. The bounds of thrust and
torque hold in the first step: that is the paper's QP, solved within the tick, and what it could not give is where the
next tick begins.

d is observed on the error's rate against what is asked beyond σ, so that no belief about the rotors can take the legs'
own torque for a disturbance.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from scipy.linalg import solve_discrete_are

from spidar_gym.arrays import JointVector, Wrench
from spidar_gym.benchmark import HOVER, PresetPolicy
from spidar_gym.control.allocation.allocator import Allocator
from spidar_gym.control.flight.centroidal import CentroidalConfig, Integrals
from spidar_gym.control.flight.compensation import CompensationMemory, ramp_joints, servo_response
from spidar_gym.control.flight.controller import CONTROL_RATE, ControllerConfig, FlightController
from spidar_gym.control.flight.margins import AXES, DELAY, FREQUENCIES, LAG, Margins, margins_of
from spidar_gym.control.flight.memory import ControlState
from spidar_gym.control.presets import TUNED
from spidar_gym.model.dynamics import Model
from spidar_gym.robot import GRAVITY, ROBOT
from spidar_gym.so3 import skew
from spidar_gym.state import Reference, RobotState
from spidar_gym.tune.flight import BOUNDS, INSIDE, lack, most
from spidar_gym.tune.parameter import Parameter
from spidar_gym.tune.search import Search

DT = 1.0 / CONTROL_RATE
AHEAD = 3
"""Ticks of preview: as many as the actuators' lag spans."""
MOST_SEEN = np.repeat([5.0, 10.0], 3)
"""A wrench that nobody knows of does no more than that: half of gravity, and of the attitude [m/s², rad/s²]."""
AXIS = (0, 0, 1, 2, 2, 3)
"""Which of `AXES` the six coordinates are."""


@dataclass(frozen=True)
class Numbers:
    """What is tuned."""

    bandwidth: tuple[float, ...]
    """ω of each of `AXES`: r = ω⁻⁴ [rad/s]."""
    damping: tuple[float, ...]
    """q of each [s²]."""
    observer: tuple[float, ...]
    """Time constant of the observer of each [s]."""
    belief: float
    """Time constant of the rotors that it believes in: a longer one than theirs buys margin [s]."""
    lag: float
    """τ: that is planned with [s]."""
    delay: float
    """γ: share of a tick by which a command comes late."""


def model(lag: float, delay: float) -> tuple[np.ndarray, np.ndarray]:
    """x⁺ = A x + B u⁺ of x = (e, v, a, u), where nothing is needed."""
    beta = 1.0 - np.exp(-DT / lag)
    # Integrals over a tick of what rotors give that are asked for c: c Δt + (a − c) · once, and so on.
    once, twice = lag * beta, lag * DT - lag**2 * beta
    C = np.array([0.0, 0.0, 0.0, delay])  # c, of x; u⁺ adds (1 − γ)
    a = np.array([0.0, 0.0, 1.0, 0.0])
    A = np.array([
        [1.0, DT, 0.0, 0.0] + twice * a + (0.5 * DT**2 - twice) * C,
        [0.0, 1.0, 0.0, 0.0] + once * a + (DT - once) * C,
        (1.0 - beta) * a + beta * C,
        np.zeros(4),
    ])  # fmt: skip
    share = 1.0 - delay
    return A, np.array([share * (0.5 * DT**2 - twice), share * (DT - once), share * beta, 1.0])


def solve(bandwidth: float, damping: float, lag: float, delay: float) -> np.ndarray:
    """K of one axis on (e, v, a − s, u − σ), from its Riccati equation."""
    A, B = model(lag, delay)
    r = bandwidth**-4
    P = solve_discrete_are(A, B[:, None], np.diag([1.0, damping, 0.0, 0.0]), np.array([[r]]))
    return B @ P @ A / (r + B @ P @ B)


def target(needed: np.ndarray, beta: float, delay: float) -> np.ndarray:
    """σ: what is to be asked for so that the rotors give what is needed.

    Args:
        needed: s in this tick and those that follow (…, at least 3) [1/s² of whatever].
        beta: Share of the way that the rotors go in a tick.
        delay: γ.
    """
    reach = needed[..., :-1] + np.diff(needed) / beta
    return (1.0 - delay) * reach[..., 0] + delay * reach[..., 1]


def share_of(time: float) -> float:
    """Share of the way that a low-pass goes in a tick."""
    return 1.0 - math.exp(-DT / time)


def to_acceleration(wrench: Wrench, control_state: ControlState, omega: np.ndarray) -> np.ndarray:
    """What a wrench in {CoG} does beyond gravity and gyroscopic torque: world, then torso axes [m/s², rad/s²]."""
    snapshot = control_state.snapshot
    lift = control_state.R_wb @ wrench[:3] / snapshot.mass
    lift[2] -= GRAVITY
    inertia = snapshot.inertia_c
    return np.concatenate((lift, np.linalg.solve(inertia, wrench[3:] - skew(omega) @ (inertia @ omega))))


def to_wrench(u: np.ndarray, control_state: ControlState, omega: np.ndarray) -> Wrench:
    """The wrench in {CoG} that does so."""
    snapshot, inertia = control_state.snapshot, control_state.snapshot.inertia_c
    force = snapshot.mass * ((u[:3] + np.array([0.0, 0.0, GRAVITY])) @ control_state.R_wb)
    return np.concatenate((force, inertia @ u[3:] + skew(omega) @ (inertia @ omega)))


class PredictiveController(FlightController):
    """The law; a subclass says with which numbers."""

    numbers: ClassVar[Numbers]

    def __init__(
        self,
        config: ControllerConfig | None = None,
        model: Model | None = None,
        allocator: type[Allocator] = Allocator,
    ) -> None:
        """Solve every axis."""
        super().__init__(config, model, allocator)
        found = self.numbers
        rows = [solve(*own, found.lag, found.delay) for own in zip(found.bandwidth, found.damping, strict=True)]
        self._K = np.array([rows[axis] for axis in AXIS])
        self._beta, self._belief = share_of(found.lag), share_of(found.belief)
        self._share = np.array([share_of(found.observer[axis]) for axis in AXIS])

    def reset(self, state: RobotState, joint_position: JointVector | None = None, trim: Wrench | None = None) -> None:
        """Forget everything."""
        super().reset(state, joint_position, trim)
        self._asked, self._given, self._believed, self._known, self._seen, self._rates = np.zeros((6, 6))
        self._map: np.ndarray | None = None

    def compute_wrench(
        self, state: RobotState, reference: Reference, control_state: ControlState, joints: JointVector
    ) -> tuple[Wrench, Integrals, CompensationMemory]:
        """w^d: the first step of the optimum over what is known to come."""
        limits, snapshot, error = self.config.centroidal, control_state.snapshot, control_state.error
        omega = state.omega_b
        compensation, _ = self.compensate(state, reference, control_state, joints)
        rates = -np.concatenate((error.velocity_w, error.omega_b))
        self._look_back(control_state, omega, rates)
        ahead = [reference, *(self.preview(j * DT) if self.preview else reference for j in range(1, AHEAD + 1))]
        targets = [np.clip(one.joint_target, -ROBOT.joint_limit, ROBOT.joint_limit) for one in ahead]
        rate = self._legs_ahead(targets, joints, self.memory.compensation, compensation)
        h = self._momentum(snapshot.momentum_map[3:], rate)
        turn = np.linalg.solve(snapshot.inertia_c, np.diff(h, axis=1) / DT + skew(omega) @ h[:, :-1])
        needed = np.array([np.concatenate((one.acceleration_w, one.alpha_b)) for one in ahead]).T
        needed[3:] += turn
        sigma = target(needed, self._beta, self.numbers.delay)
        widest = np.concatenate((limits.max_position_error, limits.max_attitude_error))
        e = np.clip(np.concatenate((error.position_w, error.attitude)), -widest, widest)
        d = self._seen
        x = np.stack([-e, rates, self._given + d, self._asked + d], axis=1)
        most = np.concatenate((limits.max_acceleration, np.full(3, limits.max_angular_acceleration)))
        u = np.clip(sigma - d - (self._K * x).sum(axis=1), -most, most)
        self._known, self._rates = sigma, rates
        return to_wrench(u, control_state, omega), self.memory.integrals, compensation

    def _momentum(self, momentum_map: np.ndarray, joint_velocity: np.ndarray) -> np.ndarray:
        """h, torso axes, at this tick and those that follow (3, …): its map goes on changing as in the last tick."""
        change = np.zeros_like(momentum_map) if self._map is None else momentum_map - self._map
        self._map = momentum_map.copy()
        ticks = np.arange(joint_velocity.shape[1])
        return momentum_map @ joint_velocity + change @ (ticks * joint_velocity)

    def _look_back(self, control_state: ControlState, omega: np.ndarray, rates: np.ndarray) -> None:
        """What the rotors were asked for a tick ago beyond σ, which the allocation decided, and what came of it."""
        if self.last_step is None:  # the wrench that a hover is known to bear
            R_wb, w = control_state.R_wb, self.memory.compensation.external_w
            self._seen = to_acceleration(np.concatenate((w[:3] @ R_wb, w[3:] @ R_wb)), control_state, 0.0 * omega)
            self._seen[2] += GRAVITY
            self._asked = self._given = self._believed = -self._seen
            return
        numbers, before = self.numbers, self._asked
        self._asked = to_acceleration(self.last_step.allocation.wrench, control_state, omega) - self._known
        reached = (1.0 - numbers.delay) * self._asked + numbers.delay * before
        self._given = self._given + self._beta * (reached - self._given)
        self._believed = self._believed + self._belief * (self._asked - self._believed)
        residual = (rates - self._rates) / DT - self._believed
        seen = self._seen + self._share * (residual - self._seen)
        self._seen = np.clip(seen, -MOST_SEEN, MOST_SEEN)

    def _legs_ahead(
        self, targets: list[JointVector], joints: JointVector, now: CompensationMemory, then: CompensationMemory
    ) -> np.ndarray:
        """q̇ of the model of the servos at this tick and those that follow (16, `AHEAD` + 2).

        Args:
            targets: Where the joints are sent in this tick and the next ones [rad].
            joints: What they are told in this one [rad].
            now: Model of the servos.
            then: After this tick.
        """
        options = self.config.compensation
        told, rate = joints, (joints - self.memory.joint_position) / DT
        position, velocity = then.servo_position, then.servo_velocity
        found = [now.servo_velocity, velocity]
        for target in targets[1:]:
            told, rate = ramp_joints(
                told, rate, target, speed=self.config.joint_speed, ramp=options.joint_ramp, dt=DT
            )  # fmt: skip
            position, velocity = servo_response(position, velocity, told, bandwidth=options.servo_bandwidth, dt=DT)
            found.append(velocity)
        return np.stack(found, axis=1)


def loop(numbers: Numbers, axis: int, *, delay: float = DELAY, lag: float = LAG) -> Margins:
    """Margins of one of `AXES`: the law's own difference equations at z = e^{iωΔt}, before the real actuators."""
    K = solve(numbers.bandwidth[axis], numbers.damping[axis], numbers.lag, numbers.delay)
    s = 1j * FREQUENCIES
    back = np.exp(-s * DT)  # z⁻¹

    def passed(time: float) -> np.ndarray:
        """A low-pass that has what comes in at once."""
        share = share_of(time)
        return share / (1.0 - (1.0 - share) * back)

    reached = back * ((1.0 - numbers.delay) + numbers.delay * back)
    given, believed = passed(numbers.lag) * reached, passed(numbers.belief) * back
    observer = passed(numbers.observer[axis])
    # The wrench that is seen is −s in K and −σ of this tick and, in K, of the last one.
    seen = (1.0 + K[2] + K[3] * back) * observer
    of_u = 1.0 + K[2] * given + K[3] * back - seen * believed
    of_e = K[0] + (K[1] + seen * (1.0 - back) / DT) * s
    of_rate = (K[1] + seen * (1.0 - back) / DT) / of_u
    D = np.exp(-s * delay) / (1.0 + lag * s)
    return margins_of(D * of_e / of_u / (s * s), of_rate, rate_hz=CONTROL_RATE)


KEYS = ("xy", "z", "roll_pitch", "yaw")
"""What the parameters of each of `AXES` begin with."""
SLOWEST, FASTEST = 3.0, 15.0
"""Between these ω is searched for [rad/s]."""
TERMS = ("bandwidth", "damping", "observer")
"""Fields of `Numbers` that each has."""
BASE = replace(
    TUNED,
    centroidal=CentroidalConfig(),
    compensation=replace(TUNED.compensation, momentum_gain=0.0, observer_gain=0.0, reference_gain=0.0),
)
"""What stays of `tuned`: the models of the servos, the limits."""
OPTIONS = ("servo_bandwidth", "vectoring_lead")
"""What of it is tuned."""
PARAMETERS = (
    *(Parameter(f"{key}_damping", 0.01, 0.001, 0.2) for key in KEYS),
    *(Parameter(f"{key}_observer", 0.2 if key in KEYS[:2] else 0.4, 0.05, 2.0) for key in KEYS),
    Parameter("belief", 0.1, 0.01, 0.3),
    Parameter("lag", 0.03, 0.01, 0.1),
    Parameter("delay", 0.5, 0.0, 1.0, linear=True),
    Parameter("servo_bandwidth", 35.0, *BOUNDS["servo_bandwidth"]),
    Parameter("vectoring_lead", BASE.compensation.vectoring_lead, *BOUNDS["vectoring_lead"]),
)


def numbers_of(values: Mapping[str, float]) -> Numbers:
    """The law of parameters."""
    bandwidth, damping, observer = (tuple(values[f"{key}_{term}"] for key in KEYS) for term in TERMS)
    return Numbers(bandwidth, damping, observer, values["belief"], values["lag"], values["delay"])


def settle(values: Mapping[str, float]) -> dict[str, float]:
    """The same parameters, each axis as fast as its margins allow."""
    found = {f"{key}_bandwidth": SLOWEST for key in KEYS} | dict(values)
    for axis, key in enumerate(KEYS):

        def holds(bandwidth: float, axis: int = axis, key: str = key) -> bool:
            return lack(loop(numbers_of({**found, f"{key}_bandwidth": bandwidth}), axis), INSIDE) == 0.0

        found[f"{key}_bandwidth"] = max(SLOWEST, most(holds, SLOWEST, FASTEST))
    return found


def arguments(values: Mapping[str, float]) -> dict[str, object]:
    """What `gym.make` is told of parameters."""
    compensation = replace(BASE.compensation, **{name: values[name] for name in OPTIONS})
    law = type("Predictive", (PredictiveController,), {"numbers": numbers_of(values)})
    return {"controller": replace(BASE, compensation=compensation), "law": law}


def loops(values: Mapping[str, float]) -> list[Margins]:
    """Margins of all axes."""
    numbers = numbers_of(values)
    return [loop(numbers, axis) for axis in range(len(AXES))]


SEARCH = Search("mpc", "flight", "tuned", PARAMETERS, arguments, loops, by_pattern=True, settle=settle)
"""`spidar tune baselines.mpc:SEARCH`."""
FOUND = {
    "xy_bandwidth": 7.667, "z_bandwidth": 8.247, "roll_pitch_bandwidth": 7.716, "yaw_bandwidth": 7.516,
    "xy_damping": 0.00118, "z_damping": 0.002521, "roll_pitch_damping": 0.00118, "yaw_damping": 0.00118,
    "xy_observer": 0.5429, "z_observer": 1.695, "roll_pitch_observer": 0.5683, "yaw_observer": 0.482,
    "belief": 0.08861, "lag": 0.02544, "delay": 0.425, "servo_bandwidth": 23.1, "vectoring_lead": 0.04626,
}  # fmt: skip
"""What it flies with: what the search ended with, `baselines/searches/mpc.json`."""


class MPC(PresetPolicy):
    """Linear model predictive control with preview of the legs' momentum on the paper's allocation; flights only."""

    presets = {HOVER: arguments(FOUND)}  # noqa: RUF012 - nobody writes it
