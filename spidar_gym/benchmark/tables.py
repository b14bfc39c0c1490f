"""Tables as text: for terminals, and for Markdown."""


def aligned(lines: list[list[str]]) -> str:
    """Columns of equal width; the first line is the heading."""
    widths = [max(len(line[k]) for line in lines) for k in range(len(lines[0]))]
    rows = ["  ".join(cell.ljust(w) for cell, w in zip(line, widths, strict=True)).rstrip() for line in lines]
    return "\n".join([rows[0], "  ".join("─" * width for width in widths), *rows[1:]])


def piped(lines: list[list[str]]) -> list[str]:
    """Lines of a Markdown table; the first line is the heading."""
    rows = ["| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines]
    return [rows[0], "|" + "---|" * len(lines[0]), *rows[1:]]
