"""Statements for lanes: where lanes part both sides run, each under its mask, and what is read behind is blended."""

from __future__ import annotations

import ast
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field

from graspfx.compile.lanes.lane_expressions import LaneFunction, LaneFunctions, reaches_out
from graspfx.compile.lanes.lane_joins import Edge, LaneJoins
from graspfx.compile.lanes.lane_liveness import Liveness
from graspfx.compile.lanes.lane_shapes import Names, Scope, Shape
from graspfx.compile.llvm.llvm_arithmetic import BOOL, Number, binary, truth
from graspfx.compile.llvm.llvm_expressions import Array, Tuple, Value
from graspfx.compile.specialise.syntax import size

RETURNED = "return"  # stands for what was returned among the variables: no name of Python's
SHORT = 4  # statements that are run for nobody rather than jumped over


@dataclass(eq=False)
class Level:
    """A function, or a loop inside, that lanes may leave one by one.

    Attributes:
        number: tells it from others.
        mask: the lanes with which its turn began.
        needs: names that lanes which left still need.
        masked: whether lanes may leave it one by one.
        after: jumps out of it that all its lanes take together; to its next turn, `again`.
        departures: how often lanes have left it one by one.
    """

    number: int
    mask: Number | None
    needs: Names
    masked: bool
    after: list[Edge] = field(default_factory=list)
    again: list[Edge] = field(default_factory=list)
    departures: int = 0

    @property
    def here(self) -> str:
        """Name the mask of the lanes that have not left this turn."""
        return f"#here{self.number}"

    @property
    def going(self) -> str:
        """Name the mask of those that turn again."""
        return f"#going{self.number}"


class PartingError(Exception):
    """Lanes leave loops one by one that were written for all together."""

    def __init__(self, levels: Sequence[Level]) -> None:
        super().__init__()
        self.levels = levels


class LaneStatements(LaneJoins, ABC):
    """One function for some shapes of its arguments."""

    def __init__(self, functions: LaneFunctions, node: ast.FunctionDef) -> None:
        super().__init__(functions, node)
        self.liveness = Liveness(node)
        self.levels: list[Level] = []

    def function_text(
        self, name: str, arguments: Sequence[Value], shapes: Sequence[Shape | None], *, masked: bool
    ) -> tuple[LaneFunction, str]:
        """Write the function; return its name with the shape of its result, and its text."""
        code, scope = self.code, Scope()
        parameters = []
        roots = [a.root for a in arguments if isinstance(a, Array)]
        for k, (parameter, argument, shape) in enumerate(zip(self.tree.args.args, arguments, shapes, strict=True)):
            if isinstance(argument, Array):
                alone = "noalias " if roots.count(argument.root) == 1 else ""
                parameters.append(f"ptr {alone}%p{k}")
                if argument.root in self.all_functions.shared:
                    parameters.append(f"ptr %p{k}.s")
                scope[parameter.arg] = Array(argument.root, f"%p{k}")
                continue
            assert shape is not None
            parts = []
            for i, (type_, varies) in enumerate(shape.kinds):
                text = f"%p{k}.{i}"
                parameters.append(f"{code.type_text(type_, varies)} {text}")
                parts.append(Number(type_, text))
                if varies:
                    code.varying.add(text)
            scope[parameter.arg] = Tuple(tuple(parts)) if shape.is_tuple else parts[0]
        if masked:
            parameters.append(f"{code.type_text(BOOL, True)} %mask")
            code.varying.add("%mask")
            self.mask = Number(BOOL, "%mask")
        level = Level(0, self.mask, frozenset({RETURNED}), masked=True)
        self.levels = [level]
        if not self.block(self.tree.body, scope, level.needs):
            level.after.append(self.jump(scope))
        ends = [(place, block, {RETURNED: v[RETURNED]} if RETURNED in v else {}) for place, block, v in level.after]
        if ends:
            self.join(code.name("b"), ends, level.needs, scope)
        result = scope.get(RETURNED)
        shape = self.shape_of(result) if isinstance(result, Number | Tuple) else None
        self.leave_with(result)
        head = f'define internal {self.shape_text(shape)} @"{name}"({", ".join(parameters)}) nounwind {{'
        return LaneFunction(name, shape), "\n".join([head, "start:", *code.lines, "}"])

    def leave_with(self, result: Value | None) -> None:
        code = self.code
        if isinstance(result, Number):
            code.put(f"ret {code.typed(result)}")
        elif isinstance(result, Tuple):
            whole, type_ = "poison", self.shape_text(self.shape_of(result))
            for k, part in enumerate(result.parts):
                whole = code.plain("", f"insertvalue {type_} {whole}, {code.typed(part)}, {k}").text
            code.put(f"ret {type_} {whole}")
        else:
            code.put("ret void")

    @abstractmethod
    def count(self, node: ast.For, scope: Scope) -> bool:
        """Write a loop over a range."""

    @abstractmethod
    def repeat(self, node: ast.While, scope: Scope) -> bool:
        """Write a loop that goes on while a test holds."""

    # Statements ---------------------------------------------------------------------------------------------------

    def block(self, statements: Sequence[ast.stmt], scope: Scope, live: Names) -> bool:
        """Write statements one after another; return whether their end is never reached.

        After one in which lanes left, the rest is for those that did not. `live` are the names that are needed behind
        the block.
        """
        level = self.levels[-1]
        for k, statement in enumerate(statements):
            departures = level.departures
            if self.statement(statement, scope):
                return True
            rest = statements[k + 1 :]
            if level.departures != departures and rest:
                self.region(self.present(scope), scope, self.needed(), live, rest)
                return False
        return False

    def needed(self) -> Names:
        """List what lanes need that left."""
        return frozenset().union(*(level.needs for level in self.levels))

    def present(self, scope: Scope) -> Number:
        """Give the mask of the lanes that are here and have not left."""
        here = scope.get(self.levels[-1].here)
        assert isinstance(here, Number)
        return self.code.both(self.mask, here)

    def region(
        self, mask: Number, scope: Scope, blended: Names, carried: Names, statements: Sequence[ast.stmt]
    ) -> None:
        """Write statements for the lanes of a mask; jump over them if there are none, unless they are short.

        Args:
            mask: the lanes.
            scope: the variables, changed in place.
            blended: names that other lanes need as they were.
            carried: names that only the lanes of the mask need.
            statements: to be written.
        """
        code, before, mask_before = self.code, dict(scope), self.mask
        jumps = size(list(statements)) > SHORT or any(reaches_out(s, self.all_functions) for s in statements)
        skip = None
        if jumps:
            some, on, off = code.some(mask), code.name("b"), code.name("b")
            code.choose(some, on, off)
            code.begin(off)
            skip = self.jump(before)
            code.begin(on)
        self.mask = mask
        inner = dict(scope)
        self.block(statements, inner, blended | carried)
        self.mask = mask_before
        after = self.blended(mask, inner, before, blended, carried)
        if skip is not None:
            self.join(code.name("b"), [self.jump(after), skip], blended | carried, after)
        scope.clear()
        scope.update(after)

    def statement(self, node: ast.stmt, scope: Scope) -> bool:
        match node:
            case ast.Assign():
                value = self.value(node.value, scope)
                for target in node.targets:
                    self.put(target, value, scope)
                return False
            case ast.AugAssign():
                self.augment(node, scope)
                return False
            case ast.If():
                return self.branch(node, scope)
            case ast.While(orelse=[]):
                return self.repeat(node, scope)
            case ast.For(target=ast.Name(), orelse=[], iter=ast.Call(func=ast.Name(id="range"), keywords=[])):
                return self.count(node, scope)
            case ast.Return():
                result = None if node.value is None else self.value(node.value, scope)
                if isinstance(result, Array):
                    raise self.cannot(node, "returns a buffer")
                return self.give(result, scope)
            case ast.Break() | ast.Continue() if len(self.levels) > 1:
                return self.leave(scope, again=isinstance(node, ast.Continue))
            case ast.Expr(value=ast.Call() as call):
                self.call(call, scope)  # type: ignore[arg-type]
                return False
            case ast.Expr(value=ast.Compare() | ast.BoolOp() | ast.UnaryOp() as tested):  # a test, for its calls
                self.value(tested, scope)
                return False
            case ast.Pass() | ast.Expr(value=ast.Constant()):
                return False
        raise self.cannot(node, "is no statement that can be compiled")

    def put(self, target: ast.expr, value: Value, scope: Scope) -> None:
        if isinstance(value, Array):
            raise self.cannot(target, "would be a buffer")
        match target:
            case ast.Name(id=name):
                scope[name] = value
            case ast.Subscript():
                array = self.value(target.value, scope)
                if not isinstance(array, Array) or not isinstance(value, Number):
                    raise self.cannot(target, "is no entry of a buffer, or is given no number")
                self.store_at(array, self.index(target.slice, scope), value)
            case ast.Tuple(elts=targets):
                if isinstance(value, Number) and value.text == "undef":
                    value = Tuple((value,) * len(targets))
                if not isinstance(value, Tuple) or len(value.parts) != len(targets):
                    raise self.cannot(target, "takes another number of values than are given")
                for part, item in zip(targets, value.parts, strict=True):
                    self.put(part, item, scope)
            case _:
                raise self.cannot(target, "cannot be assigned to")

    def augment(self, node: ast.AugAssign, scope: Scope) -> None:
        value = self.number(node.value, scope)  # type: ignore[arg-type]
        if isinstance(node.target, ast.Name):
            old = self.number(ast.Name(node.target.id, ast.Load()), scope)  # type: ignore[arg-type]
            scope[node.target.id] = binary(self.code, node.op, old, value)
            return
        array = self.value(node.target.value, scope)
        if not isinstance(node.target, ast.Subscript) or not isinstance(array, Array):
            raise self.cannot(node, "changes what is no entry of a buffer")
        index = self.index(node.target.slice, scope)
        self.store_at(array, index, binary(self.code, node.op, self.load_at(array, index), value))

    def branch(self, node: ast.If, scope: Scope) -> bool:
        code, live = self.code, self.liveness.after[node] | self.needed()
        test = truth(code, self.number(node.test, scope))  # type: ignore[arg-type]
        if code.varies(test):
            mask, other_mask = code.both(self.mask, test), code.neither(self.mask, test)
            others = names_in(node.orelse)  # the other side reads what was there before
            self.region(mask, scope, live | others, frozenset(), node.body)
            if node.orelse:
                self.region(other_mask, scope, live, frozenset(), node.orelse)
            return False
        one, other = code.name("b"), code.name("b")
        code.choose(test, one, other)
        edges = []
        for label, statements in ((one, node.body), (other, node.orelse)):
            code.begin(label)
            inner = dict(scope)
            if not self.block(statements, inner, live):
                edges.append(self.jump(inner))
        if not edges:
            return True
        self.join(code.name("b"), edges, live, scope)
        return False

    # Leaving ------------------------------------------------------------------------------------------------------

    def give(self, result: Number | Tuple | None, scope: Scope) -> bool:
        """Return from the function: all lanes by a jump, or those that are here."""
        function = self.levels[0]
        before = scope.get(RETURNED)
        if result is not None:
            if before is None or self.mask is None:
                scope[RETURNED] = result
            else:
                scope |= self.blended(self.mask, {RETURNED: result}, {RETURNED: before}, function.needs)
        if self.mask is function.mask:
            function.after.append(self.jump(scope))
            return True
        self.depart(scope, self.levels, again=False)
        return False

    def leave(self, scope: Scope, *, again: bool) -> bool:
        """Break out of the loop, or go on with its next turn."""
        level = self.levels[-1]
        if self.mask is level.mask and not level.masked:
            (level.again if again else level.after).append(self.jump(scope))
            return True
        self.depart(scope, [level], again=again)
        return False

    def depart(self, scope: Scope, levels: Sequence[Level], *, again: bool) -> None:
        """Let the lanes that are here leave some levels."""
        code = self.code
        if together := [level for level in levels if not level.masked]:
            raise PartingError(together)
        mask = self.mask if self.mask is not None else code.everyone()
        for level in levels:
            level.departures += 1
            for name in (level.here,) if again else (level.here, level.going):
                before = scope.get(name)
                scope[name] = code.neither(before if isinstance(before, Number) else None, mask)


def names_in(statements: Sequence[ast.stmt]) -> Names:
    """List the names in some statements."""
    return frozenset(n.id for s in statements for n in ast.walk(s) if isinstance(n, ast.Name))
