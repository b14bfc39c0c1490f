"""Pins `spidar bench`: every figure is present and a valid time; the speed itself is not tested."""

import gymnasium
import numpy as np
import pytest

from spidar_gym.benchmark.track import WORLD
from spidar_gym.cli import bench, bench_in_turn
from spidar_gym.cli.bench import (
    KINDS,
    PAIRS,
    bench_table,
    hard_demands,
    measure,
    run_bench,
)
from spidar_gym.cli.bench_in_turn import EFFECTS, GRASPS, MOVING, OFF
from spidar_gym.cli.main import main
from spidar_gym.sim.config import PlantConfig


@pytest.mark.slow
def test_the_benchmark_reports_every_figure_and_its_unit(monkeypatch):
    monkeypatch.setattr(bench, "ROUNDS", 1)
    monkeypatch.setattr(bench, "TURNS", 2)
    monkeypatch.setattr(bench_in_turn, "TURNS", 2)
    monkeypatch.setattr(bench_in_turn, "HERDS", (2,))
    monkeypatch.setattr(bench, "CROWDS", crowds := ((1, 1), (3, 2)))
    result = run_bench(seconds=0.02)
    for preset in ("as_flown", "paper"):
        for form in ("form1", "form2", "form3"):
            for name in ("snapshot_us", "qp_assembly_us", "osqp_us", "control_tick_us", "mj_step_us"):
                timing = result[preset][form][name]
                assert 0.0 < timing["best"] <= timing["median"] <= timing["p99"]
    engine = result["engine"]
    assert {(row["environment"], row["robots"], row["threads"]) for row in engine} == {
        (name, *crowd) for name in KINDS for crowd in crowds
    }
    assert all(row[name] > 0.0 for row in engine for name in ("engine_cpu_us", "bare_wall_us", "of_bare", "of_hot"))
    assert sum(result["hard_states"]["statuses"].values()) == 400
    table = bench_table(result)
    assert "control_tick" in table
    core = result["core"]
    assert "compiled core" in table
    assert core["tick_us"]["best"] > 0.0
    assert all(core[name]["ratio"] > 0.0 for name in PAIRS)
    assert "steps/s" in table
    effects = {row["effect"]: row for row in result["effects"]}
    assert {*effects} == {OFF, *EFFECTS, WORLD}
    assert all(row["cpu_us"] > 0.0 and row["ratio"] > 0.0 for row in effects.values())
    grasps = {row["part"]: row for row in result["grasps"]}
    assert {*grasps} == {*GRASPS}
    assert grasps["Hover"]["of_hover"] == grasps["Crawl"]["of_crawl"] == 1.0
    assert all(name in table for name in (*effects, *grasps))


def test_the_timed_effects_change_a_flight():
    def flown(plant):
        env = gymnasium.make(**MOVING, plant=plant)
        env.reset(seed=3)
        seen = [env.step(np.zeros(env.action_space.shape or ()))[0] for _ in range(120)][-1]
        env.close()
        return seen.tobytes()

    # The board scales thrusts only beyond the largest one, which no rotor needs here.
    acting = [plant for name, plant in EFFECTS.items() if "board" not in name]
    assert len(acting) == len(EFFECTS) - 1
    assert len({flown(plant) for plant in (PlantConfig(), *acting)}) == 1 + len(acting)


def test_the_hard_states_are_the_same_each_time_and_hard():
    first, second = (hard_demands(np.random.default_rng(3), 20) for _ in range(2))
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a.wrench, b.wrench)
        np.testing.assert_array_equal(a.torque_map, b.torque_map)
    assert any(demand.restricted.any() for demand in first)


def test_a_measurement_orders_its_figures():
    timing = measure(lambda: sum(range(100)), seconds=0.02)
    assert 0.0 < timing["best"] <= timing["median"] <= timing["p99"]


def test_the_help_names_the_command_that_times_learners(capfd):
    with pytest.raises(SystemExit) as stop:
        main(["bench", "--help"])
    assert stop.value.code == 0
    assert "python -m train.speed" in " ".join(capfd.readouterr().out.split())
