"""Scenes linearised about their grasp, against matrices by hand, python-control, runs, and `preloaded`."""

from __future__ import annotations

from pathlib import Path

import control
import numpy as np
import pytest

import graspfx as gx
from graspfx.certificate.linearise import linearise
from graspfx.errors import InputError, UnknownNameError
from tests.support.optional import require
from tests.support.sampled_loops import stepped_object
from tests.support.small_scenes import B_V, KEP, KIP, M_V, SPRING, B, M, attached


def by_hand(d: int) -> tuple[np.ndarray, np.ndarray]:
    """G and M_o of `attached`, from its numbers: force balance, moments by cross products, a solid box."""
    size = np.array([0.04, 0.05, 0.06][:d])
    directions = {1: [[-1], [1]], 2: [[-1, 0], [1, 0], [0, 1]], 3: [[-1, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, -1]]}[d]
    arms = np.zeros((len(directions), 3))
    arms[:, :d] = 0.5 * size * np.array(directions)
    blocks = []
    for arm in arms:
        moments = np.array([np.cross(arm, axis) for axis in np.eye(3)]).T
        blocks.append(np.vstack([np.eye(3)[:d, :d], moments[{1: [], 2: [2], 3: [0, 1, 2]}[d]][:, :d]]))
    if d == 1:
        return np.hstack(blocks), np.diag([M_V])
    x, y, *z = size**2
    about = [M_V * (x + y) / 12] if d == 2 else [M_V * (y + z[0]) / 12, M_V * (x + z[0]) / 12, M_V * (x + y) / 12]
    return np.hstack(blocks), np.diag([M_V] * d + about)


@pytest.mark.parametrize(("d", "integrator"), [(1, "exact"), (2, "explicit"), (3, "semi-implicit")])
def test_spectral_radius_is_that_of_python_control(d: int, integrator: str) -> None:
    """Plants sampled and the loop closed by python-control, from G, M_o and P made by hand: poles to 1e-6."""
    T = 0.004
    G, inertia = by_hand(d)
    P = np.linalg.pinv(G) @ G
    K = KEP * P + KIP * (np.eye(len(P)) - P)
    one = control.sample_system(
        control.ss([[0.0, 1.0], [-SPRING / M, -(B + 0.1) / M]], [[0.0], [1.0 / M]], [[1.0, 0.0]], 0.0), T, "zoh"
    )
    plants = [one] * G.shape[1]
    for i, m in enumerate(np.diag(inertia)):
        A, b = stepped_object(m, B_V if i < d else 4e-4, T, integrator)
        plants.append(control.ss(A, b[:, None], [[1.0, 0.0]], 0.0, T))
    stretch = np.hstack([np.eye(len(K)), -G.T])
    loop = control.feedback(control.append(*plants), stretch.T @ K @ stretch)
    expected = np.abs(loop.poles()).max()
    assert gx.stability.spectral_radius(attached(d, integrator)) == pytest.approx(expected, abs=1e-6)


def test_the_reference_scene_is_its_modes() -> None:
    """reference-1dof: both modes are devices by themselves, whose radii `wall_limits` and `external_limits` know."""
    scene = gx.load("reference-1dof")
    from graspfx.analysis.stability import external_limits, wall_limits

    inner = wall_limits(0.15, 0.2, 0.005, spring=33.0)
    outer = external_limits(0.15, 0.2, 0.005, 0.1, 0.8, spring=33.0, integrator="exact")
    expected = max(inner.spectral_radius(70.0), outer.spectral_radius(30.0))
    assert gx.stability.spectral_radius(scene) == pytest.approx(expected, abs=1e-12)
    assert {round(require(mode.limits).limit, 1) for mode in gx.stability.modes(scene)} == {80.1, 91.8}


@pytest.mark.parametrize("d", [2, 3])
def test_a_squeeze_adds_what_preloaded_says_of_a_run(d: int) -> None:
    """Displacements and forces of a run that has come to rest; the preload's entries to 1e-5 of the stiffness."""
    scene = attached(d, "exact", squeeze=0.004)
    found = linearise(scene)
    rec = gx.run(scene.replace({"finger.*.device.damping": 2.0, "object.viscosity": 3.0}), duration=6.0)
    contacts = found.contacts - rec.object_position[-1]
    displacement = require(rec.true_position)[-1] - rec.contact_position[-1]
    expected = gx.stability.preloaded(contacts, displacement, rec.finger_force[-1])
    assert found.at == ("squeezed",)
    assert found.linear.preload == pytest.approx(expected.preload, abs=1e-5 * KIP)
    assert pytest.approx(expected.G, abs=1e-7) == found.linear.G
    assert linearise(scene, "start").linear.preload is None


def test_without_friction_forces_are_along_the_normals() -> None:
    """Two fingers on a box: K is n [2 kep kip/(kep + kip) ...] n' by hand; tangents carry nothing."""
    scene = attached(2).replace(
        {"coupling.contact": "unilateral", "coupling.friction": 0.0, "finger.*.hand.squeeze": 0.002}
    )
    found = linearise(scene, "start")
    G, _ = by_hand(2)
    P = np.linalg.pinv(G) @ G
    K = KEP * P + KIP * (np.eye(6) - P)
    n = np.zeros((6, 3))
    n[[0, 2, 5], [0, 1, 2]] = 1.0
    soft = np.linalg.inv(n.T @ np.linalg.inv(K) @ n)  # forces along n alone: compliances add
    assert found.linear.stiffness == pytest.approx(n @ soft @ n.T, abs=1e-9 * KIP)
    assert "contacts without friction: forces act along the normals only" in found.assumed


def test_arms_are_point_devices_at_their_posture() -> None:
    """paper-spring-arms against point devices with the arms' mass and friction there: limits to 1 %."""
    arms = gx.load("paper-spring-arms")
    points = arms.replace({"finger.*.device": {"name": "simulated", "mass": 0.15, "damping": 0.2}})
    from graspfx.certificate.limit_sweep import limits_of_scene

    one, other = limits_of_scene(arms), limits_of_scene(points)
    assert one.internal == pytest.approx(other.internal, rel=0.01)
    assert one.external == pytest.approx(other.external, rel=0.01)
    assert gx.stability.spectral_radius(arms) == pytest.approx(gx.stability.spectral_radius(points), abs=1e-5)


def test_several_objects_have_the_largest_radius() -> None:
    scene = gx.load("two-objects", {"object.*.dynamics": "native", "world.collide": False})
    radii = [gx.stability.spectral_radius(linearise(scene, object=thing.name).linear) for thing in scene.object]
    assert gx.stability.spectral_radius(scene) == pytest.approx(max(radii), abs=1e-9)


def test_delays_and_the_mass_metric_are_those_of_the_scene() -> None:
    scene = attached(2, delay=2).replace({"finger.0.device.mass": 0.3, "coupling.metric": "mass"})
    linear = scene.linearise()
    assert linear.delay.tolist() == [2] * 6
    shares = np.repeat([0.3, M, M], 2) / np.mean([0.3, M, M])
    assert linear.stiffness @ np.ones(6) == pytest.approx(
        linear.stiffness.T @ np.ones(6)
    )  # symmetric, as a metric's gains are
    inner = np.linalg.svd(linear.G)[2][3:].T  # forces without a wrench
    assert inner.T @ linear.stiffness @ (inner / shares[:, None]) == pytest.approx(KIP * inner.T @ inner, abs=1e-9)


def test_a_device_that_tells_no_mass_is_named(tmp_path: Path) -> None:
    (tmp_path / "mute.py").write_text(
        "from dataclasses import replace\n"
        "from graspfx.plugins import load\n"
        "Point = load('devices', 'simulated').PointDevice\n"
        "class Mute(Point):\n"
        "    @property\n"
        "    def features(self):\n"
        "        return replace(super().features, mass=None)\n"
        "def connect(*, dimensions):\n"
        "    return Mute(mass=0.1, damping=0.2, fingers=1, dimensions=dimensions, resolution=0.0,\n"
        "                velocity_window=1, delay=0, force_limit=None, workspace=None)\n"
    )
    scene = attached(1).replace({"finger.1.device": {"name": str(tmp_path / "mute.py")}, "finger.1.name": "thumb"})
    with pytest.raises(InputError, match=r"the device of thumb.*a device that reports its mass"):
        scene.linearise()


def test_names_that_nothing_answers_to() -> None:
    with pytest.raises(UnknownNameError, match="operating point"):
        attached(1).linearise("finish")
    with pytest.raises(UnknownNameError, match="object"):
        linearise(attached(1), object="ball")
