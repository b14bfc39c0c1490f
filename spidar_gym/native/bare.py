"""Bare physics: the CPU time of an engine's robots in MuJoCo alone, for comparison."""

# pyright: reportAttributeAccessIssue=false
# The compiled modules below come without stubs.

import ctypes
from concurrent.futures import ThreadPoolExecutor

import mujoco
import numpy as np

from spidar_gym.native.engine_binding import Engine
from spidar_gym.native.engine_structs import FASTEST
from spidar_gym.native.mujoco import BOXED, FLAT, FREE, OWN, STATE, Simulation
from spidar_gym.sim.scene import TIMESTEP, scene


class BarePhysics:
    """An MjModel and an MjData for each robot of an engine, and nothing else.

    Masses, friction, floor and actuators are each robot's. Contact detection is on where it is on in the engine.
    """

    def __init__(self, engine: Engine, threads: int) -> None:
        """Copy the robots in their present state and distribute them over `threads` threads."""
        plant = self._plants(engine)
        self._substeps = [int(each["config"]["substeps"]) for each in plant]
        ground = plant[0]["config"]["ground"]
        uneven, boxed = bool(ground["tiles"].any()), bool(ground["boxes"].any())
        free = bool(plant[0]["config"]["object"]["shape"])
        model = scene(visual=False, uneven=uneven, boxed=boxed, robot=engine.robot, free=free)
        self._simulations = [Simulation(model) for _ in plant]
        names = next(names for names in (FREE, BOXED, OWN, FLAT) if len(names) == int(engine.record["piece_count"]))
        self._pieces = [simulation.pieces(names).tolist() for simulation in self._simulations]
        self._shares = np.array_split(np.arange(len(plant)), threads)
        self._pool = ThreadPoolExecutor(threads) if threads > 1 else None
        self.take(engine)

    @staticmethod
    def _plants(engine: Engine) -> np.ndarray:
        robots = engine.robots
        return robots["plant"] if "plant" in (robots.dtype.names or ()) else robots

    def take(self, engine: Engine) -> None:
        """Copy the present robots and their states from an engine."""
        flag, plants = int(mujoco.mjtDisableBit.mjDSBL_CONTACT), self._plants(engine)
        for k, (simulation, substeps) in enumerate(zip(self._simulations, self._substeps, strict=True)):
            model, plant, copy = simulation.model, plants[k], engine.copies[min(k, len(engine.copies) - 1)]
            for address, size, at in self._pieces[k]:
                ctypes.memmove(address, copy.ctypes.data + at, size)
            row = plant["row"][: mujoco.mj_stateSize(model, STATE)]
            mujoco.mj_setState(model, simulation.data, row, STATE)
            limit = np.minimum(plant["torque_limit"], plant["config"]["actuators"]["max_joint_torque"])
            joints = slice(len(model.actuator_forcerange) - 2 * len(limit), len(model.actuator_forcerange) - len(limit))
            model.actuator_forcerange[joints, 0], model.actuator_forcerange[joints, 1] = -limit, limit
            far = plant["clearance"] > FASTEST * substeps * TIMESTEP
            model.opt.disableflags = model.opt.disableflags | flag if far else model.opt.disableflags & ~flag

    def step(self, ticks: int) -> None:
        """Advance every simulation by the physics steps of `ticks` control periods."""
        if self._pool is None:
            self._step(self._shares[0], ticks)
            return
        list(self._pool.map(self._step, self._shares, [ticks] * len(self._shares)))

    def _step(self, share: np.ndarray, ticks: int) -> None:
        own = [(s.model, s.data, n) for s, n in ((self._simulations[k], self._substeps[k]) for k in share.tolist())]
        for _ in range(ticks):
            for model, data, substeps in own:
                mujoco.mj_step(model, data, substeps)

    def close(self) -> None:
        """Stop the threads."""
        if self._pool is not None:
            self._pool.shutdown()
