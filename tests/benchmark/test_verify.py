"""Pins the check of rows: which scenarios are evaluated again, the tolerances, and refusals."""

import inspect
import json
import re
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.rows import SPEC, TRACK, changed, made_row, score, stored

from spidar_gym.benchmark import verify as verifying
from spidar_gym.benchmark.evaluate import evaluate
from spidar_gym.benchmark.metrics import told_in
from spidar_gym.benchmark.row import RowError, make_row, read_row, row_hash, row_of, write_row
from spidar_gym.benchmark.scenario import load_scenarios
from spidar_gym.benchmark.track import CAP, TRACKS
from spidar_gym.benchmark.verify import (
    Check,
    drawn_per_run,
    drawn_sample,
    every_scenario,
    largest_differences,
    measures,
    other_conditions,
    require_verified,
    results,
)
from spidar_gym.errors import SpidarError
from spidar_gym.policies.load import load_policy
from spidar_gym.policies.provenance import file_digest
from spidar_gym.policies.source import source_file

GROUND = "ground-paper"
ROOT = Path(__file__).resolve().parents[2]


def draw(seed=0):
    return np.random.default_rng(seed)


def verify(rows, sample, rng, **how):
    return verifying.verify(rows, drawn_sample(every_scenario(rows), sample, rng), **how)


@pytest.fixture
def replay(monkeypatch):
    """Replace the evaluation by the metrics of a row after a change; record the requested shards."""

    def start(row, change=lambda metrics: None):
        asked = []

        def answer(shards, *, workers=1, folder=None, on_done):
            asked.append((shards, workers))
            results = []
            for shard in shards:
                where = row.scenarios(shard.track).index(shard.scenario.index)
                assert shard.scenario == load_scenarios(shard.track, shard.split)[0][shard.scenario.index]
                run = row.part(shard.track).content["tracks"][shard.track]["runs"][0]
                metrics = {name: values[where] for name, values in run.items()}
                change(metrics)
                results.append({"metrics": metrics, "timing": {}})
                on_done(len(results) - 1, results[-1])
            return results

        monkeypatch.setattr(verifying, "run_shards", answer)
        return asked

    return start


def flight(error=0.5):
    return made_row({TRACK: [score(TRACK, [error], indices=(7,))]})


def elsewhere(row, folder, change=lambda c: c["versions"].update(numpy="1.0")):
    """The row as made on another machine."""
    return read_row(stored(changed(row, change), folder))


def check_of(row, sample=1):
    (check, *_) = verify({row.name: row}, sample, draw())
    return check


@pytest.fixture(scope="module")
def rows():
    """Two rows on scenarios other than the first, one of them on the split `validation`."""
    one = {TRACK: [score(TRACK, [0.3, 0.4, CAP], indices=(9, 2, 30))], GROUND: [score(GROUND, [0.7], indices=(4,))]}
    other = {GROUND: [score(GROUND, [0.8, 0.9], indices=(0, 49), split="validation")]}
    return {"qp": made_row(one), "own": made_row(other, "own")}


def test_a_row_that_comes_out_the_same_is_verified(replay):
    row = made_row({TRACK: [score(TRACK, [0.3, 0.4, CAP], indices=(9, 2, 30))], GROUND: [[0.7, CAP]]})
    replay(row)
    checks = verify({"qp": row}, 12, draw())
    assert len({check.line for check in checks}) == len(checks) == 5  # all of them, each once
    assert all(check.equal and check.passes and check.line.endswith(", equal") for check in checks)
    require_verified(checks)


def test_every_row_track_and_scenario_is_drawn_and_named(rows, monkeypatch):
    def answer(shards, *, on_done, **_):
        found = []
        for s in shards:
            row = rows["qp" if s.split == "test" else "own"]
            where, run = row.scenarios(s.track).index(s.scenario.index), row.content["tracks"][s.track]["runs"][0]
            found.append({"metrics": {name: values[where] for name, values in run.items()}, "timing": {}})
            on_done(len(found) - 1, found[-1])
        return found

    monkeypatch.setattr(verifying, "run_shards", answer)
    rng = draw()
    checks = [verify(rows, 1, rng)[0] for _ in range(600)]
    assert all(check.equal for check in checks)
    count = Counter(check.line.split(": ")[0] for check in checks)
    assert set(count) == {
        *(f"qp, {TRACK}, run 0, scenario {k}" for k in (9, 2, 30)),
        f"qp, {GROUND}, run 0, scenario 4",
        *(f"own, {GROUND}, run 0, scenario {k}" for k in (0, 49)),
    }
    # Rows evenly, then tracks, then scenarios: ½ · ½ · ⅓, ½ · ½, ½ · ½ of 600; five standard deviations.
    for where, times in count.items():
        share = 1 / 12 if TRACK in where else 1 / 4
        assert abs(times - 600 * share) < 5.0 * np.sqrt(600 * share * (1.0 - share))


def test_runs_are_drawn_each_with_its_own_policy(tmp_path, monkeypatch):
    policies = written_policies(tmp_path, monkeypatch, "run_a", "run_b", "run_c")
    scores = {TRACK: [score(TRACK, [0.1 * (k + 1)]) for k in range(3)]}
    row = make_row([load_policy(spec) for spec in policies], policies, scores, command="")
    runs = dict(zip(policies, row.content["tracks"][TRACK]["runs"], strict=True))
    first = {spec: {"metrics": {name: values[0] for name, values in run.items()}} for spec, run in runs.items()}

    def answer(shards, *, on_done, **_):
        for place, shard in enumerate(shards):
            on_done(place, first[shard.policy])

    monkeypatch.setattr(verifying, "run_shards", answer)
    checks = verify({"own": row}, 3, draw(), trust=True)
    assert all(check.equal for check in checks)
    assert {found[1] for check in checks if (found := re.search(r"run (\d)", check.line))} == {"0", "1", "2"}


def written_policies(folder, monkeypatch, *names):
    """Write each policy to a separate file; return the specifications."""
    monkeypatch.syspath_prepend(folder)
    for name in names:
        code = f"class Own:\n    name = 'own'\n    def reset(self, seed): '{name}'\n    def act(self, o): return o\n"
        (folder / f"{name}.py").write_text(code)
    return [f"{name}:Own" for name in names]


def test_a_seed_gives_the_same_sample_and_another_seed_another(rows, replay):
    asked = replay(rows["qp"])
    for seed in (0, 0, 1):
        verify({"qp": rows["qp"]}, 3, draw(seed))
    first, again, other = (shards for shards, _ in asked)
    assert first == again != other


def test_all_is_every_scenario_once_and_a_draw_per_run_leaves_out_no_run(rows):
    every = every_scenario(rows)
    assert len(set(every)) == len(every) == 6
    assert every_scenario(rows, [TRACK]) == [("qp", TRACK, 0, k) for k in range(3)]
    for seed in range(5):
        drawn = drawn_per_run(every, 1, draw(seed))
        assert [pick[:3] for pick in drawn] == [("qp", TRACK, 0), ("qp", GROUND, 0), ("own", GROUND, 0)]
        assert drawn_sample(every, 99, draw(seed)) != every
        assert sorted(drawn_sample(every, 99, draw(seed))) == sorted(every)
    assert drawn_per_run(every, 9, draw()) == every


def test_shards_are_those_of_the_row_and_progress_is_reported(rows, replay):
    asked, told = replay(rows["qp"]), []
    verify({"qp": rows["qp"]}, 3, draw(), workers=3, on_check=told.append)
    ((shards, workers),) = asked
    assert (len(shards), len(told), workers) == (3, 3, 3)
    assert {shard.policy for shard in shards} == {SPEC}
    assert {shard.split for shard in shards} == {"test"}


@pytest.mark.parametrize("factor", [0.5, 1.0 - 1e-15, 1.0 + 1e-12])
def test_an_improved_number_is_detected_though_the_hash_is_right(tmp_path, replay, factor):
    honest = flight()
    better = read_row(
        stored(changed(honest, lambda c: c["tracks"][TRACK]["runs"][0].update(error=[0.5 * factor])), tmp_path)
    )
    assert better.content["sha256"] == row_hash(better.content) != honest.content["sha256"]
    replay(honest)
    checks = verify({"qp": better}, 1, draw())
    assert not any(check.equal or check.passes for check in checks)
    with pytest.raises(
        RowError, match=rf"1 of 1 scenarios give .*qp, {TRACK}, run 0, scenario 7.*DIFFERS \(error .*\).*valid"
    ):
        require_verified(checks)


@pytest.mark.parametrize(("name", "value"), [("energy_wh", 9.99), ("success", False), ("failure", "tilt"),
                                             ("unsolved", 1), ("slip_m", 0.0), ("late_forms", 1)])  # fmt: skip
def test_any_other_metric_counts_as_much_on_the_same_machine(replay, name, value):
    row = flight()
    replay(row, lambda metrics: metrics.update({name: value}))
    check = check_of(row)
    assert not check.equal
    assert not check.passes
    assert f"DIFFERS ({name} " in check.line


OTHERWISE = [
    lambda c: c["versions"].update(mujoco="3.0.0"),
    lambda c: c["versions"].update(python="2.7"),
    lambda c: c.update(processor="another"),
]


@pytest.mark.parametrize("change", OTHERWISE)
def test_another_version_or_processor_may_change_every_number_a_little(tmp_path, replay, change):
    row = elsewhere(flight(), tmp_path, change)
    replay(row, lambda metrics: metrics.update(error=0.5 + 5e-7, energy_wh=10.5 + 9e-7))
    check = check_of(row)
    assert check.passes
    assert not check.equal
    assert check.line.endswith("within tolerance (energy_wh 90.0% of it)")
    require_verified([check])


@pytest.mark.parametrize("track", [TRACK, GROUND, "course-mixed"])
@pytest.mark.parametrize("share", [0.99, 1.01, -0.99, -1.01])
def test_every_metric_has_its_own_tolerance(tmp_path, replay, track, share):
    row = elsewhere(made_row({track: [[0.5]]}), tmp_path)
    world = TRACKS[track].world
    numbers = {n: m for n, m in told_in(world).items() if m.kind is float and world in m.worlds}
    assert len(numbers) > 8
    for name, metric in numbers.items():
        spread = metric.spread[world]
        assert 0.0 < spread < 0.1 * metric.most
        replay(row, lambda metrics, name=name, spread=spread: metrics.update({name: metrics[name] + share * spread}))
        assert check_of(row).passes == (abs(share) < 1.0), name


@pytest.mark.parametrize("change", OTHERWISE)
@pytest.mark.parametrize(
    ("name", "forged"),
    [("position_rms_m", 1e-6), ("energy_wh", 1.0), ("endurance_min", 60.0), ("torque_share", 0.1), ("unsolved", 1),
     ("late_forms", 1), ("failure", "tilt"), ("success", False), ("violations", 0.5), ("thrust_mean", 0.9)],
)  # fmt: skip
def test_a_forged_metric_is_detected_whatever_processor_or_versions_the_row_names(
    tmp_path, replay, change, name, forged
):
    """Invented metrics with a valid hash, under another processor's name."""
    honest = flight()

    def forge(content):
        change(content)
        content["tracks"][TRACK]["runs"][0][name] = [forged]

    row = elsewhere(honest, tmp_path, forge)
    replay(honest)
    check = check_of(row)
    assert not check.passes
    assert f"DIFFERS ({name} {forged} → " in check.line
    with pytest.raises(RowError, match=name):
        require_verified([check])


def test_the_summary_states_the_measure_by_which_each_row_was_checked(tmp_path, replay):
    here, there = flight(), elsewhere(flight(), tmp_path, lambda c: c.update(processor="another"))
    assert other_conditions(here) == ""
    assert other_conditions(there) == "another"
    assert other_conditions(here, "python") == "core"
    replay(here)
    (same,) = verify({"qp": here}, 1, draw())
    (other,) = verify({"qp": there}, 1, draw())
    assert measures([same, same]) == ["qp: 2 bit for bit"]
    assert measures([other]) == ["qp: 1 within tolerance (made with another), 1 of them equal"]
    assert largest_differences([same]) == ""
    replay(here, lambda metrics: metrics.update(energy_wh=10.5 + 5e-7))
    assert largest_differences(verify({"qp": there}, 1, draw())) == "energy_wh 50.00%"


def test_each_file_of_a_row_is_checked_by_the_measure_of_its_processor(replay, tmp_path):
    there = elsewhere(flight(), tmp_path, lambda c: c.update(processor="another"))
    row = replace(there, added=(made_row({"flight-path": [[0.5]]}, "qp"),))
    replay(row)
    checks = verify({"qp": row}, 2, draw())
    assert sorted(measures(checks)) == [
        "qp: 1 bit for bit",
        "qp: 1 within tolerance (made with another), 1 of them equal",
    ]
    replay(row, lambda metrics: metrics.update(energy_wh=10.5 + 5e-7))
    for check in verify({"qp": row}, 2, draw()):
        assert check.passes == (check.conditions == "another")


def test_the_python_controllers_are_checked_within_tolerance_as_their_rounding_differs(tmp_path, replay):
    row = flight()
    asked = replay(row, lambda metrics: metrics.update(energy_wh=10.5 + 5e-7))
    (check,) = verify({"qp": row}, 1, draw(), control="python")
    assert check.passes
    assert asked[0][0][0].control == "python"
    (check,) = verify({"qp": row}, 1, draw())
    assert not check.passes


@pytest.mark.parametrize("was", [0.5, CAP])
def test_no_version_turns_a_failure_into_none_or_none_into_one(tmp_path, replay, was):
    row = elsewhere(flight(was), tmp_path)
    replay(row, lambda metrics: metrics.update(failed=not metrics["failed"]))
    check = check_of(row)
    assert not check.passes
    with pytest.raises(RowError, match="failed"):
        require_verified([check])


def test_metrics_of_a_fall_are_checked_on_the_same_processor_only(tmp_path, replay):
    """Rounding grows to centimetres within a fall, but its error is the cap and the kind of failure stays."""
    fall = flight(CAP)
    for row, passes in ((fall, False), (elsewhere(fall, tmp_path), True)):
        replay(row, lambda metrics: metrics.update(energy_wh=2.0 * metrics["energy_wh"]))
        assert check_of(row).passes == passes
    replay(row, lambda metrics: metrics.update(failure="another"))
    assert not check_of(row).passes
    replay(elsewhere(flight(0.5), tmp_path), lambda metrics: metrics.update(energy_wh=2.0 * metrics["energy_wh"]))
    assert not check_of(elsewhere(flight(0.5), tmp_path)).passes


def test_one_wrong_scenario_among_many_is_enough():
    good = Check("qp", "a", "", {})
    near, wrong = Check("qp", "b", "another", {"error": 0.5}), Check("qp", "this one", "", {"error": 0.5})
    require_verified([good, near, good])
    with pytest.raises(RowError, match=r"^2 of 4 scenarios .*this one.*; valid: ") as caught:
        require_verified([good, wrong, near, wrong])
    assert "\n" not in str(caught.value)


def planted(folder, monkeypatch, name, code=""):
    """A row whose policy file creates the file `ran` when it is executed."""
    spec = f"{name}:Own"
    path = folder / f"{name.replace('.', '/')}.py"
    path.parent.mkdir(exist_ok=True)
    path.write_text(
        f"import pathlib\npathlib.Path({str(folder / 'ran')!r}).touch()\n{code}\n"
        "class Own:\n    name = 'own'\n    def reset(self, seed): pass\n    def act(self, o): return [0.0] * 6\n"
    )
    monkeypatch.chdir(folder)
    row = made_row({TRACK: [score(TRACK, [0.5])]}, "own")
    content = changed(row, lambda c: c.update(policies=[spec], policies_sha256=[file_digest(path)]))
    monkeypatch.setattr(verifying, "run_shards", lambda shards, **_: pytest.fail("played"))
    return row_of(content), path


def test_a_policy_whose_file_has_changed_is_refused_before_it_is_imported(tmp_path, monkeypatch):
    row, path = planted(tmp_path, monkeypatch, "changing")
    path.write_text(path.read_text() + "# better\n")
    with pytest.raises(RowError, match=r"row own: changing:Own has changed since; valid: the row evaluated again"):
        verify({"own": row}, 1, draw(), trust=True)
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize("name", ["foreign", "folder.foreign", "tests_of_mine.baselines"])
def test_a_policy_from_outside_the_package_is_neither_run_nor_imported_without_trust(tmp_path, monkeypatch, name):
    row, _ = planted(tmp_path, monkeypatch, name)
    before = list(sys.path)
    with pytest.raises(RowError, match=rf"row own: {name}:Own is code from outside the package.*; valid: --trust"):
        verify({"own": row}, 1, draw())
    assert not (tmp_path / "ran").exists()
    assert sys.path == before
    assert name not in sys.modules


def test_a_package_of_the_same_name_in_the_working_folder_does_not_win_over_the_committed_baselines(
    tmp_path, monkeypatch
):
    row, path = planted(tmp_path, monkeypatch, "baselines.qp")
    (tmp_path / "baselines" / "__init__.py").write_text(path.read_text())
    assert source_file("baselines.qp:QP") == ROOT / "baselines" / "qp.py"
    with pytest.raises(RowError, match=r"baselines\.qp:Own has changed since"):
        verify({"own": row}, 1, draw())
    assert not (tmp_path / "ran").exists()
    assert type(load_policy("baselines.qp:QP")).__name__ == "QP"
    assert inspect.getsourcefile(type(load_policy("baselines.hold:Hold"))) == str(ROOT / "baselines" / "hold.py")
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize("spec", ["spidar_gym.benchmark.nowhere:Own", "os:Own", "../up:Own", "a..b:Own", "none.npz"])
def test_a_policy_that_is_not_there_is_one_line_and_nothing_is_imported(tmp_path, monkeypatch, spec):
    row, _ = planted(tmp_path, monkeypatch, "mine_own")
    row = row_of(changed(row, lambda c: c.update(policies=[spec])))
    with pytest.raises(SpidarError) as caught:
        verify({"own": row}, 1, draw())
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "ran").exists()


def test_an_evaluated_row_is_reproduced_bit_for_bit_and_a_check_resumes(tmp_path, monkeypatch):
    """A policy without feedback soon fails."""
    spec = "baselines.hold:Hold"
    flown = make_row([load_policy(spec)], [spec], {TRACK: [evaluate(spec, TRACK, [1])]}, command="")
    row = read_row(write_row(flown, tmp_path))
    rms = row.column(TRACK, "position_rms_m")[0, 0]
    assert rms > 0.0
    picks = every_scenario({"hold": row})
    (check,) = verifying.verify({"hold": row}, picks, folder=tmp_path / "kept")
    assert check.equal
    monkeypatch.setattr(
        sys.modules["spidar_gym.benchmark.evaluate"], "play_shards", lambda shards: pytest.fail("played")
    )
    assert verifying.verify({"hold": row}, picks, folder=tmp_path / "kept") == [check]
    (told,) = json.loads(json.dumps(results({"hold": row}, picks, [check])))
    assert (told["row"], told["scenario"], told["metrics"]) == ("hold", 1, check.metrics)
    assert check.line == f"hold, {TRACK}, run 0, scenario 1: error 5, equal"
