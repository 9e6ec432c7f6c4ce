"""Whole samples of scenes: specialised, compiled and as they are written, all the same bits."""

from __future__ import annotations

import ast
import math
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.assembly.build import build
from graspfx.compile.native import compiled, interpreted
from graspfx.compile.specialise.specialise import Program
from graspfx.compile.specialise.values import Dynamic, Memory, Static
from graspfx.coupling.grasp_state import FingerState, GraspState
from graspfx.coupling.sample import sample
from graspfx.errors import InputError

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
def test_a_sample_is_the_same_specialised_and_compiled(name: str) -> None:
    states = SCENES[name]
    rng = np.random.default_rng(0)
    with build(gx.load(name)) as servo:
        grasped = servo.objects[0].grasped
        S = grasped.block
        program: Any = Program()
        program.add(sample, [Memory("MEM", 0), Static(0)])
        source = program.source()
        blocks = [S.copy() for _ in range(3)]
        plain = GraspState(memoryview(blocks[0]))
        runs = [lambda: sample(plain), interpreted(source).bind(blocks[1]).brief]
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
            pressed += bool(np.any(plain.fingers.array(FingerState.force)))
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
    MEM = S[o] + 1.0
    S[o] = MEM * MEM


def itself(S: Any, o: int) -> None:
    itself(S, o + 1)


def turns_over_entries(S: Any, o: int) -> None:
    for x in (S[o], S[o + 1]):
        S[o + 1] = S[o + 1] + x


def moves_on(S: Any, o: int) -> None:
    o, S[o] = o + 1, 9.0


def looks_back(S: Any, o: int) -> None:
    S[o] = S[-1]


@pytest.mark.parametrize("kernel", [lists, itself, shadows, turns_over_entries, moves_on, looks_back])
def test_what_no_kernel_may_hold_is_said_with_file_and_line(kernel: object) -> None:
    with pytest.raises(InputError, match=r"test_compile_specialise\.py:\d+"):
        Program().add(kernel, [Memory("MEM", 0), Static(0)])  # type: ignore[arg-type]


@pytest.mark.parametrize("unroll", [1, 4])
@pytest.mark.parametrize("x", [0.0, -0.0, 3.0])
def test_folding_changes_no_value_and_drops_no_effect(x: float, unroll: int) -> None:
    program: Any = Program(unroll)
    program.add(edges, [Memory("MEM", 0), Static(1), Static(1), Static(0.0)])
    source = program.source()
    A = np.arange(16.0) / 8.0
    A[2] = x
    B, C = A.copy(), A.copy()
    edges(memoryview(A), 1, 1, 0.0)
    interpreted(source).bind(B).brief()
    compiled(source).bind(C).brief()
    np.testing.assert_array_equal(A.view(np.int64), B.view(np.int64))
    np.testing.assert_array_equal(A.view(np.int64), C.view(np.int64))


def test_what_is_asked_for_its_effect_is_asked() -> None:
    program: Any = Program()
    program.add(asks_for_effect, [Memory("MEM", 0), Static(0)])
    A, B = np.zeros(3), np.zeros(3)
    asks_for_effect(memoryview(A), 0)
    interpreted(program.source()).bind(B).brief()
    assert A.tolist() == B.tolist() == [2.0, 2.0, 1.0]


@pytest.mark.parametrize("kind", [0, 1, 2])
def test_what_is_known_leaves_no_trace(kind: int) -> None:
    program: Any = Program(unroll=4)
    made = program.add(chooses, [Memory("MEM", 10), Static(0), Static(kind)])
    assert isinstance(made.result, Static) and made.result.value == kind
    source = program.source()
    assert ("sqrt" in source, "-1.5" in source, "for" in source) == (kind == 1, kind == 2, False)
    A = np.arange(16.0) / 4.0
    A[14] = 3.0
    B, C = A.copy(), A.copy()
    chooses(memoryview(A), 10, kind)
    interpreted(source).bind(B).brief()
    compiled(source).bind(C).brief()
    np.testing.assert_array_equal(A, B)
    np.testing.assert_array_equal(A, C)


def runs_over(S: Any, o: int, n: int) -> float:
    total = 0.0
    for i in range(n):
        S[o + i] = 2.0 * S[o + i]
        total += S[o + i]
    return total


@pytest.mark.parametrize(("most", "loops"), [(7, 1), (8, 0)])
def test_a_loop_is_written_out_if_that_is_little(most: int, loops: int) -> None:
    program: Any = Program(unroll=most)
    program.add(runs_over, [Memory("MEM", 0), Static(0), Static(4)])
    assert program.source().count("for ") == loops


def two_buffers(S: Any, Z: Any) -> float:
    S[1] = 3.0 * S[0] + Z[0]
    return S[1]


def test_arrays_share_the_functions_of_one_array() -> None:
    text = """
def run(k):
    value = two(A, F) + one(A) + one(B) + two(A, B)
    F[1] = value
"""
    program: Any = Program()
    names = {name: Memory(name, 0) for name in "ABF"}
    entry = [Dynamic(ast.Name("k", ast.Load()))]
    program.add_text(text, {**names, "two": two_buffers, "one": one_buffer}, entry)
    source = program.source()
    assert (source.count("def two_buffers"), source.count("def one_buffer")) == (2, 1)
    blocks = {name: np.array([number, 7.0]) for name, number in zip("ABF", (1.0, 2.0, 0.5), strict=True)}
    namespace: dict[str, Any] = {}
    exec(source, namespace)
    native = compiled(source)
    for run in (lambda *b: namespace["run"](*b, 0), lambda *b: native.bind(*b).brief(0)):
        these = {name: block.copy() for name, block in blocks.items()}
        run(*(these[name] for name in native.arrays))
        assert [these[name][1] for name in "ABF"] == [5.0, 4.0, 3.5 + 2.0 + 4.0 + 5.0]


def one_buffer(S: Any) -> float:
    S[1] = 2.0 * S[0]
    return S[1]
