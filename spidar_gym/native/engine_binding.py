"""Many robots in the library on MuJoCo's threads: their memory, and jobs on them."""

# pyright: reportAttributeAccessIssue=false
# The compiled modules below come without stubs.

import time
from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np

from spidar_gym import turn
from spidar_gym.errors import InvalidValueError, closed, require_least
from spidar_gym.native.engine_structs import MAX_PENDING, engine_layouts
from spidar_gym.native.library import Room, load_core, pointer, require_version, version, write
from spidar_gym.native.mujoco import BOXED, FLAT, FREE, OWN, Pool, Simulation, world
from spidar_gym.native.structs import USUAL, fill
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.scene import TIMESTEP, scene

MAX_THREADS = 256
"""Largest number of threads of an engine."""
_POINTERS = (
    "world", "apply", "batch", "threads", "first", "copies", "stride", "copy_bytes", "thread_count", "piece_count",
    "own_copies", "job", "argument", "rules", "goals", "knots", "actions", "observations", "begun", "infos",
    "quantities", "observation_size", "goal_room", "knot_room", "rules_bytes",
)  # fmt: skip
"""Members of `sp_engine`, eight bytes each."""


class Engine:
    """Robots of one kind of simulation, and the threads that simulate them.

    A robot is a record of `robots`, plain data. Where robots differ in masses or floors, its entry of `copies` holds
    its part of MuJoCo's model. These bytes are its complete state.
    """

    def __init__(
        self, struct: str, config: PlantConfig, robots: int, threads: int, *, alike: bool, floors: bool = False,
        models: Sequence[Any] | None = None,
    ) -> None:  # fmt: skip
        """Make the robots, all of one configuration.

        Args:
            struct: Struct of a robot: `plant`, or a struct that begins with one.
            config: Configuration of the simulated robots.
            robots: Number of robots.
            threads: Number of threads, the caller's included.
            alike: Whether all robots keep this configuration; else each has its own part of MuJoCo's model.
            floors: Whether robots may have different floor planes; tiles and boxes may always differ.
            models: MuJoCo's models, one for each thread; by default those of the described robot.

        Raises:
            InvalidValueError: For fewer than 1 robot or thread, too many threads, or a delay that is too long.
            SpidarError: Where MuJoCo cannot make a thread pool.
        """
        require_least(1, robots=robots, threads=threads)
        if threads > MAX_THREADS:
            raise InvalidValueError("threads", threads, f"a whole number within 1 … {MAX_THREADS}")
        check_delay(config)
        self.library = load_core()
        self._made = struct, config, robots, threads, alike, floors
        layouts, uneven, boxed, free = engine_layouts(), config.ground.uneven, config.ground.boxed, config.object.exists
        robot = config.robot
        models = models or [scene(visual=False, uneven=uneven, boxed=boxed, robot=robot, free=free)] * threads
        self.simulations = [Simulation(model) for model in models]
        if uneven or boxed or free:  # the bounding volumes in the model are those of the original tiles, boxes, object
            for simulation in self.simulations:
                simulation.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_MIDPHASE)
        self.rooms = [Room(self.library, robot) for _ in range(threads)]
        self.robots = np.zeros(robots, layouts[struct])
        names = FREE if free else BOXED if boxed else OWN if uneven or floors else FLAT
        pieces = [simulation.pieces(names) for simulation in self.simulations]
        _, size, offset = pieces[0][-1].tolist()
        self.copies = np.zeros((1 if alike else robots, offset + -(-size // 8) * 8), np.uint8)
        width = len(self.simulations[0].record)
        self._threads = np.zeros((threads, width + 5), np.uint64)
        for row, simulation, room, piece in zip(self._threads, self.simulations, self.rooms, pieces, strict=True):
            row[:width] = simulation.record
            row[width : width + 2] = room.record.ctypes.data, piece.ctypes.data
        self._names = names
        self.robot, self._pieces, self._world = robot, pieces, world(uneven, boxed, robot, free)
        self.turn = turn.Turn()
        """Serialises calls into the library, closing, and changes of the arrays that `record` points to."""
        self._pool = Pool(robots, threads)
        self.record = np.zeros((), np.dtype([(name, np.uint64) for name in _POINTERS]))
        """`sp_engine`."""
        self.address = pointer(self.record)
        """Pointer to `record`."""
        self._kept: dict[str, np.ndarray] = {}
        self.seconds = 0.0
        """Wall time of all jobs so far [s]."""
        self.share("world", self._world)
        self.share("threads", self._threads)
        self.share("first", self.robots)
        self.share("copies", self.copies)
        numbers = {
            "stride": self.robots.itemsize,
            "copy_bytes": self.copies.shape[1], "thread_count": threads, "piece_count": len(names),
            "own_copies": not alike,
        }  # fmt: skip
        for name, number in numbers.items():
            self.record[name] = number
        self._use_pool()
        configs = np.zeros(robots, layouts["plant_config"])
        fill(configs[0], config)
        configs[1:] = configs[0]
        self.configure(configs, np.zeros(1, np.int32) if alike else None)
        if alike and struct != "plant":
            self.robots["plant"][1:] = self.robots["plant"][0]
        elif alike:
            self.robots[1:] = self.robots[0]

    def _use_pool(self) -> None:
        """Register the pool, whose threads have not run yet, in the library's records."""
        self.record["apply"], self.record["batch"] = self._pool.apply, self._pool.address
        self._threads[:, -3:] = 0  # seat, busy, carries of `sp_thread`

    def _open(self) -> None:
        """Raise if the threads are stopped; make a new pool in a forked process."""
        if not self._pool.address:
            raise closed()
        if self._pool.process != turn.process:
            self._pool = Pool(len(self.robots), len(self.rooms))
            self._use_pool()

    def __getstate__(self) -> dict[str, Any]:
        """Return the state of a copy, without addresses (`SpidarError` where the threads are stopped)."""
        with self.turn.lock:
            self._open()
            models = [simulation.model for simulation in self.simulations]  # their gravity may have been changed
            robots, copies = self.robots.tobytes(), self.copies.tobytes()
        return {"version": version(), "made": self._made, "models": models, "robots": robots, "copies": copies}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a copy with its own memory (`SpidarError` for a state of another version)."""
        require_version("copied robots", state["version"])
        struct, config, robots, threads, alike, floors = state["made"]
        self.__init__(struct, config, robots, threads, alike=alike, floors=floors, models=state["models"])
        write(self.robots, state["robots"])
        write(self.copies, state["copies"])
        self.forget_copies()

    def configure(self, configs: np.ndarray, ids: np.ndarray | None = None, *, goes_on: bool = False) -> None:
        """Apply configurations to robots.

        Args:
            configs: Records of `sp_plant_config`, one for every robot.
            ids: Robots that are configured; all if not given.
            goes_on: Whether their episodes continue with the new configuration.
        """
        with self.turn.lock:
            self.forget_copies()
            self.run("sp_change_plants" if goes_on else "sp_configure_plants", ids, configs)

    def fault_of_copies(self, copies: np.ndarray) -> str:
        """Describe the first array in parts of MuJoCo's model with invalid numbers; return "" if all are valid.

        Args:
            copies: Array like `copies`, of any number of robots.
        """
        model = self.simulations[0].model
        highest = {
            "geom_sameframe": len(mujoco.mjtSameFrame.__members__) - 1,
            "body_sameframe": len(mujoco.mjtSameFrame.__members__) - 1,
            "geom_type": max(int(mujoco.mjtGeom.mjGEOM_BOX), int(mujoco.mjtGeom.mjGEOM_CYLINDER)),
            "body_geomnum": np.bincount(model.geom_bodyid, minlength=model.nbody),
        }
        for name, (_, size, at) in zip(self._names, self._pieces[0].tolist(), strict=True):
            values = copies[:, at : at + size].view(getattr(model, name).dtype)
            if name in highest:
                least, most = 0, highest[name]
            else:
                least, most = -USUAL[1], USUAL[1]
            if not ((values >= least) & (values <= most)).all():
                return f"{name} of MuJoCo's model, expected numbers from {least:g} to {np.max(most):g}"
        return ""

    def write_copy(self, robot: int, name: str, values: np.ndarray) -> None:
        """Write an array of a robot's part of MuJoCo's model."""
        _, size, at = self._pieces[0][self._names.index(name)].tolist()
        self.copies[robot, at : at + size] = np.ascontiguousarray(values).view(np.uint8).reshape(-1)
        self.forget_copies()

    def forget_copies(self) -> None:
        """Mark the models of all threads as outdated; required after `copies` was written."""
        with self.turn.lock:
            self._threads[:, -1] = 0

    def share(self, name: str, array: np.ndarray) -> None:
        """Set a pointer member of `sp_engine` to an array, and keep the array alive."""
        with self.turn.lock:
            self._kept[name] = array
            self.record[name] = array.ctypes.data

    def run(
        self,
        job: str,
        ids: np.ndarray | None = None,
        argument: np.ndarray | None = None,
        *,
        at_once: int | None = None,
    ) -> Sequence[int]:
        """Run a job of the library.

        Args:
            job: Name of its function.
            ids: Robots in rising order; all if not given.
            argument: Array argument of the function, one entry per robot.
            at_once: Number of robots per thread between two checks for Ctrl-C. After an interrupt the remaining robots
                are unchanged. If not given, Ctrl-C is handled after the whole job.

        Returns:
            Robots for which MuJoCo failed; their job is not done, or only in part.

        Raises:
            SpidarError: Where the threads are stopped.
        """
        with self.turn.lock:
            self._open()
            chosen = None if ids is None else np.ascontiguousarray(ids, np.int32)
            count = len(self.robots) if chosen is None else len(chosen)
            if at_once is not None and count > (most := at_once * len(self.rooms)):
                each = np.arange(count, dtype=np.int32) if chosen is None else chosen
                parts = np.split(each, range(most, count, most))
                return [robot for part in parts for robot in self.run(job, part, argument)]
            arguments = [] if argument is None else [pointer(argument)]
            where = None if chosen is None else pointer(chosen)
            began = time.perf_counter()
            failures = getattr(self.library, job)(self.address, where, count, *arguments)
            self.seconds += time.perf_counter() - began
            if not failures:
                return ()
            failed = self._pool.failed
            return (failed if chosen is None else np.intersect1d(failed, chosen)).tolist()

    def call(self, function: str, *arguments: Any) -> None:  # noqa: ANN401 - of ctypes
        """Call a function of the library on the calling thread.

        Args:
            function: Name of the function.
            arguments: Its arguments.

        Raises:
            SpidarError: Where the threads are stopped.
        """
        with self.turn.lock:
            self._open()
            getattr(self.library, function)(*arguments)

    def words(self, robot: int) -> str:
        """Return MuJoCo's error message for a robot, in one line."""
        with self.turn.lock:
            self._open()
            return " ".join(self._pool.words(robot).split())

    def close(self) -> None:
        """Stop the threads after their present job; a second call has no effect."""
        with self.turn.lock:
            self._pool.close()


def check_delay(config: PlantConfig, sampled: Mapping[str, float] | None = None) -> None:
    """Raise `InvalidValueError` for a delay with more pending commands than `MAX_PENDING` allows.

    Args:
        config: Configuration of the simulated robot.
        sampled: Largest sampled values by field of `PlantConfig`, which replace the configured ones.
    """
    own = {f"actuators.{name}": getattr(config.actuators, name) for name in ("delay", "vectoring_delay", "jitter")}
    largest = own | dict(sampled or {})
    delays = [float(largest[name]) for name in own]
    most = (MAX_PENDING - 2) * config.substeps
    if not sum(np.rint(delay / TIMESTEP) for delay in delays) <= most:
        raise InvalidValueError(
            "delay", sum(delays), f"with the vectoring servos' and the jitter at most {most * TIMESTEP:g} s"
        )
