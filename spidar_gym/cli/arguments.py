"""Arguments that several commands have, each with its help: switches, names out of a table, what is printed."""

from collections.abc import Iterable
from typing import Annotated, Any

import tyro

from spidar_gym.control.presets import CRAWL_PRESETS, PRESETS
from spidar_gym.sim.stage import VIEWS


def choice(names: Iterable[str], help_text: str | None = None) -> Any:  # noqa: ANN401 - tyro's own annotation
    """An annotation with which the help shows names; the command refuses others, in its own words."""
    return tyro.conf.arg(metavar="{" + ",".join(names) + "}", help=help_text)


Flag = tyro.conf.FlagCreatePairsOff[bool]
"""A switch that is off where it is not named."""
JsonArg = Annotated[Flag, tyro.conf.arg(help="Print one JSON object on stdout and nothing else there.")]
FlightPresetArg = Annotated[str, choice(PRESETS)]
CrawlPresetArg = Annotated[str, choice(CRAWL_PRESETS)]
AnyPresetArg = Annotated[str | None, choice((*PRESETS, *CRAWL_PRESETS))]
CameraArg = Annotated[
    str, choice(VIEWS, "Camera of the video; fixed sees everything, the others follow and take longer.")
]
