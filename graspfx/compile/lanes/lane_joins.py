"""Where ways meet: variables that come by jumps, or are blended under a mask."""

from __future__ import annotations

from collections.abc import Sequence

from graspfx.compile.lanes.lane_expressions import LaneExpressions
from graspfx.compile.lanes.lane_shapes import Names, Scope, Shape, unset, zero
from graspfx.compile.llvm.llvm_arithmetic import BOOL, Number, convert, widest
from graspfx.compile.llvm.llvm_expressions import Array, Tuple, Value

Edge = tuple[int, str, Scope]  # the place of a jump in the text, its block, and the variables there


class LaneJoins(LaneExpressions):
    """Joins of one function."""

    def jump(self, scope: Scope) -> Edge:
        """Leave room for a jump from here."""
        self.code.lines.append("")
        return len(self.code.lines) - 1, self.code.block, dict(scope)

    def join(self, label: str, edges: Sequence[Edge], live: Names, scope: Scope) -> None:
        """Continue in a block where jumps arrive, with what each brings of the names that are still needed."""
        code = self.code
        names = {name for _, _, variables in edges for name in variables if name in live or name[0] in "#$"}
        merged: Scope = {}
        shapes: dict[str, Shape] = {}
        for name in sorted(names):
            values = [variables.get(name) for _, _, variables in edges]
            first = next(value for value in values if value is not None)
            shape = self.common(values)
            if isinstance(first, Array) or all(value == first for value in values):
                merged[name] = first
            elif shape is not None:  # else a tuple on one way and a number on another: nobody can read it
                shapes[name] = shape
        brought = []
        for place, _, variables in edges:
            mark = len(code.lines)
            brought.append({name: self.adapted(variables.get(name), shape, name) for name, shape in shapes.items()})
            code.lines[place] = "\n".join([*code.lines[mark:], f"  br label {label}"])
            del code.lines[mark:]
        code.begin(label)
        for name, shape in shapes.items():
            numbers = []
            for k, kind in enumerate(shape.kinds):
                ways = zip(brought, edges, strict=True)
                pairs = ", ".join(f"[ {values[name][k].text}, {block} ]" for values, (_, block, _) in ways)
                numbers.append(self.result_in(kind, f"phi {code.type_text(*kind)} {pairs}"))
            merged[name] = Tuple(tuple(numbers)) if shape.is_tuple else numbers[0]
        scope.clear()
        scope.update(merged)

    def common(self, values: Sequence[Value | None]) -> Shape | None:
        """Find the shape that a variable has where ways meet; None if nothing is set, or there is none."""
        shape: Shape | None = None
        for value in values:
            if isinstance(value, Number | Tuple) and not unset(value):
                own = self.shape_of(value)
                if shape is not None and (own.is_tuple, len(own.kinds)) != (shape.is_tuple, len(shape.kinds)):
                    return None
                shape = own if shape is None else shape.joined(own)
        return shape

    def blended(self, mask: Number, one: Scope, other: Scope, live: Names, carried: Names = frozenset()) -> Scope:
        """Give the variables of one scope in the lanes of a mask, and of the other elsewhere."""
        out: Scope = {}
        for name in {**one, **other}:
            a, b = one.get(name), other.get(name)
            if name in live and a is not None and b is not None:
                both = self.blended_value(mask, a, b)
                if both is not None:
                    out[name] = both
            elif name in live or name in carried or name[0] in "#$":  # masks, which only these lanes have changed, too
                value = b if a is None else a
                assert value is not None
                out[name] = value
        return out

    def blended_value(self, mask: Number, one: Value, other: Value) -> Value | None:
        """Give one value in the lanes of a mask, the other elsewhere; None for a tuple and a number."""
        if one == other or unset(other) or isinstance(one, Array) or isinstance(other, Array):
            return one
        if unset(one):
            return other
        if isinstance(one, Number) and isinstance(other, Number):
            return self.blend(mask, one, other)
        if isinstance(one, Tuple) and isinstance(other, Tuple) and len(one.parts) == len(other.parts):
            return Tuple(tuple(self.blend(mask, a, b) for a, b in zip(one.parts, other.parts, strict=True)))
        return None

    def blend(self, mask: Number, one: Number, other: Number) -> Number:
        to = widest((one.type, other.type))
        return self.code.blend(mask, convert(self.code, one, to), convert(self.code, other, to))

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
