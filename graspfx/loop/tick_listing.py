"""Listing of the kernels that run in the ticks of one scene, and of the skipped calls with the reasons.

The listing is obtained by observation: ticks run interpreted, and every call of a kernel is recorded. Calls that did
not occur are found in the source of `graspfx.loop.step`. The reason given for a skipped call is the first of the
enclosing conditions that no record of the scene's `World` satisfies.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import numpy as np
from numpy.typing import NDArray

import graspfx
from graspfx.compile.definitions import definition
from graspfx.compile.kernel import source_function, written
from graspfx.compile.kernel_marks import LOWERED
from graspfx.compile.records import Many
from graspfx.coupling.grasp_state import GraspState
from graspfx.loop import step
from graspfx.loop.arena import Arena
from graspfx.loop.engine import Interpreted
from graspfx.loop.servo import Servo

FloatArray = NDArray[np.float64]

TICKS = 200  # number of ticks observed
WIDTH = 52  # width of the names
BETWEEN = "kernels.py", "engine.py", "lowering.py", "kernel_checks.py"  # files whose functions only forward a call
LOWERED_FILE = ", lowered>"
BY_NUMBER = "invoke", "invoke_at", "invoke_beside", "call"  # callers of a part's kernel
HANDING = "invoke", "invoke_at", "invoke_beside", "run", "checked", "first"


@dataclass(eq=False)
class Call:
    """Calls of one kernel by one caller.

    Attributes:
        name: Name of the kernel.
        code: Code object of the kernel.
        count: Number of calls.
        parts: Names of the scene's parts for which the kernel was called, in the order of the first calls.
        calls: Calls that the kernel made, by the code object of the called kernel, in the order of the first calls.
    """

    name: str
    code: CodeType
    count: int = 0
    parts: dict[str, None] = field(default_factory=dict)
    calls: dict[CodeType, Call] = field(default_factory=dict)

    def walk(self, depth: int = 0) -> Iterator[tuple[int, Call]]:
        """Yield these calls and all calls made within them, each with its depth in the call tree."""
        yield depth, self
        for each in self.calls.values():
            yield from each.walk(depth + 1)


@dataclass(frozen=True)
class Skipped:
    """A call in `graspfx.loop.step` that was made in no observed tick.

    Attributes:
        stage: Name of the function that contains the call.
        name: Name of the kernel that the call names.
        line: Line number of the call.
        why: Condition because of which the scene never makes the call.
    """

    stage: str
    name: str
    line: int
    why: str


@dataclass(frozen=True)
class Used:
    """Kernels that ran in the observed ticks of a scene, and calls that were skipped.

    Attributes:
        ticks: Number of observed ticks.
        root: Calls of `steps`, with all calls made within them.
        skipped: Calls in `graspfx.loop.step` that were made in no observed tick.
    """

    ticks: int
    root: Call
    skipped: tuple[Skipped, ...]

    @property
    def kernels(self) -> frozenset[str]:
        """Names of the kernels that ran and that are not defined in `graspfx.loop.step`."""
        return frozenset(call.name for _, call in self.root.walk() if not _is_stage(call))

    @property
    def stages(self) -> frozenset[str]:
        """Names of the kernels that ran and that are defined in `graspfx.loop.step`."""
        return frozenset(call.name for _, call in self.root.walk() if _is_stage(call))


class _Rows:
    """Buffer for the rows of the observed ticks; the rows are not written to a recording."""

    def __init__(self, ticks: int, width: int) -> None:
        self._rows, self._ticks = np.empty((ticks, width)), 0

    @property
    def row(self) -> FloatArray:
        return np.asarray(self._rows[max(self._ticks, 1) - 1])

    def space(self) -> tuple[FloatArray, int, int]:
        return self._rows, self._ticks, len(self._rows) - self._ticks

    def take(self, count: int) -> None:
        self._ticks += count

    def drain(self) -> None: ...

    def fault(self, k: int, message: str) -> None: ...

    def change(self, k: int, values: Mapping[str, Any]) -> None: ...


def used(servo: Servo, ticks: int = TICKS) -> Used:
    """Run ticks of a new servo interpreted, and return the kernels that ran and the calls that were skipped.

    Hardware is neither read nor written: the positions of its fingers remain the initial positions of the scene.
    """
    arena = servo.arena
    watch = _Watch(arena)
    servo._engine = engine = Interpreted(arena)  # replaces the engine that the scene names
    if servo.hardware:
        engine.write_to(np.empty((ticks, servo.layout.width)))
        with watch:
            for k in range(ticks):
                while not engine.run(k, 1, k):  # one call up to the writing of its devices, and one from there on
                    pass
    else:
        with watch:
            servo.run(ticks, _Rows(ticks, servo.layout.width))
    return Used(ticks, watch.root, tuple(_skipped(arena, watch.root)))


def listing(servo: Servo, ticks: int = TICKS) -> list[str]:
    """List the kernels that ran in the first `ticks` ticks, in order, and the skipped calls with the reasons."""
    found = used(servo, ticks)
    lines = [f"kernels that ran in ticks 0 to {found.ticks - 1}: calls per tick, parts of the scene, source line", ""]
    for depth, call in found.root.walk():
        often = f"{call.count / found.ticks:.4g}"
        name = f"{'  ' * depth}{call.name}"
        lines.append(f"{name:<{WIDTH}} {often:>6}  {_listed(list(call.parts)):<32}  {_place(call.code)}".rstrip())
    lines += ["", "calls in graspfx/loop/step.py that were skipped, and the reasons", ""]
    groups: dict[tuple[str, str], list[str]] = {}
    for each in found.skipped:
        groups.setdefault((each.name, each.why), []).append(f"{each.stage}:{each.line}")
    return lines + [f"{name:<{WIDTH}} {why}; {', '.join(places)}" for (name, why), places in groups.items()]


# What ran -------------------------------------------------------------------------------------------------------------


class _Watch:
    """Record the calls of kernels while a `with` block runs."""

    def __init__(self, arena: Arena) -> None:
        self.root = Call("steps", source_function(step.steps).__code__)
        self._parts = _Places(arena)
        self._calls: dict[FrameType, Call] = {}  # calls of running kernels
        self._stack: list[Any] = []
        self._before: Any = None

    def __enter__(self) -> None:
        self._before = sys.getprofile()
        sys.setprofile(self._see)

    def __exit__(self, *exc: object) -> None:
        sys.setprofile(self._before)

    def _see(self, frame: FrameType, event: str, _: object) -> None:
        if event == "return":
            self._calls.pop(frame, None)
        if event != "call":
            return
        code = frame.f_code
        if code is self.root.code:
            self.root.count += 1
            self._calls[frame] = self.root
            return
        if not self._calls:
            return
        back, handed = frame.f_back, 0
        while back is not None and back not in self._calls and _hands_on(back.f_code):
            back, handed = back.f_back, handed + 1
        caller = None if back is None else self._calls.get(back)
        if caller is None or _hands_on(code) or not _is_kernel(code):
            return
        call = caller.calls.setdefault(code, Call(code.co_name, code))
        call.count += 1
        if (part := self._parts.of(frame)) is not None:
            call.parts[part] = None
        self._calls[frame] = call


def _hands_on(code: CodeType) -> bool:
    """Return whether a function only passes a call from one kernel to another."""
    return code.co_name in HANDING and Path(code.co_filename).name in BETWEEN


def _is_kernel(code: CodeType) -> bool:
    """Return whether a function is a kernel, and not a buffer's method or a function of the compiler."""
    if code.co_filename.endswith(LOWERED_FILE):
        return True
    own = str(Path(graspfx.__path__[0]) / "compile")
    return not code.co_filename.startswith((own, "<")) and Path(code.co_filename).name not in BETWEEN


class _Places:
    """Names of the scene's parts by the range of the arena that each part uses."""

    def __init__(self, arena: Arena) -> None:
        parts, self._ranges = arena.parts, list[tuple[int, int, str]]()
        names = parts.layout.fingers

        def add(array: FloatArray | None, name: str) -> None:
            if array is not None:
                first = arena.place(array)
                self._ranges.append((first, first + array.size, name))

        for part in parts.objects:
            group = GraspState(part.grasped.block).fingers
            start = arena.place(part.grasped.block) + group.offset
            for j, f in enumerate(part.fingers.tolist()):
                first = start + j * group.stride
                self._ranges.append((first, first + group.stride, names[f]))
            add(part.grasped.block, part.name)
        for part, observer in zip(parts.objects, parts.observers, strict=False):
            add(observer.buffer, part.name)
        if parts.safety is not None:
            for part, buffer in zip(parts.objects, parts.safety.buffers, strict=True):
                add(buffer, part.name)
        for station in parts.stations:
            add(_state(station.device), _listed([names[f] for f in station.fingers.tolist() if f >= 0]))
        for m in parts.plants:
            for each in (m.plant, m.hand):
                add(_state(each), _listed([names[f] for f in m.fingers.tolist() if f >= 0]))

    def of(self, frame: FrameType) -> str | None:
        """Return the name of the part on which a kernel operates; None if the kernel's arguments refer to no part.

        If the arguments refer to several parts, the part with the smallest range is returned: a finger of an object
        rather than the object.
        """
        code, values = frame.f_code, frame.f_locals
        arguments = [values[name] for name in code.co_varnames[: code.co_argcount]]
        found = [
            (size, name)
            for buffer, place in pairwise(arguments)
            if not isinstance(buffer, int | float) and isinstance(place, int)
            for first, end, name in self._ranges
            for size in [end - first]
            if first <= place < end
        ]
        return min(found)[1] if found else None


def _state(part: object) -> FloatArray | None:
    state = getattr(part, "state", None)
    return state if isinstance(state, np.ndarray) else None


# What did not run -----------------------------------------------------------------------------------------------------

ONE = "world", "servo"  # records that occur once per scene
STAGES = {
    name: each
    for name, each in vars(step).items()
    if hasattr(each, LOWERED) and written(each).__module__ == step.__name__
}


def _is_stage(call: Call) -> bool:
    """Return whether a kernel is defined in `graspfx.loop.step`; the kernel of a part may have the same name."""
    return call.code.co_filename == f"<{step.__name__}.{call.name}{LOWERED_FILE}"


def _skipped(arena: Arena, root: Call) -> Iterator[Skipped]:
    """Yield the calls that the stages never made, each with the first condition that no record satisfied."""
    ran: dict[str, set[CodeType]] = {}
    for _, call in root.walk():
        if _is_stage(call):
            ran.setdefault(call.name, set()).update(call.calls)
    for name in STAGES:
        if name not in ran:
            continue
        function = written(STAGES[name])
        named = {source_function(each).__code__ for each in vars(step).values() if hasattr(each, LOWERED)}
        for node, guards in _calls(definition(function).body, ()):
            callee = node.func.id if isinstance(node.func, ast.Name) else ""
            kernel = function.__globals__.get(callee)
            if hasattr(kernel, LOWERED) and source_function(kernel).__code__ not in ran[name]:
                yield Skipped(name, kernel.__name__, node.lineno, _reason(arena, guards))
            elif callee in BY_NUMBER and ran[name] <= named:
                yield Skipped(name, ast.unparse(node.args[1]), node.lineno, _reason(arena, guards))


Guard = tuple[ast.expr, bool] | ast.For


def _calls(body: Sequence[ast.stmt], guards: tuple[Guard, ...]) -> Iterator[tuple[ast.Call, tuple[Guard, ...]]]:
    """Yield the calls in some statements, each with the loops and conditions that enclose it."""
    for statement in body:
        if isinstance(statement, ast.If):
            yield from ((c, guards) for c in _within(statement.test))
            yield from _calls(statement.body, (*guards, (statement.test, True)))
            yield from _calls(statement.orelse, (*guards, (statement.test, False)))
        elif isinstance(statement, ast.For):
            yield from _calls(statement.body, (*guards, statement))
        elif isinstance(statement, ast.While):
            yield from _calls(statement.body, guards)
        else:
            yield from ((c, guards) for c in _within(statement))


def _within(node: ast.AST) -> Iterator[ast.Call]:
    return (each for each in ast.walk(node) if isinstance(each, ast.Call))


def _reason(arena: Arena, guards: Sequence[Guard]) -> str:
    """Return a description of the first enclosing loop without records, or condition that no record satisfies."""
    scopes: list[dict[str, Any]] = [{"world": arena.world, "servo": arena.servo}]
    for guard in guards:
        if isinstance(guard, ast.For):
            scopes = [scope | bound for scope in scopes for bound in _bound(guard, scope)]
            if not scopes:
                return f"no {_table(guard)}"
            continue
        test, wanted = guard
        for part in test.values if isinstance(test, ast.BoolOp) and isinstance(test.op, ast.And) and wanted else [test]:
            met = [scope for scope in scopes if _holds(part, scope) in (wanted, None)]
            if not met:
                return _words(part, wanted)
            scopes = met
    last = next((guard for guard in reversed(guards) if not isinstance(guard, ast.For)), None)
    return "no observed tick reached the call" if last is None else _words(*last)


def _bound(loop: ast.For, scope: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield one binding of the loop variable per record; for a loop over anything else, yield one empty binding."""
    source, target = loop.iter, loop.target
    if isinstance(source, ast.Call) and isinstance(source.func, ast.Name) and source.func.id == "enumerate":
        source = source.args[0]
        assert isinstance(target, ast.Tuple)
        target = target.elts[1]
    records = _value(source, scope)
    if not isinstance(records, Many) or not isinstance(target, ast.Name):
        yield {}
        return
    yield from ({target.id: each} for each in records)


def _table(loop: ast.For) -> str:
    text = ast.unparse(loop.iter)
    return text.removeprefix("enumerate(").removesuffix(")").rpartition(".")[2]


def _value(node: ast.expr, scope: dict[str, Any]) -> Any:
    """Evaluate an expression on the records of the world; return None if its value depends on the tick."""
    try:
        return eval(compile(ast.Expression(node), "<condition>", "eval"), vars(step) | scope)
    except (NameError, TypeError, AttributeError, ValueError):
        return None


def _holds(test: ast.expr, scope: dict[str, Any]) -> bool | None:
    names = {node.id for node in ast.walk(test) if isinstance(node, ast.Name)}
    if "servo" in names:  # faults change during a run
        return None
    value = _value(test, scope)
    return None if value is None else bool(value)


def _words(test: ast.expr, wanted: bool) -> str:
    """Return a description of why no record of the world gives a condition the value `wanted`."""
    match test:
        case ast.UnaryOp(ast.Not(), operand):
            return _words(operand, not wanted)
        case ast.Compare(ast.Attribute(ast.Name(owner), name), [ast.NotEq()], [ast.Name("NONE")]):
            if owner in ONE:
                return f"the {owner} has {'no' if wanted else 'a'} {name}"
            return f"no {owner} has a {name}" if wanted else f"every {owner} has a {name}"
        case ast.Attribute(ast.Name(owner), name):
            if owner in ONE:
                return f"the {owner} is {'not ' if wanted else ''}{name}"
            return f"no {owner} is {name}" if wanted else f"every {owner} is {name}"
        case _:
            return f"{ast.unparse(test)}: {'never' if wanted else 'always'}"


# Lines ----------------------------------------------------------------------------------------------------------------


def _listed(names: Sequence[str]) -> str:
    """Join names by commas; from five names on, return the first name, the last name and the number of names."""
    return ", ".join(names) if len(names) < 5 else f"{names[0]}, ..., {names[-1]} ({len(names)})"


def _place(code: CodeType) -> str:
    """Return the file, relative to the package's parent folder, and the first line of a function."""
    file, line = code.co_filename, code.co_firstlineno
    if file.endswith(LOWERED_FILE):
        module, _, name = file[1:].removesuffix(LOWERED_FILE).rpartition(".")
        function: Any = getattr(sys.modules.get(module), name, None)
        code = getattr(written(function), "__code__", code)
        file, line = code.co_filename, code.co_firstlineno
    for root in graspfx.__path__:
        folder = Path(root).parent if Path(root).name == "graspfx" else Path(root)
        if Path(file).is_relative_to(folder):
            return f"{Path(file).relative_to(folder).as_posix()}:{line}"
    return f"{file}:{line}"
