"""An adversary's checkpoints: every flipped bit is detected; content with a valid checksum must have its form."""

import json
import time

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="the extra `train` is not installed")

from spidar_gym.benchmark.track import CRAWL
from spidar_gym.border import pack, unpack
from train.gait import BY_CYCLE, BY_PHASE, layers, phase_table, places, scaling
from train.lib.evaluate import Verdict
from train.lib.run import TITLE, CheckpointError, Run, State, curve_line

pytestmark = pytest.mark.train
VALUES = (None, True, -1, 10**9, 1.5, "", "a\nb", "\x1b", [], {}, [[None]], "x" * 10_000)
LEARNED = (*BY_PHASE, *BY_CYCLE)
SIZE = len(places(LEARNED))
FRESH = {"costs": np.zeros((0, 12)), "best": np.zeros(SIZE), "ticks": 0}


@pytest.fixture
def run(tmp_path):
    """A run with a checkpoint, as `train.gait` writes it."""
    run = Run(tmp_path, {"seed": 0, "rate": 0.04}, CRAWL, {"preset": "robust", "action_mode": "residual_gait_force"})
    rng, none = np.random.default_rng(0), layers(phase_table(LEARNED, np.zeros(SIZE)))
    state = State(segment=2, scaling=vars(scaling()), mean=none, best=none, best_score=-0.1)
    state.learner = {"costs": rng.uniform(0.5, 1.0, (4, 12)), "best": rng.uniform(-1.0, 1.0, SIZE), "ticks": 3200}
    state.base = {"ground-paper": {"error": 0.5}}
    state.curve = [curve_line(k, 1.0, Verdict({"ground-paper": {"error": -0.1}}, 0.0, failed=False)) for k in (1, 2)]
    run.save(state)
    return run


def outcome(run):
    """The loaded state, or None if it was refused in a line that states what would be valid."""
    began = time.process_time()
    try:
        state = run.load()
        run.require_alike(state.learner, FRESH)
        run.require_alike(state.scaling, vars(scaling()))
    except CheckpointError as error:
        state, message = None, str(error)
        assert message.isprintable()
        assert "valid: " in message
    assert time.process_time() - began < 1.0
    return state


def test_a_checkpoint_is_loaded_as_it_was_saved(run):
    state = run.load()
    before = run.checkpoint.read_bytes()
    run.save(state)
    assert run.checkpoint.read_bytes() == before == run.previous.read_bytes()


def test_every_damaged_checkpoint_is_refused(run, tries, rng):
    whole = run.checkpoint.read_bytes()
    for k in range(tries(300)):
        data = bytearray(whole)
        data[rng.integers(len(data))] ^= 1 << rng.integers(8)
        if k % 3 == 2:
            a, b = sorted(rng.integers(len(whole), size=2).tolist())
            data = (whole[: b - 1], whole[:a] + whole[b + 1 :], whole + whole[a : b + 1])[rng.integers(3)]
        run.checkpoint.write_bytes(data)
        with pytest.raises(CheckpointError, match=r"checksum is not that of its content.*valid: "):
            run.load()


def test_no_rebuilt_checkpoint_gets_past_its_form(run, tries, rng):
    """An adversary who changes a checkpoint can also recompute its checksum."""
    whole, refused, count = run.checkpoint.read_bytes(), 0, tries(300)
    for _ in range(count):
        content, arrays = unpack(TITLE, whole, sealed=True)
        kind = rng.integers(3)
        if kind == 0:
            name = list(arrays)[rng.integers(len(arrays))]
            array = arrays.pop(name)
            others = (array[None], array[..., :-1], array.astype(np.int64), array * np.nan, array.astype(np.float16))
            if rng.random() < 0.8:
                arrays[(name, "x\ny", "learner/more")[rng.integers(3)]] = others[rng.integers(len(others))]
        else:
            parent = content if rng.random() < 0.3 else content["state"]
            while True:
                key = list(parent)[rng.integers(len(parent))] if isinstance(parent, dict) else rng.integers(len(parent))
                inside = parent[key]
                if not (isinstance(inside, dict | list) and inside and rng.random() < 0.6):
                    break
                parent = inside
            if kind == 1:
                parent[key] = VALUES[rng.integers(len(VALUES))]
            else:
                del parent[key]
        run.checkpoint.write_bytes(pack(TITLE, json.loads(json.dumps(content)), arrays, sealed=True))
        refused += outcome(run) is None
    assert 0.4 * count < refused <= count
