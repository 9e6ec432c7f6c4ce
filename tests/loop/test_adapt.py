"""Texts of C calls, and the machine code that makes them: signatures, verdicts, errors."""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from graspfx.compile.c_calls.c_signature import read_calls, read_comparisons
from graspfx.compile.emission import address, emitted, loaded
from graspfx.errors import InputError, MissingPackageError
from graspfx.loop import adapt as adapting
from graspfx.loop.adapt import adapt
from graspfx.loop.velocity import VelocityEstimator
from tests.support.optional import require

require("llvmlite")
if not sys.platform.startswith("linux"):
    pytest.skip("Python's loop runs elsewhere", allow_module_level=True)

TEXT = """
@codes = global [4 x i32] zeroinitializer
@counts = global [4 x i64] zeroinitializer
@seen = global [8 x double] zeroinitializer
@errors = global [4 x i32] zeroinitializer
@left = global i64 0
define internal i32 @noted(i64 %i) {
  %count = getelementptr [4 x i64], ptr @counts, i64 0, i64 %i
  %old = load i64, ptr %count
  %new = add i64 %old, 1
  store i64 %new, ptr %count
  %code.at = getelementptr [4 x i32], ptr @codes, i64 0, i64 %i
  %code = load i32, ptr %code.at
  ret i32 %code
}
define i32 @place(ptr %x, ptr %y, i8 signext %id) {
  store double 1000.0, ptr %x
  %wide = sitofp i8 %id to double
  store double %wide, ptr %y
  %code = call i32 @noted(i64 0)
  ret i32 %code
}
define i32 @rate(ptr %v) {
  store double 3.0, ptr %v
  %next = getelementptr double, ptr %v, i64 1
  store double 4.0, ptr %next
  %code = call i32 @noted(i64 1)
  ret i32 %code
}
define i32 @status(ptr %numbers, i16 zeroext %mask) {
  %five = getelementptr i32, ptr %numbers, i64 2
  %wide = zext i16 %mask to i32
  store i32 %wide, ptr %five
  ret i32 0
}
define signext i8 @push(double %x, float %y, i64 %big, ptr %both) {
  store double %x, ptr @seen
  %w = fpext float %y to double
  %one = getelementptr double, ptr @seen, i64 1
  store double %w, ptr %one
  %b = sitofp i64 %big to double
  %two = getelementptr double, ptr @seen, i64 2
  store double %b, ptr %two
  %last.at = getelementptr double, ptr %both, i64 1
  %last = load double, ptr %last.at
  %three = getelementptr double, ptr @seen, i64 3
  store double %last, ptr %three
  %code = call i32 @noted(i64 2)
  %small = trunc i32 %code to i8
  ret i8 %small
}
define void @quiet() {
  %code = call i32 @noted(i64 3)
  ret void
}
define double @half() {
  ret double 0.5
}
define { i64, i32 } @popped() {
  %n = load i64, ptr @left
  %none = icmp eq i64 %n, 0
  br i1 %none, label %empty, label %go
empty:
  ret { i64, i32 } zeroinitializer
go:
  %less = sub i64 %n, 1
  store i64 %less, ptr @left
  %at = getelementptr [4 x i32], ptr @errors, i64 0, i64 %less
  %code = load i32, ptr %at
  %wide = zext i32 %code to i64
  %dirty = or i64 %wide, 4294967296000
  %r = insertvalue { i64, i32 } zeroinitializer, i64 %dirty, 0
  ret { i64, i32 } %r
}
"""
NAMES = "place", "rate", "status", "push", "quiet", "half", "popped"
READ = "int place(out 0 * 0.001, out 1, i8 id); int rate(out 2:4 * 2)"
WRITE = "i8 push(in 0 * -1, float 0.5, i64 big, in 0:2 * 3)"
STOP = "i8 push(double 0, float 0, i64 0, double[2] zeros); void quiet()"


class Library:
    """A library in this process."""

    def __init__(self) -> None:
        self._engine = loaded([emitted(TEXT)], ())
        for name in NAMES:
            setattr(self, name, ctypes.CFUNCTYPE(ctypes.c_int)(address(self._engine, name)))

    def memory(self, name: str, kind: Any) -> Any:
        return kind.from_address(int(self._engine.get_global_value_address(name)))


@pytest.fixture
def library() -> Library:
    return Library()


def called(place: int, context: int) -> Callable[[np.ndarray[Any, Any]], int]:
    function = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_void_p, ctypes.c_void_p)(place)
    return lambda block: int(function(context, block.ctypes.data))


def adapted(library: object, **changes: Any) -> Any:
    texts = {"read": READ, "write": WRITE, "stop": STOP, "shape": (1, 2), "id": -3, "big": 2**40}
    whole = {**texts, **changes}
    if isinstance(whole["read"], str) and " id)" not in whole["read"]:
        del whole["id"]
    return adapt(library, **whole)


def test_arguments_arrive_as_c_declares_them(library: Library) -> None:
    """Signs, widths, factors, addresses, settings and constants, each to the bit."""
    calls = adapted(library)
    block = np.zeros(4)
    assert called(calls.read, calls.context)(block) == 0
    assert block.tolist() == [1.0, -3.0, 6.0, 8.0]
    assert called(calls.write, calls.context)(np.array([0.1, 0.2])) == 0
    seen = library.memory("seen", ctypes.c_double * 8)
    assert list(seen)[:4] == [-0.1, 0.5, 2.0**40, 3.0 * 0.2]
    assert called(calls.stop, calls.context)(np.array([7.0, 7.0])) == 0
    assert list(seen)[:4] == [0.0] * 4
    assert calls.ask == 0


@pytest.mark.parametrize(
    ("codes", "verdict", "text"),
    [
        ((0, 0), 0, ""), ((1, 0), 1, ""), ((0, 1), 1, ""), ((2, 0), 0, ""),
        ((-1, 0), -1, "place returns -1"), ((0, -1), -2, "rate returns -1"),
        ((1, -1), -2, "rate returns -1"), ((-1, 1), -1, "place returns -1"), ((1, -(2**31)), -2, "rate returns"),
    ],
)  # fmt: skip
def test_each_call_is_judged_by_itself(library: Library, codes: Any, verdict: int, text: str) -> None:
    """A 1, no new data, never hides a -1, whichever comes first; what comes after a fault is not called."""
    calls = adapted(library)
    library.memory("codes", ctypes.c_int32 * 4)[:2] = codes
    counts = library.memory("counts", ctypes.c_int64 * 4)
    before = counts[1]
    code = called(calls.read, calls.context)(np.zeros(4))
    assert code == verdict
    assert counts[1] - before == (codes[0] >= 0)
    if code < 0:
        assert calls.keep.fault_text(code).startswith(text)
        assert calls.keep.value(code) == min(codes)


def test_stop_tries_all_of_its_calls(library: Library) -> None:
    calls = adapted(library)
    library.memory("codes", ctypes.c_int32 * 4)[2] = -5
    counts = library.memory("counts", ctypes.c_int64 * 4)
    before = counts[3]
    code = called(calls.stop, calls.context)(np.zeros(2))
    assert code < 0
    assert calls.keep.fault_text(code) == "push returns -5"
    assert counts[3] == before + 1


def test_buffers_and_other_comparisons(library: Library) -> None:
    """A fault may be an entry of what a function filled; a result may be a float; conditions are the driver's."""
    read = "int status(i32[4] numbers, u16 mask); double half()"
    calls = adapted(library, read=read, fault="< 0 or numbers[2] == 0", mask=0)
    code = called(calls.read, calls.context)(np.zeros(4))
    assert calls.keep.fault_text(code) == "status gives numbers[2] = 0"
    calls = adapted(library, read=read, fault="< 0 or numbers[2] == 0", held="== 0.5", mask=0xFFFF)
    assert called(calls.read, calls.context)(np.zeros(4)) == 1
    assert calls.keep.buffer("numbers")[2] == 0xFFFF
    calls = adapted(library, read=read, fault="> 0.25", mask=1)
    code = called(calls.read, calls.context)(np.zeros(4))
    assert calls.keep.fault_text(code) == "half returns 0.5"


def test_a_stack_of_errors_is_emptied(library: Library) -> None:
    """After every call until it is empty; the oldest error is the fault."""
    calls = adapted(library, read="int rate(out 2:4)", errors="u32[3] popped()")
    assert called(calls.read, calls.context)(np.zeros(4)) == 0
    library.memory("errors", ctypes.c_uint32 * 4)[:3] = [0x302, 0x200, 0x201]
    left = library.memory("left", ctypes.c_int64)
    left.value = 3
    code = called(calls.read, calls.context)(np.zeros(4))
    assert calls.keep.fault_text(code) == "rate leaves error 0x302"
    assert left.value == 0


def test_velocities_are_the_estimators(library: Library) -> None:
    """Machine code goes on where Python's estimator stands, and the other way; samples that are held are counted."""
    memory, own, reference = np.zeros(2), *(VelocityEstimator(1e-3, (2,), 1e-4, 8) for _ in range(2))
    codes = library.memory("codes", ctypes.c_int32 * 4)
    places: list[Any] = []
    for i in range(20):
        held = i in (5, 6, 11)
        memory[:] = 1.0, -3.0 - i if i > 12 else -3.0
        if i == 8 or not places:
            places.append(adapted(library, read="int place(out 0 * 0.001, out 1, i8 id)", velocity=own))
        codes[0] = int(held)
        calls, block = places[-1], np.zeros(4)
        if i % 3:
            assert called(calls.read, calls.context)(block) == int(held)
        elif held:
            own.miss()
        else:
            block[2:] = own.update([1.0, -3.0])
        if held:
            reference.miss()
        else:
            assert np.array_equal(block[2:], reference.update([1.0, -3.0]))


def test_positions_that_were_missed_lie_on_a_line() -> None:
    """The estimate after a gap is that of the points between, as Force Dimension's driver always had it."""
    one, other = (VelocityEstimator(1e-3, (), 1e-5, 8) for _ in range(2))
    for x in (0.0, 1e-3):
        one.update(x)
        other.update(x)
    one.miss()
    one.miss()
    last = 1e-3
    new = 7e-3
    for k in (1, 2):
        other.update(last + (new - last) * (k / 3))
    assert float(one.update(new)) == float(other.update(new))


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "no text": ({"read": 3}, "given 3"),
    "no call": ({"read": ""}, "more expected at the end|'' expected|expected"),
    "an unknown type": ({"read": "number place(out 0)"}, "unknown type 'number'; known types: void, double"),
    "an unknown type of an argument": ({"read": "int place(quad x)"}, "unknown type 'quad'"),
    "an entry out of range": ({"read": "int place(out 4)"}, "entry 4 is out of range: the block has 4 entries"),
    "a range out of range": ({"write": "int push(in 0:3)"}, "entry 2 is out of range: the block has 2 entries"),
    "no closing bracket": ({"read": "int place(out 0"}, "',' expected at the end"),
    "something behind": ({"read": "int place(out 0) out"}, "';' expected before 'out'"),
    "a strange letter": ({"read": "int place(out 0) @"}, "'@' is not a valid token"),
    "a void argument": ({"read": "int place(void x)"}, "an argument cannot be void"),
    "half a whole number": ({"read": "int place(int 0.5)"}, "0.5 is not an integer, as i32 requires"),
    "an empty range": ({"read": "int place(out 2:2)"}, "entries 2:2 form an empty range"),
    "a struct of floats": ({"read": "double[3] place(out 0)"}, "two to four 32-bit numbers"),
    "a buffer of two sizes": (
        {"read": "int status(i32[4] b, u16 1); int status(i32[5] b, u16 1)"},
        "two types or sizes",
    ),
    "a function that is not there": ({"read": "int nowhere(out 0)"}, "a library with the C function nowhere"),
    "a setting that is missing": ({"read": "int place(out 0, out 1, i8 other)"}, "the settings named in the calls"),
    "a setting that is too large": ({"id": 128}, "a whole number in the range of i8"),
    "a comparison of nothing": ({"fault": "0 <"}, "a name expected, not '0'"),
    "a comparison with an unknown buffer": ({"fault": "b[0] == 1"}, r"not b\[0\]"),
    "an estimator of another size": ({"velocity": VelocityEstimator(1e-3, (3,))}, "an estimator of 2 components"),
}


@pytest.mark.parametrize("kind", WRONG)
def test_what_is_wrong_is_said(library: Library, kind: str) -> None:
    changes, says = WRONG[kind]
    with pytest.raises(InputError, match=says):
        adapted(library, **changes)


def test_a_library_of_python_is_none_of_c(library: Library) -> None:
    class Plain:
        place = rate = push = quiet = staticmethod(lambda: 0)

    with pytest.raises(InputError, match="a library with the C function place"):
        adapted(Plain())


def test_without_llvm_it_says_what_to_install(library: Library, monkeypatch: pytest.MonkeyPatch) -> None:
    def missing() -> None:
        raise MissingPackageError("llvmlite", "a compiled loop", "run `pip install llvmlite`")

    monkeypatch.setattr(adapting, "require_llvm", missing)
    with pytest.raises(MissingPackageError, match="llvmlite"):
        adapted(library)


def test_machine_code_comes_from_the_cache(library: Library, monkeypatch: pytest.MonkeyPatch) -> None:
    """Addresses and settings are in no program: another library's is the same."""
    adapted(library)
    monkeypatch.setattr(adapting, "emitted", lambda text: pytest.fail("compiled again"))
    calls = adapted(Library(), id=5)
    block = np.zeros(4)
    called(calls.read, calls.context)(block)
    assert block[1] == 5.0


def test_texts_read_as_they_are_written() -> None:
    [call] = read_calls("read", " unsigned_".replace("unsigned_", "uint") + " f ( ) ; ", 0)
    assert (call.result, call.name, call.arguments) == ("u32", "f", ())
    [first, second] = read_comparisons("fault", "< -1e-3 or n[2] >= 0x10")
    assert (first.sign, first.number, first.subject) == ("<", -1e-3, "")
    assert (second.sign, second.number, second.subject) == (">=", 16.0, "n[2]")
    assert read_comparisons("held", "") == ()
