"""`gx.Feedback`: push, grip and fingers' forces of a host's contacts, against the split and closed forms."""

import numpy as np
import pytest

import graspfx as gx
from graspfx.errors import InputError

PINCH = np.array([[-0.02, 0.0, 0.0], [0.02, 0.0, 0.0]])
THREE = np.array([[0.03, 0.0, 0.0], [-0.015, 0.026, 0.0], [-0.015, -0.026, 0.01]])


def settled(feedback, points, forces, **more):
    feedback.update(points, forces, 0.0, **more)
    return feedback.update(points, forces, 1.0, **more)


@pytest.mark.parametrize("d", [1, 2, 3])
@pytest.mark.parametrize("n", [1, 2, 3, 5])
def test_the_split_is_that_of_divide(n, d):
    rng = np.random.default_rng(10 * n + d)
    points, forces = 0.05 * rng.normal(size=(n, d)), rng.normal(size=(n, d))
    shown = settled(gx.Feedback(engine="interpreted"), points, forces)
    external, internal = gx.divide(gx.Grasp(points), forces)
    assert np.allclose(shown.external, external, rtol=0, atol=1e-12)
    assert np.allclose(shown.internal, internal, rtol=0, atol=1e-12)
    assert np.allclose(shown.push, forces.sum(axis=0), rtol=0, atol=1e-12)


def test_both_engines_give_the_same_bits():
    rng = np.random.default_rng(3)
    one, other = gx.Feedback(0.5, 2.0, engine="interpreted"), gx.Feedback(0.5, 2.0, engine="compiled")
    for k in range(20):
        m = 1 + k % 4
        points, forces = rng.normal(size=(m, 3)), rng.normal(size=(m, 3))
        a, b = one.update(points, forces, 0.01 * k), other.update(points, forces, 0.01 * k)
        assert np.array_equal(a.fingers, b.fingers)
        assert a.grip == b.grip


def test_an_object_between_two_fingers_opens_the_hand():
    """Pressed by 2 N a finger, an object pushes the fingers apart: the operator's are opened by 2 N."""
    shown = settled(gx.Feedback(), PINCH, np.array([[-2.0, 0.0, 0.0], [2.0, 0.0, 0.0]]))
    assert shown.grip == pytest.approx(-2.0)
    assert np.allclose(shown.push, 0.0)
    assert shown.fingers[0, 0] < 0.0 < shown.fingers[1, 0]  # away from one another


def test_an_obstacle_pushes_the_hand_back():
    """A hand that moves along x into a wall feels the wall's force, along -x."""
    shown = settled(gx.Feedback(), PINCH, np.array([[-1.5, 0.0, 0.0], [-1.5, 0.0, 0.0]]))
    assert np.allclose(shown.push, [-3.0, 0.0, 0.0])
    assert shown.grip == pytest.approx(0.0)


def test_gains_that_are_matrices():
    push, squeeze = np.diag([1.0, 2.0, 0.0]), np.array([[1.0, 0.2, 0.0], [0.2, 1.0, 0.0], [0.0, 0.0, 0.5]])
    forces = np.random.default_rng(1).normal(size=(3, 3))
    shown = settled(gx.Feedback(push, squeeze), THREE, forces)
    external, internal = gx.divide(gx.Grasp(THREE), forces)
    assert np.allclose(shown.fingers, external @ push.T + internal @ squeeze.T, rtol=0, atol=1e-12)
    assert np.allclose(shown.push, push @ forces.sum(axis=0), rtol=0, atol=1e-12)


def test_grip_is_along_the_normals_where_they_are_given():
    normals = np.array([[1.0, 1.0, 0.0], [-3.0, 0.0, 0.0]])
    forces = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    shown = settled(gx.Feedback(squeeze_gain=2.0), PINCH, forces, normals=normals)
    assert shown.grip == pytest.approx(2.0 * (np.sqrt(0.5) + 1.0) / 2.0)


def test_moment_has_torques_and_moves_with_the_reference():
    forces, torques = np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]]), np.array([[0.0, 0.0, 0.01], [0.0, 0.0, 0.0]])
    feedback = gx.Feedback()
    shown = settled(feedback, PINCH, forces, torques=torques)
    assert np.allclose(shown.moment, [0.0, 0.0, -0.04 + 0.01])
    moved, more = PINCH + np.array([0.3, 0.0, 0.0]), forces + np.array([0.0, 1.0, 0.0])
    both = feedback.update(moved, more, 2.0, torques=torques, reference=[0.3, 0.0, 0.0])
    assert np.allclose(both.moment, shown.moment)  # the same about the object's centre, wherever that is
    away = feedback.update(moved, more, 3.0, torques=torques, reference=[0.0, 0.0, 0.0])
    assert np.allclose(away.moment, shown.moment + np.array([0.0, 0.0, 0.3 * 2.0]))


def test_a_finger_with_several_contacts_is_one_finger():
    points = np.array([[-0.02, 0.005, 0.0], [-0.02, -0.005, 0.0], [0.02, 0.0, 0.0]])
    forces = np.array([[-1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    shown = settled(gx.Feedback(fingers=3), points, forces, finger=[0, 0, 2])
    assert shown.grip == pytest.approx(-2.0)
    assert np.allclose(shown.fingers, [[-2.0, 0.0, 0.0], [0.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    assert shown.touching.tolist() == [True, False, True]


def test_contacts_that_come_and_go_make_no_step():
    """Fingers touch and let go again and again: |change of a force| <= 2 F dt/fade, F all forces."""
    fade, dt, forces = 0.05, 1e-3, np.array([[-2.0, 0.5, 0.0], [1.0, -1.0, 0.3], [1.0, 0.4, 0.0]])
    feedback, steps, largest = gx.Feedback(fade=fade, fingers=3), [], 0.0
    before = None
    for k in range(2000):
        some = [0, 1, 2] if k // 100 % 2 else [0, 1] if k // 200 % 2 else []
        shown = feedback.update(THREE[some], forces[some], dt * k, finger=np.array(some, dtype=int))
        felt = np.concatenate([shown.fingers.ravel(), shown.push, [shown.grip]])
        if before is not None:
            steps.append(np.abs(felt - before).max())
        before, largest = felt, max(largest, np.abs(felt).max())
    total = np.linalg.norm(forces, axis=1).sum()
    assert largest > 1.5  # the forces are there,
    assert max(steps) <= 2.0 * total * dt / fade  # and come gradually


def test_without_the_fade_forces_would_step():
    feedback = gx.Feedback(fade=1e-9)
    feedback.update(PINCH, PINCH * 100.0, 0.0)
    full = feedback.update(PINCH, PINCH * 100.0, 0.001)
    gone = feedback.update(np.zeros((0, 3)), np.zeros((0, 3)), 0.002)
    assert np.abs(full.fingers - gone.fingers).max() == pytest.approx(2.0)


def test_no_contact_is_no_force_and_says_so():
    feedback = gx.Feedback()
    settled(feedback, PINCH, PINCH * 100.0)
    shown = feedback.update(np.zeros((0, 3)), np.zeros((0, 3)), 1.001)
    assert np.abs(shown.fingers).max() > 1.9  # still there, and on its way
    shown = feedback.update(np.zeros((0, 3)), np.zeros((0, 3)), 1.1)
    assert not shown.fingers.any()
    assert shown.grip == 0.0
    assert not shown.push.any()
    assert "no contact" in shown.message


@pytest.mark.parametrize(
    ("points", "forces", "more", "words"),
    [
        (PINCH, np.full((2, 3), np.nan), {}, "forces: .*find where|forces: .*diverged"),
        (np.full((2, 3), np.inf), PINCH, {}, "points"),
        (PINCH, PINCH * 1e9, {}, "largest"),
        (PINCH, PINCH[:1], {}, "two arrays of the same shape"),
        (PINCH[:, 0], PINCH[:, 0], {}, "two arrays of the same shape"),
        (PINCH, PINCH, {"normals": PINCH[:1]}, "normals"),
        (PINCH, PINCH, {"torques": np.full((2, 3), np.nan)}, "finite"),
        (PINCH, PINCH, {"torques": np.full((2, 3), 1e41)}, "at most 1e"),
        (PINCH, PINCH, {"reference": [np.nan, 0.0, 0.0]}, "finite"),
        (PINCH, PINCH, {"reference": [1e41, 0.0, 0.0]}, "at most 1e"),
        (PINCH, PINCH, {"finger": [0.5, 1.0]}, "non-negative integers"),
        (PINCH, PINCH, {"finger": [0, -1]}, "non-negative integers"),
        (PINCH, PINCH, {"time": 0.0}, "after that of the previous sample"),
        (PINCH[:, :2], PINCH[:, :2], {}, "as in the previous samples"),
    ],
)
def test_what_cannot_be_meant_is_refused_and_loses_nothing(points, forces, more, words):
    feedback = gx.Feedback()
    settled(feedback, PINCH, PINCH * 100.0)
    with pytest.raises(InputError, match=words):
        feedback.update(points, forces, more.pop("time", 2.0), **more)
    shown = feedback.update(PINCH, PINCH * 100.0, 3.0)
    assert shown.grip == pytest.approx(-2.0)


@pytest.mark.parametrize(
    "arguments",
    [{"push_gain": -1.0}, {"squeeze_gain": [1.0, 2.0]}, {"push_gain": -np.eye(3)}, {"fade": 0.0}, {"fingers": 0},
     {"engine": "fast"}, {"largest": -1.0}, {"moment_gain": np.nan}],
)  # fmt: skip
def test_settings_that_cannot_be_meant_are_refused(arguments):
    with pytest.raises(InputError, match=next(iter(arguments))):
        gx.Feedback(**arguments)


def test_feedback_refuses_a_point_whose_products_overflow() -> None:
    """1e308 m is finite, but forces were NaN from this sample on."""
    feedback = gx.Feedback(fingers=3)
    feedback.update(THREE, -THREE, 0.01)
    far = THREE.copy()
    far[2, 2] = 1e308
    with pytest.raises(InputError, match="points"):
        feedback.update(far, -THREE, 0.02)
    assert np.isfinite(feedback.update(THREE, -THREE, 0.03).fingers).all()
