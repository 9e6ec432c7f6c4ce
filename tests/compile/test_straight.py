"""Straight lines against the program that they were written down from."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from graspfx.batch.lanes import FIRST, HIGH, LANES, LAST, LATE_HIGH, LATE_LOW, LOW, MEASURES, SQUARES, SUM, lanes_text
from graspfx.compile.native import compiled, interpreted
from graspfx.compile.straight.straight import NotSteadyError, reduced, written_down
from graspfx.compile.straight.trace import Cells, Graph, Node, Traceable

STATISTICS = ("first", "last", "mean", "rms", "min", "max", "growth")
COUNT, EARLY = 41, 20

# A damped oscillator: switched on in the first turn, its rate from a series of as many terms as the lane needs.
OSCILLATOR = """
import math

def series(z):
    term, total, k = 1.0, 1.0, 1
    while abs(term) > 1e-17:
        term = term * z / k
        total = total + term
        k = k + 1
    return (total, term)

def check(S):
    if not math.isfinite(S[0] + 0.0 * S[9]) or not abs(S[1]) <= 1e150:
        S[7] = 1.0
    if S[6] == 0.0:
        S[6] = 1.0
        S[5] = S[2] + S[3]

def run(S, rows, k, count, r):
    for i in range(count):
        check(S)
        if S[7] == 0.0:
            decay, _ = series(-S[4])
            force = -S[5] * S[0] + 0.0 * S[1]
            S[1] = decay * S[1] + 0.01 * force
            S[0] = S[0] + 0.01 * S[1] / S[8]
            S[10] = S[10] + k
        rows[r * 3] = S[0]
        rows[r * 3 + 1] = max(S[0], S[1])
        rows[r * 3 + 2] = S[10]
        k = k + 1
        r = r + 1
"""
SIZE, WIDTH = 11, 3


def lanes_of(source, given, columns, *, same=()):
    """Measures and marks of lanes (V, SIZE) by the straight line written down from the first."""
    program = Traceable(source)
    turns = written_down(program, {"S": given[0]}, lambda slot: slot[1] in same, columns)
    text = lanes_text(program, turns, len(columns), STATISTICS)
    blocks = -(-len(given) // LANES)
    padded = np.vstack([given, np.repeat(given[-1:], blocks * LANES - len(given), axis=0)])
    inputs = padded[:, [k for _, k in text.inputs]].reshape(blocks, LANES, -1).swapaxes(1, 2).copy()
    out = np.zeros((blocks, text.outputs, LANES))
    native = compiled(text.source, wide=True)
    native.bind(inputs.reshape(-1), np.zeros(text.scratch), out.reshape(-1)).long(blocks, EARLY, COUNT - EARLY)
    out = out.swapaxes(1, 2).reshape(-1, text.outputs)[: len(given)]
    return out[:, :-1].reshape(len(given), len(columns), MEASURES), out[:, -1], turns


def rows_of(source, start):
    """Rows of one lane by the program itself."""
    S, rows = start.copy(), np.zeros((COUNT, WIDTH))
    interpreted(source).bind(S, rows.reshape(-1)).brief(0, COUNT, 0)
    return rows


def lanes(seed, count=70):
    random = np.random.default_rng(seed)
    given = np.zeros((count, SIZE))
    given[:, 0], given[:, 1] = random.normal(size=(2, count))
    given[:, 2], given[:, 3] = random.uniform(1.0, 50.0, (2, count))
    given[:, 4], given[:, 8] = random.uniform(0.001, 1.5, count), random.uniform(0.5, 2.0, count)
    return given


def test_lanes_give_the_program_s_bits():
    given = lanes(1)
    found, bad, turns = lanes_of(OSCILLATOR, given, [0, 1, 2], same=(6, 7, 9, 10))
    assert not bad.any()
    assert not reduced(turns).guards or all(g.op != "isfinite" for g in reduced(turns).guards)  # bounds imply it
    for lane in range(len(given)):
        rows = rows_of(OSCILLATOR, given[lane])
        np.testing.assert_array_equal(found[lane, :, FIRST], rows[0])
        np.testing.assert_array_equal(found[lane, :, LAST], rows[-1])
        np.testing.assert_array_equal(found[lane, :, LOW], rows[:EARLY].min(axis=0))
        np.testing.assert_array_equal(found[lane, :, LATE_LOW], rows[EARLY:].min(axis=0))
        np.testing.assert_array_equal(found[lane, :, HIGH], rows[:EARLY].max(axis=0))
        np.testing.assert_array_equal(found[lane, :, LATE_HIGH], rows[EARLY:].max(axis=0))
        total, squares = np.zeros(WIDTH), np.zeros(WIDTH)
        for row in rows:  # one after another, as the lanes add
            total, squares = total + row, squares + row * row
        np.testing.assert_array_equal(found[lane, :, SUM], total)
        np.testing.assert_array_equal(found[lane, :, SQUARES], squares)


@pytest.mark.parametrize(
    ("slot", "value"),
    [(0, math.nan), (1, math.inf), (1, 1e140), (7, 1.0), (8, 1e-9), (2, 1e9), (9, math.inf)],
)
def test_lanes_that_are_otherwise_are_marked(slot, value):
    given = lanes(2, 40)
    given[17, slot] = value
    _, bad, _ = lanes_of(OSCILLATOR, given, [0], same=())
    assert np.flatnonzero(bad).tolist() == [17]


def test_what_nothing_asks_for_is_left_out():
    _, _, turns = lanes_of(OSCILLATOR, lanes(3), [0], same=(6, 7, 9, 10))
    assert set(reduced(turns).ends) == {("S", 0), ("S", 1)}
    _, _, turns = lanes_of(OSCILLATOR, lanes(3), [2], same=(6, 7, 9, 10))
    assert ("S", 10) in reduced(turns).ends


def test_turns_that_differ_are_refused():
    source = OSCILLATOR.replace("force =", "if k % 2 == 0:\n                S[2] = S[2] + 1.0\n            force =")
    with pytest.raises(NotSteadyError):
        written_down(Traceable(source), {"S": lanes(4)[0]}, lambda slot: True, [0])


def test_a_branch_on_data_marks_lanes_that_take_another():
    source = OSCILLATOR.replace("rows[r * 3] =", "if S[0] < 0.0:\n            S[0] = -S[0]\n        rows[r * 3] =")
    given = lanes(5)
    given[:, :2] = np.abs(given[:, :2])
    found, bad, _ = lanes_of(source, given, [0], same=(6, 7, 9, 10))
    assert 0 < bad.sum() < len(given)
    for lane in np.flatnonzero(bad == 0.0):
        np.testing.assert_array_equal(found[lane, 0, LAST], rows_of(source, given[lane])[-1, 0])


def test_numbers_answer_as_they_are_and_are_noted():
    graph = Graph()
    cells = Cells("S", lambda slot: graph.node("input", (slot,), 2.5, steady=True))
    assert isinstance(cells[0], Node)
    x: Any = cells[0]
    assert (1.0 * x) is x
    assert (x * 1.0) is x
    assert (x - 0.0) is x
    assert (x + 0.0) is not x  # of -0.0 it is 0.0
    assert int(x) == 2
    assert x > 1.0
    assert bool(x)
    noted = [(g.op, g.b, g.outcome) for g in graph.guards.values()]
    assert noted == [("whole", 2, True), (">", 1.0, True), ("!=", 0.0, True)]
