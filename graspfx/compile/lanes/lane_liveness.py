"""Names that a statement leaves to be read: only those are blended where lanes that went different ways meet."""

from __future__ import annotations

import ast
from collections.abc import Sequence

Names = frozenset[str]
NONE: Names = frozenset()


class Liveness:
    """For each statement of a function, the names that may be read after it before they are assigned anew.

    Attributes:
        after: by statement.
        head: by loop, the names that may be read from where a turn of it begins.
    """

    def __init__(self, tree: ast.FunctionDef) -> None:
        self.after: dict[ast.stmt, Names] = {}
        self.head: dict[ast.stmt, Names] = {}
        self._block(tree.body, NONE, (NONE, NONE))

    def _block(self, statements: Sequence[ast.stmt], after: Names, loop: tuple[Names, Names]) -> Names:
        """Work backwards; give what may be read from the first statement on. `loop`: at its head, and behind it."""
        for statement in reversed(statements):
            self.after[statement] = after
            after = self._statement(statement, after, loop)
        return after

    def _statement(self, node: ast.stmt, after: Names, loop: tuple[Names, Names]) -> Names:
        match node:
            case ast.If():
                sides = self._block(node.body, after, loop) | self._block(node.orelse, after, loop)
                return sides | read(node.test)
            case ast.While():
                return self._turns(node, read(node.test), NONE, after)
            case ast.For():
                return self._turns(node, NONE, _names(node.target), after) | read(node.iter)
            case ast.Return():
                return NONE if node.value is None else read(node.value)
            case ast.Break():
                return loop[1]
            case ast.Continue():
                return loop[0]
            case ast.Assign():
                written = frozenset(name for target in node.targets for name in _written(target))
                inner = [target for target in node.targets if not isinstance(target, ast.Name)]
                return (after - written) | read(node.value).union(*map(_inside, inner))
            case ast.AugAssign():
                return after | read(node.value) | _names(node.target)
        return after | read(node)

    def _turns(self, node: ast.While | ast.For, test: Names, counted: Names, after: Names) -> Names:
        head = after | test
        while True:
            self.head[node] = head
            begin = self._block(node.body, head, (head, after))
            more = head | (begin - counted)
            if more == head:
                return head
            head = more


def read(node: ast.AST) -> Names:
    """List the names that an expression reads."""
    return frozenset(n.id for n in ast.walk(node) if isinstance(n, ast.Name))


def _names(node: ast.AST) -> Names:
    return read(node)


def _written(target: ast.expr) -> list[str]:
    if isinstance(target, ast.Name):
        return [target.id]
    return [name for part in target.elts for name in _written(part)] if isinstance(target, ast.Tuple) else []


def _inside(target: ast.expr) -> Names:
    """List the names that an assignment to entries reads: buffers and indices."""
    if isinstance(target, ast.Tuple):
        return NONE.union(*map(_inside, target.elts))
    return NONE if isinstance(target, ast.Name) else read(target)
