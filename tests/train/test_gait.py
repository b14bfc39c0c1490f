"""Pins the search for gait parameters: the table is the network, paired crawls lead downhill, runs resume."""

import json
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="the extra `train` is not installed")

from spidar_gym.benchmark.track import TRACKS
from spidar_gym.border import unpack
from spidar_gym.control.crawl.observation import crawl_layout
from spidar_gym.control.crawl.phases import PHASES
from spidar_gym.errors import InvalidValueError, UnknownNameError
from spidar_gym.policies.artifact import read_artifact
from train import gait
from train.gait import PRESETS, SIZE, Course, artifact, learn, phase_table, update
from train.lib.config import CONTROL, override
from train.lib.envs import training_seed
from train.lib.run import TITLE, CheckpointError, State

pytestmark = pytest.mark.train
TINY = override(PRESETS["crawl"], directions=1, scenarios=1, control=CONTROL)
TRACK = "ground-randomised"


def observe(phase, steps_left, rng):
    """An observation in a phase, with anything elsewhere."""
    pieces = []
    for piece in crawl_layout(gait.MODE.size):
        value = rng.uniform(-piece.bound, piece.bound, piece.size)
        if piece.name == "phase":
            value = np.array([name == phase for name in PHASES], float)
        pieces.append(np.full(1, steps_left) if piece.name == "steps_left" else value)
    return np.concatenate(pieces).astype(np.float32)


def test_a_network_says_what_its_table_says_in_every_phase_of_the_last_cycle_and_of_the_others():
    rng = np.random.default_rng(0)
    numbers = rng.uniform(-0.9, 0.9, SIZE)
    agent, rows = artifact(TINY, numbers, State()), phase_table(numbers)
    assert len(set(np.abs(rows[rows != 0.0]))) == len(numbers)
    for k, phase in enumerate(PHASES):
        for steps_left in (0, 1, 2, 3, 17):
            raised, lift, force = rows[k if steps_left <= 1 else len(PHASES) + k]
            action = agent.act(observe(phase, steps_left, rng))
            np.testing.assert_allclose(action[:4], [0.0, raised, 0.0, lift], atol=1e-6)
            np.testing.assert_allclose(action[4:].reshape(4, 3), [[0.0, 0.0, force]] * 4, atol=1e-6)


class Bowl:
    """Instead of crawls: a cost with its least at a table, and what an episode draws on top, the same for its seed."""

    def __init__(self, least):
        self.least, self.seeds = least, []

    def cost(self, numbers, number, seed):
        self.seeds.append(seed)
        luck = 100.0 * np.random.default_rng(seed).normal()
        return float(np.mean((numbers - self.least) ** 2)) + luck, 800

    def close(self):
        pass


def test_the_search_goes_downhill_whatever_the_episodes_draw():
    """The luck of an episode is some thousand times what a table changes; it is the same on both sides."""
    least = np.random.default_rng(1).uniform(-0.6, 0.6, SIZE)
    bowl, numbers, direction = Bowl(least), np.zeros(SIZE), np.zeros(SIZE)
    args = override(TINY, directions=4)
    for number in range(60):
        numbers, direction, ticks = update(args, bowl, numbers, direction, number, number / 60, lambda _: None)
        assert ticks == 2 * 4 * 800
    first, last = np.mean(least**2), np.mean((numbers - least) ** 2)
    assert last < 0.1 * first
    assert np.abs(numbers).max() <= 1.0
    assert all(a == b for a, b in zip(bowl.seeds[::2], bowl.seeds[1::2], strict=True))  # pairs
    assert len(set(bowl.seeds)) == 60 * 4
    assert min(bowl.seeds) >= 2**31


def test_where_nothing_makes_a_difference_nothing_changes():
    flat = type("Flat", (), {"cost": lambda *_: (1.0, 10)})()
    numbers = np.full_like(np.zeros(SIZE), 0.25)
    np.testing.assert_array_equal(update(TINY, flat, numbers, np.zeros(SIZE), 0, 0.0, lambda _: None)[0], numbers)


@pytest.fixture
def short(monkeypatch):
    """Crawls of two seconds: nobody arrives, but runs are runs."""
    monkeypatch.setitem(TRACKS, TRACK, replace(TRACKS[TRACK], seconds=2.0))


def test_a_crawl_costs_its_time_its_energy_and_what_is_missing_at_its_end(short):
    course = Course(TINY)
    cost, ticks = course.cost(np.zeros(SIZE), 0, training_seed(0, 6, 0))
    assert ticks == 80
    # Not arrived: nearly all that an error at the goal can cost, the failure, its energy, its time.
    inner = course._envs[0].unwrapped
    progress, energy, config = inner.progress, inner.plant.energy_wh, TINY.cost
    known = (
        config.failure + config.hurry * 2.0 / progress.nominal_time + config.energy * energy / progress.initial_distance
    )
    assert cost - known == pytest.approx(config.goal, rel=0.01)
    assert course.cost(np.zeros(SIZE), 0, training_seed(0, 6, 0)) == (cost, ticks)
    course.close()


def test_a_run_is_its_seed_and_goes_on_where_it_was_interrupted(short, tmp_path, monkeypatch):
    monkeypatch.setattr(gait, "Course", lambda _: Bowl(np.full_like(np.zeros(SIZE), 0.5)))
    args = override(TINY, steps=6400, validations=2)
    whole = learn(override(args, out=tmp_path / "whole")).read_bytes()

    calls = []

    def stop(*args, **kwargs):
        calls.append(1)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return update(*args, **kwargs)

    monkeypatch.setattr(gait, "update", stop)
    with pytest.raises(KeyboardInterrupt):
        learn(override(args, out=tmp_path / "cut"))
    path = learn(override(args, out=tmp_path / "cut"))
    assert path.read_bytes() == whole
    assert len(calls) == 5  # four updates, one of them begun twice
    curve = json.loads((path.parent / "curve.json").read_text())
    assert [line["steps"] for line in curve["curve"]] == [3200, 6400]
    agent = read_artifact(path)
    assert (agent.kind, dict(agent.arguments)) == ("residual", args.arguments)
    folders = [tmp_path / name / "learned_gait" / "seed0" for name in ("whole", "cut")]
    found = [
        unpack(TITLE, (folder / "checkpoint.npz").read_bytes(), sealed=True)[1]["learner/numbers"] for folder in folders
    ]
    np.testing.assert_array_equal(*found)
    assert np.abs(found[0]).max() > 0.0

    with pytest.raises(CheckpointError, match=r"spread = 0.3 instead of 0.2"):
        learn(override(args, out=tmp_path / "cut", spread=0.2))


def test_bad_settings_are_refused_before_anything_is_written(tmp_path):
    with pytest.raises(InvalidValueError, match="crawls"):
        override(TINY, tracks=("flight-fast3",))
    with pytest.raises(UnknownNameError):
        override(TINY, tracks=("moon",))
    with pytest.raises(InvalidValueError):
        override(TINY, directions=0)
