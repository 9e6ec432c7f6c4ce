"""The host's link: what each kind of device is shown, the operator on his way back, and loops that end or die."""

import os

import numpy as np
import pytest

import graspfx as gx
from graspfx.errors import DeviceError, InputError
from graspfx.feedback import host_link
from graspfx.system.shared_memory import Named, file_of
from tests.support.hosted import HALF, hosted, hosted_scene, name_of

PINCH = np.array([[-0.02, 0.0, 0.0], [0.02, 0.0, 0.0]])
FORCES = np.array([[1.2, 0.0, 0.1], [-0.8, 0.0, 0.1]])


def settled(points, forces, feedback=None):
    feedback = gx.Feedback() if feedback is None else feedback
    feedback.update(points, forces, 0.0)
    return feedback.update(points, forces, 1.0)


@pytest.mark.parametrize("fingers", [1, 2, 3])
def test_each_device_is_shown_what_it_can(fingers):
    """One finger the push, two each their own, three the two that there are."""
    shown = settled(PINCH, FORCES)
    with hosted(hosted_scene(fingers=fingers)) as (session, link):
        link.read()
        link.show(shown, 0.0)
        session.step(5)
        force = link.read().force
    expected = {1: np.array([[0.4, 0.0, 0.2]]), 2: FORCES, 3: np.vstack([FORCES, np.zeros(3)])}
    assert np.allclose(force, expected[fingers], rtol=0, atol=1e-12)


def test_a_device_of_two_fingers_shows_push_and_grip_of_any_hand():
    points = np.array([[0.03, 0.0, 0.0], [-0.015, 0.026, 0.0], [-0.015, -0.026, 0.01]])
    shown = settled(points, -2.0 * (points.mean(axis=0) - points) / 0.03 + [0.0, 0.0, -0.1])
    with hosted(hosted_scene()) as (session, link):
        link.read()
        link.show(shown, 0.0)
        session.step(5)
        read = link.read()
    assert shown.grip < -1.0
    assert np.allclose(read.force.sum(axis=0), shown.push, rtol=0, atol=1e-12)
    inward = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    assert ((read.force - shown.push / 2.0) * inward).sum(axis=1) == pytest.approx(shown.grip, abs=1e-3)


def test_more_fingers_than_a_hand_of_three_has_are_refused():
    rng = np.random.default_rng(0)
    shown = settled(0.03 * rng.normal(size=(5, 3)), rng.normal(size=(5, 3)))
    with hosted(hosted_scene(fingers=3)) as (_, link), pytest.raises(InputError, match="at most 3 fingers"):
        link.show(shown, 0.0)


def test_forces_of_another_dimension_are_refused():
    shown = settled(PINCH[:, :2], FORCES[:, :2])
    with hosted(hosted_scene()) as (_, link), pytest.raises(InputError, match="3 coordinates"):
        link.show(shown, 0.0)


def test_the_operator_goes_the_other_way():
    def opens(i):
        """The finger at -20 mm goes to -30 mm, the other one to 26 mm."""
        return {"stiffness": 500.0, "damping": 10.0, "rest": [[-0.03, 0.0, 0.004], [0.026, 0.0, 0.004]][i]}

    with hosted(hosted_scene(hand=opens)) as (session, link):
        first = link.read()
        assert first.aperture == pytest.approx(2.0 * HALF)
        session.step(2000)
        read = link.read()
    assert read.time == pytest.approx(2.0)
    assert read.aperture == pytest.approx(0.056, abs=1e-6)
    assert np.allclose(read.centre, [-0.002, 0.0, 0.004], rtol=0, atol=1e-6)
    assert np.abs(read.velocity).max() < 1e-4


def test_a_loop_that_ends_tells_its_host():
    with gx.open(hosted_scene()) as session:
        session.step()
        link = host_link.HostLink(name_of(session.scene), timeout=0.0)
        link.read()
    with pytest.raises(DeviceError, match="has ended"):
        link.read()
    with pytest.raises(DeviceError, match="has ended"):
        link.show(settled(PINCH, FORCES), 0.0)
    link.stop()  # nobody is there


def test_a_loop_that_was_killed_is_not_waited_for(monkeypatch):
    monkeypatch.setattr(host_link, "DEAD", 0.05)
    with hosted(hosted_scene()) as (_, link):
        link.read(0.0)
        with pytest.raises(DeviceError, match="killed"):
            link.read(1.0)


def test_a_host_that_starts_anew_goes_on_with_the_numbers():
    with hosted(hosted_scene()) as (session, link):
        for k in range(3):
            link.read()
            link.show(settled(PINCH, FORCES), 0.01 * k)
            session.step(5)
        other = host_link.HostLink(link.name, timeout=0.0)
        other.read()
        other.show(settled(PINCH, -FORCES), 0.0)
        session.step(5)
        read = other.read()
    assert (read.lost, read.late) == (0, 0)
    assert np.allclose(read.force, -FORCES, rtol=0, atol=1e-12)


def test_an_error_of_the_host_lets_the_force_fade():
    with hosted(hosted_scene()) as (session, first):
        with pytest.raises(InputError, match="diverged"), gx.Feedback().connect(first.name) as link:  # noqa: PT012
            feedback = gx.Feedback()
            link.read()
            link.show(settled(PINCH, FORCES, feedback), 0.0)
            session.step(5)
            feedback.update(PINCH, FORCES * np.nan, 2.0)
        session.step(60)
        assert "host has ended" in str(session.fault)
        assert not session.recording.displayed_force[-1].any()


def test_a_name_is_its_users_alone_and_goes_with_its_owner():
    name = f"own-{os.getpid()}"
    owner, other = Named(name, 64), Named(name, 64)
    try:
        assert owner.publish()
        assert owner.publish()  # once more changes nothing
        assert file_of(name).stat().st_mode & 0o777 == 0o600
        assert not other.publish()
    finally:
        owner.close()
        other.close()
    assert not list(file_of(name).parent.glob(f"{file_of(name).name}*"))


def test_no_file_is_left_by_a_check_or_a_run():
    scene = hosted_scene()
    gx.check(scene)
    with gx.open(scene) as session:
        session.step(3)
        assert file_of(name_of(scene)).exists()
    path = file_of(name_of(scene))
    assert not list(path.parent.glob(f"{path.name}*"))
