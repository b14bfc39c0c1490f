"""`spidar log`: describe logs of runner, robot and simulation, and convert them to MCAP or CSV."""

import sys
from pathlib import Path
from typing import Annotated

import tyro

from spidar_gym.arguments import JsonArg
from spidar_gym.console import kept, progress
from spidar_gym.errors import InvalidValueError, SpidarError
from spidar_gym.files import json_text
from spidar_gym.logs.csv_folder import write_csv
from spidar_gym.logs.describe import record_facts, record_table
from spidar_gym.logs.mcap import mcap_library, write_mcap
from spidar_gym.logs.open import read_log
from spidar_gym.logs.record import Record
from spidar_gym.logs.topics import FORMATS
from spidar_gym.onboard.messages import NAMESPACE

log_app = tyro.extras.SubcommandApp()
FileArg = Annotated[
    tyro.conf.Positional[Path], tyro.conf.arg(help="Log of the runner, MCAP with messages of ROS 1, or bag of ROS 1.")
]
NamespaceArg = Annotated[str, tyro.conf.arg(help="Namespace of the robot's topics in MCAP and bags.")]


def _read(file: Path, namespace: str) -> Record:
    if not namespace.startswith("/") or namespace.endswith("/"):
        raise InvalidValueError("namespace", namespace, "a name of ROS such as /spidar")
    size = file.stat().st_size if file.is_file() else 0
    with progress(total=size, unit="B", unit_scale=True, desc=f"read {file.name}", leave=False, delay=1.0) as bar:
        return read_log(file, namespace=namespace, on_bytes=bar.update)


@log_app.command
def info(file: FileArg, namespace: NamespaceArg = NAMESPACE, json: JsonArg = False) -> None:
    """Print what a log holds: topics with count, rate [Hz], largest gap [s] and units; events; damage."""
    record = _read(file, namespace)
    print(json_text(record_facts(record)) if json else record_table(record))


@log_app.command
def convert(
    file: FileArg,
    out: Path | None = None,
    csv: Path | None = None,
    namespace: NamespaceArg = NAMESPACE,
) -> None:
    """Convert a log to MCAP, or to CSV; times are in s, angles in rad, and every column states its unit.

    Damaged parts of the log are left out, with a warning.

    Args:
        out: MCAP to write; the log's name with .mcap if neither --out nor --csv is given.
        csv: Folder for one CSV per topic.
    """
    target = out or (file.with_suffix(".mcap") if csv is None else None)
    for path in (target, csv):
        if path is not None and path.absolute() == file.absolute():
            raise SpidarError(f"{path} is the log itself; valid: another file, with --out")
    if target is not None:
        mcap_library()  # raises without the library, before the log is read
    record = _read(file, namespace)
    if not record.series:
        elsewhere = sorted({topic[: -len(name) - 1] for topic in record.others for name in FORMATS
                            if topic.endswith(f"/{name}")})  # fmt: skip
        raise SpidarError(
            f"{file} has no message of the robot's topics under {namespace}; valid: a log with some"
            f"{f', or --namespace {elsewhere[0]}' if elsewhere else ''}"
        )
    warnings, written = list(record.warnings), list[str]()
    count = sum(map(len, record.series.values())) * ((target is not None) + (csv is not None))
    with (
        progress(total=count, unit="message", desc=f"convert {file.name}") as bar,
        kept(lambda: f"{file} is unchanged"),
    ):
        if target is not None:
            warnings += write_mcap(record, target, namespace=namespace, on_messages=bar.update)
            written.append(str(target))
        if csv is not None:
            write_csv(record, csv, on_messages=bar.update)
            written.append(str(csv))
    for warning in warnings:
        print(f"spidar: warning: {file}: {' '.join(warning.split())}", file=sys.__stderr__)
    for topic, other in record.others.items():
        print(f"spidar: warning: {topic} is not converted: {other.count} messages of {other.kind}", file=sys.__stderr__)
    print(f"{len(record.series)} topics, {sum(map(len, record.series.values()))} messages: {', '.join(written)}")
