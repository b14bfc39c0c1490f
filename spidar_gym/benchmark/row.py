"""A row of the leaderboard: one JSON file with everything that its numbers rest on, and a hash that guards it."""

import hashlib
import json
import os
import platform
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

import spidar_gym
from spidar_gym.benchmark.episode import METRICS
from spidar_gym.benchmark.evaluate import Score
from spidar_gym.benchmark.policy import (
    KINDS,
    Policy,
    check_name,
    policy_arguments,
    policy_digest,
    policy_doc,
    policy_kind,
    policy_name,
)
from spidar_gym.benchmark.scenario import load_scenarios
from spidar_gym.benchmark.track import SCENARIOS, SPLITS, TRACKS
from spidar_gym.description import assets_dir, mjcf_path
from spidar_gym.errors import InvalidValueError, SpidarError, require_name
from spidar_gym.files import write_text

FORMAT = 1
"""Version of the rows' format."""
PACKAGES = ("mujoco", "numpy", "scipy", "pin", "osqp", "gymnasium")
"""Packages whose versions stand in a row, beside Python's and our own."""
REFERENCE = "qp"
"""The row that scores refer to."""
BASES = {"paper": "qp", "tuned": "qp_tuned", "published": "qp", "robust": "qp_tuned", "overlapped": "qp_overlapped",
         "robust_overlapped": "qp_robust_overlapped"}  # fmt: skip
"""Preset → the row of that controller, with which what adds to it is compared."""
ROWS = "baselines/scores"
"""Folder of the committed rows in a checkout."""


class RowError(SpidarError):
    """A row's file that cannot be read, was edited by hand, or belongs to other scenarios."""


@dataclass(frozen=True)
class Row:
    """One line of the leaderboard."""

    name: str
    """Of the policy."""
    kind: str
    """`classical`, `learned` or `residual`."""
    doc: str
    """What it is, in one line."""
    policies: tuple[str, ...]
    """Specification of each run: one for a deterministic controller, one a training seed for a learned one."""
    content: Mapping[str, Any]
    """The file, whole."""

    @property
    def tracks(self) -> list[str]:
        """Tracks on which it was evaluated, in the table's order."""
        return [name for name in TRACKS if name in self.content["tracks"]]

    @property
    def base(self) -> str:
        """Name of the row of the controller that it adds to; empty where it adds to none that is known."""
        chosen = self.content.get("arguments") or {}
        return BASES.get(str(chosen.get("preset", "")), "") if self.kind == "residual" else ""

    def errors(self, track: str) -> np.ndarray:
        """Error of every run on every scenario, shape (runs, scenarios)."""
        return np.array([run["error"] for run in self.content["tracks"][track]["runs"]], float)

    def column(self, track: str, metric: str) -> np.ndarray:
        """A metric of every run on every scenario, NaN where it has no meaning."""
        return np.array([run[metric] for run in self.content["tracks"][track]["runs"]], float)

    def scenarios(self, track: str) -> list[int]:
        """Indices of the scenarios that were played."""
        return self.content["tracks"][track]["scenarios"]


def model_hash() -> str:
    """SHA-256 of the robot's model file."""
    return hashlib.sha256(mjcf_path().read_bytes()).hexdigest()


def versions() -> dict[str, str]:
    """Versions of what the numbers rest on."""
    found = {"python": platform.python_version(), "spidar-gym": spidar_gym.__version__}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = ""
    return found


def processor() -> str:
    """Family of the processor: what decides which machine code numpy and its libraries choose."""
    words = {}
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            key, _, value = line.partition(":")
            words.setdefault(key.strip(), value.strip())
    except OSError:
        pass
    family = " ".join(words.get(key, "") for key in ("vendor_id", "cpu family", "model")).strip()
    wide = [flag for flag in ("avx2", "avx512f") if flag in words.get("flags", "").split()]
    return " ".join([platform.machine(), family or platform.processor(), *wide]).strip()


def make_row(
    policies: Sequence[Policy],
    specs: Sequence[str],
    scores: Mapping[str, Sequence[Score]],
    *,
    command: str,
) -> Row:
    """The row of a policy.

    Args:
        policies: One for each run.
        specs: Their specifications.
        scores: For each track the score of each run.
        command: What was called.
    """
    first = policies[0]
    require_one_policy(policies, specs)
    for track, runs in scores.items():
        if len({(run.split, run.indices) for run in runs}) > 1 or len(runs) != len(policies):
            raise InvalidValueError("scores", track, "a score for each run, on the same scenarios")
    training = [getattr(policy, "training", None) for policy in policies]
    tracks, times = {}, {}
    for track, runs in scores.items():
        steps = np.array([t["step_s"] for run in runs for t in run.timing])
        acts = np.array([t["act_s"] for run in runs for t in run.timing])
        tracks[track] = {
            "split": runs[0].split,
            "scenarios_sha256": runs[0].scenarios_sha256,
            "scenarios": list(runs[0].indices),
            "runs": [run.metrics for run in runs],
        }
        times[track] = {
            "step_ms_p50_p99": (1e3 * np.median(steps, axis=0)).round(3).tolist(),
            "policy_ms_p50_p99": (1e3 * np.median(acts, axis=0)).round(3).tolist(),
            "wall_s": round(float(sum(t["wall_s"] for run in runs for t in run.timing)), 1),
        }
    content: dict[str, Any] = {
        "format": FORMAT,
        "name": policy_name(first),
        "kind": policy_kind(first),
        "doc": policy_doc(first),
        "policies": list(specs),
        "policies_sha256": [policy_digest(policy) for policy in policies],
        "training": training if any(training) else None,
        **_arguments(first, scores),
        "command": command,
        "versions": versions(),
        "model_sha256": model_hash(),
        "tracks": tracks,
        "timing": {"processor": processor(), "tracks": times},
    }
    content["sha256"] = row_hash(content)
    return _row(content)


def _arguments(policy: Policy, scores: Mapping[str, Sequence[Score]]) -> dict[str, Any]:
    """What a learned policy asked its environment for; nothing for a controller, whose code says it."""
    if policy_kind(policy) == "classical":
        return {}
    chosen = policy_arguments(policy, TRACKS[next(iter(scores))].env_id) or {}
    plain = {name: value for name, value in chosen.items() if isinstance(value, str | int | float)}
    return {"arguments": plain} if plain else {}


def require_one_policy(policies: Sequence[Policy], specs: Sequence[str]) -> None:
    """Refuse runs of different policies."""
    if len({(policy_name(policy), policy_kind(policy)) for policy in policies}) > 1:
        raise InvalidValueError("policies", list(specs), "runs of one policy: the same name and kind")


def _row(content: Mapping[str, Any]) -> Row:
    return Row(content["name"], content["kind"], content["doc"], tuple(content["policies"]), content)


def row_hash(content: Mapping[str, Any]) -> str:
    """SHA-256 of a row but for itself and the `timing` block."""
    kept = {key: value for key, value in content.items() if key not in ("sha256", "timing")}
    return hashlib.sha256(json.dumps(kept, sort_keys=True, ensure_ascii=False).encode()).hexdigest()


def row_text(row: Row) -> str:
    """The row's file: one line a metric."""
    content = dict(row.content)
    tracks, timing, digest = content.pop("tracks"), content.pop("timing"), content.pop("sha256")
    lines = ["{"]
    lines += [f" {json.dumps(key)}: {json.dumps(value, ensure_ascii=False)}," for key, value in content.items()]
    lines.append(' "tracks": {')
    for k, (name, track) in enumerate(tracks.items()):
        lines.append(f"  {json.dumps(name)}: {{")
        lines += [f"   {json.dumps(key)}: {json.dumps(value)}," for key, value in track.items() if key != "runs"]
        runs = []
        for run in track["runs"]:
            metrics = [f"     {json.dumps(key)}: {json.dumps(values)}" for key, values in run.items()]
            runs.append("    {\n" + ",\n".join(metrics) + "\n    }")
        lines.append('   "runs": [\n' + ",\n".join(runs) + "\n   ]")
        lines.append("  }" + ("," if k < len(tracks) - 1 else ""))
    lines += [" },", f' "timing": {json.dumps(timing)},', f' "sha256": {json.dumps(digest)}', "}"]
    return "\n".join(lines) + "\n"


def write_row(row: Row, folder: Path) -> Path:
    """Write a row whole or not at all; its path."""
    path = folder / f"{row.name}.json"
    write_text(path, row_text(row))
    return path


def read_row(path: Path) -> Row:
    """A row from its file.

    Raises:
        RowError: When it cannot be read, was edited by hand, or its scenarios or model are not the present ones.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise RowError(f"{path}: {error.strerror}; valid: a row that `spidar eval` wrote") from error
    except ValueError as error:
        raise RowError(f"{path} is no JSON ({error}); valid: a row that `spidar eval` wrote") from error
    if not (isinstance(content, dict) and content.get("format") == FORMAT):
        raise RowError(f"{path} is no row of format {FORMAT}; valid: a row that `spidar eval` wrote")
    if content.get("sha256") != row_hash(content):
        raise RowError(f"{path} was edited by hand: its hash does not match; valid: the row that `spidar eval` writes")
    try:
        _check_content(content)
    except (KeyError, TypeError, AttributeError) as error:
        raise RowError(f"{path} lacks {error}; valid: a row that `spidar eval` wrote") from error
    except SpidarError as error:
        raise RowError(f"{path}: {error}") from error
    return _row(content)


def _check_content(content: Mapping[str, Any]) -> None:
    """Whether a row has all its parts, of the present robot and scenarios."""
    anew = "valid: a row evaluated anew by its command"
    if content["model_sha256"] != model_hash():
        raise RowError(f"another robot model; {anew}")
    require_name("kind", content["kind"], KINDS)
    check_name(content["name"])
    runs = len(content["policies"])
    if not {"doc", "command", "versions", "training"} <= set(content) or not {"processor", "tracks"} <= set(
        content["timing"]
    ):
        raise RowError("it lacks where it comes from; valid: a row that `spidar eval` wrote")
    if len(content["policies_sha256"]) != runs or not runs:
        raise RowError("as many policies as hashes are valid, at least one")
    for name, track in content["tracks"].items():
        require_name("split", track["split"], SPLITS)
        if name not in TRACKS or load_scenarios(name, track["split"])[1] != track["scenarios_sha256"]:
            raise RowError(f"{name} has other scenarios; {anew}")
        if len(track["runs"]) != runs:
            raise RowError(f"{name} has {len(track['runs'])} runs; valid: {runs}, one a policy")
        _check_numbers(name, track)


def _check_numbers(name: str, track: Mapping[str, Any]) -> None:
    """Whether a track has a number for each scenario, of each metric and run."""
    indices = track["scenarios"]
    if len(set(indices)) != len(indices) or not set(indices) <= set(range(SCENARIOS)) or not indices:
        raise RowError(f"{name} has scenarios {indices}; valid: different ones within 0 … {SCENARIOS - 1}")
    for run in track["runs"]:
        for metric in METRICS:
            if metric not in run:
                raise RowError(f"{name} lacks {metric}; valid: a row evaluated anew by its command")
            if len(run[metric]) != len(indices):
                raise RowError(f"{name} has {len(run[metric])} numbers of {metric}; valid: {len(indices)}")


def read_rows(folder: Path) -> dict[str, Row]:
    """Every row of a folder by name, the reference first."""
    if not folder.is_dir():
        raise RowError(f"{folder} is no folder; valid: one with rows that `spidar eval` wrote")
    rows: dict[str, Row] = {}
    for path in sorted(folder.glob("*.json")):
        row = read_row(path)
        if row.name in rows:
            raise RowError(f"{path} is a second row {row.name}; valid: one file a row")
        rows[row.name] = row
    if not rows:
        raise RowError(f"{folder} has no rows; valid: a folder with rows that `spidar eval` wrote")
    return {name: rows[name] for name in sorted(rows, key=lambda name: (name != REFERENCE, name))}


def committed_row(name: str = REFERENCE) -> Row | None:
    """A committed row of a checkout or of the installed wheel, the one that scores refer to; None if there is none."""
    candidates = (Path(ROWS) / f"{name}.json", assets_dir() / "scores" / f"{name}.json",
                  assets_dir().parent / ROWS / f"{name}.json")  # fmt: skip
    path = next((path for path in candidates if path.is_file()), None)
    return None if path is None else read_row(path)


def called(arguments: Sequence[str] | None = None) -> str:
    """The command that is being run, in words."""
    given = sys.argv[1:] if arguments is None else arguments
    return " ".join(["spidar", *given])


def eval_command(specs: Sequence[str], tracks: Sequence[str], split: str = "test", scenarios: int = SCENARIOS) -> str:
    """The command with which anybody evaluates a row again: what is not by default, and nothing else."""
    words = ["eval", "--policy", *specs, *(["--tracks", *tracks] if tracks else [])]
    words += [] if split == "test" else ["--split", split]
    words += [] if scenarios == SCENARIOS else ["--scenarios", str(scenarios)]
    return called(words)


def cores() -> int:
    """Processes by default: one a core that this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:
        return os.cpu_count() or 1
