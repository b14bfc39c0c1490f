"""Pins the search for gait parameters: the network equals the table, trials share their crawls, runs resume."""

import json
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="the extra `train` is not installed")

from spidar_gym.benchmark.evaluate import play
from spidar_gym.benchmark.track import TRACKS
from spidar_gym.border import unpack
from spidar_gym.control.crawl.observation import crawl_layout
from spidar_gym.control.crawl.phases import PHASES
from spidar_gym.errors import InvalidValueError, UnknownNameError
from spidar_gym.policies.artifact import read_artifact
from train import gait
from train.gait import PRESETS, artifact, crawl, learn, phase_table, places
from train.lib.config import override
from train.lib.evaluate import Base
from train.lib.run import TITLE, CheckpointError, State
from train.lib.trials import draw_scenarios

pytestmark = pytest.mark.train
TINY = override(PRESETS["crawl"], tracks=("ground-randomised",), scenarios=1, crawls=1, workers=1)
SIZE = len(places(TINY.learned))


def observe(phase, steps_left, rng):
    """Build an observation of a phase, with random values in all other entries."""
    pieces = []
    for piece in crawl_layout(gait.MODE.size):
        value = rng.uniform(-piece.bound, piece.bound, piece.size)
        if piece.name == "phase":
            value = np.array([name == phase for name in PHASES], float)
        pieces.append(np.full(1, steps_left) if piece.name == "steps_left" else value)
    return np.concatenate(pieces).astype(np.float32)


@pytest.mark.parametrize("preset", PRESETS)
def test_a_network_equals_its_table_in_every_phase_of_the_last_cycle_and_of_the_others(preset):
    rng, args = np.random.default_rng(0), PRESETS[preset]
    numbers = rng.uniform(-0.9, 0.9, len(places(args.learned)))
    agent, rows = artifact(args, numbers, State()), phase_table(args.learned, numbers)
    assert len(set(np.abs(rows[rows != 0.0]))) == len(numbers)
    for k, phase in enumerate(PHASES):
        for steps_left in (0, 1, 2, 3, 17):
            *gaits, force = rows[k if steps_left <= 1 else len(PHASES) + k]
            action = agent.act(observe(phase, steps_left, rng))
            np.testing.assert_allclose(action[:4], gaits, atol=1e-6)
            np.testing.assert_allclose(action[4:].reshape(4, 3), [[0.0, 0.0, force]] * 4, atol=1e-6)


def test_what_is_not_learned_stays_as_it_is():
    numbers = np.full(len(places(("force",))), 0.5)
    table = phase_table(("force",), numbers)
    assert not table[:, :4].any()
    assert table[:, 4].any()
    with pytest.raises(UnknownNameError, match=r"unknown learned 'speed'; valid: .*stride"):
        override(TINY, learned=("speed",))


def test_trials_of_a_generation_share_their_crawls_and_no_generation_those_of_another():
    args = override(PRESETS["crawl"], crawls=2)
    first, again, second, other = (
        {
            name: [(one.seed, dict(one.options)) for one in own]
            for name, own in draw_scenarios(override(args, seed=s), g, args.crawls)
        }
        for s, g in ((0, 0), (0, 0), (0, 1), (1, 0))
    )
    assert first == again
    seeds = {seed for drawn in (first, second, other) for own in drawn.values() for seed, _ in own}
    assert len(seeds) == 3 * 5 * 2
    assert {tuple(options) for _, options in first["ground-friction"]} == {("friction", "slope", "slope_direction")}


def test_a_crawl_costs_its_energy_its_time_and_what_is_missing_at_its_end():
    ((track, scenarios),) = draw_scenarios(TINY, 0, TINY.crawls)
    cost, ticks = crawl(TINY, (np.zeros(SIZE), track, scenarios))
    (played,) = play(Base(TINY.arguments), track, scenarios, control=TINY.control)
    found, options = played["metrics"], scenarios[0].options
    way = options["distance"]
    way += 0.5 * abs(options["turn"])
    assert ticks == round(40.0 * found["duration_s"])
    missing = found["final_error_m"] + 0.5 * found["final_yaw_rad"]
    share = (missing / 0.01) ** 2
    goal = TINY.cost.goal * share / (1.0 + share)
    known = 0.025 * found["energy_wh"] / way + 0.015 * found["duration_s"] / way
    assert cost == pytest.approx(
        known + goal + TINY.cost.failure * (not found["success"]), rel=5e-3
    )  # the cost uses the distance from the pose after settling
    assert TINY.cost({"failed": True}) == TINY.cost.fall > cost
    lost, won = (TINY.cost({**found, "success": success}) for success in (False, True))
    assert lost == pytest.approx(won + TINY.cost.failure)


@pytest.fixture
def short(monkeypatch):
    """Shorten validation crawls to two seconds, in which no robot arrives."""
    track = TINY.tracks[0]
    monkeypatch.setitem(TRACKS, track, replace(TRACKS[track], seconds=2.0))


def test_a_run_depends_on_its_seed_alone_and_resumes_where_it_was_interrupted(short, tmp_path, monkeypatch):
    calls = []

    def bowl(args, piece):
        """Replace crawls by a cost with its minimum at parameters of ½."""
        calls.append(1)
        if len(calls) == stop:
            raise KeyboardInterrupt
        return float(np.mean((piece[0] - 0.5) ** 2)), 100

    monkeypatch.setattr(gait, "crawl", bowl)
    args, stop = override(TINY, generations=4, validations=2, population=6), 0
    whole = learn(override(args, out=tmp_path / "whole")).read_bytes()
    assert len(calls) == 24

    calls, stop = [], 15
    with pytest.raises(KeyboardInterrupt):
        learn(override(args, out=tmp_path / "cut"))
    stop = 0
    path = learn(override(args, out=tmp_path / "cut"))
    assert path.read_bytes() == whole
    assert len(calls) == 15 + 12  # two complete generations, and a third started twice
    curve = json.loads((path.parent / "curve.json").read_text())
    assert [line["steps"] for line in curve["curve"]] == [1200, 2400]
    agent = read_artifact(path)
    assert (agent.kind, dict(agent.arguments)) == ("residual", args.arguments)
    folders = [tmp_path / name / "gait" / "seed0" for name in ("whole", "cut")]
    found = [
        unpack(TITLE, (folder / "checkpoint.npz").read_bytes(), sealed=True)[1]["learner/costs"] for folder in folders
    ]
    np.testing.assert_array_equal(*found)
    assert found[0].shape == (4, 6)

    with pytest.raises(CheckpointError, match=r"spread = 0.2 instead of 0.3"):
        learn(override(args, out=tmp_path / "cut", spread=0.3))


def test_bad_settings_are_refused_before_anything_is_written(tmp_path):
    with pytest.raises(InvalidValueError, match="crawls"):
        override(TINY, tracks=("flight-fast3",))
    with pytest.raises(UnknownNameError):
        override(TINY, tracks=("moon",))
    with pytest.raises(InvalidValueError):
        override(TINY, crawls=0)
