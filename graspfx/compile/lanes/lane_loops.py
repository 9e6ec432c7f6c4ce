"""Loops for lanes: all turn together, or each until it wants to leave."""

from __future__ import annotations

import ast
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from graspfx.compile.lanes.lane_shapes import Names, Scope, Shape, number_at, unset
from graspfx.compile.lanes.lane_statements import RETURNED, LaneStatements, Level, PartingError
from graspfx.compile.llvm.llvm_arithmetic import BOOL, INT, Number, convert, truth
from graspfx.compile.llvm.llvm_expressions import Tuple
from graspfx.compile.specialise.syntax import assigned

Shapes = dict[str, Shape]


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


class LaneLoops(LaneStatements):
    """One function for some shapes of its arguments, loops among its statements."""

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
        """Write a loop, again until it is clear which lanes go together and of which kinds its variables are."""
        code = self.code
        mark, block, mask = len(code.lines), code.block, self.mask
        before = [(len(level.after), len(level.again), level.departures) for level in self.levels]
        shapes: Shapes = {}
        masked = False
        while True:
            level = Level(code.count + 1, mask, self.needs_of(loop.node), masked)
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

    def needs_of(self, node: ast.For | ast.While) -> Names:
        """List what lanes need that leave a loop, or only the rest of a turn."""
        needs = self.liveness.after[node]
        return needs | self.liveness.head[node] if continues(node.body) else needs

    def heads(self, loop: Loop, scope: Scope, shapes: Shapes) -> Shapes:
        """List the variables that a loop carries from turn to turn, with their shapes so far."""
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

    def begin_head(self, scope: Scope, shapes: Shapes) -> tuple[str, dict[str, list[tuple[int, str]]]]:
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
                number = self.result_in((type_, varies), "")
                line = f"  {number.text} = phi {code.type_text(type_, varies)} [ {start.text}, {before} ]"
                code.lines[-1] = line
                places.append((len(code.lines) - 1, line))
                numbers.append(number)
            phis[name] = places
            scope[name] = Tuple(tuple(numbers)) if shape.is_tuple else numbers[0]
        return head, phis

    def close_head(self, phis: dict[str, list[tuple[int, str]]], scope: Scope, shapes: Shapes) -> Shapes:
        """Lead the end of a turn back to the head; give the shapes that the variables ought to have there."""
        out: Shapes = {}
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

    def turn_together(self, loop: Loop, level: Level, scope: Scope, shapes: Shapes) -> tuple[Shapes, Shapes]:
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

    def with_new(self, shapes: Shapes, inner: Scope, node: ast.For | ast.While) -> Shapes:
        """Add the variables that a turn has set for the first time and that are needed behind it."""
        live = self.liveness.head[node] | self.liveness.after[node] | self.needed()
        out = dict(shapes)
        for name in assigned([node]) | {RETURNED}:
            value = inner.get(name)
            if name in live and name not in out and isinstance(value, Number | Tuple) and not unset(value):
                out[name] = self.shape_of(value)
        return out

    def turn_apart(self, loop: Loop, level: Level, scope: Scope, shapes: Shapes) -> tuple[Shapes, Shapes]:
        """Write a loop that each lane leaves when it wants to: it turns until none is left."""
        code, node, outer = self.code, loop.node, self.mask
        going, after = f"#turning{level.number}", self.liveness.after[node] | self.needed()
        scope.pop(going, None)
        scope[going] = outer if outer is not None else code.everyone()
        shapes = self.heads(loop, scope, {**shapes, going: Shape(False, ((BOOL, True),))})
        # what is the same in all lanes goes on so inside; behind the loop each lane has its own
        exits = {name: f"$exit {name}" for name, shape in shapes.items() if name in after and not shape.varies}
        for name, own in exits.items():
            shapes[own] = Shape(shapes[name].is_tuple, tuple((type_, True) for type_, _ in shapes[name].kinds))
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
        heads = self.with_new(
            {name: shape for name, shape in shapes.items() if name not in exits.values()}, inner, node
        )
        for name in after & heads.keys():
            new, old = inner.get(name), scope.get(name)
            if new is None or old is None:
                continue
            if name in exits:
                ends[exits[name]] = self.blended(turning, {name: new}, {name: scope[exits[name]]}, after)[name]
            else:
                ends |= self.blended(turning, {name: new}, {name: old}, after)
        more = self.close_head(phis, ends, {**heads, **{own: shapes[own] for own in exits.values()}})
        code.go(head)
        self.levels.pop()
        code.begin(off)
        self.mask = outer
        for name, own in exits.items():
            scope[name] = scope.pop(own)
        scope.pop(going)
        return without(shapes, exits, going), without(more, exits, going)


def without(shapes: Shapes, exits: dict[str, str], going: str) -> Shapes:
    return {name: shape for name, shape in shapes.items() if name not in exits.values() and name != going}


def continues(statements: Sequence[ast.stmt]) -> bool:
    """Tell whether a loop's body has a `continue` of its own."""
    for statement in statements:
        if isinstance(statement, ast.Continue):
            return True
        if isinstance(statement, ast.If) and (continues(statement.body) or continues(statement.orelse)):
            return True
    return False
