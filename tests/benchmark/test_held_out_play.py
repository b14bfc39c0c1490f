"""Pins the evaluation of policies under held-out conditions: choice of policies, their bases, resuming."""

from dataclasses import replace
from pathlib import Path

import pytest

from spidar_gym.benchmark import COURSE, CRAWL, HOVER
from spidar_gym.benchmark import held_out_play as module
from spidar_gym.benchmark.held_out import CONDITIONS, draw_held_out
from spidar_gym.benchmark.held_out_play import Entrant, choose, plan, play_all
from spidar_gym.benchmark.row import ROWS, RowError, read_rows
from spidar_gym.benchmark.scoring import play_scenario
from spidar_gym.errors import InvalidValueError, SpidarError, UnknownNameError
from spidar_gym.policies.load import load_policy
from spidar_gym.policies.source import PolicyError

ROOT = Path(__file__).resolve().parents[2]
QP, TUNED = "baselines.qp:QP", "baselines.qp_tuned:QPTuned"
SEED = str(ROOT / "baselines" / "learned" / "supervised_tuned" / "seed0.npz")
SHORT = "duct-fast4"


@pytest.fixture(scope="module")
def rows():
    return read_rows(ROOT / ROWS)


@pytest.fixture
def short(monkeypatch):
    """A condition with flights of half a second."""
    draw_held_out.cache_clear()
    monkeypatch.setitem(CONDITIONS, SHORT, replace(CONDITIONS[SHORT], seconds=0.5))
    yield SHORT
    draw_held_out.cache_clear()


def entrant(policy=QP, name="qp", conditions=(SHORT,)) -> Entrant:
    return Entrant(name, "classical", (policy,), "", conditions)


# Policies


def test_every_row_with_a_controller_below_it_is_played_where_it_is_defined(rows, monkeypatch):
    monkeypatch.chdir(ROOT)
    found = {entrant.name: entrant for entrant in choose(rows)}
    grasps = {name for name in rows if name.startswith("grasp_")}  # no condition has an object
    assert set(rows) - set(found) == {"distilled", "distilled_ppo", "direct", "hold", "ppo_direct", *grasps}
    assert list(found) == [name for name in rows if name in found]
    for name, one in found.items():
        assert one.policies == rows[name].policies
        worlds = {CONDITIONS[condition].env_id for condition in one.conditions}
        of = {"flight": HOVER, "ground": CRAWL, "course": COURSE}
        assert worlds == {of[track.split("-")[0]] for track in rows[name].tracks}
    assert found["supervised_tuned"].against == "qp_tuned_v1"
    assert len(found["supervised_tuned"].policies) == 5
    assert found["learned_gait"].against == "qp_robust_overlapped_v1"
    assert found["qp"].against == ""
    assert set(found["qp"].conditions) == {name for name, one in CONDITIONS.items() if one.env_id != COURSE}


def test_named_rows_are_chosen_with_their_base_and_even_without_a_controller(rows, monkeypatch):
    monkeypatch.chdir(ROOT)
    assert [one.name for one in choose(rows, ["ppo_paper"])] == ["qp", "ppo_paper"]
    assert [one.name for one in choose(rows, ["hold"])] == ["hold"]


def test_a_row_whose_base_is_missing_is_compared_with_none(rows, monkeypatch):
    monkeypatch.chdir(ROOT)
    alone = {"ppo_paper": rows["ppo_paper"]}
    assert [(one.name, one.against) for one in choose(alone)] == [("ppo_paper", "")]


@pytest.mark.parametrize(
    ("against", "base"), [("", "qp_tuned_v1"), ("tuned", "qp_tuned"), ("qp_tuned", "qp_tuned"), ("paper", "qp")]
)
def test_a_candidate_is_compared_with_its_preset_or_a_given_row(against, base, rows):
    rows = {name: row for name, row in rows.items() if name != "supervised_tuned"}
    first, own = choose(rows, policies=[SEED, SEED.replace("seed0", "seed1")], against=against)
    assert (first.name, own.against) == (base, base)
    assert (own.name, own.kind, len(own.policies)) == ("supervised_tuned", "residual", 2)
    assert set(own.conditions) == {name for name, condition in CONDITIONS.items() if condition.flies}


def test_a_candidate_that_adds_to_nothing_is_played_alone(rows):
    (own,) = choose({"qp": rows["qp"]}, policies=[TUNED])
    assert (own.name, own.against) == ("qp_tuned", "")


@pytest.mark.parametrize(
    ("arguments", "error", "words"),
    [
        ({"names": ["missing"]}, UnknownNameError, "unknown row 'missing'; valid: qp, "),
        ({"against": "qp"}, InvalidValueError, "expected a candidate that is compared with it, --policy FILE"),
        ({"policies": [TUNED], "against": "rl"}, UnknownNameError, "unknown row or preset 'rl'; valid: qp, "),
        ({"policies": [QP, TUNED]}, InvalidValueError, "runs of one policy"),
        ({"policies": [TUNED], "names": ["qp_tuned"]}, InvalidValueError, "with another name than the rows"),
        ({"policies": [SEED], "against": "supervised_tuned"}, InvalidValueError, "with another name than the rows"),
        ({"policies": ["baselines.qp:Missing"]}, PolicyError, "Missing"),
    ],
)
def test_invalid_choices_are_refused_in_one_line(arguments, error, words, rows, monkeypatch):
    monkeypatch.chdir(ROOT)
    with pytest.raises(error) as refusal:
        choose(rows, **arguments)
    assert words in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_a_preset_without_a_row_is_refused_with_the_existing_rows(rows):
    with pytest.raises(InvalidValueError, match="against = 'tuned_v1' is not valid; expected one of qp, or a preset"):
        choose({"qp": rows["qp"]}, policies=[SEED])


def test_a_row_runs_no_code_from_outside_the_package_and_no_changed_file(rows, monkeypatch):
    strange = replace(rows["qp"], policies=("json.decoder:JSONDecoder",))
    with pytest.raises(RowError, match="valid: --trust"):
        choose({"qp": strange})
    changed = replace(rows["qp"], content={**rows["qp"].content, "policies_sha256": ["0" * 64]})
    with pytest.raises(RowError, match="has changed since"):
        choose({"qp": changed})


# Evaluation


def test_every_run_plays_the_same_scenarios_of_every_condition_in_order():
    pair = replace(entrant(), policies=(QP, TUNED), conditions=("duct-fast2", "payload-crawl"))
    episodes = plan([pair], 2)
    assert [(e.policy, e.condition, e.scenario.index) for e in episodes] == [
        (policy, condition, k)
        for policy in (QP, TUNED)
        for condition in ("duct-fast2", "payload-crawl")
        for k in (0, 1)
    ]
    assert [e.scenario for e in episodes[:4]] == [e.scenario for e in episodes[4:]]


def test_side_by_side_gives_the_bits_of_one_by_one_on_the_conditions_robot(short):
    together = play_all(plan([entrant()], 2))
    scenarios = draw_held_out(short, 2)
    alone = [play_scenario(load_policy(QP), short, one, track=CONDITIONS[short])["metrics"] for one in scenarios]
    assert together == alone
    described = replace(CONDITIONS[short], options={**CONDITIONS[short].options, "plant": None})
    other = [play_scenario(load_policy(QP), short, one, track=described)["metrics"] for one in scenarios]
    assert all(a["position_rms_m"] != b["position_rms_m"] for a, b in zip(alone, other, strict=True))


def test_what_is_finished_is_kept_and_only_the_rest_is_played(short, tmp_path, monkeypatch):
    episodes, played, play = plan([entrant(), entrant(TUNED, "qp_tuned")], 2), [], module.play_episodes

    def interrupted(items):
        if played:
            raise KeyboardInterrupt
        played.extend(items)
        return play(items)

    monkeypatch.setattr(module, "play_episodes", interrupted)
    with pytest.raises(KeyboardInterrupt):
        play_all(episodes, folder=tmp_path)
    assert [one.policy for one in played] == [QP, QP]
    assert sorted(path.parent.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*.json")) == [
        f"qp/{short}", f"qp/{short}",
    ]  # fmt: skip
    monkeypatch.setattr(module, "play_episodes", lambda items: played.extend(items) or play(items))
    counted = []
    metrics = play_all(episodes, folder=tmp_path, on_episode=lambda: counted.append(1))
    assert [one.policy for one in played] == [QP, QP, TUNED, TUNED]
    assert len(counted) == len(metrics) == 4
    assert play_all(episodes, folder=tmp_path) == metrics
    assert len(played) == 4
    assert play_all(episodes[:0]) == []


def test_kept_episodes_of_other_code_or_scenarios_are_played_again(short, tmp_path, monkeypatch):
    def names():
        return {path.name for path in tmp_path.rglob("*.json")}

    play_all(plan([entrant()], 1), folder=tmp_path)
    once = names()
    monkeypatch.setattr(module, "code_digest", lambda *names: "another")
    play_all(plan([entrant()], 1), folder=tmp_path)
    assert len(names() - once) == 1


def test_a_policy_that_is_not_defined_on_a_condition_is_refused(short):
    with pytest.raises(SpidarError, match="expected a track on which the policy is defined"):
        play_all(plan([entrant("baselines.qp_tuned:QPOverlapped")], 1))
