"""Force closure: Nguyen's rule for pairs, known frictionless grasps, and both proofs checked against the cones."""

from __future__ import annotations

import numpy as np
import pytest

import graspfx as gx
from graspfx.errors import InputError, UnknownNameError
from tests.support.grasps import polygon
from tests.support.optional import require


def unit(x):
    return x / np.linalg.norm(x, axis=-1, keepdims=True)


def pushes(grasp, mu, gamma, rng, count, independent=False):
    """Random forces (count, m) on the boundary of the cones, one contact at a time."""
    d, n = grasp.dimensions, grasp.fingers
    f = np.zeros((count, len(grasp.finger_of_column)))
    for k in range(count):
        i = rng.integers(n)
        normal = grasp.contacts.normals[i]
        side = rng.normal(size=d)
        side = unit(side - side @ normal * normal) if d > 1 else np.zeros(1)
        angle = rng.uniform(0, 2 * np.pi)
        shear, twist = (1.0, rng.choice([-1, 1])) if independent else (np.cos(angle), np.sin(angle))
        soft = grasp.contacts.models[i] == "soft" and d == 3
        if not soft:
            shear, twist = 1.0, 0.0
        if grasp.contacts.models[i] == "frictionless":
            shear = 0.0
        force = normal + mu * shear * side
        own = grasp.finger_of_column == i
        f[k, own] = grasp.contacts.force_axes[own] @ force + grasp.torsion_columns[own] * gamma * twist
    return f


def assert_proved(grasp, found, mu, gamma=0.0, independent=False):
    """The answer's own proof, from the definition alone."""
    if found.closed:
        f = found.squeeze
        assert np.abs(grasp.matrix @ f).max() < 1e-14 * (1.0 + np.abs(grasp.matrix).max())
        total = 0.0
        for i in range(grasp.fingers):
            own = grasp.finger_of_column == i
            world = f[own & ~grasp.torsion_columns] @ grasp.contacts.force_axes[own & ~grasp.torsion_columns]
            normal = world @ grasp.contacts.normals[i]
            side = np.linalg.norm(world - normal * grasp.contacts.normals[i])
            twist = np.abs(f[own & grasp.torsion_columns]).sum()
            total += normal
            assert normal > 0.0
            if independent:
                assert side < mu * normal and twist < gamma * normal
            elif grasp.contacts.models[i] == "frictionless":
                assert side < 1e-15
            else:
                assert np.hypot(side / mu, twist / gamma if twist else 0.0) < normal
        assert np.isclose(total, 1.0, rtol=1e-9)
        assert np.linalg.matrix_rank(grasp.matrix) == len(grasp.matrix)
    else:
        # moments about the centroid, divided by the rms radius
        arms = grasp.points - grasp.points.mean(axis=0)
        scaled = gx.Grasp(
            grasp.points, grasp.contacts.normals, model=grasp.contacts.models, origin=grasp.points.mean(axis=0)
        ).matrix
        scaled[grasp.dimensions :] /= np.sqrt((arms**2).sum() / grasp.fingers)
        w = pushes(grasp, mu, gamma, np.random.default_rng(0), 500, independent) @ scaled.T
        assert np.isclose(np.linalg.norm(found.separating), 1.0, rtol=1e-12)
        assert (w @ found.separating).max() < 2e-7 * (1.0 + mu + gamma)


@pytest.mark.parametrize("d", [2, 3])
def test_two_fingers_close_iff_their_line_is_inside_both_cones(d):
    # Nguyen 1988: hard fingers in the plane, soft ones in space; hard ones in space cannot turn the object
    rng = np.random.default_rng(d)
    counted = np.zeros(2, dtype=int)
    for _ in range(60):
        points = rng.normal(size=(2, d))
        u = unit(points[1] - points[0])
        normals = unit(np.array([u, -u]) + rng.uniform(0.2, 1.0) * rng.normal(size=(2, d)))
        mu = rng.uniform(0.1, 1.5)
        cosines = (normals * [u, -u]).sum(axis=1)
        if np.abs(cosines - np.cos(np.arctan(mu))).min() < 1e-4:
            continue
        inside = bool((cosines > np.cos(np.arctan(mu))).all())
        grasp = gx.Grasp(points, normals, model="soft" if d == 3 else "hard")
        found = grasp.force_closure(mu, 0.1 if d == 3 else 0.0)
        assert found.closed == inside == bool(found)
        assert_proved(grasp, found, mu, 0.1)
        counted[int(inside)] += 1
        if d == 3:
            assert not gx.Grasp(points, normals).force_closure(mu)
    assert counted.min() > 10


@pytest.mark.parametrize("tilt", [-1e-5, 1e-5])
def test_the_edge_of_the_cone_is_found_to_five_digits(tilt):
    # both normals tilted by atan(mu) (1 + tilt) to opposite sides of the line: closed inside, not closed outside
    mu = 0.5
    angle = np.arctan(mu) * (1 + tilt)
    n = np.array([np.cos(angle), np.sin(angle)])
    grasp = gx.Grasp([[-1.0, 0.0], [1.0, 0.0]], [n, -n])
    assert grasp.force_closure(mu).closed == (tilt < 0)


def pinwheel(turn, s=0.3):
    """Four contacts on the sides of a square, each s off the middle; the upper and lower to the same or other side."""
    points = np.array([[1.0, s], [-1.0, -s], [turn * s, 1.0], [-turn * s, -1.0]])
    return gx.Grasp(points, [[-1.0, 0.0], [1.0, 0.0], [0.0, -1.0], [0.0, 1.0]], model="frictionless")


def test_frictionless_square():
    # moments s, s from left and right; -s, -s from above and below if off to the same sense, else s, s: no -t_z then
    for turn, closed in ((1.0, True), (-1.0, False)):
        grasp = pinwheel(turn)
        found = grasp.force_closure()
        assert found.closed == closed
        assert_proved(grasp, found, 0.0)
    assert np.allclose(pinwheel(1.0).force_closure().squeeze, 0.25, rtol=1e-9)


def test_frictionless_contacts_never_close_on_a_disc():
    # all normals meet in the centre: no moment about it. The separating direction is that moment
    points = polygon(7, 0.03)
    found = gx.Grasp(points, -points, model="frictionless").force_closure()
    assert not found and np.isclose(abs(require(found.separating)[2]), 1.0, rtol=1e-12)
    assert gx.Grasp(points, -points, model="frictionless", free=[True, True, False]).force_closure()


def test_line():
    assert gx.Grasp([[0.0], [1.0]], [[1.0], [-1.0]]).force_closure()
    assert not gx.Grasp([[0.0], [1.0]], [[1.0], [1.0]]).force_closure()


def test_locked_object_is_closed_and_a_lone_finger_is_not():
    assert gx.Grasp(polygon(2, 1.0), polygon(2, -1.0), free=[False] * 3).force_closure()
    found = gx.Grasp([[0.0, 0.0]], [[1.0, 0.0]], free=[True, True, False]).force_closure(0.5)
    assert not found
    # nothing pushes back along -x
    assert require(found.separating)[0] <= -1 / np.sqrt(1.25) + 1e-9


@pytest.mark.parametrize("limit", ["elliptic", "independent"])
@pytest.mark.parametrize("seed", range(30))
def test_both_proofs_hold_for_random_grasps(seed, limit):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 6))
    points = unit(rng.normal(size=(n, 3)))
    normals = unit(-points + 0.5 * rng.normal(size=(n, 3)))
    model = [str(x) for x in rng.choice(["hard", "soft"], size=n)]
    grasp = gx.Grasp(points, normals, model=model)
    mu, gamma = rng.uniform(0.2, 1.2), 0.1
    found = grasp.force_closure(mu, gamma, limit=limit)
    assert_proved(grasp, found, mu, gamma, limit == "independent")
    assert (found.share > 0.0) == found.closed


@pytest.mark.parametrize("seed", range(10))
def test_scale_frame_and_reference_do_not_matter(seed):
    rng = np.random.default_rng(seed)
    points = unit(rng.normal(size=(3, 3)))
    normals = unit(-points + 0.3 * rng.normal(size=(3, 3)))
    Q = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    here = gx.Grasp(points, normals).force_closure(0.6)
    there = gx.Grasp(1000.0 * points @ Q.T + 7.0, normals @ Q.T, origin=rng.normal(size=3)).force_closure(0.6)
    assert here.closed == there.closed


def test_coefficient_per_contact():
    points = polygon(2, 1.0)
    normals = unit(-points + [[0.0, 0.2], [0.0, 0.2]])  # 11.3 degrees off
    assert gx.Grasp(points, normals).force_closure([0.3, 0.21])
    assert not gx.Grasp(points, normals).force_closure([0.3, 0.19])


def test_refuses_what_it_cannot_judge():
    points = np.column_stack([polygon(3, 1.0), np.zeros(3)])
    with pytest.raises(InputError, match="normals"):
        gx.Grasp(points).force_closure(0.5)
    with pytest.raises(InputError, match="no friction law"):
        gx.Grasp(points, -points, model="full").force_closure(0.5)
    with pytest.raises(InputError, match="torsion"):
        gx.Grasp(points, -points, model="soft").force_closure(0.5)
    with pytest.raises(InputError, match="friction"):
        gx.Grasp(points, -points).force_closure(-0.1)
    with pytest.raises(InputError, match="friction"):
        gx.Grasp(points, -points).force_closure([0.1, 0.2])
    with pytest.raises(UnknownNameError, match="independent"):
        gx.Grasp(points, -points).force_closure(0.1, limit="indpendent")  # type: ignore[arg-type] # misspelt


def test_every_random_grasp_is_decided():
    # near the boundary either proof is hard to find; of 150 grasps none is left without one
    for seed in range(150):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(2, 9))
        points = unit(rng.normal(size=(n, 3)))
        normals = unit(-points + rng.uniform(0.0, 1.0) * rng.normal(size=(n, 3)))
        found = gx.Grasp(points, normals, model="soft").force_closure(rng.uniform(0.1, 1.2), 0.05)
        assert (found.squeeze is None) == (not found.closed) and (found.separating is None) == found.closed
