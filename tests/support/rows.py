"""Rows of the leaderboard with invented metrics."""

import json
from copy import deepcopy

from spidar_gym.benchmark.evaluate import Score
from spidar_gym.benchmark.metrics import told_in
from spidar_gym.benchmark.row import make_row, row_hash
from spidar_gym.benchmark.scenario import load_scenarios
from spidar_gym.benchmark.track import CAP, TRACKS
from spidar_gym.policies.presets import PresetPolicy

SPEC = "spidar_gym.policies.presets:PresetPolicy"
"""Policy of every run of a made row: it can be loaded, and is never evaluated."""
TRACK = "flight-fast5"


def policy(name="qp", kind="classical", doc="What it is.", training=None, arguments=None):
    made = PresetPolicy()
    made.name, made.kind, made.training, made.__doc__ = name, kind, training, doc
    made.arguments = lambda env_id: arguments or {}
    return made


def score(track, errors, *, indices=None, split="test", steps=0.001, **columns):
    """A score with invented metrics; a scenario at the cap has failed."""
    n, world = len(errors), TRACKS[track].world
    plain = {float: 0.5, int: 0}
    metrics = {name: [plain.get(m.kind) if world in m.worlds else None] * n for name, m in told_in(world).items()}
    failed = [error >= CAP for error in errors]
    metrics |= {"error": list(errors), "failed": failed, "success": [error < 1.0 for error in errors]}
    metrics |= {"failure": ["tilt" if lost else "" for lost in failed], "energy_wh": [10.0 + error for error in errors]}
    metrics |= {"violations": [0.0] * n} if "violations" in metrics else {}
    metrics |= {"unsolved": list(range(n)), "attitude_rms_rad": [0.1 * e for e in errors]}
    timing = [{"act_s": [1e-5, 2e-5], "step_s": [steps, 3.0 * steps], "wall_s": 0.5} for _ in errors]
    digest = load_scenarios(track, split)[1]
    return Score(track, split, digest, tuple(indices or range(n)), metrics | columns, timing)


def made_row(scores, name="qp", kind="classical", *, doc="What it is.", training=None, arguments=None, **options):
    """A row from the errors, or the scores, of every run on each track."""
    scores = {
        track: [run if isinstance(run, Score) else score(track, run, **options) for run in runs]
        for track, runs in scores.items()
    }
    runs = max(map(len, scores.values()))
    policies = [policy(name, kind, doc, training, arguments) for _ in range(runs)]
    return make_row(policies, [SPEC] * runs, scores, command=f"spidar eval --policy {name}")


def changed(row, change):
    """The row's content after a change, with the hash of the new one."""
    content = deepcopy(dict(row.content))
    change(content)
    content["sha256"] = row_hash(content)
    return content


def stored(content, folder, name="row.json"):
    path = folder / name
    path.write_text(json.dumps(content), encoding="utf-8")
    return path
