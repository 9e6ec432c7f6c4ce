"""Certificates of grasps whose contacts slid: against stick, whole ticks by differences, and growth in runs."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.analysis.grasp_stiffness import released
from graspfx.certificate.certificate import Certificate
from graspfx.certificate.grip import sliding_notes
from graspfx.certificate.judgement import Judge
from graspfx.certificate.linearise import linearise
from graspfx.certificate.mode_limits import mode_limits
from graspfx.errors import InputError, NoRestError
from tests.support.carriers import CARRIERS, require
from tests.support.rested_run import RestedRun

DURATION = 4.0  # [s]: the hands are closed at 0.4, and motions have died out


def askew(
    friction: float | str, skew: float, external: float, internal: float, squeeze: float, ramp: float = 0.0
) -> gx.Scene:
    """Two fingers on a box that cannot turn; their hands close along lines `skew` [m] apart, at once or in `ramp` [s].

    What the hands take long to close leaves contacts on their cones' edges.
    """
    fingers: list[dict[str, Any]] = []
    for side in (1, -1):
        hand: dict[str, Any] = {"stiffness": 100.0, "damping": 1.0}
        if ramp:
            aside = [side * squeeze, side * skew / 2]
            hand |= {"squeeze": math.hypot(*aside), "squeeze_ramp": ramp, "closing": aside, "damping": 4.0}
        else:
            hand |= {"rest": [side * (squeeze - 0.025), side * skew / 2]}
        device = {"name": "simulated", "mass": 0.15, "damping": 0.2}
        fingers.append({"start": [-0.025 * side, 0.0], "device": device, "hand": hand})
    return gx.Scene(
        dimensions=2,
        period=0.005,
        duration=3.0,
        object={
            "mass": 0.1,
            "viscosity": 0.8,
            "integrator": "explicit",
            "shape": {"kind": "box", "size": [0.05, 0.05]},
            "free": [True, True, False],
        },
        coupling={"friction": friction, "external": {"stiffness": external}, "internal": {"stiffness": internal}},
        finger=fingers,
    )


def slid_grasp(seed: int) -> gx.Scene:
    """2 to 5 fingers on a box or a ball, in the plane or in space, whose hands close along lines beside the contacts.

    Hands are damped, so that what closing excites dies out; nothing but the fingers holds the object.
    """
    rng = np.random.default_rng(seed)
    d, n = int(rng.integers(2, 4)), int(rng.integers(2, 6))
    n = max(n, d)  # two fingers in space let the object swing about their line
    ball = bool(rng.random() < 0.5)
    half = rng.uniform(0.02, 0.03, d)
    directions = _around(rng, n, d)
    starts, inward = [], []
    for u in directions:
        reach = half[0] if ball else float(np.min(half / np.maximum(np.abs(u), 1e-9)))
        p = reach * u
        axis = int(np.argmax(np.abs(p) / half))
        normal = -u if ball else -np.sign(p[axis]) * np.eye(d)[axis]
        starts.append(p - 1e-4 * normal)
        inward.append(normal)
    squeeze = rng.uniform(0.004, 0.008)
    mu = float(rng.uniform(0.25, 0.7))
    mass, T = float(rng.uniform(0.1, 0.3)), 0.004
    fingers: list[dict[str, Any]] = []
    for p, normal in zip(starts, inward, strict=True):
        beside = rng.normal(size=d)
        beside -= (beside @ normal) * normal
        beside *= rng.uniform(0.3, 0.9) * squeeze / np.linalg.norm(beside)
        fingers.append(
            {
                "start": p.tolist(),
                "device": {"name": "simulated", "mass": float(rng.uniform(0.1, 0.2)), "damping": 0.4},
                "hand": {
                    "stiffness": float(rng.uniform(80.0, 150.0)),
                    "damping": float(rng.uniform(1.5, 2.5)),
                    "rest": (p + beside).tolist(),
                    "squeeze": squeeze,
                    "squeeze_ramp": 0.4,
                    "closing": normal.tolist(),
                },
            }
        )
    shape = {"kind": "sphere", "radius": float(half[0])} if ball else {"kind": "box", "size": (2.0 * half).tolist()}
    return gx.Scene(
        dimensions=d,
        period=T,
        duration=DURATION,
        object={
            "mass": mass,
            "viscosity": float(rng.uniform(0.5, 1.5)),
            "rotational_viscosity": float(mass * half[0] ** 2 * rng.uniform(3.0, 8.0)),
            "integrator": str(rng.choice(["explicit", "semi-implicit", "exact"])),
            "shape": shape,
        },
        coupling={
            "friction": mu,
            "external": {"stiffness": float(rng.uniform(20.0, 40.0))},
            "internal": {"stiffness": float(rng.uniform(60.0, 150.0))},
            "absent": "follow",
        },
        finger=fingers,
    )


def _around(rng: np.random.Generator, n: int, d: int) -> np.ndarray:
    """Directions from the centre that hold an object between them (n, d), not evenly."""
    if d == 2:
        angles = 2 * np.pi * np.arange(n) / n + rng.uniform(-0.25, 0.25, n) + rng.uniform(0.0, 2 * np.pi)
        return np.stack([np.cos(angles), np.sin(angles)], axis=1)
    if n == 3:
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        angles = 2 * np.pi * np.arange(3) / 3 + rng.uniform(-0.2, 0.2, 3)
        return np.stack([np.cos(angles), np.sin(angles)], axis=1) @ turn[:2]
    around: np.ndarray = rng.normal(size=(n, 3))
    for _ in range(200):  # they repel one another until they are spread
        apart = around[:, None] - around[None]
        apart /= (np.linalg.norm(apart, axis=2) ** 3 + np.eye(n))[:, :, None]
        around = around + 0.05 * apart.sum(axis=1)
        around /= np.linalg.norm(around, axis=1)[:, None]
    return around


def standing(integrator: str) -> gx.Scene:
    """Two fingers on a box in the plane that stands on a floor, which bears its weight."""
    fingers = [
        {
            "start": [0.025 * side, 0.03],
            "device": {"name": "simulated", "mass": 0.15, "damping": 0.4},
            "hand": {
                "stiffness": 100.0,
                "damping": 1.5,
                "squeeze": 0.006,
                "squeeze_ramp": 0.3,
                "closing": [-side, 0.0],
            },
        }
        for side in (-1, 1)
    ]
    return gx.Scene(
        dimensions=2,
        period=0.004,
        duration=3.0,
        gravity=[0.0, -9.81],
        world={"friction": 0.6},
        obstacle=[{"name": "floor", "shape": {"kind": "half-space", "normal": [0.0, 1.0]}}],
        object={
            "mass": 0.2,
            "viscosity": 0.8,
            "rotational_viscosity": 4e-4,
            "integrator": integrator,
            "shape": {"kind": "box", "size": [0.05, 0.06]},
            "position": [0.0, 0.03],
        },
        coupling={
            "friction": 0.5,
            "absent": "follow",
            "external": {"stiffness": 40.0},
            "internal": {"stiffness": 90.0},
        },
        finger=fingers,
    )


SKEWS = (0.001, 0.002, 0.003, 0.004, 0.005, 0.006, 0.008, 0.010)  # [m]
SLID = [seed for seed in range(44) if seed not in (2, 3, 11, 13, 15, 20, 22, 25, 29, 32, 35, 38, 42, 43)]


def limit_of(certificate: Certificate, mode: str) -> float:
    return next(row.limit for row in certificate.limits if row.mode == mode)


def radius_at(scene: gx.Scene, external: float, recording: gx.Recording) -> float:
    near = scene.replace({"coupling.external.stiffness": external})
    return gx.stability.spectral_radius(linearise(near, "recorded", recording=recording).linear)


@pytest.mark.parametrize(
    ("external", "internal", "squeeze", "frictions"),
    [(60.0, 300.0, 0.006, (0.2, 0.3, 0.5, 0.8)), (100.0, 120.0, 0.005, (0.3,))],
)
def test_two_fingers_askew_have_the_limits_of_contacts_that_stick(
    external: float, internal: float, squeeze: float, frictions: tuple[float, ...]
) -> None:
    """All 32: at rest, 484 and 73 N/m as with "stick"; of those that slide farthest contacts are on the cone's edge."""
    expected = [row.limit for row in gx.certify(askew("stick", 0.004, external, internal, squeeze))[0].limits[:2]]
    assert expected == pytest.approx([483.9, 73.4], abs=0.05)
    edges = 0
    for friction in frictions:
        for skew in SKEWS:
            scene = askew(friction, skew, external, internal, squeeze)
            found = linearise(scene)
            assert found.at == ("squeezed",), (friction, skew, found.assumed)
            rows = mode_limits(scene, found, halves=False, compare=False)
            assert [row.limit for row in rows[:2]] == pytest.approx(expected, rel=1e-6), (friction, skew)
            assert (found.margins <= 1.0 + 1e-6).all(), (friction, skew)
            edges += bool(found.edge)
    assert edges >= 3 * len(frictions) - 3


def test_a_contact_on_the_edge_is_said_to_be() -> None:
    certificates = gx.certify(askew(0.3, 0.004, 60.0, 300.0, 0.006, ramp=2.0))
    (found,) = certificates
    assert found.edge == ("finger0", "finger1")
    assert found.grip == pytest.approx({"finger0": 1.0, "finger1": 1.0}, abs=1e-6)
    assert any("a run may differ by a few per cent" in text for text in found.assumed)
    text = " ".join(repr(certificates).split())
    assert "f_t/(mu f_n): finger0 1.00, finger1 1.00; on the cone's edge, assumed to stick: finger0, finger1" in text
    data = json.loads(json.dumps(certificates.to_dict()))
    assert data["stable"] is True
    assert data["certificates"][0]["edge"] == ["finger0", "finger1"]
    assert data["certificates"][0]["grip"]["finger0"] == pytest.approx(1.0)
    (held,) = gx.certify(askew(0.8, 0.001, 60.0, 300.0, 0.006, ramp=2.0))
    assert held.edge == ()
    assert held.grip["finger0"] == pytest.approx(0.5 / 6.0 / 0.8, rel=0.03)  # 0.5 mm aside for 6 mm of squeeze


@pytest.mark.parametrize("seed", [7, 8, 18, 19, 40])
def test_boxes_in_space_come_to_rest(seed: int) -> None:
    """Three and four fingers on a box, mu = 0.5, hands aside: at rest where they squeeze, not as at the start."""
    scene = slid_grasp(seed).replace({"coupling.friction": 0.5})
    assert scene.dimensions == 3
    assert len(scene.finger) in (3, 4)
    found = linearise(scene)
    assert found.at == ("squeezed",), found.assumed
    assert any("slid while the hands closed" in text for text in found.assumed)


@pytest.mark.parametrize(
    ("seed", "changes"),
    [
        (1, {}),
        (8, {"coupling.external.damping": 0.1, "coupling.internal.damping": 0.3}),
        (37, {"coupling.reaction": "contact"}),
        (30, {"object.integrator": "implicit", "coupling.external.damping": 0.1}),
    ],
)
def test_the_loop_at_a_recorded_rest_is_that_of_whole_ticks(seed: int, changes: dict[str, object]) -> None:
    """Spectral radii near the limit of kep to 1e-7 of those of a tick's own difference quotients."""
    scene = slid_grasp(seed).replace(changes)
    run = RestedRun(scene, scene.duration)
    (found,) = gx.certify(scene, recording=run.recording)
    assert found.at == "recorded"
    edge = limit_of(found, "external")
    external = 3.0 * float(np.max(scene.coupling.external.stiffness)) if math.isinf(edge) else 1.02 * edge
    assert run.spectral_radius(external) == pytest.approx(radius_at(scene, external, run.recording), abs=1e-7)
    run.close()


def runs_agree(seed: int) -> None:
    """Growth and decay of a run 3 % on either side of the limit of kep, the squeeze held, at the rest that it recorded.

    The rate is that of the spectral radius to 3e-5 a sample unless a second motion is nearly as slow.
    """
    scene = slid_grasp(seed)
    run = RestedRun(scene, scene.duration)
    recording = run.recording
    assert recording.status is not None
    assert (recording.status == 2).any(), "nothing slid"
    (found,) = gx.certify(scene, recording=recording)
    assert found.at == "recorded"
    assert not any("not at rest" in text for text in found.assumed)
    edge = limit_of(found, "external")
    for factor, sign in ((0.97, -1.0), (1.03, 1.0)):
        radius = radius_at(scene, factor * edge, recording)
        seen = run.growth(factor * edge, 4000, 2000, 1e-6)
        assert (radius - 1.0) * sign > 1e-5, seed
        assert (seen - 1.0) * sign > 0.0, (seed, factor, seen, radius)
        assert seen == pytest.approx(radius, abs=0.9 * abs(radius - 1.0)), (seed, factor)
    # the rest of hands that close slowly is another, by a few per cent
    (slow,) = gx.certify(scene)
    assert slow.at == "squeezed"
    assert limit_of(slow, "external") == pytest.approx(edge, rel=0.15)
    run.close()


@pytest.mark.parametrize("seed", [30])
def test_runs_grow_and_decay_beside_a_recorded_rest(seed: int) -> None:
    runs_agree(seed)


@pytest.mark.large
@pytest.mark.parametrize("seed", SLID)
def test_thirty_grasps_that_slid(seed: int) -> None:
    runs_agree(seed)


def test_runs_on_the_cones_edge_agree() -> None:
    """Hands that close in 2 s leave both contacts on the edge; small motions go on as if they stuck, to 1e-5."""
    scene = askew(0.3, 0.006, 60.0, 120.0, 0.006, ramp=2.0)
    run = RestedRun(scene, 4.0)
    (found,) = gx.certify(scene, recording=run.recording)
    assert found.edge == ("finger0", "finger1")
    (slow,) = gx.certify(scene)
    assert limit_of(found, "external") == pytest.approx(limit_of(slow, "external"), rel=1e-6)
    for factor in (0.97, 1.03):
        external = factor * limit_of(found, "external")
        seen = run.growth(external, 3000, 1500, 1e-8)
        assert seen == pytest.approx(radius_at(scene, external, run.recording), abs=1e-5)
        assert (seen - 1.0) * (factor - 1.0) > 0.0
    run.close()


# Obstacles ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("integrator", ["explicit", "implicit"])
def test_a_floor_that_carries_the_weight_belongs_to_the_loop(integrator: str) -> None:
    """A box on a floor: spectral radii at 1.03 of its limit to 1e-6 of whole ticks, the floor's memory with them."""
    scene = standing(integrator)
    run = RestedRun(scene, scene.duration)
    (found,) = gx.certify(scene, recording=run.recording)
    assert "the object stands on floor with 2 points, which stick and carry load" in found.assumed
    external = 1.03 * limit_of(found, "external")
    radius = radius_at(scene, external, run.recording)
    assert radius > 1.0005
    assert run.spectral_radius(external) == pytest.approx(radius, abs=1e-6)
    run.close()


def test_a_floor_under_a_squeezed_grasp_has_a_row() -> None:
    """Off the floor kep goes as far as 160 N/m; on it the box stays and nothing but kip counts, a wall's limit."""
    (found,) = gx.certify(standing("explicit"))
    assert "the weight is carried by other supports, which are ignored (floor)" in found.assumed
    row = next(row for row in found.limits if row.mode == "standing on floor")
    assert row.limit == pytest.approx(limit_of(found, "internal"), rel=1e-6)
    assert limit_of(found, "external") == pytest.approx(160.5, abs=0.1)
    soft = standing("explicit").replace({"finger.*.device.damping": 0.0, "finger.*.hand.damping": 0.0})
    assert not gx.certify(soft).stable


@pytest.mark.parametrize("dynamics", CARRIERS)
def test_what_carries_the_load_and_is_no_floor_is_named(dynamics: str) -> None:
    """The floor of others is no part of the loop: the certificate at a recorded rest says what it leaves out."""
    require(dynamics)
    scene = gx.load("pick-and-place", {"object.dynamics": dynamics})
    recording = gx.run(scene, duration=0.7)  # closed, not yet lifted
    (found,) = gx.certify(scene, recording=recording)
    assert any("carried by floor, which is ignored" in text for text in found.assumed), found.assumed


# Recordings, and squeezes that are held ----------------------------------------------------------------------------


def test_a_recording_may_be_a_path_and_has_to_be_of_the_scene(tmp_path: Path) -> None:
    scene = askew(0.5, 0.002, 60.0, 120.0, 0.006)
    recording = gx.run(scene)
    recording.save(tmp_path / "recording.h5")
    by_path = gx.certify(scene, recording=tmp_path / "recording.h5")
    assert by_path.to_dict() == gx.certify(scene, recording=recording).to_dict()
    assert "in the state at the end of the recording" in " ".join(repr(by_path).split())
    with pytest.raises(InputError, match="one of this scene: 1 dimensions"):
        gx.certify("reference-1dof", recording=recording)
    with pytest.raises(InputError, match="the recording provides the equilibrium"):
        gx.certify(scene, quick=True, recording=recording)
    stiffer = scene.replace({"coupling.internal.stiffness": 150.0})
    assert any(
        "differ from those of this scene's gains" in text
        for text in gx.certify(stiffer, recording=recording)[0].assumed
    )
    moving = gx.run(scene, duration=0.2)
    assert any("not at rest at its end" in text for text in gx.certify(scene, recording=moving)[0].assumed)
    apart = gx.run(scene.replace({"finger.0.hand.rest": [-0.05, 0.0]}))
    (found,) = gx.certify(scene, recording=apart)
    assert not found.stable and found.gap == pytest.approx(float(np.array(apart.gap)[-1].min()))
    assert found.verdict.startswith("not grasping: ") and found.verdict.endswith("at the end of the recording")


def disc(kep: float, depth: float = 0.0) -> gx.Scene:
    """Two unequal fingers that stick to a disc, and squeeze it by hands of 474 N/m."""
    fingers = [
        {
            "device": {"name": "simulated", "mass": mass, "damping": 0.2},
            "hand": {"stiffness": 474.0, "damping": 0.5, "squeeze": 0.005},
            "start": [x, 0.0],
        }
        for mass, x in ((0.181, -0.03), (0.087, 0.03))
    ]
    thing = {"mass": 0.2, "viscosity": 0.5, "rotational_viscosity": 4e-4, "shape": {"kind": "sphere", "radius": 0.03}}
    coupling = {
        "friction": "stick",
        "damping_depth": depth,
        "external": {"stiffness": kep, "damping": 1.5},
        "internal": {"stiffness": 113.0, "damping": 1.0},
    }
    table = {"dimensions": 2, "period": 0.002, "object": thing | {"integrator": "semi-implicit"}, "coupling": coupling}
    return gx.Scene(**table, finger=fingers, duration=4.0)


@pytest.mark.parametrize("depth", [0.0, 5e-4])
@pytest.mark.parametrize("kep", [1301.0, 1640.0, 3000.0])
def test_a_rest_is_found_where_one_finger_throws_the_object_at_the_other(kep: float, depth: float) -> None:
    """The search ended without a rest; at the start dampers by depth are soft, and the radius was up to 1.025."""
    scene = disc(kep, depth)
    recording = gx.run(scene)
    (squeezed,), (at_its_end,) = gx.certify(scene), gx.certify(scene, recording=recording)
    assert squeezed.at == "squeezed" and squeezed.stable and recording.summary()["growth"] == []
    assert squeezed.spectral_radius == pytest.approx(at_its_end.spectral_radius, abs=1e-9)


def test_what_has_no_rest_is_not_judged() -> None:
    """A disc that slips out of its fingers was called stable, by its contacts at the start."""
    scene = disc(300.0).replace({"gravity": [0.0, -9.81], "coupling.friction": 0.2})
    assert gx.run(scene, duration=0.5).objects["object"].position[-1, 1] < -0.3
    with pytest.raises(NoRestError, match=r"although the hands do not move; run the scene until it rests"):
        gx.certify(scene)
    report = gx.check(scene)
    assert report.verdict.startswith("not judged: object: ") and not report.ok and report.certificates == ()
    judged = Judge(scene).judge({})
    assert not judged.stable and judged.margin == 0.0 and judged.at == ""


BODY = """from graspfx.objects.body import NativeBody

{told}
def create(state):
    return NativeBody(state)
"""


def test_dynamics_of_a_plug_in_are_certified_with_the_integrator_that_they_tell(tmp_path: Path) -> None:
    """`object.integrator` is not asked of them: it moved the limit of kep from 51.8 to 384 N/m for the same body."""
    for told in ("explicit", "semi-implicit", "exact", ""):
        file = tmp_path / f"body-{told}.py"
        file.write_text(BODY.format(told=f"INTEGRATOR = {told!r}" if told else ""))
        native = gx.certify(gx.load("paper-spring", {"object.integrator": told or "semi-implicit"}))[0]
        for ignored in ("explicit", "exact"):
            changes = {"object.dynamics": str(file), "object.integrator": ignored}
            (found,) = gx.certify(gx.load("paper-spring", changes))
            assert [row.limit for row in found.limits] == pytest.approx([row.limit for row in native.limits], rel=1e-9)
            assert any("because `INTEGRATOR` is not stated" in text for text in found.assumed) is (not told)
    file.write_text(BODY.format(told="INTEGRATOR = 'implicit'"))
    with pytest.raises(InputError, match=r"INTEGRATOR of the dynamics .* expected one of explicit, semi-implicit"):
        gx.certify(gx.load("paper-spring", {"object.dynamics": str(file)}))


def test_soft_fingers_keep_their_torsion() -> None:
    """A pinch whose contacts bear torsion: the forces at its recorded rest are the recorded ones."""
    scene = gx.load("soft-pinch")
    recording = gx.run(scene, duration=0.7)
    moments = recording.finger_moment
    assert moments is not None
    assert np.abs(moments[-1]).max() > 1e-4
    (found,) = gx.certify(scene, recording=recording)
    assert not any("differ from those of this scene's gains" in text for text in found.assumed)
    wrench = recording.wrench[-1]
    assert np.isfinite(wrench).all()


def test_a_held_squeeze_is_provisional() -> None:
    """Contacts that do not slide: the one step is the rest to 1e-3; those that would slide are said to."""
    quick, sought = (gx.certify("sphere-three-fingers", quick=quick)[0] for quick in (True, False))
    assert quick.at == "provisional"
    for mode in ("internal", "external"):
        assert limit_of(quick, mode) == pytest.approx(limit_of(sought, mode), rel=1e-3)
    held = gx.certify(askew(0.3, 0.010, 60.0, 300.0, 0.006), quick=True)
    assert held.provisional
    assert repr(held).startswith("scene: provisional, ")
    assert any("finger0, finger1 would slide here" in text for text in held[0].assumed)


# Sliding -----------------------------------------------------------------------------------------------------------


def test_sliding_takes_what_it_slides_along_from_the_stiffness() -> None:
    """Forces stay on the cone's edge, V'K_s = 0, and a motion along the slip changes none, K_s t = 0."""
    rng = np.random.default_rng(3)
    K = np.diag([60.0, 60.0, 90.0, 90.0]) + 5.0
    t, n = np.array([[0.0, 1.0, 0.0, 0.0]]).T, np.array([[1.0, 0.0, 0.0, 0.0]]).T
    V = t - 0.4 * n
    K_s = released(K, t, V)
    assert K_s is not None
    assert V.T @ K_s == pytest.approx(np.zeros((1, 4)), abs=1e-12)
    assert K_s @ t == pytest.approx(np.zeros((4, 1)), abs=1e-12)
    still = rng.normal(size=4)
    still -= V[:, 0] * (V[:, 0] @ K @ still) / (V[:, 0] @ K @ V[:, 0])
    assert K_s @ still == pytest.approx(K @ still, abs=1e-10)  # what does not slide feels all of it
    # friction so large that pressing grows by more than sliding relieves: no answer
    coupled = np.array([[100.0, 60.0], [60.0, 50.0]])
    assert released(coupled, np.array([[0.0], [1.0]]), np.array([[-1.0], [1.0]])) is None


def test_what_sliding_could_do_is_a_note() -> None:
    """A normal force that grows as the contact slides makes a note, and no difference to the radius."""
    linear = gx.stability.Linearisation(
        period=0.005,
        mass=0.15,
        friction=0.2,
        G=np.zeros((0, 2)),
        inertia=np.zeros((0, 0)),
        viscosity=np.zeros((0, 0)),
        stiffness=[[40.0, 20.0], [20.0, 30.0]],
        hand_stiffness=33.0,
    )
    t, n = np.array([[0.0], [1.0]]), np.array([[1.0], [0.0]])
    assert list(sliding_notes(linear, t, t - 0.3 * n, ["thumb"])) == []
    (note,) = sliding_notes(linear, t, t - 2.0 * n, ["thumb"])
    assert note.startswith("if thumb slid, Coulomb's law would have no solution")


def test_a_finger_without_friction_beside_others_slips() -> None:
    """One of three carries forces along its normal alone, also in the stiffness that limits are searched along."""
    scene = slid_grasp(33).replace({"finger.0.friction": 0.0})
    found = linearise(scene)
    assert found.at == ("squeezed",), found.assumed
    assert any(text.startswith("contacts stick, except finger0 without friction") for text in found.assumed)
    assert math.isnan(found.margins[0])
    K = found.linear.stiffness
    block = K[:3, :3]
    assert np.linalg.matrix_rank(block, tol=1e-6 * np.abs(block).max()) == 1
    preload = found.linear.preload
    assert preload is not None
    assert np.abs(preload).max() < 0.3 * np.abs(K).max()  # what is left to the preload is a preload
