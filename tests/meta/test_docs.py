"""Pins the guide: every table of figures is generated from its committed result and names its command."""

import json
import re
from pathlib import Path

import pytest
from packaging.version import Version

from spidar_gym import __version__
from spidar_gym.benchmark.comparison import compare_rows
from spidar_gym.benchmark.row import read_rows
from spidar_gym.cli.cards import card_lines
from spidar_gym.cli.docs import broken_links
from spidar_gym.cli.tables import DRAWN, MARKED, RESULTS, markdown_table, pages, read_result, with_tables
from spidar_gym.control.presets import controller_config
from spidar_gym.errors import SpidarError, UnknownNameError
from spidar_gym.tune.flight import loops

ROOT = Path(__file__).resolve().parents[2]
PAGES = pages(ROOT)
FILES = sorted((ROOT / RESULTS).glob("*.json"))


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_every_table_of_a_page_is_what_its_result_gives(path):
    text = path.read_text(encoding="utf-8")
    assert with_tables(ROOT, text) == text, "spidar docs --tables writes it"


def test_no_table_of_figures_for_a_terminal_is_pasted():
    for path in PAGES:
        for block in re.findall(r"^```text\n(.*?)^```", path.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE):
            assert "───" not in block, path


def test_every_result_stands_on_exactly_one_page_of_the_guide():
    shown = [
        name
        for path in PAGES[1:]
        for name in MARKED.findall(path.read_text(encoding="utf-8"))
        if len(name.split()) == 1
    ]
    assert sorted(n for n in shown if (ROOT / RESULTS / f"{n}.json").is_file()) == sorted(p.stem for p in FILES)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_a_result_names_its_command_and_a_version_that_exists(path):
    result = read_result(path)
    assert re.match(r"(spidar|python -m (train|tests|spidar_gym)\.|python \.ci/|pytest) ?\w+", result["command"])
    assert Version(result["version"]) <= Version(__version__)


def put(folder: Path, **content) -> Path:
    path = folder / RESULTS / "mine.json"
    path.parent.mkdir(parents=True)
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


def test_a_table_is_written_between_its_markers_with_the_command_below_and_a_stale_one_changes(tmp_path):
    put(
        tmp_path, command="spidar x", version="0.1.0", date="2026-01-02", lines=[["a", "b"], ["1", "|2|"]], notes=["N."]
    )
    page = "before\n<!-- table: mine -->\nold\n<!-- /table -->\nafter\n"
    table = "| a | b |\n|---|---|\n| 1 | \\|2\\| |\n\nN.\n\n`spidar x`, spidar_gym 0.1.0, 2026-01-02."
    written = f"before\n<!-- table: mine -->\n{table}\n<!-- /table -->\nafter\n"
    assert with_tables(tmp_path, page) == written
    assert with_tables(tmp_path, written) == written


@pytest.mark.parametrize(
    "content",
    [{}, {"command": "x", "version": "0.1.0", "date": "yesterday", "lines": []},
     {"command": "x", "version": "0.1.0", "date": "2026-01-02"},
     {"command": "x", "version": "0.1.0", "date": "2026-01-02", "lines": [], "notes": "N."},
     {"command": "x", "version": "0.1.0", "date": "2026-01-02", "table": "nothing", "result": {}}],
)  # fmt: skip
def test_a_damaged_result_is_refused_in_one_line(content, tmp_path):
    with pytest.raises(SpidarError, match=r"mine\.json is no result") as refusal:
        read_result(put(tmp_path, **content))
    assert "\n" not in str(refusal.value)


def test_a_marker_without_a_result_and_one_without_an_end_are_refused(tmp_path):
    with pytest.raises(UnknownNameError, match=r"unknown table 'speed'.*did you mean speeds"):
        markdown_table(ROOT, "speed")
    with pytest.raises(SpidarError, match="a table has no end"):
        with_tables(tmp_path, "<!-- table: mine -->\n")


def test_the_cost_of_methods_is_that_of_their_rows_and_of_the_searches_that_made_their_numbers():
    table = markdown_table(ROOT, "methods qp_tuned qp_robust_overlapped hold")
    tuned, crawler, hold = ([cell.strip() for cell in line.split("|")[1:-1]] for line in table.splitlines()[2:])
    ticks = {
        name: [line["ticks"] for line in json.loads((ROOT / f"baselines/searches/{name}.json").read_text())["log"]]
        for name in ("flight", "crawl")
    }
    assert tuned[3] == f"{len(ticks['flight'])} generations, {sum(ticks['flight']) / 1e6:.1f} M ticks"
    assert crawler[3] == f"{len(ticks['crawl'])} generations, {sum(ticks['crawl']) / 1e6:.1f} M ticks"
    assert hold[3] == "–"
    timing = json.loads((ROOT / "baselines/scores/qp_tuned.json").read_text())["timing"].values()
    assert tuned[1:3] == [f"{max(own['step_ms_p50_p99'][k] for own in timing):.1f} ms" for k in (0, 1)]


def test_a_card_shows_the_row_and_the_margins_of_the_loops():
    for name, base in (("mpc", "qp_tuned"), ("walking", "qp_robust_overlapped"), ("qp_tuned", "qp")):
        heading, *lines = card_lines(ROOT, name, base)
        card, rows = dict(lines), {n: read_rows(ROOT / "baselines/scores", n)[n] for n in (name, base)}
        assert heading == [f"`{name}`", rows[name].doc]
        assert card["command"] == f"`{rows[name].content['command']}`"
        assert ("margins" in card) == (name != "walking")
        for comparison in compare_rows(rows[name], rows[base]):
            change = comparison.changes["error"]
            told = [f"`{comparison.track}`" in card[f"{words} than `{base}`"] for words in ("better", "worse")]
            assert told == [change.high < 0.0, change.low > 0.0]
    log = json.loads((ROOT / "baselines/searches/flight.json").read_text())["log"]
    assert card["parameters"].startswith(f"`spidar tune flight`: {len(log)} generations")
    least = min(margins.gain for margins in loops(controller_config("tuned")))
    assert card["margins"].startswith(f"gain margin {least:.2f}, ")


def test_every_table_generated_from_figures_has_a_result():
    assert set(DRAWN) == {result["table"] for result in map(read_result, FILES) if "table" in result}


def test_links_to_missing_pages_and_missing_anchors_are_found(tmp_path):
    (tmp_path / "b.html").write_text('<h1 id="here">', encoding="utf-8")
    (tmp_path / "a.html").write_text(
        '<p id="top"><a href="b.html#here"><a href="#top"><a href="https://x.org/y"><a href="b.html#gone">'
        '<img src="c.png"><a href="#bottom">',
        encoding="utf-8",
    )
    assert [target for _, target in broken_links(tmp_path)] == ["b.html#gone", "c.png", "#bottom"]
