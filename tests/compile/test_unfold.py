"""Stages unfolded into programs: the same text as written out by hand, the same numbers as run as they stand."""

from __future__ import annotations

import importlib.util
import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from graspfx.compile.records import Record
from graspfx.compile.unfold.expression import Expression, literal
from graspfx.compile.unfold.stage import stage
from graspfx.compile.unfold.unfold import unfold
from graspfx.errors import InputError

FloatArray = NDArray[np.float64]


class Memories:
    """Names of two arrays and of kernels."""

    def __init__(self) -> None:
        self.a, self.b = np.arange(1.0, 9.0), np.arange(0.5, 4.5)
        self.kernels: dict[str, Callable[..., Any]] = {}

    def place(self, array: FloatArray) -> tuple[str, int]:
        for name, memory in (("A", self.a), ("B", self.b)):
            first = (array.__array_interface__["data"][0] - memory.__array_interface__["data"][0]) // 8
            if 0 <= first <= len(memory) - len(array):
                return name, first
        raise AssertionError(array)

    def kernel(self, function: Callable[..., Any]) -> str:
        self.kernels[function.__name__] = function
        return function.__name__

    def variable(self, name: str) -> str:
        return f"{name}_" if name in self.kernels else name

    def text(self, function: Callable[..., None], **parts: object) -> list[str]:
        return [line.text for line in unfold(function, self, **parts)]

    def run(self, lines: Sequence[str], **variables: object) -> None:
        """Execute a program on the two arrays."""
        exec("\n".join(lines), {"A": self.a, "B": self.b, "math": math, **self.kernels, **variables})


@dataclass
class Part:
    """A part that a stage loops over."""

    memory: FloatArray
    scale: float = 2.0
    index: int = 0
    extra: FloatArray | None = None
    inner: list[int] = field(default_factory=list)


def double(S: Any, o: int) -> float:
    S[o] *= 2.0
    return float(S[o])


@stage
def total(part: Part) -> Any:
    """Sum the first entries."""
    number = part.memory[0] * part.scale
    for k in part.inner:
        number += part.memory[k] * part.scale
    return number


@stage
def whole(parts: Sequence[Part], k: int, A: FloatArray) -> None:
    """Go through every kind of statement."""
    for i, part in enumerate(parts):
        number = total(part)
        if k > 0 and part.memory[0] != 0.0:
            A[part.index] = -number + (k - 1) * 0.5 / (number + 1.0)
            if part.extra is not None:
                part.extra[i] = A[part.index]
        elif part.extra is None:
            A[part.index] += 1.0
        else:
            part.extra[-1] -= math.sqrt(abs(number)) + max(number, 0.25)
        code = double(A, 2 + i)
        if code > 6.0 or not (k < 3 and code == 2.0):
            A[part.index] = A[part.index] * code
        if part.scale == 2.0:
            continue
        A[7] -= k % 2 + k // 2


def parts(memories: Memories) -> list[Part]:
    return [
        Part(memories.a[1:4], inner=[1, 2]),
        Part(memories.b[1:], 3.0, 1, memories.b, inner=list(range(1, 3))),
        Part(memories.b, 0.0, 2),
    ]


@pytest.mark.parametrize("k", range(4))
def test_a_program_does_what_the_stage_does(k: int) -> None:
    """Bit by bit; the stage itself runs on numpy's numbers, the program on the same arrays."""
    written, unfolded = Memories(), Memories()
    whole(parts(written), k, written.a)
    unfolded.run(unfolded.text(whole, parts=parts(unfolded), A=unfolded.a), k=k)
    assert written.a.tobytes() + written.b.tobytes() == unfolded.a.tobytes() + unfolded.b.tobytes()


def test_the_text_is_that_of_a_program_written_by_hand() -> None:
    memories = Memories()
    assert memories.text(whole, parts=parts(memories)[1:2], A=memories.a) == [
        "number = B[1] * 3.0",
        "number += B[2] * 3.0",
        "number += B[3] * 3.0",
        "if k > 0 and B[1] != 0.0:",
        "    A[1] = -number + (k - 1) * 0.5 / (number + 1.0)",
        "    B[0] = A[1]",
        "else:",
        "    B[3] -= math.sqrt(abs(number)) + max(number, 0.25)",
        "code = double(A, 2)",
        "if code > 6.0 or not (k < 3 and code == 2.0):",
        "    A[1] = A[1] * code",
        "A[7] -= k % 2 + k // 2",
    ]


def test_an_inner_stage_has_variables_of_its_own() -> None:
    memories = Memories()
    text = memories.text(outer, A=memories.a)
    assert text == ["number = A[0]", "tripled = A[2] * 3.0", "number_ = tripled + 1.0", "A[2] = 100.0", "A[0] = 7.0",
                    "A[1] = number_", "A[0] = number"]  # fmt: skip


@stage
def outer(A: FloatArray) -> None:
    number = A[0]
    inner(A, A[2] * 3.0)
    A[0] = number


@stage
def inner(A: FloatArray, tripled: float) -> None:
    number = tripled + 1.0
    A[2] = 100.0  # of which `tripled` was computed before
    A[0] = 7.0
    A[1] = number


def test_a_line_names_the_stage_and_its_line() -> None:
    """A stage that another one calls tells its lines; what is called further inside counts as the line of the call."""
    lines = unfold(deep, memories := Memories(), A=memories.a)
    assert {line.origin.file for line in lines} == {__file__}
    first = {"deep": deep.__code__.co_firstlineno, "outer": outer.__code__.co_firstlineno}
    places = [(line.origin.stage, line.origin.line - first[line.origin.stage]) for line in lines]
    assert places == [("deep", 2), ("outer", 2), *[("outer", 3)] * 5, ("outer", 4)]


@stage
def deep(A: FloatArray) -> None:
    A[7] = 0.0
    outer(A)


class Pair(Record):
    x: float
    y: float


@stage
def with_record(A: FloatArray, pair: Pair) -> None:
    double(pair, 1)


def test_a_record_is_its_memory_and_its_offset() -> None:
    memories = Memories()
    assert memories.text(with_record, A=memories.a, pair=Pair(memories.b, 2)) == ["double(B, 2, 1)"]


# What cannot be -------------------------------------------------------------------------------------------------------


@stage
def a_choice_in_python(A: FloatArray) -> None:
    A[0] = 1.0 if A[1] else 2.0


@stage
def a_chain(A: FloatArray) -> None:
    A[0] = 0.0 < A[1] < 2.0


@stage
def a_way_out(A: FloatArray) -> None:
    for k in range(3):
        if A[k] == 0.0:
            continue
        A[k] = 1.0


@stage
def unsettled(A: FloatArray) -> None:
    index = 0
    if A[1] == 0.0:
        index = 1
    A[index] = 1.0


@stage
def unsettled_test(A: FloatArray) -> None:
    flag = False
    if A[1] == 0.0:
        flag = True
    if flag:
        A[0] = 1.0


@stage
def beyond(A: FloatArray) -> None:
    A[8] = 1.0


@stage
def a_stage_inside(A: FloatArray) -> None:
    A[0] = A[0] + store_and_give(A)


@stage
def store_and_give(A: FloatArray) -> Any:
    A[0] = 5.0
    return A[0]


@stage
def over_numbers(A: FloatArray) -> None:
    for number in A:
        A[0] = number


@stage
def idle(A: FloatArray) -> None:
    A[0] + 1.0


@stage
def a_loop(A: FloatArray) -> None:
    while A[0] > 0.0:
        A[0] -= 1.0


@stage
def a_foreign_call(A: FloatArray) -> None:
    A[0] = np.sin(A[1])


@stage
def names_for_a_kernel(A: FloatArray) -> None:
    double(A, o=1)


@stage
def a_piece_for_a_kernel(A: FloatArray) -> None:
    double(A[1:], 0)


@stage
def infinite(A: FloatArray) -> None:
    A[0] = math.inf


@stage
def no_such_thing(A: FloatArray) -> None:
    A[0] = A.breadth  # type: ignore[attr-defined]


@stage
def an_index_by_number(A: FloatArray) -> None:
    A[0] = [1.0, 2.0][int(A[1])]


@pytest.mark.parametrize(
    ("function", "line", "message"),
    [
        (a_choice_in_python, 2, "a choice that the parts settle"),
        (a_chain, 2, "an expression of a stage"),
        (a_way_out, 4, "choices around it that the parts settle"),
        (unsettled, 5, "one that the parts settle"),
        (unsettled_test, 5, "one that the parts settle"),
        (beyond, 2, "an entry of 8"),
        (a_stage_inside, 2, "a statement of its own for the call"),
        (over_numbers, 2, "parts to go through"),
        (idle, 2, "a number alone does nothing"),
        (a_loop, 2, "a statement of a stage"),
        (a_foreign_call, 2, "a kernel, a stage, or a function of mathematics"),
        (names_for_a_kernel, 2, "arguments in order"),
        (a_piece_for_a_kernel, 2, "a whole memory"),
        (infinite, 2, "a finite number"),
        (no_such_thing, 2, "no attribute 'breadth'"),
        (an_index_by_number, 2, "an expression of a stage"),
    ],
)
def test_what_no_stage_can_do_is_an_error_with_its_line(function: Callable[..., None], line: int, message: str) -> None:
    memories = Memories()
    with pytest.raises(InputError, match=message) as caught:
        unfold(function, memories, A=memories.a)
    code = function.__code__
    assert str(caught.value).startswith(f"{code.co_filename}:{code.co_firstlineno + line}: ")


def test_a_variable_of_one_branch_may_be_read_in_it_and_set_again_after_it() -> None:
    memories = Memories()
    text = memories.text(a_variable_of_a_branch, A=memories.a)
    assert text == [
        "if A[0] == 0.0:",
        "    code = double(A, 1)",
        "    A[2] = code",
        "code = double(A, 3)",
        "A[4] = code",
    ]


@stage
def a_variable_of_a_branch(A: FloatArray) -> None:
    if A[0] == 0.0:
        code = double(A, 1)
        A[2] = code
    code = double(A, 3)
    A[4] = code


def test_a_file_that_has_changed_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "stages_of_old.py"
    file.write_text("from graspfx.compile.unfold.stage import stage\n\n@stage\ndef set_first(A):\n    A[0] = 1.0\n")
    module = load(file)
    memories = Memories()
    os.utime(file, ns=(1, 1))
    with pytest.raises(InputError, match="has changed since: start anew"):
        unfold(module.set_first, memories, A=memories.a)


def load(file: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(file.stem, file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("value", "text"),
    [(True, "True"), (-3, "-3"), (np.int64(4), "4"), (0.1, "0.1"), (-0.0, "-0.0"), (np.float64(1e300), "1e+300")],
)
def test_numbers_are_written_so_that_python_reads_the_same(value: Any, text: str) -> None:
    assert literal(value).text == text
    assert repr(eval(text)) == repr(value.item() if isinstance(value, np.generic) else value)


def test_brackets_stand_where_they_are_needed() -> None:
    a, b = Expression("a"), Expression("b")
    assert str((a + b) * 2.0 - (a - (b - 1))) == "(a + b) * 2.0 - (a - (b - 1))"
    assert str(-(a * b) / -a) == "-(a * b) / -a"
    assert str(np.int64(2) * (a < b + np.float64(0.5))) == "2 * (a < b + 0.5)"
    assert str(1 - a // 2 % b) == "1 - a // 2 % b"
