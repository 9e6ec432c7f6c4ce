"""Contact models: which components each carries, in which axes, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from graspfx.errors import GraspFXError, InputError, UnknownNameError
from graspfx.grasp.contact import contacts
from graspfx.grasp.grasp import Grasp
from tests.support.optional import require

POINTS = {1: [[-0.02], [0.02]], 2: [[-0.02, 0.0], [0.02, 0.0]], 3: [[-0.02, 0.0, 0.0], [0.02, 0.0, 0.0]]}
NORMALS = {1: [[1.0], [-1.0]], 2: [[1.0, 0.0], [-1.0, 0.0]], 3: [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]}


@pytest.mark.parametrize(
    ("model", "per_contact"),
    [
        ("frictionless", {1: 1, 2: 1, 3: 1}),
        ("hard", {1: 1, 2: 2, 3: 3}),
        ("soft", {1: 1, 2: 2, 3: 4}),
        ("full", {1: 1, 2: 3, 3: 6}),
    ],
)
@pytest.mark.parametrize("d", [1, 2, 3])
def test_number_of_components(model, per_contact, d):
    found = contacts(POINTS[d], NORMALS[d], model=model)
    assert len(found.finger) == 2 * per_contact[d]
    assert found.finger.tolist() == [0] * per_contact[d] + [1] * per_contact[d]


def test_mixed_models_go_contact_by_contact_forces_before_moments():
    points = np.eye(3)
    found = contacts(points, -points, model=["soft", "frictionless", "full"])
    assert found.finger.tolist() == [0] * 4 + [1] + [2] * 6
    assert found.moment.tolist() == [False] * 3 + [True] + [False] + [False] * 3 + [True] * 3
    assert found.force_axes[4].tolist() == [0.0, -1.0, 0.0]  # along the normal of the second contact
    assert found.moment_axes[3].tolist() == [-1.0, 0.0, 0.0]  # torsion about the normal of the first
    assert np.array_equal(found.moment_axes[8:], np.eye(3))


def test_normals_are_scaled_to_unit_length_whatever_their_size():
    # 3-4-5, at sizes whose squares would overflow or underflow
    found = contacts([[0.0, 0.0]] * 2, [[3e200, 4e200], [3e-200, -4e-200]], model="frictionless")
    assert np.allclose(found.force_axes, [[0.6, 0.8], [0.6, -0.8]], rtol=1e-15)


def test_frames_give_the_axes_and_the_normal():
    # columns: y, z, x; the normal is x, and the components of a force are along y, z, x
    frame = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    soft = contacts([[0.0, 0.0, 0.0]], frames=[frame], model="soft")
    assert require(soft.normals).tolist() == [[1.0, 0.0, 0.0]]
    assert soft.force_axes[:3].tolist() == frame.T.tolist()
    assert soft.moment_axes[3].tolist() == [1.0, 0.0, 0.0]
    assert contacts([[0.0, 0.0, 0.0]], frames=[frame], model="frictionless").force_axes.tolist() == [[1.0, 0.0, 0.0]]


def test_the_input_is_not_kept():
    points = np.zeros((2, 3))
    found = contacts(points)
    points[:] = 1.0
    assert not found.points.any()


ROTATED = [[[0.8, 0.6], [-0.6, 0.8]]] * 2


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"points": [0.0, 1.0]}, "n, d"),
        ({"points": np.zeros((0, 3))}, "n > 0"),
        ({"points": np.zeros((2, 4))}, "d = 1, 2 or 3"),
        ({"points": [[0.0, np.nan]]}, "NaN"),
        ({"points": [[0.0, np.inf]]}, "finite"),
        ({"points": [["a", "b"]]}, "numbers"),
        ({"points": [[0.0], [0.0, 1.0]]}, "rectangular"),
        ({"points": POINTS[2], "normals": [[1.0, 0.0]]}, "shape (2, 2)"),
        ({"points": POINTS[2], "normals": [[1.0, 0.0], [0.0, 0.0]]}, "normals[1]"),
        ({"points": POINTS[2], "normals": [[1.0, 0.0], [np.nan, 0.0]]}, "normals"),
        ({"points": POINTS[2], "model": "frictionless"}, "contact 0"),
        ({"points": POINTS[3], "model": ["hard", "soft"]}, "contact 1"),
        ({"points": POINTS[2], "model": ["hard"]}, "each of the 2"),
        ({"points": POINTS[2], "frames": np.eye(2)}, "(2, 2, 2)"),
        ({"points": POINTS[2], "frames": [np.eye(2), 1.001 * np.eye(2)]}, "frames[1]"),
        ({"points": POINTS[2], "normals": NORMALS[2], "frames": ROTATED}, "last column"),
    ],
)
def test_what_cannot_be_used_is_refused_with_words(arguments, words):
    with pytest.raises(InputError) as caught:
        contacts(**arguments)
    assert words in str(caught.value)


def test_unknown_model_has_a_close_match():
    with pytest.raises(UnknownNameError, match="did you mean 'frictionless'"):
        contacts(POINTS[2], model="frictionles")
    with pytest.raises(GraspFXError):
        contacts(POINTS[2], model=["hard", "sotf"])


def test_soft_and_full_need_no_normal_where_they_have_no_torsion():
    # on the line and in the plane soft is hard; full is about z in the plane
    assert len(contacts(POINTS[2], model="soft").finger) == 4
    assert contacts(POINTS[2], model="full").moment_axes[2].tolist() == [1.0]
    assert contacts(POINTS[3], model="full").normals is None


FRAMES = np.array([np.linalg.qr(np.random.default_rng(k).normal(size=(3, 3)))[0] for k in range(3)])
SELECTED: dict[str, Any] = {
    "frictionless": {1: [[1.0]], 2: [[0, 1, 0]], 3: [[0, 0, 1, 0, 0, 0]]},
    "hard": {1: np.eye(1), 2: np.eye(3)[:2], 3: np.eye(6)[:3]},
    "soft": {1: np.eye(1), 2: np.eye(3)[:2], 3: np.eye(6)[[0, 1, 2, 5]]},
    "full": {1: np.eye(1), 2: np.eye(3), 3: np.eye(6)},
}


@pytest.mark.parametrize("name", SELECTED)
@pytest.mark.parametrize("d", [1, 2, 3])
def test_a_selection_that_says_what_a_name_does_is_the_same(name, d):
    frames = np.array([[[1.0]], [[-1.0]], [[1.0]]]) if d == 1 else FRAMES
    if d == 2:
        angle = np.array([0.3, 2.0, 4.0])
        frames = np.moveaxis(np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]), 2, 0)
    points = np.random.default_rng(7).normal(size=(3, d))
    named = Grasp(points, frames=frames, model=name)
    for model in (SELECTED[name][d], [SELECTED[name][d]] * 3, [name, SELECTED[name][d], name]):
        chosen = Grasp(points, frames=frames, model=model)
        assert np.array_equal(chosen.matrix, named.matrix)
        assert np.array_equal(chosen.torsion_columns, named.torsion_columns)
        assert np.array_equal(chosen.finger_of_column, named.finger_of_column)


def test_a_selection_may_turn_its_axes():
    # a force along (x + y)/sqrt 2 at (0, 0, 1), of moment z x (x + y)/sqrt 2 = (y - x)/sqrt 2, and a moment about x
    s = np.sqrt(0.5)
    grasp = Grasp([[0.0, 0.0, 1.0]], model=[[[s, s, 0, 0, 0, 0], [0, 0, 0, 1, 0, 0]]])
    assert np.allclose(grasp.matrix.T, [[s, s, 0, -s, s, 0], [0, 0, 0, 1, 0, 0]], rtol=0, atol=1e-16)
    assert grasp.contacts.models == ("selection",) and grasp.torsion_columns.tolist() == [False, True]


@pytest.mark.parametrize(
    ("model", "words"),
    [
        (np.eye(3), "(k, 6) with columns for 3 forces and 3 moments"),
        (np.zeros((0, 6)), "one for each of the 2"),
        ([[1, 0, 0, 1, 0, 0]], "a force and a moment have different units"),
        (np.eye(6)[[3, 0]], "before rows of moments"),
        (2.0 * np.eye(6), "orthonormal"),
        ([[1, 0, 0, 0, 0, 0], [1, 0, 0, 0, 0, 0]], "orthonormal"),
        ([[1, 0, 0, 0, 0, np.nan]], "finite"),
        ([np.eye(6)] * 3, "one for each of the 2"),
        (["hard", np.eye(4)], "model[1]"),
        ([["hard", "soft"], "hard"], "numbers"),
    ],
)
def test_a_selection_that_cannot_be_used_is_refused(model, words):
    with pytest.raises(InputError) as caught:
        contacts(POINTS[3], NORMALS[3], model=model)
    assert words in str(caught.value)


def test_closure_knows_no_friction_law_of_a_selection():
    with pytest.raises(InputError, match="a selection contact has no friction law"):
        Grasp(POINTS[3], NORMALS[3], model=np.eye(6)[:3]).force_closure(0.5)
