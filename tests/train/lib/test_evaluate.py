"""Pins paired evaluation: untrained agents equal the base, errors are relative to it, and nothing may get worse."""

import pytest

pytest.importorskip("stable_baselines3", reason="the extra `train` is not installed")
from support.training import TINY

from spidar_gym.errors import SpidarError
from train.lib import evaluate
from train.lib.agent import actor_layers
from train.lib.config import CONTROL
from train.lib.envs import scaling_of
from train.lib.evaluate import Base, PairedEvaluator
from train.lib.run import State
from train.lib.vector import TrainingVec
from train.residual import artifact, make_agent, make_robots

pytestmark = [pytest.mark.train, pytest.mark.usefixtures("short")]


def test_before_training_the_agent_is_its_base_bit_for_bit_and_an_agent_that_is_not_is_refused():
    evaluator = PairedEvaluator(TINY.env.tracks, Base(TINY.env.arguments), 1, control=CONTROL)
    robots = TrainingVec(TINY.env, TINY.reward, 2)
    scaling = scaling_of(robots.reset(), robots.raw_space.high)
    layers = actor_layers(make_agent(TINY, make_robots(TINY, scaling)))
    evaluator.require_same_as_base(artifact(TINY, layers, scaling, State()))
    *rest, (w, b) = layers
    with pytest.raises(SpidarError, match=r"differs from its base on flight-fast3 in attitude_rms_rad"):
        evaluator.require_same_as_base(artifact(TINY, (*rest, (w, b + 1e-3)), scaling, State()))


@pytest.mark.parametrize(("limit", "expected"), [(1.0, 1.0), (0.6, 0.5), (0.0, 0.3)])
def test_the_largest_admissible_fraction_is_chosen(limit, expected, monkeypatch):
    tried = []

    def play(self, fraction, on_scenario=lambda: None):
        tried.append(fraction)
        return evaluate.Verdict({"flight-fast3": {"error": fraction - limit}}, 0.0, failed=False)

    monkeypatch.setattr(PairedEvaluator, "evaluate", play)
    verdict, fraction = PairedEvaluator.largest_fraction(object.__new__(PairedEvaluator), lambda fraction: fraction)
    assert (fraction, verdict.admissible) == (expected, limit > 0.0)
    assert tuple(tried) == evaluate.FRACTIONS[: len(tried)]


def test_errors_are_relative_to_the_base_kind_by_kind():
    evaluator = object.__new__(PairedEvaluator)
    evaluator._tracks = ("flight-fast3", "flight-fast5")
    evaluator.means = {"flight-fast3": {"p": 1.0, "a": 0.02}, "flight-fast5": {"p": 3.0, "a": 0.02}}
    assert evaluator.relative_errors() == {"flight-fast3": (0.75, 0.75), "flight-fast5": (1.25, 1.25)}
    assert evaluator.relative_errors(apart=True) == {"flight-fast3": (0.5, 1.0), "flight-fast5": (1.5, 1.0)}
    reward = TrainingVec(TINY.env, TINY.reward, 1, relative_errors={"flight-fast3": (0.75, 0.5)})._groups[0].reward
    assert reward.position == pytest.approx(0.75 * TINY.reward.position)
    assert reward.velocity == pytest.approx(0.75 * TINY.reward.velocity)
    assert reward.attitude == pytest.approx(0.5 * TINY.reward.attitude)
    assert reward.rate == pytest.approx(0.5 * TINY.reward.rate)
