"""Sphinx settings of the guide, which `spidar docs` builds offline and with warnings as errors."""

import json
import re
from pathlib import Path
from typing import Any

from docutils.nodes import SkipNode
from docutils.utils.math import MathError, latex2mathml
from myst_parser.parsers.sphinx_ import MystParser
from sphinx.util import logging

import spidar_gym
from spidar_gym.envs.docs import pages
from spidar_gym.files import refresh

project = "spidar_gym"
author = "The spidar_gym developers"
copyright = author
release = version = spidar_gym.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
]
source_suffix = {".md": "markdown", ".ipynb": "notebook"}
exclude_patterns = ["results", "**/.ipynb_checkpoints"]
default_role = "code"
smartquotes = False
myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 4

autodoc_default_options = {"members": True, "member-order": "bysource"}
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
python_maximum_signature_line_length = 88
python_use_unqualified_type_names = True

add_module_names = False

html_theme = "furo"
html_title = f"spidar_gym {release}"
html_static_path = ["static"]
html_css_files = ["guide.css"]
html_math_renderer = "mathml"
html_copy_source = False
html_show_sphinx = False


fields: dict[str, list[str]] = {}
"""Docstrings of fields, kept from napoleon, which interprets the text before a colon as a type."""


def plain(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:  # noqa: ANN401 - Sphinx's
    """Escape reStructuredText markup in docstrings, which are plain text with code in backticks."""
    for k, line in enumerate(lines):
        parts = re.split(r"(`[^`]*`)", line)
        parts[::2] = [re.sub(r"([|*]|(?<=\w)_(?!\w))", r"\\\1", part) for part in parts[::2]]
        lines[k] = "".join(parts)
    if what in ("attribute", "data", "property"):
        fields[name] = lines.copy()


def restore(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:  # noqa: ANN401 - Sphinx's
    """Restore a field's docstring after napoleon."""
    lines[:] = fields.pop(name, lines)


SPELLED = (
    ("…", r"\\ldots "),
    ("°", r"^\\circ "),
    (r"\\(d?dot|bar|hat|tilde|underline) ?(\\[a-zA-Z]+|[a-zA-Z])", r"{\\\1{\2}{}}"),
    (r"\\(?:\||lVert)(.+?)\\(?:\||rVert)", r"\\left\\|\1\\right\\|"),
    (r"\bCoG\b", r"\\mathrm{CoG}"),
    (r"\\([td]?frac)(\d)(\d)", r"\\\1{\2}{\3}"),
)
"""Replacements for TeX that the converter does not support or renders badly, such as an index of an accented letter."""


def mathml(translator: Any, node: Any) -> None:  # noqa: ANN401 - Sphinx's
    """Convert a formula to MathML, which browsers render without a script from the network."""
    text, block = node.astext(), node.tagname == "math_block"
    for short, spelled in SPELLED:
        text = re.sub(short, spelled, text)
    try:
        found = latex2mathml.tex2mathml(text, as_block=block)
    except MathError as error:
        logging.getLogger(__name__).warning("%s: %s", text, error, location=node)
    else:
        translator.body.append(f'<div class="math">{found}</div>' if block else found)
    raise SkipNode


def page_of(notebook: dict[str, Any]) -> str:
    """Convert a notebook to a page: its text, code, and saved outputs."""
    blocks = []
    for cell in notebook["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            blocks.append(source)
            continue
        blocks.append(f"```python\n{source}\n```")
        for output in cell["outputs"]:
            if output["output_type"] == "stream":
                blocks.append(f"```text\n{''.join(output['text'])}```")
            else:
                picture = "".join(output["data"]["image/png"]).replace("\n", "")
                blocks.append(f"![Output of the code above](data:image/png;base64,{picture})")
    return "\n\n".join(blocks)


class NotebookParser(MystParser):
    """Parses notebooks, whose outputs are saved beforehand by `jupyter execute`."""

    supported = ("notebook",)

    def parse(self, inputstring: str, document: Any) -> None:  # noqa: ANN401 - docutils'
        """Parse a notebook, and add a download link above its text."""
        heading, rest = page_of(json.loads(inputstring)).split("\n", 1)
        sphinx = document.settings.env
        name = Path(sphinx.doc2path(sphinx.docname)).name
        super().parse(f"{heading}\n\nThis page is {{download}}`a notebook <{name}>`.\n{rest}", document)


def write_environments(app: Any) -> None:  # noqa: ANN401 - Sphinx's application
    """Write the pages of the environments, which are generated from the code and ignored by git."""
    refresh({Path(app.srcdir) / name: text for name, text in pages().items()}, "spidar docs", check=False)


def setup(app: Any) -> None:  # noqa: ANN401 - Sphinx's application
    """Register the extensions; docstrings are processed before and after napoleon."""
    app.add_html_math_renderer("mathml", (mathml, None), (mathml, None))
    app.add_source_parser(NotebookParser)
    app.connect("builder-inited", write_environments)
    app.connect("autodoc-process-docstring", plain, priority=100)
    app.connect("autodoc-process-docstring", restore, priority=900)
