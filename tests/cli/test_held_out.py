"""Pins `spidar leaderboard held-out`: a complete file or none, its page, and one line for every refusal."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from spidar_gym.benchmark import held_out_play as module
from spidar_gym.benchmark.held_out import CONDITIONS, HELD_OUT, draw_held_out
from spidar_gym.benchmark.held_out_table import read_content
from spidar_gym.cli.held_out import PAGE
from spidar_gym.cli.main import main

ROOT = Path(__file__).resolve().parents[2]
SEED = str(ROOT / "baselines" / "learned" / "supervised_paper" / "seed0.npz")


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch) -> Path:
    """Return a working folder; there are two conditions, with flights of 1.5 s and crawls of 0.1 s."""
    monkeypatch.chdir(tmp_path)
    draw_held_out.cache_clear()
    every, short = dict(CONDITIONS), {"duct-fast2": 1.5, "delay-crawl": 0.1}
    CONDITIONS.clear()
    CONDITIONS.update({name: replace(every[name], seconds=seconds) for name, seconds in short.items()})
    yield tmp_path
    # Restores their order, which is that of the tables.
    CONDITIONS.clear()
    CONDITIONS.update(every)
    draw_held_out.cache_clear()


def held_out(*more) -> None:
    """Run the command with two scenarios, in this process."""
    main(["leaderboard", "held-out", "--rows", str(ROOT / "baselines" / "scores"), "--scenarios", "2", "--workers", "1",
          *more])  # fmt: skip


def files(folder: Path) -> dict[str, bytes]:
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_a_candidate_is_evaluated_beside_its_controller_and_its_worst_loss_is_printed(here, capfd):
    held_out("--policy", SEED, "--out", "t.json")
    out = capfd.readouterr().out
    content = read_content(here / "t.json")
    assert [entry["name"] for entry in content["policies"]] == ["qp", "supervised_paper"]
    assert content["command"] == f"spidar leaderboard held-out --policy {SEED} --scenarios 2"
    assert list(content["policies"][0]["runs"]) == ["duct-fast2", "delay-crawl"]
    assert list(content["policies"][1]["runs"]) == ["duct-fast2"]
    assert " → " in out
    assert "largest upper end" in out
    assert "written to t.json" in out


def test_a_candidate_against_another_row_and_as_json(here, capfd):
    held_out("--policy", SEED, "--against", "tuned", "--json")
    printed = json.loads(capfd.readouterr().out)["held_out"]
    assert printed == read_content(here / "out" / "held_out.json")
    assert [(entry["name"], entry["against"]) for entry in printed["policies"]] == [
        ("qp_tuned", ""), ("supervised_paper", "qp_tuned"),
    ]  # fmt: skip


def test_the_same_command_again_evaluates_nothing_and_writes_the_same_bytes(here, capfd, monkeypatch):
    held_out("--names", "qp")
    before = (here / "out" / "held_out.json").read_bytes()

    def never(episodes):
        raise AssertionError("played")

    monkeypatch.setattr(module, "play_episodes", never)
    held_out("--names", "qp")
    assert (here / "out" / "held_out.json").read_bytes() == before


def test_an_interruption_leaves_no_table_and_prints_how_to_resume(here, capfd, monkeypatch):
    play, played = module.play_episodes, []

    def interrupted(episodes):
        if played:
            raise KeyboardInterrupt
        played.extend(episodes)
        return play(episodes)

    monkeypatch.setattr(module, "play_episodes", interrupted)
    with pytest.raises(SystemExit) as stop:
        held_out("--names", "qp", "--cache", "kept")
    assert stop.value.code == 130
    words = "spidar: interrupted; 2 of 4 episodes kept in kept; the same command resumes"
    assert words in capfd.readouterr().err
    assert not (here / "out").exists()
    assert len(files(here / "kept")) == 2


def test_the_committed_table_is_shown_on_its_page_too(here, capfd):
    (here / PAGE).parent.mkdir(parents=True)
    (here / PAGE).write_text("# T\n\n<!-- table: held-out flight -->\n<!-- /table -->\n", encoding="utf-8")
    held_out("--names", "qp")
    assert "| duct-fast2 | qp |" not in (here / PAGE).read_text(encoding="utf-8")
    held_out("--names", "qp", "--out", HELD_OUT)
    assert "| duct-fast2 | qp |" in (here / PAGE).read_text(encoding="utf-8")
    assert f"written to {HELD_OUT} and {PAGE}" in capfd.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "valid"),
    [
        (["--names", "missing"], "unknown row 'missing'; valid: qp, "),
        (["--names", "qp", "--against", "tuned"], "expected a candidate"),
        (["--policy", SEED, "--against", "rl"], "unknown row or preset 'rl'; valid: qp, "),
        (["--policy", "nothing.npz"], "nothing.npz"),
        (["--scenarios", "0"], "at least 1"),
        (["--workers", "0"], "at least 1"),
        (["--rows", "nowhere"], "valid: one with rows"),
    ],
    ids=lambda value: " ".join(value)[:30] if isinstance(value, list) else "",
)
def test_bad_input_is_refused_in_one_line_and_nothing_is_written(arguments, valid, here, capfd):
    with pytest.raises(SystemExit) as stop:
        held_out(*arguments)
    assert stop.value.code == 2
    out, err = capfd.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert valid in err
    assert files(here) == {}


def test_its_help_names_every_option(capfd):
    with pytest.raises(SystemExit) as stop:
        main(["leaderboard", "held-out", "--help"])
    assert stop.value.code == 0
    out = capfd.readouterr().out
    options = ("--rows", "--names", "--policy", "--against", "--scenarios", "--out", "--cache", "--workers", "--trust")
    assert all(option in out for option in options)
    assert "never used for training or tuning" in " ".join(out.split())


def test_the_commands_page_names_it():
    assert "`held-out`" in (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
