"""The gaps of the fade as a scene's gains and hands ask for them, and grasps inside the band of the blend."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.assembly.grasps import grasps
from graspfx.assembly.resolve import resolve
from graspfx.certificate.certificate import lines
from graspfx.certificate.notes import arms, blend_notes
from graspfx.coupling.rules import Rules, release_compliance
from graspfx.errors import SceneError
from graspfx.show.summary_table import remarks
from tests.support.grasps import grasped, law

DISC = np.array([[math.cos(a), math.sin(a)] for a in 2.0 * np.pi * np.arange(3) / 3])


def held(
    radius: float = 0.025,
    kep: Any = 60.0,
    kip: Any = 150.0,
    squeeze: float = 0.006,
    engine: str = "auto",
    **coupling: Any,
) -> gx.Scene:
    """Three hands of 50 N/m on a disc."""
    return gx.Scene.model_validate(
        {
            "dimensions": 2, "period": 0.001, "duration": 0.5, "engine": engine,
            "object": {
                "mass": 0.1, "viscosity": 0.8, "rotational_viscosity": 1e-4, "inertia": 4e-5,
                "shape": {"kind": "sphere", "radius": radius},
            },
            "coupling": {"external": {"stiffness": kep}, "internal": {"stiffness": kip}, **coupling},
            "finger": [
                {
                    "device": {"name": "simulated", "mass": 0.15, "damping": 0.4},
                    "hand": {"stiffness": 50.0, "damping": 1.0, "squeeze": squeeze, "squeeze_ramp": 0.4},
                    "start": (radius * point).tolist(),
                }
                for point in DISC
            ],
        }
    )  # fmt: skip


def gaps(scene: gx.Scene) -> tuple[float, float]:
    (one,) = grasps(resolve(scene))
    return float(one.grasped.state.fade_start), float(one.grasped.state.fade_end)


def test_auto_begins_where_the_squeeze_asks_for_it() -> None:
    """1/2 |1/60 - 1/150| of three hands of 50 N/m closed by 6 mm, 0.9 N in all: 4.5 mm; 2 mm where that is less."""
    assert gaps(held()) == pytest.approx((0.0045, 0.0125), rel=1e-12)
    assert gaps(held(squeeze=0.002)) == (0.002, 0.01)
    assert gaps(held(kip=60.0)) == (0.002, 0.01)
    assert gaps(held(fade=[0.001, 0.003])) == (0.001, 0.003)


def test_auto_is_a_bound_where_the_default_of_2_mm_was_too_short() -> None:
    """Squeezes from the surface: the run's forces never ask for more, and would have with 2 and 10 mm."""
    for n, squeeze in enumerate((0.006, 0.012, 0.02)):
        scene = held(squeeze=squeeze, kep=60.0 - 10.0 * n, kip=150.0)
        assert gx.run(scene).summary()["fade_shortfall"] is None
        before = gx.run(scene.replace({"coupling.fade": [0.002, 0.01]})).summary()["fade_shortfall"]
        assert (before or 0.0) > (0.0 if n == 0 else 1e-3)


def test_the_note_of_a_run_says_which_gaps_would_do() -> None:
    scene = held(fade=[0.0005, 0.0085], squeeze=0.02)
    (note,) = [text for text in remarks(gx.run(scene)) if "coupling.fade" in text]
    given = [float(number) for number in note.partition("[")[2].rstrip("]").split(", ")]
    assert given[1] - given[0] == pytest.approx(0.008)
    assert gx.run(scene.replace({"coupling.fade": given})).summary()["fade_shortfall"] is None


@pytest.mark.parametrize("engine", ["interpreted", "compiled"])
def test_a_shortfall_is_one_of_the_fade_that_it_was_measured_from(engine: str) -> None:
    """The fade is set to 20 mm, where nothing is short, after it was short of 0.5 mm: 20 mm are no part of the need."""
    scene = held(fade=[0.0005, 0.0085], squeeze=0.012, engine=engine)
    alone = gx.run(scene, duration=0.3).outcome
    with gx.open(scene, live=["coupling.fade"]) as session:
        session.step(300)
        session.set("coupling.fade", [0.02, 0.03])
        session.step(200)
        later = session.recording.outcome
        session.set("coupling.fade", [0.0005, 0.0085])
        session.step(100)
    assert alone.fade_needed == 0.0005 + alone.fade_shortfall > 0.002
    assert (later.fade_needed, later.fade_shortfall) == (alone.fade_needed, alone.fade_shortfall)
    last = session.recording.outcome
    assert last.fade_needed == 0.0005 + last.fade_shortfall > alone.fade_needed  # the hands have closed further


def test_the_certificate_says_how_far_the_fade_is_from_the_settled_squeeze() -> None:
    """The forces at rest are less than the bound that `auto` takes; a fade of 2 mm is too short by the difference."""
    scene = held(squeeze=0.012)
    (one,) = gx.certify(scene)
    assert one.fade is not None
    begins, asked = one.fade
    assert begins == pytest.approx(0.009) and 0.004 < asked < begins
    assert f"the fade begins at 9 mm; the forces at rest require {1e3 * asked:.3g} mm" in " ".join(
        repr(gx.certify(scene)).split()
    )
    (short,) = gx.certify(scene.replace({"coupling.fade": [0.002, 0.01]}))
    assert short.fade is not None and short.fade[1] == pytest.approx(asked, rel=1e-3)
    assert f"too short by {1e3 * (short.fade[1] - 0.002):.3g} mm" in "\n".join(lines(short))


def test_the_compliance_of_matrices_is_that_of_their_inverses() -> None:
    A, B = np.diag([60.0, 30.0]), np.diag([150.0, 40.0])
    assert release_compliance(law(60.0, 150.0), 3, 2) == 0.5 * (1.0 / 60.0 - 1.0 / 150.0)
    assert release_compliance(law(A, B), 3, 2) == pytest.approx(0.5 * (1.0 / 60.0 - 1.0 / 150.0))
    assert release_compliance(law(np.kron(np.eye(3), A), B), 3, 2) == pytest.approx(0.5 * (1.0 / 60.0 - 1.0 / 150.0))
    assert release_compliance(law(np.array([60.0, 50.0, 40.0]), 150.0), 3, 2) == pytest.approx(
        0.5 * (1.0 / 40.0 - 1.0 / 150.0)
    )


@pytest.mark.parametrize(
    ("key", "value"), [("fade", "atuo"), ("blend", "of"), ("fade", [0.01, 0.002]), ("blend", [0.0, 0.0])]
)
def test_what_is_no_pair_and_no_word_is_refused(key: str, value: Any) -> None:
    with pytest.raises(SceneError, match=rf"coupling\.{key}: expected"):
        gx.load("paper-waving", {f"coupling.{key}": value})


def test_a_grasp_in_the_band_is_told_with_its_figure() -> None:
    """A disc of 0.8 mm: b = 0.824 of the rotation, 75.8 N/m for 60 and 150; every sample counts, none with off."""
    t = (0.8 - 0.25) / 0.75
    b = t * t * (3.0 - 2.0 * t)
    made = 150.0 + (60.0 - 150.0) * b
    small = held(0.0008, contact="attached", squeeze=0.0)
    (note,) = blend_notes(resolve(small))
    assert "an arm of 0.8 mm" in note
    assert f"it has {made:.4g} N/m where eq. (4) has kep = 60 N/m ({100.0 * (made / 60.0 - 1.0):+.2g} %)" in note
    assert gx.run(small, duration=0.1).summary()["blended"] == 1.0
    off = small.replace({"coupling.blend": "off"})
    assert blend_notes(resolve(off)) == [] and gx.run(off, duration=0.1).summary()["blended"] is None
    assert blend_notes(resolve(held())) == [] and gx.run(held(), duration=0.1).summary()["blended"] is None


def test_without_the_blend_a_small_grasp_has_the_forces_of_the_split() -> None:
    """Three fingers on a disc of 0.8 mm, displaced at random: eq. (4) by gx.Split to 1e-14, 3 % off with the blend."""
    forces = []
    for blend in ("off", [0.00025, 0.001]):
        (one,) = grasps(resolve(held(0.0008, contact="attached", squeeze=0.0, blend=blend)))
        g = one.grasped
        contacts = g.contact_position.copy()
        e = 1e-4 * np.array([[1.0, 0.3], [-0.2, 0.8], [0.5, -0.4]])
        g.finger_position[:] = contacts + e
        assert g.sample() == 0
        forces.append(g.force.ravel().copy())
    expected = law(60.0, 150.0).force(gx.Grasp(contacts).split(), e.ravel())
    np.testing.assert_allclose(forces[0], expected, rtol=0.0, atol=1e-14 * np.abs(expected).max())
    assert np.abs(forces[1] - expected).max() > 0.03 * np.abs(expected).max()


def test_the_arms_of_a_grasp_in_space() -> None:
    """Fingers at the corners of a tetrahedron of radius R turn with arms R sqrt(2/3); on a line one arm is left out."""
    corners = (
        0.02 * np.array([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]]) / math.sqrt(3.0)
    )
    g = grasped(4, 3, law(30.0, 70.0), Rules(attached=True), contacts=corners, inertia=4e-5)
    assert arms(g) == pytest.approx([0.02 * math.sqrt(2.0 / 3.0)] * 3)
    line = np.outer([-1.0, 0.0, 1.0], [0.02, 0.01, 0.0])
    g = grasped(3, 3, law(30.0, 70.0), Rules(attached=True), contacts=line, inertia=4e-5)
    assert len(arms(g)) == 2
