"""Pins the guide's notebook: it runs in Jupyter, its committed outputs are of such a run, it converts to a page."""

import base64
import json
import re
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

from spidar_gym.envs.docs import pages

ROOT = Path(__file__).resolve().parents[2]
PATH = ROOT / "docs" / "tutorials" / "train_in_a_minute.ipynb"
TEXT = PATH.read_text(encoding="utf-8")
CELLS = json.loads(TEXT)["cells"]
CODE = [cell for cell in CELLS if cell["cell_type"] == "code"]
LONG = "SECONDS = 60"


def outputs(kind):
    return [output for cell in CODE for output in cell["outputs"] if output["output_type"] == kind]


def test_the_committed_notebook_was_run_completely_in_order_and_without_an_error():
    assert [cell["execution_count"] for cell in CODE] == list(range(1, len(CODE) + 1))
    assert {output["output_type"] for cell in CODE for output in cell["outputs"]} == {"stream", "display_data"}
    assert {output["name"] for output in outputs("stream")} == {"stdout"}, "no warning"
    assert not re.search(r"/home/|/root/|/work/|/tmp/", TEXT)


def test_it_trained_for_a_minute_and_flew_better_than_the_controller_alone():
    assert "".join(CODE[0]["source"]) == LONG
    said = "".join(line for output in outputs("stream") for line in output["text"])
    rewards = [float(value) for value in re.findall(r"reward (\d\.\d+), RMS", said)]
    assert len(rewards) == 2
    assert rewards[1] > rewards[0] + 0.1


def test_it_shows_two_figures_that_are_small():
    pictures = [base64.b64decode("".join(output["data"]["image/png"])) for output in outputs("display_data")]
    assert len(pictures) == 2
    assert all(picture.startswith(b"\x89PNG") and len(picture) < 100_000 for picture in pictures)


def test_it_has_a_next_section_and_its_links_lead_to_pages():
    words = "\n".join("".join(cell["source"]) for cell in CELLS if cell["cell_type"] == "markdown")
    assert "\n## Next\n" in words
    links = re.findall(r"\]\(([^)#]+)\)", words)
    assert len(links) > 5
    generated = {ROOT / "docs" / name for name in pages()}  # written when the guide is built
    for link in links:
        assert (PATH.parent / link).is_file() or (PATH.parent / link).resolve() in generated, link


def test_a_notebook_becomes_a_page_with_its_code_prints_and_pictures():
    pytest.importorskip("myst_parser", reason="the extra `docs` is not installed")
    spec = spec_from_file_location("conf", ROOT / "docs" / "conf.py")
    conf = module_from_spec(spec)
    spec.loader.exec_module(conf)
    page = conf.page_of(json.loads(TEXT))
    for cell in CELLS:
        assert "".join(cell["source"]) in page
    assert page.count("```python\n") == len(CODE)
    assert page.count("```text\n") == len(outputs("stream"))
    assert page.count("](data:image/png;base64,") == 2


@pytest.mark.slow
def test_it_runs_in_jupyter(tmp_path):
    nbformat = pytest.importorskip("nbformat", reason="the extra `test` is not installed")
    nbclient = pytest.importorskip("nbclient", reason="the extra `test` is not installed")
    pytest.importorskip("ipykernel", reason="the extra `test` is not installed")
    pytest.importorskip("matplotlib", reason="the extra `viz` is not installed")
    assert TEXT.count(LONG) == 1
    notebook = nbformat.reads(TEXT.replace(LONG, "SECONDS = 0"), as_version=4)
    nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    said = "".join(o["text"] for c in notebook.cells for o in c.get("outputs", []) if o["output_type"] == "stream")
    assert "1 generations, 10240 ticks" in said
    assert list(tmp_path.iterdir()) == [], "it writes nothing"
