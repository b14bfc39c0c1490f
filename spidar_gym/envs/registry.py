"""One table: environment id → task and horizon. String entry points only, so that every spec survives JSON."""

from dataclasses import dataclass

import gymnasium

from spidar_gym.errors import UnknownNameError


@dataclass(frozen=True)
class Entry:
    """One registered environment."""

    entry_point: str
    """Its class, `module:name`."""
    horizon: int
    """Ticks an episode: the task's `horizon_s` at 40 a second."""
    doc: str
    """What it is, in one line."""


ENVIRONMENTS: dict[str, Entry] = {
    "spidar_gym/Hover-v0": Entry(
        "spidar_gym.envs.hover:HoverEnv", 800, "hold the CoG while the joints go through a sequence of forms"
    ),
    "spidar_gym/Crawl-v0": Entry("spidar_gym.envs.crawl:CrawlEnv", 3000, "crawl to a pose on the floor"),
}
"""Every environment of this package."""


def register() -> None:
    """Tell Gymnasium about them; importing `spidar_gym` does this."""
    for name, entry in ENVIRONMENTS.items():
        if name not in gymnasium.registry:
            gymnasium.register(
                id=name,
                entry_point=entry.entry_point,
                max_episode_steps=entry.horizon,
            )


def environment(name: str) -> Entry:
    """Entry by id (`UnknownNameError` lists the valid ones)."""
    if name not in ENVIRONMENTS:
        raise UnknownNameError("environment", name, ENVIRONMENTS)
    return ENVIRONMENTS[name]
