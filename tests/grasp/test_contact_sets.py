"""Many sets of contacts in one call: each is as by itself, degenerate ones in the middle of a batch among them."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import graspfx as gx
from graspfx.compile.lazy_kernels import KernelOnDemand
from graspfx.errors import InputError
from graspfx.grasp import point_sets
from graspfx.grasp.split import UnitDependentSplitWarning

LAW = gx.Coupling(gx.Impedance(30.0, 0.2), gx.Impedance(70.0, 0.1))


def sets_of(rng: np.random.Generator, n: int, d: int) -> np.ndarray:
    """Contact sets (3, 4, n, d): one on a line, one nearly, one at a point, one 1 km away, one of a micrometre."""
    sets = rng.normal(size=(3, 4, n, d)) * 0.05
    line = rng.normal(size=(n, 1)) * rng.normal(size=d) * 0.05
    sets[0, 1] = line
    sets[0, 2] = line + 1e-9 * rng.normal(size=(n, d))
    sets[1, 0] = sets[1, 0, 0]
    sets[1, 2] += 1000.0
    sets[2, 1] *= 2e-5
    sets[2, 2] = line + 1000.0
    return sets


@pytest.mark.parametrize("d", [1, 2, 3])
@pytest.mark.parametrize("n", [1, 2, 3, 5, 20])
def test_forces_of_many_are_those_of_each_to_the_bit(n: int, d: int) -> None:
    rng = np.random.default_rng([n, d])
    points, e, de = sets_of(rng, n, d), rng.normal(size=(3, 4, n, d)), rng.normal(size=(3, 4, n, d))
    split = gx.Grasp(points).split()
    both, still = LAW.force(split, e, de), LAW.force(split, e)
    assert both.shape == (3, 4, n * d)
    for i in np.ndindex(3, 4):
        one = gx.Grasp(points[i]).split()
        assert split.rank[i] == one.rank
        assert np.array_equal(both[i], LAW.force(one, e[i], de[i]))
        assert np.array_equal(still[i], LAW.force(one, e[i].ravel()))
        np.testing.assert_allclose(split.external[i], one.external, rtol=0, atol=3e-16)
        np.testing.assert_array_equal(split.modes[i][:, : one.rank], one.modes)
        assert np.isclose(split.condition[i], one.condition, rtol=1e-9)


@pytest.mark.parametrize(
    ("keywords", "metric"),
    [
        ({"model": "frictionless"}, None),
        ({"model": "soft"}, "torsion"),
        ({"model": ["full", "hard", "soft", "frictionless", "hard"]}, "torsion"),
        ({"model": np.eye(6)[[0, 2, 5]]}, "torsion"),
        ({"free": [True, True, True, False, False, True]}, None),
        ({"free": [False, False, False, True, True, True], "origin": [0.1, 0.2, 0.3]}, None),
        ({"free": [True] * 3 + [False] * 3}, None),
        ({}, "weights"),
        ({}, "dense"),
        ({"model": "hard", "frames": True}, None),
    ],
)
def test_every_model_splits_many_as_each(keywords: dict[str, object], metric: str | None) -> None:
    rng = np.random.default_rng(3)
    points, normals = sets_of(rng, 5, 3), rng.normal(size=(3, 4, 5, 3))
    frames = np.linalg.qr(rng.normal(size=(3, 4, 5, 3, 3)))[0]
    framed = "frames" in keywords
    keywords = {key: value for key, value in keywords.items() if key != "frames"}

    def grasp_of(i: tuple[int, ...]) -> gx.Grasp:
        more = {"frames": frames[i]} if framed else {"normals": normals[i]}
        return gx.Grasp(points[i], **more, **keywords)  # type: ignore[arg-type] # of many kinds

    grasp = grasp_of(())
    m = grasp.components
    A = rng.normal(size=(m, m))
    M = {
        None: None, "weights": rng.uniform(0.5, 2.0, 5), "dense": A @ A.T + np.eye(m),
        "torsion": grasp.metric(torsion_length=0.006) if metric == "torsion" else None,
    }[metric]  # fmt: skip
    split = grasp.split(M)
    forces, e = rng.normal(size=(3, 4, m)), rng.normal(size=(3, 4, m))
    external, internal = split.divide(forces)
    f = LAW.force(split, e, 0.1 * e)
    K = LAW.stiffness(split)
    for i in np.ndindex(3, 4):
        one = grasp_of(i)
        np.testing.assert_allclose(grasp.matrix[i], one.matrix, rtol=0, atol=1e-12)
        alone = one.split(M)
        assert split.rank[i] == alone.rank
        near = 1e-14 * max(alone.condition, 100.0)  # the order of sums is not the same, and the condition tells
        pairs = [
            (split.external[i], alone.external), (split.displacement_external[i], alone.displacement_external),
            (external[i], alone.divide(forces[i])[0]),
        ]  # fmt: skip
        for many, single in pairs:
            np.testing.assert_allclose(many, single, rtol=0, atol=near)
        np.testing.assert_allclose(f[i], LAW.force(alone, e[i], 0.1 * e[i]), rtol=0, atol=100 * near)
        np.testing.assert_allclose(K[i], LAW.stiffness(alone), rtol=0, atol=100 * near)
    assert np.array_equal(internal, forces - external)


@pytest.mark.parametrize("form", ["literal", "symmetric"])
@pytest.mark.parametrize("shape", [(5,), (3, 3), (5, 3, 3), (15, 15)])
def test_gains_as_matrices_take_many_sets(form: str, shape: tuple[int, ...]) -> None:
    rng = np.random.default_rng(5)
    points, e = sets_of(rng, 5, 3), rng.normal(size=(3, 4, 5, 3))
    square = rng.normal(size=shape)
    outer = square**2 if len(shape) == 1 else square @ np.swapaxes(square, -1, -2)
    law = gx.Coupling(gx.Impedance(outer), gx.Impedance(70.0, 0.3), form=form)  # type: ignore[arg-type] # one of both
    split = gx.Grasp(points).split()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        f = law.force(split, e, 0.1 * e)
        for i in np.ndindex(3, 4):
            alone = gx.Coupling(law.external, law.internal, law.form).force(
                gx.Grasp(points[i]).split(), e[i], 0.1 * e[i]
            )
            np.testing.assert_allclose(f[i], alone, rtol=0, atol=1e-11 * np.abs(f).max())


def test_one_set_takes_many_displacements_and_many_take_one() -> None:
    rng = np.random.default_rng(6)
    points, e = rng.normal(size=(4, 3)), rng.normal(size=(7, 4, 3))
    split = gx.Grasp(points).split()
    rows = LAW.force(split, e)
    assert rows.shape == (7, 12)
    assert all(np.array_equal(row, LAW.force(split, each)) for row, each in zip(rows, e, strict=True))
    many = gx.Grasp(np.stack([points, 2 * points])).split()
    assert np.array_equal(LAW.force(many, e[0])[0], rows[0])
    assert np.array_equal(LAW.force(many, e[:, None])[:, 0], rows)
    weighed = gx.Grasp(points).split([1.0, 2.0, 3.0, 4.0])
    np.testing.assert_allclose(LAW.force(weighed, e)[3], LAW.force(weighed, e[3].ravel()), rtol=0, atol=1e-13)


def test_stacks_of_matrices() -> None:
    rng = np.random.default_rng(7)
    G = rng.normal(size=(6, 3, 8))
    G[2, 2] = G[2, 0]
    split = gx.Split(G)
    assert split.rank.tolist() == [3, 3, 2, 3, 3, 3]
    np.testing.assert_allclose(split.external, np.linalg.pinv(G) @ G, rtol=0, atol=1e-13)
    with pytest.raises(InputError, match="sets of contacts with equal ranks"):
        split.internal_basis  # noqa: B018 # an attribute that is computed
    basis = gx.Split(G[3:]).internal_basis
    assert basis.shape == (3, 8, 5)
    assert np.abs(G[3:] @ basis).max() < 1e-14


def test_what_needs_one_set_says_so() -> None:
    grasp = gx.Grasp(np.random.default_rng(8).normal(size=(2, 4, 3)))
    for function in (grasp.measures, grasp.force_closure, grasp.margin, grasp.virtual_linkage):
        with pytest.raises(InputError, match="one set of contacts"):
            function()
    with pytest.raises(InputError, match="one set of contacts"):
        grasp.split().internal_coordinates()
    assert "2" in repr(grasp) and "sets" in repr(grasp.split())


def test_shapes_that_do_not_go_together() -> None:
    split = gx.Grasp(np.random.default_rng(9).normal(size=(2, 4, 3))).split()
    for bad in (np.ones(5), np.ones((3, 12)), np.ones((3, 4, 3)), np.ones((2, 3, 4)), np.full((2, 12), np.nan)):
        with pytest.raises(InputError, match="e: given"):
            LAW.force(split, bad)
    with pytest.raises(InputError, match="force: given"):
        split.divide(np.ones((3, 12)))
    single = gx.Grasp(np.eye(3)).split()
    with pytest.raises(InputError, match="e: given"):
        LAW.force(single, np.ones((2, 9)))
    for bad in (np.ones(3), np.ones((0, 3)), np.ones((2, 4, 4)), np.ones((0, 4, 3))):
        with pytest.raises(InputError, match="points"):
            gx.Grasp(bad)


def test_soft_contacts_warn_once_for_a_batch() -> None:
    points = np.random.default_rng(10).normal(size=(2, 3, 3))
    with pytest.warns(UnitDependentSplitWarning) as caught:
        gx.Grasp(points, -points, model="soft").split()
    assert len(caught) == 1


def test_machine_code_and_interpreter_give_the_same_bits(monkeypatch: pytest.MonkeyPatch) -> None:
    """The engine changes by how much was computed: the answers before and after are the same."""
    pytest.importorskip("llvmlite")
    rng = np.random.default_rng(11)
    points, e = sets_of(rng, 5, 3), rng.normal(size=(3, 4, 15))
    answers = []
    for most in (float("inf"), 0):  # never, and at once
        for name in ("COUPLE", "COUPLE_ROWS", "MODE_ROWS"):
            kernel = getattr(point_sets, name).kernel
            monkeypatch.setattr(point_sets, name, KernelOnDemand(kernel, load=most, make=most))
        monkeypatch.setattr(point_sets, "SPACES", point_sets.Workspaces())
        split = gx.Grasp(points).split()
        alone = [LAW.force(gx.Grasp(points[i]).split(), e[i]) for i in np.ndindex(3, 4)]
        answers.append([LAW.force(split, e), np.array(alone), split.external])
        compiled = [getattr(point_sets, name).is_compiled for name in ("COUPLE", "COUPLE_ROWS", "MODE_ROWS")]
        assert all(compiled) if most == 0 else not any(compiled)
    assert all(np.array_equal(one, other) for one, other in zip(*answers, strict=True))


def test_nothing_is_formed_that_nobody_asks_for() -> None:
    grasp = gx.Grasp(np.random.default_rng(12).normal(size=(5, 3)))
    split = grasp.split()
    LAW.force(split, np.ones(15))
    lazy = {"contacts", "matrix", "external", "internal", "metric", "_modes", "_spectrum", "_point_modes"}
    assert not lazy & (set(vars(grasp)) | set(vars(split)))


def test_points_of_a_grasp_do_not_change_behind_its_split() -> None:
    points = np.random.default_rng(13).normal(size=(5, 3))
    grasp = gx.Grasp(points)
    split, before = grasp.split(), grasp.points.copy()
    points[:] = 0.0
    assert np.array_equal(grasp.points, before)
    with pytest.raises(ValueError, match="read-only"):
        grasp.points[0] = 0.0
    assert split.rank == 6
