"""Linear model of a hover: the simulated robot with its legs and servos, any flight controller, and their margins.

The robot is MuJoCo's, linearised about a hover in a form: torso, joints with stiffness and damping, vectoring servos,
lag of the thrust, delay of the commands, filter of the encoders. The controller is the one that flies, linearised by
differences of its own step. Not in the model: air, dry friction and play, noise, latency of the motion capture, limits.
"""

# pyright: reportAttributeAccessIssue=false
# The compiled modules below come without stubs.

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cached_property
from typing import Any

import mujoco
import numpy as np

from spidar_gym.arrays import JointVector
from spidar_gym.control.flight.controller import FlightController
from spidar_gym.errors import SpidarError
from spidar_gym.native.plant import Plant
from spidar_gym.robot import GIMBAL_NAMES, JOINT_NAMES, N_JOINTS, N_ROTORS
from spidar_gym.sim.air import AeroConfig
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.recirculation import RecirculationConfig
from spidar_gym.sim.scene import TIMESTEP
from spidar_gym.so3 import exp, matrix_to_quat, quat_to_matrix
from spidar_gym.state import Reference, RobotState

SETTLE_SECONDS, SETTLED = 25.0, 1e-3
"""Time of the flight that finds the hover [s], and the largest joint speed at its end [rad/s]."""
CALM = 8.0
"""Least damping of the joint servos in that flight [Nm s/rad]."""
TOLERANCE = 1e-5
"""Growth of a mode per tick up to which a loop counts as stable: the integrals of a hover are neutral."""
HARDLY = 0.01
"""Motion of the torso below which a mode at the limits of the actuators only rings [m, rad] [chosen]."""
LEAST_GAIN, MOST_GAIN, MOST_DELAY = 0.4, 8.0, 0.2
"""Least and largest gain, and largest delay, that are tried [s]."""
MEASURED = {
    "position_w": 3, "attitude": 3, "velocity_w": 3, "omega_b": 3, "joint_position": N_JOINTS,
    "joint_velocity": N_JOINTS, "vectoring": 2 * N_ROTORS, "thrust": N_ROTORS,
}  # fmt: skip
"""Quantities of a state that the controller reads, and their sizes."""


@dataclass(frozen=True)
class LinearRobot:
    """A simulated robot about a hover, in physics steps: x⁺ = A x + B u, y = C x."""

    A: np.ndarray
    """(n, n) of velocities and positions of all axes, and of the actuators' activations."""
    B: np.ndarray
    """(n, 24), of the commands: thrusts [N], then φ and θ of each module [rad]."""
    C: np.ndarray
    """(80, n), of `MEASURED`."""
    delay: np.ndarray
    """Delay of each command in physics steps, (24,)."""
    substeps: int
    """Physics steps of a control period."""
    thrust_room: np.ndarray
    """What each thrust may deviate from that of the hover, to its nearer limit, (8,) [N]."""
    vectoring_speed: float
    """Largest speed of the vectoring servos [rad/s]."""


@dataclass(frozen=True)
class LinearLaw:
    """A controller about a hover, in control ticks: z⁺ = A z + B y, u = C z + D y."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray


@dataclass(frozen=True)
class Hover:
    """A hover of a robot with a controller."""

    config: PlantConfig
    """The robot, without what the model leaves out."""
    controller: FlightController
    """The controller, with the memory that it has in the hover."""
    reference: Reference
    """What it is to hold."""
    state: RobotState
    """The state."""
    qpos: np.ndarray
    """MuJoCo's position."""
    act: np.ndarray
    """MuJoCo's activations of the actuators."""


def modelled(config: PlantConfig) -> PlantConfig:
    """Return a robot without what the linear model leaves out; the mean of the jitter joins the delay."""
    a = config.actuators
    actuators = replace(
        a, delay=a.delay + 0.5 * a.jitter, thrust_lag=0.5 * (1.0 + a.spin_down) * a.thrust_lag, spin_down=1.0,
        jitter=0.0, loss=0.0, thrust_noise=0.0, joint_friction=0.0, backlash=0.0, vectoring_friction=0.0,
        vectoring_backlash=0.0, joint_offset=0.0 * a.joint_offset, vectoring_offset=0.0 * a.vectoring_offset,
        battery=False, board_scaling=False,
    )  # fmt: skip
    air = AeroConfig(wake=False)
    return replace(config, sense=False, actuators=actuators, aero=air, recirculation=RecirculationConfig())


def settle(controller: FlightController, form: JointVector, config: PlantConfig, mode: str = "flight") -> Hover:
    """Fly a robot with well damped joints until it hovers in a form; its hover is that of any damping and delay.

    Args:
        controller: The controller; its memory is changed.
        form: q [rad].
        config: The robot.
        mode: Allocation mode.

    Raises:
        SpidarError: If the hover does not come to rest.
    """
    config = modelled(config)
    calm = replace(config.actuators, joint_kd=max(CALM, config.actuators.joint_kd), delay=0.0, vectoring_delay=0.0)
    plant = Plant(replace(config, actuators=calm))
    vectoring = controller.rest_vectoring(form)
    thrust = np.full(N_ROTORS, config.robot.weight / N_ROTORS)
    state = plant.reset(np.array([0.0, 0.0, 3.0]), joint_position=form, vectoring=vectoring, thrust=thrust)
    controller.reset(state, form)
    com = controller.model.snapshot(form, np.eye(3), vectoring).com_b
    level = np.array([1.0, 0.0, 0.0, 0.0])
    reference = Reference(state.position_w + com, level, np.zeros(3), np.zeros(3), form, mode=mode)
    for _ in range(round(SETTLE_SECONDS / plant.period)):
        state = plant.step(controller.step(state, reference))
    if plant.diverged or not np.abs(state.joint_velocity).max() < SETTLED:
        raise SpidarError("the hover does not come to rest, even with well damped joints and no delay; no margins")
    found = Hover(config, controller, reference, state, plant.data.qpos.copy(), plant.data.act.copy())
    plant.close()
    return found


def linear_robot(hover: Hover, config: PlantConfig | None = None) -> LinearRobot:
    """Linearise the robot of a hover, or another one that hovers there: with other damping, lag or delay.

    Args:
        hover: The hover.
        config: The other robot.
    """
    config = hover.config if config is None else modelled(config)
    plant = Plant(config)
    model, data = plant.model, plant.data
    data.qpos[:], data.qvel[:], data.act[:], data.ctrl[:] = hover.qpos, 0.0, hover.act, hover.act
    nv = model.nv
    A, B = np.zeros((2 * nv + model.na,) * 2), np.zeros((2 * nv + model.na, model.nu))
    mujoco.mjd_transitionFD(model, data, 1e-6, 1, A, B, None, None)
    C = np.zeros((sum(MEASURED.values()), len(A)))
    joints, gimbals = ([model.joint(name).dofadr[0] for name in names] for names in (JOINT_NAMES, GIMBAL_NAMES))
    torso = list(range(3)), list(range(3, 6))
    columns = [
        *torso[0], *torso[1], *(nv + k for k in (*torso[0], *torso[1])), *joints, *(nv + k for k in joints), *gimbals,
        *(2 * nv + k for k in range(N_ROTORS)),
    ]  # fmt: skip
    C[np.arange(len(C)), columns] = 1.0
    plant.close()
    # The activations of the joints' servos are their setpoints, which no feedback moves.
    first = N_ROTORS + N_JOINTS
    kept = np.delete(np.arange(len(A)), 2 * nv + np.arange(N_ROTORS, first))
    commands = np.r_[0:N_ROTORS, first : model.nu]
    actuators = config.actuators
    late = np.repeat([0.0, actuators.vectoring_delay], (N_ROTORS, 2 * N_ROTORS)) + actuators.delay
    delay = np.rint(late / TIMESTEP).astype(int)
    thrust = hover.act[:N_ROTORS]
    return LinearRobot(
        A[np.ix_(kept, kept)], B[np.ix_(kept, commands)], C[:, kept], delay, config.substeps,
        np.minimum(thrust, actuators.max_thrust - thrust), config.robot.max_vectoring_speed,
    )  # fmt: skip


def linear_law(hover: Hover, step: float = 1e-5) -> LinearLaw:
    """Linearise the controller of a hover by central differences of its step in its memory and its measurements.

    The memory is `memory`, the wrench that the last step allocated, and every array that the controller has besides.
    """
    controller, reference, state = hover.controller, hover.reference, hover.state
    before = _memory_of(controller)
    at, size = _flat(before), sum(MEASURED.values())

    def tick(z: np.ndarray, y: np.ndarray) -> np.ndarray:
        _remember(controller, before, z)
        command = controller.step(_moved(state, y), reference)
        return np.concatenate((_flat(_memory_of(controller)), command.thrust, command.vectoring.reshape(-1)))

    n = len(at)
    J = np.zeros((n + 3 * N_ROTORS, n + size))
    point = np.concatenate((at, np.zeros(size)))
    for k in np.flatnonzero(np.isfinite(point)):
        ahead, back = point.copy(), point.copy()
        ahead[k] += step
        back[k] -= step
        ends = tick(ahead[:n], ahead[n:]), tick(back[:n], back[n:])
        with np.errstate(invalid="ignore"):
            J[:, k] = (ends[0] - ends[1]) / (2.0 * step)
    _remember(controller, before, at)
    J[~np.isfinite(J)] = 0.0
    kept = _alive(J, n)
    rows, columns = np.r_[kept, n : len(J)], np.r_[kept, n : n + size]
    J = J[np.ix_(rows, columns)]
    m = len(kept)
    return LinearLaw(J[:m, :m], J[:m, m:], J[m:, :m], J[m:, m:])


def _alive(J: np.ndarray, n: int) -> np.ndarray:
    """Return the entries of the memory that something moves and that move something, out of n."""
    kept = np.arange(n)
    while True:
        inner = np.abs(J[np.ix_(kept, kept)])
        np.fill_diagonal(inner, 0.0)
        moves = np.maximum(inner.max(0, initial=0.0), np.abs(J[n:, kept]).max(0)) > 1e-7
        moved = np.maximum(inner.max(1, initial=0.0), np.abs(J[kept, n:]).max(1)) > 1e-7
        if (moves & moved).all():
            return kept
        kept = kept[moves & moved]


def _moved(state: RobotState, y: np.ndarray) -> RobotState:
    """Return a state moved by y, an entry for each of `MEASURED`; the attitude turns about the torso's axes."""
    ends = np.cumsum(list(MEASURED.values()))[:-1]
    p, turn, v, omega, q, rate, vectoring, thrust = np.split(y, ends)
    return replace(
        state, position_w=state.position_w + p, quat_wb=matrix_to_quat(quat_to_matrix(state.quat_wb) @ exp(turn)),
        velocity_w=state.velocity_w + v, omega_b=state.omega_b + omega, joint_position=state.joint_position + q,
        joint_velocity=state.joint_velocity + rate, vectoring=state.vectoring + vectoring.reshape(N_ROTORS, 2),
        thrust=state.thrust + thrust,
    )  # fmt: skip


def _memory_of(controller: FlightController) -> dict[str, Any]:
    """Return what a controller remembers from tick to tick."""
    assert controller.last_step is not None
    own = {name: value for name, value in vars(controller).items() if isinstance(value, np.ndarray)}
    return {"memory": controller.memory, "last_step": controller.last_step, **own}


def _remember(controller: FlightController, before: Mapping[str, Any], numbers: np.ndarray) -> None:
    """Give a controller a memory with other numbers."""
    values = iter(numbers.tolist())
    for name, value in before.items():
        if name == "last_step":
            wrench = _filled(value.allocation.wrench, values)
            value = replace(value, allocation=replace(value.allocation, wrench=wrench))
        else:
            value = _filled(value, values)
        setattr(controller, name, value)


def _flat(memory: Mapping[str, Any]) -> np.ndarray:
    """Return the numbers of a memory."""
    parts = (part.allocation.wrench if name == "last_step" else part for name, part in memory.items())
    return np.array([number for part in parts for number in _numbers(part)])


def _numbers(value: Any) -> Iterator[float]:  # noqa: ANN401 - any part of a memory
    """Iterate over the numbers of arrays and dataclasses; flags and words are no numbers."""
    if isinstance(value, np.ndarray) and value.dtype.kind == "f":
        yield from value.reshape(-1).tolist()
    elif isinstance(value, float):
        yield value
    elif is_dataclass(value):
        for f in fields(value):
            yield from _numbers(getattr(value, f.name))


def _filled(value: Any, numbers: Iterator[float]) -> Any:  # noqa: ANN401 - any part of a memory
    """Return a copy with other numbers, in the order of `_numbers`."""
    if isinstance(value, np.ndarray) and value.dtype.kind == "f":
        return np.array([next(numbers) for _ in range(value.size)]).reshape(value.shape)
    if isinstance(value, float):
        return next(numbers)
    if is_dataclass(value) and not isinstance(value, type):
        return replace(value, **{f.name: _filled(getattr(value, f.name), numbers) for f in fields(value)})
    return value


def behind_encoders(law: LinearLaw, bandwidth: float, period: float) -> LinearLaw:
    """Return a law that reads joint angles and velocities from the estimator's filter of the encoders.

    Args:
        law: The law.
        bandwidth: Bandwidth of the filter [rad/s], 0 for none.
        period: Period of the law [s], in which the filter is assumed to read the encoders once.
    """
    if not bandwidth:
        return law
    d, I = math.exp(-bandwidth * period), np.eye(N_JOINTS)
    # a⁺ = a + Δt r + (1 − d²) e, r⁺ = r + (1 − d)² / Δt e of the error e = q − a − Δt r; see `Estimator.update`.
    gains = np.vstack(((1.0 - d * d) * I, (1.0 - d) ** 2 / period * I))
    guess = np.hstack((I, period * I))
    F = np.block([[I, period * I], [np.zeros_like(I), I]]) - gains @ guess
    names = list(MEASURED)
    ends = np.cumsum(list(MEASURED.values()))
    first = int(ends[names.index("joint_position") - 1])
    read = np.zeros((len(law.B.T), 2 * N_JOINTS))
    read[first : first + 2 * N_JOINTS] = F
    seen = np.eye(len(read))
    seen[first : first + 2 * N_JOINTS] = 0.0
    angles = slice(first, first + N_JOINTS)
    seen[first : first + 2 * N_JOINTS, angles] = gains
    G = np.zeros((2 * N_JOINTS, len(read)))
    G[:, angles] = gains
    return LinearLaw(
        np.block([[law.A, law.B @ read], [np.zeros((2 * N_JOINTS, len(law.A))), F]]),
        np.vstack((law.B @ seen, G)), np.hstack((law.C, law.D @ read)), law.D @ seen,
    )  # fmt: skip


@dataclass(frozen=True)
class Loop:
    """A robot and a law about the same hover."""

    robot: LinearRobot
    law: LinearLaw

    @cached_property
    def _powers(self) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """A^k, and the sums of the first k of them, k = 0 … substeps."""
        powers, sums = [np.eye(len(self.robot.A))], [np.zeros_like(self.robot.A)]
        for _ in range(self.robot.substeps):
            sums.append(sums[-1] + powers[-1])
            powers.append(self.robot.A @ powers[-1])
        return powers, sums

    def transition(self, gain: float = 1.0, delay: int = 0) -> np.ndarray:
        """Return the transition of robot, law and commands under way over one control period.

        Args:
            gain: Factor on what the commands deviate from those of the hover.
            delay: Physics steps by which all commands come later still.
        """
        robot, law, (powers, sums) = self.robot, self.law, self._powers
        steps, n, m, k = robot.substeps, len(robot.A), len(law.A), robot.B.shape[1]
        ticks, rest = np.divmod(robot.delay + delay, steps)
        depth = int((ticks + (rest > 0)).max())
        inputs = np.zeros((depth + 1, n, k))  # of the command i ticks ago
        for tick, late in {*zip(ticks.tolist(), rest.tolist(), strict=True)}:
            own = np.flatnonzero((ticks == tick) & (rest == late))
            inputs[tick][:, own] += sums[steps - late] @ robot.B[:, own]
            if late:
                inputs[tick + 1][:, own] += powers[steps - late] @ sums[late] @ robot.B[:, own]
        T = np.zeros((n + m + k * depth,) * 2)
        now = np.hstack((gain * law.D @ robot.C, gain * law.C))
        T[:n, :n] = powers[steps]
        T[:n, : n + m] += inputs[0] @ now
        T[n : n + m, :n], T[n : n + m, n : n + m] = law.B @ robot.C, law.A
        for i in range(depth):
            own = slice(n + m + k * i, n + m + k * (i + 1))
            T[:n, own] = inputs[i + 1]
            if i:
                T[own, n + m + k * (i - 1) : n + m + k * i] = np.eye(k)
            else:
                T[own, : n + m] = now
        return T

    def modes(self, gain: float = 1.0, delay: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return growth per control period, frequency [rad/s] and shape of all modes, the fastest growing first.

        Shapes are columns of the transition's states.
        """
        found, shapes = np.linalg.eig(self.transition(gain, delay))
        order = np.argsort(-np.abs(found))
        return np.abs(found[order]), np.abs(np.angle(found[order])) / self.period, shapes[:, order]

    @property
    def period(self) -> float:
        """Control period [s]."""
        return self.robot.substeps * TIMESTEP

    def growing(self, gain: float = 1.0, delay: int = 0, *, rings: bool = False) -> float:
        """Return the frequency of the fastest growing mode [rad/s]; −1 if none grows.

        Args:
            gain: As in `transition`.
            delay: As in `transition`.
            rings: Whether modes count that ring only.
        """
        if np.abs(np.linalg.eigvals(self.transition(gain, delay))).max() <= 1.0 + TOLERANCE:
            return -1.0
        growth, frequency, shapes = self.modes(gain, delay)
        for k in np.flatnonzero(growth > 1.0 + TOLERANCE):
            if rings or not self._rings(float(frequency[k]), shapes[:, k], gain):
                return float(frequency[k])
        return -1.0

    def growth(self, gain: float = 1.0, delay: int = 0, *, rings: bool = False) -> float:
        """Return the rate at which the fastest growing mode grows [1/s]; 0 if none does.

        Args:
            gain: As in `transition`.
            delay: As in `transition`.
            rings: Whether modes count that ring only.
        """
        fastest = np.abs(np.linalg.eigvals(self.transition(gain, delay))).max()
        if fastest <= 1.0 + TOLERANCE or rings:
            return max(0.0, math.log(fastest) / self.period) if fastest > 1.0 + TOLERANCE else 0.0
        growth, frequency, shapes = self.modes(gain, delay)
        for k in np.flatnonzero(growth > 1.0 + TOLERANCE):
            if not self._rings(float(frequency[k]), shapes[:, k], gain):
                return math.log(growth[k]) / self.period
        return 0.0

    def _rings(self, frequency: float, shape: np.ndarray, gain: float) -> bool:
        """Return whether a mode hardly moves the torso when its thrusts or vectoring servos reach their limits."""
        robot, law = self.robot, self.law
        n, m = len(robot.A), len(law.A)
        u = gain * np.abs(law.D @ robot.C @ shape[:n] + law.C @ shape[n : n + m])
        speed = u[N_ROTORS:].max() * 2.0 * math.sin(0.5 * frequency * self.period) / self.period
        limit = 1.0 / max(float((u[:N_ROTORS] / robot.thrust_room).max()), speed / robot.vectoring_speed)
        y = np.abs(robot.C @ shape[:n]) * limit
        return bool(y[:6].max() < HARDLY)

    def gain_margin(self, *, rings: bool = False) -> tuple[float, float]:
        """Return the factor on the commands' deviations from which on a mode grows, and its frequency [rad/s].

        Modes that ring count only if `rings`: legs and vectoring servos swing, and the torso hardly moves when an
        actuator reaches its limit, which bounds them. All others throw the robot over. Below 1 a mode grows already,
        and the loop is stable with that factor. Where none grows up to `MOST_GAIN`, the factor is that, and where one
        grows down to `LEAST_GAIN`, 0; the frequency is then −1.
        """
        frequency = self.growing(rings=rings)
        end = MOST_GAIN if frequency < 0.0 else LEAST_GAIN
        last = 1.0
        for gain in np.geomspace(1.0, end, 16)[1:].tolist():
            found = self.growing(gain, rings=rings)
            if (found < 0.0) != (frequency < 0.0):
                break
            last, frequency = gain, found
        else:
            return (MOST_GAIN if frequency < 0.0 else 0.0), -1.0
        low, high = min(last, gain), max(last, gain)
        frequency = max(frequency, found)
        while high > 1.005 * low:
            middle = math.sqrt(low * high)
            found = self.growing(middle, rings=rings)
            low, high, frequency = (middle, high, frequency) if found < 0.0 else (low, middle, found)
        return low, frequency

    def delay_margin(self) -> float:
        """Return the largest further delay of all commands without a mode that throws the robot over [s]."""
        low, high = 0, round(MOST_DELAY / TIMESTEP)
        if self.growing(delay=low) >= 0.0:
            return 0.0
        while high > low + 1:
            middle = (low + high) // 2
            low, high = (middle, high) if self.growing(delay=middle) < 0.0 else (low, middle)
        return low * TIMESTEP
