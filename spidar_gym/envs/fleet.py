"""Fleet: one robot or thousands of an environment, simulated by the engine and evaluated by their task."""

import logging
import math
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from typing import Any

import numpy as np

from spidar_gym.control.course.gates import Course
from spidar_gym.control.grasp.scene import GraspScene
from spidar_gym.envs.locking import whole
from spidar_gym.errors import REAL, InvalidValueError, SpidarError, require_array, require_keys
from spidar_gym.native.course_records import write_course
from spidar_gym.native.draws import from_numpy, to_numpy
from spidar_gym.native.engine_binding import Engine
from spidar_gym.native.engine_structs import AUTORESETS, SEQUENCES, engine_layouts
from spidar_gym.native.grasp_records import write_scene
from spidar_gym.native.library import write
from spidar_gym.native.structs import WORDS, fill
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.disturbances import Disturbances
from spidar_gym.tasks.start import FlightStart, FormGoal
from spidar_gym.tasks.task import Task, checked_array, require_finite, square

_LOG = logging.getLogger("spidar_gym.mujoco")
_SHARED = ("rules", "actions", "observations", "begun", "infos", "quantities", "goals", "knots")
"""Arrays in memory shared with the engine."""
_SHOWN = ("rewards", "terminated", "truncated", "final_observations", "final_infos", "terms", "final_terms")
"""Arrays that Python writes."""
_CLIENTS = ("actions", "observations", "final_observations", "rewards", "terminated", "truncated", "begun", "infos",
            "final_infos", "terms", "final_terms")  # fmt: skip
"""Arrays to which clients hold references."""
_AT_ONCE, _SETTLING_AT_ONCE = 256, 4
"""Robots that a thread resets between checks for Ctrl-C; on tiles a robot takes up to 70 ms to settle."""
_MODES = len(WORDS["reference", "mode"])
UNIT = 1e-3
"""Tolerance of a quaternion's squared length."""


class Fleet:
    """Robots of one environment and their task.

    The arrays have an entry for every robot. Each tick overwrites them: copy what is to be kept.
    """

    commander: Any = None
    """Python controller of the only robot; None if the core controls."""

    def __init__(
        self, task: Task[Any], rules: np.ndarray, plant: PlantConfig, robots: int, threads: int, *,
        alike: bool, floors: bool = False, goals: int = 0, knots: int = 0,
    ) -> None:  # fmt: skip
        """Make the robots.

        Args:
            task: Task of the robots.
            rules: `sp_hover_rules`, `sp_crawl_rules` or `sp_course_rules`, one for all or one for every robot; with one
                each, all floors are of the same kind.
            plant: The nominal simulated robot.
            robots: Number of robots.
            threads: Number of threads, the caller's included.
            alike: Whether neither robots nor floors are randomised.
            floors: Whether robots may have different floor planes although they have the same rules.
            goals: Largest number of forms of an episode.
            knots: Largest number of knots of an episode's path.
        """
        engine = Engine(
            f"{task.robots.kind}_robot", plant, robots, threads, alike=alike, floors=floors or rules.ndim > 0
        )
        if rules.ndim:
            engine.configure(np.ascontiguousarray(rules["rules"]["plant"]))
        self.has_own_copies, self._settles = not alike, plant.ground.uneven
        self._share(task, engine, rules, goals, knots)

    def _share(self, task: Task[Any], engine: Engine, rules: np.ndarray, goals: int, knots: int) -> None:
        """Allocate the inputs and outputs of an engine and share them with it."""
        layouts, common, robots = engine_layouts(), rules["rules"], len(engine.robots)
        self.task, self.rules, self.engine, self.kind = task, rules, engine, task.robots.kind
        self.robots = engine.robots
        """Complete state of the robots: records of `sp_hover_robot`, `sp_crawl_robot` or `sp_course_robot`."""
        own, shown = sum(f.size for f in task.fields), int(common["size"].flat[0])
        self.actions = np.zeros((robots, int(common["mode"]["size"].flat[0])))
        self.observations, self.final_observations = (np.zeros((robots, shown + own), np.float32) for _ in range(2))
        self.rewards = np.zeros(robots)
        self.terminated, self.truncated, self.begun = (np.zeros(robots, bool) for _ in range(3))
        self.infos, self.final_infos = (np.zeros(robots, layouts[f"{self.kind}_info"]) for _ in range(2))
        self.quantities = np.zeros(robots, layouts[f"{self.kind}_quantities"])
        """Quantities that the engine computes for the task."""
        self.goals, self.knots = np.zeros((robots, goals), layouts["goal"]), np.zeros((robots, knots), layouts["knot"])
        self.terms, self.final_terms = (np.zeros((robots, len(task.reward_terms))) for _ in range(2))
        """Reward terms in the order of the task's table."""
        self.memory = np.zeros(robots, np.dtype([*task.memory, ("_task", "u1")]))
        """The task's variables of each robot."""
        self.is_given = np.zeros(robots, bool)
        """Robots with a start given by the user, which replaces the task's."""
        self.scheduled: dict[str, np.ndarray] = {}
        for name in _SHARED:
            engine.share(name, getattr(self, name))
        if rules.ndim:
            engine.record["rules_bytes"] = rules.itemsize
        engine.record["goal_room"], engine.record["knot_room"] = goals, knots
        engine.record["observation_size"] = shown + own
        self._prepare_task()

    def _prepare_task(self) -> None:
        """Read the task once: which optional methods it has, and the order of its terms and failures."""
        task, common, robots = self.task, self.rules["rules"], len(self.robots)
        self._horizon, self._truncates, self._autoreset = common["horizon"], common["truncates"], common["autoreset"]
        self.view = task.robots(self, self.memory)
        """Argument of the task's methods."""
        self.told, self.final_told = told(self.infos), told(self.final_infos)
        """Views of `infos` and `final_infos` by name."""
        self._episode = self.robots["episode"]
        self._failure_code, self._success = self.infos["info"]["failure_code"], self.infos["is_success"]
        self._names, self._words = list(task.reward_terms), [word for word in task.failures if word != "diverged"]
        codes = list(task.failures)
        self._codes = np.array([codes.index(word) for word in ("diverged", *self._words)])
        self._weights = np.array([weight for weight, _ in task.reward_terms.values()])
        self._failed, self._never = np.zeros((len(self._codes), robots), bool), np.zeros(robots, bool)
        self._rewards, self._shape = np.zeros(robots), (robots,)
        self._advances, self._draws = type(task).advance is not Task.advance, task.overrides("draw")
        self._ends_with_success = task.ends_with_success
        self._tells = type(task).tell is not Task.tell
        self._starts = hasattr(task, "start") and task.overrides("start")
        self._refers = task.refers
        self._bound = np.concatenate([[], *(np.full(f.size, f.bound) for f in task.fields)])
        scaled = bool(common["is_scaled"].flat[0])
        self._gain = np.concatenate([[], *(np.full(f.size, 1.0 / f.scale if scaled else 1.0) for f in task.fields)])
        self._was_over = True

    def __getstate__(self) -> dict[str, Any]:
        """Return the state for a copy: bytes, without arrays that the engine has the address of."""
        names = (*(name for name in _SHARED if name != "rules"), *_SHOWN, "memory", "is_given")
        return {
            "share": (self.task, self.engine, self.rules.copy(), self.goals.shape[1], self.knots.shape[1]),
            "numbers": {name: getattr(self, name).tobytes() for name in names},
            "has_own_copies": self.has_own_copies, "_settles": self._settles,
        }  # fmt: skip

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a copy with its own memory."""
        share, numbers = state.pop("share"), state.pop("numbers")
        vars(self).update(state)
        self._share(*share)
        for name, content in numbers.items():
            write(getattr(self, name), content)

    @property
    def horizon(self) -> np.ndarray:
        """Steps after which an episode is truncated, one for all or one for every robot."""
        return self._horizon

    @property
    def action_size(self) -> int:
        """Number of entries of an action."""
        return self.actions.shape[1]

    @property
    def parts(self) -> list[np.ndarray]:
        """Arrays with further state of the robots, besides `robots`, `goals` and `knots`."""
        return [self.observations, self.infos, self.quantities, self.terms, self.memory, self.is_given]

    def take_task(self, task: Task[Any]) -> None:
        """Set a task with other options, and the same terms and failures, from the next episode on."""
        self.task = task
        if self.kind == "hover":
            self.robots["forms"] = SEQUENCES.index(vars(task)["forms"])

    # ---- settings of the next episode ----

    def seed(self, robot: int, rng: np.random.Generator) -> None:
        """Copy the state of a generator into a robot's environment."""
        self._episode[robot]["generator"] = from_numpy(rng)

    def disturb(self, robot: int, disturbances: Disturbances) -> None:
        """Set the disturbances of a robot from its next episode on."""
        fill(self._episode[robot]["disturbances"], disturbances)

    def load(self, ids: np.ndarray, mass: np.ndarray, position_b: np.ndarray) -> None:
        """Attach point masses to torsos, from the next tick to the end of the episode.

        Args:
            ids: Indices of the robots.
            mass: Mass for each robot [kg].
            position_b: Positions in torso axes (…, 3) [m].
        """
        configs = self.robots["plant"]["config"].copy()
        configs["body"]["payload_mass"][ids], configs["body"]["payload_position"][ids] = mass, position_b
        self.engine.configure(configs, np.unique(ids), goes_on=True)

    def begin_with(self, robot: int, start: FlightStart | None) -> None:
        """Set the start of a robot's flights from the next episode on; with None the engine samples it."""
        record = self.robots[robot]
        record["is_given"] = start is not None
        if start is None:
            return
        record["offset"], record["rotation"] = start.position, start.rotation
        record["velocity"], record["omega"] = start.velocity, start.omega
        record["has_trim"], record["trim"] = start.trim is not None, 0.0 if start.trim is None else start.trim
        record["knots"] = knots = 0 if start.path is None else len(start.path.times)
        self.make_room(0, knots)
        if start.path is not None:
            row = self.knots[robot, :knots]
            row["time"], row["pose_w"] = start.path.times, start.path.pose_w
            row["rate_w"], row["acceleration_w"] = start.path.rate_w, start.path.acceleration_w
        self.reschedule(robot, start.goals)

    def reschedule(self, robot: int, goals: Sequence[FormGoal]) -> None:
        """Set the forms of a flight; forms that the episode has reached stay reached."""
        self.robots[robot]["goals"] = count = len(goals)
        self.make_room(count)
        rows = self.goals[robot, :count]
        rows["reached"][int(self.robots[robot]["current"]) :] = 0
        for name in ("start", "deadline", "joint_target"):
            rows[name] = [getattr(goal, name) for goal in goals]

    def give_start(self, robot: int, start: FlightStart | None) -> None:
        """Set a start given by the user, as `begin_with`; it replaces the task's."""
        self.begin_with(robot, start)
        self.is_given[robot] = start is not None

    def go(self, robot: int, course: Course | None) -> None:
        """Set a robot's course from the next episode on; with None the engine samples it."""
        record = self.robots[robot]
        record["is_given"] = course is not None
        if course is not None:
            write_course(record["course"], course)

    def set_scene(self, robot: int, scene: GraspScene | None) -> None:
        """Set a robot's scene of grasping from the next episode on; with None the engine samples it."""
        record = self.robots[robot]
        record["is_given"] = scene is not None
        if scene is not None:
            write_scene(record["scene"], scene)

    def ask_advice(self) -> None:
        """Compute the controller's command at every tick beside a `direct` action, for imitation learning.

        From then on ``robots["advice"]`` is the controller's command for the state observed before the tick. If
        ``robots["is_led"]`` is set, this command replaces the action, and is reported as the action.

        Raises:
            InvalidValueError: For a crawl, or an action mode other than `direct`.
        """
        mode = self.rules["rules"]["mode"]
        if self.kind != "hover" or not np.all(mode["is_direct"] & ~mode["is_in_torso_axes"]):
            raise InvalidValueError("action_mode", self.kind, "a flight with action_mode=direct")
        self.rules["rules"]["is_advised"] = 1

    # ---- memory ----

    def take_over(self, old: "Fleet") -> None:
        """Use the arrays of another fleet, to which clients hold references, and close that fleet.

        Generators and the settings of the next episodes are copied. The robots must be reset afterwards.
        """
        with old.engine.turn.lock, self.engine.turn.lock:
            for name in _CLIENTS:
                if getattr(self, name).shape == getattr(old, name).shape:
                    setattr(self, name, getattr(old, name))
                    if name in _SHARED:
                        self.engine.share(name, getattr(self, name))
            self.is_given = old.is_given
            self.make_room(old.goals.shape[1], old.knots.shape[1])
            self.goals[:, : old.goals.shape[1]], self.knots[:, : old.knots.shape[1]] = old.goals, old.knots
            plants = self.robots["plant"].copy()
            self.robots[:] = old.robots
            self.robots["plant"] = plants
            self.rules["rules"]["is_advised"] = np.any(old.rules["rules"]["is_advised"])
            self._prepare_task()
            old.close()

    def way_back(self) -> Callable[[], None]:
        """Return a function that restores the current robots and rules."""
        arrays = [self.rules, self.robots, self.goals, self.knots, *self.parts]
        contents = [(array, array.copy()) for array in (*arrays, self.engine.copies)]
        rooms = {"goals": self.goals, "knots": self.knots}

        def back() -> None:
            for array, content in contents:
                array[...] = content
            for name, array in rooms.items():
                self._give(name, array)
            self.engine.forget_copies()

        return back

    def _give(self, name: str, array: np.ndarray) -> None:
        """Replace the array of goals or knots."""
        setattr(self, name, array)
        self.engine.share(name, array)
        self.engine.record[f"{name[:-1]}_room"] = array.shape[1]

    def make_room(self, goals: int, knots: int = 0) -> None:
        """Allocate memory for at least this many forms of an episode and knots of its path."""
        with self.engine.turn.lock:
            for name, wanted in (("goals", goals), ("knots", knots)):
                held = getattr(self, name)
                robots, room = held.shape
                if wanted > room:
                    wider = np.zeros((robots, wanted), held.dtype)
                    wider[:, :room] = held
                    self._give(name, wider)

    def restored(self) -> None:
        """Invalidate cached values after the robots were overwritten from outside."""
        self._was_over = True
        self.engine.forget_copies()

    # ---- episodes ----

    def reset(self, ids: np.ndarray | None = None) -> None:
        """Begin episodes of robots, all if None (`SpidarError` if MuJoCo fails for one of them)."""
        chosen = np.arange(len(self.robots)) if ids is None else ids
        self._say_starts(chosen)
        self._run("reset", ids, _SETTLING_AT_ONCE if self._settles else _AT_ONCE)
        if self.commander is not None:
            self.commander.begin()
        self._begin(chosen)
        if self.commander is not None:
            self.commander.look()
            self._run(self._after, chosen)
        terms = self._terms()
        if self.task.is_own:
            self._require_finite(terms, self.rewards)
        self.terms[chosen], self.rewards[chosen] = terms[chosen], 0.0
        self.terminated[chosen] = self.truncated[chosen] = False
        self._tell()
        self._observe(chosen)
        if self.commander is not None:
            self.commander.observe()

    def step(self, ids: np.ndarray | None = None) -> None:
        """Step robots with `actions`; `ids` in rising order, all if None.

        If MuJoCo fails for a robot, its episode ends as diverged, other robots are unaffected, and `reset` begins its
        next episode. A failure while an episode begins automatically raises an error.

        Raises:
            SpidarError: For a robot that MuJoCo cannot place at the start of its next episode.
        """
        rows = slice(None) if ids is None else ids
        if self._is_plain and len(self.robots) == 1:
            try:
                self._run("step", ids)
                self._rate(rows)
            except KeyboardInterrupt:
                self._rate(rows)  # the interrupt may precede it, and a second call changes nothing
                raise
            return
        # Ctrl-C is handled after engine and task have processed all robots; immediately with a Python controller,
        # which may take long.
        with whole() if self.commander is None else nullcontext():
            if self._starts and self._autoreset.flat[0] == _NEXT_STEP:
                self._say_starts(np.flatnonzero(self._episode["over"]))
            self._move(ids)
            # Terms of a custom task whose sum is not finite are refused with a message.
            with np.errstate(over="ignore", invalid="ignore") if self.task.is_own else nullcontext():
                self._rate(rows)
            if self.commander is not None:
                self.commander.observe()

    @property
    def _is_plain(self) -> bool:
        """Whether a step runs no custom code and no task with memory, so that a second evaluation changes nothing."""
        return self.commander is None and not (self.task.is_own or self._advances)

    def _move(self, ids: np.ndarray | None) -> None:
        """Simulate a step of robots; Python's commands and references are new in each of its control periods."""
        commander, hold = self.commander, 1
        if self._refers or commander is not None:
            hold = int(self.rules["rules"]["hold"].flat[0])
        for period in range(hold):
            if commander is not None:
                commander.act()
            self._run("hold" if period else "step", ids)
            self._refer()
            if commander is not None:
                commander.look()
            if self._refers or commander is not None:
                self._run(self._after, ids)
            if period + 1 < hold:
                ids = self._going(ids)
                if not ids.size:
                    break

    def _going(self, ids: np.ndarray | None) -> np.ndarray:
        """Return the robots whose step of several control periods does not end early."""
        ends = self.begun | (self.view.diverged != 0.0)
        for name, most in self.task.stops.items():
            ends |= getattr(self.view, name) > most
        return np.flatnonzero(~ends) if ids is None else ids[~ends[ids]]

    @property
    def _after(self) -> str:
        """Engine's job after Python has written references or commands: flights then compute their errors."""
        return "regard" if self.kind == "hover" else "show"

    def _rate(self, rows: Any) -> None:  # noqa: ANN401 - all robots, or some by number
        """Compute rewards, failures and ends of robots that have moved, and begin the next episodes at an end."""
        task, view, failed = self.task, self.view, self._failed
        if self._advances:
            task.advance(view)
        self._note_failures()
        terms, rewards = self._reward(failed[0])
        succeeded = task.succeeded(view)
        if not (type(succeeded) is np.ndarray and succeeded.dtype.char == "?" and succeeded.shape == self._shape):
            succeeded = checked_array(f"{self._name}.succeeded", succeeded, self._shape, "?")
        terminated, truncated, begun = self._never, self._never, _NONE
        if np.count_nonzero(failed):
            terminated = np.logical_or.reduce(failed)
            succeeded = succeeded & ~terminated
        if self._ends_with_success and np.count_nonzero(succeeded):
            terminated = terminated | succeeded
        if np.count_nonzero(self._truncates):
            truncated = (view.ticks >= self._horizon) & (self._truncates != 0)
        way = self._autoreset.flat[0]
        if way == _NEXT_STEP and np.count_nonzero(self.begun):
            begun, go_on = np.flatnonzero(self.begun), ~self.begun
            terminated, truncated, succeeded = terminated & go_on, truncated & go_on, succeeded & go_on
            rewards[begun] = 0.0
        self.terms[rows], self.rewards[rows] = terms[rows], rewards[rows]
        self.terminated[rows], self.truncated[rows] = terminated[rows], truncated[rows]
        over = terminated | truncated
        ends = np.count_nonzero(over) > 0
        if ends or self._was_over:
            self._note_ends(rows, terminated, truncated, over, begun)
        self._go_on(begun)
        if np.count_nonzero(succeeded):
            self._success[rows] = succeeded[rows]
        self._tell()
        self._observe()
        if ends and way == _SAME_STEP:
            self._begin_anew(np.flatnonzero(over) if isinstance(rows, slice) else rows[over[rows]])

    def _note_failures(self) -> None:
        """Write which failures each robot has; the first is that of the engine."""
        np.not_equal(self.view.diverged, 0.0, out=self._failed[0])
        for k, mask in enumerate(self._rows(self.task.failed(self.view), self._words, "failed", "?"), 1):
            self._failed[k] = mask

    def _reward(self, diverged: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return terms (N, k) and rewards (N,); both are 0 for a robot that has diverged."""
        terms, rewards = self._terms(), self._rewards
        if np.count_nonzero(diverged):
            terms[diverged] = 0.0
        np.add.reduce(terms * self._weights, axis=1, out=rewards)
        if not math.isfinite(np.add.reduce(rewards)):
            self._require_finite(terms, rewards)
        return terms, rewards

    def _require_finite(self, terms: np.ndarray, rewards: np.ndarray) -> None:
        """Require terms and their sum to be finite for robots that have not diverged."""
        for k, name in enumerate(self._names):
            require_finite(f"{self._name}.terms: {name}", terms[:, k], self.view.diverged)
        require_finite(f"{self._name}: sum of terms", rewards, self.view.diverged)

    def _go_on(self, begun: np.ndarray) -> None:
        """Write the references of the next step, and initialise the robots whose next episode has begun."""
        task: Any = self.task
        if self._refers:
            self._write_reference(task.reference(self.view), task.preview(self.view))
        if begun.size:
            self._begin(begun)
            self.terms[begun] = self._terms()[begun]
        if self._refers:
            self._run("show", None)

    def _note_ends(
        self, rows: slice | np.ndarray, terminated: np.ndarray, truncated: np.ndarray, over: np.ndarray,
        begun: np.ndarray,
    ) -> None:  # fmt: skip
        """Write which episodes are over, and their failures."""
        failure = np.where(np.logical_or.reduce(self._failed), self._codes[self._failed.argmax(axis=0)], -1)
        failure[begun] = -1
        episode = self._episode
        for name, values in (("failure", failure), ("truncated", truncated), ("over", over)):
            episode[name][rows] = values[rows]
        self._failure_code[rows] = failure[rows]
        self._was_over = bool(over.any()) or not isinstance(rows, slice)

    def _begin_anew(self, ids: np.ndarray) -> None:
        """Store the final outputs of robots at an end, and begin their next episodes in the same step."""
        for name in ("observations", "infos", "terms"):
            getattr(self, f"final_{name}")[ids] = getattr(self, name)[ids]
        kept = {name: getattr(self, name)[ids] for name in ("rewards", "terminated", "truncated")}
        self.reset(ids)
        for name, values in kept.items():
            getattr(self, name)[ids] = values

    def _say_starts(self, ids: np.ndarray) -> None:
        """Set the starts of episodes that are about to begin, if the task defines starts."""
        if not self._starts:
            return
        task: Any = self.task
        for k in ids[~self.is_given[ids]].tolist():
            rng = to_numpy(self._episode[k]["generator"])
            start = task.start(rng)
            if not (start is None or isinstance(start, FlightStart)):
                raise InvalidValueError(f"{self._name}.start", start, "a FlightStart, or None for a sampled one")
            self.begin_with(k, start)
            self._episode[k]["generator"] = from_numpy(rng)

    def _begin(self, ids: np.ndarray) -> None:
        """Initialise the task's memory and references of episodes that the engine has begun."""
        self.memory[ids] = 0
        if self._draws:
            for k in ids.tolist():
                rng = to_numpy(self._episode[k]["generator"])
                self._remember(k, self.task.draw(rng))
                self._episode[k]["generator"] = from_numpy(rng)
        if self._refers:
            task: Any = self.task
            self._run("refer", ids)
            before = {name: self.robots[name].copy() for name in ("reference", "preview")}
            self._schedule()
            self._write_reference(task.reference(self.view), task.preview(self.view))
            others = np.setdiff1d(np.arange(len(self.robots)), ids)
            for name, records in before.items():
                self.robots[name][others] = records[others]
            if self.commander is None:
                self._run("regard", ids)

    def refer(self) -> None:
        """Update the reference of a Python controller after a change of the disturbances."""
        if self.commander is not None and self.kind == "hover" and not self._refers:
            self._run("refer", None)

    def _refer(self) -> None:
        """Update the references if the task overrides them: the schedule's first, then the task's."""
        if not self._refers:
            return
        task: Any = self.task
        self._run("refer", None)
        self._schedule()
        self.robots["reference"] = self._checked_reference(task.reference(self.view))

    def _schedule(self) -> None:
        self.scheduled = {name: self.robots[name].copy() for name in ("reference", "preview")}

    def _write_reference(self, reference: object, preview: object) -> None:
        self.robots["reference"] = self._checked_reference(reference)
        self.robots["preview"] = self._checked_records("preview", preview)

    def _checked_reference(self, given: object) -> np.ndarray:
        wanted, name = self._checked_records("reference", given), f"{self._name}.reference"
        if not ((wanted["mode"] >= 0) & (wanted["mode"] < _MODES)).all():
            raise InvalidValueError(f"{name}: mode", wanted["mode"].tolist(), f"numbers within 0 … {_MODES - 1}")
        off = ~(np.abs(square(wanted["quat_wb"]) - 1.0) < UNIT) & (self.view.diverged == 0.0)
        if off.any():
            k = int(np.flatnonzero(off)[0])
            raise InvalidValueError(
                f"{name}: quat_wb", wanted["quat_wb"][k].tolist(), f"a unit quaternion for robot {k}"
            )
        return wanted

    def _checked_records(self, method: str, given: object) -> np.ndarray:
        """Check a task's records: the type of the default, finite for robots that have not diverged."""
        like, name = self.robots[method], f"{self._name}.{method}"
        if not (isinstance(given, np.ndarray) and given.dtype == like.dtype and given.shape == like.shape):
            raise InvalidValueError(
                name, getattr(given, "dtype", given), f"records of shape {like.shape} with the fields of the default"
            )
        # One check for all members: non-negative integers, read as floats, are finite.
        if not np.isfinite(np.ascontiguousarray(given).view(np.float64)).all():
            for member in given.dtype.names or ():
                if given[member].dtype.kind == "f":
                    require_finite(f"{name}: {member}", given[member], self.view.diverged)
        return given

    def _terms(self) -> np.ndarray:
        """Return the reward terms (N, k) in the order of the task's table."""
        found = self._rows(self.task.terms(self.view), self._names, "terms", REAL)
        terms = np.empty((len(self.robots), len(found)))
        for k, values in enumerate(found):
            terms[:, k] = values
        return terms

    def _tell(self) -> None:
        """Write the task's entries of `info` into `infos`."""
        if self._tells:
            for name, values in self.task.tell(self.view).items():
                self.infos[name] = values

    def _observe(self, ids: np.ndarray | None = None) -> None:
        """Write the task's fields at the end of the observations."""
        if not len(self._bound):
            return
        task, rows = self.task, slice(None) if ids is None else ids
        given = task.observe(self.view)
        self._require_names(given, [f.name for f in task.fields], "observe")
        own = []
        for f in task.fields:
            name = f"{self._name}.observe: {f.name}"
            values = checked_array(name, given[f.name], (len(self.robots), f.size)).astype(float)
            require_finite(name, values, self.view.diverged)
            own.append(values)
        seen = np.clip(np.concatenate(own, axis=1), -self._bound, self._bound)
        seen[self.view.diverged != 0.0] = 0.0
        self.observations[rows, -len(self._bound) :] = (self._gain * seen)[rows]

    @property
    def _name(self) -> str:
        return type(self.task).__name__

    def _remember(self, robot: int, drawn: Any) -> None:  # noqa: ANN401 - user input
        """Write the values that a task has sampled for a robot into the memory."""
        method = f"{self._name}.draw"
        memory = self.memory[robot]
        for name, value in require_keys(
            method, "entry of the memory", drawn, [row[0] for row in self.task.memory]
        ).items():
            shape = np.shape(memory[name])
            values = require_array(f"{method}: {name}", value, f"numbers of shape {shape}")
            if values.shape not in ((), shape) or not np.isfinite(values).all():
                raise InvalidValueError(f"{method}: {name}", value, f"finite numbers of shape {shape}")
            memory[name] = value

    def _rows(self, given: Any, names: list[str], method: str, kinds: str) -> list[np.ndarray]:  # noqa: ANN401 - user input
        """Check a task's arrays by name, and return them in the order of its table."""
        self._require_names(given, names, method)
        rows = [given[name] for name in names]
        for k, values in enumerate(rows):
            if not (type(values) is np.ndarray and values.shape == self._shape and values.dtype.char in kinds):
                rows[k] = checked_array(f"{self._name}.{method}: {names[k]}", values, self._shape, kinds)
        return rows

    def _require_names(self, given: Any, names: list[str], method: str) -> None:  # noqa: ANN401 - user input
        if type(given) is dict and given.keys() == {*names}:
            return
        expected = f"a dictionary with an array for each of {', '.join(names)}"
        raise InvalidValueError(f"{self._name}.{method}", given, expected)

    def _run(self, job: str, ids: np.ndarray | None, at_once: int | None = None) -> None:
        failed = self.engine.run(f"sp_{job}_{self.kind}_robots", ids, at_once=at_once)
        if failed and job == "step":
            lost = [robot for robot in failed if not self.begun[robot]]
            for robot in lost:
                _LOG.warning("robot %d: its episode ends as diverged: %s", robot, self.engine.words(robot))
            again = self.engine.run(f"sp_lose_{self.kind}_robots", np.array(lost)) if lost else ()
            failed = [robot for robot in failed if robot not in lost or robot in again]
        if failed:
            robot, words = failed[0], self.engine.words(failed[0])
            raise SpidarError(f"MuJoCo failed for robot {robot}: {words}; valid: a robot and actions that it simulates")
        if self.kind == "crawl" and not self.robots["cycles"].all():
            robot = int(np.flatnonzero(self.robots["cycles"] == 0)[0])
            way = self.robots["way"][robot].tolist()
            raise InvalidValueError("way", way, "a goal within reach in at most as many steps as fit in memory")

    def close(self) -> None:
        """Stop the threads; a second call does nothing."""
        self.engine.close()


_NEXT_STEP, _SAME_STEP = AUTORESETS.index("next_step"), AUTORESETS.index("same_step")
_NONE = np.zeros(0, int)


def told(records: np.ndarray) -> dict[str, Any]:
    """Return views of infos (`sp_hover_info` or another task's) by name; entries of all environments come first."""
    common = records["info"]
    shared = {name: common[name] for name in common.dtype.names or ()}
    return shared | {name: records[name] for name in records.dtype.names or () if name != "info"}
