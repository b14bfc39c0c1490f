"""Formatting of tables and text for terminals and for Markdown."""

import re
from collections.abc import Iterable, Sequence


def format_table(lines: Sequence[Sequence[str]], *, left: int | None = None, markdown: bool = False) -> str:
    """Format a table for a terminal or for Markdown.

    Args:
        lines: Cells, line by line; the first line is the heading.
        left: Number of left-aligned columns; the others, of numbers, are right-aligned. All are left-aligned if None.
        markdown: Whether to write Markdown, without padding.
    """
    if markdown:
        rows = ["| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines]
        return "\n".join([rows[0], "|" + "---|" * len(lines[0]), *rows[1:]])
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    places = "".join("<" if left is None or k < left else ">" for k in range(len(widths)))
    rows = ["  ".join(map("{:{}{}}".format, line, places, widths)).rstrip() for line in lines]
    return "\n".join([rows[0], "  ".join("─" * width for width in widths), *rows[1:]])


def markdown_rows(heading: str, rows: Iterable[Sequence[str]]) -> str:
    """Format a table in Markdown; the cells of `heading` are separated by a vertical bar between blanks."""
    return format_table([heading.split(" | "), *rows], markdown=True)


def escaped(text: str) -> str:
    """Escape text for Markdown: one line, no HTML, no links or pictures; code in backticks stays code."""
    parts = re.split(r"(`[^`]*`)", " ".join(text.split()))
    for k in range(0, len(parts), 2):
        parts[k] = re.sub(r"[\\`\[\]<>&]", lambda found: f"&#{ord(found[0])};", parts[k])
    return "".join(parts)


def code(text: str) -> str:
    """Format text as code in Markdown; it may contain backticks."""
    words = " ".join(text.split())
    fence = "`" * (1 + max(map(len, re.findall("`+", words)), default=0))
    space = " " if "`" in words else ""
    return f"{fence}{space}{words}{space}{fence}"
