"""The split and eq. (4) over all conditions, sizes, offsets, numbers of fingers and ratios of gains."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.coupling.rules import Rules
from tests.support.exact import distance, exact_force, exact_share
from tests.support.families import efforts, family
from tests.support.grasps import ON_A_LINE, grasped
from tests.support.scatter import contact_set, decades, rotation

SHARE = family("split: P e", "50 digits, of the largest entry of e")
LAWS = family("split: P = P', P P = P, G (I - P) = 0, trace P = rank", "the definitions")
ORDER = family("split: fingers in another order", "the same numbers")
FRAME = family("split: another frame and unit", "the same numbers")
FORCE = family("eq. (4), analysis", "50 digits, of max gain times max |e|")
TICK = family("eq. (4), tick", "50 digits, of max gain times |e|")
WRENCH = family("eq. (4), tick: wrench of the internal part", "zero, of max gain times |e|")

EPS = np.finfo(float).eps
SHARP = 1e-13  # tolerance on the rank: below all that contacts are made of here


def bound(n: int, condition: float) -> float:
    """4e-15 up to a condition of 100, 20 eps condition beyond; sums over many fingers lose a little more."""
    return max(4e-15, 20.0 * EPS * condition if condition > 100.0 else 0.0) * max(1.0, np.sqrt(n) / 4.0)


@efforts(short=40, full=1000)
def test_share_against_fifty_digits(cases: int) -> None:
    rng = np.random.default_rng(1)
    for _ in range(cases):
        made = contact_set(rng)
        e = rng.normal(size=made.points.size)
        split = gx.Grasp(made.points).split(tolerance=SHARP)
        exact, rank = exact_share(made.points, e, SHARP)
        assert split.rank == rank, made.label
        external, internal = split.divide(e)
        error = distance(external, exact) / np.abs(e).max()
        SHARE.check(error, 4e-15 * max(1.0, np.sqrt(len(made.points)) / 4.0), made.label)
        assert np.array_equal(internal, e - external)


@efforts(short=40, full=1000)
def test_projector_laws(cases: int) -> None:
    rng = np.random.default_rng(2)
    for _ in range(cases):
        made = contact_set(rng, most=30)
        n, d = made.points.shape
        grasp = gx.Grasp(made.points, origin=made.points.mean(axis=0))
        split = grasp.split(tolerance=SHARP)
        P = split.external
        spread = np.abs(made.points - made.points.mean(axis=0)).max() or 1.0
        G = grasp.matrix.copy()
        G[d:] /= spread
        wrong = max(
            np.abs(P - P.T).max(),
            np.abs(P @ P - P).max(),
            np.abs(G @ split.internal).max() / np.sqrt(n),
            abs(np.trace(P) - split.rank) / max(1, split.rank),
            np.abs(split.internal_basis.T @ split.internal_basis - np.eye(n * d - split.rank)).max(initial=0.0),
        )
        # far from the origin the arms of G itself are rounded; P's are not
        rounded = 4.0 * EPS * np.abs(made.points).max() / spread
        LAWS.check(wrong, 4e-15 + rounded, made.label)


@efforts(short=30, full=1000)
def test_order_frame_and_unit_do_not_matter(cases: int) -> None:
    rng = np.random.default_rng(3)
    for _ in range(cases):
        made = contact_set(rng, most=20)
        n, d = made.points.shape
        P = gx.Grasp(made.points).split(tolerance=SHARP).external
        order = rng.permutation(n)
        columns = (order[:, None] * d + np.arange(d)).ravel()
        again = gx.Grasp(made.points[order]).split(tolerance=SHARP).external
        # centroids are summed in another order: contacts differ by what their positions are rounded to
        ORDER.check(float(np.abs(again - P[np.ix_(columns, columns)]).max()), 4e-15, made.label)
        unit = 2.0 ** int(rng.integers(-30, 30))  # exact, so that contacts stay what they are
        assert np.array_equal(gx.Grasp(unit * made.points).split(tolerance=SHARP).external, P), made.label
        if d > 1 and "away" in made.label:
            arms = made.points - made.points[0]  # turned, positions are rounded anew; far away that would be all
            flat = np.linalg.svd(arms - arms.mean(axis=0), compute_uv=False)
            if n < 3 or flat[0] == 0.0 or (flat[:d] < 1e-6 * flat[0]).any():
                continue
            turn = rotation(rng, d)
            turned = gx.Grasp(arms @ turn.T).split(tolerance=SHARP).external
            about = np.kron(np.eye(n), turn)
            straight = gx.Grasp(arms).split(tolerance=SHARP).external
            condition = flat[0] / flat[: max(2, d - 1)].min()
            FRAME.check(float(np.abs(about @ straight @ about.T - turned).max()), 100.0 * EPS * condition, made.label)


def gains(rng: np.random.Generator) -> tuple[float, float]:
    """External and internal, of a ratio up to 1e6 either way; sometimes zero or equal."""
    middle, ratio = decades(rng, 1e-3, 1e5), decades(rng, 1e-6, 1e6)
    kind = rng.random()
    if kind < 0.05:
        return middle, 0.0
    return (middle, middle) if kind < 0.1 else (middle * np.sqrt(ratio), middle / np.sqrt(ratio))


@efforts(short=30, full=1000)
def test_force_of_the_analysis(cases: int) -> None:
    rng = np.random.default_rng(4)
    for _ in range(cases):
        made, (ke, ki) = contact_set(rng), gains(rng)
        e = decades(rng, 1e-9, 1.0) * rng.normal(size=made.points.size)
        split = gx.Grasp(made.points).split(tolerance=SHARP)
        law = gx.Coupling(external=gx.Impedance(ke), internal=gx.Impedance(ki))
        exact, _ = exact_force(made.points, e, ke, ki, SHARP)
        scale = max(ke, ki) * np.abs(e).max()
        label = f"{made.label}, {ke:.1e} and {ki:.1e} N/m"
        n = len(made.points)
        FORCE.check(distance(law.force(split, e), exact) / scale, 4e-15 * max(1.0, np.sqrt(n) / 4.0), label)
        if n <= 20:
            K = law.stiffness(split)
            assert np.abs(K @ e - law.force(split, e)).max() <= 1e-13 * scale, label
            assert np.linalg.eigvalsh(K)[0] >= -1e-13 * max(ke, ki), label  # K lies between the gains


def flatness(points: np.ndarray) -> float:
    """Largest over smallest rms arm of a rotation that counts; a split leaves out arms that are rounding."""
    arms = points - points[0]
    sizes = np.linalg.svd(arms - arms.mean(axis=0), compute_uv=False)
    least = float(np.hypot(*sizes[1:3])) if points.shape[1] == 3 and len(sizes) > 2 else 0.0
    return float(sizes[0]) / least if least > SHARP * sizes[0] else 1.0


@efforts(short=30, full=1000)
def test_force_of_the_tick(cases: int) -> None:
    rng = np.random.default_rng(5)
    for _ in range(cases):
        made, (ke, ki) = contact_set(rng, most=60), gains(rng)
        points = made.points
        n, d = points.shape
        e = decades(rng, 1e-9, 1e-2) * rng.normal(size=(n, d))
        law = gx.Coupling(external=gx.Impedance(ke), internal=gx.Impedance(ki))

        radius = np.sqrt(((points - points.mean(axis=0)) ** 2).sum() / n) or 1.0
        blend = (0.1 * SHARP * radius, SHARP * radius)  # above what is rounded, below all that contacts are made of
        turning: dict[str, Any] = ON_A_LINE if d == 1 else {"inertia": 1e-4}
        held = grasped(n, d, law, Rules(attached=True, blend=blend, force_bound=1e39), contacts=points, **turning)
        held.finger_position[:] = points + e
        assert held.sample() == 0
        felt = (points + e) - points  # the displacement that doubles can hold
        exact, _ = exact_force(points, felt, ke, ki, SHARP)
        scale = max(ke, ki) * float(np.linalg.norm(felt)) or 1.0
        condition = max(gx.Grasp(points).split(tolerance=SHARP).condition, flatness(points))
        label = f"{made.label}, {ke:.1e} and {ki:.1e} N/m, condition {condition:.1e}"
        TICK.check(distance(held.force, exact) / scale, bound(n, condition), label)
        internal = held.force.ravel() - ke * gx.Grasp(points).split(tolerance=SHARP).project(felt.ravel())
        WRENCH.check(float(np.abs(internal.reshape(n, d).sum(axis=0)).max()) / scale, n * bound(n, condition), label)


@pytest.mark.parametrize("d", [1, 2, 3])
@pytest.mark.parametrize("n", [1, 2, 100])
def test_fingers_in_one_place_are_one_finger(n: int, d: int) -> None:
    # all contacts at one point 1 km away: only translations are external, P the mean over the fingers
    points = np.full((n, d), 1000.0 / 3.0)
    P = gx.Grasp(points).split().external
    assert np.abs(P - np.kron(np.full((n, n), 1.0 / n), np.eye(d))).max() <= 1e-15
