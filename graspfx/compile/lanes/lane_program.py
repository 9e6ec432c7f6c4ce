"""A program as text for LLVM that runs for many lanes side by side, each with buffers of its own."""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping, Sequence

from graspfx.compile.lanes.lane_code import by_lane, lane_declarations
from graspfx.compile.lanes.lane_expressions import LaneFunction
from graspfx.compile.lanes.lane_loops import LaneLoops
from graspfx.compile.lanes.lane_shapes import Shape
from graspfx.compile.llvm.entry import entry_of
from graspfx.compile.llvm.llvm import INTRINSICS, LlvmProgram, declared
from graspfx.compile.llvm.llvm_arithmetic import INT, Number
from graspfx.compile.llvm.llvm_expressions import Array, Value
from graspfx.compile.llvm.method import ENTRY
from graspfx.errors import GraspFXError, InputError


class _Module:
    """The functions of a program, written as they are called."""

    checked = False

    def __init__(self, trees: Sequence[ast.FunctionDef], lanes: int, shared: Mapping[str, tuple[int, int]]) -> None:
        self.trees = {tree.name: tree for tree in trees}
        self.lanes, self.shared = lanes, dict(shared)
        self.functions: dict[object, LaneFunction | None] = {}
        self.texts: list[str] = []
        self.notes: list[str] = []
        self.libm: set[str] = set()

    def has(self, name: str) -> bool:
        return name in self.trees

    def lane_function_for(
        self,
        name: str,
        arguments: Sequence[Value],
        shapes: Sequence[Shape | None],
        *,
        masked: bool,
        why: Callable[[str], GraspFXError],
    ) -> LaneFunction:
        roots = [a.root for a in arguments if isinstance(a, Array)]
        arrays = tuple((roots.index(root), self.shared.get(root)) for root in roots)
        key = name, arrays, tuple(shapes), masked
        if key not in self.functions:
            tree = self.trees[name]
            if len(tree.args.args) != len(arguments):
                raise why(f"{name} takes {len(tree.args.args)} arguments")
            self.functions[key] = None
            body = LaneLoops(self, tree)
            function, text = body.function_text(f"{name}.{len(self.functions)}", arguments, shapes, masked=masked)
            self.functions[key] = function
            self.texts.append(text)
            self.libm |= body.code.used
        function_ = self.functions[key]
        if function_ is None:
            raise why("calls itself")
        return function_


def lane_program(source: str, lanes: int, shared: Mapping[str, tuple[int, int]] | None = None) -> LlvmProgram:
    """Write a program for several lanes in LLVM's language, its last function the entry, which returns nothing.

    Each lane has buffers of its own, entry by entry side by side: entry k of lane l is at k * lanes + l. Numbers among
    the entry's parameters are the same for all lanes.

    Args:
        source: the program as Python, such as `Program.source()` gives it.
        lanes: side by side.
        shared: by buffer, the first and the end of entries that are the same in all lanes, to which nothing is stored:
            they stand once, in a buffer of their own behind all others.

    Raises:
        InputError: the program holds something that cannot be compiled; it names the function and the line.
    """
    entry = entry_of(source)
    tree, names, arrays = entry.tree, list(entry.names), entry.arrays
    common = {name: first for name, first in (shared or {}).items() if name in arrays}
    numbers = tuple(INT for _ in entry.numbers)
    module = _Module(entry.trees, lanes, common)
    values: list[Array | Number] = [Array(name, f"%p{k}") for k, name in enumerate(arrays)]
    values += [Number(type_, f"%p{k}") for k, type_ in enumerate(numbers, start=len(arrays))]

    def why(text: str) -> GraspFXError:
        return InputError(tree.name, names, "a program that can be compiled", text)

    shapes = [None if isinstance(value, Array) else Shape(False, ((value.type, False),)) for value in values]
    function = module.lane_function_for(tree.name, values, shapes, masked=False, why=why)
    if function.result is not None:
        raise why("a program for lanes returns nothing")
    texts = [
        INTRINSICS,
        lane_declarations(lanes),
        *map(declared, sorted(module.libm)),
        *(by_lane(name, lanes) for name in sorted(module.libm)),
        *module.texts,
        _entry(function, values, common),
    ]
    behind = tuple(f"{name}.shared" for name in arrays if name in common)
    return LlvmProgram("\n".join(texts) + "\n", (*arrays, *behind), numbers, False, tuple(sorted(module.libm)))


def _entry(function: LaneFunction, values: Sequence[Array | Number], shared: Mapping[str, tuple[int, int]]) -> str:
    arrays = [a for a in values if isinstance(a, Array)]
    numbers = [a for a in values if isinstance(a, Number)]
    parameters = [f"ptr noalias {a.text}" for a in arrays]
    parameters += [f"ptr noalias {a.text}.s" for a in arrays if a.root in shared]
    parameters += [f"{n.type} {n.text}" for n in numbers]
    operands = []
    for a in arrays:
        operands += [f"ptr {a.text}", *([f"ptr {a.text}.s"] if a.root in shared else [])]
    operands += [f"{n.type} {n.text}" for n in numbers]
    body = [f'  call void @"{function.name}"({", ".join(operands)})', "  ret i64 0"]
    return "\n".join([f"define i64 @{ENTRY}({', '.join(parameters)}) nounwind {{", *body, "}"])
