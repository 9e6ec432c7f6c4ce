"""Kinds of split against dense algebra, published bases and what each promises."""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.errors import InputError, UnknownNameError

POINTS = np.array([[0.03, 0.0, 0.0], [-0.015, 0.026, 0.0], [-0.015, -0.026, 0.01], [0.0, 0.0, 0.03]])
WEIGHTS = [1.0, 2.0, 0.5, 4.0]


@pytest.mark.parametrize("unit", [1.0, 1000.0])
@pytest.mark.parametrize(
    ("kind", "more"),
    [("pseudoinverse", {}), ("mass", {"weights": WEIGHTS}), ("weights", {"weights": WEIGHTS}),
     ("stiffness", {"stiffness": WEIGHTS}), ("virtual-linkage", {})],
)  # fmt: skip
def test_a_kind_is_its_formula(kind: Any, more: dict[str, Any], unit: float) -> None:
    """M G'(G M G')^+ G f, in metres and millimetres; without moments the virtual linkage is the pseudo-inverse."""
    f = np.random.default_rng(0).normal(size=12)
    G, M = gx.grasp_matrix(POINTS), np.diag(np.repeat(next(iter(more.values()), np.ones(4)), 3))
    expected = M @ G.T @ np.linalg.pinv(G @ M @ G.T, rcond=1e-12) @ G @ f
    external, internal = gx.divide(gx.Grasp(unit * POINTS), f, kind=kind, **more)
    np.testing.assert_allclose(external, expected, rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(external + internal, f, rtol=0.0, atol=1e-15)
    by_finger = gx.divide(gx.Grasp(unit * POINTS), f.reshape(4, 3), kind=kind, **more)[0]
    np.testing.assert_array_equal(by_finger.ravel(), external)


def test_weights_are_virtual_masses_of_a_rigid_body() -> None:
    """About the masses' centre f_i = m_i (F/m + (J^-1 tau) x r_i), Erhart and Hirche: 1e-12."""
    masses = np.array(WEIGHTS)
    r = POINTS - masses @ POINTS / masses.sum()
    J = sum(m * (x @ x * np.eye(3) - np.outer(x, x)) for m, x in zip(masses, r, strict=True))
    f = np.random.default_rng(1).normal(size=(4, 3))
    F, tau = f.sum(axis=0), np.cross(r, f).sum(axis=0)
    expected = masses[:, None] * (F / masses.sum() + np.cross(np.linalg.solve(J, tau), r))
    external, _ = gx.divide(gx.Grasp(POINTS), f, kind="mass", weights=masses)
    np.testing.assert_allclose(external, expected, rtol=0.0, atol=1e-12)


def bicchi(a: float) -> tuple[gx.Grasp, np.ndarray]:
    """Example 7.1 of Bicchi (1994), as github.com/ssilenzi/random-grasp-planning-with-contacts has it.

    And the order of its columns, 9 forces and 3 torsions, among ours.
    """
    s = np.sqrt(3.0)
    points = np.array([[0.0, 0.0, 2.0 * a], [0.0, 2.0 * a, 3.0 * a], [0.0, 2.0 * a, a]])
    normals = np.array([[0.0, 1.0, 0.0], [0.0, -s / 2.0, -0.5], [0.0, -s / 2.0, 0.5]])
    grasp = gx.Grasp(points, normals, model="soft")
    return grasp, np.array([0, 1, 2, 4, 5, 6, 8, 9, 10, 3, 7, 11])


def test_bicchi_example_has_its_printed_null_space() -> None:
    """Rank 6; the six printed internal forces make no wrench (5e-15 N m at a = 50), and the split leaves them alone."""
    a, s = 50.0, np.sqrt(3.0)
    grasp, order = bicchi(a)
    printed = np.array([
        (0, 2, 1, 0, -2, -1, 0, 0, 0, 0, 0, 0), (0, 2, -1, 0, 0, 0, 0, -2, 1, 0, 0, 0),
        (0, 0, 0, 0, 0, 1, 0, 0, -1, 0, 0, 0), (-2, 0, 0, 1, 0, 0, 1, 0, 0, 0, -4 * a, 4 * a),
        (0, 0, 0, 1, 0, 0, -1, 0, 0, 0, 2 * a / s, 2 * a / s), (0, 0, 0, 0, 0, 0, 0, 0, 0, s, 1, 1),
    ])  # fmt: skip
    assert np.linalg.matrix_rank(grasp.matrix) == 6 and np.linalg.matrix_rank(printed) == 6
    np.testing.assert_allclose(grasp.matrix[:, order] @ printed.T, 0.0, atol=5e-14)
    f = np.zeros((6, 12))
    f[:, order] = printed
    external, internal = gx.divide(grasp, f, metric=grasp.metric(torsion_length=10.0))
    np.testing.assert_allclose(external, 0.0, atol=1e-12)
    np.testing.assert_allclose(internal, f, rtol=0.0, atol=1e-12)


def test_bicchi_example_divides_by_stiffness_as_computed() -> None:
    """K = diag of fingers, w = (0, 1, 0, -100, 0, 0): the y-forces of THEORY 9, ten digits, and nothing else."""
    a = 50.0
    grasp, order = bicchi(a)
    K = np.diag([20.0, 1.0 / (0.05 + 0.04 * a**2), *[20.0] * 7, 100.0, 100.0, 100.0])
    own = np.zeros((12, 12))
    own[np.ix_(order, order)] = K
    w = np.array([0.0, 1.0, 0.0, -100.0, 0.0, 0.0])
    f = np.linalg.lstsq(grasp.matrix, -w, rcond=None)[0]
    external, internal = gx.divide(grasp, f, kind="stiffness", stiffness=own)
    expected = np.zeros(12)
    expected[[1, 4, 7]] = -0.0002498126405, -0.4998750937, -0.4998750937
    np.testing.assert_allclose(external[order], expected, rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(grasp.matrix @ internal, 0.0, atol=1e-10)


@pytest.mark.parametrize(
    ("more", "name"),
    [({"kind": "weights"}, "weights"), ({"kind": "mass", "weights": [1.0]}, "weights"),
     ({"weights": WEIGHTS}, "weights"), ({"kind": "stiffness", "stiffness": [1.0, -1.0, 1.0, 1.0]}, "metric"),
     ({"kind": "weights", "weights": WEIGHTS, "metric": WEIGHTS}, "metric"),
     ({"kind": "virtual-linkage", "weights": WEIGHTS}, "weights")],
)  # fmt: skip
def test_faults_are_told_by_their_argument(more: dict[str, Any], name: str) -> None:
    with pytest.raises(InputError, match=name):
        gx.divide(gx.Grasp(POINTS), np.zeros(12), **more)


def test_a_bare_matrix_and_contacts_with_moments() -> None:
    """A bare matrix does not know its contacts, a number per finger no unit of moments; other kinds are unknown."""
    with pytest.raises(InputError, match="Grasp"):
        gx.divide(gx.grasp_matrix(POINTS), np.zeros(12), kind="weights", weights=WEIGHTS)
    with pytest.raises(InputError, match="moments"):
        gx.divide(gx.Grasp(POINTS, POINTS, model="soft"), np.zeros(16), kind="stiffness", stiffness=WEIGHTS)
    with pytest.raises(UnknownNameError, match="kind of split"):
        gx.divide(gx.Grasp(POINTS), np.zeros(12), kind="equal")  # type: ignore[arg-type]


def test_one_force_for_many_sets_of_contacts() -> None:
    """One force, flat or by finger, is divided by each set; so are a set's own forces, also of a single contact."""
    rng = np.random.default_rng(3)
    points, f = rng.normal(size=(5, 3, 3)), rng.normal(size=(3, 3))
    expected = [gx.divide(gx.Grasp(each), f) for each in points]
    for given in (f, f.ravel()):
        parts = gx.divide(gx.Grasp(points), given)
        for part, own in zip(parts, zip(*expected, strict=True), strict=True):
            np.testing.assert_allclose(part, np.reshape(own, (5, *given.shape)), rtol=0.0, atol=1e-12)
    bare = gx.divide(gx.grasp_matrix(points), f.ravel())
    np.testing.assert_allclose(bare[0], gx.divide(gx.Grasp(points), f.ravel())[0], rtol=0.0, atol=1e-9)
    forces = rng.normal(size=(5, 1, 3))
    np.testing.assert_allclose(gx.divide(gx.Grasp(points[:, :1]), forces)[0], forces, rtol=0.0, atol=1e-12)
    for bad in (rng.normal(size=(4, 9)), "a", None, [[1.0], [1.0, 2.0]], np.zeros(8)):
        with pytest.raises(InputError, match=r"^force: given"):
            gx.divide(gx.Grasp(points), bad)  # type: ignore[arg-type]


def test_the_page_has_the_table_of_its_script() -> None:
    """Push, squeeze and limits of each kind on one grasp and load, computed anew."""
    docs = Path(__file__).parents[2] / "docs"
    script = runpy.run_path(str(docs / "pictures" / "which_split.py"))
    page = (docs / "explanation" / "which-split.md").read_text(encoding="utf-8")
    assert "\n".join(script["table"]()) in page
