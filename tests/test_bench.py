"""Pins the benchmark: every figure is there and is a time; how long anything takes is not tested."""

import json
import sys
from dataclasses import fields

import numpy as np
import pytest

import spidar_gym
from spidar_gym import bench
from spidar_gym.bench import PAIRS, bench_table, hard_demands, measure, run_bench
from spidar_gym.cli import main


@pytest.mark.slow
def test_the_benchmark_reports_every_figure_and_its_unit(monkeypatch):
    monkeypatch.setattr(bench, "ROUNDS", 1)
    result = run_bench(seconds=0.02)
    for preset in ("as_flown", "paper"):
        for form in ("form1", "form2", "form3"):
            for name in ("snapshot_us", "qp_assembly_us", "osqp_us", "control_tick_us", "mj_step_us"):
                timing = result[preset][form][name]
                assert 0.0 < timing["best"] <= timing["median"] <= timing["p99"]
    assert result["env_steps_per_s_mixed"] > 0.0
    assert sum(result["hard_states"]["statuses"].values()) == 400
    table = bench_table(result)
    assert "control_tick" in table
    core = result["core"]
    assert "compiled core" in table
    if core is not None:
        assert core["tick_us"]["best"] > 0.0
        assert all(core[name]["ratio"] > 0.0 for name in PAIRS)
    assert "steps/s" in table


def test_the_hard_states_are_the_same_each_time_and_hard():
    first, second = (hard_demands(np.random.default_rng(3), 20) for _ in range(2))
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a.wrench, b.wrench)
        np.testing.assert_array_equal(a.torque_map, b.torque_map)
    assert any(demand.restricted.any() for demand in first)


def test_a_measurement_orders_its_figures():
    timing = measure(lambda: sum(range(100)), seconds=0.02)
    assert 0.0 < timing.best <= timing.median <= timing.p99


@pytest.mark.train
def test_the_same_ticks_are_timed_without_and_with_the_controller():
    from train import speed

    env = speed.make_env(speed.settings("hover-paper-ppo", ("flight-randomised",)), "flight-randomised").env
    seconds, saved, commands = speed.play(env, 3, 6)
    after = env.unwrapped.state
    assert seconds > 0.0
    assert len(commands) == 6
    assert speed.replay(env.unwrapped.plant, saved, commands) > 0.0
    again = env.unwrapped.plant.state()
    for field in fields(after):
        np.testing.assert_array_equal(getattr(again, field.name), getattr(after, field.name))


@pytest.mark.train
@pytest.mark.parametrize("json_", [True, False])
def test_with_train_every_column_is_a_rate(json_, monkeypatch, capfd):
    from train import speed

    small = {**speed.presets.RESIDUAL["hover-paper-ppo"], "envs": 2, "batch_size": 16, "scaling_ticks": 4}
    monkeypatch.setitem(speed.presets.RESIDUAL, "hover-paper-ppo", small)
    monkeypatch.setattr(speed, "ROWS", {"flight": ("hover-paper-ppo", ("flight-fast3",))})
    monkeypatch.setattr(speed, "ROUNDS", 2)
    main(["bench", "--train", "--seconds", "0.005", *(["--json"] if json_ else [])])
    out = capfd.readouterr().out
    if not json_:
        assert "simulation" in out
        assert "+ learner" in out
        return
    result = json.loads(out)
    row = result["speed"]["flight"]
    rates = row["ticks_per_s"]
    assert list(rates) == list(speed.COLUMNS)
    assert all(rates[name] > 0.0 for name in ("simulation", "allocator_python", "learner"))
    assert (rates["allocator_core"] is None) == (row["learner_control"] == "python")
    assert "torch" in result["machine"]


def test_a_learner_is_timed_in_segments_of_a_batch_that_do_as_much_a_tick_as_long_ones():
    speed = pytest.importorskip("train.speed")
    for name, settings in speed.presets.RESIDUAL.items():
        args = speed.settings(name, settings["tracks"])
        assert args.n_steps * args.envs == args.batch_size
        assert args.segment == args.batch_size * args.hold
        assert args.critic_first == 0


def test_outside_a_clone_and_without_a_learning_framework_train_is_refused_in_one_line(tmp_path, monkeypatch, capfd):
    def refused() -> str:
        with pytest.raises(SystemExit) as stop:
            main(["bench", "--train"])
        out, err = capfd.readouterr()
        assert (stop.value.code, out) == (2, "")
        (line,) = err.splitlines()
        return line

    for name in ("speed", "residual", "learner", "run"):
        monkeypatch.delitem(sys.modules, f"train.{name}", raising=False)
    # Not torch: tyro imports it, too, where sys.modules has the name.
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    assert "pip install -e '.[train]'" in refused()
    monkeypatch.setattr(spidar_gym, "__file__", str(tmp_path / "spidar_gym" / "__init__.py"))
    assert "a clone of the repository" in refused()
