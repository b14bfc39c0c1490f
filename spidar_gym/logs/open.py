"""Reading a log of any kind; the kind is recognised by the content, not by the name."""

from collections.abc import Callable
from pathlib import Path

from spidar_gym.border import BorderError
from spidar_gym.logs import bag, mcap
from spidar_gym.logs.record import Record
from spidar_gym.logs.runner_log import is_runner_log, read_runner_log, runner_record
from spidar_gym.onboard.messages import NAMESPACE

VALID = "a log of the runner, an MCAP with messages of ROS 1, a bag of ROS 1"
"""Kinds of logs."""


def read_log(
    path: str | Path, *, namespace: str = NAMESPACE,
    on_bytes: Callable[[int], object] = lambda count: None,
) -> Record:  # fmt: skip
    """Read a log; parts that are damaged or missing are left out, and `Record.warnings` states them.

    Args:
        path: A log of the runner, an MCAP or a bag of ROS 1.
        namespace: Namespace of the robot's topics in an MCAP or a bag.
        on_bytes: Called with a number of bytes that have been read, for progress; logs of the runner are read at once.

    Raises:
        BorderError: For a file that cannot be read or is no such log.
        MissingDependencyError: Without the extra `log`, for an MCAP or a bag.
    """
    path = Path(path)
    try:
        if path.is_dir():
            raise BorderError(f"{path} is a folder; valid: {VALID}")
        with path.open("rb") as file:
            start = file.read(16)
    except (OSError, ValueError) as error:
        raise BorderError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}; valid: {VALID}") from error
    if is_runner_log(start):
        return runner_record(read_runner_log(path))
    if start.startswith(mcap.MAGIC):
        return mcap.read_mcap(path, namespace=namespace, on_bytes=on_bytes)
    if start.startswith(bag.MAGIC):
        return bag.read_bag(path, namespace=namespace, on_bytes=on_bytes)
    raise BorderError(f"{path} is no log; valid: {VALID}")
