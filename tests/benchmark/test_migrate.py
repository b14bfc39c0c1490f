"""Pins the migration of rows: an older format, and policies that differ in moved imports alone; metrics stay."""

import hashlib
import json
from copy import deepcopy

import pytest
from support.rows import TRACK, changed, made_row, stored

from spidar_gym.benchmark.migrate import MOVED, migrate
from spidar_gym.benchmark.row import RowError, read_row, row_of, row_text
from spidar_gym.benchmark.track import CAP
from spidar_gym.cli.main import main
from spidar_gym.policies.provenance import file_digest


@pytest.fixture
def row():
    """Two runs on a flight, two on a crawl, of which one failed."""
    scores = {"ground-paper": [[0.8, CAP], [0.9, 0.1 + 0.2]], TRACK: [[0.5, 1e-300, 1.75], [0.25, 0.7, 1.0 / 3.0]]}
    return made_row(scores, "sham", "residual", doc='½ of ‖x‖, "quoted" | piped.', training={"seed": 3, "steps": 10})


def as_format_1(row):
    """The file that earlier versions wrote of the same evaluation: processor beside the times, outside the hash."""
    content = {key: value for key, value in row.content.items() if key not in ("processor", "timing", "sha256")}
    content["format"] = 1
    text = json.dumps(content, sort_keys=True, ensure_ascii=False)
    timing = {"processor": row.content["processor"], "tracks": row.content["timing"]}
    return {**content, "timing": timing, "sha256": hashlib.sha256(text.encode()).hexdigest()}


def test_a_row_of_format_1_is_migrated_and_no_metric_changes(row, tmp_path, capfd):
    path = stored(as_format_1(row), tmp_path)
    with pytest.raises(RowError, match=r"no row of format 2; .* `spidar leaderboard migrate --rows .*` makes it one"):
        read_row(path)
    main(["leaderboard", "migrate", "--rows", str(tmp_path)])
    assert "1 of 1 rows" in capfd.readouterr().out
    assert read_row(path) == row
    assert path.read_text(encoding="utf-8") == row_text(row)
    assert not migrate(path)


def test_a_row_of_format_1_that_was_edited_by_hand_or_holds_nonsense_is_not_migrated(row, tmp_path):
    old = as_format_1(row)
    edited = deepcopy(old)
    edited["tracks"][TRACK]["runs"][0]["error"][0] *= 0.5
    path = stored(edited, tmp_path)
    with pytest.raises(RowError, match="edited by hand"):
        migrate(path)
    for change in (lambda c: c.update(timing=3), lambda c: c.pop("timing"), lambda c: c["timing"].pop("processor"),
                   lambda c: c.pop("tracks"), lambda c: c.update(doc="a\nb")):  # fmt: skip
        stored(changed(row_of(old), change), tmp_path)
        before = path.read_bytes()
        with pytest.raises(RowError, match=r"row\.json"):
            migrate(path)
        assert path.read_bytes() == before


POLICY = "".join(now for now, _ in MOVED) + "\n\nclass Mine:\n    '''A policy.'''\n"
"""A policy's file, with every line of import that has moved."""


def before_the_move(text):
    for now, before in MOVED:
        text = text.replace(now, before)
    return text


def of_mine(row, folder, evaluated):
    """The file of a row of `mine:Mine`, evaluated when its file was `evaluated`."""
    digest = hashlib.sha256(evaluated.encode()).hexdigest()
    runs = len(row.policies)
    origin = {"policies": ["mine:Mine"] * runs, "policies_sha256": [digest] * runs}
    return stored(changed(row, lambda content: content.update(origin)), folder)


@pytest.fixture
def mine(tmp_path, monkeypatch):
    """The policy's file as it is, in the working folder."""
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "mine.py"
    file.write_text(POLICY, encoding="utf-8")
    return file


def test_a_policy_whose_imports_alone_have_moved_gets_the_hash_of_its_file_and_no_more(row, mine, tmp_path):
    path = of_mine(row, tmp_path, before_the_move(POLICY))
    old = read_row(path)
    assert migrate(path)
    new = read_row(path)
    assert new.content["policies_sha256"] == [file_digest(mine)] * len(row.policies)
    apart = {"policies_sha256", "sha256"}
    assert {k: v for k, v in new.content.items() if k not in apart} == {
        k: v for k, v in old.content.items() if k not in apart
    }
    assert not migrate(path)


@pytest.mark.parametrize(
    "evaluated",
    [
        before_the_move(POLICY) + "\n",
        before_the_move(POLICY).replace("A policy.", "Another policy."),
        before_the_move(POLICY).replace("import", "import  ", 1),
        POLICY + "    gain = 2.0\n",
        POLICY,
    ],
    ids=["a line more", "another word", "a space", "a number", "none"],
)
def test_a_policy_that_differs_in_anything_else_keeps_its_hash(row, mine, tmp_path, evaluated):
    path = of_mine(row, tmp_path, evaluated)
    before = path.read_bytes()
    assert not migrate(path)
    assert path.read_bytes() == before


def test_a_policy_that_is_not_there_keeps_its_hash(row, mine, tmp_path):
    path = of_mine(row, tmp_path, before_the_move(POLICY))
    mine.unlink()
    assert not migrate(path)
