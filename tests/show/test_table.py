"""A table's lines as they stand on a terminal, wide and narrow."""

from __future__ import annotations

import pytest

from graspfx.show.summary_table import ASCII, BOLD, PLAIN, Column, lines

FORCES = (
    Column("what", ["force", "ticks"]),
    Column("a/\nb", ["0.120  0.102", "400"], right=True, folds=True),
    Column("unit", ["N", ""]),
)


def test_each_column_on_its_side_and_titles_at_the_foot() -> None:
    assert list(lines(FORCES, 80)) == [
        "      ┃           a/ ┃     ",
        "what  ┃            b ┃ unit",
        "━━━━━━╇━━━━━━━━━━━━━━╇━━━━━",
        "force │ 0.120  0.102 │ N   ",
        "ticks │          400 │     ",
    ]


@pytest.mark.parametrize("width", [1, 19, 20])
def test_cells_are_folded_between_words_but_never_cut(width: int) -> None:
    assert list(lines(FORCES, width, rules=ASCII)) == [
        "      |    a/ |     ",
        "what  |     b | unit",
        "------+-------+-----",
        "force | 0.120 | N   ",
        "      | 0.102 |     ",
        "ticks |   400 |     ",
    ]


def test_a_long_title_stays_whole_where_cells_are_short() -> None:
    head = list(lines([Column("", ["x"]), Column("reference-1dof", ["0.25"], right=True, folds=True)], 12))[:-2]
    assert head == ["  ┃ reference-1dof"]


def test_wide_letters_take_two_columns() -> None:
    assert list(lines([Column("", ["x"]), Column("実験é", ["1"], right=True, folds=True)], 80))[2] == "x │     1"


def test_a_head_in_bold() -> None:
    assert next(lines(FORCES, 80, bold=True)) == f"{BOLD}      ┃           a/ ┃     {PLAIN}"


def test_a_title_is_never_broken_within_a_word() -> None:
    columns = [
        Column("what", ["a"]),
        *(Column(f"coupling.internal.stiffness = {k}", ["1"], folds=True) for k in range(4)),
    ]
    head = [line.split("-")[0] for line in lines(columns, 40, rules=ASCII) if "-" not in line][:-1]
    assert sum(line.count("coupling.internal.stiffness") for line in head) == 4
