"""Detection of names that a kernel may read before assignment, where machine code reads undefined values."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from graspfx.compile.syntax import assigned

Bound = frozenset[str] | None  # names that certainly have a value; None for unreachable code


@dataclass
class Loop:
    """Sets of the names that are bound where a loop is left, one set for each `break`."""

    breaks: list[Bound] = field(default_factory=list)


def unbound_names(tree: ast.FunctionDef) -> list[ast.Name]:
    """List the reads of a function's local variables that some path reaches before an assignment.

    The analysis assumes that every condition can be true or false, regardless of earlier conditions. It also assumes
    that a loop can have no iterations, unless the loop is `while True` or runs over a literal, non-empty range or
    tuple.
    """
    flow = Flow(assigned(tree.body))
    flow.block(tree.body, frozenset(a.arg for a in tree.args.args))
    return flow.uses


def lost_end(tree: ast.FunctionDef) -> int:
    """Return the line at which a function that returns a value can end without a value, or 0 if there is no such line.

    The analysis assumes that every condition can be true or false, so `if` and `elif` without `else` may fall through.
    """
    returns = [node for node in ast.walk(tree) if isinstance(node, ast.Return)]
    if all(node.value is None for node in returns):
        return 0
    for node in returns:
        if node.value is None:
            return node.lineno
    flow = Flow(set())
    return 0 if flow.block(tree.body, frozenset()) is None else tree.body[-1].end_lineno or tree.lineno


class Flow:
    """Analysis of the paths through a function; `uses` lists the reads of names that may be unassigned.

    Args:
        variables: Names that the function assigns to.
    """

    def __init__(self, variables: set[str]) -> None:
        self._variables = variables
        self._loops: list[Loop] = []
        self.uses: list[ast.Name] = []

    def block(self, statements: Sequence[ast.stmt], bound: Bound) -> Bound:
        """Analyse statements; return the names that are certainly bound after the last statement."""
        for statement in statements:
            if bound is None:
                break
            bound = self.statement(statement, bound)
        return bound

    def statement(self, node: ast.stmt, bound: frozenset[str]) -> Bound:
        match node:
            case ast.Assign():
                self.use(node.value, bound)
                for target in node.targets:
                    bound = self.assign(target, bound)
            case ast.AnnAssign():
                if node.value is not None:
                    self.use(node.value, bound)
                    bound = self.assign(node.target, bound)
            case ast.AugAssign():
                if isinstance(node.target, ast.Name):
                    self.note(node.target, bound)
                self.use(node.value, bound)
                bound = self.assign(node.target, bound)
            case ast.If():
                self.use(node.test, bound)
                return common([self.block(node.body, bound), self.block(node.orelse, bound)])
            case ast.While():
                self.use(node.test, bound)
                return self.turns(node.body, bound, bound, endless=_is_true(node.test))
            case ast.For():
                self.use(node.iter, bound)
                return self.turns(node.body, bound, self.assign(node.target, bound), once=_has_turns(node.iter))
            case ast.Return():
                if node.value is not None:
                    self.use(node.value, bound)
                return None
            case ast.Break():
                if self._loops:
                    self._loops[-1].breaks.append(bound)
                return None
            case ast.Continue():
                return None
            case ast.Expr():
                self.use(node.value, bound)
        return bound

    def turns(
        self, body: Sequence[ast.stmt], before: Bound, inside: Bound, *, once: bool = False, endless: bool = False
    ) -> Bound:
        """Analyse the body of a loop; return the names that are certainly bound after the loop.

        The body is analysed once, because no later iteration starts with fewer bound names than the first iteration.
        """
        loop = Loop()
        self._loops.append(loop)
        behind = self.block(body, inside)
        self._loops.pop()
        if endless:
            return common(loop.breaks)
        first = common([behind, *self._continued(body, inside)]) if once else before
        return common([first, *loop.breaks])

    def _continued(self, body: Sequence[ast.stmt], inside: Bound) -> list[Bound]:
        """Return the names bound at a `continue` of the body, as a list with one entry, or an empty list without one.

        These are the names bound at the start of an iteration.
        """
        return [inside] if any(isinstance(node, ast.Continue) for each in body for node in ast.walk(each)) else []

    def assign(self, target: ast.expr, bound: frozenset[str]) -> frozenset[str]:
        if isinstance(target, ast.Name):
            return bound | {target.id}
        if isinstance(target, ast.Tuple):
            for part in target.elts:
                bound = self.assign(part, bound)
            return bound
        self.use(target, bound)
        return bound

    def use(self, node: ast.expr, bound: frozenset[str]) -> None:
        for name in _names(node):
            self.note(name, bound)

    def note(self, name: ast.Name, bound: frozenset[str]) -> None:
        if name.id in self._variables and name.id not in bound:
            self.uses.append(name)


def common(ways: Sequence[Bound]) -> Bound:
    """Return the names that are bound on all of several paths; unreachable paths are ignored."""
    sets = [way for way in ways if way is not None]
    return frozenset.intersection(*sets) if sets else None


def _names(node: ast.expr) -> Iterator[ast.Name]:
    return (n for n in ast.walk(node) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Load))


def _is_true(test: ast.expr) -> bool:
    return isinstance(test, ast.Constant) and bool(test.value)


def _has_turns(turns: ast.expr) -> bool:
    """Return whether the iterable of a loop is a literal range or tuple with at least one element."""
    if isinstance(turns, ast.Tuple):
        return bool(turns.elts)
    if not (isinstance(turns, ast.Call) and isinstance(turns.func, ast.Name) and turns.func.id == "range"):
        return False
    try:
        return bool(range(*(int(ast.literal_eval(bound)) for bound in turns.args)))
    except ValueError:
        return False
