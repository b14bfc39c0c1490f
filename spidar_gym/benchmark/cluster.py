"""A Ray cluster, here or elsewhere: found, or refused in one line."""

import os
import socket
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from spidar_gym.errors import MissingDependencyError, SpidarError

PATIENCE = 5.0
"""How long a cluster may take to answer [s]; Ray itself tries again for many minutes."""


@contextmanager
def cluster(
    address: str,
    workers: int,
    *,
    variables: Mapping[str, str] | None = None,
    **options: Any,  # noqa: ANN401 - ray.init's
) -> Iterator[Any]:
    """Ray, connected for as long as the context lasts; one that is connected already is left as it is.

    Args:
        address: `local` for a cluster of `workers` workers here, `auto`, or host:port.
        workers: Workers of a local cluster.
        variables: Environment variables of the workers, beside where they import from.
        **options: More of `ray.init`.

    Raises:
        MissingDependencyError: Without Ray.
        SpidarError: Where there is no cluster.
    """
    try:
        import ray
    except ImportError as error:
        raise MissingDependencyError("Ray", "pip install 'spidar-gym[ray]'") from error
    started = not ray.is_initialized()
    if started:
        # What is imported by name is also looked for in the working folder, there as here.
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
