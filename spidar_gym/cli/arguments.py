"""Types of arguments that several commands have: names out of a table, which the help lists."""

from collections.abc import Iterable
from typing import Annotated, Any

import tyro

from spidar_gym.control.presets import CRAWL_PRESETS, PRESETS
from spidar_gym.sim.stage import VIEWS


def choice(names: Iterable[str]) -> Any:  # noqa: ANN401 - tyro's own annotation
    """An annotation with which the help shows names; the command refuses others, in its own words."""
    return tyro.conf.arg(metavar="{" + ",".join(names) + "}")


FlightPresetArg = Annotated[str, choice(PRESETS)]
CrawlPresetArg = Annotated[str, choice(CRAWL_PRESETS)]
AnyPresetArg = Annotated[str | None, choice((*PRESETS, *CRAWL_PRESETS))]
CameraArg = Annotated[str, choice(VIEWS)]
