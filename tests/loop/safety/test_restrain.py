"""The end of the safety chain on random forces: size, cones, growth, walls and finiteness, against numpy."""

from __future__ import annotations

import numpy as np
import pytest

from graspfx.compile.machine import compiled
from graspfx.compile.records import start_of
from graspfx.coupling.grasp_state import FingerState
from graspfx.coupling.grasped import GraspedObject
from graspfx.coupling.law import react
from graspfx.coupling.limit import scale
from graspfx.loop.safety.chain import SafetyChain, SafetyLimits
from graspfx.loop.safety.restrain import BAND, growth_share, restrain
from graspfx.loop.safety.safety_state import FingerLimits, SafetyState
from graspfx.loop.safety.soften import apply_gain, soften
from graspfx.loop.safety.trust import NOT_FINITE
from graspfx.spatial import Vector
from tests.support.pushed_grasps import KINDS, depth, push, random_grasp, wrench_rows

T = 0.001


def chain_of(g: GraspedObject, rng: np.random.Generator, *, rate: float, walls: bool) -> SafetyChain:
    """A chain with limits of 1 to 6 N, and walls 20 mm or so from the object's centre."""
    n, d = g.fingers, g.dimensions
    box = rng.uniform(0.015, 0.03, (n, d)) if walls else np.full((n, d), np.inf)
    limits = SafetyLimits(rng.uniform(1.0, 6.0, n), np.full(n, rate), np.full(n, np.inf), -box, box, 3, 0.0)
    return SafetyChain(limits, [(g, np.arange(n))], n, T)


class Bench:
    """Random forces through limit, gain and restraint, each a compiled kernel."""

    def __init__(self, g: GraspedObject, chain: SafetyChain) -> None:
        self.g, self.chain, [self.buffer] = g, chain, chain.buffers
        self.state = SafetyState(self.buffer)
        self.scale, self.soften, self.apply = compiled(scale), compiled(soften), compiled(apply_gain)
        self.react, self.restrain = compiled(react), compiled(restrain)

    def run(self, gain: float) -> int:
        """One sample: the law's forces stand in the block already."""
        block, buffer, pace = self.g.block, self.buffer, self.chain.pace
        self.state.tank.level = self.state.tank.most = np.inf
        self.state.gain = 0.0
        self.chain.pace[:] = 0.0
        soft, trust = 4, 5  # of `Pace`
        pace[soft], pace[trust] = gain, 1.0
        self.soften(block, 0, buffer, 0, pace, 0, 0)
        self.scale(block, 0, False)
        self.apply(block, 0, buffer, 0)
        self.react(block, 0)
        return int(self.restrain(block, 0, buffer, 0, pace, 0))

    def last(self) -> np.ndarray:
        """Forces of the sample before, (n, 3)."""
        return self.state.fingers.array(FingerLimits.last)


def distance(f: np.ndarray, last: np.ndarray) -> float:
    """From a force to the segment between the last one and zero, in numpy's way."""
    square = float(last @ last)
    t = min(max(float(f @ last) / square, 0.0), 1.0) if square else 0.0
    return float(np.linalg.norm(f - t * last))


def sweep(kind: str, grasps: int, states: int, seed: int) -> np.ndarray:
    """The worst excess of size, growth, cone, wall and turn of the wrench over random states."""
    dimensions, rules = KINDS[kind]
    rng = np.random.default_rng(seed)
    worst = np.zeros(5)
    short = grown = walled = 0
    for _ in range(grasps):
        g = random_grasp(rng, int(rng.integers(1, 6)), int(rng.choice(dimensions)), rules)
        assert g.limit is not None
        device = g.limit.copy()
        free = rng.random() < 0.4  # no rate and no walls: then the wrench keeps its direction
        chain = chain_of(g, rng, rate=np.inf if free else 500.0, walls=not free)
        bench, G = Bench(g, chain), wrench_rows(g, rules)
        own = bench.state.fingers
        limits = np.minimum(device, own.array(FingerLimits.force))
        lower, upper = own.array(FingerLimits.lower), own.array(FingerLimits.upper)
        for _ in range(states):
            push(rng, g, rules)
            before = g.array(FingerState.local).copy()
            g.finger_position[:] = rng.uniform(-0.03, 0.03, g.finger_position.shape)
            last = bench.last().copy()
            assert bench.run(float(rng.choice([1.0, 0.3]))) == 0
            f, local = g.array(FingerState.force), g.array(FingerState.local)
            size = np.linalg.norm(f, axis=1)
            scale_of = float(np.abs(before).max()) or 1.0
            worst[0] = max(worst[0], float((size / limits).max()) - 1.0)
            short += bool((size > limits * (1.0 - 1e-12)).any())
            outside = -depth(g, rules, local) + min(depth(g, rules, before), 0.0)  # by more than they came in
            worst[2] = max(worst[2], outside / scale_of)
            assert np.array_equal(g.limit, limits)  # its own again, the device's with the chain's
            g.limit[:] = device
            if free:
                w, w0 = G @ local.ravel(), G @ before.ravel()
                alpha = float(w @ w0 / (w0 @ w0)) if len(w0) and w0 @ w0 > 0.0 else 1.0
                worst[4] = max(worst[4], float(np.abs(w - alpha * w0).max(initial=0.0)) / scale_of)
                continue
            position = np.zeros((g.fingers, 3))
            position[:, : g.dimensions] = g.finger_position
            for i in range(g.fingers):
                grew = distance(f[i], last[i])
                worst[1] = max(worst[1], grew / (500.0 * T) - 1.0)
                grown += grew > 0.499
            outward = np.where(position > upper, -f, 0.0) + np.where(position < lower, f, 0.0)
            worst[3] = max(worst[3], float(outward.max()))
            walled += bool(((position > upper) | (position < lower))[:, : g.dimensions].any())
    assert short > 0 and grown > 0 and walled > 0
    return worst


@pytest.mark.parametrize("kind", KINDS)
def test_random_forces_come_out_within_all_limits(kind: str) -> None:
    """3400 states each, 20 400 in all: size and growth to 1e-12, cones and wrench to 4e-15 of the forces; walls."""
    worst = sweep(kind, 68, 50, sum(map(ord, kind)))
    assert worst[0] <= 1e-12
    assert worst[1] <= 1e-12
    assert worst[2] <= 4e-15
    assert worst[3] == 0.0
    assert worst[4] <= 4e-15


@pytest.mark.stress
@pytest.mark.parametrize("kind", KINDS)
def test_a_million_random_forces_come_out_within_all_limits(kind: str) -> None:
    """168 000 states each, 1 008 000 in all, as above."""
    worst = sweep(kind, 840, 200, 1 + sum(map(ord, kind)))
    assert (worst <= [1e-12, 1e-12, 4e-15, 0.0, 4e-15]).all()


FIELDS = ("position", "velocity", "displacement", "rate", "local", "elastic", "limit", "last", "gain")


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("field", FIELDS)
def test_a_number_that_is_none_is_a_fault_at_every_entry(field: str, value: float) -> None:
    """Every component of every finger in turn: the kernel says so, and remembers no force.

    An infinite limit alone is none: the chain's own takes its place.
    """
    rules = KINDS["friction"][1]
    rng = np.random.default_rng(5)
    g = random_grasp(rng, 3, 3, rules)
    chain = chain_of(g, rng, rate=100.0, walls=True)
    bench = Bench(g, chain)
    push(rng, g, rules)
    assert bench.run(1.0) == 0
    block, buffer = g.block.copy(), bench.buffer.copy()
    if field == "last":
        entries = [("buffer", int(k)) for k in offsets(bench.buffer, bench.last())]
    elif field == "gain":
        entries = [("buffer", int(k)) for k in offsets(bench.buffer, bench.buffer[gain_at() : gain_at() + 1])]
    else:
        entries = [("block", int(k)) for k in offsets(g.block, g.array(getattr(FingerState, field)))]
    for memory, k in entries:
        g.block[:], bench.buffer[:] = block, buffer
        if memory == "block":
            g.block[k] = value
        else:
            bench.buffer[k] = value
        if field == "limit":  # as a device tells it, before the chain looks at it
            code = bench.run(1.0)
            assert code == (0 if value == np.inf else NOT_FINITE)
            continue
        assert bench.restrain(g.block, 0, bench.buffer, 0, chain.pace, 0) == NOT_FINITE
        assert not bench.last().any()


def gain_at() -> int:
    """Where the gain stands in an object's memory."""
    return start_of(SafetyState, "gain")


def offsets(memory: np.ndarray, piece: np.ndarray) -> np.ndarray:
    """Entries of a memory that an array shows."""
    first = (piece.ctypes.data - memory.ctypes.data) // 8
    steps = [stride // 8 for stride in piece.strides]
    index = np.indices(piece.shape).reshape(piece.ndim, -1)
    return np.asarray(first + np.tensordot(steps, index, 1))


# Closed forms -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("f", "last", "share"),
    [
        ((3.0, 0.0), (1.0, 0.0), 1.5 / 3.0),  # grows by 0.5
        ((0.2, 0.0), (1.0, 0.0), 1.0),  # lets go at once
        ((-2.0, 0.0), (1.0, 0.0), 0.25),  # through zero, and 0.5 on
        ((0.0, 2.0), (1.0, 0.0), 0.25),  # at right angles: from zero
        ((0.0, 2.0), (0.0, 0.0), 0.25),  # from nothing
        ((1.0, 1.0), (1.0, 0.0), 0.5),  # through the side, 0.5 above the segment's middle
        ((2.0, 1.0), (2.0, 0.0), 0.5),  # at 26.6 degrees through the side, at (1, 0.5)
        ((4.0, 1.0), (1.0, 0.0), (4.0 + np.sqrt(16.0 - 17.0 * 0.75)) / 17.0),  # through the cap
        ((0.0, 0.4), (1.0, 0.0), 1.0),
    ],
)
def test_growth_in_closed_form(f: tuple[float, float], last: tuple[float, float], share: float) -> None:
    """A ray leaves what is at most 0.5 N, a sample's growth, from the segment between the last force and zero."""
    assert growth_share(Vector(*f, 0.0), Vector(*last, 0.0), 0.5) == pytest.approx(share, rel=1e-14)


def test_a_wall_lets_through_what_points_inward_alone() -> None:
    """On a line with a wall at 10 mm: at most L x/BAND outward at the distance x, all of it inward, nothing beyond."""
    rng = np.random.default_rng(1)
    g = random_grasp(rng, 1, 1, KINDS["attached"][1])
    limits = SafetyLimits(np.array([2.0]), *(np.array([np.inf]),) * 2, np.array([[-np.inf]]), np.array([[0.01]]), 3, 0)
    bench = Bench(g, SafetyChain(limits, [(g, np.arange(1))], 1, T))
    g.limit[:] = np.inf  # type: ignore[index]
    for x, force, out in (
        (0.0, -1.5, -1.5), (0.01 - 0.5 * BAND, -1.5, -1.0), (0.01 - 0.5 * BAND, 1.5, 1.5), (0.01, -1.5, 0.0),
        (0.02, -1.5, 0.0), (0.02, 1.5, 1.5), (0.0, -9.0, -2.0),
    ):  # fmt: skip
        g.finger_position[:] = x
        g.array(FingerState.local)[:] = 0.0
        g.array(FingerState.local)[:, 0] = force
        assert bench.run(1.0) == 0
        assert g.array(FingerState.local)[0, 0] == pytest.approx(out, rel=1e-12)  # the operator feels its opposite
        g.limit[:] = np.inf  # type: ignore[index]
