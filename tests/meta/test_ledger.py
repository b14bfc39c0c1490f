"""Pins the equation ledger of the guide: every equation has a function that cites it and an existing test."""

import ast
import importlib
import re
from pathlib import Path

import pytest

import spidar_gym

ROOT = Path(__file__).resolve().parents[2]
EQUATIONS = range(1, 38)
ROW = re.compile(r"^\| (\d+|Gait) \| ([^|]+) \| `([\w.]+)` \| `(\w+/\w+\.c)` \| `([\w/]+\.py)::(\w+)` \|$", re.M)
TAG = re.compile(r"\[Zhao2025, Eq\. ([\d,\s-]+)\]")
ROWS = ROW.findall((ROOT / "docs" / "paper" / "equations.md").read_text(encoding="utf-8"))


def equations(numbers: str) -> set[int]:
    """`9-13, 30-32` → {9, …, 13, 30, 31, 32}."""
    result = set()
    for part in numbers.replace("\n", " ").split(","):
        first, _, last = part.strip().partition("-")
        result |= set(range(int(first), int(last or first) + 1))
    return result


def cited(docstring: str) -> set[int]:
    return set().union(*(equations(numbers) for numbers in TAG.findall(docstring)), set())


def resolve(name: str):
    parts = name.split(".")
    for split in range(len(parts), 0, -1):
        try:
            thing = importlib.import_module("spidar_gym." + ".".join(parts[:split]))
        except ImportError:
            continue
        for attribute in parts[split:]:
            thing = getattr(thing, attribute)
        return thing
    raise AssertionError(f"no such thing: {name}")


def test_every_equation_of_the_paper_has_a_row():
    assert {int(number) for number, *_ in ROWS if number != "Gait"} == set(EQUATIONS)
    assert sum(number == "Gait" for number, *_ in ROWS) >= 3


@pytest.mark.parametrize(("number", "name"), [(row[0], row[2]) for row in ROWS])
def test_the_function_of_a_row_cites_its_equation(number, name):
    docstring = resolve(name).__doc__ or ""
    if number == "Gait":
        assert "[Zhao2025, Sec. Crawling Gait]" in docstring
    else:
        assert int(number) in cited(docstring)


@pytest.mark.parametrize(("number", "file"), [(row[0], row[3]) for row in ROWS])
def test_the_c_file_of_a_row_cites_its_equation(number, file):
    text = (ROOT / "spidar_gym" / "native" / file).read_text(encoding="utf-8")
    if number == "Gait":
        assert "[Zhao2025, Sec. Crawling Gait]" in text
    else:
        assert int(number) in cited(text)


@pytest.mark.parametrize(("file", "name"), [row[4:] for row in ROWS])
def test_the_test_of_a_row_exists(file, name):
    tree = ast.parse((ROOT / "tests" / file).read_text(encoding="utf-8"))
    assert name in {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}


def test_every_equation_that_the_code_cites_has_a_row():
    known = {int(number) for number, *_ in ROWS if number != "Gait"}
    for path in Path(spidar_gym.__file__).parent.rglob("*.py"):
        assert cited(path.read_text(encoding="utf-8")) <= known, path


def test_every_citation_is_in_the_one_form():
    for path in Path(spidar_gym.__file__).parent.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        for citation in re.findall(r"\[Zhao2025[^\]]*\]", text):
            assert TAG.fullmatch(citation) or re.fullmatch(r"\[Zhao2025, (Sec\. [\w\s]+|Tab\. 1)\]", citation), (
                path,
                citation,
            )
