"""LLVM text of a program's expressions: values, conditions of branches, entries of buffers, and calls."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple, Protocol

from graspfx.compile.llvm.llvm_arithmetic import (
    BOOL,
    FLOAT,
    INT,
    Code,
    LlvmFunction,
    Number,
    Type,
    absolute,
    binary,
    compare,
    constant,
    convert,
    extreme,
    floating,
    mantissa_and_exponent,
    mathematical,
    negative,
    select,
    truncated,
    truth,
    widest,
)
from graspfx.compile.syntax import assigned
from graspfx.errors import GraspFXError, InputError

NAMES = {"inf": math.inf, "nan": math.nan}


class Array(NamedTuple):
    """Buffer of floats in LLVM text: the parameter of the entry that it is, and the register with its address."""

    root: str
    text: str


class Tuple(NamedTuple):
    """Tuple of numbers in LLVM text."""

    parts: tuple[Number, ...]


Value = Number | Tuple | Array
Variables = dict[str, Type | Array]


class Functions(Protocol):
    """Functions of a program that can be called."""

    def has(self, name: str) -> bool: ...

    def function_for(
        self, name: str, arguments: Sequence[Value], why: Callable[[str], GraspFXError]
    ) -> LlvmFunction: ...


class Expressions:
    """Translates the expressions of one function."""

    def __init__(self, functions: Functions, node: ast.FunctionDef) -> None:
        self.functions, self.tree = functions, node
        self.code = Code()
        self.assigned = assigned(node.body)
        self.unset: set[str] = set()  # variables read before their first assignment, which may follow in a loop's body

    def cannot(self, node: ast.AST, why: str) -> GraspFXError:
        line = getattr(node, "lineno", self.tree.lineno)
        text = ast.unparse(node).splitlines()[0] if isinstance(node, ast.expr | ast.stmt) else self.tree.name
        place = f"{self.tree.name}, line {line}"
        return InputError(place, text, "a construct supported in compiled kernels", f"it {why}")

    def number(self, node: ast.expr, scope: Variables) -> Number:
        value = self.value(node, scope)
        if isinstance(value, Number):
            return value
        raise self.cannot(node, "is not a number")

    def value(self, node: ast.expr, scope: Variables) -> Value:
        code = self.code
        match node:
            case ast.Constant(value=bool() | int() | float() as number):
                if isinstance(number, int) and number.bit_length() > 63:
                    raise self.cannot(node, "does not fit in 64 bits")
                return constant(number)
            case ast.Name():
                return self.variable(node, scope)
            case ast.Attribute(value=ast.Name(id="math"), attr="inf" | "nan" | "pi" | "tau" | "e" as name):
                return floating(getattr(math, name))
            case ast.Subscript():
                return self.item(node, scope)
            case ast.Tuple():
                return Tuple(tuple(self.number(part, scope) for part in node.elts))
            case ast.BinOp(op=ast.Add() | ast.Sub() | ast.Mult() | ast.Div() | ast.FloorDiv() | ast.Mod() | ast.Pow()):
                return binary(code, node.op, self.number(node.left, scope), self.number(node.right, scope))
            case ast.UnaryOp(op=ast.USub()):
                return negative(code, self.number(node.operand, scope))
            case ast.UnaryOp(op=ast.UAdd()):
                operand = self.number(node.operand, scope)
                return convert(code, operand, widest((operand.type, INT)))
            case ast.UnaryOp(op=ast.Not()):
                return code.op(BOOL, f"xor i1 {truth(code, self.number(node.operand, scope)).text}, true")
            case ast.BoolOp():
                return self.logic(node, scope)
            case ast.Compare():
                return self.comparison(node, scope)
            case ast.IfExp():
                one, other = code.name("b"), code.name("b")
                self.test(node.test, one, other, scope)
                return self.value_of_branches(((one, node.body), (other, node.orelse)), scope)
            case ast.Call():
                result = self.call(node, scope)
                if result is None:
                    raise self.cannot(node, "returns nothing")
                return result
        raise self.cannot(node, "is not an expression that can be compiled")

    def variable(self, node: ast.Name, scope: Variables) -> Value:
        kind = scope.get(node.id)
        if isinstance(kind, Array):
            return kind
        if isinstance(kind, tuple):
            return Tuple(tuple(self.load(f"{node.id}.{k}", part) for k, part in enumerate(kind)))
        if kind is not None:
            return self.load(node.id, kind)
        if node.id in NAMES:
            return floating(NAMES[node.id])
        if node.id in scope:
            raise self.cannot(node, "is a tuple on one path and a number on another")
        if node.id not in self.assigned:
            raise self.cannot(node, "is undefined here")
        self.unset.add(node.id)
        return Number(BOOL, "undef")

    def slot(self, name: str, type_: str) -> str:
        slot = f'%"{name}.{type_}"'
        self.code.slots[slot] = type_
        return slot

    def load(self, name: str, type_: str) -> Number:
        return self.code.op(type_, f"load {type_}, ptr {self.slot(name, type_)}")

    def item(self, node: ast.Subscript, scope: Variables) -> Value:
        owner = self.value(node.value, scope)
        if isinstance(owner, Array):
            return self.code.op(FLOAT, f"load double, ptr {self.entry(owner, node.slice, scope)}")
        if isinstance(owner, Tuple):
            return self.entry_of_tuple(owner, self.number(node.slice, scope))
        if owner.text == "undef":
            return owner
        raise self.cannot(node, "is not an entry of a buffer")

    def entry_of_tuple(self, items: Tuple, index: Number) -> Number:
        """Write the selection of a number of a tuple; if the index is out of range, the last number is selected."""
        *first, value = items.parts
        if index.text.isdigit() and int(index.text) < len(items.parts):
            return items.parts[int(index.text)]
        for k, part in reversed(list(enumerate(first))):
            value = select(self.code, compare(self.code, ast.Eq(), index, constant(k)), part, value)
        return value

    def entry(self, array: Array, index: ast.expr, scope: Variables) -> str:
        """Write the computation of the address of a buffer's entry, and return the register."""
        number = self.number(index, scope)
        if number.type == FLOAT:
            raise self.cannot(index, "is not an integer, as an index must be")
        number = convert(self.code, number, INT)
        return self.code.op("ptr", f"getelementptr inbounds double, ptr {array.text}, i64 {number.text}").text

    def value_of_branches(self, ways: Iterable[tuple[str, ast.expr]], scope: Variables) -> Number:
        """Write branches, each with a label and an expression, and return the value of the branch that is taken."""
        code, end = self.code, self.code.name("b")
        edges = []
        for label, node in ways:
            code.begin(label)
            edges.append(self.edge(self.number(node, scope)))
        return self.meet(end, edges)

    def edge(self, number: Number) -> tuple[int, str, Number]:
        """Reserve a line for the jump at the end of a branch, which `meet` writes when all types are known.

        Returns:
            Index of the line, label of the branch's block, and value of the branch.
        """
        self.code.lines.append("")
        return len(self.code.lines) - 1, self.code.block, number

    def meet(self, end: str, edges: Sequence[tuple[int, str, Number]]) -> Number:
        code = self.code
        to = widest([number.type for _, _, number in edges])
        sources = []
        for place, block, number in edges:
            value, text = self.detached(lambda n=number: convert(code, n, to))  # type: ignore[misc]
            code.lines[place] = "\n".join([*text, f"  br label {end}"])
            sources.append(f"[ {value.text}, {block} ]")
        code.begin(end)
        return code.op(to, f"phi {to} {', '.join(sources)}")

    def detached(self, write: Callable[[], Number]) -> tuple[Number, list[str]]:
        """Call `write`, and move the lines that it writes from the text to a list.

        Returns:
            Number that `write` returned, and the list of lines.
        """
        mark = len(self.code.lines)
        number = write()
        text = self.code.lines[mark:]
        del self.code.lines[mark:]
        return number, text

    def logic(self, node: ast.BoolOp, scope: Variables) -> Number:
        """Write `and` or `or`. The value is the first operand that decides; later operands are not evaluated."""
        code, end = self.code, self.code.name("b")
        stops = isinstance(node.op, ast.Or)
        number = self.number(node.values[0], scope)
        edges = []
        for part in node.values[1:]:
            if number.type == BOOL and _harmless(part):
                other = self.number(part, scope)
                number = select(code, number, *((number, other) if stops else (other, number)))
                continue
            test, on, off = truth(code, number), code.name("b"), code.name("b")
            code.choose(test, off if stops else on, on if stops else off)
            code.begin(off)
            edges.append(self.edge(number))
            code.begin(on)
            number = self.number(part, scope)
        return self.meet(end, [*edges, self.edge(number)]) if edges else number

    def comparison(self, node: ast.Compare, scope: Variables) -> Number:
        code, end = self.code, self.code.name("b")
        left = self.number(node.left, scope)
        edges = []
        outcome = Number(BOOL, "true")
        for k, (op, part) in enumerate(zip(node.ops, node.comparators, strict=True)):
            if isinstance(op, ast.Is | ast.IsNot | ast.In | ast.NotIn):
                raise self.cannot(node, "is not a comparison of numbers")
            if k > 0 and not _harmless(part):
                no, on = code.name("b"), code.name("b")
                code.choose(outcome, on, no)
                code.begin(no)
                edges.append(self.edge(Number(BOOL, "false")))
                code.begin(on)
                outcome = Number(BOOL, "true")
            right = self.number(part, scope)
            this = compare(code, op, left, right)
            outcome = this if outcome.text == "true" else code.op(BOOL, f"and i1 {outcome.text}, {this.text}")
            left = right
        return self.meet(end, [*edges, self.edge(outcome)]) if edges else outcome

    def test(self, node: ast.expr, one: str, other: str, scope: Variables) -> None:
        """Write a jump to the label `one` if an expression is true, and to the label `other` if not."""
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            self.test(node.operand, other, one, scope)
        elif isinstance(node, ast.BoolOp) and not all(map(_harmless, node.values)):
            *first, last = node.values
            for part in first:
                following = self.code.name("b")
                if isinstance(node.op, ast.And):
                    self.test(part, following, other, scope)
                else:
                    self.test(part, one, following, scope)
                self.code.begin(following)
            self.test(last, one, other, scope)
        else:
            self.code.choose(truth(self.code, self.number(node, scope)), one, other)

    def call(self, node: ast.Call, scope: Variables) -> Number | Tuple | None:
        """Write a call, and return its value; None if the function returns nothing."""
        if node.keywords:
            raise self.cannot(node, "has a keyword argument")
        arguments = [self.value(a, scope) for a in node.args]
        if isinstance(node.func, ast.Name) and self.functions.has(node.func.id):
            return self.own(node, node.func.id, arguments)
        numbers = [a for a in arguments if isinstance(a, Number)]
        if len(numbers) == len(arguments) and numbers:
            number = None
            if isinstance(node.func, ast.Name):
                number = self.builtin(node.func.id, numbers)
            elif ast.unparse(node.func) == "math.frexp" and len(numbers) == 1:
                return Tuple(mantissa_and_exponent(self.code, convert(self.code, numbers[0], FLOAT)))
            elif isinstance(node.func, ast.Attribute) and ast.unparse(node.func.value) == "math":
                number = mathematical(self.code, node.func.attr, numbers)
            if number is not None:
                return number
        raise self.cannot(node, "calls a function that cannot be compiled with these arguments")

    def builtin(self, name: str, numbers: Sequence[Number]) -> Number | None:
        code = self.code
        if name in ("min", "max") and len(numbers) > 1:
            return extreme(code, name, numbers)
        if len(numbers) != 1:
            return None
        [number] = numbers
        match name:
            case "abs":
                return absolute(code, number)
            case "int":
                return truncated(code, number)
            case "float":
                return convert(code, number, FLOAT)
            case "bool":
                return truth(code, number)
        return None

    def own(self, node: ast.Call, name: str, arguments: Sequence[Value]) -> Number | Tuple | None:
        """Write a call of another function of the program, and return its value; None if it returns nothing."""
        function = self.functions.function_for(name, arguments, lambda why: self.cannot(node, why))
        operands = ", ".join(f"ptr {a.text}" if isinstance(a, Array) else f"{a.type} {a.text}" for a in flat(arguments))
        text = f'call {result_type(function.result)} @"{function.name}"({operands})'
        if function.result is None:
            self.code.put(text)
            return None
        if isinstance(function.result, str):
            return self.code.op(function.result, text)
        whole = self.code.op("", text).text
        kind = result_type(function.result)
        return Tuple(tuple(self.code.op(t, f"extractvalue {kind} {whole}, {k}") for k, t in enumerate(function.result)))


def result_type(result: Type) -> str:
    """Return the LLVM type of a function's result."""
    if result is None:
        return "void"
    return result if isinstance(result, str) else f"{{ {', '.join(result)} }}"


def flat(values: Iterable[Value]) -> list[Number | Array]:
    return [part for value in values for part in (value.parts if isinstance(value, Tuple) else (value,))]


def _harmless(node: ast.expr) -> bool:
    """Return whether an expression may be evaluated even if its value is not needed.

    Such an expression contains no entry of a buffer, no call, and none of the operators `/` and `**`.
    """
    if not isinstance(node, ast.Compare | ast.BoolOp | ast.UnaryOp | ast.Name | ast.Constant):
        return False
    inner = (n for n in ast.walk(node) if isinstance(n, ast.Call | ast.Subscript | ast.IfExp | ast.Div | ast.Pow))
    return next(inner, None) is None
