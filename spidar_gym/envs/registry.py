"""Registry of the environments by id; entry points are strings, so that every specification can be stored in JSON."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import gymnasium
from gymnasium.envs.registration import WrapperSpec

from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.envs.suite import SUITE
from spidar_gym.errors import require_name


class RegisteredSteps(int):
    """Default length of an episode, which `horizon_s` overrides."""


HORIZON = WrapperSpec("Horizon", "spidar_gym.envs.horizon:Horizon", {})
"""Wrapper that truncates the episodes of every environment."""


class OnlyOfOne(tuple[WrapperSpec, ...]):
    """Wrappers that `gymnasium.make` applies; a native vector truncates episodes itself and needs none.

    `gymnasium.make` iterates over the wrappers. `gymnasium.make_vec` reads their number, and refuses any number but 0.
    """

    __slots__ = ()

    def __len__(self) -> int:
        """Return 0, the number of a vector's wrappers."""
        return 0


HOVER, PATH, CRAWL, COURSE, GRASP = (f"spidar_gym/{name}-v0" for name in ("Hover", "Path", "Crawl", "Course", "Grasp"))


@dataclass(frozen=True)
class Entry:
    """One registered environment."""

    entry_point: str
    """Class of the environment, `module:name`."""
    vector_entry_point: str
    """Function that makes its native vector, `module:name`."""
    horizon: int
    """Steps of an episode, from the task's `horizon_s`."""
    doc: str
    """Description in one line."""
    hold: int = 1
    """Control periods per step."""

    @property
    def seconds(self) -> float:
        """Length of an episode [s]."""
        return self.horizon * self.hold / CONTROL_RATE


ENVIRONMENTS: dict[str, Entry] = {
    HOVER: Entry(
        "spidar_gym.envs.hover_env:HoverEnv", "spidar_gym.envs.vector:hover_vector", 800,
        "hold the CoG while the joints go through a sequence of forms",
    ),
    PATH: Entry(
        "spidar_gym.envs.path_env:PathEnv", "spidar_gym.envs.vector:path_vector", 800,
        "follow a path with the CoG while the joints go through a sequence of forms",
    ),
    CRAWL: Entry(
        "spidar_gym.envs.crawl_env:CrawlEnv", "spidar_gym.envs.vector:crawl_vector", 3000,
        "crawl to a pose on the floor",
    ),
    COURSE: Entry(
        "spidar_gym.envs.course_env:CourseEnv", "spidar_gym.envs.vector:course_vector", 600,
        "reach a pose behind walls, beams and slots: take off, fly, change form, land, crawl", 20,
    ),
    GRASP: Entry(
        "spidar_gym.envs.grasp_env:GraspEnv", "spidar_gym.envs.vector:grasp_vector", 3000,
        "grasp an object with the legs, lift it, carry it and put it down",
    ),
}  # fmt: skip
"""Every environment of this package."""


def import_id(name: str) -> str:
    """Return the id for a process that has not imported this package: Gymnasium imports the part before the colon."""
    return f"{__name__.partition('.')[0]}:{name}"


def register() -> None:
    """Register the environments in Gymnasium, as importing this module or, with Gymnasium, `spidar_gym` does."""
    for name, entry in ENVIRONMENTS.items():
        if name not in gymnasium.registry:
            _register(name, entry, {})
    for task in SUITE.values():
        if task.id not in gymnasium.registry:
            steps = round(task.seconds * CONTROL_RATE / task.hold)
            _register(task.id, replace(environment(task.env_id), horizon=steps), task.options)


def register_task(name: str, base: str, task: object, **options: object) -> None:
    """Register a custom task in Gymnasium, for `gymnasium.make` and `gymnasium.make_vec`.

    Args:
        name: New id, such as `mine/Eight-v0`.
        base: Id of the environment that runs the task.
        task: As the environment's argument `task`; given as `module:Class`, the specification can be stored in JSON.
        **options: Other arguments of the environment.

    Raises:
        UnknownNameError: For a base that does not exist; it lists the valid ones.
    """
    _register(name, environment(base), {"task": task, **options})


def _register(name: str, entry: Entry, arguments: Mapping[str, object]) -> None:
    gymnasium.register(
        id=name,
        entry_point=entry.entry_point,
        max_episode_steps=RegisteredSteps(entry.horizon),
        additional_wrappers=OnlyOfOne((HORIZON,)),
        vector_entry_point=entry.vector_entry_point,
        kwargs=dict(arguments),
    )


def environment(name: str) -> Entry:
    """Return an entry by id (`UnknownNameError` lists the valid ones)."""
    require_name("environment", name, ENVIRONMENTS)
    return ENVIRONMENTS[name]


register()
