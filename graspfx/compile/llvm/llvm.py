"""Translation of a program to LLVM text. Each function is written once for each combination of argument types."""

from __future__ import annotations

import ast
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from graspfx.compile.llvm.late import DECLARATIONS, LATE
from graspfx.compile.llvm.llvm_arithmetic import BINARY_LIBM, FLOAT, INT, LlvmFunction, Number
from graspfx.compile.llvm.llvm_expressions import Array, Value, result_type
from graspfx.compile.llvm.llvm_statements import Statements, type_of
from graspfx.compile.llvm.method import ENTRY
from graspfx.errors import GraspFXError, InputError

INTRINSICS = "".join(
    f"declare double @llvm.{name}.f64(double{', double' if name == 'copysign' else ''})\n"
    for name in ("fabs", "copysign", "sqrt", "floor", "ceil", "trunc")
)


class LlvmProgram(NamedTuple):
    """Program as LLVM text.

    Args:
        text: LLVM text.
        arrays: Names of the entry's first parameters, which are buffers of floats.
        numbers: Types of the entry's other parameters, INT or FLOAT.
        libm: Names of the functions of the C library that the program calls. It calls the function NAME as
            `graspfx_NAME`.
    """

    text: str
    arrays: tuple[str, ...]
    numbers: tuple[str, ...]
    libm: tuple[str, ...]


class Module:
    """Functions of a program. A function is translated when the text of its first call is written."""

    def __init__(self, trees: Sequence[ast.FunctionDef]) -> None:
        self.trees = {tree.name: tree for tree in trees}
        self.functions: dict[object, LlvmFunction | None] = {}
        self.texts: list[str] = []
        self.libm: set[str] = set()

    def has(self, name: str) -> bool:
        return name in self.trees or name in LATE

    def function_for(self, name: str, arguments: Sequence[Value], why: Callable[[str], GraspFXError]) -> LlvmFunction:
        if name in LATE and name not in self.trees:
            if name not in self.functions:
                self.texts.append(LATE[name].text)
                self.libm.update(LATE[name].library)
            late = self.functions[name] = LlvmFunction(name, LATE[name].result)
            return late
        roots = [a.root for a in arguments if isinstance(a, Array)]
        arrays = tuple(map(roots.index, roots))  # which buffers are identical
        key = name, arrays, tuple(None if isinstance(a, Array) else type_of(a) for a in arguments)
        if key not in self.functions:
            tree = self.trees[name]
            if len(tree.args.args) != len(arguments):
                raise why(f"passes {len(arguments)} arguments to {name}, which takes {len(tree.args.args)}")
            self.functions[key] = None
            body = Statements(self, tree)
            self.functions[key], text = body.function_text(f"{name}.{len(self.functions)}", arguments)
            self.texts.append(text)
            self.libm |= body.code.used
        function = self.functions[key]
        if function is None:
            raise why("calls itself")
        return function


def llvm_program(
    source: str,
    floats: Collection[str] = (),
    *,
    apart: bool = True,
) -> LlvmProgram:
    """Translate a program to LLVM text. The last function is the entry and is named `graspfx_entry`.

    Args:
        source: Text of the program in Python, for example from `Program.source()`.
        floats: Names of the entry's parameters that are floats. Parameters that are indexed are buffers, and all others
            are integers.
        apart: Whether no two buffers overlap in memory.

    Raises:
        InputError: If the program contains a construct that cannot be compiled, or the entry does not return an integer
            or nothing.
    """
    entry = entry_of(source)
    tree, names, arrays = entry.tree, list(entry.names), entry.arrays
    unknown = set(floats) - set(entry.numbers)
    if unknown:
        raise InputError("floats", sorted(unknown), f"numbers among the parameters of {tree.name}")
    numbers = tuple(FLOAT if name in floats else INT for name in entry.numbers)

    module = Module(entry.trees)
    parameters: list[Array | Number] = [Array(name if apart else "any", f"%p{k}") for k, name in enumerate(arrays)]
    parameters += [Number(type_, f"%p{k}") for k, type_ in enumerate(numbers, start=len(arrays))]

    def why(text: str) -> GraspFXError:
        return InputError(tree.name, names, "a program that can be compiled", text)

    function = module.function_for(tree.name, parameters, why)
    texts = [
        INTRINSICS,
        *map(declared, sorted(module.libm)),
        *module.texts,
        _entry(function, parameters, "noalias " if apart else ""),
    ]
    libm = tuple(sorted(module.libm))
    return LlvmProgram("\n".join(texts) + "\n", arrays, numbers, libm)


def function_text(source: str, symbol: str, types: Sequence[str]) -> LlvmProgram:
    """Translate the last function of a program, and the functions that it calls, to be called by other machine code.

    Args:
        source: Text of the program in Python.
        symbol: Name by which other machine code calls the function.
        types: LLVM types of the arguments, `ptr` for a buffer. Buffers may overlap in memory.
    """
    trees = [node for node in ast.parse(source).body if isinstance(node, ast.FunctionDef)]
    module, name = Module(trees), trees[-1].name

    def why(text: str) -> GraspFXError:
        return InputError(name, types, "a kernel that can be compiled", text)

    values = [Array("any", f"%p{k}") if type_ == "ptr" else Number(type_, f"%p{k}") for k, type_ in enumerate(types)]
    function = module.function_for(name, values, why)
    result = result_type(function.result)
    parameters = ", ".join(f"{type_} %p{k}" for k, type_ in enumerate(types))
    call = f'call {result} @"{function.name}"({parameters})'
    body = [f"  {call}", "  ret void"] if function.result is None else [f"  %r = {call}", f"  ret {result} %r"]
    head = f'define {result} @"{symbol}"({parameters}) nounwind {{'
    texts = [INTRINSICS, *map(declared, sorted(module.libm)), *module.texts, head, *body, "}"]
    return LlvmProgram("\n".join(texts) + "\n", (), (), tuple(sorted(module.libm)))


def declared(name: str) -> str:
    if name in DECLARATIONS:
        return DECLARATIONS[name]
    arguments = {"ldexp": "double, i32", **dict.fromkeys(BINARY_LIBM, "double, double")}.get(name, "double")
    return f"declare double @graspfx_{name}({arguments}) nounwind willreturn nofree nosync memory(none)"


def _entry(function: LlvmFunction, values: Sequence[Array | Number], alone: str) -> str:
    parameters = ", ".join(f"ptr {alone}{a.text}" if isinstance(a, Array) else f"{a.type} {a.text}" for a in values)
    arguments = ", ".join(f"ptr {a.text}" if isinstance(a, Array) else f"{a.type} {a.text}" for a in values)
    call = f'call {result_type(function.result)} @"{function.name}"({arguments})'
    match function.result:
        case None:
            body = [f"  {call}", "  ret i64 0"]
        case "i64":
            body = [f"  %result = {call}", "  ret i64 %result"]
        case "i1":
            body = [f"  %result = {call}", "  %whole = zext i1 %result to i64", "  ret i64 %whole"]
        case _:
            raise InputError(function.name, function.result, "an entry that returns an integer or nothing")
    return "\n".join([f"define i64 @{ENTRY}({parameters}) nounwind {{", *body, "}"])


@dataclass(frozen=True)
class Entry:
    """Parsed program with its entry.

    Attributes:
        trees: Syntax trees of all functions.
        tree: Syntax tree of the entry.
        names: Names of the parameters of the entry.
        arrays: Names of the parameters that are buffers, which are the first ones.
    """

    trees: tuple[ast.FunctionDef, ...]
    tree: ast.FunctionDef
    names: tuple[str, ...]
    arrays: tuple[str, ...]

    @property
    def numbers(self) -> tuple[str, ...]:
        """Names of the parameters that are numbers."""
        return self.names[len(self.arrays) :]


def entry_of(source: str) -> Entry:
    """Parse a program, whose last function is the entry.

    Raises:
        InputError: If the program has no function, or a number precedes a buffer in the entry's parameters.
    """
    trees = tuple(node for node in ast.parse(source).body if isinstance(node, ast.FunctionDef))
    if not trees:
        raise InputError("source", source, "at least one function")
    tree, functions = trees[-1], {t.name: t for t in trees}
    names = tuple(a.arg for a in tree.args.args)
    arrays = tuple(name for name in names if is_indexed(tree, name, functions))
    if arrays != names[: len(arrays)]:
        raise InputError(f"{tree.name}", list(names), "buffers first, then numbers")
    return Entry(trees, tree, names, arrays)


def is_indexed(tree: ast.FunctionDef, name: str, functions: Mapping[str, ast.FunctionDef]) -> bool:
    """Return whether a parameter of a function is indexed, in the function or in functions to which it is passed."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Subscript) and isinstance(node.value, ast.Name) and node.value.id == name:
            return True
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in functions:
            called = functions[node.func.id]
            for argument, parameter in zip(node.args, called.args.args, strict=False):
                passed = isinstance(argument, ast.Name) and argument.id == name and called is not tree
                if passed and is_indexed(called, parameter.arg, functions):
                    return True
    return False
