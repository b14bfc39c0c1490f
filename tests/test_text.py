"""Pins the tables: columns, alignment, the rule below the heading, Markdown."""

import pytest

from spidar_gym.text import format_table

CELLS = [["case", "λ [N]", "what"], ["a  b", "7.5", "none"], ["c", "12.25", ""]]


def test_columns_are_as_wide_as_their_widest_cell_with_a_rule_below_the_heading():
    assert format_table(CELLS).splitlines() == [
        "case  λ [N]  what",
        "────  ─────  ────",
        "a  b  7.5    none",
        "c     12.25",
    ]


def test_columns_of_numbers_are_right_aligned():
    assert format_table(CELLS, left=1).splitlines() == [
        "case  λ [N]  what",
        "────  ─────  ────",
        "a  b    7.5  none",
        "c     12.25",
    ]
    assert format_table(CELLS, left=3) == format_table(CELLS)


def test_a_table_in_markdown_escapes_what_would_end_a_cell():
    assert format_table([["a", "b"], ["1", "|2|"]], markdown=True) == "| a | b |\n|---|---|\n| 1 | \\|2\\| |"


def test_lines_of_different_lengths_are_refused():
    with pytest.raises(ValueError, match="zip"):
        format_table([["a", "b"], ["1"]])
