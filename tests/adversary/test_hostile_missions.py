"""Junk missions and corrupted logs: the runner refuses them in one line or stays within its bounds."""

import re
from collections import Counter

import numpy as np
from support.runner import Loop, check_bounds, junk, read_mission, said

TICKS = 20
"""Ticks of a corrupted log."""


def test_missions(tries, rng, library, hover, crawl, course):
    """Valid missions are driven: the wait, the take-over, and half a second."""
    found = Counter()
    for _ in range(tries(123_000)):
        mission = read_mission(library, junk(rng).replace(b"\0", b""))
        if isinstance(mission, str):
            assert re.match(r"mission, line \d+; valid: ", mission)
            found["refused"] += 1
            continue
        stream = (hover, crawl, course, crawl)[mission["kind"]]  # a bench test is driven in ARM_ON too
        loop = Loop.begin(library, mission)
        if isinstance(loop, str):
            assert "; valid: " in loop
            found["out of reach"] += 1
            continue
        check_bounds(loop.run(stream.inputs[stream.hovers - 5 : stream.drives + 20]))
        found["driven"] += 1
    print(dict(found))
    assert found["refused"] > found["driven"] > 0


def test_logs(tries, rng, checked, library, stream, tmp_path):
    """Under sanitizers, a log is replayed or refused in one line."""
    inputs = stream.inputs[stream.drives - TICKS // 2 :][:TICKS]
    stream.write(tmp_path / "log", inputs, Loop(library, stream.mission).run(inputs))
    whole = np.frombuffer((tmp_path / "log").read_bytes(), np.uint8)
    answers = Counter()
    for _ in range(tries(5_150)):
        spoilt = whole.copy()
        # The head, which has the counts, more often than its share.
        end = rng.choice([400, len(spoilt)])
        places = rng.integers(end, size=rng.integers(1, 30))
        spoilt[places] = rng.choice([0, 255, 127, 128, 1, int(rng.integers(256))], size=len(places))
        (tmp_path / "log").write_bytes(spoilt[: len(spoilt) if rng.random() < 0.7 else rng.integers(len(spoilt))])
        done = said(checked, "replay", tmp_path / "log", tmp_path / "out")
        assert done.returncode in (0, 2), done.stderr[-2000:]
        assert re.fullmatch(r"(runner: [^\n]*\n)?", done.stderr), done.stderr[-2000:]
        answers[done.returncode] += 1
    assert len(answers) == 2
