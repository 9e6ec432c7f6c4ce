"""Damping that grows with depth in the linearisation: whole ticks by finite differences, limits, what is said of it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.analysis.grasp_stiffness import in_series
from graspfx.analysis.stability.loop import loop_matrix
from graspfx.certificate.certify import certificates
from graspfx.certificate.linearise import linearise

ANGLES = np.radians([180.0, 50.0, -70.0])
OUT = np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=1)
RADIUS, KEP, KIP, KED, KID, HAND = 0.03, 200.0, 400.0, 1.5, 3.0, 150.0
SMALL = 1e-7  # [m]: of a start that is displaced
TICKS = 8
UNIT = np.array([1.0] * 8 + [RADIUS])  # a turn as the way of the contacts


def forces(most: float = 0.36) -> np.ndarray:
    """With which three fingers balance one another, the first one's at most, (3,) [N]."""
    others = np.linalg.solve(OUT[1:].T, -OUT[0])
    return most * np.array([1.0, *others])


def scene(depth: float = 1e-3, *, offset: Any = 0.0, speed: Any = (0.0, 0.0, 0.0), **changes: Any) -> gx.Scene:
    """Three fingers at rest in a disc, each by its force over KIP deep: 0.9, 0.85 and 0.59 of a millimetre."""
    f = forces()
    start = (RADIUS - f / KIP)[:, None] * OUT
    rest = start - (f / HAND)[:, None] * OUT
    table = gx.Scene(
        dimensions=2,
        period=0.002,
        duration=TICKS * 0.002,
        object={
            "mass": 0.1,
            "viscosity": 0.4,
            "rotational_viscosity": 2e-4,
            "shape": {"kind": "sphere", "radius": RADIUS},
            "integrator": "semi-implicit",
            "velocity": list(speed[:2]),
            "angular_velocity": float(speed[2]),
        },
        coupling={
            "external": {"stiffness": KEP, "damping": KED},
            "internal": {"stiffness": KIP, "damping": KID},
            "friction": "stick",
            "damping_depth": depth,
        },
        finger=[
            {
                "start": (start[i] + np.broadcast_to(offset, (3, 2))[i]).tolist(),
                "device": {"name": "simulated", "mass": 0.1, "damping": 0.5},
                "hand": {"stiffness": HAND, "damping": 0.5, "rest": rest[i].tolist()},
            }
            for i in range(3)
        ],
    )
    return table.replace({key.replace("__", "."): value for key, value in changes.items()})


def motion(grasp: gx.Scene) -> np.ndarray:
    """Fingertips and object of a run, (ticks, 9)."""
    rec = gx.run(grasp)
    assert rec.true_position is not None and rec.object_orientation is not None
    angle = rec.object_orientation.reshape(len(rec), 1)
    return np.hstack([rec.true_position.reshape(len(rec), 6), rec.object_position, angle])


# Its forces are solved with moment arms that stay where they are, so that they are exact where nothing turns; and it
# finds contacts where the object will be, so that a push is no small motion about this grasp.
IMPLICIT: dict[str, Any] = {"object__integrator": "implicit", "object__free": [True, True, False]}
CASES: list[dict[str, Any]] = [
    {},
    {"object__integrator": "exact"},
    IMPLICIT,
    {"coupling__friction": 0.8},
    {"coupling__friction": 0.8, **IMPLICIT},
    {"coupling__friction": 0.0},
    {"coupling__external__damping": 3.0, "coupling__external__stiffness": 400.0},
    {"coupling__external__damping": 0.0},
    {"coupling__internal__damping": 0.0},
    {"coupling__external__damping": [1.5, 1.5, 1.5], "coupling__internal__damping": [3.0, 3.0, 3.0]},
    {"coupling__reaction": "contact"},
]


@pytest.mark.parametrize("changes", CASES, ids=str)
def test_the_linearisation_is_the_tick_by_finite_differences(changes: dict[str, Any]) -> None:
    """8 ticks after a start aside or a push, central differences: A's states to 1e-5 of the start's displacement."""
    rest = linearise(scene(**changes))
    assert rest.at == ("squeezed",)
    A = loop_matrix(rest.linear)
    r = rest.linear.coordinates[1]
    for kind in (1,) if "object__integrator" in changes else (0, 1 + r):
        offset, speed = np.zeros((3, 2)), np.zeros(3)
        if kind < 2:
            offset[kind] = OUT[kind]  # along the normal: the contact stays where it is
        else:
            speed[kind - 2] = 1.0 / (0.002 * UNIT[kind + 4])
        both = [motion(scene(offset=x * offset, speed=x * speed, **changes)) for x in (SMALL, -SMALL)]
        measured = (both[0] - both[1]) / (2 * SMALL) * UNIT
        state = np.zeros(len(A))
        state[:6], state[12 + r : 12 + 2 * r] = offset.ravel(), speed[:r]
        state[12 + 2 * r :] = offset.ravel()  # of the sample before
        for k in range(TICKS):
            expected = np.concatenate([state[:6], state[12 : 12 + r]]) * UNIT[: 6 + r]
            np.testing.assert_allclose(measured[k, : 6 + r], expected, rtol=0.0, atol=1e-5, err_msg=f"{kind}, {k}")
            state = A @ state


def test_without_the_series_the_linearisation_would_be_another() -> None:
    """The full D instead: the same comparison fails by 1e-2 within ten ticks, so that it does see the damping."""
    grasp = scene()
    rest = linearise(grasp)
    full = linearise(scene(depth=0.0))
    assert np.abs(rest.linear.damping - full.linear.damping).max() > 0.3
    states = []
    for linear in (rest.linear, full.linear):
        A, state = loop_matrix(linear), np.zeros(24)
        state[15] = 500.0
        states.append(np.linalg.matrix_power(A, 10) @ state)
    assert np.abs(states[0] - states[1])[:6].max() > 1e-2


def test_damping_at_rest_is_the_formula() -> None:
    """(D^-1 + C)^-1 by numpy with s from the forces of the rest; K and all else as without the key."""
    rest, full = linearise(scene()).linear, linearise(scene(depth=0.0)).linear
    s = np.minimum(1.0, forces() / (KIP * 1e-3))
    assert (s < 1.0).all()
    C = np.repeat((1.0 - s) / (s * max(KED, KID)), 2)
    expected = np.linalg.inv(np.linalg.inv(full.damping) + np.diag(C))
    np.testing.assert_allclose(rest.damping, expected, rtol=0.0, atol=1e-8 * KID)
    np.testing.assert_allclose(rest.stiffness, full.stiffness, rtol=0.0, atol=1e-9 * KIP)
    # deeper than the length: the same matrix as without it
    assert np.array_equal(linearise(scene(depth=1e-4)).linear.damping, full.damping)
    start = linearise(scene(), "start")
    assert not start.linear.damping.any()
    assert "unloaded contacts have no damping, which grows with depth" in start.assumed


def test_a_singular_damping_has_its_limit_in_series() -> None:
    """D of one direction, and a finger without force: as with a least damping and with a compliance of 1e12."""
    D = np.outer([1.0, 2.0, -1.0], [1.0, 2.0, -1.0])
    C = np.array([0.5, 0.0, 2.0])
    near = np.linalg.inv(np.linalg.inv(D + 1e-7 * np.eye(3)) + np.diag(C))
    np.testing.assert_allclose(in_series(D, C), near, atol=1e-5)
    np.testing.assert_allclose(in_series(D, [0.5, np.inf, 2.0]), in_series(D, [0.5, 1e12, 2.0]), atol=1e-10)
    assert in_series(D, np.zeros(3)) is D
    assert not in_series(D, np.full(3, np.inf)).any()


def test_a_run_grows_and_decays_as_the_certificate_says() -> None:
    """3 % on either side of the largest kid, shallow in the object; with all damping at once half of it is too much.

    The sway of the fingers after a start aside by a tenth of a micrometre, its rate to 15 %.
    """
    depth, limit = 2.5e-3, 266.5
    assert gx.stability.spectral_radius(scene(depth=0.0, coupling__internal__damping=0.5 * limit)) > 1.0
    for factor, grows in ((0.97, False), (1.03, True)):
        offset = np.array([[SMALL], [0.5 * SMALL], [-0.2 * SMALL]]) * OUT
        grasp = scene(depth, offset=offset, coupling__internal__damping=factor * limit, duration=0.8)
        sway = (np.diff(motion(grasp)[:, :6], axis=0) ** 2).sum(axis=1)
        rate = 0.5 * np.log(sway[-100:].sum() / sway[-200:-100].sum()) / 100
        predicted = np.log(gx.stability.spectral_radius(grasp))
        assert bool(predicted > 0.0) is grows
        assert rate == pytest.approx(predicted, rel=0.15)


def test_passivity_is_judged_where_all_damping_is_there() -> None:
    """`graspfx check` gives limits of passivity for the damping's own value only."""
    exact: dict[str, Any] = {"object__integrator": "exact"}
    assert "grows with depth" in certificates(scene(**exact))[0].why_not_passive
    assert certificates(scene(depth=1e-4, **exact))[0].passive is not None
