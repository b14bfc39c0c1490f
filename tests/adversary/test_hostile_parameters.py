"""Mutated parameter files: the runner refuses them in one line, as Python does, or drives within its bounds."""

import hashlib
import re
import subprocess
from collections import Counter

import numpy as np
from support.needs import needs_compiler
from support.parameters import sealed, with_compiled
from support.runner import CHECKED, compiled

from spidar_gym.border import BorderError
from spidar_gym.native.compiler import compiler
from spidar_gym.native.recipe import FLAGS
from spidar_gym.onboard.build import arguments
from spidar_gym.onboard.parameters import parameters_of, parameters_record, parameters_text

pytestmark = needs_compiler
BATCH = 100
"""Files of a process."""
WORDS = [
    b"nan", b"-nan", b"inf", b"1e400", b"-1e400", b"1e-400", b"5e-324", b"0x1p3", b"1_0", b"1e", b"--1", b"+.5",
    b"1.e2", b"", b"-0.0", b"0", b"1", b"-1", b"4", b"1e300", b"42.0", b"#", b"\t", b"\r", b"m", b"N", b"word",
    b"observed", b"robot.gravity", b"flight.steady.", b"crawl.", b".", b"%s%n", b"\xff\xfe", "λ".encode(), b"x" * 1100,
]  # fmt: skip
MISSIONS = {"hover": b"flight steady\n", "crawl": b"crawl published\nmove 0.05 0 0 0\n",
            "course": b"course steady published\ntake_off 0.5\nland\n"}  # fmt: skip


def base():
    """The lines of a file with a preset of each kind."""
    lines = parameters_text(parameters_record(presets=("steady",)))[:-72].split(b"\n")[:-1]
    return [line for line in lines if not re.match(rb"crawl\.(?!published\.)", line)]


def changed(lines, rng):
    """Change words of some lines; numbers mostly stay numbers, many of them valid."""
    for _ in range(rng.integers(1, 6)):
        k = rng.integers(1, len(lines))
        words = lines[k].split(b" ")
        at = rng.integers(len(words)) if rng.random() < 0.2 else len(words) - 1
        try:
            number = float(words[at])
        except ValueError:
            number = 1.0
        factors = rng.lognormal(0.0, 2.0), 1.0 + 1e-3 * rng.normal(), -1.0
        wild = [*(number * each for each in factors), 0.0, rng.lognormal(0.0, 9.0), np.round(rng.uniform(0, 10))]
        words[at] = WORDS[rng.integers(len(WORDS))] if rng.random() < 0.15 else repr(float(rng.choice(wild))).encode()
        lines[k] = b" ".join(words)
    return lines


def rearranged(lines, rng):
    """Drop, double, swap, or insert lines, or append words."""
    for _ in range(rng.integers(1, 4)):
        i, j, what = *rng.integers(len(lines), size=2), rng.integers(6)
        if what == 0:
            del lines[min(i, j) : min(i, j) + rng.choice([1, 1, 60])]
        elif what == 1:
            lines[i:i] = lines[i : i + rng.choice([1, 1, 60])]
        elif what == 2:
            lines[i], lines[j] = lines[j], lines[i]
        elif what == 3:
            lines.insert(i, rng.choice(WORDS))
        elif what == 4:
            lines[i] += b" " + WORDS[rng.integers(len(WORDS))]
        else:
            lines[i] = b"  " + lines[i].replace(b" ", b"\t ") + b" # a comment\r"
        if not lines:
            return [b""]
    return lines


def mutated(lines, rng):
    """A file that is changed in one way or several; most have the right hash."""
    lines = list(lines)
    if rng.random() < 0.7:
        lines = changed(lines, rng)
    if rng.random() < 0.3:
        lines = rearranged(lines, rng)
    text = b"\n".join(lines) + b"\n"
    if rng.random() < 0.1:
        raw = bytearray(text)
        for at in rng.integers(len(raw), size=rng.integers(1, 5)):
            raw[at] = rng.integers(1, 256)
        text = bytes(raw)
    data = sealed(text)
    if rng.random() < 0.1:
        at = rng.integers(len(data))
        data = data[:at] + rng.bytes(rng.integers(3)).replace(b"\0", b"x") + data[at + rng.integers(2) :]
    return data if rng.random() < 0.95 else data[: rng.integers(len(data))]


def compile_driver(folder, out):
    """Compile the driver with the runner's sources in place of its `main`, with sanitizers."""
    sources = [word for word in arguments(folder) if not word.endswith("/main.c")]
    driver = f"{__file__.removesuffix('test_hostile_parameters.py')}parameters_driver.c"
    command = [*compiler(), *FLAGS, *CHECKED[1:], "-O1", driver, *sources, "-o", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[:2000]
    return out


def expected(data, own):
    """What C must answer: the hash of the parameters that Python reads, or a refusal."""
    try:
        return hashlib.sha256(with_compiled(parameters_of(data), own).tobytes()).hexdigest()
    except BorderError:
        return "refused:"


def test_parameters(tries, rng, folder, library, hover, crawl, course, tmp_path):
    """Under sanitizers; C and Python agree about every file, and about every number of those that both accept."""
    driver, found, lines = compile_driver(folder, tmp_path / "driver"), Counter(), base()
    own, streams = compiled(library), {"hover": hover, "crawl": crawl, "course": course}
    for k in range(-(-tries(20_000) // BATCH)):
        name = list(MISSIONS)[k % len(MISSIONS)]
        stream, files = (
            streams[name],
            [sealed(b"\n".join(lines) + b"\n"), *(mutated(lines, rng) for _ in range(BATCH - 1))],
        )
        inputs = stream.inputs[stream.hovers - 5 : stream.drives + 8]
        given = [np.int32(len(inputs)).tobytes(), inputs.tobytes()]
        for data in files:
            given += [np.array([len(data), len(MISSIONS[name])], np.int32).tobytes(), data, MISSIONS[name]]
        done = subprocess.run([driver], input=b"".join(given), capture_output=True, check=False, timeout=600)
        assert (done.returncode, done.stderr) == (0, b""), done.stderr[-3000:].decode(errors="replace")
        answers = done.stdout.decode(errors="replace").splitlines()
        assert len(answers) == len(files), "a line for each file"
        assert answers[0].endswith(" driven")
        for data, answer in zip(files, answers, strict=True):
            verdict, _, what = answer.partition(" ")
            assert verdict == expected(data, own), (answer, data)
            assert what != "OUT OF BOUNDS", data
            if verdict == "refused:":
                assert "; valid: " in what
                what = "refused by a line" if "parameters, line" in what else "refused by hash or frame"
            found[what] += 1
    print(dict(found))
    assert (
        min(found[what] for what in ("refused by a line", "refused by hash or frame", "driven")) > 0.1 * found.total()
    )
