"""`spidar docs`: build the guide, offline and with warnings as errors, and write its tables and pictures."""

import importlib.util
import subprocess
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import spidar_gym
from spidar_gym.arguments import Flag
from spidar_gym.cli.tables import pages, with_tables
from spidar_gym.console import progress
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
    """Build the guide as HTML and print the path of its first page; requires a clone and the extra docs.

    Args:
        out: Folder for the HTML; index.html is the first page.
        tables: Instead of HTML, update every marked table in docs/ and README.md from the committed results.
        check: Instead of HTML, fail if a marked table is stale; writes nothing.
        pictures: Instead of HTML, draw docs/pictures/*.png; requires OpenGL and matplotlib, and takes four minutes.
        only: Draw only pictures whose names begin with this text.
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
    # A separate process, since Sphinx imports the documented modules and changes warnings and logging permanently.
    # -E -a rebuilds every page, since Sphinx does not repeat the warnings of unchanged pages.
    options = ["-q", "-E", "-a", "-W", "--keep-going", "-j", "auto"]
    command = [sys.executable, "-m", "sphinx", *options, str(root / "docs"), str(folder)]
    if subprocess.run(command, check=False).returncode:
        raise SpidarError("the guide has errors; valid: pages that Sphinx builds without the warnings above")
    broken = [f"{page.relative_to(folder.resolve())}: {target}" for page, target in broken_links(folder)]
    if broken:
        raise SpidarError(f"broken links: {', '.join(broken)}; valid: pages, files and anchors of the guide")
    print(folder / "index.html")


def checkout() -> Path:
    """Return the root of the clone that contains this package (`SpidarError` for an installed wheel)."""
    root = Path(spidar_gym.__file__).parent.parent
    if not (root / "docs" / "conf.py").is_file():
        raise SpidarError(f"there is no guide beside {root / 'spidar_gym'}; valid: a clone of the repository")
    return root


def _tables(root: Path, check: bool) -> None:
    files = {path: with_tables(root, path.read_text(encoding="utf-8")) for path in pages(root)}
    written = refresh(files, "spidar docs --tables", check=check)
    print("every table is up to date" if check else f"{written} of {len(files)} pages written")


class _Page(HTMLParser):
    """The targets of a page's links and pictures, and the page's anchors."""

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
    """Yield page and target of every relative link in a folder of HTML whose file or anchor does not exist."""
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
