"""Robots of one environment in the engine, and what goes in and comes out at a tick: one robot or thousands."""

import logging
from collections.abc import Callable
from typing import Any

import numpy as np

from spidar_gym.control.course.gates import Course
from spidar_gym.envs.hover.task import FlightStart
from spidar_gym.errors import InvalidValueError, SpidarError
from spidar_gym.native.course import write_course
from spidar_gym.native.draws import from_numpy
from spidar_gym.native.engine import Engine
from spidar_gym.native.engine_structs import COURSE_FAILURES, CRAWL_FAILURES, FLIGHT_FAILURES, engine_layouts
from spidar_gym.native.library import write
from spidar_gym.native.structs import fill
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.disturbances import Disturbances

_LOG = logging.getLogger("spidar_gym.mujoco")
_FAILURES = {"hover": FLIGHT_FAILURES, "crawling": CRAWL_FAILURES, "coursing": COURSE_FAILURES}
_SHARED = ("rules", "actions", "observations", "final_observations", "rewards", "terminated", "truncated", "begun",
           "infos", "final_infos", "goals", "knots")  # fmt: skip
"""Arrays that the engine reads and writes where they lie."""
_AT_ONCE, _SETTLING_AT_ONCE = 256, 4
"""Robots that a thread resets before Ctrl-C is answered: on tiles one takes up to 70 ms to come to rest."""


class Fleet:
    """Robots of one environment.

    Its arrays have an entry for every robot, and are written anew at every tick: who keeps them makes a copy.
    """

    def __init__(
        self, kind: str, rules: np.ndarray, plant: PlantConfig, robots: int, threads: int, *,
        alike: bool, goals: int = 0, knots: int = 0,
    ) -> None:  # fmt: skip
        """Make them.

        Args:
            kind: `hover`, `crawling` or `coursing`.
            rules: `sp_hover_rules`, `sp_crawl_rules` or `sp_course_rules`, one for all or one for every robot: then
                each is simulated as its own say, on floors of the same kind.
            plant: The simulated robot, or the one that others are drawn around.
            robots: How many.
            threads: How many threads, the caller's included.
            alike: Whether none of them is drawn, nor its floor.
            goals: Forms that an episode has at most.
            knots: Knots that a path of an episode has at most.
        """
        engine = Engine(kind, plant, robots, threads, alike=alike, floors=rules.ndim > 0)
        if rules.ndim:
            engine.configure(np.ascontiguousarray(rules["rules"]["plant"]))
        self.has_own_copies, self._settles = not alike, plant.ground.uneven
        self._share(kind, engine, rules, goals, knots)

    def _share(self, kind: str, engine: Engine, rules: np.ndarray, goals: int, knots: int) -> None:
        """Make what goes in and out of an engine."""
        layouts, common, robots = engine_layouts(), rules["rules"], len(engine.robots)
        self.kind, self.rules, self.engine = kind, rules, engine
        self.robots = engine.robots
        """All that there is of the robots: records of `sp_hover`, `sp_crawling` or `sp_coursing`."""
        info, size = layouts[f"{kind}_info"], int(common["size"].flat[0])
        self.actions = np.zeros((robots, int(common["mode"]["size"].flat[0])))
        self.observations, self.final_observations = (np.zeros((robots, size), np.float32) for _ in range(2))
        self.rewards = np.zeros(robots)
        self.terminated, self.truncated, self.begun = (np.zeros(robots, bool) for _ in range(3))
        self.infos, self.final_infos = np.zeros(robots, info), np.zeros(robots, info)
        self.told, self.final_told = told(self.infos), told(self.final_infos)
        """Views of `infos` and `final_infos` by name."""
        self.goals, self.knots = np.zeros((robots, goals), layouts["goal"]), np.zeros((robots, knots), layouts["knot"])
        self.extras: list[np.ndarray] = []
        """Other arrays with an entry for every robot that belong to what a robot is."""
        self.task = "the built-in one"
        """Who judges."""
        self.failures = len(_FAILURES[kind])
        """How many words there are for why an episode is over."""
        for name in _SHARED:
            engine.share(name, getattr(self, name))
        if rules.ndim:
            engine.record["rules_bytes"] = rules.itemsize
        engine.record["goal_room"], engine.record["knot_room"] = goals, knots

    def __getstate__(self) -> dict[str, Any]:
        """What a copy is made of: numbers, and no array that the engine has the address of."""
        numbers = {name: getattr(self, name).tobytes() for name in _SHARED if name != "rules"}
        return {
            "share": (self.kind, self.engine, self.rules.copy(), self.goals.shape[1], self.knots.shape[1]),
            "numbers": numbers, "extras": self.extras, "task": self.task, "failures": self.failures,
            "has_own_copies": self.has_own_copies, "_settles": self._settles,
        }  # fmt: skip

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Become a copy with a memory of its own."""
        share, numbers = state.pop("share"), state.pop("numbers")
        self._share(*share)
        vars(self).update(state)
        for name, content in numbers.items():
            write(getattr(self, name), content)

    def seed(self, robot: int, rng: np.random.Generator) -> None:
        """Let a robot's environment draw what this generator would."""
        self.robots[robot]["episode"]["generator"] = from_numpy(rng)

    def disturb(self, robot: int, disturbances: Disturbances) -> None:
        """Say what happens to a robot from its next episode on."""
        fill(self.robots[robot]["episode"]["disturbances"], disturbances)

    def load(self, ids: np.ndarray, mass: np.ndarray, position_b: np.ndarray) -> None:
        """Let torsos carry point masses from the next tick on, until their episodes end.

        Args:
            ids: Whose.
            mass: [kg], an entry for each of them.
            position_b: Where, torso axes (…, 3) [m].
        """
        configs = self.robots["plant"]["config"].copy()
        configs["body"]["payload_mass"][ids], configs["body"]["payload_position"][ids] = mass, position_b
        self.engine.configure(configs, np.unique(ids), goes_on=True)

    def begin_with(self, robot: int, start: FlightStart | None) -> None:
        """Say what a flight begins with and goes through from its next episode on; None has it drawn."""
        record = self.robots[robot]
        record["is_given"] = start is not None
        if start is None:
            return
        record["offset"], record["rotation"] = start.position, start.rotation
        record["velocity"], record["omega"] = start.velocity, start.omega
        record["has_trim"], record["trim"] = start.trim is not None, 0.0 if start.trim is None else start.trim
        record["goals"] = count = len(start.goals)
        record["knots"] = knots = 0 if start.path is None else len(start.path.times)
        self.make_room(count, knots)
        if start.path is not None:
            row = self.knots[robot, :knots]
            row["time"], row["pose_w"] = start.path.times, start.path.pose_w
            row["rate_w"], row["acceleration_w"] = start.path.rate_w, start.path.acceleration_w
        goals = self.goals[robot, :count]
        for name in ("start", "deadline", "joint_target"):
            goals[name] = [getattr(goal, name) for goal in start.goals]

    def go(self, robot: int, course: Course | None) -> None:
        """Say which course a robot goes from its next episode on; None has it drawn."""
        record = self.robots[robot]
        record["is_given"] = course is not None
        if course is not None:
            write_course(record["course"], course)

    def ask_advice(self) -> None:
        """Let the controller say at every tick what it would command in place of a `direct` action, for imitation.

        From then on ``robots["advice"]`` is its command for what was seen before the tick. Where ``robots["is_led"]``
        is set, that is done in place of the action, and told as if it had been the action.

        Raises:
            InvalidValueError: For a crawl, or an action mode that has the controller fly anyway.
        """
        if self.kind != "hover" or not np.all(self.rules["rules"]["mode"]["is_direct"]):
            raise InvalidValueError("action_mode", self.kind, "a flight with action_mode=direct")
        self.rules["rules"]["is_advised"] = 1

    def take_over(self, old: "Fleet") -> None:
        """Go on in the arrays of other robots, where clients look; those are closed, and these have to begin anew.

        Their generators, and what was said of their next episodes, go on too.
        """
        with old.engine.turn.lock, self.engine.turn.lock:
            for name in (
                "actions", "observations", "final_observations", "rewards", "terminated", "truncated", "begun", "infos",
                "final_infos",
            ):  # fmt: skip
                setattr(self, name, getattr(old, name))
                self.engine.share(name, getattr(self, name))
            self.told, self.final_told = old.told, old.final_told
            self.make_room(old.goals.shape[1], old.knots.shape[1])
            self.goals[:, : old.goals.shape[1]], self.knots[:, : old.knots.shape[1]] = old.goals, old.knots
            plants = self.robots["plant"].copy()
            self.robots[:] = old.robots
            self.robots["plant"] = plants
            self.rules["rules"]["is_advised"] = np.any(old.rules["rules"]["is_advised"])
            old.close()

    def way_back(self) -> Callable[[], None]:
        """What lets robots and rules be again as they are now."""
        arrays = [self.rules, self.robots, self.goals, self.knots, self.observations, self.infos, *self.extras]
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
        """Let goals or knots be in another array."""
        setattr(self, name, array)
        self.engine.share(name, array)
        self.engine.record[f"{name[:-1]}_room"] = array.shape[1]

    def make_room(self, goals: int, knots: int = 0) -> None:
        """Let an episode have at least so many forms, and its path so many knots."""
        with self.engine.turn.lock:
            for name, wanted in (("goals", goals), ("knots", knots)):
                held = getattr(self, name)
                robots, room = held.shape
                if wanted > room:
                    wider = np.zeros((robots, wanted), held.dtype)
                    wider[:, :room] = held
                    self._give(name, wider)

    def reset(self, ids: np.ndarray | None = None) -> None:
        """Let robots begin an episode, all if not said; `SpidarError` where MuJoCo gives one of them up."""
        self._run("reset", ids, _SETTLING_AT_ONCE if self._settles else _AT_ONCE)

    def step(self, ids: np.ndarray | None = None) -> None:
        """One control period of robots, with `actions`; of all if not said which, in rising order.

        Where MuJoCo gives up a robot, its episode ends as one that has diverged, and nobody else's is changed; `reset`
        begins its next. Where it does so while an episode begins by itself, that is an error.

        Raises:
            SpidarError: For a robot that MuJoCo cannot put where its next episode begins.
        """
        self._run("step", ids)

    def show(self) -> None:
        """Write observations and infos of what is now, where Python judges."""
        self._run("show", None)

    def regard(self, ids: np.ndarray) -> None:
        """Look at flights with the references that Python has written, where episodes have just begun; show them."""
        self._run("regard", ids)

    def _run(self, job: str, ids: np.ndarray | None, at_once: int | None = None) -> None:
        failed = self.engine.run(f"sp_{job}_{self.kind}s", ids, at_once=at_once)
        if failed and job == "step":
            lost = [robot for robot in failed if not self.begun[robot]]
            for robot in lost:
                _LOG.warning("robot %d: its episode ends as diverged: %s", robot, self.engine.words(robot))
            again = self.engine.run(f"sp_lose_{self.kind}s", np.array(lost)) if lost else ()
            failed = [robot for robot in failed if robot not in lost or robot in again]
        if failed:
            robot, words = failed[0], self.engine.words(failed[0])
            raise SpidarError(f"MuJoCo gave up robot {robot}: {words}; valid: a robot and actions that it simulates")
        if self.kind == "crawling" and not self.robots["cycles"].all():
            robot = int(np.flatnonzero(self.robots["cycles"] == 0)[0])
            way = self.robots["way"][robot].tolist()
            raise InvalidValueError("way", way, "a way within reach, and no more steps than there is room for")

    def close(self) -> None:
        """Stop the threads; a second call does nothing."""
        self.engine.close()


def told(records: np.ndarray) -> dict[str, Any]:
    """Views of infos (`sp_hover_info` or `sp_crawling_info`) by name: what all environments tell comes first."""
    common = records["info"]
    shared = {name: common[name] for name in common.dtype.names or ()}
    return shared | {name: records[name] for name in records.dtype.names or () if name != "info"}
