"""Pins the guide's explanations: their code runs; the files, classes and layers they name exist."""

import doctest
import re
import tomllib
from pathlib import Path

import pytest

from spidar_gym.envs.registry import ENVIRONMENTS
from spidar_gym.logs.topics import COLUMNS

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "spidar_gym"
PAGES = {str(path.relative_to(ROOT / "docs")): path.read_text(encoding="utf-8") for path in ROOT.glob("docs/*/*.md")}
PAGES["references.md"] = (ROOT / "docs" / "references.md").read_text(encoding="utf-8")
EXPLAINED = ("environments", "concepts", "paper", "studies", "onboard", "development")
CODE = re.compile(r"^```python\n(.*?)^```$", re.DOTALL | re.MULTILINE)
RUN = {
    page: blocks
    for page, text in PAGES.items()
    if page.startswith(EXPLAINED) and (blocks := CODE.findall(text)) and "<!-- client: " not in text
}
"""Code blocks by page; `tests/clients` runs those of the learning frameworks, where these are installed."""
FOLDERS = "|".join(("spidar_gym", "tests", "assets", "baselines", "train", "docs"))


def test_pages_have_code():
    assert {
        "environments/index.md",
        "concepts/allocation.md",
        "development/adding_a_block.md",
    } <= set(RUN)


@pytest.mark.parametrize("page", RUN)
def test_the_code_of_a_page_runs(page):
    names = {"__name__": "page"}
    for block in RUN[page]:
        if block.startswith(">>>"):
            session = doctest.DocTestParser().get_doctest(block, names, page, page, 0)
            names = session.globs
            assert doctest.DocTestRunner().run(session, clear_globs=False).failed == 0
        else:
            exec(compile(block, page, "exec"), names)


@pytest.mark.parametrize("page", PAGES)
def test_no_line_of_a_paragraph_begins_as_a_comment_or_a_list_would(page):
    prose = re.sub(r"^```.*?^```$|\$\$.*?\$\$", "", PAGES[page], flags=re.DOTALL | re.MULTILINE)
    assert re.findall(r"^(?:%|\+ ).*", prose, re.MULTILINE) == []


@pytest.mark.parametrize("page", PAGES)
def test_the_files_that_a_page_names_exist(page):
    for name in re.findall(rf"`((?:{FOLDERS})/[\w./-]+)`", PAGES[page]):
        assert name in ENVIRONMENTS or name in COLUMNS or (ROOT / name).exists(), name


@pytest.mark.parametrize("page", ["development/architecture.md"])
def test_the_files_of_the_package_that_a_page_names_exist(page):
    for name in re.findall(r"`([\w-]+/[\w./-]*)`", PAGES[page]):
        assert (PACKAGE / name).exists() or (ROOT / name).exists(), name


@pytest.mark.parametrize("page", PAGES)
def test_the_classes_that_a_page_names_exist(page):
    own = " ".join(CODE.findall(PAGES[page]))
    code = " ".join(path.read_text(encoding="utf-8") for path in (*PACKAGE.rglob("*.py"), *ROOT.glob("train/**/*.py")))
    for name in re.findall(r"`([A-Z][a-z]+[A-Z]\w*)\b", PAGES[page]):
        assert re.search(rf"\b{name}\b", code + own), name


def test_the_layers_of_the_page_are_those_of_the_contracts():
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"][
        "contracts"
    ]
    (layers,) = [contract["layers"] for contract in contracts if contract["type"] == "layers"]
    (drawn,) = re.findall(r"## Layers\n.*?```text\n(.*?)```", PAGES["development/architecture.md"], re.DOTALL)
    assert [re.split(" {2,}", line)[0] for line in drawn.splitlines()] == [
        layer.replace("spidar_gym.", "") for layer in layers
    ]
