"""`spidar export`: write the onboard core as a folder that needs only a C compiler, with reproducible bytes."""

import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path

import spidar_gym
from spidar_gym.control.presets import FORMER_PRESETS, PRESETS
from spidar_gym.errors import InvalidValueError, SpidarError
from spidar_gym.files import cannot_write, whole_file
from spidar_gym.margins import WORLD, require_margins
from spidar_gym.native.codegen.committed import osqp_files, osqp_version
from spidar_gym.native.codegen.header import (
    CORE,
    constants_header,
    interface_hash,
    model_header,
    modes_header,
    presets_header,
    structs_header,
)
from spidar_gym.native.recipe import interface_header, source_bytes
from spidar_gym.onboard.fields import fields_header
from spidar_gym.onboard.golden import golden_files
from spidar_gym.onboard.parameters import digest_of, parameters_record, parameters_text
from spidar_gym.onboard.policy import RATE, policy_header
from spidar_gym.onboard.runner_header import runner_hash, runner_header
from spidar_gym.onboard.runner_structs import RUNNER
from spidar_gym.onboard.topics_file import topics_file
from spidar_gym.policies.artifact import read_artifact
from spidar_gym.policies.source import artifact_file
from spidar_gym.robot import ROBOT, RobotSpec
from spidar_gym.sim.worlds import find_world, world_names

ONBOARD = Path(__file__).resolve().parent
"""Sources of the programs around the core on the robot."""
PARTS = {
    "core": (CORE, "*.[ch]"), "runner": (RUNNER, "*.[ch]*"), "msg": (ONBOARD / "msg", "*.msg"),
    "examples": (ONBOARD / "examples", "*.c"),
}  # fmt: skip
"""Exported folder → folder of hand-written sources, and pattern of the files."""
EXPORTED = ("paper", "as_flown", "as_flown_quasi", "steady", "first_flight")
"""Flight presets of an export without a choice: those with the margins that an export requires."""
FLOWN = EXPORTED[:3]
"""Those of them that are exported for a custom robot: the paper's."""
EVERY = (*PRESETS, *FORMER_PRESETS)
"""All flight presets."""
PAGES = ("CMakeLists.txt", "package.xml", "README.md")
"""Files at the top of the export."""


def exported(robot: RobotSpec = ROBOT) -> tuple[str, ...]:
    """Return the flight presets of an export without a choice, for a robot."""
    return EXPORTED if robot == ROBOT else FLOWN


def export_files(
    *,
    golden: bool = True,
    residual: Path | None = None,
    rate: float = RATE,
    extra: Mapping[str, bytes] | None = None,
    robot: RobotSpec = ROBOT,
    presets: Sequence[str] | None = None,
    fragile: bool = False,
    name: str = "spidar",
    world: str = WORLD,
) -> dict[str, bytes]:
    """Return path → content of the exported folder; reproducible.

    Args:
        golden: Whether to include recorded inputs and the Python controller's outputs.
        residual: Artifact of a learned policy.
        rate: Largest rate of every entry of the policy's action [1/s].
        extra: Additional files of the folder.
        robot: The robot; a learned policy requires the nominal one.
        presets: Names of the flight presets; those of `exported` if None.
        fragile: Whether presets are exported whatever their margins are.
        name: Name of the parameter file, `parameters/NAME.txt`.
        world: Calibrated world over whose robots the margins are the worst ones, by name or file.

    Raises:
        UnknownNameError: For a preset that does not exist.
        SpidarError: If the artifact cannot be read or exported, or is combined with another robot; for a preset whose
            worst margins over the robots of the calibrated world are below those of `spidar_gym.margins`.
    """
    files: dict[str, bytes] = dict(extra or {})
    artifact, origin = None, None
    presets = exported(robot) if presets is None else presets
    if not presets:
        raise InvalidValueError("presets", list(presets), "at least one flight preset")
    if residual is not None and robot != ROBOT:
        raise InvalidValueError("residual", str(residual), "none: it was learned on the nominal robot, not on this one")
    if not fragile:
        require_margins(presets, robot, world)
    if residual is not None:
        residual = artifact_file(residual)
        artifact = read_artifact(residual)
        origin = {
            "name": artifact.name,
            "sha256": hashlib.sha256(residual.read_bytes()).hexdigest(),
            "env_id": artifact.env_id,
            "arguments": dict(artifact.arguments),
            "rate": rate,
        }
    for part, (sources, pattern) in PARTS.items():
        for source in sorted(sources.glob(pattern)):
            files[f"{part}/{source.name}"] = source_bytes(source)
    for page in PAGES:
        files[page] = source_bytes(ONBOARD / page)
    parameters = parameters_text(parameters_record(robot, presets))
    files[f"parameters/{name}.txt"] = parameters
    generated = {
        "constants": constants_header(), "structs": structs_header(), "modes": modes_header(),
        "model": model_header(robot), "presets": presets_header(presets, robot, digest_of(parameters)),
        "policy": policy_header(artifact, rate),
        "runner": runner_header(), "fields": fields_header(), "interface": interface_header(interface_hash()),
    }  # fmt: skip
    files |= {f"generated/spidar_{each}.h": text.encode() for each, text in generated.items()}
    files |= {f"osqp/{each}": data for each, data in osqp_files().items()}
    files["topics.toml"] = topics_file(robot)
    if golden:
        files |= golden_files(robot)
    manifest = {
        "interface": runner_hash(),
        "versions": {
            "spidar-gym": spidar_gym.__version__,
            "osqp": osqp_version(),
            **{each: version(each) for each in ("pin", "numpy")},
        },
        "worlds": {each: find_world(each).digest for each in world_names()},
        "presets": {"flight": list(presets), "margins": "not checked" if fragile else "held"},
        "residual": origin,
        "sha256": {each: hashlib.sha256(data).hexdigest() for each, data in sorted(files.items())},
    }
    files["MANIFEST.json"] = (json.dumps(manifest, indent=1) + "\n").encode()
    return files


def export(
    folder: Path, *, residual: Path | None = None, rate: float = RATE, extra: Mapping[str, bytes] | None = None,
    robot: RobotSpec = ROBOT, presets: Sequence[str] | None = None, fragile: bool = False,
    name: str = "spidar", world: str = WORLD,
) -> list[str]:  # fmt: skip
    """Write the folder, completely or not at all; returns the names of its files.

    `residual`, `rate`, `extra`, `robot`, `presets`, `fragile`, `name` and `world` are as for `export_files`.

    Raises:
        SpidarError: If the folder holds other files or cannot be written.
    """
    folder = Path(os.path.realpath(folder))  # keep a link to a folder, write the folder
    try:
        free = not folder.exists() or not any(folder.iterdir()) or (folder / "MANIFEST.json").is_file()
    except OSError as error:
        raise cannot_write(folder, error) from error
    if not free:
        raise SpidarError(f"{folder} holds something else; valid: a new or empty folder, or one exported before")
    with whole_file(folder) as made:
        files = export_files(
            residual=residual,
            rate=rate,
            extra=extra,
            robot=robot,
            presets=presets,
            fragile=fragile,
            name=name,
            world=world,
        )
        write_files(files, made)
    return sorted(files)


def write_files(files: dict[str, bytes], folder: Path) -> None:
    """Write files (path → content) under a folder."""
    for name, data in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
