"""`spidar docs`: builds the guide, offline and with warnings as errors, and writes its tables and pictures."""

import importlib.util
import subprocess
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import spidar_gym
from spidar_gym.cli.arguments import Flag
from spidar_gym.cli.console import progress
from spidar_gym.cli.tables import pages, with_tables
from spidar_gym.errors import MissingDependencyError, SpidarError, UnknownNameError
from spidar_gym.files import output_folder, refresh
from spidar_gym.viz.gallery import draw, gallery

NEEDED = ("sphinx", "myst_parser", "furo", "sphinx_copybutton")
"""Packages of the extra `docs`."""


def docs(
    out: Path = Path("out/docs"),
    tables: Flag = False,
    check: Flag = False,
    pictures: Flag = False,
    only: str = "",
) -> None:
    """Build the guide as HTML and print the path of its first page; needs a checkout and the extra docs.

    Args:
        out: Folder for the HTML; index.html is the first page.
        tables: Instead, write every marked table of docs/ and README.md anew from the committed results.
        check: Instead, write nothing; fail when a marked table is stale.
        pictures: Instead, draw docs/pictures/*.png anew; needs OpenGL and matplotlib, and takes four minutes.
        only: Of the pictures, those whose names begin so.
    """
    root = checkout()
    if pictures:
        names = [name for name in gallery() if name.startswith(only)]
        if not names:
            raise UnknownNameError("picture", only, gallery())
        folder = output_folder(root / "docs" / "pictures")
        for name in progress(names, unit="picture", desc="pictures"):
            draw(name, folder)
        print(f"{len(names)} pictures drawn in {folder}")
        return
    if tables or check:
        _tables(root, check)
        return
    missing = [name for name in NEEDED if importlib.util.find_spec(name) is None]
    if missing:
        raise MissingDependencyError(", ".join(missing), "pip install -e '.[docs]' in the clone")
    folder = output_folder(out)
    # A process of its own: Sphinx imports what it documents, and changes warnings and logging for good. All of it anew:
    # of a page that has not changed it would not repeat the warnings.
    options = ["-q", "-E", "-a", "-W", "--keep-going", "-j", "auto"]
    command = [sys.executable, "-m", "sphinx", *options, str(root / "docs"), str(folder)]
    if subprocess.run(command, check=False).returncode:
        raise SpidarError("the guide is not sound; valid: pages that Sphinx builds without the warnings above")
    broken = [f"{page.relative_to(folder.resolve())}: {target}" for page, target in broken_links(folder)]
    if broken:
        raise SpidarError(f"links that lead nowhere: {', '.join(broken)}; valid: pages, files and anchors of the guide")
    print(folder / "index.html")


def checkout() -> Path:
    """The clone of the repository that this package is in (`SpidarError` where it is installed alone)."""
    root = Path(spidar_gym.__file__).parent.parent
    if not (root / "docs" / "conf.py").is_file():
        raise SpidarError(f"there is no guide beside {root / 'spidar_gym'}; valid: a clone of the repository")
    return root


def _tables(root: Path, check: bool) -> None:
    files = {path: with_tables(root, path.read_text(encoding="utf-8")) for path in pages(root)}
    written = refresh(files, "spidar docs --tables", check=check)
    print("every table is what its result gives" if check else f"{written} of {len(files)} pages written")


class _Page(HTMLParser):
    """The targets of a page's links and pictures, and the names that links may lead to."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.targets: list[str] = []
        self.anchors: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if name in ("href", "src") and value:
                self.targets.append(value)
            elif name == "id" and value:
                self.anchors.add(value)


def broken_links(folder: Path) -> Iterator[tuple[Path, str]]:
    """Links within a folder of HTML that lead to no file, or to no anchor of one: the page and the link's target."""
    found = {path.resolve(): _Page(path.read_text(encoding="utf-8")) for path in sorted(folder.rglob("*.html"))}
    for path, page in found.items():
        for target in page.targets:
            parts = urlsplit(target)
            if parts.scheme or parts.netloc:
                continue
            to = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            anchor = unquote(parts.fragment)
            if not to.is_file() or (anchor and to in found and anchor not in found[to].anchors):
                yield path, target
