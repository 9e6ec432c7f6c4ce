"""The grasp matrix against the definition of a wrench, and the meaning of its rows and columns."""

from __future__ import annotations

import numpy as np
import pytest

import graspfx as gx
from graspfx.errors import InputError

MODELS = ["frictionless", "hard", "soft", "full"]


def wrench(points, axes, moments, finger, f, origin):
    """Force and moment of components along given axes, summed one by one."""
    total, turn = np.zeros(3), np.zeros(3)
    for a, b, i, x in zip(axes, moments, finger, f, strict=True):
        total += x * a
        turn += x * (np.cross(points[i] - origin, a) + b)
    return np.concatenate([total, turn])


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("framed", [False, True])
def test_columns_sum_to_the_wrench_in_space(seed, framed):
    rng = np.random.default_rng(seed)
    n = 5
    points, normals, origin = rng.normal(size=(n, 3)), rng.normal(size=(n, 3)), rng.normal(size=3)
    frames = np.array([np.linalg.qr(rng.normal(size=(3, 3)))[0] for _ in range(n)]) if framed else None
    model = [*MODELS, "soft"]
    grasp = gx.Grasp(points, None if framed else normals, model=model, frames=frames, origin=origin)
    f = rng.normal(size=1 + 3 + 4 + 6 + 4)
    axes, moments, finger = [], [], []
    zero = np.zeros(3)
    for i, name in enumerate(model):
        own = np.eye(3) if frames is None else frames[i].T
        normal = normals[i] / np.linalg.norm(normals[i]) if frames is None else frames[i][:, 2]
        forces = [normal] if name == "frictionless" else list(own)
        torsions = {"soft": [normal], "full": list(own)}.get(name, [])
        axes += forces + [zero] * len(torsions)
        moments += [zero] * len(forces) + torsions
        finger += [i] * (len(forces) + len(torsions))
    assert np.allclose(grasp.matrix @ f, wrench(points, axes, moments, finger, f, origin), atol=1e-14)
    assert grasp.finger_of_column.tolist() == finger
    assert grasp.torsion_columns.tolist() == [bool(np.any(b)) for b in moments]
    assert grasp.moment_rows.tolist() == [False] * 3 + [True] * 3


def test_line_is_a_row_of_ones():
    assert np.array_equal(gx.grasp_matrix([[-1.0], [0.5], [2.0]]), [[1.0, 1.0, 1.0]])
    # along normals that oppose, pushing forces count with their sign
    assert np.array_equal(gx.grasp_matrix([[-1.0], [1.0]], [[2.0], [-2.0]], model="frictionless"), [[1.0, -1.0]])


def test_plane_by_hand():
    # moments x f_y - y f_x about (0.5, 0); the full contact adds its own t_z
    G = gx.grasp_matrix([[1.0, 2.0], [0.0, -1.0]], model=["hard", "full"], origin=[0.5, 0.0])
    assert np.array_equal(G, [[1.0, 0.0, 1.0, 0.0, 0.0], [0.0, 1.0, 0.0, 1.0, 0.0], [-2.0, 0.5, 1.0, -0.5, 1.0]])


def test_locked_freedoms_leave_rows_out():
    points = np.random.default_rng(0).normal(size=(3, 3))
    free = [True, False, True, False, False, True]
    grasp = gx.Grasp(points, free=free)
    assert np.array_equal(grasp.matrix, gx.grasp_matrix(points)[np.array(free)])
    assert grasp.moment_rows.tolist() == [False, False, True]
    assert gx.grasp_matrix(points, free=[False] * 6).shape == (0, 9)


def test_metric_of_weights_and_a_torsion_length():
    # weight of the finger, times (4 mm)^2 for the torsion of the soft one
    grasp = gx.Grasp([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]], [[1.0, 0.0, 0.0]] * 2, model=["soft", "hard"])
    assert np.allclose(grasp.metric(torsion_length=0.004, weights=[2.0, 3.0]), [2, 2, 2, 32e-6, 3, 3, 3], rtol=1e-15)
    assert gx.Grasp([[0.0, 1.0]]).metric().tolist() == [1.0, 1.0]
    for bad in (
        {},
        {"torsion_length": 0.0},
        {"torsion_length": np.nan},
        {"torsion_length": 0.01, "weights": [1.0, 0.0]},
    ):
        with pytest.raises(InputError):
            grasp.metric(**bad)


@pytest.mark.parametrize(
    "arguments",
    [
        {"origin": [0.0, 0.0]},
        {"origin": [0.0, 0.0, np.nan]},
        {"free": [True] * 3},
        {"free": [True] * 5 + [2]},
        {"free": "all"},
    ],
)
def test_origin_and_mask_that_do_not_fit(arguments):
    with pytest.raises(InputError, match=next(iter(arguments))):
        gx.Grasp(np.eye(3), **arguments)
