"""Pins the table of clients: every client has a test, code in the guide that the test runs, a committed outcome."""

import json
import re
import sys
from dataclasses import replace
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest
from support.clients import PAGE, shown

from spidar_gym.errors import UnknownNameError

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "tests" / "clients"
SPEC = spec_from_file_location("matrix", FOLDER / "__main__.py")
matrix = module_from_spec(SPEC)
sys.modules["matrix"] = matrix  # dataclasses look up their module by name
SPEC.loader.exec_module(matrix)
RESULT = json.loads((ROOT / "docs" / "results" / "clients.json").read_text(encoding="utf-8"))


def test_every_test_of_a_client_is_tried_and_every_client_has_one():
    tests = {path.stem.removeprefix("test_") for path in FOLDER.glob("test_*.py")}
    assert tests == {client.test for client in matrix.CLIENTS.values()}


def test_all_code_of_the_page_is_run_by_a_test_of_a_client():
    code = shown()
    assert len(code) == PAGE.read_text(encoding="utf-8").count("<!-- client: ") > 10
    run = " ".join(path.read_text(encoding="utf-8") for path in FOLDER.glob("test_*.py"))
    assert set(code) == set(re.findall(r'(?:run_shown\(|shown\(\)\[)"([\w ]+)"', run))


def test_the_committed_table_is_of_all_clients_and_each_of_them_works():
    heading, *lines = RESULT["lines"]
    assert heading == matrix.HEADING
    assert RESULT["command"] == matrix.COMMAND
    assert [(name, done) for name, _, _, done in lines] == [(n, c.done) for n, c in matrix.CLIENTS.items()]
    for name, tried, outcome, _ in lines:
        client = matrix.CLIENTS[name]
        assert outcome == client.works
        assert [each.split(" ")[0] for each in tried.split(", ")] == list(client.packages)
        if name.startswith("Gymnasium 1."):
            assert tried.startswith(f"gymnasium {name.split(' ')[1]}.")


def report(*cases):
    """A report of pytest."""
    return (
        f"<testsuites><testsuite>{''.join(f'<testcase>{case}</testcase>' for case in cases)}</testsuite></testsuites>"
    )


SKIPPED = '<skipped message="not installed"/>'
FAILED = '<failure message="AssertionError: assert 1 == 2&#10; more">text</failure>'


def test_an_outcome_follows_from_the_results_of_the_tests():
    client = matrix.Client("x", (), (), "")
    glued = replace(client, glue="a wrapper", but="this")
    assert (client.works, glued.works) == ("unchanged", "glue: a wrapper; but not this")
    assert matrix.verdict(report("", SKIPPED), client.works) == "unchanged"
    assert matrix.verdict(report(SKIPPED), glued.works) == "not tried: every test was skipped"
    assert matrix.verdict(report("", FAILED), glued.works) == "fails: AssertionError: assert 1 == 2"


def test_a_failed_installation_is_reported_and_is_a_failure(tmp_path, monkeypatch, capsys):
    nowhere = matrix.Client("gymnasium", ((str(tmp_path / "nothing.whl"),),), ("gymnasium",), "nothing")
    monkeypatch.setitem(matrix.CLIENTS, "Missing", nowhere)
    out = tmp_path / "result.json"
    assert matrix.main(["Missing", "--folder", str(tmp_path / "clients"), "--out", str(out)]) == 1
    assert "Missing: not installed: " in capsys.readouterr().out
    ((name, _, outcome, _),) = json.loads(out.read_text(encoding="utf-8"))["lines"][1:]
    assert name == "Missing"
    assert "nothing.whl" in outcome
    with pytest.raises(UnknownNameError, match=r"valid: Gymnasium 1\.2, "):
        matrix.main(["Gymnasium 0.26"])
