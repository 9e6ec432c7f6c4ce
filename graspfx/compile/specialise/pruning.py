"""Elimination of dead code."""

from __future__ import annotations

import ast

from graspfx.compile.specialise.syntax import calls, nodes


def without_unused(statements: list[ast.stmt]) -> list[ast.stmt]:
    """Eliminate assignments of constants to variables that nothing reads."""
    while True:
        read = {n.id for n in nodes(statements) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Load)}
        pruner = _Pruner(read)
        statements = [rest for s in statements if (rest := pruner.visit(s)) is not None]
        if not pruner.dropped:
            return statements


class _Pruner(ast.NodeTransformer):
    def __init__(self, read: set[str]) -> None:
        self.read, self.dropped = read, False

    def visit_Assign(self, node: ast.Assign) -> ast.stmt | None:
        target = node.targets[0]
        names = [target] if isinstance(target, ast.Name) else target.elts if isinstance(target, ast.Tuple) else []
        unread = names and all(isinstance(n, ast.Name) and n.id not in self.read for n in names)
        if unread and not calls(node.value):
            self.dropped = True
            return None
        return node

    def visit_If(self, node: ast.If) -> ast.stmt | None:
        self.generic_visit(node)
        if node.body or node.orelse or calls(node.test):
            node.body = node.body or [ast.Pass()]
            return node
        self.dropped = True
        return None

    def visit_For(self, node: ast.For) -> ast.stmt | None:
        self.generic_visit(node)
        self.dropped = self.dropped or not node.body
        return node if node.body else None

    def visit_While(self, node: ast.While) -> ast.stmt:
        self.generic_visit(node)
        node.body = node.body or [ast.Pass()]
        return node
