"""How large the numbers of a turn can be, so that what only guards against infinity need not be asked every turn.

A number that a turn carries on is taken to be at most CARRIED at first, one that stays the same at most STEADY, and as
a divisor at least 1/STEADY: all three are asked when the program runs. From there bounds follow by the operations.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from graspfx.compile.straight.trace import Graph, Guard, Node, Plain, Slot

CARRIED = 1e80
STEADY = 1e7
LARGEST_TICK = 1e9
ROUNDING = 1.0 + 1e-12
Bounds = dict[int, float]


def magnitudes(graph: Graph, carried: Mapping[Slot, float]) -> Bounds:
    """Bound the size of each node, by its number; inf where there is no bound, and where it may be NaN."""
    sizes: Bounds = {}
    positive: set[int] = set()
    for node in graph.nodes:
        if node.steady:
            sizes[node.number] = 0.0 if multiplied(node) is not None else STEADY
            continue
        operands = [_size(arg, sizes) for arg in node.args if isinstance(arg, Node | bool | int | float)]
        sizes[node.number] = _bound(node, operands, carried, positive) * ROUNDING
        if _is_positive(node, positive):
            positive.add(node.number)
    return sizes


def _size(arg: Node | Plain, bounds: Bounds) -> float:
    size = bounds[arg.number] if isinstance(arg, Node) else abs(float(arg))
    return math.inf if math.isnan(size) else size


def _bound(node: Node, sizes: Sequence[float], carried: Mapping[Slot, float], positive: set[int]) -> float:
    op, args = node.op, node.args
    if op == "input":
        return carried.get(args[0], math.inf)
    if op == "tick":
        return LARGEST_TICK
    if op in ("+", "-"):
        return sum(sizes)
    if op == "*":
        return 0.0 if 0.0 in sizes and math.inf not in sizes else math.prod(sizes)
    if op == "/":
        divisor = args[1]
        if isinstance(divisor, Node):
            return sizes[0] * STEADY if divisor.steady else math.inf
        return sizes[0] / sizes[1] if sizes[1] > 0.0 else math.inf
    if op in ("abs", "min", "max", "float"):
        return max(sizes)
    if op == "math.sqrt" and isinstance(args[0], Node) and args[0].number in positive:
        return math.sqrt(sizes[0])
    if op in ("math.sin", "math.cos") and sizes[0] < math.inf:
        return 1.0
    return math.inf


def _is_positive(node: Node, positive: set[int]) -> bool:
    """Tell whether a node is zero or more (or NaN)."""
    if node.op == "*":
        return node.args[0] is node.args[1]
    if node.op == "+":
        return all(arg.number in positive if isinstance(arg, Node) else arg >= 0.0 for arg in node.args)
    return node.op in ("abs", "math.sqrt")


def multiplied(node: Node) -> Node | None:
    """Give the steady number that a node multiplies by zero: the product is zero if the number is finite."""
    if node.steady and node.op == "*":
        for one, other in (node.args, node.args[::-1]):
            if isinstance(other, Node) and not isinstance(one, Node) and one == 0.0:
                return other
    return None


def divisors(graph: Graph) -> set[int]:
    """List the steady nodes that others are divided by."""
    return {
        node.args[1].number
        for node in graph.nodes
        if node.op == "/" and not node.steady and isinstance(node.args[1], Node) and node.args[1].steady
    }


def implied(guard: Guard, bounds: Bounds) -> bool:
    """Tell whether the bounds imply a guard."""
    op, a, b, outcome = guard
    if not isinstance(a, Node) or a.steady:
        return False
    size = bounds[a.number]
    if op == "isfinite":
        return outcome and size < math.inf
    if isinstance(b, Node) or b is None:
        return False
    if a.op == "tick":
        return op in (">", ">=") and outcome  # it only grows
    if op == "<=":
        return outcome and size <= b
    if op in ("==", "!="):
        return size == 0.0 == b and outcome == (op == "==")
    return False


def carried_on(
    graph: Graph, ends: Mapping[Slot, Node | Plain], guards: Sequence[Guard], most: int
) -> tuple[int, Bounds]:
    """Count the turns, up to `most`, whose guards follow from bounds at their beginning; return the last bounds too.

    Args:
        graph: one turn.
        ends: what it leaves in the slots that it carries on.
        guards: those that bounds can imply at all.
        most: turns.
    """
    carried = dict.fromkeys(ends, CARRIED)
    bounds = magnitudes(graph, carried)
    implied_guards = [guard for guard in guards if implied(guard, bounds)]
    turns = 1
    while turns < most:
        carried = {slot: max(carried[slot], _size(end, bounds)) for slot, end in ends.items()}
        following = magnitudes(graph, carried)
        if not all(implied(guard, following) for guard in implied_guards):
            break
        bounds, turns = following, turns + 1
    return turns, bounds
