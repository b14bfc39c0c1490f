"""Pins the tutorials: all code blocks run in order in an empty folder, as a reader would run them.

`<!-- tested with: A -> B -->` above a block replaces A by B, where the reader's command takes minutes.
`<!-- file: NAME -->` above a block of Python names the file to which the reader saves the block.
"""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
TUTORIALS = ROOT / "docs" / "tutorials"
BLOCK = re.compile(r"((?:^<!-- [^\n]* -->\n)*)^```(python|bash)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
MARKS = {
    "goals_and_critics": [pytest.mark.slow, pytest.mark.train],
    "train_a_residual": [pytest.mark.slow, pytest.mark.train],
    "take_it_to_the_robot": [pytest.mark.slow],
}
"""Pages that are slow or need an extra."""


def script(page: Path) -> list[tuple[str, str]]:
    """The page's code in order: the kind of each block (`python`, `bash` or the name of a file), and the block."""
    found = []
    for comments, kind, code in BLOCK.findall(page.read_text(encoding="utf-8")):
        for name, value in re.findall(r"<!-- ([a-z ]+): (.*) -->", comments):
            if name == "file":
                kind = value
            elif name == "tested with":
                old, _, new = value.partition(" -> ")
                assert code.count(old) == 1, f"{old!r} is not in the block that it changes"
                code = code.replace(old, new)
        if kind == "python" and found and found[-1][0] == "python":
            code = found.pop()[1] + code  # consecutive blocks are one program
        found.append((kind, code))
    return found


@pytest.mark.parametrize(
    "name", [pytest.param(p.stem, marks=MARKS.get(p.stem, [])) for p in sorted(TUTORIALS.glob("*.md"))]
)
def test_the_code_of_a_tutorial_runs(name, tmp_path):
    python = Path(sys.executable)
    environment = os.environ | {
        "PATH": f"{python.parent}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": f"{ROOT}{os.pathsep}{os.environ.get('PYTHONPATH', '')}",
        "MUJOCO_GL": os.environ.get("MUJOCO_GL", "egl"),
    }
    for kind, code in script(TUTORIALS / f"{name}.md"):
        if kind not in ("bash", "python"):
            (tmp_path / kind).write_text(code, encoding="utf-8")
            continue
        command = ["bash", "-euo", "pipefail", "-c"] if kind == "bash" else [str(python), "-W", "error", "-c"]
        done = subprocess.run(
            [*command, code], cwd=tmp_path, env=environment, check=False, capture_output=True, text=True,
            stdin=subprocess.DEVNULL,
        )  # fmt: skip
        assert done.returncode == 0, f"{code}\n{done.stdout}\n{done.stderr}"


def test_every_tutorial_has_a_next_section_and_a_picture():
    for page in TUTORIALS.glob("*.md"):
        text = page.read_text(encoding="utf-8")
        assert "\n## Next\n" in text, page
        assert re.search(r"^!\[.+\]\(\.\./pictures/\S+\.png\)$", text, re.MULTILINE), page
