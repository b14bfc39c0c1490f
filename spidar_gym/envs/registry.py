"""One table: environment id → task and horizon. String entry points only, so that every spec survives JSON."""

from dataclasses import dataclass

import gymnasium
from gymnasium.envs.registration import WrapperSpec

from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.errors import require_name


class RegisteredSteps(int):
    """Length of an episode that nobody has asked for: `horizon_s` goes before it."""


HORIZON = WrapperSpec("Horizon", "spidar_gym.envs.horizon:Horizon", {})
"""What ends every environment's episodes."""


class OnlyOfOne(tuple[WrapperSpec, ...]):
    """Wrappers that `gymnasium.make` puts around an environment; its vector, which ends episodes itself, has none.

    `gymnasium.make` takes them one by one; `gymnasium.make_vec` asks how many there are, and refuses a vector with any.
    """

    __slots__ = ()

    def __len__(self) -> int:
        """None of a vector's."""
        return 0


HOVER, PATH, CRAWL, COURSE = (f"spidar_gym/{name}-v0" for name in ("Hover", "Path", "Crawl", "Course"))


@dataclass(frozen=True)
class Entry:
    """One registered environment."""

    entry_point: str
    """Its class, `module:name`."""
    vector_entry_point: str
    """What makes many of it in native code, `module:name`."""
    horizon: int
    """Steps of an episode: those of the task's `horizon_s`."""
    doc: str
    """What it is, in one line."""
    hold: int = 1
    """Control periods of a step."""

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
}  # fmt: skip
"""Every environment of this package."""


def import_id(name: str) -> str:
    """The id for a process that has not imported this package: Gymnasium imports what stands before the colon."""
    return f"{__name__.partition('.')[0]}:{name}"


def register() -> None:
    """Tell Gymnasium about them; importing this does it, and importing `spidar_gym`, once there is Gymnasium."""
    for name, entry in ENVIRONMENTS.items():
        if name not in gymnasium.registry:
            _register(name, entry, {})


def register_task(name: str, base: str, task: object, **options: object) -> None:
    """Tell Gymnasium about a task of one's own, for `gymnasium.make` and `gymnasium.make_vec`.

    Args:
        name: Its id, such as `mine/Eight-v0`.
        base: Id of the environment whose robots do it.
        task: As the environment's argument `task`; by its name `module:Class` the specification survives JSON.
        **options: Other arguments of the environment.

    Raises:
        UnknownNameError: For a base that does not exist; it lists the valid ones.
    """
    _register(name, environment(base), {"task": task, **options})


def _register(name: str, entry: Entry, arguments: dict[str, object]) -> None:
    gymnasium.register(
        id=name,
        entry_point=entry.entry_point,
        max_episode_steps=RegisteredSteps(entry.horizon),
        additional_wrappers=OnlyOfOne((HORIZON,)),
        vector_entry_point=entry.vector_entry_point,
        kwargs=arguments,
    )


def environment(name: str) -> Entry:
    """Entry by id (`UnknownNameError` lists the valid ones)."""
    require_name("environment", name, ENVIRONMENTS)
    return ENVIRONMENTS[name]


register()
