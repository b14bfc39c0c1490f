"""An adversary's scenario files: each is refused in one line, or yields valid episodes of its track."""

import hashlib
import json
import os
import shutil

import pytest

from spidar_gym.benchmark import TRACKS, load_scenarios, scenario
from spidar_gym.errors import StaleAssetError
from spidar_gym.robot.description import assets_dir

NAMES = ("flight-fast5", "flight-wind", "ground-friction")
VALUES = (None, True, -1, 0, 1e6, -1e308, 10**30, 2**63 - 1, 1e999, float("nan"), "", "x", [], [None], [[]], {},
          {"a": 1}, "a\nb", "\ud800")  # fmt: skip


@pytest.fixture
def files(tmp_path, monkeypatch):
    """A copy of the scenario files from which the package reads."""
    shutil.copytree(assets_dir() / "scenarios", tmp_path / "scenarios")
    monkeypatch.setattr(scenario, "assets_dir", lambda: tmp_path)
    load_scenarios.cache_clear()
    yield tmp_path / "scenarios"
    load_scenarios.cache_clear()


def pin(files, name, data):
    """Write a file and its hash, as an adversary can."""
    (files / "test" / f"{name}.json").write_bytes(data)
    pins = files / "SHA256SUMS"
    lines = [line for line in pins.read_text().splitlines() if not line.endswith(f"  test/{name}.json")]
    pins.write_text("".join(f"{line}\n" for line in [*lines, f"{hashlib.sha256(data).hexdigest()}  test/{name}.json"]))


def places(value, at=()):
    """Path to every place in a JSON value."""
    yield at
    inside = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, each in inside:
        yield from places(each, (*at, key))


def mutated(data, rng):
    """The file with changed bytes or values."""
    kind = rng.integers(5)
    if kind == 0:
        out = bytearray(data)
        for place in rng.integers(len(out), size=rng.integers(1, 5)):
            out[place] ^= 1 << rng.integers(8)
        return bytes(out)
    if kind == 1:
        a, b = sorted(rng.integers(len(data) + 1, size=2).tolist())
        return (data[:a], data[:a] + data[b:], b"\xff" + data, data.decode().encode("utf-16"), b"")[rng.integers(5)]
    content = json.loads(data)
    everywhere = [at for at in places(content) if at]
    shallow = [at for at in everywhere if len(at) < 5]
    chosen = shallow if kind < 4 else everywhere
    *path, last = chosen[rng.integers(len(chosen))]
    parent = content
    for key in path:
        parent = parent[key]
    if rng.random() < 0.2:
        del parent[last]
    else:
        parent[last] = VALUES[rng.integers(len(VALUES))]
    return json.dumps(content).encode()


def outcome(name):
    """The scenarios and an empty message, or no scenarios and the message of the refusal."""
    try:
        return load_scenarios(name)[0], ""
    except StaleAssetError as error:
        return (), str(error)


def test_no_mutated_scenario_file_gets_past_the_border_but_with_episodes(files, tries, rng):
    originals = {name: (files / "test" / f"{name}.json").read_bytes() for name in NAMES}
    count, refused = tries(300), 0
    for k in range(count):
        name = NAMES[k % len(NAMES)]
        pin(files, name, mutated(originals[name], rng))
        load_scenarios.cache_clear()
        found, message = outcome(name)
        assert "\n" not in message
        assert (found == ()) == (f"{name}.json" in message)
        refused += found == ()
        for one in found:
            assert set(one.options) == set(TRACKS[name].ranges)
            json.dumps(one.start, allow_nan=False)
    assert 0.5 * count < refused < count


@pytest.mark.parametrize(
    "change",
    [
        lambda one: one.update(start=None),
        lambda one: one.update(start=5),
        lambda one: one.update(state=None),
        lambda one: one["start"].update(goals=None),
        lambda one: one["start"].update(position=[0.0, 0.0]),
        lambda one: one["start"]["goals"][0].pop(),
        lambda one: one.update(seed=-1),
        lambda one: one.update(seed=True),
        lambda one: one.update(index=7),
        lambda one: one.update(disturbances={"wind": 1e9, "push": 20.0}),
        lambda one: one.update(disturbances={"wind": 2.0}),
        lambda one: one.update(options={"render_mode": "human"}),
        lambda one: one.update(robot=None),
        lambda one: one.clear(),
    ],
)
def test_a_scenario_that_is_none_of_its_track_is_refused(change, files):
    path = files / "test" / "flight-wind.json"
    content = json.loads(path.read_bytes())
    pin(files, "flight-wind", json.dumps(content).encode())
    assert len(load_scenarios("flight-wind")[0]) == 50, "a file rewritten without a change is valid"
    load_scenarios.cache_clear()
    change(content["scenarios"][3])
    pin(files, "flight-wind", json.dumps(content).encode())
    with pytest.raises(StaleAssetError, match=r"flight-wind\.json .*`spidar scenarios`"):
        load_scenarios("flight-wind")


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("flight-path", lambda one: one["start"].pop("path")),
        ("flight-path", lambda one: one["start"].update(path=[])),
        ("flight-path", lambda one: one["start"]["path"][2].pop()),
        ("flight-path", lambda one: one["start"]["path"][2].__setitem__(0, 0.0)),
        ("flight-path", lambda one: one["start"]["path"][2].__setitem__(1, 1e9)),
        ("flight-path", lambda one: one.update(disturbances={"wind": 3.5})),
        ("flight-path", lambda one: one.update(disturbances={"push": 20.0})),
        ("flight-fast5", lambda one: one["start"].update(path=[[1.0, *[0.0] * 12]])),
        ("flight-wind", lambda one: one.update(disturbances={})),
        ("course-mixed", lambda one: one.update(start=None)),
        ("course-mixed", lambda one: one["start"].pop("goal")),
        ("course-mixed", lambda one: one["start"].update(goal=[1e9, 0.0, 0.0])),
        ("course-mixed", lambda one: one["start"].update(gates=[["door", 2.0, 2.2, 1.0, 0.0]])),
        ("course-mixed", lambda one: one["start"]["gates"][0].__setitem__(1, 0.1)),
        ("course-mixed", lambda one: one["start"]["gates"][0].clear()),
        ("course-mixed", lambda one: one["start"].update(dares=1)),
        ("course-takeoff", lambda one: one.update(disturbances={})),
        (
            "ground-paper",
            lambda one: one.update(start={"gates": [], "goal": [2.0, 0.0, 0.0], "tiles": [], "dares": False}),
        ),
    ],
)
def test_a_start_is_whole_and_that_of_its_track(name, change, files):
    content = json.loads((files / "test" / f"{name}.json").read_bytes())
    change(content["scenarios"][3])
    pin(files, name, json.dumps(content).encode())
    with pytest.raises(StaleAssetError, match=rf"{name}\.json .*`spidar scenarios`"):
        load_scenarios(name)


@pytest.mark.parametrize("name", ["flight-wind.json", "../SHA256SUMS"])
def test_a_scenario_file_or_its_hashes_in_other_words_pipes_or_sizes_are_refused(name, files):
    path = files / "test" / name
    for data in (b"\xff\xfe\xfd", b"", b"\x00" * 100, b" " * 20_000_000):
        path.write_bytes(data)
        with pytest.raises(StaleAssetError):
            load_scenarios("flight-wind")
    path.unlink()
    os.mkfifo(path)  # a pipe without a writer
    with pytest.raises(StaleAssetError):
        load_scenarios("flight-wind")
