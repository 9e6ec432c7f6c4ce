"""Programs: Python text of a function and of all kernels that it calls, in which every name is resolved.

Lowered kernels consist of numbers, entries of buffers, `if`, `while`, `for ... in range(...)`, calls of other kernels,
of functions of `math` and of a few builtins, and tuples that are returned or unpacked. A program performs the same
operations in the same order as its kernels, so that the results are identical.
"""

from __future__ import annotations

import ast
import builtins
import copy
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from inspect import signature
from types import FunctionType, ModuleType
from typing import Any

from graspfx import log
from graspfx.compile.definitions import definition
from graspfx.compile.kernel import keep_lowerings, source_function
from graspfx.compile.kernel_marks import BOUND_LATE
from graspfx.compile.llvm.llvm import is_indexed
from graspfx.compile.own_sources import identity, recall, remember, request_key
from graspfx.compile.syntax import assigned, constant, leaves, nodes
from graspfx.errors import GraspFXError, InputError, KernelError

STATEMENTS = (
    ast.Assign, ast.AnnAssign, ast.AugAssign, ast.If, ast.For, ast.While, ast.Return, ast.Expr,
    ast.Break, ast.Continue, ast.Pass,
)  # fmt: skip
EXPRESSIONS = (
    ast.Constant, ast.Name, ast.Attribute, ast.Subscript, ast.Call, ast.Tuple, ast.BinOp, ast.UnaryOp, ast.BoolOp,
    ast.Compare, ast.IfExp,
)  # fmt: skip
OPERATORS = (
    ast.Add, ast.Sub, ast.Mult, ast.Div, ast.FloorDiv, ast.Mod, ast.Pow, ast.USub, ast.UAdd, ast.Not,
    ast.And, ast.Or, ast.Eq, ast.NotEq, ast.Lt, ast.LtE, ast.Gt, ast.GtE,
)  # fmt: skip
BUILTINS = (abs, min, max, int, float, bool)
BEFORE = "is a negative index; the last entry of a group is [count - 1]"


@dataclass
class Program:
    """Functions of a program.

    Attributes:
        functions: Syntax trees of the functions. Each function follows the functions that it calls.
        files: Source files of the kernels.
        numbers_of_modules: Numbers of modules that the functions use, as text, by module and name.
    """

    functions: list[ast.FunctionDef] = field(default_factory=list)
    files: set[str] = field(default_factory=set)
    numbers_of_modules: dict[tuple[str, str], str] = field(default_factory=dict)
    _names: dict[FunctionType, str] = field(default_factory=dict)  # empty while a function is being added

    def add(self, kernel: Callable[..., Any]) -> str:
        """Add a kernel and the kernels that it calls, and return the name of the kernel in the program."""
        function = source_function(kernel)
        code = function.__code__
        if function not in self._names:
            name, self._names[function] = f"{function.__name__}_{len(self._names)}", ""
            self.files.update(getattr(function, "__source_files__", (code.co_filename,)))
            original = getattr(function, "__written__", None)
            self._add(definition(function), function.__globals__, name, code.co_filename, original)
            self._names[function] = name
        if not self._names[function]:
            place = f"{code.co_filename}:{code.co_firstlineno}"
            raise InputError(place, function.__qualname__, "a kernel without recursion")
        return self._names[function]

    def add_text(self, text: str, namespace: Mapping[str, Any], arrays: Sequence[str] = ()) -> None:
        """Add a function and the kernels that it calls; the arguments are those of `program_source`."""
        [tree] = ast.parse(text).body
        assert isinstance(tree, ast.FunctionDef)
        tree.args.args[:0] = map(ast.arg, arrays)
        self._add(tree, namespace, tree.name, f"<{tree.name}>", None)
        entry, functions = self.functions[-1], {each.name: each for each in self.functions}
        for name in arrays:
            if not is_indexed(entry, name, functions):
                entry.args.args = [each for each in entry.args.args if each.arg != name]
                entry.body.insert(0, ast.Assign([ast.Name(name, ast.Store())], ast.Constant(0)))

    def _add(
        self, tree: ast.FunctionDef, namespace: Mapping[str, Any], name: str, file: str, original: FunctionType | None
    ) -> None:
        function = Function(self, tree, namespace, file, original)
        body = [line for statement in tree.body for line in function.lines(copy.deepcopy(statement))]
        parameters = [ast.arg(a.arg) for a in tree.args.args]
        arguments = ast.arguments(posonlyargs=[], args=parameters, kwonlyargs=[], kw_defaults=[], defaults=[])
        self.functions.append(
            ast.FunctionDef(
                name=name, args=arguments, body=body or [ast.Pass()], decorator_list=[], lineno=0, type_params=[]
            )
        )

    def source(self) -> str:
        """Return the text of the program in Python."""
        lines = ["import math", "", "inf, nan = math.inf, math.nan", ""]
        return "\n".join([*lines, *(ast.unparse(ast.fix_missing_locations(node)) + "\n" for node in self.functions)])


class Function(ast.NodeTransformer):
    """Resolves the names in one function.

    Args:
        program: Program to which kernels that the function calls are added.
        tree: Syntax tree of the function, which is not changed.
        namespace: Objects to which names refer that are neither parameters nor assigned in the function.
        file: Path of the function's source file, for error messages.
        original: Original function of the kernel if `tree` is a lowered kernel; otherwise None.
    """

    def __init__(
        self,
        program: Program,
        tree: ast.FunctionDef,
        namespace: Mapping[str, Any],
        file: str,
        original: FunctionType | None,
    ) -> None:
        self._program, self._tree, self._namespace = program, tree, namespace
        self._file, self._original = file, original
        self._parameters = {a.arg for a in tree.args.args}
        self._own = self._parameters | assigned(tree.body)

    def lines(self, statement: ast.stmt) -> list[ast.stmt]:
        """Return the statements that replace a statement, with resolved names; there may be none or several."""
        result = self.visit(statement)
        return result if isinstance(result, list) else [] if result is None else [result]

    def visit(self, node: ast.AST) -> Any:
        if isinstance(node, ast.stmt) and not isinstance(node, STATEMENTS):
            raise self.cannot(node, "is not a statement supported in kernels")
        if isinstance(node, ast.expr) and not isinstance(node, EXPRESSIONS):
            raise self.cannot(node, "is not an expression supported in kernels")
        for operator in [getattr(node, "op", None), *getattr(node, "ops", ())]:
            if operator is not None and not isinstance(operator, OPERATORS):
                raise self.cannot(node, "is not an expression supported in kernels")
        return super().visit(node)

    def cannot(self, node: ast.AST, why: str, kind: type[InputError] = InputError) -> GraspFXError:
        line, file = getattr(node, "lineno", self._tree.lineno), self._file
        text = ast.unparse(node).splitlines()[0] if isinstance(node, ast.expr | ast.stmt) else self._tree.name
        if self._original is not None:
            from graspfx.compile.lower.lowering import written_lines

            file, line = self._original.__code__.co_filename, written_lines(self._original)[line - 1]
        return kind(f"{file}:{line}", text, "a construct supported in kernels", f"it {why}")

    # Names -----------------------------------------------------------------------------------------------------------

    def meaning(self, node: ast.expr) -> Any:
        """Return the object to which a global name, or an attribute of a module, refers.

        The result is None for a variable or any other expression.
        """
        if isinstance(node, ast.Name) and node.id not in self._own:
            missing = object()
            item = self._namespace.get(node.id, getattr(builtins, node.id, missing))
            if item is missing:
                raise self.cannot(node, f"uses {node.id!r}, which is undefined")
            self._note(self._namespace.get("__name__"), node.id, item)
            return item
        if isinstance(node, ast.Attribute):
            owner = self.meaning(node.value)
            if isinstance(owner, ModuleType):
                self._note(owner.__name__, node.attr, item := getattr(owner, node.attr))
                return item
            raise self.cannot(node, "is not an attribute of a module")
        return None

    def _note(self, module: Any, name: str, item: Any) -> None:
        if isinstance(item, bool | int | float) and isinstance(module, str):
            self._program.numbers_of_modules[module, name] = repr(item)

    def visit_Name(self, node: ast.Name) -> ast.expr:
        if node.id in self._own:
            return node
        return self._number(node)

    def visit_Attribute(self, node: ast.Attribute) -> ast.expr:
        return self._number(node)

    def _number(self, node: ast.expr) -> ast.expr:
        item = self.meaning(node)
        if isinstance(item, bool | int | float):
            return ast.copy_location(constant(item), node)
        raise self.cannot(node, f"is {item!r}, which a kernel cannot use")

    def visit_Constant(self, node: ast.Constant) -> ast.expr:
        if isinstance(node.value, bool | int | float):
            return node
        raise self.cannot(node, "is not an expression supported in kernels")

    def visit_Subscript(self, node: ast.Subscript) -> ast.expr:
        self.generic_visit(node)
        index = node.slice
        negative = isinstance(index, ast.UnaryOp) and isinstance(index.op, ast.USub)
        if negative and isinstance(node.value, ast.Name) and isinstance(index.operand, ast.Constant):  # type: ignore[attr-defined]
            raise self.cannot(node, BEFORE, KernelError)
        return node

    def visit_Call(self, node: ast.Call) -> ast.expr:
        called: Any = self.meaning(node.func)
        if isinstance(called, FunctionType):
            if hasattr(called, BOUND_LATE):  # defined by the program itself
                return self._call(node, called.__name__)
            name = self._program.add(called)
            return self._call(node, name, self._arguments(node, source_function(called)))
        known = getattr(called, "__name__", "")
        if called in BUILTINS:
            return self._call(node, known)
        if called is not None and getattr(math, known, None) is called:
            return self._call(node, f"math.{known}")
        if called is None or isinstance(called, ModuleType):
            raise self.cannot(node, "does not call a function")
        raise self.cannot(node, f"calls {called!r}, which kernels do not support")

    def _call(self, node: ast.Call, name: str, arguments: Sequence[ast.expr] | None = None) -> ast.expr:
        if arguments is None:
            arguments = node.args
            if node.keywords:
                raise self.cannot(node, "has a keyword argument")
        function = ast.parse(name, mode="eval").body
        return ast.copy_location(ast.Call(function, [self.visit(argument) for argument in arguments], []), node)

    def _arguments(self, node: ast.Call, function: FunctionType) -> list[ast.expr]:
        """Return the arguments of a call in the order of the function's parameters, with default values."""
        parameters = signature(function).parameters.values()
        keywords = {k.arg: k.value for k in node.keywords}
        arguments: list[ast.expr] = list(node.args)
        for parameter in [*parameters][len(arguments) :]:
            if parameter.name in keywords:
                arguments.append(keywords.pop(parameter.name))
            elif isinstance(parameter.default, bool | int | float):
                arguments.append(constant(parameter.default))
        if len(arguments) != len(parameters) or keywords:
            given = len(node.args) + len(node.keywords)
            raise self.cannot(node, f"passes {given} arguments to a function with {len(parameters)} parameters")
        return arguments

    # Statements ------------------------------------------------------------------------------------------------------

    def visit_Expr(self, node: ast.Expr) -> ast.stmt | None:
        if isinstance(node.value, ast.Constant):
            return None  # a docstring
        if not isinstance(node.value, ast.Call):
            raise self.cannot(node.value, "does nothing")
        node.value = self.visit(node.value)
        return node

    def visit_Assign(self, node: ast.Assign) -> ast.stmt | list[ast.stmt]:
        first, value = node.targets[0], node.value
        if isinstance(first, ast.Tuple) and isinstance(value, ast.IfExp):  # a conditional tuple becomes a branch
            one = ast.copy_location(ast.Assign(node.targets, value.body), node)
            other = ast.copy_location(ast.Assign(copy.deepcopy(node.targets), value.orelse), node)
            return self.lines(ast.copy_location(ast.If(value.test, [one], [other]), node))
        return self._assigned(node)

    def _assigned(self, node: ast.Assign) -> ast.stmt:
        self.generic_visit(node)
        return node

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.stmt | None:
        if node.value is None:
            return None
        return self._assigned(ast.copy_location(ast.Assign([node.target], node.value), node))

    def visit_If(self, node: ast.If) -> ast.stmt:
        return self._block(node)

    def visit_While(self, node: ast.While) -> ast.stmt:
        if node.orelse:
            raise self.cannot(node, "has an else after its loop")
        return self._block(node)

    def visit_For(self, node: ast.For) -> ast.stmt | list[ast.stmt]:
        turns = node.iter
        if isinstance(turns, ast.Tuple) and not node.orelse and not leaves(node.body):
            parts = [*nodes([turns])]
            changed = assigned(node.body) & {part.id for part in parts if isinstance(part, ast.Name)}
            if not changed and not any(isinstance(part, ast.Subscript | ast.Call) for part in parts):
                out: list[ast.stmt] = []  # the tuple cannot change during the loop, which is written out
                for part in turns.elts:
                    out += self.lines(ast.copy_location(ast.Assign([copy.deepcopy(node.target)], part), node))
                    out += [line for statement in node.body for line in self.lines(copy.deepcopy(statement))]
                return out
        ranged = isinstance(turns, ast.Call) and isinstance(turns.func, ast.Name) and turns.func.id == "range"
        if not isinstance(node.target, ast.Name) or node.orelse or not ranged:
            raise self.cannot(node, "does not loop over a range or a constant tuple")
        assert isinstance(turns, ast.Call)
        turns.args = [self.visit(argument) for argument in turns.args]
        node.body = [line for statement in node.body for line in self.lines(statement)] or [ast.Pass()]
        return node

    def _block(self, node: ast.If | ast.While) -> ast.stmt:
        self.generic_visit(node)
        node.body = node.body or [ast.Pass()]
        return node


def program_source(
    text: str, kernels: Mapping[str, Callable[..., Any]], arrays: Sequence[str], *, make: bool = True
) -> str:
    """Return the text of a program that consists of a function and of the kernels that it calls.

    The text is stored in the disk cache and used again as long as the sources are unchanged.

    Args:
        text: Text that defines the function. Its parameters are numbers.
        kernels: Kernels by the names in the text.
        arrays: Names of buffers in the text. The buffers that are used become the function's first parameters.
        make: Whether a program that is not in the cache is written. If False, a LookupError is raised instead.
    """
    roots = {name: identity(kernel) for name, kernel in sorted(kernels.items())}
    request = json.dumps([text, roots, list(arrays)])
    key = request_key((kernel.__module__ for kernel in kernels.values()), "program", request)
    known = recall(key)
    if known is not None:
        log.debug("program %s: text from the cache", key[:12])
        return known
    if not make:
        raise LookupError("not written yet")
    program = Program()
    program.add_text(text, kernels, arrays)
    source = program.source()
    log.debug("program %s: written, %d lines", key[:12], source.count("\n"))
    keep_lowerings()
    remember(key, program.files, program.numbers_of_modules, source)
    return source
