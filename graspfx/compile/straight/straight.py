"""A program that turns without end, as a straight line for many of its kind side by side.

Its first turns are written down (`graspfx.compile.straight.trace`) as they come, then one that all later turns are
like. What stays the same from turn to turn is computed once, what nothing asks for never, and what is carried on stays
in local variables over some turns; the loop over the lanes inside has no branch, so that LLVM makes it one of vectors.
A lane in which something is not as it was taken for granted is marked, and left to the program itself.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.straight import bounds
from graspfx.compile.straight.trace import Cells, Graph, Guard, Node, Plain, Slot, Traceable, needed, parts, plain

FloatArray = NDArray[np.float64]

HEADS = (2, 3, 4)  # turns after which all are tried to be alike
TURNS = 4  # for which what is carried on stays in local variables
FOLDED = (0.0, 1.0, -1.0)  # numbers that are worth a program of their own
SIGNED = ("math.atan2", "math.copysign", "/", "**", "//", "%")  # operations that may tell 0.0 from -0.0


class NotSteadyError(Exception):
    """A program whose turns differ."""


@dataclass(frozen=True)
class Turns:
    """A program's turns written down.

    Attributes:
        head: what the first turns compute.
        watched: per turn of the head, the numbers that are asked for.
        body: what every later turn computes.
        begin: what the slots hold when the first of them begins, in terms of the head.
        ends: what a later turn leaves in the slots that it carries on.
        output: the numbers that are asked for, in terms of the body.
    """

    head: Graph
    watched: list[list[Node | Plain]]
    body: Graph
    begin: Callable[[Slot], Node | Plain]
    ends: dict[Slot, Node | Plain]
    output: list[Node | Plain]


def written_down(
    program: Traceable,
    arrays: Mapping[str, FloatArray],
    same: Callable[[Slot], bool],
    columns: Sequence[int],
) -> Turns:
    """Trace the turns of `run(..., k, count, r)`, each of which writes a row to `rows`.

    Args:
        program: the program.
        arrays: its buffers at the beginning, of one lane.
        same: whether an entry of a buffer is the same in every lane.
        columns: of a row, that are asked for.

    Raises:
        NotSteadyError: later turns are not alike.
    """
    error: Exception | None = None
    for count in HEADS:
        try:
            return _Writer(program, arrays, same, columns).turns(count)
        except (NotSteadyError, ArithmeticError, ValueError, IndexError) as fault:
            error = fault
    raise NotSteadyError(str(error)) from error


class _Writer:
    def __init__(
        self,
        program: Traceable,
        arrays: Mapping[str, FloatArray],
        same: Callable[[Slot], bool],
        columns: Sequence[int],
    ) -> None:
        self.program, self.arrays, self.same, self.columns = program, arrays, same, columns
        self.names = [name for name in program.parameters if name in arrays]

    def turns(self, count: int) -> Turns:
        head = Graph()

        def start(slot: Slot) -> Node | Plain:
            value = float(self.arrays[slot[0]][slot[1]])
            if self.same(slot) and value in FOLDED:
                return value
            return head.node("input", (slot,), value, steady=True)

        cells = {name: Cells(name, start) for name in self.names}
        watched = [self._turn(head, cells, k, lambda args: True) for k in range(count)]

        def begin(slot: Slot) -> Node | Plain:
            return cells[slot[0]][slot[1]]

        carried: set[Slot] = set()  # all else stays
        while True:
            body, now, output = self._steady_turn(begin, carried, count, None)
            more = {slot for slot in _changed(now) if slot not in carried}
            if not more:
                break
            carried |= more
        ends = {slot: now[slot[0]].now[slot[1]] for slot in carried if slot[1] in now[slot[0]].first}
        self._require_alike(begin, carried, count, body, now)
        return Turns(head, watched, body, begin, ends, output)

    def _steady_turn(
        self, begin: Callable[[Slot], Node | Plain], carried: set[Slot], k: int, values: Mapping[Slot, float] | None
    ) -> tuple[Graph, dict[str, Cells], list[Node | Plain]]:
        graph = Graph()

        def first(slot: Slot) -> Node | Plain:
            start = begin(slot)
            value = plain(start) if values is None else values.get(slot, plain(start))
            if slot in carried:
                return graph.node("input", (slot,), value, steady=False)
            return graph.node("input", (slot,), value, steady=True) if isinstance(start, Node) else start

        now = {name: Cells(name, first) for name in self.names}
        tick = graph.node("tick", (), k, steady=False)
        output = self._turn(graph, now, tick, lambda args: all(a.steady for a in args if isinstance(a, Node)))
        return graph, now, output

    def _turn(
        self, graph: Graph, cells: Mapping[str, Cells], k: Any, whole: Callable[[Sequence[Any]], bool]
    ) -> list[Node | Plain]:
        def none(slot: Slot) -> float:
            raise NotSteadyError(f"row {slot[1]} is read")

        rows = Cells("rows", none)
        values = {**cells, "rows": rows, "k": k, "count": 1, "r": 0}
        self.program.turn(graph, [values[name] for name in self.program.parameters], whole)
        return [rows.now[c] for c in self.columns]

    def _require_alike(
        self,
        begin: Callable[[Slot], Node | Plain],
        carried: set[Slot],
        count: int,
        body: Graph,
        now: Mapping[str, Cells],
    ) -> None:
        values = {(name, k): plain(value) for name, cells in now.items() for k, value in cells.now.items()}
        again, _, _ = self._steady_turn(begin, carried, count + 1, values)
        if _shape(again) != _shape(body):
            raise NotSteadyError("turns differ")


def _changed(now: Mapping[str, Cells]) -> Iterator[Slot]:
    """List the slots that are read and hold something else at the end."""
    for name, cells in now.items():
        for k, first in cells.first.items():
            last = cells.now[k]
            alike = (
                last is first if isinstance(first, Node) else not isinstance(last, Node) and _bits(last) == _bits(first)
            )
            if not alike:
                yield name, k


def _bits(value: Plain) -> str:
    return float(value).hex()


def _shape(graph: Graph) -> object:
    def described(value: Any) -> object:
        return ("node", value.number) if isinstance(value, Node) else (type(value).__name__, repr(value))

    nodes = [(node.op, *map(described, node.args)) for node in graph.nodes]
    return nodes, [(g.op, described(g.a), described(g.b), g.outcome) for g in graph.guards.values()]


@dataclass(frozen=True)
class Body:
    """A later turn, with only what is asked for.

    Attributes:
        output: the numbers that are asked for.
        ends: what is left in the slots that are carried on.
        guards: what is to be asked every turn.
        once: what is to be asked once.
        steady: numbers that are computed once.
        bounded: numbers that bounds take to be at most `bounds.STEADY`.
        divisors: those that they take to be at least its inverse.
        turns: for how many turns what is carried on is bounded, if it is at the beginning.
    """

    output: list[Node | Plain]
    ends: dict[Slot, Node | Plain]
    guards: list[Guard]
    once: list[Guard]
    steady: list[Node]
    bounded: list[Node]
    divisors: list[Node]
    turns: int


def reduced(turns: Turns) -> Body:
    """Reduce a turn to the nodes that are asked for, without the guards that bounds imply."""
    graph = turns.body
    every = list(graph.guards.values())
    once = [g for g in every if all(n.steady for n in (g.a, g.b) if isinstance(n, Node))]
    rest = [g for g in every if not any(g is o for o in once)]
    count, sizes = bounds.carried_on(graph, turns.ends, rest, TURNS)
    replaced = _Replaced(graph, sizes)
    guards = [replaced.guard(g) for g in rest if not bounds.implied(g, sizes)]
    output = [replaced(value) for value in turns.output]
    ends = {slot: replaced(value) for slot, value in turns.ends.items()}
    roots = [value for g in guards for value in (g.a, g.b)] + output
    live: set[Slot] = set()
    while True:
        nodes = needed(n for n in (*roots, *(ends[slot] for slot in live)) if isinstance(n, Node))
        more = {n.args[0] for n in nodes if n.op == "input" and not n.steady} - live
        if not more:
            break
        live |= more
    live_ends = {slot: end for slot, end in ends.items() if slot in live}
    used = [n for node in nodes if not node.steady for n in parts(node) if n.steady]
    used += [n for n in (*roots, *live_ends.values()) if _is_steady(n)]
    bounded = [n for node in graph.nodes if not node.steady for n in parts(node) if n.steady]
    bounded += [n for node in graph.nodes if (n := bounds.multiplied(node)) is not None]
    return Body(
        output,
        live_ends,
        guards,
        [replaced.guard(g) for g in once],
        _each(used),
        _each(n for n in map(replaced, bounded) if isinstance(n, Node)),
        _each(replaced(graph.nodes[number]) for number in bounds.divisors(graph)),
        count,
    )


def _each(nodes: Iterable[Node]) -> list[Node]:
    unique = {node.number: node for node in nodes}
    return [unique[number] for number in sorted(unique)]


def _is_steady(value: Any) -> bool:
    return isinstance(value, Node) and value.steady


class _Replaced:
    """Nodes of a graph with the zeros left out that change no more than the sign of a zero."""

    def __init__(self, graph: Graph, sizes: Mapping[int, float]) -> None:
        self.sizes = sizes
        self.graph = Graph()
        self.zeros = not any(n.op in SIGNED and not n.steady and _is_unsafe(n) for n in graph.nodes)
        self.replacements: dict[int, Node | Plain] = {}
        for node in graph.nodes:
            self.replacements[node.number] = self._new(node)

    def __call__(self, value: Any) -> Any:
        return self.replacements[value.number] if isinstance(value, Node) else value

    def guard(self, guard: Guard) -> Guard:
        return Guard(guard.op, self(guard.a), self(guard.b), guard.outcome)

    def _new(self, node: Node) -> Node | Plain:
        if self.zeros and self.sizes[node.number] == 0.0:
            return 0.0
        args = [self(arg) for arg in node.args]
        if self.zeros and node.op in ("+", "-") and len(args) == 2:
            if _is_zero(args[1]):
                return args[0]  # type: ignore[no-any-return]
            if node.op == "+" and _is_zero(args[0]):
                return args[1]  # type: ignore[no-any-return]
        return self.graph.node(node.op, tuple(args), node.value, steady=node.steady)


def _is_unsafe(node: Node) -> bool:
    """Tell whether a division may be by a zero, whose sign then counts."""
    if node.op != "/":
        return True
    return isinstance(node.args[1], Node) and not node.args[1].steady


def _is_zero(value: Any) -> bool:
    return not isinstance(value, Node) and value == 0.0


class Text:
    """Lines that compute nodes, each under a name of its own.

    Args:
        prefix: of the names.
        names: names or numbers of inputs, and of what has been computed before.
    """

    def __init__(self, prefix: str, names: Mapping[int, str]) -> None:
        self.prefix, self.names = prefix, dict(names)
        self.lines: list[str] = []

    def compute(self, roots: Iterable[Any]) -> None:
        missing = self._missing(roots)
        widths = {n.args[0].number: n.args[2] for n in missing if n.op == "item"}
        for node in missing:
            name = f"{self.prefix}{node.number}"
            if node.op == "item":
                self.names[node.number] = f"{self.prefix}{node.args[0].number}_{node.args[1]}"
                continue
            if node.number in widths:
                target = ", ".join(f"{name}_{k}" for k in range(widths[node.number]))
            else:
                self.names[node.number] = target = name
            self.lines.append(f"{target} = {self._expression(node)}")

    def _missing(self, roots: Iterable[Any]) -> list[Node]:
        missing: dict[int, Node] = {}
        rest = [n for n in roots if isinstance(n, Node)]
        while rest:
            node = rest.pop()
            if node.number not in missing and node.number not in self.names:
                missing[node.number] = node
                rest += parts(node)
        return [missing[number] for number in sorted(missing)]

    def _expression(self, node: Node) -> str:
        args = [self.text_of(arg) for arg in node.args]
        if node.op == "call":
            return f"{node.args[0]}({', '.join(args[1:])})"
        if node.op[0].isalpha():
            return f"{node.op}({', '.join(args)})"
        return f"{args[0]} {node.op} {args[1]}" if len(args) == 2 else f"{node.op}{args[0]}"

    def text_of(self, value: Any) -> str:
        if isinstance(value, Node):
            return self.names[value.number]
        if isinstance(value, str):
            return value
        text = repr(value)
        return f"({text})" if text.startswith("-") else text

    def asks(self, guard: Guard) -> str:
        a = self.text_of(guard.a)
        if guard.op == "whole":
            test = f"int({a}) == {guard.b}"
        elif guard.op.isalpha():
            test = f"math.{guard.op}({a})"
        else:
            test = f"{a} {guard.op} {self.text_of(guard.b)}"
        return test if guard.outcome else f"not {test}"
