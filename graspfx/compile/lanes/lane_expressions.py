"""Expressions for lanes: what only some lanes evaluate is evaluated under their mask."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple, Protocol

from graspfx.compile.lanes.lane_code import LaneCode
from graspfx.compile.lanes.lane_shapes import Kind, Scope, Shape, zero
from graspfx.compile.llvm.llvm_arithmetic import (
    BOOL,
    FLOAT,
    INT,
    Number,
    compare,
    convert,
    floating,
    select,
    truth,
    widest,
)
from graspfx.compile.llvm.llvm_expressions import (
    NAMES,
    Array,
    Expressions,
    Tuple,
    Value,
    _harmless,
    flat,
)
from graspfx.errors import GraspFXError


class LaneFunction(NamedTuple):
    """A function for some kinds of arguments: its name and what it returns."""

    name: str
    result: Shape | None


class LaneFunctions(Protocol):
    """Where called functions come from."""

    checked: bool
    notes: list[str]
    lanes: int
    shared: dict[str, tuple[int, int]]  # by buffer, the first and the end of the entries that are the same in all lanes

    def has(self, name: str) -> bool: ...

    def lane_function_for(
        self, name: str, arguments: Sequence[Value], shapes: Sequence[Shape | None], *, masked: bool,
        why: Callable[[str], GraspFXError],
    ) -> LaneFunction: ...  # fmt: skip


class LaneExpressions(Expressions):
    """The expressions of one function, for the lanes of a mask.

    Attributes:
        mask: the lanes that are here; None for all.
    """

    code: LaneCode

    def __init__(self, functions: LaneFunctions, node: ast.FunctionDef) -> None:
        super().__init__(functions, node)  # type: ignore[arg-type]
        self.all_functions = functions
        self.code = LaneCode(functions.lanes)
        self.code.block = "%start"
        self.mask: Number | None = None

    def shape_of(self, value: Number | Tuple) -> Shape:
        parts = value.parts if isinstance(value, Tuple) else (value,)
        return Shape(isinstance(value, Tuple), tuple((part.type, self.code.varies(part)) for part in parts))

    def shape_text(self, shape: Shape | None) -> str:
        """Write the type of a result in LLVM's language."""
        if shape is None:
            return "void"
        types = [self.code.type_text(*kind) for kind in shape.kinds]
        return f"{{ {', '.join(types)} }}" if shape.is_tuple else types[0]

    def variable(self, node: ast.Name, scope: Scope) -> Value:  # type: ignore[override]
        value = scope.get(node.id)
        if value is not None:
            return value
        if node.id in NAMES:
            return floating(NAMES[node.id])
        if node.id not in self.assigned:
            raise self.cannot(node, "is nothing known here")
        self.unset.add(node.id)
        return Number(BOOL, "undef")

    # What only some evaluate --------------------------------------------------------------------------------------

    def value(self, node: ast.expr, scope: Scope) -> Value:  # type: ignore[override]
        if not isinstance(node, ast.IfExp):
            return super().value(node, scope)  # type: ignore[arg-type]
        test = truth(self.code, self.number(node.test, scope))  # type: ignore[arg-type]
        if not self.code.varies(test):
            one, other = self.code.name("b"), self.code.name("b")
            self.code.choose(test, one, other)
            return self.value_of_branches(((one, node.body), (other, node.orelse)), scope)  # type: ignore[arg-type]
        first = self.under(self.code.both(self.mask, test), node.body, scope)
        second = self.under(self.code.neither(self.mask, test), node.orelse, scope)
        return select(self.code, test, first, second)

    def under(self, mask: Number, node: ast.expr, scope: Scope) -> Number:
        """Evaluate an expression for the lanes of a mask; one that may reach out of a buffer only if there are some."""
        before, self.mask = self.mask, mask
        try:
            if not reaches_out(node, self.all_functions):
                return self.number(node, scope)  # type: ignore[arg-type]
            on, end = self.code.name("b"), self.code.name("b")
            start = self.code.block
            self.code.choose(self.code.some(mask), on, end)
            self.code.begin(on)
            number = self.number(node, scope)  # type: ignore[arg-type]
            behind = self.code.block
            self.code.go(end)
            self.code.begin(end)
            return self.phi(number, [(number, behind), (Number(number.type, zero(number.type)), start)])
        finally:
            self.mask = before

    def phi(self, like: Number, sources: Sequence[tuple[Number, str]]) -> Number:
        """Merge values of one type that come from several blocks; a constant becomes a vector where others are."""
        varies = any(self.code.varies(number) for number, _ in sources)
        texts = []
        for number, block in sources:
            text = number.text
            if varies and not self.code.varies(number):
                text = "zeroinitializer" if text == zero(number.type) else self.code._constant(number.type, text)
            texts.append(f"[ {text}, {block} ]")
        line = f"phi {self.code.type_text(like.type, varies)} {', '.join(texts)}"
        return self.code.vector(like.type, line) if varies else self.code.plain(like.type, line)

    def meet(self, end: str, edges: Sequence[tuple[int, str, Number]]) -> Number:
        code = self.code
        to = widest([number.type for _, _, number in edges])
        varies = code.varies(*(number for _, _, number in edges))
        sources = []
        for place, block, number in edges:

            def converted(number: Number = number) -> Number:
                same = convert(code, number, to)
                return code.wide(same) if varies else same

            value, text = self.detached(converted)
            code.lines[place] = "\n".join([*text, f"  br label {end}"])
            sources.append(f"[ {value.text}, {block} ]")
        code.begin(end)
        line = f"phi {code.type_text(to, varies)} {', '.join(sources)}"
        return code.vector(to, line) if varies else code.plain(to, line)

    def logic(self, node: ast.BoolOp, scope: Scope) -> Number:  # type: ignore[override]
        code, stops = self.code, isinstance(node.op, ast.Or)
        number = self.number(node.values[0], scope)  # type: ignore[arg-type]
        for part in node.values[1:]:
            if number.type == BOOL and _harmless(part):
                other = self.number(part, scope)  # type: ignore[arg-type]
                number = select(code, number, *((number, other) if stops else (other, number)))
                continue
            test = truth(code, number)
            if not code.varies(test):
                number = self._branching(number, test, part, scope, stops=stops)
                continue
            mask = code.neither(self.mask, test) if stops else code.both(self.mask, test)
            other = self.under(mask, part, scope)
            number = select(code, test, *((number, other) if stops else (other, number)))
        return number

    def _branching(self, number: Number, test: Number, part: ast.expr, scope: Scope, *, stops: bool) -> Number:
        code, end, on, off = self.code, self.code.name("b"), self.code.name("b"), self.code.name("b")
        code.choose(test, off if stops else on, on if stops else off)
        code.begin(off)
        edges = [self.edge(number)]
        code.begin(on)
        edges.append(self.edge(self.number(part, scope)))  # type: ignore[arg-type]
        return self.meet(end, edges)

    def comparison(self, node: ast.Compare, scope: Scope) -> Number:  # type: ignore[override]
        code = self.code
        left = self.number(node.left, scope)  # type: ignore[arg-type]
        outcome: Number | None = None
        for op, part in zip(node.ops, node.comparators, strict=True):
            if isinstance(op, ast.Is | ast.IsNot | ast.In | ast.NotIn):
                raise self.cannot(node, "is no comparison of numbers")
            if outcome is None or _harmless(part):
                right = self.number(part, scope)  # type: ignore[arg-type]
            else:
                right = self.under(code.both(self.mask, outcome), part, scope)
            this = compare(code, op, left, right)
            outcome = this if outcome is None else code.op(BOOL, f"and i1 {outcome.text}, {this.text}")
            left = right
        assert outcome is not None
        return outcome

    # Entries ------------------------------------------------------------------------------------------------------

    def item(self, node: ast.Subscript, scope: Scope) -> Value:  # type: ignore[override]
        owner = self.value(node.value, scope)
        if not isinstance(owner, Array):
            return super().item(node, scope)  # type: ignore[arg-type]
        return self.load_at(owner, self.index(node.slice, scope))

    def index(self, node: ast.expr, scope: Scope) -> Number:
        number = self.number(node, scope)  # type: ignore[arg-type]
        if number.type == FLOAT:
            raise self.cannot(node, "is no whole number, as an index must be")
        return convert(self.code, number, INT)

    def load_at(self, array: Array, index: Number) -> Number:
        """Load an entry; what all lanes share is one number where its index is."""
        code, stretch = self.code, self.all_functions.shared.get(array.root)
        first, end_of = stretch or (0, 0)
        if stretch is None or (index.text.isdigit() and not first <= int(index.text) < end_of):
            if code.varies(index):
                return code.gather(code.places(array.text, index, self.mask))
            return code.load_entry(code.address(array.text, index))
        if index.text.isdigit():
            place = code.plain(
                "ptr", f"getelementptr inbounds double, ptr {array.text}.s, i64 {int(index.text) - first}"
            )
            return code.plain(FLOAT, f"load double, ptr {place.text}")
        if code.varies(index):
            return code.gather(self._shared_places(array, index, first, end_of))
        own, one, end = code.name("b"), code.name("b"), code.name("b")
        code.choose(self._is_own(index, first, end_of), own, one)
        code.begin(own)
        edges = [self.edge(code.load_entry(code.address(array.text, index)))]
        code.begin(one)
        behind = code.op(INT, f"sub i64 {index.text}, {first}")
        place = code.plain("ptr", f"getelementptr inbounds double, ptr {array.text}.s, i64 {behind.text}")
        edges.append(self.edge(code.plain(FLOAT, f"load double, ptr {place.text}")))
        return self.meet(end, edges)

    def _is_own(self, index: Number, first: int, end: int) -> Number:
        """Tell whether each lane has an entry for itself: index - first, unsigned, is no less than the size."""
        behind = self.code.op(INT, f"sub i64 {index.text}, {first}")
        return self.code.op(BOOL, f"icmp uge i64 {behind.text}, {end - first}")

    def _shared_places(self, array: Array, index: Number, first: int, end: int) -> list[str]:
        code = self.code
        if self.mask is not None:
            index = code.blend(self.mask, index, Number(INT, "0"))
        own = self._is_own(index, first, end)
        near = code.places(array.text, select(code, own, index, Number(INT, "0")), None)
        behind = select(code, own, Number(INT, "0"), code.op(INT, f"sub i64 {index.text}, {first}"))
        out = []
        for lane, place in enumerate(near):
            at = code.plain(INT, f"extractelement {code.type_text(INT, True)} {behind.text}, i64 {lane}")
            far = code.plain("ptr", f"getelementptr inbounds double, ptr {array.text}.s, i64 {at.text}")
            here = code.plain(BOOL, f"extractelement {code.type_text(BOOL, True)} {own.text}, i64 {lane}")
            out.append(code.plain("ptr", f"select i1 {here.text}, ptr {place}, ptr {far.text}").text)
        return out

    def store_at(self, array: Array, index: Number, value: Number) -> None:
        """Store an entry of the lanes that are here; what all lanes share nothing stores to."""
        code, value = self.code, convert(self.code, value, FLOAT)
        if code.varies(index):
            code.scatter(code.places(array.text, index, self.mask), value, self.mask)
        else:
            code.store_entry(code.address(array.text, index), value, self.mask)

    # Calls --------------------------------------------------------------------------------------------------------

    def own(self, node: ast.Call, name: str, arguments: Sequence[Value]) -> Number | Tuple | None:
        code, masked = self.code, self.mask is not None
        function = self.all_functions.lane_function_for(
            name, arguments, [None if isinstance(a, Array) else self.shape_of(a) for a in arguments], masked=masked,
            why=lambda text: self.cannot(node, text),
        )  # fmt: skip
        operands = [text for part in flat(arguments) for text in self.operand(part)]
        if self.mask is not None:
            operands.append(code.typed(self.mask))
        text = f'call {self.shape_text(function.result)} @"{function.name}"({", ".join(operands)})'
        if function.result is None:
            code.put(text)
            return None
        if not function.result.is_tuple:
            return self.result_in(function.result.kinds[0], text)
        whole, type_ = code.plain("", text).text, self.shape_text(function.result)
        parts = (
            self.result_in(kind, f"extractvalue {type_} {whole}, {k}") for k, kind in enumerate(function.result.kinds)
        )
        return Tuple(tuple(parts))

    def result_in(self, kind: Kind, text: str) -> Number:
        return self.code.vector(kind[0], text) if kind[1] else self.code.plain(kind[0], text)

    def operand(self, part: Number | Array) -> Iterable[str]:
        if isinstance(part, Number):
            yield self.code.typed(part)
            return
        yield f"ptr {part.text}"
        if part.root in self.all_functions.shared:
            yield f"ptr {part.text}.s"


def reaches_out(node: ast.AST, functions: LaneFunctions) -> bool:
    """Tell whether something must not run for nobody: it calls a function, or its indices are computed."""
    for each in ast.walk(node):
        if isinstance(each, ast.Call) and isinstance(each.func, ast.Name) and functions.has(each.func.id):
            return True
        if isinstance(each, ast.Subscript) and not isinstance(each.slice, ast.Constant):
            return True
        if isinstance(each, ast.While | ast.For):
            return True
    return False
