"""Modules and balance from hovers: gain and lag of each module, tilted thrusts, centres of mass, steady and slow force.

The inverse dynamics of the logged motion give the wrench that acted on the robot; the commands, delayed and lagged,
give the wrench of the modules. What is missing between both is compared in two ways: at the frequencies of the swinging
thrusts, where commands are the cause and gusts are small, and in the mean of every steady hover, where all is in
balance. Both are linear in all that is not known exactly, but for the lags, so that the estimate is a linear regression
with what was known before, and its covariance contains what the hovers leave open.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import butter, sosfiltfilt

from spidar_gym.identify.estimate import Estimate, UnfitLogError
from spidar_gym.identify.excitation import excitations_of
from spidar_gym.identify.motion import Dynamics, Motion, motion_of
from spidar_gym.logs.record import Record
from spidar_gym.onboard.runner_structs import Excited, Stage
from spidar_gym.robot import N_JOINTS, N_LINKS, N_ROTORS, ROBOT, RobotSpec
from spidar_gym.sim.config import PlantConfig

RATE = 100.0
"""Rate of the motion [Hz]."""
FIRST_LAG, LEAST_LAG, MOST_LAG = 0.045, 0.005, 0.15
"""First guess of a lag, and its limits [s]."""
SPREAD = {
    "gain": 0.1, "lag": 0.03, "delay": 0.05, "accelerometer": 0.002, "encoder": 0.002, "link_mass": 0.03, "tilt": 0.01,
    "torso_com": 0.01, "link_com": 0.004, "wind": 2.0, "air_force": 2.0, "air_torque": 0.3,
}  # fmt: skip
"""Standard deviations of what is known before [chosen]: gain; lag and delay [s]; delay of the accelerometer's and the
encoders' stamps [s]; factor on the mass of a link; tilt of a thrust, vectoring offset and ducts together [rad]; shift
of a centre of mass [m]; steady horizontal force in world axes, a tilted frame of the motion capture included [N];
steady force [N] and torque [Nm] of the air in a form, torso axes."""
ALIKE = {"gain": 0.05, "lag": 0.07}
"""Standard deviations of gains and lags of modules of one make from their mean, over it [chosen, on robots other than
those of the study hidden]."""
COUNTS = {
    "gain": N_ROTORS, "lag": N_ROTORS, "delay": 1, "accelerometer": 1, "encoder": 1, "link_mass": N_LINKS,
    "tilt": 2 * N_ROTORS, "torso_com": 3, "link_com": 3 * N_LINKS, "wind": 2,
}  # fmt: skip
"""Number of unknowns by name; the steady air follows, six for each form."""
LAG_FLOOR = 0.001
"""Deviation of all lags that time stamps and physics steps leave open [s] [chosen]."""
NUDGE = 1e-3
"""Step of derivatives by lags and delays [s]."""
STEPS, MOST_STEP = 6, 0.02
"""Steps of the regression, and largest step of a lag [s]."""
APART = (3, 5)
"""Distances of the bins whose amplitudes measure the noise from a swing's frequency [bins of the span's length]."""
STILL, TURNING = 0.02, 0.1
"""Largest slow rates of joints and of the heading in a steady hover, in which a slow controller lets the air turn the
robot [rad/s]."""
BLOCK = 3.0
"""Length of the blocks whose means count as independent [s]."""
SLOWEST, FASTEST = 0.05, 1.5
"""Band of the slow force [Hz]."""


@dataclass(frozen=True)
class Hovers:
    """What hovers tell."""

    gain: Estimate
    """Thrust over commanded thrust of each module at the given mass, (8,); a flight tells its ratio to the mass."""
    mean_gain: Estimate
    """Its mean over the modules, ()."""
    lag: Estimate
    """Time constant of each module's thrust, (8,) [s]."""
    mean_lag: Estimate
    """Its mean over the modules, () [s]."""
    tilt: Estimate
    """Tilt of each thrust about the module's x and y axes, vectoring offset and ducts together, (8, 2) [rad]."""
    torso_com: Estimate
    """Shift of the torso's centre of mass, torso axes, (3,) [m]."""
    wind: Estimate
    """Steady horizontal force in world axes, (2,) [N], or m g times the tilt of the motion capture's frame."""
    air: Estimate
    """Steady wrench of the air in each form, torso axes, (forms, 6) [N, Nm]."""
    forms: np.ndarray
    """These forms, (forms, 16) [rad]."""
    hovers: int
    """Number of steady hovers: forms and headings."""
    slow: np.ndarray
    """Standard deviation of the slow force and torque, torso axes, (6,) [N, Nm]."""
    slow_time: np.ndarray
    """Their correlation times, (6,) [s]."""


class _Flight:
    """A flight's missing wrench by what is not known: its values, and its derivatives, at 100 Hz."""

    def __init__(self, record: Record, mass: float, robot: RobotSpec, on_step: Callable[[], object]) -> None:
        self.record, self.motion = record, motion_of(record)
        config = PlantConfig.of(robot)
        config = replace(config, body=replace(config.body, total_mass=mass))
        self.needed, self.module, self.com = Dynamics(config).parts(self.motion)
        on_step()
        columns = []
        for late in ((NUDGE, 0.0), (0.0, NUDGE)):
            columns.append((Dynamics(config).needed(motion_of(record, late)) - self.needed) / NUDGE)
            on_step()
        for link in range(N_LINKS):
            factor = config.body.link_mass + 0.1 * (np.arange(N_LINKS) == link)
            other = replace(config, body=replace(config.body, link_mass=factor))
            columns.append((Dynamics(other).needed(self.motion) - self.needed) / 0.1)
            on_step()
        self.by_model = np.stack(columns, axis=-1)
        """Derivatives of the needed wrench by the delays of accelerometer and encoders and by masses, (n, 6, 10)."""
        self.sent = record["four_axes/command"]

    def missing(self, gain: np.ndarray, lag: np.ndarray, delay: float) -> np.ndarray:
        """Return the needed wrench minus that of the modules, (n, 6)."""
        return self.needed - np.einsum("nwm,nm->nw", self.module[..., 2], gain * self._thrust(lag, delay))

    def columns(self, gain: np.ndarray, lag: np.ndarray, delay: float) -> dict[str, np.ndarray]:
        """Return how the missing wrench changes with each unknown, by name, (n, 6, count) each."""
        thrust = self._thrust(lag, delay)
        # A turn about the module's x axis moves the thrust towards −y, one about its y axis towards x.
        tilt = np.stack([-self.module[..., 1], self.module[..., 0]], axis=-1) * (gain * thrust)[:, None, :, None]
        slower = (self._thrust(lag + NUDGE, delay) - thrust) / NUDGE * gain
        later = (self._thrust(lag, delay + NUDGE) - thrust) / NUDGE * gain
        n = len(thrust)
        wind = np.zeros((n, 6, 2))
        wind[:, :3] = self.motion.R_wb.transpose(0, 2, 1)[..., :2]
        along = self.module[..., 2]
        return {
            "gain": -along * thrust[:, None], "lag": -along * slower[:, None],
            "delay": -np.einsum("nwm,nm->nw", along, later)[..., None], "accelerometer": self.by_model[..., :1],
            "encoder": self.by_model[..., 1:2], "link_mass": self.by_model[..., 2:], "tilt": -tilt.reshape(n, 6, -1),
            "torso_com": -self.com[:, :, 0], "link_com": -self.com[:, :, 1:].reshape(n, 6, -1), "wind": -wind,
        }  # fmt: skip

    def _thrust(self, lag: np.ndarray, delay: float) -> np.ndarray:
        return lagged(self.motion.time, self.sent.received, self.sent.values["base_thrust"], delay, lag)


def fit_hovers(
    record: Record, mass: float, delay: Estimate, robot: RobotSpec = ROBOT, *,
    on_step: Callable[[], object] = lambda: None,
) -> Hovers:  # fmt: skip
    """Estimate what a flight of hovers tells.

    Args:
        record: Log of a flight in which the thrust of every module swings, best in two forms and headings.
        mass: Mass of the robot [kg].
        delay: Delay of the commands [s]; a swing tells the sum of delay and lag.
        robot: The described robot.
        on_step: Called about twenty times, for progress.

    Raises:
        UnfitLogError: For a log in which a module's thrust does not swing, or without a steady hover.
    """
    evidence = _Evidence(record, motion_of(record))
    flight = _Flight(record, mass, robot, on_step)
    unknowns = _Unknowns(delay, len(evidence.forms))
    missing = np.zeros(0)
    for _ in range(STEPS):
        now = unknowns.gain, unknowns.lag, unknowns.late
        missing = flight.missing(*now)
        unknowns.update(*evidence.equations(missing, flight.columns(*now)))
        on_step()
    motion, driven = flight.motion, driven_span(record)
    slow, slow_time = _slow(missing[(motion.time > driven[0]) & (motion.time < driven[1])])
    found = unknowns.estimate
    return Hovers(
        found("gain", (N_ROTORS,)), unknowns.mean("gain"), found("lag", (N_ROTORS,)), unknowns.mean("lag"),
        found("tilt", (N_ROTORS, 2)), found("torso_com", (3,)), found("wind", (2,)),
        found("air", (len(evidence.forms), 6)), np.array(evidence.forms), len(evidence.hovers), slow, slow_time,
    )  # fmt: skip


class _Evidence:
    """What a flight says about the unknowns: linear equations from the swings' amplitudes and the means of hovers."""

    def __init__(self, record: Record, motion: Motion) -> None:
        swings = _swings(record)
        self.hovers = _hovers(motion, driven_span(record))
        self.forms = sorted({form for form, _ in self.hovers})
        self._tones = [_tone(motion.time, span, frequency) for frequency, span in swings]
        self._noise = [
            _tone(motion.time, span, frequency + side * bins / (span[1] - span[0]))
            for frequency, span in swings for bins in range(*APART) for side in (-1.0, 1.0)
        ]  # fmt: skip

    def equations(self, missing: np.ndarray, columns: Mapping[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Return weighted rows, in the order of `COUNTS`, and values, whose difference has a deviation of 1.

        Args:
            missing: Missing wrench (n, 6).
            columns: Its derivative by the unknowns but for the steady air, by name, (n, 6, count) each.
        """
        rows, values = [], []
        own = np.concatenate([columns[name] for name in COUNTS], axis=-1)
        still = np.zeros((6, 6 * len(self.forms)))  # steady air has no amplitude at a swing
        off = np.array([_amplitude(tone, missing) for tone in self._noise])  # (k, 2, 6)
        whiten = np.linalg.cholesky(np.linalg.inv(np.einsum("kci,kcj->ij", off, off) / (2 * len(off)))).T
        for tone in self._tones:
            for amplitudes, off_ in zip(_amplitude(tone, own), _amplitude(tone, missing), strict=True):
                rows.append(whiten @ np.concatenate([amplitudes, still], axis=-1))
                values.append(whiten @ off_)
        for (form, chosen), deviation in zip(self.hovers, _deviations(missing, self.hovers), strict=True):
            air = np.kron(np.eye(len(self.forms))[self.forms.index(form)], -np.eye(6))
            rows.append(np.concatenate([own[chosen].mean(axis=0), air], axis=-1) / deviation[:, None])
            values.append(missing[chosen].mean(axis=0) / deviation)
        return np.concatenate(rows), -np.concatenate(values)


class _Unknowns:
    """The unknowns of a flight: what is known before, and step by step the estimate with its covariance."""

    def __init__(self, delay: Estimate, forms: int) -> None:
        counts = {**COUNTS, "air": 6 * forms}
        ends = np.cumsum(list(counts.values())).tolist()
        self._place = {name: slice(end - own, end) for (name, own), end in zip(counts.items(), ends, strict=True)}
        self._delay, self.late = float(delay.value), float(delay.value)
        self.gain, self.lag = np.ones(N_ROTORS), np.full(N_ROTORS, FIRST_LAG)
        self._before = np.concatenate([np.full(own, SPREAD.get(name, 0.0)) for name, own in counts.items()])
        self._before[self._place["delay"]] = max(float(delay.deviation), 1e-5)
        self._before[self._place["air"]] = np.tile(np.repeat([SPREAD["air_force"], SPREAD["air_torque"]], 3), forms)
        self._value, self._covariance = np.zeros(ends[-1]), np.diag(self._before**2)

    def update(self, rows: np.ndarray, values: np.ndarray) -> None:
        """Take a step by equations at the present gains, lags and delay."""
        place, first = self._place, np.zeros(len(self._before))
        first[place["gain"]], first[place["lag"]] = 1.0 - self.gain, FIRST_LAG - self.lag
        first[place["delay"]] = self._delay - self.late
        normal, slope = rows.T @ rows + np.diag(1.0 / self._before**2), rows.T @ values + first / self._before**2
        for name, own in (("gain", self.gain), ("lag", self.lag)):
            apart = (np.eye(N_ROTORS) - 1.0 / N_ROTORS) / (ALIKE[name] * own.mean())
            normal[place[name], place[name]] += apart.T @ apart
            slope[place[name]] -= apart.T @ (apart @ own)
        self._value = value = np.linalg.solve(normal, slope)
        self._covariance = np.linalg.inv(normal)
        self._covariance[place["lag"], place["lag"]] += LAG_FLOOR**2
        self.gain = self.gain + value[place["gain"]]
        self.lag = np.clip(self.lag + np.clip(value[place["lag"]], -MOST_STEP, MOST_STEP), LEAST_LAG, MOST_LAG)
        self.late += float(value[place["delay"]][0])

    def estimate(self, name: str, shape: tuple[int, ...]) -> Estimate:
        """Return the estimate of an unknown."""
        own = self._place[name]
        value = {"gain": self.gain, "lag": self.lag}.get(name, self._value[own])
        deviation = np.sqrt(np.diag(self._covariance))[own]
        return Estimate(value.reshape(shape), deviation.reshape(shape), self._before[own].reshape(shape))

    def mean(self, name: str) -> Estimate:
        """Return the estimate of an unknown's mean."""
        own, each = self._place[name], self.estimate(name, (-1,))
        deviation = np.sqrt(self._covariance[own, own].mean())
        return Estimate(np.array(each.value.mean()), np.array(deviation), np.array(each.known.mean()))


def require_hovers(record: Record) -> None:
    """Require a log that `fit_hovers` takes (`UnfitLogError` for another one)."""
    _swings(record)
    _hovers(motion_of(record), driven_span(record))


def _swings(record: Record) -> list[tuple[float, tuple[float, float]]]:
    """Return frequency [Hz] and time span [s] of the swings of thrusts in a log's mission."""
    given = [each for each in excitations_of(record) if each.excited == Excited.THRUST]
    start, end = driven_span(record)
    swings = [each for each in given if each.frequency == each.last_frequency and start + each.end <= end + 1.0]
    if missing := sorted({*range(N_ROTORS)} - {each.index for each in swings}):
        raise UnfitLogError(f"swinging thrust of module {missing[0] + 1}", "the log of the test thrust, not aborted")
    return [(each.frequency, (start + each.start, start + each.end)) for each in swings]


def driven_span(record: Record) -> tuple[float, float]:
    """Return first and last time at which the runner drove and nothing was aborted [s]."""
    status = record["runner/status"]
    drives = status.received[(status.values["stage"] == Stage.DRIVING) & (status.values["aborted"] == 0)]
    if not len(drives):
        raise UnfitLogError("time in which the runner drives", "the log of a mission")
    return float(drives[0]), float(drives[-1])


def _tone(time: np.ndarray, span: tuple[float, float], frequency: float) -> np.ndarray:
    """Return weights whose products with samples are cosine and sine amplitude at a frequency in a span, (2, n)."""
    place = (time - span[0]) / (span[1] - span[0])
    window = np.where((place >= 0.0) & (place <= 1.0), np.sin(np.pi * place) ** 2, 0.0)
    angle = 2.0 * np.pi * frequency * (time - span[0])
    return np.stack([np.cos(angle), np.sin(angle)]) * (2.0 * window / window.sum())


def _amplitude(tone: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the amplitudes of values (n, …) at a tone, (2, …)."""
    return np.tensordot(tone, values, axes=1)


def _hovers(motion: Motion, driven: tuple[float, float]) -> list[tuple[tuple[float, ...], np.ndarray]]:
    """Return form [rad] and samples of each steady hover: legs and heading do not move."""
    sos = butter(2, 0.3, fs=RATE, output="sos")
    slow = sosfiltfilt(sos, np.column_stack([motion.rate[:, :N_JOINTS], motion.omega_b[:, 2]]), axis=0)
    still = (abs(slow[:, :-1]) < STILL).all(axis=1) & (abs(slow[:, -1]) < TURNING)
    still &= (motion.time > driven[0]) & (motion.time < driven[1])
    edges = np.flatnonzero(np.diff(np.concatenate([[False], still, [False]]).astype(int)))
    found = []
    for first, last in edges.reshape(-1, 2):
        if last - first >= 2.0 * BLOCK * RATE:
            chosen = np.arange(first, last)
            form = np.round(np.median(motion.angle[chosen, :N_JOINTS], axis=0), 1) + 0.0
            found.append((tuple(form.tolist()), chosen))
    if not found:
        raise UnfitLogError(f"steady hover of {2.0 * BLOCK:g} s", "the log of the test thrust or forms")
    return found


def _deviations(missing: np.ndarray, hovers: Sequence[tuple[tuple[float, ...], np.ndarray]]) -> list[np.ndarray]:
    """Return the standard deviation of the mean missing wrench of each hover, (6,) each, from the blocks of all."""
    counts, scatter = [], np.zeros(6)
    for _, chosen in hovers:
        means = np.array(
            [missing[own].mean(axis=0) for own in np.array_split(chosen, int(len(chosen) / RATE // BLOCK))]
        )
        counts.append(len(means))
        scatter += ((means - means.mean(axis=0)) ** 2).sum(axis=0)
    scatter /= sum(counts) - len(counts)
    return [np.sqrt(scatter / count) for count in counts]


def _slow(missing: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return standard deviations and correlation times [s] of the slow part of a missing wrench, (6,) each."""
    sos = butter(2, (SLOWEST, FASTEST), btype="bandpass", fs=RATE, output="sos")
    slow, times = sosfiltfilt(sos, missing - missing.mean(axis=0), axis=0), []
    for own in slow.T:
        power = np.fft.irfft(abs(np.fft.rfft(own, 4 * len(own))) ** 2)[: len(own)]
        times.append(np.argmax(power < power[0] / np.e) / RATE)
    return slow.std(axis=0), np.array(times)


def lagged(time: np.ndarray, sent: np.ndarray, values: np.ndarray, delay: float, lag: np.ndarray) -> np.ndarray:
    """Return held commands after a delay and a first-order lag at given times: the exact response.

    Args:
        time: Times (n,) [s].
        sent: Times of the commands (m,) [s].
        values: Commands (m, 8).
        delay: Delay [s].
        lag: Time constant of each column (8,) [s].
    """
    come = sent + delay
    state = np.empty_like(values)
    state[0] = values[0]
    decay = np.exp(-np.diff(come)[:, None] / lag)
    for k in range(len(come) - 1):
        state[k + 1] = values[k] + (state[k] - values[k]) * decay[k]
    at = np.clip(np.searchsorted(come, time, side="right") - 1, 0, len(come) - 1)
    since = np.maximum(time - come[at], 0.0)[:, None]
    return values[at] + (state[at] - values[at]) * np.exp(-since / lag)
