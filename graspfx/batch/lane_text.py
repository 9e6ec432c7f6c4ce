"""The program of a tick for lanes side by side: it goes on whatever happens, and measures what it would record."""

from __future__ import annotations

import ast
from collections.abc import Collection, Sequence

from graspfx.batch.lanes import FIRST, HIGH, LAST, LATE_LOW, LOW, MEASURES, NEEDS, SQUARES, SUM

ROWS, SUMS = "rows", "measures"


def lane_text(source: str, columns: Sequence[int] | None, statistics: Collection[str]) -> str:
    """Write the program of `run(..., rows, k, count, r)`, which gives the ticks done, for lanes.

    Args:
        source: the program of a run that comes back after the tick of a fault.
        columns: of a row that are measured as they come, into `measures`, MEASURES numbers each: then there is one row,
            of those columns only, and the last parameter is LOW or LATE_LOW instead of the row; None to record whole
            rows.
        statistics: that are asked for of each.
    """
    kernels, head, text = source.rpartition("def run(")  # of most of the text nothing changes
    [run] = ast.parse(head + text).body
    assert isinstance(run, ast.FunctionDef)
    [loop] = [node for node in run.body if isinstance(node, ast.For)]
    run.body = [loop]
    loop.body = [each for each in loop.body if not any(isinstance(node, ast.Return) for node in ast.walk(each))]
    if columns is not None:
        place_of = {column: place for place, column in enumerate(dict.fromkeys(columns))}
        loop.body = [line for each in loop.body if (line := _lasting(each, place_of)) is not None]
        places = [place_of[column] for column in columns]
        last = next(i for i, each in enumerate(loop.body) if ast.unparse(each) == "k = k + 1")
        loop.body[last:last] = ast.parse("\n".join(_measured(places, statistics))).body
        run.args.args = [
            ast.arg({"r": "low"}.get(a.arg, a.arg)) for a in _with_measures(run.args.args, some=bool(places))
        ]
    return f"{kernels}{ast.unparse(ast.fix_missing_locations(run))}\n"


def taking_text(columns: int, statistics: Collection[str]) -> str:
    """Write the program of `run(rows, measures, k, count, low)`, which takes rows of some columns into measures."""
    lines = [line.replace(f"{ROWS}[", f"{ROWS}[i * {columns} + ") for line in _measured(range(columns), statistics)]
    body = "\n".join(f"        {line}" for line in [*lines, "k = k + 1"])
    return f"def run({ROWS}, {SUMS}, k, count, low):\n    for i in range(count):\n{body}\n"


def _with_measures(parameters: Sequence[ast.arg], *, some: bool) -> list[ast.arg]:
    """Put the measures behind the rows, or neither where nothing is measured."""
    out: list[ast.arg] = []
    for parameter in parameters:
        if parameter.arg != ROWS:
            out.append(parameter)
        elif some:
            out += [parameter, ast.arg(SUMS)]
    return out


def _lasting(node: ast.stmt, place_of: dict[int, int]) -> ast.stmt | None:
    """Drop the recording of columns that have no place, and what counts rows."""
    text = ast.unparse(node)
    if text.startswith("row = ") or text == "r = r + 1":
        return None
    if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Subscript):
        target = node.targets[0]
        if isinstance(target.value, ast.Name) and target.value.id == ROWS:
            column = _column(target.slice)
            if column not in place_of:
                return None
            target.slice = ast.Constant(place_of[column])
    return node


def _column(index: ast.expr) -> int:
    """Read the column from `row` or `row + column`."""
    if isinstance(index, ast.BinOp) and isinstance(index.right, ast.Constant):
        return int(str(index.right.value))
    return 0


def _measured(places: Sequence[int], statistics: Collection[str]) -> list[str]:
    """Write lines that take the row into measures."""
    needed = {m for name in statistics for m in NEEDS[name]}
    lines: list[str] = []
    for c, place in enumerate(places):
        o = c * MEASURES
        lines.append(f"x = {ROWS}[{place}]")
        if FIRST in needed:
            lines += ["if k == 0:", f"    {SUMS}[{o + FIRST}] = x"]
        if LAST in needed:
            lines.append(f"{SUMS}[{o + LAST}] = x")
        if SUM in needed:
            lines.append(f"{SUMS}[{o + SUM}] = {SUMS}[{o + SUM}] + x")
        if SQUARES in needed:
            lines.append(f"{SUMS}[{o + SQUARES}] = {SUMS}[{o + SQUARES}] + x * x")
        if LOW in needed:
            for first in (LOW, LATE_LOW):
                lines += [f"if low == {first}:"]
                lines += [f"    if x < {SUMS}[{o + first}]:", f"        {SUMS}[{o + first}] = x"]
                lines += [f"    if x > {SUMS}[{o + first + HIGH - LOW}]:"]
                lines += [f"        {SUMS}[{o + first + HIGH - LOW}] = x"]
    return lines or ["pass"]
