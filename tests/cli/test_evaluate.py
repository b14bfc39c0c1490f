"""Pins `spidar eval` and `spidar leaderboard`: rows written completely or not at all, one line for every refusal."""

import importlib.util
import json
import re
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from spidar_gym.benchmark import HOVER, TRACKS, load_scenarios, scoring
from spidar_gym.benchmark.row import read_row, read_rows, row_hash
from spidar_gym.benchmark.track import SCENARIOS
from spidar_gym.cli import evaluate as cli_eval
from spidar_gym.cli.evaluate import BASELINES
from spidar_gym.cli.main import main

ROOT = Path(__file__).resolve().parents[2]
module = importlib.import_module("spidar_gym.benchmark.evaluate")
TRACK, QP = "flight-fast5", "baselines.qp:QP"
MODULE = '''
"""Policies of a test."""


class Push:
    """Pushes upwards without end."""

    name = "push"

    def arguments(self, env_id):
        return {"preset": "paper"} if "Hover" in env_id else None

    def reset(self, seed):
        pass

    def act(self, observation):
        return [0.0, 0.0, 0.5, 0.0, 0.0, 0.0]


class Gentle(Push):
    """The same, half as hard."""

    def act(self, observation):
        return [0.0, 0.0, 0.25, 0.0, 0.0, 0.0]


class Fails(Push):
    """Does not even begin."""

    name = "fails"

    def act(self, observation):
        raise RuntimeError("first line\\nsecond line")


class Leaves(Push):
    """Ends the program."""

    name = "leaves"

    def act(self, observation):
        raise SystemExit(0)


class Magic(Push):
    """Of no kind that there is."""

    name, kind = "magic", "magic"
'''


def settle(folder: Path, monkeypatch) -> None:
    """Work in a folder with a module of policies; flights take 0.5 s, crawls and courses 0.1 s."""
    folder.mkdir()
    (folder / "mine.py").write_text(MODULE, encoding="utf-8")
    monkeypatch.chdir(folder)
    monkeypatch.setattr(sys, "path", [str(ROOT), *sys.path])
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    importlib.invalidate_caches()
    for name, track in TRACKS.items():
        monkeypatch.setitem(TRACKS, name, replace(track, seconds=0.5 if name == TRACK else 0.1))


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch) -> Path:
    """Return the working folder."""
    settle(tmp_path / "here", monkeypatch)
    yield tmp_path / "here"
    sys.modules.pop("mine", None)


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    """Return a working folder in which the reference and another policy have been evaluated."""
    folder = tmp_path_factory.mktemp("made") / "here"
    with pytest.MonkeyPatch.context() as monkeypatch:
        settle(folder, monkeypatch)
        evaluate()
        evaluate(policy="mine:Push")
        assert "mine" not in sys.modules  # its code ran in a separate process
    return folder


def evaluate(*more, policy=QP, out="rows", scenarios=2) -> None:
    """Run `spidar eval` for a policy on two scenarios of one track, in this process."""
    main(["eval", "--policy", policy, "--tracks", TRACK, "--scenarios", str(scenarios), "--workers", "1",
          "--out", out, *more])  # fmt: skip


@pytest.fixture
def rows(made, here, capfd) -> Path:
    """Return a folder with two rows, the reference's and another; their finished scenarios are kept."""
    for name in ("rows", "out"):
        shutil.copytree(made / name, here / name)
    capfd.readouterr()
    return here / "rows"


def files(folder: Path) -> dict[str, bytes]:
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def refused(capfd, call, *arguments, code=2) -> str:
    """Return the line on stderr with which a command is refused, below its progress bars."""
    with pytest.raises(SystemExit) as stop:
        call(*arguments)
    out, err = capfd.readouterr()
    assert stop.value.code == code
    assert "written" not in out
    bars = ("scenario/s", "s/scenario")  # tqdm's unit depends on the speed
    lines = [line for line in err.splitlines() if not any(bar in line for bar in bars) and line.strip()]
    assert len(lines) == 1
    assert lines[0].startswith("spidar: ")
    return lines[0]


# An evaluation


def test_an_evaluation_writes_its_row_and_sets_it_beside_the_reference(here, capfd):
    evaluate(out="baselines/scores")
    assert "qp" in capfd.readouterr().out
    evaluate(policy="mine:Push")
    out = capfd.readouterr().out
    assert "push: Pushes upwards without end." in out
    assert re.search(r"against .*\n.*\n.* qp ", out)
    assert TRACK in out
    assert str(Path("rows/push.json")) in out
    row = read_row(here / "rows" / "push.json")
    assert (row.name, row.kind, row.tracks, row.policies) == ("push", "unstated", [TRACK], ("mine:Push",))
    assert row.scenarios(TRACK) == [0, 1]
    assert row.errors(TRACK).shape == (1, 2)
    assert row.content["tracks"][TRACK]["scenarios_sha256"] == load_scenarios(TRACK)[1]
    assert set(files(here / "rows")) == {"push.json"}


def test_the_command_in_a_row_gives_the_row_again(rows, here, capfd):
    row = read_row(rows / "push.json")
    words = row.content["command"].split()
    assert words[0] == "spidar"
    main([*words[1:], "--workers", "1", "--out", "again", "--cache", "elsewhere"])
    assert read_row(here / "again" / "push.json").content["sha256"] == row.content["sha256"]


def test_a_policy_whose_scenarios_are_kept_is_evaluated_only_once(rows, here, monkeypatch, capfd):
    before = read_row(rows / "push.json").content

    def never(shards):
        raise AssertionError

    monkeypatch.setattr(module, "play_shards", never)
    evaluate(policy="mine:Push", out="again")
    assert read_row(here / "again" / "push.json").content["sha256"] == before["sha256"]


def test_without_tracks_the_policy_is_evaluated_on_every_one_on_which_it_is_defined(here, capfd):
    main(["eval", "--policy", "mine:Push", "--scenarios", "1", "--workers", "1"])
    row = read_row(here / "out" / "scores" / "push.json")
    assert row.tracks == [name for name, track in TRACKS.items() if track.env_id == HOVER]
    assert len(files(here / "out" / "eval")) == len(row.tracks)


def test_several_policies_are_the_runs_of_one_row(here, capfd):
    evaluate("--split", "validation", policy="mine:Push")
    once = read_row(here / "rows" / "push.json")
    main(["eval", "--policy", "mine:Push", "mine:Gentle", "--tracks", TRACK, "--scenarios", "2", "--workers", "1",
          "--split", "validation", "--out", "rows"])  # fmt: skip
    row = read_row(here / "rows" / "push.json")
    assert row.policies == ("mine:Push", "mine:Gentle")
    assert row.content["tracks"][TRACK]["split"] == once.content["tracks"][TRACK]["split"] == "validation"
    assert row.errors(TRACK).shape == (2, 2)
    assert row.errors(TRACK)[0].tolist() == once.errors(TRACK)[0].tolist()
    assert row.errors(TRACK)[1].tolist() != row.errors(TRACK)[0].tolist()
    assert "--split validation" in row.content["command"]


def test_all_baselines_get_a_row_each_where_they_are_defined(here, capfd, monkeypatch):
    monkeypatch.setattr(scoring, "_steps_of", lambda seconds, env: 60)  # the Python controllers are slow
    main(["eval", "--baselines", "--tracks", "flight-fast3", "--scenarios", "1", "--workers", "1"])
    out = capfd.readouterr().out
    names = {path.stem for path in (here / "out" / "scores").glob("*.json")}
    assert names == {
        "qp", "qp_as_flown", "qp_as_flown_quasi", "qp_unconstrained", "pinv", "unlimited", "scaled", "compensation",
        "planning", "indi", "adrc", "mpc", "adrc_steady", "indi_steady", "compensation_steady", "mpc_steady",
        "qp_tuned", "qp_tuned_v1", "qp_retuned", "qp_steady", "hold", "blind",
    }  # fmt: skip
    assert len(names) == len(BASELINES) - 17, "four only crawl, six go courses, seven grasp"
    assert all(f"\n{name}: " in "\n" + out for name in names)


def test_baselines_without_the_library_of_one_of_them_are_refused_before_any_is_evaluated(here, capfd, monkeypatch):
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *rest: None if name == "cma" else find(name, *rest))
    assert "pip install 'spidar-gym[tune]'" in refused(capfd, main, ["eval", "--baselines"])
    assert set(files(here)) == {"mine.py"}


def test_json_is_one_object_with_the_rows_and_nothing_else(here, capfd):
    evaluate(out="baselines/scores")
    capfd.readouterr()
    evaluate("--json", policy="mine:Push")
    (row,) = json.loads(capfd.readouterr().out)["rows"]
    written = read_row(here / "rows" / "push.json")
    assert (row["name"], row["sha256"]) == ("push", written.content["sha256"])
    assert row["reference"] == {"qp": read_row(here / "baselines" / "scores" / "qp.json").content["sha256"]}
    cell = row["tracks"][TRACK]
    assert cell["error"] == pytest.approx(written.errors(TRACK).mean())
    assert cell["score"]["value"] < 1.0
    assert cell["scenarios"] == 2


def test_other_rows_stay_as_they_are(rows, here, capfd):
    before = files(rows)
    evaluate("--cache", "elsewhere", policy="mine:Push", scenarios=1)
    after = files(rows)
    assert after["qp.json"] == before["qp.json"]
    assert after["push.json"] != before["push.json"]
    assert set(after) == set(before)


# Refusals


@pytest.mark.parametrize(
    ("arguments", "valid"),
    [
        ([], "--baselines"),
        (["--policy", QP, "--baselines"], "--baselines"),
        (["--policy", QP, "--tracks", "flight"], "flight-paper"),
        (["--policy", QP, "--tracks", TRACK, "flight"], "flight-paper"),
        *((["--policy", QP, "--scenarios", n], f"1 … {SCENARIOS}") for n in ("0", "-1", str(SCENARIOS + 1))),
        (["--policy", QP, "--scenarios", "some"], "a whole number"),
        (["--policy", QP, "--split", "train"], "test, validation"),
        (["--policy", QP, "--workers", "0"], "at least 1"),
        *((["--policy", QP, "--act-limit", s], "above 0 [s]") for s in ("0", "-1", "nan")),
        (["--policy", "mine"], "module:Class"),
        (["--policy", "mine:Missing"], "module:Class"),
        (["--policy", "nothing.npz"], "nothing.npz"),
        (["--policy", "mine:Push", "--tracks", "ground-paper"], "spidar_gym/Hover-v0"),
        (["--policy", "mine:Magic", "--tracks", TRACK], "classical or learned or residual"),
        (["--policy", "mine:Push", QP, "--tracks", TRACK], "the same name"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)  # fmt: skip
def test_bad_input_is_refused_in_one_line_and_nothing_is_run_or_written(arguments, valid, capfd, here, monkeypatch):
    before = files(here)

    def never(shards):
        raise AssertionError("played")

    monkeypatch.setattr(module, "play_shards", never)
    workers = [] if "--workers" in arguments else ["--workers", "1"]
    assert valid in refused(capfd, main, ["eval", *arguments, *workers])
    assert files(here) == before


@pytest.mark.parametrize(
    ("policy", "words"), [("Fails", "scenario 0, tick 0: act() raised RuntimeError"), ("Leaves", "SystemExit")]
)
def test_a_policy_that_fails_is_one_line_and_has_no_row(policy, words, here, capfd):
    (here / "rows").mkdir()
    (here / "rows" / f"{policy.lower()}.json").write_text("mine")
    before = files(here)
    with pytest.raises(SystemExit) as stop:
        evaluate(policy=f"mine:{policy}")
    assert stop.value.code == 2
    assert words in capfd.readouterr().err
    assert files(here) == before


def test_an_error_of_a_policy_is_printed_on_one_line(here, capfd):
    assert "first line" in refused(capfd, lambda: evaluate(policy="mine:Fails"))


def test_ctrl_c_leaves_what_is_finished_and_no_half_of_anything(rows, here, capfd, monkeypatch):
    before, play_shards, played = files(rows), module.play_shards, []

    def interrupt(shards):
        if len(played) == 1:
            raise KeyboardInterrupt
        played.extend(shards)
        return play_shards(shards)

    monkeypatch.setattr(module, "play_shards", interrupt)
    with pytest.raises(SystemExit) as stop:
        evaluate("--cache", "kept", policy="mine:Push", scenarios=3)
    assert stop.value.code == 130
    assert "spidar: interrupted; 1 of 3 scenarios kept in kept; the same command resumes\n" in capfd.readouterr().err
    assert files(rows) == before
    assert len(files(here / "kept")) == 1
    assert all(name.endswith(".json") and ".part" not in name for name in files(here / "kept"))
    monkeypatch.setattr(module, "play_shards", lambda shards: played.extend(shards) or play_shards(shards))
    evaluate("--cache", "kept", policy="mine:Push", scenarios=3)
    assert [shard.scenario.index for shard in played] == [0, 1, 2]
    assert read_row(rows / "push.json").scenarios(TRACK) == [0, 1, 2]


# The leaderboard


def test_the_leaderboard_is_shown_as_text_and_as_json(rows, here, capfd):
    rows = shutil.copytree(rows, here / "baselines" / "scores")
    main(["leaderboard", "show", "--rows", str(rows)])
    out = capfd.readouterr().out
    assert all(word in out for word in ("qp", "push", TRACK, "against qp"))
    main(["leaderboard", "show", "--rows", str(rows), "--json"])
    board = json.loads(capfd.readouterr().out)
    scores = {(entry["policy"], entry["track"]): entry["score"]["value"] for entry in board["tracks"]}
    assert set(scores) == {("qp", TRACK), ("push", TRACK)}
    assert scores["qp", TRACK] == 1.0
    assert scores["push", TRACK] < 1.0
    assert board["overall"] == []


def test_the_users_rows_are_shown_among_the_committed_ones_and_marked(rows, here, capfd):
    """The user's folder needs no row of the reference, and a row with the reference's name does not replace it."""
    committed = shutil.copytree(rows, here / "baselines" / "scores")
    (committed / "push.json").unlink()
    (rows / "qp.json").unlink()
    main(["leaderboard", "show", "--rows", str(rows)])
    out = capfd.readouterr().out
    assert f"from {rows}: push; the other rows are the committed ones" in out
    assert re.search(r"^qp +1 \[1, 1\]", out, re.MULTILINE)
    main(["leaderboard", "compare", "--row", str(rows / "push.json"), "--rows", str(rows)])
    assert "push against qp" in capfd.readouterr().out
    renamed = json.loads((rows / "push.json").read_text(encoding="utf-8")) | {"name": "qp"}
    (rows / "push.json").write_text(json.dumps({**renamed, "sha256": row_hash(renamed)}), encoding="utf-8")
    main(["leaderboard", "show", "--rows", str(rows), "--json"])
    scores = {e["policy"]: e["score"]["value"] for e in json.loads(capfd.readouterr().out)["tracks"]}
    assert scores["qp"] == 1.0
    assert scores["qp (own)"] < 1.0
    main(["leaderboard", "show", "--rows", str(committed)])
    assert "the committed ones" not in capfd.readouterr().out


def test_the_leaderboard_shows_the_chosen_tracks(rows, here, capfd):
    rows = shutil.copytree(rows, here / "baselines" / "scores")
    main(["leaderboard", "show", "--rows", str(rows), "--tracks", "flight-paper"])
    assert TRACK not in capfd.readouterr().out
    arguments = ["leaderboard", "show", "--rows", str(rows), "--tracks", "flight"]
    assert "flight-paper" in refused(capfd, main, arguments)


def test_the_leaderboard_is_built_as_a_page_with_its_picture_and_the_same_twice(rows, here, capfd):
    pytest.importorskip("matplotlib")
    pages = []
    for out in ("a", "b"):
        main(["leaderboard", "build", "--rows", str(rows), "--out", out])
        assert "2 rows" in capfd.readouterr().out
        found = files(here / out)
        assert set(found) == {"LEADERBOARD.md", "leaderboard.png"}
        assert found["leaderboard.png"].startswith(b"\x89PNG")
        pages.append(found["LEADERBOARD.md"])
    assert pages[0] == pages[1]
    assert f"## {TRACK}".encode() in pages[0]
    assert b"## flight-paper" not in pages[0]


def test_without_matplotlib_the_page_is_written_and_the_missing_extra_is_named(rows, here, capfd, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    main(["leaderboard", "build", "--rows", str(rows), "--out", "board"])
    out, err = capfd.readouterr()
    assert "2 rows" in out
    assert "no picture: matplotlib is not available; install it with: pip install 'spidar-gym[viz]'" in err
    assert set(files(here / "board")) == {"LEADERBOARD.md"}


@pytest.mark.parametrize("command", ["show", "build", "verify"])
def test_a_leaderboard_without_rows_is_refused(command, here, capfd):
    assert "valid: one with rows" in refused(capfd, main, ["leaderboard", command, "--rows", "nowhere"])
    (here / "empty").mkdir()
    assert "valid: a folder with rows" in refused(capfd, main, ["leaderboard", command, "--rows", "empty"])
    assert set(files(here)) == {"mine.py"}


def test_a_leaderboard_without_the_reference_is_refused(rows, capfd):
    (rows / "qp.json").unlink()
    assert "qp.json" in refused(capfd, main, ["leaderboard", "build", "--rows", str(rows)])


def test_correct_rows_are_verified_bit_for_bit(rows, capfd):
    main(["leaderboard", "verify", "--rows", str(rows), "--sample", "3", "--workers", "1", "--trust"])
    *lines, summary = capfd.readouterr().out.splitlines()
    assert all(line.endswith("equal") for line in lines[:3])
    assert all(line.endswith(" bit for bit") for line in lines[3:])
    assert 4 <= len(lines) <= 5
    assert "3 equal bit for bit" in summary


def test_a_row_edited_by_hand_is_refused_everywhere(rows, here, capfd):
    rows = shutil.copytree(rows, here / "baselines" / "scores")
    path = rows / "push.json"
    path.write_text(path.read_text(encoding="utf-8").replace('"success": [', '"success": [ ', 1), encoding="utf-8")
    main(["leaderboard", "show", "--rows", str(rows)])
    capfd.readouterr()
    content = json.loads(path.read_text(encoding="utf-8"))
    content["tracks"][TRACK]["runs"][0]["error"][0] *= 0.5
    path.write_text(json.dumps(content), encoding="utf-8")
    for command in ("show", "verify", "build"):
        assert "edited by hand" in refused(capfd, main, ["leaderboard", command, "--rows", str(rows)])


def test_a_row_that_differs_from_its_policys_results_fails_the_verification(rows, capfd):
    path = rows / "push.json"
    content = json.loads(path.read_text(encoding="utf-8"))
    content["tracks"][TRACK]["runs"][0]["error"] = [0.5 * x for x in content["tracks"][TRACK]["runs"][0]["error"]]
    path.write_text(json.dumps({**content, "sha256": row_hash(content)}), encoding="utf-8")
    (rows / "qp.json").unlink()
    arguments = ["leaderboard", "verify", "--rows", str(rows), "--sample", "2", "--workers", "1", "--trust"]
    line = refused(capfd, main, arguments)
    assert "2 of 2 scenarios give other results" in line


def test_a_row_of_a_policy_that_has_changed_since_is_not_verified(rows, here, capfd):
    with (here / "mine.py").open("a", encoding="utf-8") as file:
        file.write("# changed\n")
    (rows / "qp.json").unlink()
    arguments = ["leaderboard", "verify", "--rows", str(rows), "--sample", "1", "--workers", "1"]
    assert "mine:Push is code from outside" in refused(capfd, main, arguments)
    arguments.append("--trust")
    assert "mine:Push has changed since" in refused(capfd, main, arguments)


@pytest.mark.parametrize(
    "options", [["--sample", "0"], ["--workers", "0"], ["--seed", "-1"], ["--per-run", "-1"]], ids=" ".join
)
def test_a_sample_of_nothing_is_refused(options, rows, capfd):
    assert "at least" in refused(capfd, main, ["leaderboard", "verify", "--rows", str(rows), *options])


# Scenarios


def test_stale_scenario_files_are_named_by_the_check_and_written_without_it(tmp_path, capfd, monkeypatch):
    source = cli_eval.assets_dir() / "scenarios"
    drawn = {
        f"scenarios/{path.relative_to(source).as_posix()}": path.read_text(encoding="utf-8")
        for path in sorted(source.rglob("*")) if path.is_file()
    }  # fmt: skip
    shutil.copytree(source, tmp_path / "scenarios")
    monkeypatch.setattr(cli_eval, "assets_dir", lambda: tmp_path)
    monkeypatch.setattr(cli_eval, "scenario_files", lambda on_scenario: drawn)
    main(["scenarios", "--check"])
    fresh = files(tmp_path / "scenarios")
    path = tmp_path / "scenarios" / "test" / "ground-paper.json"
    path.write_text("{}")
    assert str(path) in refused(capfd, main, ["scenarios", "--check"])
    assert path.read_text() == "{}"
    main(["scenarios"])
    assert f"1 of {len(drawn)} files written" in capfd.readouterr().out
    assert files(tmp_path / "scenarios") == fresh


def test_a_second_draw_is_written_beside_the_first_and_verified_with_it(here, capfd):
    track, words = "flight-calibrated", ["--scenarios", "2", "--workers", "1", "--out", "rows"]
    for split in ("test", "second"):
        main(["eval", "--policy", QP, "--tracks", track, "--split", split, *words])
        assert re.search(rf"{track} +1 \[1, 1\]", capfd.readouterr().out), "compared with its own draw"
    assert {path for path in files(here / "rows")} == {"qp.json", "second/qp.json"}
    row = read_rows(here / "rows")["qp"]
    assert (row.split(track), row.second.split(track)) == ("test", "second")
    main(["leaderboard", "verify", "--rows", "rows", "--all", "--workers", "1"])
    shown = capfd.readouterr().out
    assert f"qp (second), {track}, run 0, scenario 1" in shown
    assert "4 scenarios of 2 rows evaluated again: 4 equal bit for bit" in shown
    line = refused(capfd, main, ["eval", "--policy", QP, "--tracks", TRACK, "--split", "second", *words])
    assert f"{TRACK!r}" in line
    assert "flight-calibrated, flight-calibrated-fast, ground-calibrated" in line
