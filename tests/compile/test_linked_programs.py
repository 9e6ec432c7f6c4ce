"""Kernels linked to one program: interpreted, compiled and as they are written, all the same bits."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.assembly.build import build
from graspfx.compile.native import compiled
from graspfx.compile.program import Program
from graspfx.coupling.grasp_state import FingerState, GraspState
from graspfx.coupling.sample import sample
from graspfx.errors import InputError
from tests.support.plain_programs import plain


def linked(call: str, arrays: str = "M", **kernels: Any) -> str:
    """The source of a program of one line, on buffers with names of one letter."""
    program = Program()
    program.add_text(f"def run():\n    {call}", kernels, list(arrays))
    return program.source()


SCENES = {  # how many states
    "reference-1dof": 200,
    "paper-waving": 200,
    "knob": 150,
    "mug": 60,
    "soft-pinch": 150,
    "thin-plate": 40,
    "twenty-fingers": 10,
}


@pytest.mark.parametrize("name", SCENES)
def test_a_sample_is_the_same_linked_and_compiled(name: str) -> None:
    states = SCENES[name]
    rng = np.random.default_rng(0)
    with build(gx.load(name)) as servo:
        grasped = servo.objects[0].grasped
        S = grasped.block
        source = linked("return sample(M, 0)", sample=sample)
        blocks = [S.copy() for _ in range(3)]
        written = GraspState(memoryview(blocks[0]))
        runs = [lambda: sample(written), plain(source, blocks[1])]
        runs.append(compiled(source).bind(blocks[2]).brief)
        n, d = grasped.fingers, grasped.dimensions
        contacts = grasped.array(FingerState.contact)[:, :d].copy()
        pressed = 0
        for _ in range(states):
            offset = rng.normal(size=(n, d)) * 10.0 ** rng.uniform(-4.0, -1.5)
            inwards = rng.uniform(0.9, 1.05)
            for block in blocks:
                grasp = GraspState(block)
                grasp.fingers.array(FingerState.position)[:, :d] = contacts * inwards + offset
                grasp.fingers.array(FingerState.velocity)[:, :d] = offset * 10.0
                grasp.body.motion.position[0] = offset[0, 0]
            faults = {run() for run in runs}
            assert len(faults) == 1
            pressed += bool(np.any(written.fingers.array(FingerState.force)))
            for block in blocks[1:]:
                np.testing.assert_array_equal(block, blocks[0])
        assert pressed > states // 2


def chooses(S: Any, o: int, kind: int) -> int:
    S[o + 5] = kind
    if kind == 1:
        S[o + 1] = math.sqrt(S[o + 2])
    elif kind == 2:
        S[o + 1] = S[o + 2] ** -1.5
    for k in range(kind):
        S[o + 3] += k * (-2.0) ** S[o + 4]
    return kind


def first_turn(S: Any, o: int) -> float:
    for k in range(3):
        S[o] += 1.0
        return S[o] + k
    return 0.0


def same_for_all(a: float) -> float:
    return 7.0


def edges(S: Any, o: int, on: int, zero: float) -> None:
    x = S[o + 1]
    S[o + 2] = (x and on) + (x or zero) * -1.0
    S[o + 3] = (on and x) or zero
    if x < 0.0:  # never: what would raise there is not to raise before
        S[o + 4] = math.sqrt(-1.0 - zero) + int(1.0 / zero) + (-1.0) ** 0.5
    S[o + 5] = first_turn(S, o + 6) + same_for_all(first_turn(S, o + 7))
    if first_turn(S, o + 8) > 1.0:
        pass
    S[o + 9] = S[o + int(x) - 1] * (-x) ** 2.0


def counts(S: Any, o: int) -> tuple[float, float]:
    S[o] = S[o] + 1.0
    return 1.0, S[o]


def asks_for_effect(S: Any, o: int) -> None:
    two = 2.0
    S[o + 1] = 2.0 if counts(S, o)[1] > 0.0 else two
    S[o + 2] = counts(S, o)[0]


def lists(S: Any, o: int) -> None:
    S[o] = sum([S[o], 1.0])


def shadows(S: Any, o: int) -> None:
    M = S[o] + 1.0
    S[o] = M * M


def itself(S: Any, o: int) -> None:
    itself(S, o + 1)


def turns_over_entries(S: Any, o: int) -> None:
    for x in (S[o], S[o + 1]):
        S[o + 1] = S[o + 1] + x


def moves_on(S: Any, o: int) -> None:
    o, S[o] = o + 1, 9.0


def looks_back(S: Any, o: int) -> None:
    S[o] = S[-1]


def shifts(S: Any, o: int) -> None:
    S[o] = S[o] * (o << 1)


def misses(S: Any, o: int) -> None:
    same_for_all()  # type: ignore[call-arg]


def asks_for_much(S: Any, o: int) -> None:
    same_for_all(1.0, b=2.0)  # type: ignore[call-arg]


def names_an_argument(S: Any, o: int) -> None:
    S[o] = min(S[o], S[o + 1], key=abs)


def holds_another(S: Any, o: int) -> None:
    def inner(x: float) -> float:
        return x

    S[o] = inner(S[o])


def holds_a_function(S: Any, o: int) -> None:
    f = math.sqrt
    S[o] = f(S[o])


@pytest.mark.parametrize(
    "kernel",
    [
        lists,
        itself,
        turns_over_entries,
        looks_back,
        shifts,
        misses,
        asks_for_much,
        names_an_argument,
        holds_another,
        holds_a_function,
    ],
)
def test_what_no_kernel_may_hold_is_said_with_file_and_line(kernel: Any) -> None:
    with pytest.raises(InputError, match=r"test_linked_programs\.py:\d+"):
        Program().add(kernel)


def agree(kernel: Any, call: str, A: np.ndarray, *arguments: float) -> None:
    """As written, linked and compiled a kernel leaves the same bits in a buffer."""
    source = linked(call, kernel=kernel)
    B, C = A.copy(), A.copy()
    kernel(memoryview(A), *arguments)
    plain(source, B)()
    compiled(source).bind(C).brief()
    np.testing.assert_array_equal(A.view(np.int64), B.view(np.int64))
    np.testing.assert_array_equal(A.view(np.int64), C.view(np.int64))


@pytest.mark.parametrize("x", [0.0, -0.0, 3.0])
def test_logic_and_constants_keep_their_values(x: float) -> None:
    A = np.arange(16.0) / 8.0
    A[2] = x
    agree(edges, "kernel(M, 1, 1, 0.0)", A, 1, 1, 0.0)


@pytest.mark.parametrize("kernel", [asks_for_effect, shadows, moves_on])
def test_effects_take_place_in_their_order(kernel: Any) -> None:
    agree(kernel, "kernel(M, 0)", np.array([0.5, 0.25, 4.0]), 0)


@pytest.mark.parametrize("kind", [0, 1, 2])
def test_branches_on_constants(kind: int) -> None:
    A = np.arange(16.0) / 4.0
    A[14] = 3.0
    agree(chooses, f"kernel(M, 10, {kind})", A, 10, kind)


def shared(a: float, b: float = 2.0, c: float = -0.0) -> float:
    return a / b + c


def varies(S: Any, o: int) -> None:
    x, y = (S[o], S[o + 1]) if S[o] > S[o + 1] else (S[o + 1], 0.0)
    for factor in (1.0, -2.0, y):
        x += factor * x
    a = b = shared(x, c=y)
    S[o], S[o + 1] = a + shared(x), b * shared(c=1.0, a=y)
    inner: int = 1
    S[o + 2] += shared(x, inner)


@pytest.mark.parametrize("first", [0.5, -3.0])
def test_defaults_keywords_and_tuples(first: float) -> None:
    agree(varies, "kernel(M, 0)", np.array([first, 0.25, 4.0]), 0)


def two_buffers(S: Any, Z: Any) -> float:
    S[1] = 3.0 * S[0] + Z[0]
    return S[1]


def one_buffer(S: Any) -> float:
    S[1] = 2.0 * S[0]
    return S[1]


def test_functions_are_shared_and_unused_buffers_left_out() -> None:
    text = """
def run(k):
    value = two(A, F) + one(A) + one(B) + two(A, B)
    F[1] = value + k
"""
    program = Program()
    program.add_text(text, {"two": two_buffers, "one": one_buffer}, "AUBF")
    source = program.source()
    assert (source.count("def two_buffers"), source.count("def one_buffer")) == (1, 1)
    blocks = {name: np.array([number, 7.0]) for name, number in zip("ABF", (1.0, 2.0, 0.5), strict=True)}
    namespace: dict[str, Any] = {}
    exec(source, namespace)
    native = compiled(source)
    assert native.arrays == [*"ABF"]
    for run in (lambda *b: namespace["run"](*b, 0), lambda *b: native.bind(*b).brief(0)):
        these = {name: block.copy() for name, block in blocks.items()}
        run(*(these[name] for name in native.arrays))
        assert [these[name][1] for name in "ABF"] == [5.0, 4.0, 3.5 + 2.0 + 4.0 + 5.0]
