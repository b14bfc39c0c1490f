"""Joint servos from a bench test: stiffness, damping, dry friction and speed of every joint, and the commands' delay.

The robot's model, clamped to a stand, is driven by the logged commands for a few seconds at a time, each time from a
measured state (multiple shooting). The parameters are those with the least squares of the differences from the encoders
and from what was known before. The states at the begins of the pieces are unknowns too: they are eliminated from each
Levenberg-Marquardt step. Masses and centres of mass of the links are unknowns as well, so that the intervals contain
what they leave open. Commands that did not arrive, which delay and damping would else explain, are found by trial.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from spidar_gym.identify.estimate import Estimate
from spidar_gym.identify.shooting import PARAMETERS, Bench, Shooting, bench_of, joined, split
from spidar_gym.logs.record import Record
from spidar_gym.robot import N_JOINTS, N_LEGS, ROBOT, RobotSpec

PIECE, HELD_OUT = 3.0, 1.0
"""Length of a piece, and time after each that is not used in the fit, but predicted [s]."""
ROBUST = 4.0
"""Deviations beyond which a difference counts less."""
STATE_SPREAD = (0.0008, 0.03)
"""Deviation of a smoothed angle and rate from the true ones at the begin of a piece [rad, rad/s]."""
STATE_NUDGE = (0.001, 0.02)
"""Steps of their derivatives [rad, rad/s]."""
STEPS, ENOUGH = 16, 3e-4
"""Most steps of the minimisation; it ends when a step lowers the cost by less than this share."""
PER_LEG = N_JOINTS // N_LEGS
APART, ECHO, LOST = 20, 0.4, 25.0
"""Distance of commands that are left out in one trial [commands], time after each in which the differences are compared
[s], and decrease of their squares from which on a command counts as lost."""
MEAN = np.array([1.0, 0.5])
"""Weights of delay and jitter in the mean delay."""
DELAY_FLOOR = 0.0005
"""Deviation of the delay that physics steps leave open [s] [chosen]."""
MOVES, NEAR = 1e-3, 3
"""Least difference of a command from its predecessor for it to be tried [rad], and commands of which one is lost."""
ALIKE = {"damping": 0.1}
"""Deviation of servos of one make from their mean, over it [chosen]."""
LEFT_OUT = 2.0
"""Factor on the deviations, for the few pieces in which a joint is moved and for what the model leaves out [chosen, on
robots other than those of the study hidden]."""


@dataclass(frozen=True)
class Servos:
    """Estimated joint servos."""

    delay: Estimate
    """Mean time, over the jitter, from the publication of a command to its effect, () [s]."""
    damping: Estimate
    """Viscous damping of servo and joint together, D, (16,) [Nm s/rad]."""
    friction: Estimate
    """Dry friction, (16,) [Nm]."""
    stiffness: Estimate
    """Stiffness of the servos, (16,) [Nm/rad]."""
    speed: Estimate
    """Largest speed of the servos' setpoints, (16,) [rad/s]."""
    lost: float
    """Share of the commands that did not arrive, as far as they would have moved a joint."""
    misfit: float
    """Root mean square of the differences from the encoders, over the encoders' own error."""
    ahead: np.ndarray
    """RMS error of the angles predicted over seconds that were not used, (16,) [rad]."""
    described: np.ndarray
    """The same of the described robot, (16,) [rad]."""


def fit_servos(
    record: Record, mass: float, robot: RobotSpec = ROBOT, *, threads: int = 2,
    on_step: Callable[[float], object] = lambda misfit: None,
) -> Servos:  # fmt: skip
    """Estimate the joint servos from the log of a bench test.

    Args:
        record: The log.
        mass: Mass of the robot [kg]; the inertias are those of the description, in proportion to it.
        robot: The described robot.
        threads: Threads that simulate.
        on_step: Called after each step of the minimisation with the misfit, for progress.

    Raises:
        UnfitLogError: For a log without a bench test.
    """
    bench = bench_of(record)
    first, last = bench.command_time[[0, -1]]
    begins = np.arange(first + 0.3, last - PIECE, PIECE + HELD_OUT)
    fit = _Minimisation(Shooting(bench, mass, robot, begins, PIECE, threads))
    parameters, covariance, misfit = fit.run(on_step)
    ahead = _ahead(bench, mass, robot, begins + PIECE, parameters, threads)
    lost = fit.lost_share()
    values, deviations = split(parameters), split(np.sqrt(np.diag(covariance)))
    known = {each.name: np.full(each.count, each.spread) for each in PARAMETERS}
    found = {name: Estimate(values[name], deviations[name], known[name]) for name in
             ("damping", "friction", "stiffness", "speed")}  # fmt: skip
    mean = float(values["delay"][0] + 0.5 * values["jitter"][0])
    deviation = np.sqrt(MEAN @ covariance[:2, :2] @ MEAN + DELAY_FLOOR**2)
    delay = Estimate(np.array(mean), np.array(deviation), np.array(known["delay"][0]))
    return Servos(delay=delay, lost=lost, misfit=misfit, ahead=ahead[0], described=ahead[1], **found)


def _ahead(
    bench: Bench, mass: float, robot: RobotSpec, begins: np.ndarray, parameters: np.ndarray, threads: int
) -> np.ndarray:
    """Return RMS errors of the angles over the held-out seconds, identified and as described, (2, 16) [rad]."""
    shooting = Shooting(bench, mass, robot, begins, HELD_OUT, threads)
    described = joined({
        "delay": parameters[0], "jitter": parameters[1], "damping": robot.joint_kd + robot.joint_damping,
        "friction": robot.joint_friction, "stiffness": robot.joint_kp, "speed": robot.joint_speed,
    })  # fmt: skip
    still = np.zeros((len(begins), 2, N_JOINTS))
    found = shooting.misfits([(parameters, still), (described, still)])
    return np.sqrt((np.array(found) ** 2).mean(axis=1)) / shooting.weight


class _Minimisation:
    """Levenberg-Marquardt steps with the states at the begins eliminated."""

    def __init__(self, shooting: Shooting) -> None:
        self._shooting = shooting
        self._first, self._spread, self._least, self._most = (
            np.concatenate([np.full(each.count, getattr(each, name)) for each in PARAMETERS])
            for name in ("first", "spread", "least", "most")
        )
        self._state_spread = np.repeat(STATE_SPREAD, PER_LEG)

    def run(self, on_step: Callable[[float], object]) -> tuple[np.ndarray, np.ndarray, float]:
        """Return the parameters with the least cost, their covariance, and the misfit."""
        shooting, parameters = self._shooting, self._first.copy()
        begins = np.zeros((len(shooting.begins), 2, N_JOINTS))
        parameters, begins = self._descend(parameters, begins, on_step)
        if self._find_lost(parameters, begins):
            parameters, begins = self._descend(parameters, begins, on_step)
        misfit = shooting.misfits([(parameters, begins)])[0]
        normal, _, _, scores = self._normal(parameters, begins, misfit)
        covariance = self._covariance(normal, scores, self._known(parameters)[2])
        return parameters, covariance, float(np.sqrt((misfit**2).mean()))

    def _descend(
        self, parameters: np.ndarray, begins: np.ndarray, on_step: Callable[[float], object]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Take steps until the cost hardly falls."""
        misfit = self._shooting.misfits([(parameters, begins)])[0]
        cost, damping = self._cost(misfit, parameters, begins), 1e-3
        for _ in range(STEPS):
            normal, slope, pieces, _ = self._normal(parameters, begins, misfit)
            before = cost
            while True:
                step = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), slope)
                tried = np.clip(parameters + step, self._least, self._most)
                moved = begins.copy()
                for (k, leg), (inverse, coupling, own) in pieces.items():
                    change = inverse @ (own - coupling @ (tried - parameters))
                    moved[k, :, PER_LEG * leg : PER_LEG * (leg + 1)] += change.reshape(2, PER_LEG)
                found = self._shooting.misfits([(tried, moved)])[0]
                lower = self._cost(found, tried, moved)
                if lower < cost or damping > 1e4:
                    break
                damping *= 10.0
            if not lower < cost:
                break
            parameters, begins, misfit, cost, damping = tried, moved, found, lower, damping / 10.0
            on_step(float(np.sqrt((misfit**2).mean())))
            if before - cost < ENOUGH * before:
                break
        return parameters, begins

    def _moving(self) -> np.ndarray:
        """Return the commands within pieces that differ from their predecessors."""
        shooting, bench = self._shooting, self._shooting.bench
        moves = (abs(np.diff(bench.command, axis=0, prepend=bench.command[:1])) > MOVES).any(axis=1)
        since = bench.command_time[:, None] - shooting.begins
        return np.flatnonzero(moves & ((since > 0.0) & (since < PIECE - ECHO)).any(axis=1))

    def _find_lost(self, parameters: np.ndarray, begins: np.ndarray) -> bool:
        """Mark the commands without which the simulation is closer to the encoders; returns whether there are some."""
        shooting, moving = self._shooting, self._moving()
        tried = [moving[k::APART] for k in range(APART)]
        masks = [np.isin(np.arange(len(shooting.lost)), own) for own in tried]
        base, *found = shooting.misfits([(parameters, begins)] * (1 + APART), [shooting.lost, *masks])
        time = shooting.sample_time
        gains = np.zeros(len(shooting.lost))
        for own, misfit in zip(tried, found, strict=True):
            better = (np.minimum(abs(base), ROBUST) ** 2 - np.minimum(abs(misfit), ROBUST) ** 2).sum(axis=1)
            for k in own:
                since = time - shooting.bench.command_time[k] - parameters[0]
                gains[k] = better[(since > 0.0) & (since < ECHO)].sum()
        # Neighbours of a lost command explain it in part: the best of them is the lost one.
        around = np.lib.stride_tricks.sliding_window_view(np.pad(gains, NEAR), 2 * NEAR + 1).max(axis=1)
        shooting.lost = (gains > LOST) & (gains == around)
        return bool(shooting.lost.any())

    def lost_share(self) -> float:
        """Return the share of lost commands among those that move a joint."""
        moving = self._moving()
        return float(self._shooting.lost[moving].mean()) if len(moving) else 0.0

    def _covariance(self, normal: np.ndarray, scores: np.ndarray, known: np.ndarray) -> np.ndarray:
        """Return the covariance of the parameters: errors of a leg in a piece belong together."""
        inverse = np.linalg.inv(normal)
        spread = inverse @ (scores.T @ scores + known) @ inverse
        # Where the scatter of the few pieces is small by chance, the noise of the encoders is the least.
        larger = LEFT_OUT * np.sqrt(np.maximum(1.0, np.diag(inverse) / np.diag(spread)))
        return spread * np.outer(larger, larger)

    def _cost(self, misfit: np.ndarray, parameters: np.ndarray, begins: np.ndarray) -> float:
        state = (begins.reshape(-1, 2, N_LEGS, PER_LEG) / self._state_spread.reshape(2, 1, PER_LEG)) ** 2
        huber = np.where(abs(misfit) < ROBUST, misfit**2, ROBUST * (2.0 * abs(misfit) - ROBUST))
        return float(huber.sum() + self._known(parameters)[0] + state.sum())

    def _known(self, parameters: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """Return the cost of what is known before, half its negative slope, and its normal matrix.

        Beside the spread of each parameter this is that servos of one make are alike: without it errors of the delay
        are errors of the damping of those joints that turn a small inertia.
        """
        off = (parameters - self._first) / self._spread
        cost, slope, normal = float(off @ off), -off / self._spread, np.diag(1.0 / self._spread**2)
        for name, share in ALIKE.items():
            place = split(np.arange(len(parameters)))[name]
            logs = np.log(parameters[place])
            own = (np.eye(len(place)) - 1.0 / len(place)) / parameters[place] / share
            apart = (logs - logs.mean()) / share
            cost += float(apart @ apart)
            slope[place] -= own.T @ apart
            normal[np.ix_(place, place)] += own.T @ own
        return cost, slope, normal

    def _groups(self) -> list[np.ndarray]:
        """Return the parameters that are varied in one simulation: legs on a stand do not move each other."""
        groups, end = [], 0
        for each in PARAMETERS:
            index = np.arange(end, end + each.count).reshape(
                -1 if each.count == 1 else N_LEGS, each.count // N_LEGS or 1
            )
            end += each.count
            groups += [] if each.name == "bias" else list(index.T)
        return groups

    def _slopes(self, parameters: np.ndarray, begins: np.ndarray, misfit: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the derivatives of the misfits: by parameters (n, 16, p), by a leg's state at the begin (n, 16, 8)."""
        shooting, groups = self._shooting, self._groups()
        vary = np.concatenate(
            [each.step(own) for each, own in zip(PARAMETERS, split(parameters).values(), strict=True)]
        )  # fmt: skip
        jobs = [(parameters + vary * np.isin(np.arange(len(vary)), group), begins) for group in groups]
        nudge = np.repeat(STATE_NUDGE, PER_LEG)
        for k in range(2 * PER_LEG):
            off = np.zeros((1, 2, N_LEGS, PER_LEG))
            off[0, k // PER_LEG, :, k % PER_LEG] = nudge[k]
            jobs.append((parameters, begins + off.reshape(1, 2, N_JOINTS)))
        found = shooting.misfits(jobs)
        slopes, states = np.zeros((*misfit.shape, len(vary))), np.zeros((*misfit.shape, 2 * PER_LEG))
        for group, varied in zip(groups, found, strict=False):
            if len(group) == 1:  # of all joints
                slopes[..., group[0]] = (varied - misfit) / vary[group[0]]
                continue
            for leg, own in enumerate(group):
                mine = slice(PER_LEG * leg, PER_LEG * (leg + 1))
                slopes[:, mine, own] = (varied - misfit)[:, mine] / vary[own]
        slopes[:, range(N_JOINTS), split(np.arange(len(vary)))["bias"]] = shooting.weight
        for k in range(2 * PER_LEG):
            states[..., k] = (found[len(groups) + k] - misfit) / nudge[k]
        return slopes, states

    def _normal(self, parameters: np.ndarray, begins: np.ndarray, misfit: np.ndarray) -> tuple:
        """Return the normal equations of the parameters, what the begins follow from, and each piece's slope."""
        slopes, states = self._slopes(parameters, begins, misfit)
        weight = np.minimum(1.0, ROBUST / np.maximum(abs(misfit), 1e-9))
        _, slope, normal = self._known(parameters)
        pieces, scores = {}, []
        for k in range(len(self._shooting.begins)):
            rows = self._shooting.piece == k
            for leg in range(N_LEGS):
                mine = slice(PER_LEG * leg, PER_LEG * (leg + 1))
                w, r = weight[rows, mine].reshape(-1), misfit[rows, mine].reshape(-1)
                J = slopes[rows, mine].reshape(len(r), -1)
                X = states[rows, mine].reshape(len(r), -1)
                off = begins[k, :, mine].reshape(-1)
                inverse = np.linalg.inv((X.T * w) @ X + np.diag(1.0 / self._state_spread**2))
                own = -(X.T @ (w * r)) - off / self._state_spread**2
                coupling = (X.T * w) @ J
                pieces[k, leg] = inverse, coupling, own
                score = -(J.T @ (w * r)) - coupling.T @ (inverse @ own)
                normal += (J.T * w) @ J - coupling.T @ inverse @ coupling
                slope += score
                scores.append(score)
        return normal, slope, pieces, np.array(scores)
