"""Statements for lanes: where lanes part both sides run, each under its mask, and what is read later is blended."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from graspfx.compile.lanes.lane_expressions import (
    Kind,
    LaneExpressions,
    LaneFunction,
    LaneFunctions,
    Result,
    Scope,
    reaches_out,
    zero,
)
from graspfx.compile.lanes.lane_liveness import Liveness, Names
from graspfx.compile.llvm.llvm_arithmetic import BOOL, INT, Number, binary, convert, truth, widest
from graspfx.compile.llvm.llvm_expressions import Array, Tuple, Value
from graspfx.compile.specialise.syntax import assigned, size

RETURNED = "return"  # stands for what was returned among the variables: no name of Python's
SHORT = 4  # statements that are run for nobody rather than jumped over
Edge = tuple[int, str, Scope]  # the place of a jump in the text, its block, and the variables there


@dataclass(eq=False)
class Level:
    """A function, or a loop inside, that lanes may leave one by one.

    Attributes:
        number: tells it from others.
        mask: the lanes with which its turn began.
        kept: names that lanes which left still need.
        masked: whether lanes may leave it one by one.
        after: jumps out of it that all its lanes take together; to its next turn, `again`.
        departures: how often lanes have left it one by one.
    """

    number: int
    mask: Number | None
    kept: Names
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


class Shape(NamedTuple):
    """Kinds of a variable's numbers: of one, or of several in a tuple."""

    several: bool
    kinds: tuple[Kind, ...]

    @property
    def varies(self) -> bool:
        return any(varies for _, varies in self.kinds)

    def joined(self, other: Shape) -> Shape:
        """Find the common shape of a variable that two ways leave with different ones."""
        if self.several != other.several or len(self.kinds) != len(other.kinds):
            return self
        pairs = zip(self.kinds, other.kinds, strict=True)
        return Shape(self.several, tuple((widest((a[0], b[0])), a[1] or b[1]) for a, b in pairs))


@dataclass(frozen=True, eq=False)
class Loop:
    """A loop to be written.

    Attributes:
        node: its statement.
        target: the name that counts its turns; empty for `while`.
        turn: the variable that really does.
        test: tells whether a turn follows.
        advance: counts on.
    """

    node: ast.For | ast.While
    target: str
    turn: str
    test: Callable[[Scope], Number]
    advance: Callable[[Scope], None]


class PartingError(Exception):
    """Lanes leave loops one by one that were written for all together."""

    def __init__(self, levels: Sequence[Level]) -> None:
        super().__init__()
        self.levels = levels


class LaneStatements(LaneExpressions):
    """One function for some kinds of its arguments."""

    def __init__(self, functions: LaneFunctions, node: ast.FunctionDef) -> None:
        super().__init__(functions, node)
        self.liveness = Liveness(node)
        self.levels: list[Level] = []

    def function_text(
        self, name: str, arguments: Sequence[Value], kinds: Sequence[Result], *, masked: bool
    ) -> tuple[LaneFunction, str]:
        """Write the function; return its name with the kind of its result, and its text."""
        code, scope = self.code, Scope()
        parameters = []
        roots = [a.root for a in arguments if isinstance(a, Array)]
        for k, (parameter, argument, kind) in enumerate(zip(self.tree.args.args, arguments, kinds, strict=True)):
            if isinstance(argument, Array):
                alone = "noalias " if roots.count(argument.root) == 1 else ""
                parameters.append(f"ptr {alone}%p{k}")
                if argument.root in self.all_functions.shared:
                    parameters.append(f"ptr %p{k}.s")
                scope[parameter.arg] = Array(argument.root, f"%p{k}")
                continue
            assert kind is not None
            single = isinstance(kind[0], str)
            parts = []
            for i, (type_, varies) in enumerate([kind] if single else kind):  # type: ignore[list-item, misc]
                text = f"%p{k}.{i}"
                parameters.append(f"{code.type_text(type_, varies)} {text}")
                parts.append(Number(type_, text))
                if varies:
                    code.varying.add(text)
            scope[parameter.arg] = parts[0] if single else Tuple(tuple(parts))
        if masked:
            parameters.append(f"{code.type_text(BOOL, True)} %mask")
            code.varying.add("%mask")
            self.mask = Number(BOOL, "%mask")
        level = Level(0, self.mask, frozenset({RETURNED}), masked=True)
        self.levels = [level]
        if not self.block(self.tree.body, scope, level.kept):
            level.after.append(self.jump(scope))
        ends = [(place, block, {RETURNED: v[RETURNED]} if RETURNED in v else {}) for place, block, v in level.after]
        if ends:
            self.join(code.name("b"), ends, level.kept, scope)
        result = scope.get(RETURNED)
        kind = None if result is None else self.kind_of(result)
        self.leave_with(result, kind)
        head = f'define internal {self.kind_text(kind)} @"{name}"({", ".join(parameters)}) nounwind {{'
        return LaneFunction(name, kind), "\n".join([head, "start:", *code.lines, "}"])

    def leave_with(self, result: Value | None, kind: Result) -> None:
        code = self.code
        if result is None or isinstance(result, Array):
            code.put("ret void")
        elif isinstance(result, Number):
            code.put(f"ret {code.typed(result)}")
        else:
            whole = "poison"
            for k, part in enumerate(result.parts):
                whole = code.plain("", f"insertvalue {self.kind_text(kind)} {whole}, {code.typed(part)}, {k}").text
            code.put(f"ret {self.kind_text(kind)} {whole}")

    # Where ways meet ----------------------------------------------------------------------------------------------

    def jump(self, scope: Scope) -> Edge:
        """Leave room for a jump from here."""
        self.code.lines.append("")
        return len(self.code.lines) - 1, self.code.block, dict(scope)

    def join(self, label: str, edges: Sequence[Edge], live: Names, scope: Scope) -> None:
        """Continue in a block where jumps arrive, with what each brings of the names that are still needed."""
        code = self.code
        names = {name for _, _, variables in edges for name in variables if name in live or name[0] in "#$"}
        merged: Scope = {}
        sources: dict[str, list[list[Number]]] = {}
        lines: list[list[str]] = [[] for _ in edges]
        for name in sorted(names):
            values = [variables.get(name) for _, _, variables in edges]
            first = next(value for value in values if value is not None)
            if isinstance(first, Array) or all(value == first for value in values):
                merged[name] = first
                continue
            if all(value is None or unset(value) for value in values):
                merged[name] = first
                continue
            shapes = {len(v.parts) if isinstance(v, Tuple) else 0 for v in values if v is not None and not unset(v)}
            if len(shapes) > 1:
                continue  # a tuple on one way and a number on another: nobody can read it
            parts = []
            for column in columns(name, values):
                kinds = [self.kind_of(part) for part in column if part is not None]
                to, varies = widest([kind[0] for kind in kinds]), any(kind[1] for kind in kinds)  # type: ignore[index]
                row = []
                for k, part in enumerate(column):
                    default = Number(BOOL, "true") if name[0] == "#" else Number(to, zero(to))

                    def same(part: Number = part or default, to: str = to, varies: bool = varies) -> Number:
                        number = convert(code, part, to)
                        return code.wide(number) if varies else number

                    number, text = self.detached(same)
                    lines[k] += text
                    row.append(number)
                parts.append((to, varies, row))
            sources[name] = parts  # type: ignore[assignment]
        for (place, _, _), text in zip(edges, lines, strict=True):
            code.lines[place] = "\n".join([*text, f"  br label {label}"])
        code.begin(label)
        for name, parts in sources.items():
            numbers = []
            for to, varies, row in parts:  # type: ignore[misc]
                pairs = ", ".join(f"[ {n.text}, {block} ]" for n, (_, block, _) in zip(row, edges, strict=True))
                numbers.append(self.made((to, varies), f"phi {code.type_text(to, varies)} {pairs}"))  # type: ignore[arg-type]
            tuple_ = any(isinstance(variables.get(name), Tuple) for _, _, variables in edges)
            merged[name] = Tuple(tuple(numbers)) if tuple_ else numbers[0]
        scope.clear()
        scope.update(merged)

    def blended(
        self, mask: Number, one: Scope, other: Scope, live: Names, carried: Names = frozenset()
    ) -> Scope:
        """Give the variables of one scope in the lanes of a mask, and of the other elsewhere."""
        out: Scope = {}
        for name in {**one, **other}:
            if name[0] not in "#$" and name not in live and name not in carried:
                continue
            a, b = one.get(name), other.get(name)
            if name[0] in "#$" or name not in live:  # masks, that only lanes which are here have changed, among them
                out[name] = a if a is not None else b  # type: ignore[assignment]
            elif a is None or b is None or a == b or isinstance(a, Array) or unset(b):
                out[name] = a if a is not None else b  # type: ignore[assignment]
            elif unset(a):
                out[name] = b
            elif isinstance(a, Tuple) or isinstance(b, Tuple):
                if isinstance(a, Tuple) and isinstance(b, Tuple) and len(a.parts) == len(b.parts):
                    out[name] = Tuple(tuple(self.blend(mask, x, y) for x, y in zip(a.parts, b.parts, strict=True)))
            else:
                assert isinstance(a, Number) and isinstance(b, Number)
                out[name] = self.blend(mask, a, b)
        return out

    def blend(self, mask: Number, one: Number, other: Number) -> Number:
        to = widest((one.type, other.type))
        return self.code.blend(mask, convert(self.code, one, to), convert(self.code, other, to))

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
        return frozenset().union(*(level.kept for level in self.levels))

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
                scope |= self.blended(self.mask, {RETURNED: result}, {RETURNED: before}, function.kept)
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

    # Loops --------------------------------------------------------------------------------------------------------

    def count(self, node: ast.For, scope: Scope) -> bool:
        code = self.code
        assert isinstance(node.iter, ast.Call) and isinstance(node.target, ast.Name)
        bounds = [self.number(a, scope) for a in node.iter.args]  # type: ignore[arg-type]
        if not 1 <= len(bounds) <= 3 or any(b.type not in (INT, BOOL) for b in bounds):
            raise self.cannot(node, "takes one to three whole numbers")
        bounds = [convert(code, b, INT) for b in bounds]
        start, stop = (Number(INT, "0"), bounds[0]) if len(bounds) == 1 else bounds[:2]
        step = bounds[2] if len(bounds) == 3 else Number(INT, "1")
        turn = f"$turn{code.count + 1}"

        def test(inner: Scope) -> Number:
            k = number_at(inner, turn)
            below = code.op(BOOL, f"icmp slt i64 {k.text}, {stop.text}")
            if step.text.isdigit():
                return below
            above = code.op(BOOL, f"icmp sgt i64 {k.text}, {stop.text}")
            down = code.op(BOOL, f"icmp slt i64 {step.text}, 0")
            return code.op(BOOL, f"select i1 {down.text}, i1 {above.text}, i1 {below.text}")

        def advance(inner: Scope) -> None:
            inner[turn] = code.op(INT, f"add i64 {number_at(inner, turn).text}, {step.text}")

        scope[turn] = start
        ended = self.turns(Loop(node, node.target.id, turn, test, advance), scope)
        scope.pop(turn, None)
        return ended

    def repeat(self, node: ast.While, scope: Scope) -> bool:
        def test(inner: Scope) -> Number:
            return truth(self.code, self.number(node.test, inner))  # type: ignore[arg-type]

        return self.turns(Loop(node, "", "", test, lambda inner: None), scope)

    def turns(self, loop: Loop, scope: Scope) -> bool:
        """Write a loop, again until it is known which lanes go together and of which kinds its variables are."""
        code = self.code
        mark, block, mask = len(code.lines), code.block, self.mask
        before = [(len(level.after), len(level.again), level.departures) for level in self.levels]
        shapes: dict[str, Shape] = {}
        masked = False
        while True:
            level = Level(code.count + 1, mask, self.kept_of(loop.node), masked)
            inner = dict(scope)
            try:
                used, shapes = (self.turn_apart if masked else self.turn_together)(loop, level, inner, shapes)
                if used == shapes:
                    break
            except PartingError as parting:
                if masked or level not in parting.levels:
                    raise
                masked, shapes = True, {}
            finally:
                self.mask = mask
                del self.levels[len(before) :]
            del code.lines[mark:]
            code.block = block
            for outer, (after, again, departures) in zip(self.levels, before, strict=True):
                del outer.after[after:], outer.again[again:]
                outer.departures = departures
        scope.clear()
        scope.update({name: value for name, value in inner.items() if name not in (level.here, level.going)})
        return False

    def kept_of(self, node: ast.For | ast.While) -> Names:
        """List what lanes need that leave a loop, or only the rest of a turn."""
        kept = self.liveness.after[node]
        return kept | self.liveness.head[node] if continues(node.body) else kept

    def heads(self, loop: Loop, scope: Scope, shapes: dict[str, Shape]) -> dict[str, Shape]:
        """List the variables that a loop carries from turn to turn, with their shapes as far as they are known."""
        node = loop.node
        live = self.liveness.after[node] | self.liveness.head[node] | self.needed()
        names = {name for name in assigned([node]) if name in live} | ({loop.turn} if loop.turn else set())
        if any(isinstance(each, ast.Return) for each in ast.walk(node)):
            names |= {RETURNED, *(mask for level in self.levels for mask in (level.here, level.going))}
        out = dict(shapes)
        for name in sorted(names):
            value = scope.get(name)
            if name[0] == "#":
                out[name] = Shape(False, ((BOOL, True),))
            elif isinstance(value, Number | Tuple) and not unset(value) and name not in out:
                out[name] = self.shape_of(value)
        return out

    def shape_of(self, value: Number | Tuple) -> Shape:
        parts = value.parts if isinstance(value, Tuple) else (value,)
        return Shape(isinstance(value, Tuple), tuple((part.type, self.code.varies(part)) for part in parts))

    def begin_head(self, scope: Scope, shapes: dict[str, Shape]) -> tuple[str, dict[str, list[tuple[int, str]]]]:
        """Begin a loop's head with a phi for each part of its variables: the value from before, and room for another.

        Returns:
            The head's label; by name the places of the phis in the text, each with its beginning.
        """
        code, phis = self.code, {}
        starts = {name: self.adapted(scope.get(name), shape, name) for name, shape in shapes.items()}
        before, head = code.block, code.name("b")
        code.go(head)
        code.begin(head)
        for name, shape in shapes.items():
            places, numbers = [], []
            for (type_, varies), start in zip(shape.kinds, starts[name], strict=True):
                number = self.made((type_, varies), "")
                line = f"  {number.text} = phi {code.type_text(type_, varies)} [ {start.text}, {before} ]"
                code.lines[-1] = line
                places.append((len(code.lines) - 1, line))
                numbers.append(number)
            phis[name] = places
            scope[name] = Tuple(tuple(numbers)) if shape.several else numbers[0]
        return head, phis

    def adapted(self, value: Value | None, shape: Shape, name: str) -> list[Number]:
        """Convert a variable to a shape; one that is not set yet is zero, a mask all lanes."""
        parts: Sequence[Number | None] = [None] * len(shape.kinds)
        if isinstance(value, Tuple):
            parts = value.parts
        elif isinstance(value, Number) and not unset(value):
            parts = [value]
        out = []
        for part, (type_, varies) in zip(parts, shape.kinds, strict=True):
            blank = Number(BOOL, "true") if name[0] == "#" else Number(type_, zero(type_))
            number = convert(self.code, part or blank, type_)
            out.append(self.code.wide(number) if varies else number)
        return out

    def close_head(self, phis: dict[str, list[tuple[int, str]]], scope: Scope, shapes: dict[str, Shape]) -> dict[str, Shape]:
        """Lead the end of a turn back to the head; give the shapes that the variables ought to have there."""
        out: dict[str, Shape] = {}
        for name, shape in shapes.items():
            value = scope.get(name)
            if isinstance(value, Number | Tuple) and not unset(value):
                out[name] = shape.joined(self.shape_of(value))
            else:
                out[name] = shape
        if out != shapes:
            return out
        ends = {name: self.adapted(scope.get(name), shape, name) for name, shape in shapes.items()}
        for name, places in phis.items():
            for (place, line), end in zip(places, ends[name], strict=True):
                self.code.lines[place] = f"{line}, [ {end.text}, {self.code.block} ]"
        return out

    def turn_together(
        self, loop: Loop, level: Level, scope: Scope, shapes: dict[str, Shape]
    ) -> tuple[dict[str, Shape], dict[str, Shape]]:
        """Write a loop whose lanes all turn, and leave, together."""
        code, node = self.code, loop.node
        shapes = self.heads(loop, scope, shapes)
        live = self.liveness.head[node] | self.liveness.after[node] | self.needed()
        head, phis = self.begin_head(scope, shapes)
        self.levels.append(level)
        test = loop.test(scope)
        if code.varies(test):
            raise PartingError([level])
        first, off = code.name("b"), code.name("b")
        code.choose(test, first, off)
        code.begin(off)
        level.after.append(self.jump(scope))
        code.begin(first)
        inner = dict(scope)
        if loop.turn:
            inner[loop.target] = inner[loop.turn]
        if not self.block(node.body, inner, live):
            level.again.append(self.jump(inner))
        more = shapes
        if level.again:
            self.join(code.name("b"), level.again, live, inner)
            loop.advance(inner)
            more = self.close_head(phis, inner, self.with_new(shapes, inner, node))
            code.go(head)
        self.levels.pop()
        self.join(code.name("b"), level.after, self.liveness.after[node] | self.needed(), scope)
        return shapes, more

    def with_new(self, shapes: dict[str, Shape], inner: Scope, node: ast.For | ast.While) -> dict[str, Shape]:
        """Add the variables that a turn has set for the first time and that are needed later."""
        live = self.liveness.head[node] | self.liveness.after[node] | self.needed()
        out = dict(shapes)
        for name in assigned([node]) | {RETURNED}:
            value = inner.get(name)
            if name in live and name not in out and isinstance(value, Number | Tuple) and not unset(value):
                out[name] = self.shape_of(value)
        return out

    def turn_apart(
        self, loop: Loop, level: Level, scope: Scope, shapes: dict[str, Shape]
    ) -> tuple[dict[str, Shape], dict[str, Shape]]:
        """Write a loop that each lane leaves when it wants to: it turns until none is left."""
        code, node, outer = self.code, loop.node, self.mask
        going, after = f"#turning{level.number}", self.liveness.after[node] | self.needed()
        scope.pop(going, None)
        scope[going] = outer if outer is not None else code.everyone()
        shapes = self.heads(loop, scope, {**shapes, going: Shape(False, ((BOOL, True),))})
        # what is the same in all lanes goes on so inside; behind the loop each lane has its own
        exits = {name: f"$exit {name}" for name, shape in shapes.items() if name in after and not shape.varies}
        for name, own in exits.items():
            shapes[own] = Shape(shapes[name].several, tuple((type_, True) for type_, _ in shapes[name].kinds))
            if name in scope:
                scope[own] = scope[name]
        head, phis = self.begin_head(scope, shapes)
        first, tested, off = code.name("b"), code.name("b"), code.name("b")
        alive = number_at(scope, going)
        code.choose(code.some(alive), tested, off)
        code.begin(tested)
        self.levels.append(level)
        self.mask = alive
        turning = code.both(alive, loop.test(scope))
        code.choose(code.some(turning), first, off)
        code.begin(first)
        self.mask = level.mask = turning
        inner = dict(scope)
        if loop.turn:
            inner[loop.target] = inner[loop.turn]
        live = self.liveness.head[node] | after
        ended = self.block(node.body, inner, live)
        assert not ended
        loop.advance(inner)
        remaining = inner.get(level.going)
        ends = dict(inner)
        ends[going] = code.both(turning, remaining) if isinstance(remaining, Number) else turning
        known = self.with_new({name: shape for name, shape in shapes.items() if name not in exits.values()}, inner, node)
        for name in after & known.keys():
            new, old = inner.get(name), scope.get(name)
            if new is None or old is None:
                continue
            if name in exits:
                ends[exits[name]] = self.blended(turning, {name: new}, {name: scope[exits[name]]}, after)[name]
            else:
                ends |= self.blended(turning, {name: new}, {name: old}, after)
        more = self.close_head(phis, ends, {**known, **{own: shapes[own] for own in exits.values()}})
        code.go(head)
        self.levels.pop()
        code.begin(off)
        self.mask = outer
        for name, own in exits.items():
            scope[name] = scope.pop(own)
        scope.pop(going)
        return without(shapes, exits, going), without(more, exits, going)


def unset(value: Value) -> bool:
    return isinstance(value, Number) and value.text == "undef"


def columns(name: str, values: Sequence[Value | None]) -> Iterator[list[Number | None]]:
    """Give the numbers of a variable on each way, part by part; None where it has none."""
    width = max(len(v.parts) if isinstance(v, Tuple) else 1 for v in values if v is not None and not isinstance(v, Array))
    for k in range(width):
        yield [
            None if v is None or unset(v) else v.parts[k] if isinstance(v, Tuple) else v  # type: ignore[union-attr]
            for v in values
        ]


def without(shapes: dict[str, Shape], exits: dict[str, str], going: str) -> dict[str, Shape]:
    return {name: shape for name, shape in shapes.items() if name not in exits.values() and name != going}


def number_at(scope: Scope, name: str) -> Number:
    value = scope[name]
    assert isinstance(value, Number)
    return value


def names_in(statements: Sequence[ast.stmt]) -> Names:
    """List the names in some statements."""
    return frozenset(n.id for s in statements for n in ast.walk(s) if isinstance(n, ast.Name))


def continues(statements: Sequence[ast.stmt]) -> bool:
    """Tell whether a loop's body has a `continue` of its own."""
    for statement in statements:
        if isinstance(statement, ast.Continue):
            return True
        if isinstance(statement, ast.If) and (continues(statement.body) or continues(statement.orelse)):
            return True
    return False
