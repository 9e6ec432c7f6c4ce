"""Forces that begin within a sample, and positions that are old: against finer samples, 40 digits and known figures."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.signal import cont2discrete

import graspfx as gx
from graspfx.analysis.discrete import INTEGRATORS
from graspfx.analysis.linearisation import Linearisation
from graspfx.analysis.stability.loop import loop_matrix, open_loop, radius_of
from graspfx.analysis.stability.modes import parts_of
from graspfx.errors import InputError
from tests.support.sampled_loops import exact_limit

M, B, T = 0.15, 0.2, 1e-3
FINE = 20  # parts of a sample in the fine simulation


@pytest.mark.parametrize(
    ("latency", "damping"), [(0.0003, 0.0), (0.0009, 0.0), (0.0013, 0.0), (0.0013, 0.05), (0.00471, -0.02)]
)
def test_a_wall_whose_force_comes_within_a_sample(latency: float, damping: float) -> None:
    limit = gx.stability.wall_limit(M, B, T, latency=latency, wall_damping=damping)
    assert limit == pytest.approx(exact_limit(M, B, T, latency, damping), rel=1e-9)
    radius = {s: radius_of(wall(s * limit, latency, damping), drift=True) for s in (1.0 - 1e-6, 1.0 + 1e-6)}
    assert radius[1.0 - 1e-6] < 1.0 < radius[1.0 + 1e-6]


def wall(stiffness: float, lateness: float = 0.0, damping: float = 0.0, age: float = 0.0) -> Linearisation:
    none = np.zeros((0, 0))
    return Linearisation(
        period=T, mass=M, friction=B, G=np.zeros((0, 1)), inertia=none, viscosity=none, stiffness=stiffness,
        damping=damping, lateness=lateness, age=age,
    )  # fmt: skip


def test_whole_samples_are_whole_samples() -> None:
    """A delay of 2 T as a time is the delay of two samples, also where 2 T is no sum of binary digits."""
    for period in (T, 0.0007, 0.005):
        whole = gx.stability.wall_limit(M, B, period, delay=2)
        assert gx.stability.wall_limit(M, B, period, latency=2 * period) == pytest.approx(whole, rel=1e-13)
        assert gx.stability.wall_limit(M, B, period, delay=1, latency=period) == pytest.approx(whole, rel=1e-13)
    assert gx.stability.wall_limit(M, B, T, latency=0.0) == gx.stability.wall_limit(M, B, T)


def test_stable_stiffness_falls_with_every_part_of_a_sample() -> None:
    """Near b/(T/2 + t_d) for a device that is slow against the sample, and monotonic from sample to sample."""
    times = np.linspace(0.0, 3e-3, 31)
    limits = np.array([gx.stability.wall_limit(5.0, B, T, latency=each) for each in times.tolist()])
    assert (np.diff(limits) < 0.0).all()
    assert limits == pytest.approx(B / (0.5 * T + times), rel=1e-3)


def test_passive_walls_with_an_output_delay() -> None:
    """b = 0.2 N s/m, T = 1 ms: b/(T/2 + t_d), half a hold being in it already."""
    limits = [gx.passivity.wall_limit(0.2, 1e-3, delay=1e-3 * ms) for ms in (0.0, 0.1, 0.2, 0.9, 1.0)]
    assert limits == pytest.approx([400.0, 1000 / 3, 2000 / 7, 1000 / 7, 400 / 3], rel=1e-12)
    region = gx.passivity.z_width(0.2, 1e-3, mass=M, latency=2e-4, wall_damping=[0.0, 0.05])
    assert region.stable is not None
    assert region.passive[0] == gx.passivity.guaranteed_wall_limit(0.2, 1e-3, delay=2e-4)
    assert region.stable[0] == gx.stability.wall_limit(M, 0.2, 1e-3, latency=2e-4)


@pytest.mark.parametrize("seed", range(24))
def test_a_loop_moves_as_one_of_finer_samples(seed: int) -> None:
    """Two devices that a hand couples, late and old by any twentieths of a sample, against twenty steps a sample."""
    rng = np.random.default_rng(seed)
    m, kind = 2, INTEGRATORS[seed % len(INTEGRATORS)]
    K = rng.normal(size=(m, m))
    hand = rng.normal(size=(m, m))
    lateness, age = (rng.integers(0, 50, m) * T / FINE for _ in range(2))
    if seed % 4 == 0:
        age = np.zeros(m)
    if seed % 4 == 1:
        lateness = np.zeros(m)
    linear = Linearisation(
        period=T, mass=rng.uniform(0.05, 0.3, m), friction=rng.uniform(0.1, 1.0, m), G=[[1.0, 0.7]], inertia=0.1,
        viscosity=0.5, stiffness=100.0 * K @ K.T, damping=0.05 * K @ K.T, hand_stiffness=200.0 * hand @ hand.T,
        hand_damping=0.5 * np.eye(m), delay=[1, 0], lateness=lateness, age=age, integrator=kind,
        rate="state" if seed % 3 == 0 else "difference", object_delay=int(kind != "implicit"),
    )  # fmt: skip
    A = loop_matrix(linear)
    state = np.zeros(len(A))
    state[: 2 * m + 2] = start = rng.normal(size=2 * m + 2) * [1e-3, 1e-3, 1e-1, 1e-1, 1e-3, 1e-1]
    state[2 * m + 2 :] = settled(linear, start)[: len(A) - 2 * m - 2]
    rows = [state]
    for _ in range(40):
        rows.append(A @ rows[-1])
    coarse = np.array(rows)[:, :m]
    fine = finer(linear, start, 41)
    assert np.abs(coarse - fine).max() < 1e-9 * np.abs(fine).max()
    opened = open_loop(linear)
    assert np.abs(opened.A + opened.B @ opened.C - A).max() <= 1e-9 * np.abs(A).max() or kind == "implicit"


def settled(linear: Linearisation, start: np.ndarray) -> np.ndarray:
    """The rest of a state that begins with devices as they are, no forces under way, and readings of a still past."""
    m = len(linear.mass)
    differenced = linear.rate == "difference"
    readings = 0 if not linear.age.any() else 1 + int((linear.age / linear.period + 1e-9).max())
    copies = readings + int(differenced)
    more = np.zeros(200)
    more[: m * copies] = np.tile(start[:m], copies)
    return more


def finer(linear: Linearisation, start: np.ndarray, count: int) -> np.ndarray:
    """Positions of the devices at the ticks, in steps of a twentieth of a sample with queues of forces and readings."""
    m, step = len(linear.mass), linear.period / FINE
    per = np.diag(1.0 / linear.mass)
    friction = np.diag(linear.friction) + linear.hand_damping
    A = np.block([[np.zeros((m, m)), np.eye(m)], [-per @ linear.hand_stiffness, -per @ friction]])
    Ad, Bd, *_ = cont2discrete((A, np.vstack([np.zeros((m, m)), per]), np.eye(2 * m), np.zeros((2 * m, m))), step)
    p, q, R, s = object_parts(linear)
    state, body, speed = start[: 2 * m].copy(), start[2 * m : 2 * m + 1].copy(), start[2 * m + 1 :].copy()
    past = [np.concatenate([state[:m], np.zeros(m)])] * 200  # a still past: positions, velocities
    past.append(state.copy())
    commands: list[np.ndarray] = []  # of the ticks
    wrenches: list[np.ndarray] = []
    late = np.round((linear.lateness + linear.delay * linear.period) / step).astype(int)
    old = np.round(linear.age / step).astype(int)
    last, rows = None, []
    for k in range(count):
        rows.append(state[:m].copy())
        x = np.array([past[-1 - old[i]][i] for i in range(m)])
        v = np.array([past[-1 - old[i]][m + i] for i in range(m)])
        if linear.rate == "difference":
            v = (x - (start[:m] if last is None else last)) / linear.period
        last = x
        f = force(linear, x, v, body, speed, (p, q, R, s))
        commands.append(f)
        wrenches.append(linear.G @ f)
        felt = wrenches[-1 - linear.object_delay] if len(wrenches) > linear.object_delay else 0.0 * wrenches[-1]
        for j in range(FINE):
            ages = [(k * FINE + j - late[i]) // FINE for i in range(m)]
            u = np.array([commands[n][i] if n >= 0 else 0.0 for i, n in enumerate(ages)])
            state = Ad @ state - Bd @ u
            past.append(state.copy())
        body, speed = body + p @ speed + q @ felt, R @ speed + s @ felt
    return np.array(rows)


def object_parts(linear: Linearisation) -> tuple[np.ndarray, ...]:
    from graspfx.analysis.stability.loop import object_matrices

    return object_matrices(linear.integrator, linear.inertia, linear.viscosity, linear.period)


def force(
    linear: Linearisation,
    x: np.ndarray,
    v: np.ndarray,
    body: np.ndarray,
    speed: np.ndarray,
    parts: tuple[np.ndarray, ...],
) -> np.ndarray:
    K, D, G = linear.stiffness, linear.damping, linear.G
    if linear.integrator != "implicit":
        return K @ (x - G.T @ body) + D @ (v - G.T @ speed)
    p, q, R, s = parts
    free = K @ (x - G.T @ (body + p @ speed)) + D @ (v - G.T @ (R @ speed))
    return np.linalg.solve(np.eye(len(x)) + (K @ G.T @ q + D @ G.T @ s) @ G, free)


@pytest.mark.parametrize("latency", [0.0004, 0.0012])
@pytest.mark.parametrize("split", [0.0, 0.25, 1.0])
def test_limits_of_a_wall_hold_in_a_fine_simulation(latency: float, split: float) -> None:
    """3 % below the limit the motion dies away, 3 % above it grows; whichever part of the delay is the reading's."""
    limit = gx.stability.wall_limit(M, B, T, latency=latency)
    for share, grows in ((0.97, False), (1.03, True)):
        linear = wall(share * limit, lateness=latency * split, age=latency * (1.0 - split))
        rows = finer_wall(linear, 6000)
        ratio = np.abs(rows[-1000:]).max() / np.abs(rows[1000:2000]).max()
        assert (ratio > 1.03) if grows else (ratio < 0.97)
        assert (radius_of(linear) > 1.0) is grows


def finer_wall(linear: Linearisation, count: int, start: float = 1e-3, push: float = 0.0) -> np.ndarray:
    """One device on a wall, from a place [m] and under the operator's force [N], in twenty steps a sample."""
    step = T / FINE
    p = B / M
    E, R = math.exp(-p * step), (1.0 - math.exp(-p * step)) / p
    shift, kick = (step - R) / B, R / M
    late, old = (round(float(each[0]) / step) for each in (linear.lateness, linear.age))
    K = float(linear.stiffness[0, 0])
    x, v, positions, queue = start, 0.0, [start] * (old + 1), [0.0] * (late + 1)
    rows, f = [], 0.0
    for k in range(count * FINE):
        if k % FINE == 0:
            f = K * positions[-1 - old]
            rows.append(x)
        queue.append(f)
        u = queue[-1 - late] - push
        x, v = x + R * v - shift * u, E * v - kick * u
        positions.append(x)
    return np.array(rows)


def test_the_age_of_a_position_counts_as_the_lateness_of_the_force() -> None:
    """With hands that couple no devices, for the spectral radius; with a hand that does and other ages it does not."""
    parts: dict[str, Any] = {
        "period": T,
        "mass": [0.1, 0.2],
        "friction": 0.2,
        "G": [[1.0, 1.0]],
        "inertia": 0.1,
        "viscosity": 0.3,
    }
    K = np.array([[60.0, -20.0], [-20.0, 60.0]])
    alone = Linearisation(**parts, stiffness=K, hand_stiffness=33.0, lateness=[1e-4, 7e-4], age=[2e-4, 1.4e-3])
    moved = alone.with_changes(lateness=alone.latency, age=0.0)
    assert radius_of(alone) == pytest.approx(radius_of(moved), abs=1e-12)
    hand = np.array([[200.0, -150.0], [-150.0, 200.0]])
    coupled = alone.with_changes(hand_stiffness=hand)
    assert abs(radius_of(coupled) - radius_of(coupled.with_changes(lateness=alone.latency, age=0.0))) > 1e-8


def test_modes_and_parts_of_late_loops_are_those_of_the_whole() -> None:
    """Equal devices, a third of a sample late and read 1.6 samples late: modes in closed form, and divided loops."""
    linear = Linearisation(
        period=T, mass=0.1, friction=0.2, G=[[1.0, 1.0, 1.0]], inertia=0.1, viscosity=0.3, hand_stiffness=33.0,
        stiffness=40.0 / 3 * np.ones((3, 3)) + 90.0 * (np.eye(3) - np.ones((3, 3)) / 3), lateness=T / 3, age=1.6 * T,
    )  # fmt: skip
    whole = radius_of(linear)
    modes = gx.stability.modes(linear)
    assert [mode.kind for mode in modes] == ["internal", "external"]
    assert max(mode.spectral_radius for mode in modes) == pytest.approx(whole, abs=1e-9)
    assert max(radius_of(part.linear) for part in parts_of(linear)) == pytest.approx(whole, abs=1e-12)


def test_a_held_hand_force_moves_readings_too() -> None:
    """The closed loop answers 1 N of the operator's as a simulation of finer steps does."""
    linear = wall(50.0, lateness=0.4 * T, age=1.7 * T)
    opened = open_loop(linear)
    A, state = opened.A + opened.B @ opened.C, np.zeros(len(opened.A))
    x = finer_wall(linear, 60, 0.0, 1.0)
    for k in range(60):
        assert state[0] == pytest.approx(x[k], abs=1e-12)
        state = A @ state + opened.hand[:, 0] * 1.0


@pytest.mark.parametrize(
    ("change", "name"),
    [({"lateness": -1e-4}, "lateness"), ({"lateness": math.nan}, "lateness"), ({"age": 2.0}, "age"),
     ({"age": [1e-3, 1e-3]}, "age"), ({"delay": 0.5}, "delay")],
)  # fmt: skip
def test_times_that_cannot_be(change: dict[str, Any], name: str) -> None:
    with pytest.raises(InputError, match=f"^{name}: given"):
        wall(50.0).with_changes(**change)


def test_a_map_takes_one_part_of_a_sample() -> None:
    limits = gx.stability.wall_limit_map([0.1, 0.2], B, T, latency=4e-4)
    assert limits == pytest.approx([gx.stability.wall_limit(m, B, T, latency=4e-4) for m in (0.1, 0.2)], rel=1e-13)
    with pytest.raises(InputError, match="latency: given"):
        gx.stability.wall_limit_map(0.1, B, [1e-3, 2e-3], latency=1.5e-3)
