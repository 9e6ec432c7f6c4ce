"""Programs of variants that are alike but for their numbers: the step with what they have in common folded in."""

from __future__ import annotations

import ast
from collections.abc import Collection, Sequence
from typing import Any

from graspfx.batch.statistics import FIRST, HIGH, LAST, LATE_LOW, LOW, MEASURES, NEEDS, SQUARES, SUM
from graspfx.compile.kernel import keep_lowerings
from graspfx.compile.records import start_of
from graspfx.loop.arena import Arena
from graspfx.loop.kernels import kernel_of
from graspfx.loop.program import UNROLL
from graspfx.loop.world import ServoState

ROWS, SUMS = "rows", "measures"
ORDERS = {"invoke": (0, 2), "invoke_at": (0, 2, 3), "invoke_beside": (0, 2, 0, 3, 4)}  # arguments that a kernel takes


def folded(arena: Arena, definition: str) -> str:
    """Specialise a function whose names are those of step.py and the buffers `arena`, `rows` and `measures`.

    Args:
        arena: whose structure is folded in.
        definition: of the function, as Python.
    """
    from graspfx.compile.specialise.specialise import Program
    from graspfx.compile.specialise.values import Dynamic, Memory
    from graspfx.loop import step

    frozen = {("arena", k): number for k, number in arena.structure().items()}
    late = {name: lambda number, order=order: (kernel_of(number), order) for name, order in ORDERS.items()}
    program = Program(frozen, UNROLL, late=late, whole="<graspfx.loop.step.")
    [tree] = ast.parse(definition).body
    assert isinstance(tree, ast.FunctionDef)
    names: dict[str, Any] = {name: Memory(name, 0) for name in ("arena", ROWS, SUMS)}
    names |= {name: getattr(step, name) for name in ("begin", "stop", "move", "advance")}
    program.add_text(definition, names, [Dynamic(ast.Name(a.arg, ast.Load())) for a in tree.args.args])
    source = program.source()
    keep_lowerings()
    return source


def lane_text(arena: Arena, columns: Sequence[int] | None, statistics: Collection[str]) -> str:
    """Write run(k, count, low) for lanes, which goes on whatever happens and measures what it would record.

    Args:
        arena: of a variant.
        columns: of a row that are measured as they come, into `measures`, MEASURES numbers each: there is one row, of
            those columns only; `low` is LOW or LATE_LOW. None to record whole rows, from row `low` on.
        statistics: that are asked for of each.
    """
    places = _columns(arena)
    if columns is None:
        width = arena.parts.layout.width
        row = [f"{ROWS}[low * {width} + {c}] = arena[{place}]" for c, place in enumerate(places)]
        lines = [*_tick(arena, row), "k += 1", "low += 1"]
    else:
        place_of = {column: place for place, column in enumerate(dict.fromkeys(columns))}
        row = [f"{ROWS}[{place}] = arena[{places[column]}]" for column, place in place_of.items()]
        lines = [*_tick(arena, row), *_measured([place_of[column] for column in columns], statistics), "k += 1"]
    return "\n".join(["def run(k, count, low):", "    for i in range(count):", *_indented(lines)])


def taking_text(columns: int, statistics: Collection[str]) -> str:
    """Write the program of `run(rows, measures, k, count, low)`, which takes rows of some columns into measures."""
    lines = [line.replace(f"{ROWS}[", f"{ROWS}[i * {columns} + ") for line in _measured(range(columns), statistics)]
    body = "\n".join(_indented([*lines, "k = k + 1"]))
    return f"def run({ROWS}, {SUMS}, k, count, low):\n    for i in range(count):\n{body}\n"


def _tick(arena: Arena, row: Sequence[str]) -> list[str]:
    """Write the lines of a tick, as `steps` runs it where all is kernels."""
    world, servo = arena.offset, arena.place(arena.own)
    return [
        f"begin(arena, {world}, arena, {servo}, k)",
        f"if {_flag(arena)} != 0.0:",
        f"    stop(arena, {world})",
        *row,
        f"move(arena, {world}, arena, {servo}, k)",
        f"advance(arena, {world}, arena, {servo}, k)",
    ]


def _columns(arena: Arena) -> list[int]:
    world = arena.world
    return [int(world.columns[c]) for c in range(world.recorded)]


def _servo(arena: Arena, name: str) -> int:
    return arena.place(arena.own) + start_of(ServoState, name)


def _flag(arena: Arena) -> str:
    return f"arena[{_servo(arena, 'faulted')}]"


def _indented(lines: Sequence[str]) -> list[str]:
    return [f"        {line}" for line in lines]


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
