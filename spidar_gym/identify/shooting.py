"""Pieces of a bench test: simulated with the logged commands from measured states, and compared with the encoders."""

# pyright: reportAttributeAccessIssue=false
# MuJoCo comes without stubs.

import copy
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from mujoco import rollout

from spidar_gym.identify.estimate import UnfitLogError
from spidar_gym.identify.smooth import smoothed
from spidar_gym.logs.record import Record
from spidar_gym.native.plant import Plant
from spidar_gym.onboard.runner_structs import Stage
from spidar_gym.robot import GIMBAL_NAMES, JOINT_NAMES, N_JOINTS, N_LINKS, N_ROTORS, RobotSpec
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.scene import TIMESTEP
from spidar_gym.sim.sensors import ENCODER_STEPS

STAND = (0.0, 0.0, 1.5)
"""Origin of the torso on the stand of the model [m]; its height has no effect."""
KNOTS = 0.05
"""Distance of the knots of the splines that smooth encoders [s]."""
NOISE = 0.58
"""Deviation of an encoder's error: half a count of noise, and rounding [counts]."""
DRAWS = 8
"""Number of samples of the jitter over which setpoints are averaged."""
KNOWN = 30
"""Number of setpoints that are kept."""
FREE = 1e3
"""Speed of setpoints that are not limited [rad/s]."""
SETTLING = 800
"""Steps in which the stand yields to the weight."""


@dataclass(frozen=True)
class Parameter:
    """A parameter of each joint or link."""

    name: str
    """Name."""
    count: int
    """Number of joints or links."""
    first: float
    """First guess, which is what is known before."""
    spread: float
    """Standard deviation of what is known before [chosen]."""
    least: float
    """Least value."""
    nudge: float
    """Step of the derivative."""
    share: float = 0.0
    """Step of the derivative over the value, where this is more."""
    most: float = math.inf
    """Largest value: of the jitter half a period of the commands, beyond which fits go astray on the way."""

    def step(self, own: np.ndarray) -> np.ndarray:
        """Return the steps of the derivatives at these values, (count,)."""
        more = abs(self.nudge) < self.share * own
        return np.where(more, self.share * own, self.nudge)


PARAMETERS = (
    Parameter("delay", 1, 0.03, 0.05, 0.0, TIMESTEP),
    Parameter("jitter", 1, 0.005, 0.003, 0.0, 0.002, most=0.0125),
    Parameter("damping", N_JOINTS, 2.0, 20.0, 0.02, 0.05, 0.05),
    Parameter("friction", N_JOINTS, 0.15, 1.0, 0.0, 0.03, 0.1),
    Parameter("stiffness", N_JOINTS, 175.0, 100.0, 30.0, 3.0),
    Parameter("speed", N_JOINTS, 0.2, 0.02, 0.02, -0.0008),  # faster than commands move has no effect
    Parameter("bias", N_JOINTS, 0.0, 0.03, -0.3, 0.001),
    Parameter("link_mass", N_LINKS, 1.0, 0.03, 0.5, 0.03),
    Parameter("link_com_x", N_LINKS, 0.0, 0.004, -0.1, 0.01),
    Parameter("link_com_z", N_LINKS, 0.0, 0.004, -0.1, 0.01),
)
"""Parameters in the order of the vector: least delay of the commands, and the largest delay beyond it [s]; damping of
servo and joint [Nm s/rad], dry friction [Nm], stiffness [Nm/rad], largest speed of the setpoint [rad/s] and error of
the encoder [rad] of each joint; factor on mass and inertia of each link with its junction and module, and shift of its
centre of mass along x and z [m]."""


def split(parameters: np.ndarray) -> dict[str, np.ndarray]:
    """Return the parameters by name, from the vector."""
    ends = np.cumsum([each.count for each in PARAMETERS])
    return {each.name: parameters[end - each.count : end] for each, end in zip(PARAMETERS, ends, strict=True)}


def joined(values: Mapping[str, np.ndarray | float]) -> np.ndarray:
    """Return the vector of parameters, from values by name; others are first guesses."""
    return np.concatenate([np.broadcast_to(values.get(each.name, each.first), each.count) for each in PARAMETERS])


@dataclass(frozen=True)
class Bench:
    """A bench test: what was commanded, and what the encoders indicated."""

    command_time: np.ndarray
    """Times of the commands, (m,) [s]."""
    command: np.ndarray
    """Commanded joint angles, (m, 16) [rad]."""
    time: np.ndarray
    """Times of the encoders' samples, (n,) [s]."""
    angle: np.ndarray
    """Indicated angles of joints and gimbals, (n, 32) [rad]."""


def bench_of(record: Record) -> Bench:
    """Return the bench test of a log (`UnfitLogError` if it has none)."""
    valid = "the log of the test bench, `spidar sitl tests` or `runner … missions/bench.txt --log`"
    for topic in ("joint_states", "joints_ctrl", "runner/status"):
        if topic not in record:
            raise UnfitLogError(topic, valid)
    status, sent, seen = record["runner/status"], record["joints_ctrl"], record["joint_states"]
    drives = status.received[(status.values["stage"] == Stage.DRIVING) & (status.values["aborted"] == 0)]
    if len(drives) < 2:
        raise UnfitLogError("time in which the runner drives", valid)
    mine = (sent.received >= drives[0]) & (sent.received <= drives[-1])
    at = (seen.time >= drives[0] - 1.0) & (seen.time <= drives[-1] + 0.2)
    return Bench(
        sent.received[mine], in_order(sent.names, sent.values["position"][mine], JOINT_NAMES), seen.time[at],
        in_order(seen.names, seen.values["position"][at], (*JOINT_NAMES, *GIMBAL_NAMES)),
    )  # fmt: skip


def in_order(names: Sequence[str], values: np.ndarray, wanted: Sequence[str]) -> np.ndarray:
    """Return the columns of named entries in another order (`UnfitLogError` if one is absent)."""
    if absent := [name for name in wanted if name not in names]:
        raise UnfitLogError(f"angle of {absent[0]}", "messages of 16 joints and 16 gimbals")
    return values[:, [list(names).index(name) for name in wanted]]


class Shooting:
    """Simulated pieces of a bench test, and their differences from the encoders."""

    def __init__(
        self, bench: Bench, mass: float, robot: RobotSpec, begins: np.ndarray, seconds: float, threads: int
    ) -> None:
        """Prepare the simulation.

        Args:
            bench: The bench test.
            mass: Mass of the robot [kg]; masses and inertias of the description are scaled to it.
            robot: The described robot.
            begins: Begins of the pieces (k,) [s].
            seconds: Length of each [s].
            threads: Threads that simulate.
        """
        self.bench, self.begins = bench, begins
        config = PlantConfig.of(robot)
        plant = Plant(replace(config, body=replace(config.body, total_mass=mass)))
        self._plant, self._model, self._data = plant, plant.model, plant.data
        model, data = plant.model, plant.data
        plant.clamp(np.array(STAND))
        plant.reset(np.array(STAND), joint_position=bench.command[0])
        self._servos = slice(N_ROTORS, N_ROTORS + N_JOINTS)
        data.ctrl[self._servos] = bench.command[0]
        for _ in range(SETTLING):
            mujoco.mj_step(model, data)
        self._rest = data.qpos[:7].copy()
        actuated = model.actuator_trnid[N_ROTORS : N_ROTORS + N_JOINTS + 2 * N_ROTORS, 0]
        self._qpos, self._dof = model.jnt_qposadr[actuated], model.jnt_dofadr[actuated]
        self._links = [_bodies_of(model, link + 1) for link in range(N_LINKS)]
        self._threads = [mujoco.MjData(model) for _ in range(threads)]
        self._smooth = smoothed(bench.time, bench.angle, KNOTS)
        self._rate = self._smooth.derivative()
        self._length = round(seconds / TIMESTEP)
        rng = np.random.Generator(np.random.PCG64(0))
        strata = rng.permuted(np.tile(np.arange(DRAWS), (len(bench.command_time), 1)), axis=1)
        self._shares = ((strata + rng.random(strata.shape)) / DRAWS).T
        """Samples of the jitter over its largest, stratified for each command, (draws, m). All differ: the steps of
        physics to which they are rounded would else change for many commands at once, and the cost would jump."""
        self._known: dict[tuple[int, float, bytes, bytes], np.ndarray] = {}
        self._samples = [np.flatnonzero((bench.time > b + 0.004) & (bench.time <= b + seconds)) for b in begins]
        self.piece = np.concatenate([np.full(len(own), k) for k, own in enumerate(self._samples)])
        """Piece of each compared sample, (n,)."""
        self.sample_time = bench.time[np.concatenate(self._samples)]
        """Times of the compared samples, (n,) [s]."""
        self.seen = bench.angle[np.concatenate(self._samples), :N_JOINTS]
        """Indicated angles of the compared samples, (n, 16) [rad]."""
        self.lost = np.zeros(len(bench.command_time), bool)
        """Which commands did not arrive, (m,)."""
        self.weight = 1.0 / (NOISE * ENCODER_STEPS[:N_JOINTS])
        """Inverse of the deviation of each encoder's error, (16,) [1/rad]."""

    def misfits(
        self, jobs: Sequence[tuple[np.ndarray, np.ndarray]], lost: Sequence[np.ndarray] | None = None
    ) -> list[np.ndarray]:  # fmt: skip
        """Return weighted differences from the encoders, (n, 16) each.

        Args:
            jobs: Vectors of parameters, and deviations (k, 2, 16) of angles [rad] and rates [rad/s] at the begins.
            lost: For each job, which commands did not arrive, (m,); `lost` of this object if None.
        """
        models, controls, starts = [], [], []
        for (parameters, begins), missed in zip(jobs, lost or [self.lost] * len(jobs), strict=True):
            model, setpoint, late = self._with(parameters), self._setpoints(parameters, missed), _part(parameters)
            for k, begin in enumerate(self.begins):
                step = round((begin - self.bench.command_time[0]) / TIMESTEP)
                models.append(model)
                control = np.zeros((self._length, self._model.nu))
                # A setpoint of a step is that of the actuator after it.
                control[:, self._servos] = setpoint[step + 1 : step + 1 + self._length]
                controls.append(control)
                starts.append(self._start(begin + late, begins[k], setpoint[step]))
        states = np.asarray(rollout.rollout(models, self._threads, np.array(starts), np.array(controls))[0])
        angles = states[:, :, 1 + self._qpos[:N_JOINTS]].reshape(len(jobs), len(self.begins), -1, N_JOINTS)
        return [self._against(own, parameters) for own, (parameters, _) in zip(angles, jobs, strict=True)]

    def _with(self, parameters: np.ndarray) -> mujoco.MjModel:
        """Return the model with other parameters."""
        found, model = split(parameters), copy.deepcopy(self._model)
        model.actuator_dynprm[self._servos, 1] = FREE  # the controls are the setpoints
        model.actuator_biasprm[self._servos, 1:3] = -np.stack([found["stiffness"], found["damping"]], axis=1)
        own = self._dof[:N_JOINTS]
        model.dof_damping[own], model.dof_frictionloss[own] = 0.0, found["friction"]
        for link, bodies in enumerate(self._links):
            model.body_mass[bodies] *= found["link_mass"][link]
            model.body_inertia[bodies] *= found["link_mass"][link]
            model.body_ipos[bodies[1], 0] += found["link_com_x"][link]
            model.body_ipos[bodies[1], 2] += found["link_com_z"][link]
        return model

    def _setpoints(self, parameters: np.ndarray, lost: np.ndarray) -> np.ndarray:
        """Return the servos' setpoints at every physics step, the mean over the jitter, (n, 16) [rad].

        A setpoint follows its command at a limited speed. Jitter does not just delay it: at a reversal that command
        counts which first lies on the other side. The delay is in whole steps; the rest of it shifts pieces in time.
        """
        found = split(parameters)
        delay, jitter, speed = round(found["delay"][0] / TIMESTEP), found["jitter"][0], found["speed"]
        key = (delay, jitter, speed.tobytes(), lost.tobytes())
        if key not in self._known:
            times = self.bench.command_time
            last = np.maximum.accumulate(np.where(lost, 0, np.arange(len(times))))  # the command that is in force
            steps = round((max(times[-1], self.begins[-1]) - times[0]) / TIMESTEP) + self._length + 1
            ticks = np.arange(steps)
            sent = np.rint((times - times[0]) / TIMESTEP).astype(int) + delay
            come = sent + np.rint(self._shares * jitter / TIMESTEP).astype(int)  # (draws, m)
            place = np.stack([np.searchsorted(own, ticks, side="right") - 1 for own in come])
            wanted = self.bench.command[last][np.maximum(place, 0)]  # (draws, n, 16)
            setpoint, present, way = np.empty((steps, N_JOINTS)), wanted[:, 0], speed * TIMESTEP
            for k in range(steps):
                setpoint[k] = present.mean(axis=0)
                present = present + np.clip(wanted[:, k] - present, -way, way)
            if len(self._known) > KNOWN:
                self._known.clear()
            self._known[key] = setpoint
        return self._known[key]

    def _start(self, time: float, off: np.ndarray, setpoint: np.ndarray) -> np.ndarray:
        """Return MuJoCo's state at the begin of a piece."""
        data, kind = self._data, mujoco.mjtState.mjSTATE_FULLPHYSICS
        data.time, data.qpos[:7], data.qvel[:], data.act[:] = 0.0, self._rest, 0.0, 0.0
        data.qpos[self._qpos], data.qvel[self._dof] = self._smooth(time), self._rate(time)
        data.qpos[self._qpos[:N_JOINTS]] += off[0]
        data.qvel[self._dof[:N_JOINTS]] += off[1]
        data.act[self._servos] = setpoint
        state = np.zeros(mujoco.mj_stateSize(self._model, kind))
        mujoco.mj_getState(self._model, data, state, kind)
        return state

    def _against(self, angles: np.ndarray, parameters: np.ndarray) -> np.ndarray:
        """Return the weighted differences of simulated angles (pieces, steps, 16) from the encoders."""
        found = []
        for begin, own, simulated in zip(self.begins + _part(parameters), self._samples, angles, strict=True):
            place = (self.bench.time[own] - begin) / TIMESTEP - 1.0
            k = np.clip(np.floor(place).astype(int), 0, self._length - 2)
            share = (place - k)[:, None]
            found.append((1.0 - share) * simulated[k] + share * simulated[k + 1])
        return (np.concatenate(found) + split(parameters)["bias"] - self.seen) * self.weight


def _bodies_of(model: mujoco.MjModel, link: int) -> list[int]:
    """Return the bodies of a link, 1 … 8: junction, link, and the two of its module."""
    names = (f"junction{link}", f"link{link}", f"gimbal{link}_roll_module", f"gimbal{link}_pitch_module")
    return [model.body(name).id for name in names]


def _part(parameters: np.ndarray) -> float:
    """Return the delay beyond whole physics steps [s]."""
    return float(parameters[0] - TIMESTEP * round(parameters[0] / TIMESTEP))
