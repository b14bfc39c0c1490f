"""An adversary's rows: flipped bytes, or exchanged parts with a valid hash; each is refused in one line, or sound."""

import json
import math
import re
from copy import deepcopy

import numpy as np
from support.rows import TRACK, made_row, score

from spidar_gym.benchmark.leaderboard import as_json, tabulate
from spidar_gym.benchmark.leaderboard_tables import markdown, text
from spidar_gym.benchmark.metrics import told_in
from spidar_gym.benchmark.row import RowError, read_row, row_hash, row_text
from spidar_gym.benchmark.track import CAP, TRACKS
from spidar_gym.policies.policy import KINDS

GROUND = "ground-paper"
JUNK = (
    None, True, False, 0, -1, 7, 10**30, 10**400, 0.0, -0.0, -1.5, 0.5, 7.0, 1e308, -1e308, 5e-324, math.nan, math.inf,
    -math.inf, "", "x", "qp", "a\nb", "a\x1b[31mb", "<script>alert(1)</script>", "<img src=x onerror=y>", "| a | b |",
    "`", "[a](javascript:b)", "\u202eback", "\ud800", "é" * 9, "x" * 5000, "../../up", "__main__:X", [], {}, [[]],
    [None], {"": None}, [0] * 300, [[[[[[]]]]]], {"error": [1.0]}, "true", "NaN", "test", "classical", "0" * 64,
)  # fmt: skip


def honest():
    scores = {TRACK: [score(TRACK, [0.5, CAP, 0.75]), score(TRACK, [0.25, 0.7, 0.3])], GROUND: [[0.8, CAP], [0.9, 0.3]]}
    training = {"command": "train", "steps": 10, "curve": [[1, 0.5]]}
    return made_row(scores, "sham", "residual", doc="What it is.", training=training, arguments={"preset": "paper"})


def places(content, place=()):
    """Path to every place of a row, containers and leaves alike."""
    for key, value in content.items() if isinstance(content, dict) else enumerate(content):
        yield (*place, key)
        if isinstance(value, dict | list):
            yield from places(value, (*place, key))


def mutated(content, whole, rng):
    """The content with one to three places replaced by junk, removed, duplicated, renamed or negated."""
    content = deepcopy(content)
    for _ in range(rng.integers(1, 4)):
        *way, last = whole[rng.integers(len(whole))]
        within = content
        try:
            for key in way:
                within = within[key]
            was = within[last]
        except (KeyError, IndexError, TypeError):
            continue  # removed by an earlier change
        action = rng.integers(6)
        junk = deepcopy(JUNK[rng.integers(len(JUNK))])
        if action <= 2:
            within[last] = junk
        elif action == 3:
            del within[last]
        elif isinstance(within, list):
            within.append(was)
        elif action == 4:
            within[str(junk)[:50]] = within.pop(last)
        else:
            within[last] = -was if isinstance(was, float) else [was]
    return content


def broken(data, rng):
    """Bytes with bits flipped, parts removed or inserted."""
    data = bytearray(data)
    for _ in range(rng.integers(1, 5)):
        at = int(rng.integers(len(data)))
        action = rng.integers(3)
        if action == 0:
            data[at] ^= 1 << int(rng.integers(8))
        elif action == 1:
            del data[at : at + int(rng.integers(1, 40))]
        else:
            data[at:at] = rng.bytes(int(rng.integers(1, 9)))
    return bytes(data)


def assert_sound(row):
    """Assert that a row is valid and that its tables are sound."""
    assert row.kind in KINDS
    assert row.tracks
    assert all(word.isprintable() for word in (row.name, row.doc, row.content["command"], row.content["processor"]))
    for track in row.tracks:
        shape = (len(row.policies), len(row.scenarios(track)))
        assert row.errors(track).shape == shape
        assert ((row.errors(track) >= 0.0) & (row.errors(track) <= CAP)).all()
        for name, metric in told_in(TRACKS[track].world).items():
            if metric.kind is bool:
                assert np.isin(row.column(track, name), (0.0, 1.0)).all()
            elif metric.kind is not str:
                column = row.column(track, name)
                assert (np.isnan(column) | ((column >= 0.0) & (column <= metric.most))).all()
    base = made_row({track: [np.full(50, 0.5).tolist()] for track in TRACKS}, "reference")
    references = {track.reference for track in TRACKS.values()}
    board = tabulate({**dict.fromkeys(references, base), "other" if row.name in references else row.name: row})
    json.dumps(as_json(board), allow_nan=False)
    page, shown = markdown(board), text(board, wide=True)
    assert not re.search(r"<[a-zA-Z/!?]|\]\(javascript", page)
    assert all(line.isprintable() for line in (*page.splitlines(), *shown.splitlines()))
    tables = [part.splitlines() for part in page.split("\n\n") if part.startswith("| ")]
    for lines in tables:
        assert len({len(re.findall(r"(?<!\\)\|", line)) for line in lines}) == 1


def outcome(path):
    """Whether a row is accepted; a refusal is one line that states what would be valid."""
    try:
        row = read_row(path)
    except RowError as error:
        words = str(error)
    else:
        assert_sound(row)
        return True
    assert len(words) < 2000
    assert "\n" not in words
    assert re.search("valid: |expected ", words), words
    return False


def test_no_row_whose_content_was_changed_and_hashed_anew_is_taken_unless_it_is_sound(tries, rng, tmp_path):
    content, path, taken = dict(honest().content), tmp_path / "row.json", 0
    whole = [place for place in places(content) if place[0] != "sha256"]
    for _ in range(tries(600)):
        bad = mutated(content, whole, rng)
        try:
            digest = row_hash(bad)
        except UnicodeEncodeError:  # surrogates, which UTF-8 cannot encode: the adversary escapes them
            digest = ""
        path.write_text(json.dumps({**bad, "sha256": digest}), encoding="utf-8")
        taken += outcome(path)
    assert taken < 0.5 * tries(600)


def test_no_row_whose_bytes_were_changed_is_taken(tries, rng, tmp_path):
    row, path = honest(), tmp_path / "row.json"
    data = row_text(row).encode()
    for _ in range(tries(300)):
        path.write_bytes(broken(data, rng))
        if outcome(path):  # the hash excludes times and white space
            again = read_row(path)
            assert {**again.content, "timing": None} == {**row.content, "timing": None}
