"""Annotated types of arguments that several commands share: switches, choices and the format of the output."""

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any

import tyro

from spidar_gym.control.presets import CRAWL_PRESETS, PRESETS
from spidar_gym.sim.stage import VIEWS


def choice(names: Iterable[str], help_text: str | None = None) -> Any:  # noqa: ANN401 - tyro's own annotation
    """Return an annotation that makes the help list `names`; the command itself refuses other names."""
    return tyro.conf.arg(metavar="{" + ",".join(names) + "}", help=help_text)


Flag = tyro.conf.FlagCreatePairsOff[bool]
"""A switch, off by default, without a negated form."""
JsonArg = Annotated[Flag, tyro.conf.arg(help="Print one JSON object on stdout instead of text.")]
FlightPresetArg = Annotated[str, choice(PRESETS)]
CrawlPresetArg = Annotated[str, choice(CRAWL_PRESETS)]
AnyPresetArg = Annotated[str | None, choice((*PRESETS, *CRAWL_PRESETS))]
WorldArg = Annotated[
    str,
    tyro.conf.arg(help="Calibrated world of the robots, calibrated_1, one kind, calibrated_1:wake-damped, or a file."),
]
ParametersArg = Annotated[
    Path | None,
    tyro.conf.arg(help="Parameter file that the runner reads at start, of `spidar parameters`; its presets are named."),
]
CameraArg = Annotated[
    str, choice(VIEWS, "Camera of the video; fixed shows the whole scene, the others follow the robot and are slower.")
]
