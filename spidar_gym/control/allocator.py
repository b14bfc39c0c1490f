"""Demand → forces: the closed form where it is exact, OSQP, a check of every answer, and named fallbacks."""

import math
import time
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from spidar_gym.arrays import FootForces, JointVector, RotorForces, RotorMask, RotorVector, Wrench
from spidar_gym.control.blocks import SPHERE_PATTERN, sphere_planes
from spidar_gym.control.modes import PROJECTION
from spidar_gym.control.qp import (
    FORCE_SCALE,
    INFINITY,
    N_FORCES,
    N_UNKNOWNS,
    WRENCH_SCALE,
    Demand,
    Mode,
    QuadraticProgram,
    assemble,
    soften,
)
from spidar_gym.control.solver import OTHER_RHO, RHO, Workspace, closed_form
from spidar_gym.errors import InvalidValueError, UnknownNameError
from spidar_gym.robot import N_LEGS, N_ROTORS, ROBOT

SIDE_TOLERANCE = 1e-5
"""A row this close to its bound may be active, in scaled units."""
_NO_FEET = np.zeros((N_LEGS, 3))
_NO_GUESS = np.zeros(0)
_NO_FEET.flags.writeable = _NO_GUESS.flags.writeable = False


class AllocationStatus(StrEnum):
    """How a tick was answered, best first."""

    CLOSED_FORM = "closed_form"
    """The optimum: the closed form of a guessed set of active rows met all KKT conditions."""
    SOLVED = "solved"
    """The optimum: the solver said solved and our check of the rows passed; refined by the closed form."""
    SOFTENED = "softened"
    """No solution within the iteration cap, or none at all: wrench and torque rows were softened."""
    HELD = "held"
    """The softened program failed too, or an input was not finite: the previous forces stay."""


@dataclass(frozen=True)
class AllocatorConfig:
    """Settings of the solver."""

    max_iter: int = 2000
    """Iteration cap: 2,000 in simulation, 300 on the robot's computer."""
    tolerance: float = 1e-7
    """Absolute tolerance of the solver, in scaled units."""
    check_tolerance: float = 1e-5
    """Largest violation of a row that our own check lets pass, in scaled units (1.6 mN of lift, 0.07 mNm of torque)."""
    price: float = 1e3
    """Price of a violated row in the softened program, in scaled units."""


@dataclass(frozen=True, slots=True)
class Allocation:
    """The answer of one tick: forces, and the thrusts λ = ‖f‖ [Zhao2025, Eq. 14]."""

    forces_l: RotorForces
    """Rotor forces in link axes, within the sphere ‖f‖ ≤ λ̄ [N]."""
    foot_forces_f: FootForces
    """Forces of the floor on the feet, floor axes [N]; zero in the modes in which they are no unknowns."""
    thrust: RotorVector
    """λ = ‖f‖ [N]."""
    joint_torques: JointVector
    """Quasi-static joint torque that goes with them, τ_q = g − T f [Nm]."""
    wrench: Wrench
    """Wrench that rotors and feet produce [N, Nm]."""
    unallocated_wrench: Wrench
    """Desired minus produced wrench [N, Nm]."""
    saturated: RotorMask
    """Rotors whose force left the sphere (the paper's bound is a cube) and was shortened."""
    status: AllocationStatus
    """How the tick was answered."""
    iterations: int
    """Iterations of the solver, all attempts together; 0 for the closed form."""
    active: np.ndarray
    """+1 where a row is at its upper bound, −1 at its lower, 0 elsewhere; empty where nobody asked for it."""
    slack: float
    """Largest violation of a softened row, in units of the weight or of the joint torque limit."""
    solve_time: float
    """Wall-clock time in closed form and solver [s]; differs from run to run."""


def _sides(program: QuadraticProgram, x: np.ndarray) -> np.ndarray:
    """+1 for rows that x brings to their upper bound, −1 for the lower: a guess of the active rows, shape (m,)."""
    r = program.A @ x
    return (program.u - r < SIDE_TOLERANCE).astype(float) - (r - program.l < SIDE_TOLERANCE)


class Allocator:
    """Demand → forces, for the modes of one preset; owns one workspace a mode."""

    def __init__(self, modes: dict[str, Mode], config: AllocatorConfig | None = None) -> None:
        """Take the modes by name and the solver's settings (`InvalidValueError` for a cap below 1)."""
        self.config = config or AllocatorConfig()
        if not isinstance(self.config.max_iter, int) or self.config.max_iter < 1:
            raise InvalidValueError("max_iter", self.config.max_iter, "an iteration cap of at least 1")
        self.modes = modes
        self._workspaces: dict[tuple[str, str], Workspace] = {}

    def allocate(
        self, demand: Demand, mode: str, previous_l: RotorForces, guess: np.ndarray | None = None
    ) -> Allocation:
        """The optimal forces of one tick, or a bounded fallback with its name.

        Args:
            demand: What is asked for.
            mode: Name of the mode.
            previous_l: Forces of the last tick, held if everything else fails [N].
            guess: `Allocation.active` of a similar demand: where those rows are active once more, that is the optimum,
                and no solver is asked. The optimum is the same to rounding, whatever the guess.

        Returns:
            The allocation. Never raises on numbers: an input that is not finite is answered with the previous forces.
        """
        start = time.perf_counter()
        with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is answered, not warned about
            rows = self.mode(mode)
            try:
                program = assemble(rows, demand)
            except ValueError:  # the sine of infinity
                return self._answer(demand, *self._held(demand, previous_l, 0), start)
            x = None
            if guess is not None and len(guess) == len(program.l):
                x = closed_form(program, guess)
            if x is None:
                x, status, iterations, slack = self._solve(demand, rows, program, previous_l)
            else:
                x, status, iterations, slack = FORCE_SCALE * x, AllocationStatus.CLOSED_FORM, 0, 0.0
            allocation = self._answer(demand, x, status, iterations, slack, start)
            if guess is None or status is AllocationStatus.HELD:
                return allocation
            return replace(allocation, active=_sides(program, x / FORCE_SCALE))

    def mode(self, name: str) -> Mode:
        """Mode by name (`UnknownNameError` lists the valid ones)."""
        if name not in self.modes:
            raise UnknownNameError("mode", name, self.modes)
        return self.modes[name]

    @staticmethod
    def _answer(
        demand: Demand,
        f: np.ndarray,
        status: AllocationStatus,
        iterations: int,
        slack: float,
        start: float,
    ) -> Allocation:
        solve_time = time.perf_counter() - start
        forces, feet = f[:N_FORCES].reshape(N_ROTORS, 3), f[N_FORCES:]
        if demand.lost.any():
            forces = np.where(demand.lost[:, None], 0.0, forces)  # the rows hold to rounding only
        norms = [math.sqrt(x * x + y * y + z * z) for x, y, z in forces.tolist()]
        thrust = np.array(norms)
        saturated = thrust > ROBOT.max_thrust
        if max(norms) > ROBOT.max_thrust:
            forces = forces * np.minimum(1.0, ROBOT.max_thrust / np.maximum(thrust, 1e-9))[:, None]
            thrust = np.minimum(thrust, ROBOT.max_thrust)
        f = np.concatenate((forces.reshape(-1), feet)) if len(feet) else forces.reshape(-1)
        wrench = demand.thrust_map @ f
        return Allocation(
            forces_l=forces,
            foot_forces_f=feet.reshape(N_LEGS, 3) if len(feet) else _NO_FEET,
            thrust=thrust,
            joint_torques=demand.gravity_torque - demand.torque_map @ f,
            wrench=wrench,
            unallocated_wrench=demand.wrench - wrench,
            saturated=saturated,
            active=_NO_GUESS,
            status=status,
            iterations=iterations,
            slack=slack,
            solve_time=solve_time,
        )

    def _solve(
        self, demand: Demand, mode: Mode, program: QuadraticProgram, previous_l: RotorForces
    ) -> tuple[np.ndarray, AllocationStatus, int, float]:
        """All unknowns [N], how they were found, iterations and slack."""
        x = closed_form(program)
        if x is not None:
            return FORCE_SCALE * x, AllocationStatus.CLOSED_FORM, 0, 0.0
        if not _finite(program):
            return self._held(demand, previous_l, 0)
        iterations = 0
        for rho in (RHO, OTHER_RHO):
            x, solved, more, duals, infeasible = self.solver(mode).solve(program, rho=rho)
            iterations += more
            solved = solved and program.violation(x) <= self.config.check_tolerance
            exact = closed_form(program, duals, rounds=8)
            if exact is None and not solved:
                exact = closed_form(program, _sides(program, x), rounds=8)
            if exact is not None or solved:
                status = AllocationStatus.SOLVED if solved else AllocationStatus.CLOSED_FORM
                return FORCE_SCALE * (x if exact is None else exact), status, iterations, 0.0
            if infeasible:
                break
        soft = soften(program, mode.soft_rows, price=self.config.price)
        x, solved, more, duals, _ = self._workspace(mode, "soft").solve(soft)
        iterations += more
        exact = closed_form(soft, duals, rounds=8)
        if exact is not None:
            x = exact
        if exact is not None or (solved and soft.violation(x) <= self.config.check_tolerance):
            slack = float(np.abs(x[mode.size :]).max())
            return FORCE_SCALE * x[: mode.size], AllocationStatus.SOFTENED, iterations, slack
        return self._held(demand, previous_l, iterations)

    @staticmethod
    def _held(
        demand: Demand, previous_l: RotorForces, iterations: int
    ) -> tuple[np.ndarray, AllocationStatus, int, float]:
        """The previous forces, bounded; of the feet nothing is known."""
        feet = demand.thrust_map.shape[1] - N_FORCES
        held = np.concatenate((_bounded(previous_l).reshape(-1), np.zeros(feet)))
        unmet = np.abs(demand.wrench - demand.thrust_map @ held).max() / WRENCH_SCALE
        return held, AllocationStatus.HELD, iterations, float(unmet) if np.isfinite(unmet) else INFINITY

    def solver(self, mode: Mode) -> Workspace:
        """The OSQP workspace of a mode's own program, for benchmarks and comparisons."""
        return self._workspace(mode, "hard")

    def _workspace(self, mode: Mode, kind: str) -> Workspace:
        key = (mode.name, kind)
        if key not in self._workspaces:
            # The two rotors and the foot of a leg share its joints, others do not.
            block = np.concatenate((np.arange(N_FORCES) // 6, np.arange(N_UNKNOWNS - N_FORCES) // 3))[: mode.size]
            P, A = block[:, None] == block[None], mode.pattern
            if kind == "soft":
                k, n = len(mode.soft_rows), mode.size
                P = np.block([[P, np.zeros((n, k), bool)], [np.zeros((k, n), bool), np.eye(k, dtype=bool)]])
                A = np.hstack([A, np.zeros((len(A), k), bool)])
                A[mode.soft_rows, n + np.arange(k)] = True
            elif kind == "projection":
                A = np.vstack([A, SPHERE_PATTERN])
            self._workspaces[key] = Workspace(P, A, max_iter=self.config.max_iter, tolerance=self.config.tolerance)
        return self._workspaces[key]

    def project(
        self, demand: Demand, forces_l: RotorForces, previous_l: RotorForces, *, rounds: int = 60
    ) -> Allocation:
        """The valid forces nearest to `forces_l`: [Zhao2025, Eq. 12, 13, 30-32] and the thrust sphere hold, Eq. 10 not.

        Tangent planes are moved along the sphere, round after round, until the nearest point of the cut polyhedron
        lies on it; then it is the nearest point of the curved set too.

        Args:
            demand: The tick's demand; its wrench is what the answer's unallocated wrench refers to.
            forces_l: Wished forces in link axes [N].
            previous_l: Forces to hold if the projection fails [N].
            rounds: Largest number of tangent planes a rotor.
        """
        start = time.perf_counter()
        with np.errstate(over="ignore", invalid="ignore"):
            forces, status, iterations = self._nearest(demand, forces_l, previous_l, rounds)
            return self._answer(demand, forces.reshape(-1), status, iterations, 0.0, start)

    def _nearest(
        self, demand: Demand, wish_l: RotorForces, previous_l: RotorForces, rounds: int
    ) -> tuple[RotorForces, AllocationStatus, int]:
        held = _bounded(previous_l), AllocationStatus.HELD
        try:
            rows = assemble(PROJECTION, demand)
        except ValueError:
            return *held, 0
        wish = wish_l.reshape(-1) / FORCE_SCALE
        # A plane turned all the way to the last point would overshoot by how far the wish lies outside.
        turn = ROBOT.max_thrust / np.maximum(np.linalg.norm(wish_l, axis=1, keepdims=True), ROBOT.max_thrust)
        forces, normals = wish_l, wish_l
        status, total = AllocationStatus.CLOSED_FORM, 0
        for _ in range(rounds):
            A, u = sphere_planes(normals)
            l = np.concatenate((rows.l, np.full(N_ROTORS, -INFINITY)))
            program = QuadraticProgram(rows.P, -wish, np.concatenate((rows.A, A)), l, np.concatenate((rows.u, u)))
            if not _finite(program):
                return *held, total
            x = closed_form(program)
            if x is None:
                status = AllocationStatus.SOLVED
                x, solved, iterations, duals, _ = self._workspace(PROJECTION, "projection").solve(program)
                total += iterations
                exact = closed_form(program, duals, rounds=8)
                if exact is not None:
                    x = exact
                elif not solved or program.violation(x) > self.config.check_tolerance:
                    return *held, total
            forces = FORCE_SCALE * x.reshape(N_ROTORS, 3)
            norm = np.linalg.norm(forces, axis=1, keepdims=True)
            if (norm <= (1.0 + 1e-8) * ROBOT.max_thrust).all():
                break
            planes = np.linalg.norm(normals, axis=1, keepdims=True)
            outside = norm > ROBOT.max_thrust
            ahead = np.where(planes > ROBOT.max_thrust, normals / planes, forces / norm)
            ahead += turn * (forces / norm - ahead)
            ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
            normals = np.where(outside | (planes > ROBOT.max_thrust), 2.0 * ROBOT.max_thrust * ahead, forces)
        return forces, status, total


def _bounded(forces_l: RotorForces) -> RotorForces:
    """The forces with zeros for what is not finite, within the sphere."""
    finite = np.where(np.isfinite(forces_l), forces_l, 0.0)
    norm = np.linalg.norm(finite, axis=1)
    return finite * np.minimum(1.0, ROBOT.max_thrust / np.maximum(norm, 1e-9))[:, None]


def _finite(program: QuadraticProgram) -> bool:
    """Whether every number is finite; an idle row's bounds are large, not infinite."""
    return bool(np.isfinite(program.P.sum() + program.q.sum() + program.A.sum() + program.l.sum() + program.u.sum()))
