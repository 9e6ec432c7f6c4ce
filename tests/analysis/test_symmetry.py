"""Exchanges of fingers that leave a grasp as it is, and sets of fingers that are alike by them."""

from __future__ import annotations

import numpy as np
import pytest

import graspfx as gx
from graspfx.analysis.grasp_stiffness import alike_sets, symmetries
from graspfx.analysis.linearisation import Linearisation
from graspfx.certificate.linearise import linearise
from graspfx.certificate.mode_limits import pushing_limits

FREE = np.ones(6, dtype=bool)


def around(n: int, **changes: object) -> tuple[Linearisation, np.ndarray]:
    """n fingers evenly around a ball's equator."""
    angle = 2.0 * np.pi * np.arange(n) / n
    contacts = 0.03 * np.stack([np.cos(angle), np.sin(angle), np.zeros(n)], axis=1)
    grasp = gx.Grasp(contacts)
    law = gx.Coupling(gx.Impedance(200.0, 1.0), gx.Impedance(400.0, 1.0))
    figures: dict[str, object] = {
        "inertia": [0.25, 0.25, 0.25, 1e-4, 1e-4, 1e-4],
        "viscosity": [0.5, 0.5, 0.5, 5e-4, 5e-4, 5e-4],
        "stiffness": law.stiffness(grasp.split()),
        "damping": 1.0,
        "hand_stiffness": 200.0,
        "mass": 0.1,
        "friction": 0.5,
    }
    linear = Linearisation(period=0.005, G=grasp.matrix, **(figures | changes))  # type: ignore[arg-type]
    return linear, contacts


@pytest.mark.parametrize("n", [2, 3, 4, 5])
def test_fingers_evenly_around_a_ball_have_the_group_of_a_polygon(n: int) -> None:
    """2 n turns and mirror images for n > 2; two fingers change places or do not."""
    linear, contacts = around(n)
    found = symmetries(linear, contacts, FREE)
    assert len(found) == len(set(found)) == (2 if n == 2 else 2 * n)
    for exchange in found:
        assert sorted(exchange) == list(range(n))


@pytest.mark.parametrize(
    "changes",
    [
        {"mass": [0.1] * 6 + [0.1 + 1e-6] * 3},
        {"friction": [0.5] * 3 + [0.6] * 6},
        {"hand_stiffness": [200.0] * 6 + [201.0] * 3},
        {"delay": [0] * 6 + [1] * 3},
        {"damping": [1.0] * 3 + [1.1] * 6},
    ],
    ids=lambda changes: next(iter(changes)),
)
def test_one_unlike_finger_of_three_leaves_one_exchange(changes: dict[str, object]) -> None:
    linear, contacts = around(3, **changes)
    assert len(symmetries(linear, contacts, FREE)) == 2


def test_an_object_that_is_heavier_one_way_leaves_what_keeps_it() -> None:
    """Moments of inertia 1, 2 and 3 of four fingers on the axes: opposite ones change places, neighbours do not."""
    linear, contacts = around(4, inertia=[0.25, 0.25, 0.25, 1e-4, 2e-4, 3e-4])
    assert set(symmetries(linear, contacts, FREE)) == {(0, 1, 2, 3), (2, 1, 0, 3), (0, 3, 2, 1), (2, 3, 0, 1)}


def test_a_locked_direction_is_not_turned_into_a_free_one() -> None:
    linear, contacts = around(4)
    free = np.array([True, False, True, True, True, True])
    locked = linear.with_changes(
        G=linear.G[free], inertia=np.diag(linear.inertia)[free], viscosity=np.diag(linear.viscosity)[free],
        G_displacement=None,
    )  # fmt: skip
    assert len(symmetries(locked, contacts, free)) == 4


def test_alike_sets_are_orbits() -> None:
    """Four fingers in a square: one kind of single, neighbours or opposite ones, one kind of three."""
    sets = [(0,), (1,), (0, 1), (0, 2), (1, 3), (1, 2), (0, 1, 2), (1, 2, 3)]
    linear, contacts = around(4)
    assert alike_sets(sets, symmetries(linear, contacts, FREE)) == [0, 0, 2, 3, 3, 2, 6, 6]
    assert alike_sets(sets, [(0, 1, 2, 3)]) == list(range(8))


@pytest.mark.parametrize("name", ["knob", "sphere-three-fingers", "prism"])
def test_alike_sets_have_the_limits_that_each_has_by_itself(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = gx.load(name)
    loop = linearise(scene, "provisional")
    alike = list(pushing_limits(scene, loop))
    monkeypatch.setattr("graspfx.certificate.mode_limits.symmetries", lambda *_: [tuple(range(len(loop.fingers)))])
    alone = list(pushing_limits(scene, loop))
    assert [row.mode for row in alike] == [row.mode for row in alone]
    assert [row.limit for row in alike] == pytest.approx([row.limit for row in alone], rel=1e-9)
    assert [row.gain for row in alike] == pytest.approx([row.gain for row in alone], rel=1e-9)
