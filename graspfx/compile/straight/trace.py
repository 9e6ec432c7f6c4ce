"""One turn of a program written down while it runs: what it computes, and what it took for granted on its way.

The program runs as Python on buffers whose entries are `Node`s, each a number with the operation that made it. Where
the program asks something of a number (a branch, an index, a whole part) the number's own answer is taken, and noted as
a `Guard`: wherever all guards hold, the same operations in the same order give what the program gives, to the last bit.
"""

from __future__ import annotations

import ast
import builtins
import math
import operator
from collections.abc import Callable, Iterable, Iterator, Sequence
from types import SimpleNamespace
from typing import Any, NamedTuple

Plain = bool | int | float
Slot = tuple[str, int]

OPERATORS: dict[str, Callable[[Any, Any], Any]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "//": operator.floordiv,
    "%": operator.mod,
    "**": operator.pow,
}
ORDERS: dict[str, Callable[[Any, Any], bool]] = {
    "==": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}
TESTS = ("isfinite", "isnan", "isinf")
WHOLE = ("floor", "ceil", "trunc")


class Guard(NamedTuple):
    """An assumption of a traced turn: `a op b`, `math.op(a)`, or, for op "whole", int(a) = b, with this outcome.

    What stands in a program as text may be asked of, too.
    """

    op: str
    a: Node | Plain | str
    b: Node | Plain | None
    outcome: bool


class Node:
    """A number and how it was made: "input" of a slot, an operator, a function's name, or part of a call's result."""

    __slots__ = ("args", "graph", "number", "op", "steady", "value")

    def __init__(self, graph: Graph, number: int, op: str, args: tuple[Any, ...], value: Plain, steady: bool) -> None:
        self.graph, self.number, self.op, self.args, self.value, self.steady = graph, number, op, args, value, steady

    def __index__(self) -> int:
        return self.__int__()

    def __int__(self) -> int:
        whole = int(self.value)
        self.graph.guard("whole", self, whole, True)
        return whole

    def __bool__(self) -> bool:
        return bool(self.graph.ask("!=", self, 0.0))

    def __neg__(self) -> Any:
        return self.graph.function("-", [self], operator.neg)

    def __pos__(self) -> Node:
        return self

    def __abs__(self) -> Any:
        return self.graph.function("abs", [self], abs)

    __hash__ = object.__hash__


def _operation(symbol: str, *, turned: bool) -> Callable[[Node, Any], Any]:
    def both(one: Node, other: Any) -> Any:
        return one.graph.operation(symbol, other, one) if turned else one.graph.operation(symbol, one, other)

    return both


def _order(symbol: str) -> Callable[[Node, Any], bool]:
    return lambda one, other: one.graph.ask(symbol, one, other)


for _name, _symbol in (
    ("add", "+"), ("sub", "-"), ("mul", "*"), ("truediv", "/"), ("floordiv", "//"), ("mod", "%"), ("pow", "**")
):  # fmt: skip
    setattr(Node, f"__{_name}__", _operation(_symbol, turned=False))
    setattr(Node, f"__r{_name}__", _operation(_symbol, turned=True))
for _name, _symbol in (("eq", "=="), ("ne", "!="), ("lt", "<"), ("le", "<="), ("gt", ">"), ("ge", ">=")):
    setattr(Node, f"__{_name}__", _order(_symbol))


class Graph:
    """All that is computed, each thing once, in the order in which it was first computed."""

    def __init__(self) -> None:
        self.nodes: list[Node] = []
        self.guards: dict[object, Guard] = {}
        self._by_key: dict[object, Node] = {}

    def node(self, op: str, args: tuple[Any, ...], value: Plain, *, steady: bool) -> Node:
        key = op, tuple(map(_key, args))
        node_ = self._by_key.get(key)
        if node_ is None:
            node_ = self._by_key[key] = Node(self, len(self.nodes), op, args, value, steady)
            self.nodes.append(node_)
        return node_

    def operation(self, symbol: str, a: Any, b: Any) -> Any:
        """Add a op b; a product or sum that changes nothing, whatever the number is, adds no node."""
        if symbol == "*" and _is(a, 1.0):
            return b
        if (symbol in ("*", "/") and _is(b, 1.0)) or (symbol == "-" and _is(b, 0.0)):
            return a
        return self.function(symbol, [a, b], OPERATORS[symbol])

    def function(self, op: str, args: Sequence[Any], compute: Callable[..., Any]) -> Any:
        steady = all(arg.steady for arg in args if isinstance(arg, Node))
        return self.node(op, tuple(args), compute(*map(plain, args)), steady=steady)

    def ask(self, symbol: str, a: Any, b: Any) -> bool:
        outcome = ORDERS[symbol](plain(a), plain(b))
        self.guard(symbol, a, b, outcome)
        return outcome

    def guard(self, op: str, a: Any, b: Any, outcome: bool) -> None:
        self.guards.setdefault((op, _key(a), _key(b)), Guard(op, a, b, outcome))

    def called(self, name: str, args: Sequence[Any], compute: Callable[..., Any]) -> Any:
        """Add a function of the program as one operation."""
        result = compute(*map(plain, args))
        steady = all(arg.steady for arg in args if isinstance(arg, Node))
        if not isinstance(result, tuple):
            return self.node("call", (name, *args), result, steady=steady)
        whole = self.node("call", (name, *args), math.nan, steady=steady)
        return tuple(self.node("item", (whole, k, len(result)), part, steady=steady) for k, part in enumerate(result))


class Cells:
    """A buffer while a turn is written down; what it holds at the beginning is asked for when it is first read."""

    def __init__(self, name: str, begin: Callable[[Slot], Node | Plain]) -> None:
        self.name, self.begin = name, begin
        self.first: dict[int, Node | Plain] = {}
        self.now: dict[int, Node | Plain] = {}

    def __getitem__(self, index: Any) -> Node | Plain:
        k = index if isinstance(index, int) else index.__index__()
        if k not in self.now:
            self.first[k] = self.now[k] = self.begin((self.name, k))
        return self.now[k]

    def __setitem__(self, index: Any, value: Any) -> None:
        k = index if isinstance(index, int) else index.__index__()
        self.now[k] = value if isinstance(value, Node) else float(value)


class Traceable:
    """A program whose turns can be written down.

    Args:
        source: the program as Python, its last function the entry.
        whole: functions that only compute but branch on their way become one operation each, if this says so of their
            arguments.
    """

    def __init__(self, source: str) -> None:
        self.tree = ast.parse(source)
        functions = [node for node in self.tree.body if isinstance(node, ast.FunctionDef)]
        self.entry = functions[-1].name
        self.parameters = [a.arg for a in functions[-1].args.args]
        self.branching = {f.name: f for f in _pure(functions) if _branches(f)}
        self._plain: dict[str, Any] = {}
        self._code = compile(source, "<program>", "exec")
        exec(self._code, self._plain)

    def turn(self, graph: Graph, arguments: Sequence[Any], whole: Callable[[Sequence[Any]], bool]) -> None:
        """Run the entry once on these arguments.

        Args:
            graph: what is computed is added to it.
            arguments: of the entry: buffers (`Cells`) and numbers.
            whole: says of the arguments of a function that only computes but branches whether it is one operation.

        Raises:
            ArithmeticError, ValueError, IndexError: the turn cannot be run.
        """
        names: dict[str, Any] = {}
        exec(self._code, names)
        for name in self.branching:
            names[name] = self._whole_or_inside(graph, name, names[name], whole)
        names |= _builtins(graph)
        names[self.entry](*arguments)

    def _whole_or_inside(
        self, graph: Graph, name: str, inside: Callable[..., Any], whole: Callable[[Sequence[Any]], bool]
    ) -> Callable[..., Any]:
        compute = self._plain[name]

        def call(*args: Any) -> Any:
            if any(isinstance(arg, Node) for arg in args) and whole(args):
                return graph.called(name, args, compute)
            return inside(*args)

        return call


def plain(value: Any) -> Any:
    """Take the number of a node."""
    return value.value if isinstance(value, Node) else value


def parts(node: Node) -> Iterator[Node]:
    """List the nodes that an operation is computed from."""
    return (arg for arg in node.args if isinstance(arg, Node))


def needed(roots: Iterable[Node]) -> list[Node]:
    """List all nodes that some nodes are computed from, and themselves, in order."""
    needed_: dict[int, Node] = {}
    rest = list(roots)
    while rest:
        node = rest.pop()
        if node.number not in needed_:
            needed_[node.number] = node
            rest += parts(node)
    return [needed_[number] for number in sorted(needed_)]


def _key(value: Any) -> object:
    if isinstance(value, Node):
        return value.number
    return type(value).__name__, repr(value)


def _is(value: Any, number: float) -> bool:
    return isinstance(value, float) and value == number and math.copysign(1.0, value) == math.copysign(1.0, number)


def _builtins(graph: Graph) -> dict[str, Any]:
    """Provide `math` and the builtins of a program, for nodes too."""

    def lifted(name: str, compute: Callable[..., Any]) -> Callable[..., Any]:
        def call(*args: Any) -> Any:
            if not any(isinstance(arg, Node) for arg in args):
                return compute(*args)
            return graph.function(name, args, compute)

        return call

    def test(name: str, compute: Callable[[float], bool]) -> Callable[[Any], bool]:
        def call(x: Any) -> bool:
            outcome = compute(plain(x))
            if isinstance(x, Node):
                graph.guard(name, x, None, outcome)
            return outcome

        return call

    def whole(compute: Callable[[float], int]) -> Callable[[Any], int]:
        def call(x: Any) -> int:
            item = compute(plain(x))
            if isinstance(x, Node):
                graph.guard("==", graph.function(f"math.{compute.__name__}", [x], compute), item, True)
            return item

        return call

    functions: dict[str, Any] = {}
    for name, item in vars(math).items():
        if name in TESTS:
            functions[name] = test(name, item)
        elif name in WHOLE:
            functions[name] = whole(item)
        elif callable(item):
            functions[name] = lifted("abs" if name == "fabs" else f"math.{name}", item)
        else:
            functions[name] = item
    return {
        "math": SimpleNamespace(**functions),
        "min": lifted("min", min),
        "max": lifted("max", max),
        "float": lifted("float", builtins.float),
    }


def _pure(functions: Sequence[ast.FunctionDef]) -> list[ast.FunctionDef]:
    """List the functions that touch no buffer, nor call one that does; each stands after those that it calls."""
    names = {f.name for f in functions}
    pure: dict[str, ast.FunctionDef] = {}
    for function in functions:
        inner = list(ast.walk(function))
        called = {n.func.id for n in inner if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)}
        if called & names <= pure.keys() and not any(isinstance(n, ast.Subscript) for n in inner):
            pure[function.name] = function
    return list(pure.values())


def _branches(function: ast.FunctionDef) -> bool:
    return any(isinstance(n, ast.If | ast.IfExp | ast.While | ast.For) for n in ast.walk(function))


def definitions(tree: ast.Module, names: Iterable[str]) -> list[str]:
    """Write the text of functions of a program, with those that they call, in its order."""
    functions = {f.name: f for f in tree.body if isinstance(f, ast.FunctionDef)}
    reached: set[str] = set()
    rest = list(names)
    while rest:
        name = rest.pop()
        if name in functions and name not in reached:
            reached.add(name)
            rest += [n.id for n in ast.walk(functions[name]) if isinstance(n, ast.Name)]
    return [ast.unparse(functions[name]) for name in functions if name in reached]
