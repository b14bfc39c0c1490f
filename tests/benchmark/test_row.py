"""Pins the rows of the leaderboard: hashes, refusals, files, and the record of their origin."""

import os
import platform
import re
from copy import deepcopy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.rows import SPEC, TRACK, changed, made_row, policy, score, stored

import spidar_gym
from spidar_gym.benchmark.content import check_content
from spidar_gym.benchmark.row import (
    ROWS,
    RowError,
    among_committed,
    committed_row,
    eval_command,
    make_row,
    model_hash,
    read_row,
    read_rows,
    row_files,
    row_text,
    write_row,
)
from spidar_gym.benchmark.scenario import load_scenarios
from spidar_gym.benchmark.track import CAP, TRACKS
from spidar_gym.errors import InvalidValueError, SpidarError, UnknownNameError
from spidar_gym.policies.policy import policy_digest
from spidar_gym.policies.presets import PresetPolicy
from spidar_gym.policies.provenance import PACKAGES, processor, versions

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def row():
    """Two runs on a flight and two on a crawl, one of which failed."""
    scores = {"ground-paper": [[0.8, CAP], [0.9, 0.1 + 0.2]], TRACK: [[0.5, 1e-300, 1.75], [0.25, 0.7, 1.0 / 3.0]]}
    return made_row(scores, "sham", "residual", doc='½ of ‖x‖, "quoted" | piped.', training={"seed": 3, "steps": 10})


def test_a_row_is_read_as_it_was_written_byte_for_byte(row, tmp_path):
    path = write_row(row, tmp_path)
    assert path == tmp_path / "sham.json"
    again = read_row(path)
    assert again == row
    assert row_text(again).encode() == path.read_bytes() == row_text(row).encode()


def test_a_file_of_a_row_has_a_line_for_every_metric(row, tmp_path):
    """A changed number changes two lines: its own and the hash."""
    other = changed(row, lambda c: c["tracks"][TRACK]["runs"][1]["error"].__setitem__(2, 0.125))
    lines = row_text(row).splitlines()
    differ = [
        (a, b) for a, b in zip(lines, row_text(read_row(stored(other, tmp_path))).splitlines(), strict=True) if a != b
    ]
    assert len(differ) == 2
    assert '"error"' in differ[0][1]
    assert "0.125" in differ[0][1]
    assert '"sha256"' in differ[1][1]


def test_errors_are_those_of_runs_and_scenarios_and_tracks_stand_in_the_tables_order(row):
    assert row.tracks == [TRACK, "ground-paper"]
    np.testing.assert_array_equal(row.errors(TRACK), [[0.5, 1e-300, 1.75], [0.25, 0.7, 1.0 / 3.0]])
    assert row.errors("ground-paper").shape == (2, 2)
    assert row.scenarios(TRACK) == [0, 1, 2]
    assert (row.name, row.kind, row.policies) == ("sham", "residual", (SPEC, SPEC))


def test_what_has_no_meaning_is_nan_in_a_column_and_truths_are_numbers(row):
    assert np.isnan(row.column(TRACK, "final_error_m")).all()
    np.testing.assert_array_equal(row.column("ground-paper", "failed"), [[0.0, 1.0], [0.0, 0.0]])
    mixed = made_row({TRACK: [score(TRACK, [CAP, 0.6], endurance_min=[None, 8.5])]})
    np.testing.assert_array_equal(mixed.column(TRACK, "endurance_min"), [[np.nan, 8.5]])


def test_a_row_records_its_origin(row):
    content = row.content
    assert content["policies_sha256"] == [policy_digest(PresetPolicy())] * 2
    assert content["model_sha256"] == model_hash()
    assert content["given"] == ["observation", "run"]
    older = {key: value for key, value in content.items() if key != "given"}
    check_content(older)  # older rows lack this field
    with pytest.raises(UnknownNameError, match="given 'seed'"):
        check_content({**content, "given": ["seed"]})
    assert content["versions"] == versions()
    assert content["processor"] == processor()
    assert content["training"] == [{"seed": 3, "steps": 10}] * 2
    assert content["tracks"][TRACK]["scenarios_sha256"] == load_scenarios(TRACK)[1]
    assert made_row({TRACK: [[0.5]]}).content["training"] is None


def test_times_are_medians_over_runs_and_scenarios_in_milliseconds():
    runs = [score(TRACK, [0.5], steps=seconds) for seconds in (0.001, 0.001, 0.004)]
    times = made_row({TRACK: runs}).content["timing"][TRACK]
    assert times == {"step_ms_p50_p99": [1.0, 3.0], "policy_ms_p50_p99": [0.01, 0.02], "wall_s": 1.5}


def test_times_do_not_count_for_the_hash(row, tmp_path):
    content = deepcopy(dict(row.content))
    content["timing"][TRACK]["wall_s"] = 1e6
    assert read_row(stored(content, tmp_path)).errors(TRACK).tolist() == row.errors(TRACK).tolist()


def places(content, place=()):
    """Every place of a row that holds a number, a word or None, except for hash and times."""
    if isinstance(content, dict | list):
        for key, value in content.items() if isinstance(content, dict) else enumerate(content):
            if place or key not in ("sha256", "timing"):
                yield from places(value, (*place, key))
    else:
        yield place


def test_nothing_else_can_be_changed_by_hand(row, tmp_path):
    whole = list(places(dict(row.content)))
    assert {place[0] for place in whole} == set(row.content) - {"sha256", "timing"}
    # One number of each column is enough for the metrics.
    for place in [p for p in whole if len(p) < 6 or p[-1] == 0]:
        content = deepcopy(dict(row.content))
        *way, last = place
        within = content
        for key in way:
            within = within[key]
        within[last] = 0.5 if within[last] is None else f"{within[last]}x"
        with pytest.raises(RowError, match="edited by hand" if place != ("format",) else "no row of format"):
            read_row(stored(content, tmp_path))


@pytest.mark.parametrize("change", [lambda c: c.pop("sha256"), lambda c: c.update(sha256=""), lambda c: c.pop("doc"),
                                    lambda c: c.update(note="better"), lambda c: c["tracks"].pop(TRACK)])  # fmt: skip
def test_a_row_without_its_hash_or_with_less_or_more_in_it_was_edited_by_hand(row, tmp_path, change):
    content = deepcopy(dict(row.content))
    change(content)
    with pytest.raises(RowError, match=r"row\.json was edited by hand.*valid: "):
        read_row(stored(content, tmp_path))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: c.update(format=3), "no row of format 2"),
        (lambda c: c.pop("format"), "no row of format 2"),
        (lambda c: c.update(model_sha256="0" * 64), "another robot model"),
        (lambda c: c["tracks"][TRACK].update(scenarios_sha256="0" * 64), f"{TRACK} has other scenarios"),
        (lambda c: c["tracks"][TRACK].update(split="validation"), f"{TRACK} has other scenarios"),
        (lambda c: c["tracks"].update({"flight-fast9": c["tracks"].pop(TRACK)}), "flight-fast9 has other scenarios"),
        (lambda c: c["tracks"][TRACK]["runs"][1].pop("slip_m"), f"{TRACK} lacks slip_m"),
    ],
)
def test_a_row_of_something_else_is_refused_though_its_hash_is_right(row, tmp_path, change, message):
    with pytest.raises(RowError, match=f"row.json.* {message}.*; valid: ") as caught:
        read_row(stored(changed(row, change), tmp_path))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("key", ["name", "kind", "doc", "policies", "model_sha256", "tracks", "timing"])
def test_a_row_that_lacks_a_part_is_refused_though_its_hash_is_right(row, tmp_path, key):
    with pytest.raises(RowError, match=r"row\.json.*; valid: "):
        read_row(stored(changed(row, lambda c: c.pop(key)), tmp_path))


@pytest.mark.parametrize(
    "change",
    [
        lambda track: track.pop("split"),
        lambda track: track.update(split="train"),
        lambda track: track.pop("runs"),
        lambda track: track["runs"].clear(),
        lambda track: track["runs"][1]["error"].pop(),
        lambda track: track["scenarios"].append(3),
        lambda track: track.update(scenarios=[0, 1, 99]),
    ],
)
def test_a_track_whose_numbers_are_not_those_of_its_scenarios_is_refused(row, tmp_path, change):
    with pytest.raises(RowError, match=r"row\.json.*; valid: "):
        read_row(stored(changed(row, lambda c: change(c["tracks"][TRACK])), tmp_path))


@pytest.mark.parametrize(
    ("metric", "value"),
    [
        ("success", 7.0), ("success", 1), ("success", "true"), ("success", None), ("failed", 0), ("failed", True),
        ("error", 0.0), ("error", -0.1),
        ("error", CAP + 0.1), ("error", None), ("error", "0.5"), ("error", True), ("error", 1),
        ("energy_wh", -1.0), ("energy_wh", 1e300), ("energy_wh", None), ("energy_wh", [1.0]), ("violations", 1.5),
        ("unsolved", 1.0), ("unsolved", -1), ("unsolved", True), ("unsolved", 10**400), ("late_forms", None),
        ("failure", "two\nlines"), ("failure", "x" * 1000), ("failure", None), ("slip_m", 0.0), ("final_error_m", {}),
    ],
)  # fmt: skip
def test_a_metric_of_another_type_or_out_of_its_range_is_refused_though_its_hash_is_right(row, tmp_path, metric, value):
    """700 % success, energy below zero, a crawl's metric in a flight, a failure without cost."""
    path = stored(changed(row, lambda c: c["tracks"][TRACK]["runs"][1][metric].__setitem__(0, value)), tmp_path)
    with pytest.raises(RowError, match=rf"row\.json: {TRACK}, run 1, scenario 0: .*expected ") as caught:
        read_row(path)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 1000


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity", "1e999"])
@pytest.mark.parametrize("place", ['"energy_wh": [', '"wall_s": ', '"steps": '])
def test_a_number_that_is_not_finite_is_refused_everywhere(row, tmp_path, number, place):
    path = write_row(row, tmp_path)
    head, tail = path.read_text(encoding="utf-8").split(place, 1)
    path.write_text(f"{head}{place}{re.sub(r'^[0-9.e+-]+', number, tail)}", encoding="utf-8")
    with pytest.raises(RowError, match=r"sham\.json is no JSON of a row .*no finite number.*valid: "):
        read_row(path)


@pytest.mark.parametrize(
    "change",
    [
        lambda c: c.update(doc="A line\nand another."), lambda c: c.update(doc="<script>alert(1)</script>"),
        lambda c: c.update(doc="Red \x1b[31m."), lambda c: c.update(doc="x" * 1000), lambda c: c.update(doc=7),
        lambda c: c.update(doc="\u202eback"), lambda c: c.update(command="spidar\r\neval"),
        lambda c: c.update(name="../up"), lambda c: c.update(name="x" * 300), lambda c: c.update(name=None),
        lambda c: c.update(kind=["classical"]), lambda c: c.update(kind="magic"), lambda c: c.update(policies=[]),
        lambda c: c.update(policies="mine:Own"), lambda c: c.update(policies_sha256=["0" * 63, ""]),
        lambda c: c.update(policies_sha256=[]), lambda c: c.update(training=5), lambda c: c.update(training=[None]),
        lambda c: c["training"][0].update(steps="many"), lambda c: c["training"][1].update(steps=10**400),
        lambda c: c["training"][0].update(command="`a` <img src=x>"), lambda c: c.update(arguments={"plant": 1}),
        lambda c: c.update(arguments={"preset": {}}), lambda c: c.update(arguments={"action_scale": {"force": "3"}}),
        lambda c: c.update(arguments={"action_scale": {"<b>": 3.0}}), lambda c: c.update(versions={"numpy": 2}),
        lambda c: c.update(versions=[]), lambda c: c.update(processor="a\nb"), lambda c: c.update(processor=None),
        lambda c: c.update(tracks={}), lambda c: c.update(tracks=[]), lambda c: c["tracks"].update({TRACK: 5}),
        lambda c: c["tracks"][TRACK].update(split=["test"]),
        lambda c: c["tracks"][TRACK].update(scenarios=[0, 1, True]),
        lambda c: c["tracks"][TRACK].update(scenarios=[0, 1, {}]), lambda c: c["tracks"][TRACK].update(runs=[1, 2]),
        lambda c: c["tracks"][TRACK]["runs"][0].update(error=0.5), lambda c: c["tracks"][TRACK].update(note="better"),
        lambda c: c["tracks"][TRACK]["runs"][0].update(more=[1, 2, 3]), lambda c: c.update(note="better"),
        lambda c: c["timing"].pop(TRACK), lambda c: c["timing"][TRACK].update(wall_s=-1.0),
        lambda c: c.update(timing=3),
        lambda c: c["timing"][TRACK].update(step_ms_p50_p99=[1.0]),
    ],
)  # fmt: skip
def test_a_field_of_another_type_or_with_unsafe_text_is_refused_though_its_hash_is_right(row, tmp_path, change):
    with pytest.raises(RowError, match=r"row\.json: .*(valid: |expected )") as caught:
        read_row(stored(changed(row, change), tmp_path))
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 1000


def test_a_renamed_processor_is_detected(row, tmp_path):
    """A check is less strict on another processor, so the hash includes the processor's name."""
    content = deepcopy(dict(row.content))
    content["processor"] = "another"
    with pytest.raises(RowError, match="edited by hand"):
        read_row(stored(content, tmp_path))


def test_a_simulation_that_diverged_leaves_no_numbers_but_costs_the_cap(tmp_path):
    kept = score(TRACK, [CAP, 0.5], energy_wh=[None, 11.0], position_rms_m=[None, 0.1])
    assert read_row(write_row(made_row({TRACK: [kept]}), tmp_path)).errors(TRACK).tolist() == [[CAP, 0.5]]
    for column in ({"error": [0.5, 0.5]}, {"success": [True, True]}, {"energy_wh": [11.0, None]}):
        with pytest.raises(RowError, match="expected"):
            made_row({TRACK: [replace(kept, metrics=kept.metrics | column)]})


def test_deep_or_large_files_are_refused_before_anything_is_built(tmp_path, monkeypatch):
    path = tmp_path / "row.json"
    path.write_text("[" * 100_000)
    with pytest.raises(RowError, match=r"is no JSON of a row .*; valid: "):
        read_row(path)
    path.write_text('{"format": 2, "doc": "\\ud800", "sha256": ""}')
    with pytest.raises(RowError, match=r"is no JSON of a row .*; valid: "):
        read_row(path)
    monkeypatch.setattr("spidar_gym.benchmark.row.LARGEST", 10)
    with pytest.raises(RowError, match=r"larger than 10 bytes; valid: "):
        read_row(path)


@pytest.mark.parametrize("data", [b"", b"{", b"[1, 2]", b"\x80\xff", b"null", b'{"format": 1}', b"PK\x03\x04"])
def test_a_file_that_is_no_row_is_refused_in_one_line(tmp_path, data):
    path = tmp_path / "row.json"
    path.write_bytes(data)
    with pytest.raises(RowError, match=r"row\.json .*; valid: ") as caught:
        read_row(path)
    assert "\n" not in str(caught.value)


def test_half_a_row_is_refused(row, tmp_path):
    whole = row_text(row).encode()
    for length in range(0, len(whole) - 2, 97):
        (tmp_path / "row.json").write_bytes(whole[:length])
        with pytest.raises(RowError, match="is no JSON"):
            read_row(tmp_path / "row.json")


def test_a_file_that_is_not_there_is_refused_in_one_line(tmp_path):
    for path in (tmp_path / "none.json", tmp_path):
        with pytest.raises(RowError, match=r": .*; valid: a row that `spidar eval` wrote$"):
            read_row(path)


def refuse(*_):
    raise OSError(28, "no space left")


def half(path, data):
    with path.open("wb") as file:
        file.write(data[: len(data) // 2])
    refuse()


@pytest.mark.parametrize(("owner", "name", "instead"), [(os, "replace", refuse), (Path, "write_bytes", half)])
def test_a_row_that_cannot_be_written_leaves_the_old_one_as_it_was(row, tmp_path, monkeypatch, owner, name, instead):
    path = write_row(made_row({TRACK: [[0.5]]}, "sham"), tmp_path)
    before = path.read_bytes()
    with monkeypatch.context() as patch:
        patch.setattr(owner, name, instead)
        with pytest.raises(SpidarError, match=r"cannot write .*sham\.json: no space left; valid: "):
            write_row(row, tmp_path)
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["sham.json"]
    write_row(row, tmp_path)
    assert read_row(path) == row


def test_rows_of_a_folder_come_by_name_the_reference_first(tmp_path):
    names = ("zero", "a", "qp", "qp_tuned", "B")
    for name in names:
        write_row(made_row({TRACK: [[0.5]]}, name), tmp_path / "rows")
    (tmp_path / "rows" / "notes.txt").write_text("no row")
    rows = read_rows(tmp_path / "rows")
    assert list(rows) == ["qp", "B", "a", "qp_tuned", "zero"]
    assert all(rows[name].name == name for name in names)


def test_one_invalid_row_makes_a_folder_invalid(row, tmp_path):
    write_row(row, tmp_path)
    (tmp_path / "bad.json").write_text("{}")
    with pytest.raises(RowError, match=r"bad\.json"):
        read_rows(tmp_path)


def test_a_folder_without_rows_is_refused(tmp_path):
    with pytest.raises(RowError, match=r"none is no folder; valid: "):
        read_rows(tmp_path / "none")
    with pytest.raises(RowError, match=r"has no rows; valid: "):
        read_rows(tmp_path)


def test_committed_rows_are_read_by_their_path_from_any_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert read_rows(Path(ROWS), "walking") == read_rows(ROOT / ROWS, "walking")
    assert committed_row("mpc") == read_rows(ROOT / ROWS, "mpc")["mpc"]
    assert read_row(Path(ROWS, "path", "mpc.json")) == read_row(ROOT / ROWS / "path" / "mpc.json")
    with pytest.raises(RowError, match=r"baselines/scores/missing\.json: No such file"):
        read_row(Path(ROWS, "missing.json"))


def test_the_committed_row_of_a_checkout_is_that_of_the_working_folder(tmp_path, monkeypatch):
    own = made_row({TRACK: [[0.123]]}, "qp")
    write_row(own, tmp_path / ROWS)
    monkeypatch.chdir(tmp_path)
    assert committed_row() == own


def test_versions_are_those_that_run():
    found = versions()
    assert list(found) == ["python", "spidar-gym", *PACKAGES]
    assert found["python"] == platform.python_version()
    assert found["numpy"] == np.__version__
    assert found["spidar-gym"] == spidar_gym.__version__
    assert all(found.values())


def test_a_package_that_is_not_installed_has_no_version(monkeypatch):
    monkeypatch.setattr("spidar_gym.policies.provenance.PACKAGES", ("numpy", "no-such-package-as-this"))
    assert versions()["no-such-package-as-this"] == ""


def test_the_processor_is_one_line_that_begins_with_the_architecture():
    assert processor().split()[0] == platform.machine()
    assert processor() == processor() == " ".join(processor().split())


@pytest.mark.parametrize(
    ("info", "expected"),
    [
        ("vendor_id\t: Some\ncpu family\t: 6\nmodel\t\t: 85\nflags\t\t: fpu avx2 avx512f\n", "Some 6 85 avx2 avx512f"),
        ("vendor_id : Some\ncpu family : 6\nmodel : 85\nmodel name : Quick\nflags : avx\n\nmodel : 9\n", "Some 6 85"),
    ],
)
def test_the_processor_is_its_family_and_the_widths_it_has(monkeypatch, info, expected):
    monkeypatch.setattr(Path, "read_text", lambda *_, **__: info)
    monkeypatch.delenv("OPENBLAS_CORETYPE", raising=False)
    assert processor() == f"{platform.machine()} {expected}"
    monkeypatch.setenv("OPENBLAS_CORETYPE", "Haswell")
    assert processor() == f"{platform.machine()} {expected} Haswell", "NumPy then computes as on that processor"


def test_the_processor_has_a_name_where_the_system_provides_none(monkeypatch):
    monkeypatch.setattr(Path, "read_text", refuse_text)
    assert processor().startswith(platform.machine())


def refuse_text(*_, **__):
    raise FileNotFoundError(2, "no such file")


def test_the_command_of_a_row_contains_only_options_that_differ_from_the_default():
    assert eval_command(["a:B"], []) == "spidar eval --policy a:B"
    chosen = eval_command(["a:B", "c.npz"], ["flight-fast5"], "validation", 3)
    assert chosen == "spidar eval --policy a:B c.npz --tracks flight-fast5 --split validation --scenarios 3"


def test_every_track_can_stand_in_a_row(tmp_path):
    made = made_row({track: [[0.5, 0.6]] for track in TRACKS})
    assert read_row(write_row(made, tmp_path)).tracks == list(TRACKS)


def test_runs_of_different_policies_or_scenarios_are_no_row():
    one, two = score(TRACK, [0.5, 0.6]), score(TRACK, [0.5, 0.6], indices=(0, 2))
    with pytest.raises(InvalidValueError, match="on the same scenarios"):
        make_row([policy()] * 2, [SPEC] * 2, {TRACK: [one, two]}, command="")
    with pytest.raises(InvalidValueError, match="a score for each run"):
        make_row([policy()] * 2, [SPEC] * 2, {TRACK: [one]}, command="")
    with pytest.raises(InvalidValueError, match="runs of one policy"):
        make_row([policy("a"), policy("b")], [SPEC] * 2, {TRACK: [one, one]}, command="")


def test_a_second_file_of_the_same_row_is_refused(row, tmp_path):
    write_row(row, tmp_path)
    (tmp_path / "copy.json").write_bytes((tmp_path / f"{row.name}.json").read_bytes())
    with pytest.raises(RowError, match="a second row"):
        read_rows(tmp_path)


def test_a_row_has_its_later_tracks_from_the_folder_of_their_group(row, tmp_path):
    base, later = made_row({TRACK: [[0.5, 0.7]]}, "sham"), made_row({"flight-path": [[0.25, 0.75, 0.5]]}, "sham")
    alone = made_row({"flight-path": [[0.1]]}, "alone")
    path = write_row(base, tmp_path)
    before = path.read_bytes()
    for one in (later, alone):
        write_row(one, tmp_path / "path")
    assert row_files(tmp_path) == [path, tmp_path / "path" / "alone.json", tmp_path / "path" / "sham.json"]
    rows = read_rows(tmp_path)
    assert list(rows) == ["alone", "sham"]
    both = rows["sham"]
    assert both.tracks == [TRACK, "flight-path"]
    assert both.content == base.content
    assert (both.part(TRACK).content, both.part("flight-path")) == (base.content, later)
    assert both.errors("flight-path").tolist() == [[0.25, 0.75, 0.5]]
    assert (both.scenarios("flight-path"), both.split("flight-path")) == ([0, 1, 2], "test")
    assert read_rows(tmp_path, "alone") == {"alone": alone}
    with pytest.raises(KeyError):
        both.part("ground-paper")
    assert path.read_bytes() == before


def test_files_of_one_name_that_do_not_go_together_are_refused(row, tmp_path):
    write_row(row, tmp_path)
    path = write_row(made_row({TRACK: [[0.5], [0.5]]}, "sham", "residual"), tmp_path / "path")
    with pytest.raises(RowError, match=rf"{path} has {TRACK} a second time"):
        read_rows(tmp_path)
    for runs, kind in (([[0.5]], "residual"), ([[0.5], [0.5]], "classical")):
        write_row(made_row({"flight-path": runs}, "sham", kind), tmp_path / "path")
        with pytest.raises(RowError, match=f"{path} is of other policies than row sham"):
            read_rows(tmp_path)
    write_row(made_row({"flight-path": [[0.5], [0.5]]}, "sham", "residual"), tmp_path / "path")
    assert read_rows(tmp_path)["sham"].tracks == [TRACK, "ground-paper", "flight-path"]


def test_the_committed_row_has_its_later_tracks_and_a_row_with_other_files_is_another(tmp_path, monkeypatch):
    write_row(made_row({TRACK: [[0.123]]}, "qp"), tmp_path / ROWS)
    write_row(made_row({"flight-path": [[0.5]]}, "qp"), tmp_path / ROWS / "path")
    monkeypatch.chdir(tmp_path)
    committed = committed_row()
    assert committed.tracks == [TRACK, "flight-path"]
    assert among_committed({"qp": committed}) == ({"qp": committed}, [])
    assert among_committed({"qp": committed.part("flight-path")})[1] == []
    other = made_row({"flight-path": [[0.25]]}, "qp")
    assert among_committed({"qp": other})[1] == ["qp (own)"]


def test_a_learned_row_records_the_arguments_of_its_environment_and_a_classical_row_does_not():
    asked = {"preset": "tuned", "action_mode": "residual_wrench", "controller": object()}
    learned = made_row({TRACK: [[0.1]]}, "learned", "residual", arguments=asked)
    assert learned.content["arguments"] == {"preset": "tuned", "action_mode": "residual_wrench"}
    assert "arguments" not in made_row({TRACK: [[0.1]]}, arguments=asked).content
