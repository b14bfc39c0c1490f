"""The suite for learning: fixed tasks from easy to open, each with its success, budgets and the scale of its returns.

Each task is an id without arguments. Its robots, its world and its ranges are fixed, so that results are comparable;
another version of the suite gets other ids.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

from spidar_gym.committed import ROOT

PREFIX, VERSION = "spidar_suite", "v1"
ANCHORS = ROOT / "assets" / f"suite_{VERSION}.json"
"""File with the results of the policies that anchor the scale of each task; `spidar suite --anchors` writes it."""
LAZY, CLASSICAL, CEILING = ("zero", "random"), "classical", "ceiling"
"""Names of these policies: zero action and uniform actions; the best classical controller; the same with the true state
in place of sensors, a privileged ceiling where that is an option."""
INTERFACE = ("action_mode", "action_scale", "hold", "observation", "preset")
"""Arguments that a policy with a controller below it may choose itself; the others are the task."""
_FLIGHT = {"forms": "independent", "joint_speed": 0.4, "horizon_s": 10.0}
_LEARNED = {"reward": "sloped", "observation": "scaled"}
_ALONE = {"action_mode": "torso_forces", "action_scale": {"force": 3.0, "joint": 0.0}}
_CRAWL = {
    "action_mode": "torso_forces", "action_scale": {"force": 5.0, "joint": 0.35}, "hold": 5, "joint_speed": 0.8,
    "distance": 0.6, "direction": 0.0, "turn": 0.0, "horizon_s": 20.0, "sensors": True, "randomization": 0.3,
}  # fmt: skip
_STEPS = {"task": "spidar_gym.tasks.sloped:SlopedSteps", "observation": "scaled", "steps": 0.05, "horizon_s": 30.0}
_FLIES = "the whole flight aloft, RMS errors below 50 mm and 50 mrad, every form reached in time"
_ARRIVES = "the torso within 50 mm and 0.1 rad of the goal, which ends the episode"
_LIES = "the robot lies within 30 mm and 0.05 rad of the goal, which ends the episode"
_STEADY = "baselines.qp_steady:QPSteady"
M = 1_000_000
"""A million control ticks."""


@dataclass(frozen=True)
class SuiteTask:
    """One task of the suite."""

    name: str
    """Its name."""
    base: str
    """Name of its environment."""
    doc: str
    """Description in one line."""
    success: str
    """Meaning of `is_success`."""
    options: Mapping[str, Any]
    """Arguments of the environment."""
    classical: str
    """The best classical controller at the time of this version: module:Class."""
    budgets: Mapping[str, int]
    """Length of training by algorithm [control ticks]; for others that of `ppo`."""

    @property
    def id(self) -> str:
        """Id for `gymnasium.make`."""
        return f"{PREFIX}/{self.name}-{VERSION}"

    @property
    def env_id(self) -> str:
        """Id of the environment that runs it."""
        return f"spidar_gym/{self.base}-v0"

    @property
    def hold(self) -> int:
        """Control periods per step."""
        return int(self.options.get("hold", 20 if self.base == "Course" else 1))

    @property
    def seconds(self) -> float:
        """Length of an episode [s]."""
        return float(self.options["horizon_s"])

    def budget(self, algorithm: str) -> int:
        """Return the length of training [control ticks]."""
        return self.budgets.get(algorithm, self.budgets["ppo"])

    @property
    def has_ceiling(self) -> bool:
        """Whether the sensors can be replaced by the true state; those of a calibrated world cannot."""
        return bool(self.options.get("sensors")) and not isinstance(self.options["randomization"], str)

    @property
    def anchors(self) -> tuple[float, float]:
        """Mean returns that are 0 and 1 on its scale: of the better lazy policy, and of the classical controller."""
        found = read_anchors()[self.name]
        return max(found[name]["return"] for name in LAZY), found[CLASSICAL]["return"]

    def normalised(self, returns: Any) -> Any:  # noqa: ANN401 - a number or an array
        """Return returns on the task's scale."""
        zero, one = self.anchors
        return (returns - zero) / (one - zero)

    def options_of(self, chosen: Mapping[str, Any] | None) -> dict[str, Any]:
        """Return the arguments of the environment with those that a policy chooses.

        Args:
            chosen: The policy's arguments, which replace all of `INTERFACE`; None or empty for a policy that acts on
                the task as it is.
        """
        if not chosen:
            return dict(self.options)
        return {name: value for name, value in self.options.items() if name not in INTERFACE} | dict(chosen)


@cache
def read_anchors() -> dict[str, Any]:
    """Read the committed results of the anchoring policies: task → policy → mean by metric."""
    return json.loads(ANCHORS.read_text(encoding="utf-8"))["tasks"]


_TASKS = (
    SuiteTask(
        "HoverResidual", "Hover", "improve the paper's controller by a wrench while the joints move", _FLIES,
        {**_FLIGHT, **_LEARNED, "action_mode": "residual_wrench", "action_scale": {"share": 0.5}, "preset": "paper"},
        _STEADY,
        {"ppo": 3 * M, "sac": 300_000},
    ),
    SuiteTask(
        "Hover", "Hover", "fly from nothing while the joints move", _FLIES,
        {**_FLIGHT, **_LEARNED, **_ALONE}, _STEADY, {"ppo": 3 * M, "sac": 300_000},
    ),
    SuiteTask(
        "Path", "Path", "fly along a path from nothing while the joints move", _FLIES,
        {**_FLIGHT, **_LEARNED, **_ALONE, "speed": 0.5}, _STEADY, {"ppo": 3 * M},
    ),
    SuiteTask(
        "Crawl", "Crawl", "crawl 0.6 m from nothing, robots randomised at strength 0.3, sensors", _ARRIVES,
        {**_LEARNED, **_CRAWL}, _STEADY, {"ppo": 2 * M},
    ),
    SuiteTask(
        "Steps", "Crawl", "crawl 0.6 m over steps of up to 5 cm, the heights of the map in sight, robots as before",
        _ARRIVES, {**_CRAWL, **_STEPS}, "baselines.qp_tuned:QPTuned", {"ppo": 3 * M},
    ),
    SuiteTask(
        "Course", "Course", "reach a pose behind walls, beams and slots by a target every half second", _LIES,
        {**_LEARNED, "horizon_s": 180.0}, "baselines.course_steady:SteadyPlanner", {"ppo": 10 * M},
    ),
)  # fmt: skip
SUITE: dict[str, SuiteTask] = {task.name: task for task in _TASKS}
"""The tasks by name, from easy to open, and after them two on robots that are as imperfect as the real one."""
SUITE |= {
    f"{name}Calibrated": replace(
        SUITE[name], name=f"{name}Calibrated",
        doc=f"{SUITE[name].doc.partition(', robots')[0]}, robots of the calibrated world, sensors",
        options={**SUITE[name].options, "randomization": "calibrated_1"},
    )
    for name in ("Hover", "Crawl")
}  # fmt: skip
SUITE_IDS: Mapping[str, str] = {task.id: name for name, task in SUITE.items()}
"""Name of each task by its id."""
