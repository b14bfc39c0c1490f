"""Rows of the leaderboard: JSON files with the origin of all their numbers, protected by a hash."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from spidar_gym.benchmark.content import RowError, check_content
from spidar_gym.benchmark.evaluate import Score
from spidar_gym.benchmark.track import REFERENCES, SCENARIOS, SECOND, TRACKS
from spidar_gym.committed import ROOT, committed
from spidar_gym.errors import InvalidValueError, SpidarError
from spidar_gym.files import write_text
from spidar_gym.policies.policy import (
    LEARNED,
    READABLE,
    Policy,
    policy_arguments,
    policy_digest,
    policy_doc,
    policy_kind,
    policy_name,
)
from spidar_gym.policies.provenance import processor, versions
from spidar_gym.robot.description import model_hash
from spidar_gym.sim.worlds import World

FORMAT = 2
"""Version of the rows' format."""
LARGEST = 2**26
"""Largest file of a row [bytes]: some hundred runs on every track."""
REFERENCE = "qp"
"""The row that scores refer to."""
BASES = {"paper": "qp", "as_flown": "qp_as_flown", "as_flown_quasi": "qp_as_flown_quasi", "tuned": "qp_tuned",
         "tuned_v1": "qp_tuned_v1", "retuned": "qp_retuned",
         "published": "qp", "robust": "qp_tuned", "overlapped": "qp_overlapped",
         "robust_overlapped": "qp_robust_overlapped", "robust_overlapped_v1": "qp_robust_overlapped_v1",
         "robust_retuned": "qp_retuned", "steady": "qp_steady", "steady_crawl": "qp_steady"}  # fmt: skip
"""Preset → the row of its controller, with which residuals on this preset are compared."""
ROWS = "baselines/scores"
"""Folder of the committed rows."""


@dataclass(frozen=True)
class Row:
    """One row of the leaderboard."""

    name: str
    """Name of the policy."""
    kind: str
    """One of `KINDS`."""
    doc: str
    """Description in one line."""
    policies: tuple[str, ...]
    """Specification of each run: one for a deterministic controller, one per training seed for a learned policy."""
    content: Mapping[str, Any]
    """Content of the file."""
    added: tuple["Row", ...] = ()
    """Rows of the same runs on further tracks, each from a separate file."""
    second: "Row | None" = None
    """Row of the same runs on the second draw of the calibrated tracks, from a separate file."""

    @property
    def tracks(self) -> list[str]:
        """Evaluated tracks, in the order of `TRACKS`."""
        return [name for name in TRACKS if any(name in part.content["tracks"] for part in (self, *self.added))]

    def part(self, track: str) -> "Row":
        """Return the row of the file that contains a track (`KeyError` if none does)."""
        for part in (self, *self.added):
            if track in part.content["tracks"]:
                return part
        raise KeyError(track)

    @property
    def files(self) -> list["Row"]:
        """The row of each file: this one, those of further tracks, and that of the second draw."""
        return [self, *self.added, *([] if self.second is None else [self.second])]

    @property
    def base(self) -> str:
        """Row of the controller to which a residual adds; empty for other policies and unknown controllers."""
        chosen = self.content.get("arguments") or {}
        return BASES.get(str(chosen.get("preset", "")), "") if self.kind == "residual" else ""

    def errors(self, track: str) -> np.ndarray:
        """Return the errors, shape (runs, scenarios)."""
        return np.array([run["error"] for run in self.part(track).content["tracks"][track]["runs"]], float)

    def column(self, track: str, metric: str) -> np.ndarray:
        """Return a metric, shape (runs, scenarios); NaN where it is not defined."""
        return np.array([run[metric] for run in self.part(track).content["tracks"][track]["runs"]], float)

    def split(self, track: str) -> str:
        """Return the split of a track's scenarios."""
        return self.part(track).content["tracks"][track]["split"]

    def scenarios(self, track: str) -> list[int]:
        """Return the indices of the evaluated scenarios of a track."""
        return self.part(track).content["tracks"][track]["scenarios"]


def make_row(
    policies: Sequence[Policy],
    specs: Sequence[str],
    scores: Mapping[str, Sequence[Score]],
    *,
    command: str,
) -> Row:
    """Create the row of a policy.

    Args:
        policies: Policy of each run.
        specs: Specification of each run.
        scores: Track → score of each run.
        command: Command line that reproduces the row.
    """
    first = policies[0]
    require_one_policy(policies, specs)
    training = [getattr(policy, "training", None) for policy in policies]
    tracks, times = {}, {}
    for track, runs in scores.items():
        if len({(run.split, run.indices) for run in runs}) > 1 or len(runs) != len(policies):
            raise InvalidValueError("scores", track, "a score for each run, on the same scenarios")
        steps = np.array([t["step_s"] for run in runs for t in run.timing])
        acts = np.array([t["act_s"] for run in runs for t in run.timing])
        tracks[track] = {
            "split": runs[0].split,
            "scenarios_sha256": runs[0].scenarios_sha256,
            "scenarios": list(runs[0].indices),
            **({} if (world := TRACKS[track].calibration) is None else {"world": world_words(world)}),
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
        "given": ["observation", "run", *(["state"] if _sees_the_state(first, scores) else [])],
        **_arguments(first, scores),
        "command": command,
        "versions": versions(),
        "processor": processor(),
        "model_sha256": model_hash(),
        "tracks": tracks,
        "timing": times,
    }
    check_content(content)
    content["sha256"] = row_hash(content)
    return row_of(content)


def world_words(world: World) -> dict[str, str]:
    """Return name and hash of a calibrated world as recorded in a row."""
    return {"name": world.name, "sha256": world.digest}


def _sees_the_state(policy: Policy, scores: Mapping[str, Sequence[Score]]) -> bool:
    """Return whether the policy has a custom allocator or law, which are called with the robot's whole state."""
    chosen = [policy_arguments(policy, TRACKS[track].env_id) or {} for track in scores]
    return any(name in READABLE for arguments in chosen for name in arguments)


def _arguments(policy: Policy, scores: Mapping[str, Sequence[Score]]) -> dict[str, Any]:
    """Return the environment arguments of a learned policy; nothing for a controller, whose code specifies them."""
    if policy_kind(policy) not in LEARNED:
        return {}
    chosen = policy_arguments(policy, TRACKS[next(iter(scores))].env_id) or {}
    plain = {name: value for name, value in chosen.items() if isinstance(value, str | int | float)}
    return {"arguments": plain} if plain else {}


def require_one_policy(policies: Sequence[Policy], specs: Sequence[str]) -> None:
    """Refuse runs of different policies, and descriptions that are invalid in a row."""
    for policy in policies:
        policy_doc(policy)
    if len({(policy_name(policy), policy_kind(policy)) for policy in policies}) > 1:
        raise InvalidValueError("policies", list(specs), "runs of one policy: the same name and kind")


def row_of(content: Mapping[str, Any]) -> Row:
    """Create a row from the content of its file."""
    return Row(content["name"], content["kind"], content["doc"], tuple(content["policies"]), content)


def row_hash(content: Mapping[str, Any]) -> str:
    """Return the SHA-256 of a row without the hash and the block `timing`; the processor's name is included."""
    kept = {key: value for key, value in content.items() if key not in ("sha256", "timing")}
    return hashlib.sha256(json.dumps(kept, sort_keys=True, ensure_ascii=False).encode()).hexdigest()


def row_text(row: Row) -> str:
    """Format the row's file, one line per metric."""
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
    """Write a row atomically and return its path."""
    path = folder / f"{row.name}.json"
    write_text(path, row_text(row))
    return path


def read_content(path: Path) -> dict[str, Any]:
    """Read a row's file and check its hash only.

    Raises:
        RowError: When it cannot be read, is not a JSON object, contains a non-finite number, or was edited by hand.
    """
    try:
        if path.is_file() and path.stat().st_size > LARGEST:
            raise RowError(f"{path} is larger than {LARGEST} bytes; valid: a row that `spidar eval` wrote")
        content = json.loads(path.read_text(encoding="utf-8"), parse_constant=_refuse)
        _require_finite(content)
        digest = row_hash(content) if isinstance(content, dict) else ""
    except OSError as error:
        raise RowError(f"{path}: {error.strerror}; valid: a row that `spidar eval` wrote") from error
    except (ValueError, RecursionError) as error:
        raise RowError(f"{path} is no JSON of a row ({error}); valid: a row that `spidar eval` wrote") from error
    if not (isinstance(content, dict) and type(content.get("format")) is int):
        raise RowError(f"{path} is no row of format {FORMAT}; valid: a row that `spidar eval` wrote")
    if content.get("sha256") != digest:
        raise RowError(f"{path} was edited by hand: its hash does not match; valid: the row that `spidar eval` writes")
    return content


def _refuse(word: str) -> NoReturn:
    """Refuse NaN and infinity, which a row must not contain."""
    raise ValueError(f"{word} is no finite number")


def _require_finite(content: object) -> None:
    """Refuse numbers like `1e999`, which `json` reads as infinity; `json.dumps` checks all numbers fast, in C."""
    try:
        json.dumps(content, allow_nan=False)
    except ValueError:
        _refuse("a number in it")


def read_row(path: Path) -> Row:
    """Read and check a row; a missing `baselines/scores/…` is read from the committed files.

    Raises:
        RowError: When it cannot be read, was edited by hand, has another format or invalid content, or its scenarios
            or robot model are not the current ones.
    """
    path = committed(path)
    content = read_content(path)
    if content["format"] != FORMAT:
        raise RowError(f"{path} is no row of format {FORMAT}; valid: a row that `spidar eval` wrote")
    try:
        check_content(content)
    except SpidarError as error:
        raise RowError(f"{path}: {error}") from error
    return row_of(content)


def row_files(folder: Path, name: str = "*") -> list[Path]:
    """Return the row files of a folder, then those of its subfolders: of groups of tracks, and of the second draw.

    Groups of tracks that were added later have subfolders, so that older files keep their processor, versions and hash.
    """
    places = dict.fromkeys(track.folder for track in TRACKS.values())
    return [path for place in ("", *places, SECOND) for path in sorted((folder / place).glob(f"{name}.json"))]


def read_rows(folder: Path, name: str = "*") -> dict[str, Row]:
    """Read the rows of a folder by name, the reference first, or a single row; files of one name are joined.

    A missing `baselines/scores` is read from the committed files.

    Raises:
        RowError: For a folder without rows, an invalid row, and files of one name that cannot be joined.
    """
    folder = committed(folder)
    if not folder.is_dir():
        raise RowError(f"{folder} is no folder; valid: one with rows that `spidar eval` wrote")
    rows: dict[str, Row] = {}
    for path in row_files(folder, name):
        row = read_row(path)
        if path.parent == folder / SECOND:
            rows[row.name] = _with_second(rows.get(row.name), row, path)
        else:
            rows[row.name] = _joined(rows[row.name], row, path, folder) if row.name in rows else row
    if not rows:
        raise RowError(f"{folder} has no rows; valid: a folder with rows that `spidar eval` wrote")
    return {name: rows[name] for name in sorted(rows, key=lambda name: (name != REFERENCE, name))}


def _joined(row: Row, other: Row, path: Path, folder: Path) -> Row:
    """Join a row with a row of the same runs on other tracks, from the subfolder of a group."""
    both = set(row.tracks) & set(other.tracks)
    if path.parent == folder:
        raise RowError(f"{path} is a second row {row.name}; valid: one file a row")
    if both:
        raise RowError(f"{path} has {', '.join(sorted(both))} a second time; valid: tracks that row {row.name} lacks")
    _require_same(row, other, path)
    return replace(row, added=(*row.added, other))


def _with_second(row: Row | None, other: Row, path: Path) -> Row:
    """Join a row with the row of the same runs on the second draw."""
    if row is None:
        raise RowError(f"{path} is a second draw without a first; valid: beside a row of the same policies")
    if any(other.split(track) != SECOND for track in other.tracks):
        raise RowError(f"{path} has other scenarios; valid: those of `spidar eval --split {SECOND}`")
    _require_same(row, other, path)
    return replace(row, second=other)


def _require_same(row: Row, other: Row, path: Path) -> None:
    """Refuse a row of other policies than those of the row with which it is joined."""
    if any(row.content[key] != other.content[key] for key in ("kind", "policies", "policies_sha256")):
        raise RowError(f"{path} is of other policies than row {row.name}; valid: the same ones, or another name")


def committed_rows() -> dict[str, Row]:
    """Read the committed rows."""
    folder = _committed_folder(REFERENCE)
    return {} if folder is None else read_rows(folder)


def committed_row(name: str = REFERENCE) -> Row | None:
    """Read a committed row, by default the reference; None if there is none."""
    folder = _committed_folder(name)
    return None if folder is None else read_rows(folder, name)[name]


def committed_references(split: str = "test") -> dict[str, Row]:
    """Read the committed reference rows: of the second draw for its split, else of the test scenarios."""
    found = {name: committed_row(name) for name in dict.fromkeys(REFERENCES.values())}
    own = {name: row and row.second if split == SECOND else row for name, row in found.items()}
    return {name: row for name, row in own.items() if row is not None}


def _committed_folder(name: str) -> Path | None:
    folders = (Path(ROWS), ROOT / ROWS)
    return next((folder for folder in folders if (folder / f"{name}.json").is_file()), None)


def among_committed(own: Mapping[str, Row]) -> tuple[dict[str, Row], list[str]]:
    """Merge the user's rows with the committed rows; returns all rows, and the new names of the user's rows.

    References are always committed rows: a user's row with the name of a committed row is renamed `NAME (own)`.
    """
    rows, names = committed_rows(), []
    for name, row in own.items():
        if name in rows and _hashes(rows[name]) >= _hashes(row):
            continue
        names.append(f"{name} (own)" if name in rows else name)
        rows[names[-1]] = row
    return rows, names


def _hashes(row: Row) -> set[str]:
    """Return the hashes of a row's files."""
    return {part.content["sha256"] for part in row.files}


def eval_command(specs: Sequence[str], tracks: Sequence[str], split: str = "test", scenarios: int = SCENARIOS) -> str:
    """Return the command that evaluates a row again, with the options that differ from the defaults."""
    words = ["eval", "--policy", *specs, *(["--tracks", *tracks] if tracks else [])]
    words += [] if split == "test" else ["--split", split]
    words += [] if scenarios == SCENARIOS else ["--scenarios", str(scenarios)]
    return " ".join(["spidar", *words])
