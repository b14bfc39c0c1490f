"""Connection to a local or remote Ray cluster."""

import os
import socket
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from spidar_gym.errors import MissingDependencyError, SpidarError

PATIENCE = 5.0
"""Timeout of the connection to a remote cluster [s]; Ray itself retries for many minutes."""


@contextmanager
def cluster(
    address: str,
    workers: int,
    *,
    variables: Mapping[str, str] | None = None,
    **options: Any,  # noqa: ANN401 - ray.init's
) -> Iterator[Any]:
    """Connect to Ray for the duration of the context; an existing connection is used and stays open.

    Args:
        address: `local` for a cluster of `workers` workers on this machine, `auto`, or host:port.
        workers: Number of workers of a local cluster.
        variables: Additional environment variables of the workers; `PYTHONPATH` is always set.
        **options: Further arguments of `ray.init`.

    Raises:
        MissingDependencyError: When Ray is not installed.
        SpidarError: When no cluster can be reached at the address.
    """
    try:
        import ray
    except ImportError as error:
        raise MissingDependencyError("Ray", "pip install 'spidar-gym[ray]'") from error
    started = not ray.is_initialized()
    if started:
        # Workers import modules from the working folder, too, as this process does.
        paths = os.pathsep.join(filter(None, [str(Path.cwd()), os.environ.get("PYTHONPATH", "")]))
        env = {"env_vars": {"PYTHONPATH": paths, **(variables or {})}}
        try:
            if address == "local":
                ray.init(num_cpus=workers, log_to_driver=False, include_dashboard=False, runtime_env=env, **options)
            else:
                host, colon, port = address.rpartition("://")[2].rpartition(":")
                if colon and port.isdigit():
                    socket.create_connection((host, int(port)), PATIENCE).close()
                ray.init(address=address, log_to_driver=False, runtime_env=env, **options)
        except (OSError, RuntimeError, ValueError) as error:
            raise SpidarError(
                f"no Ray cluster at {address!r}: {error}; valid: local, auto, or what `ray start` prints"
            ) from error
    try:
        yield ray
    finally:
        if started:
            ray.shutdown()
