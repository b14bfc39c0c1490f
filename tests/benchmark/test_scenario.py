"""Pins the scenarios: committed files, hashes, bit-exact drawing, ranges of the tracks, the robot of each."""

import hashlib
import json
import math
import shutil
from dataclasses import asdict, replace
from itertools import pairwise

import numpy as np
import pytest

from spidar_gym.benchmark import TRACKS, load_scenarios, scenario
from spidar_gym.benchmark.scenario import (
    OFFSET,
    PINS,
    check_drawn,
    draw_scenario,
    make_env,
    reset_options,
    robot_digest,
    scenario_rng,
    scenario_text,
)
from spidar_gym.benchmark.track import SCENARIOS, SPLITS, Track
from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.envs.registry import HOVER
from spidar_gym.errors import SpidarError, StaleAssetError, UnknownNameError
from spidar_gym.robot import ROBOT
from spidar_gym.robot.description import assets_dir
from spidar_gym.tasks.hover import HoverTask
from spidar_gym.tasks.start import FlightStart

FLIGHTS = [name for name, track in TRACKS.items() if track.flies]
FREE = [name for name in FLIGHTS if not (TRACKS[name].options.get("randomization") or TRACKS[name].disturbances)]
EVERY = [(name, split) for split in SPLITS for name, track in TRACKS.items() if split in track.splits]
FLOWN = [(name, split) for name, split in EVERY if TRACKS[name].flies]
FILES = assets_dir() / "scenarios"


@pytest.fixture
def copied(tmp_path, monkeypatch):
    """A copy of the scenario files from which the package reads."""
    shutil.copytree(FILES, tmp_path / "scenarios")
    monkeypatch.setattr(scenario, "assets_dir", lambda: tmp_path)
    load_scenarios.cache_clear()
    yield tmp_path / "scenarios"
    load_scenarios.cache_clear()


def as_file(found) -> dict:
    return json.loads(json.dumps(asdict(found)))


# The files


@pytest.mark.parametrize(("name", "split"), EVERY)
def test_every_track_and_split_has_fifty_scenarios_in_order(name, split):
    found, _ = load_scenarios(name, split)
    assert len(found) == SCENARIOS == 50
    assert [one.index for one in found] == list(range(SCENARIOS))
    assert json.loads((FILES / split / f"{name}.json").read_text(encoding="utf-8"))["of"] == {
        "track": name, "split": split,
    }  # fmt: skip


def test_exactly_the_tracks_files_are_pinned_each_by_its_own_hash():
    pinned = (assets_dir() / PINS).read_text(encoding="utf-8").splitlines()
    lines = [
        f"{hashlib.sha256((FILES / split / f'{name}.json').read_bytes()).hexdigest()}  {split}/{name}.json"
        for name, split in EVERY
    ]
    assert sorted(pinned) == sorted(lines)
    on_disk = {path.relative_to(FILES).as_posix() for path in FILES.rglob("*.json")}
    assert on_disk == {f"{split}/{name}.json" for name, split in EVERY}


@pytest.mark.parametrize(("name", "split"), EVERY)
def test_the_hash_that_comes_with_scenarios_is_their_files(name, split):
    data = (FILES / split / f"{name}.json").read_bytes()
    assert load_scenarios(name, split)[1] == hashlib.sha256(data).hexdigest()


def test_no_two_scenarios_have_the_same_seed():
    seeds = [one.seed for name, split in EVERY for one in load_scenarios(name, split)[0]]
    assert len(set(seeds)) == len(seeds) == len(EVERY) * SCENARIOS
    assert len(set(SPLITS.values())) == len(SPLITS)


@pytest.mark.parametrize(
    "edit",
    [
        lambda text: text + " ",
        lambda text: text.replace("0.1", "0.2", 1),
        lambda text: text[:-1],
        lambda text: "",
        None,
    ],
    ids=["longer", "other", "shorter", "empty", "missing"],
)
def test_a_scenario_file_that_is_not_the_pinned_one_is_refused_by_name(edit, copied):
    path = copied / "test" / "flight-fast5.json"
    text = path.read_text(encoding="utf-8")
    path.unlink() if edit is None else path.write_text(edit(text), encoding="utf-8")
    with pytest.raises(StaleAssetError) as refusal:
        load_scenarios("flight-fast5")
    assert str(path) in str(refusal.value)
    assert len(load_scenarios("flight-fast5", "validation")[0]) == SCENARIOS


def test_a_scenario_file_of_another_split_is_refused(copied):
    shutil.copy(copied / "validation" / "flight-fast5.json", copied / "test" / "flight-fast5.json")
    with pytest.raises(StaleAssetError):
        load_scenarios("flight-fast5")


def test_without_the_hashes_nothing_is_read(copied):
    (copied / "SHA256SUMS").unlink()
    with pytest.raises(StaleAssetError):
        load_scenarios("ground-paper")


def test_a_stale_scenario_file_is_refused_with_the_command_that_writes_it(copied):
    (copied / "test" / "flight-fast5.json").unlink()
    with pytest.raises(StaleAssetError, match="`spidar scenarios`"):
        load_scenarios("flight-fast5")


@pytest.mark.parametrize("call", [load_scenarios, lambda *names: draw_scenario(*names, 0)])
def test_tracks_and_splits_that_do_not_exist_are_refused_with_those_that_do(call):
    with pytest.raises(UnknownNameError, match="flight-paper"):
        call("flight", "test")
    with pytest.raises(UnknownNameError, match=r"test, validation$"):
        call("flight-paper", "train")


def test_a_committed_file_stays_where_only_zeros_have_another_sign(copied, monkeypatch):
    def text(name, split, **_):
        return (FILES / split / f"{name}.json").read_text(encoding="utf-8")

    monkeypatch.setattr(scenario, "TRACKS", {"flight-fast5": TRACKS["flight-fast5"]})
    monkeypatch.setattr(scenario, "scenario_text", lambda *names, **_: text(*names).replace(" 0.0,", " -0.0,"))
    for split in TRACKS["flight-fast5"].splits:
        assert scenario.scenario_files()[f"scenarios/{split}/flight-fast5.json"] == text("flight-fast5", split)
    monkeypatch.setattr(scenario, "scenario_text", lambda *names, **_: text(*names).replace("0.1", "0.2", 1))
    for split in TRACKS["flight-fast5"].splits:
        assert scenario.scenario_files()[f"scenarios/{split}/flight-fast5.json"] != text("flight-fast5", split)


# Sampling


@pytest.mark.parametrize("split", ["test", "validation"])
@pytest.mark.parametrize("name", FREE)
def test_flights_of_the_described_robot_drawn_again_are_the_committed_file(name, split):
    count = []
    text = scenario_text(name, split, on_scenario=lambda: count.append(1))
    assert text == (FILES / split / f"{name}.json").read_text(encoding="utf-8")
    assert len(count) == SCENARIOS


@pytest.mark.parametrize(
    ("name", "split", "index"),
    [
        ("flight-randomised", "test", 0), ("flight-randomised", "validation", 49), ("flight-wind", "test", 7),
        ("ground-paper", "test", 0), ("ground-directions", "validation", 3), ("ground-friction", "test", 11),
        ("ground-uneven", "test", 2), ("ground-randomised", "test", 49), ("flight-path", "test", 1),
        ("flight-path", "validation", 49), ("course-takeoff", "test", 3), ("course-gates", "validation", 0),
        ("course-mixed", "test", 49),
    ],
)  # fmt: skip
def test_a_scenario_drawn_again_is_the_committed_one(name, split, index):
    assert as_file(draw_scenario(name, split, index)) == as_file(load_scenarios(name, split)[0][index])


def test_every_scenario_has_a_generator_of_its_own():
    names = [(name, split, index) for name, split in EVERY for index in (0, 1, 49)]
    draws = [scenario_rng(*name).integers(2**63) for name in names]
    assert len(set(draws)) == len(names)
    assert scenario_rng(*names[5]).integers(2**63) == draws[5]


@pytest.mark.parametrize(("name", "split"), EVERY)
def test_what_is_drawn_lies_within_the_tracks_ranges_and_fills_them(name, split):
    track, found = TRACKS[name], load_scenarios(name, split)[0]
    for ranges, drawn in (
        (track.ranges, [one.options for one in found]),
        (track.disturbances, [one.disturbances for one in found]),
    ):
        calm = [not values for values in drawn]
        assert all(set(values) == set(ranges) for values in drawn if values)
        if ranges:
            share = track.calm if ranges is track.disturbances else 0.0
            assert abs(np.mean(calm) - share) <= 3.0 * math.sqrt(share * (1.0 - share) / len(found))
        for key, (low, high) in ranges.items():
            values = [one[key] for one in drawn if one]
            assert low <= min(values) < low + 0.2 * (high - low)
            assert high - 0.2 * (high - low) < max(values) <= high


@pytest.mark.parametrize(("name", "split"), EVERY)
def test_only_crawls_have_no_start_and_only_randomised_robots_a_digest(name, split):
    track, found = TRACKS[name], load_scenarios(name, split)[0]
    drawn = bool(track.options.get("randomization"))
    digests = {one.robot for one in found}
    assert len(digests) == (SCENARIOS if drawn else 1)
    assert ("" in digests) != drawn
    assert all((one.start is not None) == (track.world != "ground") for one in found)
    assert all(("gates" in one.start) == (track.world == "course") for one in found if one.start)


@pytest.mark.parametrize(("name", "split"), FLOWN)
def test_deadlines_are_what_the_slowest_joint_needs_at_the_tracks_speed(name, split):
    track = TRACKS[name]
    for one in load_scenarios(name, split)[0]:
        speed = {**track.options, **one.options}.get("joint_speed", ROBOT.joint_speed)
        goals = one.start["goals"]
        assert goals[0][:2] == [0.0, 0.0]
        assert len(goals) > 1
        for (_, before, start_q), (start, deadline, q) in pairwise(goals):
            way = np.abs(np.subtract(q, start_q)).max()
            # Angles are stored to 0.1 mrad, deadlines to 1 µs.
            assert abs(deadline - start - way / speed) <= 1e-4 / speed + 1e-6
            assert before - 1e-6 <= start <= track.seconds
            assert start * CONTROL_RATE == pytest.approx(round(start * CONTROL_RATE), abs=1e-9)


@pytest.mark.parametrize(("name", "split"), FLOWN)
def test_a_flight_begins_off_its_reference_within_the_documented_offset(name, split):
    found = load_scenarios(name, split)[0]
    starts = [FlightStart.parse(one.start) for one in found]
    for offsets, most in (([s.position for s in starts], 0.03), ([s.rotation for s in starts], 0.05)):
        assert np.abs(offsets).max() <= OFFSET * most + 1e-6
        assert np.abs(offsets).max() > 0.9 * OFFSET * most
        assert np.abs(offsets).max() <= 0.017


@pytest.mark.parametrize("name", FLIGHTS)
def test_the_integrals_are_preloaded_where_robot_or_weather_are_sampled(name):
    for one in load_scenarios(name)[0]:
        trim, world = one.start.get("trim"), TRACKS[name].robots(0).world
        assert (trim is None) == (name in FREE or (world is not None and not world.trimmed))
        assert trim is None or (len(trim) == 6 and all(map(math.isfinite, trim)) and any(trim))


# The robot


def begun(name, index=0, *, seed=None):
    """The environment of a scenario after a reset with the scenario's seed or another one."""
    one = load_scenarios(name)[0][index]
    env = make_env(TRACKS[name], one, {})
    env.reset(seed=one.seed if seed is None else seed, options=reset_options(one))
    return env, one


@pytest.mark.parametrize("name", ["flight-randomised", "ground-uneven"])
def test_a_scenarios_robot_is_accepted_and_that_of_another_seed_is_refused(name):
    env, one = begun(name)
    check_drawn(env.sampled_parameters, one, "here")
    assert robot_digest(env.sampled_parameters) == one.robot
    env, one = begun(name, seed=one.seed + 1)
    with pytest.raises(SpidarError, match=f"{name}, scenario 0: the sampled robot is not the scenario's"):
        check_drawn(env.sampled_parameters, one, f"{name}, scenario 0")


def test_without_randomisation_every_seed_is_valid_but_no_randomised_robot():
    env, one = begun("flight-fast5", seed=1)
    check_drawn(env.sampled_parameters, one, "here")
    with pytest.raises(SpidarError):
        check_drawn(env.sampled_parameters, replace(one, robot="0" * 16), "here")
    env, _ = begun("flight-randomised")
    with pytest.raises(SpidarError):
        check_drawn(env.sampled_parameters, one, "here")


def test_the_robot_depends_on_the_seed_alone_and_not_on_the_arguments_of_a_policy():
    one = load_scenarios("flight-randomised")[0][1]
    digests = set()
    for arguments in ({}, {"preset": "tuned", "action_mode": "residual"}, {"action_mode": "direct"}):
        env = make_env(TRACKS["flight-randomised"], one, arguments)
        env.reset(seed=one.seed, options=reset_options(one))
        digests.add(robot_digest(env.sampled_parameters))
    assert digests == {one.robot}


def test_the_environment_is_the_scenarios_and_as_long_as_the_track():
    env, one = begun("ground-friction", 4)
    assert env.task.friction == one.options["friction"]
    assert env.task.slope == one.options["slope"]
    assert env.task.distance == 0.4
    env, one = begun("flight-wind", 4)
    assert env.task.horizon_s == TRACKS["flight-wind"].seconds
    assert [goal.deadline for goal in env.progress.goals] == [deadline for _, deadline, _ in one.start["goals"]]
    assert reset_options(one)["disturbances"] == one.disturbances


def test_a_track_that_names_no_forms_has_those_of_the_task(monkeypatch):
    monkeypatch.setitem(TRACKS, "flight-plain", Track("the task as it is", HOVER, 8.0))
    named = Track("the same in words", HOVER, 8.0, {"forms": HoverTask().forms, "joint_speed": ROBOT.joint_speed})
    plain = draw_scenario("flight-plain", "test", 0)
    monkeypatch.setitem(TRACKS, "flight-plain", named)
    assert draw_scenario("flight-plain", "test", 0) == plain
