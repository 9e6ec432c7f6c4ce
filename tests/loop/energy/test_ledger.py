"""The ledger of a grasp: it closes in runs, its entries are those of closed forms and of the recorded motion."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import graspfx as gx
from graspfx.certificate.plan import plan
from graspfx.compile.kernel import written
from graspfx.compile.machine import compiled
from graspfx.coupling.grasp_state import FingerState, GraspState
from graspfx.coupling.grasped import GraspedObject
from graspfx.coupling.rules import Rules
from graspfx.errors import SceneError
from graspfx.grasp.impedance import Coupling, Impedance
from graspfx.loop.energy.books import FingerBooks, LedgerState
from graspfx.loop.energy.brake import watch
from graspfx.loop.energy.observer import Observer
from graspfx.objects import energy
from graspfx.objects.body import NativeBody, fill_body
from graspfx.objects.body_state import EXACT, BodyState, Motion
from graspfx.objects.integrators import orient
from graspfx.spatial import Vector
from graspfx.surfaces.closed_form.shape import Box
from tests.support.carriers import CARRIERS
from tests.support.carriers import require as require_dynamics
from tests.support.optional import require

WATCH = {"coupling.passivity": "observe"}
CLOSED = 1e-12  # of the largest entry: a sum of 10^4 roundings of 1e-16 each
INTEGRATORS = ["explicit", "semi-implicit", "exact", "implicit"]


def watched(name: str, duration: float, **changes: Any) -> gx.Recording:
    return gx.run(gx.load(name, WATCH | {key.replace("__", "."): v for key, v in changes.items()}), duration=duration)


def peak(books: Any) -> float:
    return max(float(np.abs(values).max()) for name, values in books.items() if name != "gap")


def assert_closed(rec: gx.Recording) -> None:
    assert not rec.faults
    for books in rec.energy.values():
        assert np.abs(books["gap"]).max() <= CLOSED * peak(books)
        ports = books["fingers"] - books["wrench"] - books["work"].sum(axis=1)
        assert np.abs(ports).max() <= CLOSED * peak(books)


@pytest.mark.parametrize(
    ("name", "duration", "changes"),
    [
        ("paper-waving", 2.0, {}),
        ("paper-waving", 1.0, {"coupling__external__stiffness": 60.0, "coupling__internal__stiffness": 60.0}),
        ("knob", 0.5, {}),  # a rotation alone, friction
        ("thin-plate", 0.1, {}),  # a mesh
        ("unequal-devices", 0.3, {}),  # the metric of masses
        ("soft-pinch", 0.3, {}),
        ("pick-and-place", 0.4, {}),  # a floor: until the object leaves it
    ],
)
def test_the_ledger_closes_in_every_kind_of_scene(name: str, duration: float, changes: dict[str, Any]) -> None:
    rec = watched(name, duration, **changes)
    assert_closed(rec)
    assert rec.summary()["ledger_gap"] <= CLOSED


def spinning(**changes: Any) -> gx.Scene:
    """Four fingers hold a brick of three moments by friction, or attached, while it falls and spins; or as changed."""
    tips = [[-0.03, 0.0, 0.0], [0.03, 0.0, 0.0], [0.0, 0.04, 0.0], [0.0, -0.04, 0.0]]
    device = {"name": "simulated", "mass": 0.1, "damping": 0.5}
    made = gx.Scene(
        dimensions=3, period=0.002, duration=0.4, gravity=[0.0, 0.0, -9.81],
        object={
            "mass": 0.1, "viscosity": 0.5, "rotational_viscosity": 1e-4,
            "shape": {"kind": "box", "size": [0.06, 0.08, 0.1]},
            "angular_velocity": [3.0, -2.0, 4.0], "velocity": [0.02, 0.0, 0.1], "inertia": [8e-5, 1.1e-4, 1.7e-4],
        },
        coupling={
            "external": {"stiffness": 120.0, "damping": 0.2}, "internal": {"stiffness": 200.0, "damping": 0.1},
            "passivity": "observe", "friction": 0.6,
        },
        finger=[{"start": p, "device": device, "hand": {"stiffness": 150.0, "squeeze": 0.004}} for p in tips],
    )  # fmt: skip
    return made.replace(changes)


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"coupling.contact": "attached", "coupling.reaction": "contact"},
        {"coupling.friction": "stick", "object.inertia": 1e-4},
        {"object.free": [True, False, True, False, False, True], "coupling.friction": 0.0,
         "object.velocity": [0.02, 0.0, 0.1], "object.angular_velocity": [0.0, 0.0, 4.0]},
        {"coupling.external.stiffness": [[120.0, 10.0, 0.0], [10.0, 90.0, 0.0], [0.0, 0.0, 100.0]],
         "coupling.form": "symmetric", "coupling.friction": 0.0},
    ],
    ids=["friction", "attached", "stick", "locked", "matrices"],
)  # fmt: skip
def test_the_ledger_closes_under_every_integrator(integrator: str, changes: dict[str, Any]) -> None:
    scene = spinning(**{"object.integrator": integrator, **changes})
    rec = gx.run(scene, duration=0.04)
    assert_closed(rec)
    books = rec.energy["object"]
    turning = rec.array("objects/object/angular_velocity").copy()
    R = Rotation.from_quat(require(rec.object_orientation).copy())
    own = R.inv().apply(turning)
    moments = np.broadcast_to(np.array(scene.object[0].inertia, dtype=float), 3)
    kinetic = 0.05 * (rec.object_velocity**2).sum(axis=1) + 0.5 * (own**2) @ moments
    np.testing.assert_allclose(books["kinetic"], kinetic, rtol=1e-12)
    fallen = -0.1 * 9.81 * (rec.object_position[:, 2] - rec.object_position[0, 2])
    np.testing.assert_allclose(books["gravity"], fallen, rtol=0, atol=1e-15)
    free = np.array(scene.free(scene.object[0]), dtype=float)
    steps = np.hstack([np.diff(rec.object_position, axis=0), (R[1:] * R[:-1].inv()).as_rotvec()]) * free
    np.testing.assert_allclose(
        books["wrench"][1:], np.cumsum((rec.wrench[:-1] * steps).sum(axis=1)), rtol=0, atol=1e-12 * peak(books)
    )
    fingers = np.cumsum((rec.finger_force[:-1] * np.diff(rec.finger_position, axis=0)).sum(axis=(1, 2)))
    np.testing.assert_allclose(books["fingers"][1:], fingers, rtol=0, atol=1e-12 * peak(books))
    np.testing.assert_allclose(books["fingers"], -rec.device_energy.sum(axis=1), rtol=0, atol=1e-12 * peak(books))
    assert np.diff(books["leaked"].sum(axis=1)).min() >= -1e-15  # K is symmetric where nothing is skew
    if integrator == "exact" and changes.get("object.inertia") == 1e-4:
        assert not books["defect"].any()


def test_coulomb_slip_takes_what_friction_does() -> None:
    """Fingers drag along a wall that stands still: slipped is mu f_n times the way, in the end nothing is stored."""
    mu, depth, speed = 0.3, 0.002, 0.05
    grasp, observer = held(n=2, d=2, kep=200.0, kip=200.0, shaped=True, friction=mu)
    p = np.array([[-0.02 + depth, 0.0], [0.02 - depth, 0.0]])
    for k in range(200):
        grasp.finger_position[:] = p + np.array([0.0, speed * 1e-3 * k])
        assert grasp.sample() == 0
        observer.sample()
    slid = read(observer, "slipped")
    stretched = mu * depth  # of each spring along the surface, before it slides [m]
    way = 199 * speed * 1e-3 - stretched
    expected = 2 * mu * 200.0 * depth * way
    assert slid.sum() == pytest.approx(expected, rel=0.02)  # a step of 5e-5 of 1e-2 m, at the start of sliding
    assert np.abs(slid[[0, 2]]).max() < 1e-9 * expected  # both go the same way: translation alone


# By hand, object held -----------------------------------------------------------------------------------------------


def held(
    n: int, d: int, kep: float, kip: float, ked: float = 0.0, kid: float = 0.0, shaped: bool = False,
    friction: float = 0.0, T: float = 1e-3,
) -> tuple[GraspedObject, Observer]:  # fmt: skip
    """A grasp whose object nothing moves but the test: contacts on a ring, attached unless it has a shape."""
    grasp = GraspedObject(
        n, d, T, Coupling(external=Impedance(kep, ked), internal=Impedance(kip, kid)),
        Rules(attached=not shaped, friction=friction, fade=None),
        lambda state: fill_body(state, dimensions=d, mass=1.0, inertia=1e-3 if d > 1 else None),
        shape=Box((0.04,) * d) if shaped else None,
    )  # fmt: skip
    if shaped:
        grasp.meet(np.array([[-0.021, 0.0], [0.021, 0.0]])[:, :d])
    else:
        grasp.attach(ring(n, d))
    body = NativeBody(grasp.body_state)
    return grasp, Observer(grasp, body, T, control=False, friction=np.zeros(n), mass=np.full(n, 0.1))


def ring(n: int, d: int) -> np.ndarray:
    angle = 2 * np.pi * np.arange(n) / n
    return 0.03 * np.stack([np.cos(angle), np.sin(angle), np.zeros(n)], axis=1)[:, :d]


def read(observer: Observer, name: str) -> np.ndarray:
    return observer.buffer[observer.where[name]]


MOTIONS = {
    "internal": ring(3, 2) / 0.03,  # outwards, all the same
    "translation": np.tile([0.6, 0.8], (3, 1)),
    "rotation": ring(3, 2)[:, ::-1] * [-1.0, 1.0] / 0.03,
}


@pytest.mark.parametrize("mode", [0, 1, 2])
@pytest.mark.parametrize("equal", [False, True])
def test_fingers_in_a_sine_on_a_held_object(mode: int, equal: bool) -> None:
    """Leak n k N A^2 sin^2(pi/N) a cycle, damping n b w A^2 N sin(pi/N) cos(pi/N): in one mode alone.

    Sum of 1/2 k D^2 with D = 2 A sin(pi/N) cos; and of b e'D with e' = A w cos(th), D = 2 A sin(pi/N) cos(th + pi/N).
    """
    N, A, T, kep, kip, ked, kid = 40, 1e-3, 1e-3, 150.0, 400.0, 0.3, 0.7
    if equal:
        kip, kid = kep, ked
    grasp, observer = held(3, 2, kep, kip, ked, kid, T=T)
    direction = list(MOTIONS.values())[mode]
    (k, b), w = (kip, kid) if mode == 0 else (kep, ked), 2 * np.pi / (N * T)
    for j in range(3 * N + 1):
        angle = 2 * np.pi * j / N
        grasp.finger_position[:] = ring(3, 2) + A * np.sin(angle) * direction
        grasp.finger_velocity[:] = A * w * np.cos(angle) * direction
        assert grasp.sample() == 0
        observer.sample()
    s, c = np.sin(np.pi / N), np.cos(np.pi / N)
    leaked, damped = 9 * k * N * A**2 * s**2, 9 * b * w * A**2 * N * s * c
    others = [j for j in range(3) if j != mode]
    for name, value in (("leaked", leaked), ("damped", damped), ("work", damped - leaked)):
        found = read(observer, name)
        assert found[mode] == pytest.approx(value, rel=1e-10)
        assert np.abs(found[others]).max() < 1e-12 * leaked
    assert np.abs(read(observer, "slipped")).max() < 1e-12 * leaked
    assert np.abs(read(observer, "reshaped")).max() < 1e-12 * leaked
    stored = read(observer, "stored")
    assert stored[mode] < 1e-12 * leaked  # back where it began


def test_an_object_that_only_turns_leaks_in_rotation_though_nothing_has_a_linear_velocity() -> None:
    """Fingers and centre stand still, the object turns in a sine: n kep r^2 N th^2 sin^2(pi/N) a cycle, to th^2.

    An observer of force times linear velocity reads zero at both ports.
    """
    N, amplitude, kep, r = 50, 1e-4, 300.0, 0.03
    grasp, observer = held(3, 2, kep, 900.0)
    state = grasp.body_state
    for j in range(2 * N + 1):
        body = BodyState(memoryview(state))
        body.motion.angle = float(amplitude * np.sin(2 * np.pi * j / N))
        orient(body)
        grasp.finger_position[:] = ring(3, 2)
        assert grasp.sample() == 0
        observer.sample()
    expected = 2 * 3 * kep * r**2 * N * amplitude**2 * np.sin(np.pi / N) ** 2
    leaked = read(observer, "leaked")
    assert leaked[2] == pytest.approx(expected, rel=1e-7)
    assert np.abs(leaked[:2]).max() < 1e-7 * expected
    assert read(observer, "fingers")[0] == 0.0
    assert read(observer, "wrench")[0] == pytest.approx(expected, rel=1e-6)


# Bodies ---------------------------------------------------------------------------------------------------------------


def test_what_exact_viscosity_takes_is_its_integral() -> None:
    for z in (0.0, 1e-9, 1e-3, 0.1, 0.499, 0.501, 2.0, 30.0):
        exact = mpmath.quad(lambda s, z=z: ((1 - mpmath.exp(-z * s)) / z if z else s) ** 2, [0, 1])
        assert energy.decay_square(z) == pytest.approx(float(exact), rel=2e-14)
    m, b, T, v, u = 0.3, 2.0, 0.05, 0.4, -3.0
    a = b / m
    loss = mpmath.quad(lambda t: b * (v * mpmath.exp(-a * t) + u / a * (1 - mpmath.exp(-a * t))) ** 2, [0, T])
    assert energy.viscous(EXACT, m, b, T, v, 0.0, u) == pytest.approx(float(loss), rel=1e-13)


def test_a_body_of_three_moments_that_spins_freely_gains_nothing_but_the_defect_of_its_order() -> None:
    """Exact is of fourth order there: halving the period makes the defect at least 2^4 times smaller in all."""
    found = []
    for T in (0.001, 0.0005):
        spin = {"object.angular_velocity": [30.0, -20.0, 40.0], "object.rotational_viscosity": 0.0, "period": T}
        loose = {"coupling.external": {"stiffness": 0.0}, "coupling.internal": {"stiffness": 0.0}}
        made = spinning(**spin, **loose, **{"coupling.contact": "attached"})
        books = gx.run(made, duration=0.1).energy["object"]
        found.append(abs(books["defect"][-1]))
        assert found[-1] < 1e-4 * books["kinetic"][0]
    assert found[1] < found[0] / 2**3.9


@pytest.mark.parametrize("dynamics", CARRIERS)
def test_contacts_of_others_are_what_is_left_over(dynamics: str) -> None:
    require_dynamics(dynamics)
    free = spinning(**{"object.dynamics": dynamics, "object.viscosity": 0.0, "object.rotational_viscosity": 0.0,
                       "object.inertia": 1e-4})  # fmt: skip
    books = gx.run(free, duration=0.2).energy["object"]
    assert np.abs(books["contact"]).max() < 1e-9 * peak(books)
    assert np.abs(books["gap"]).max() <= CLOSED * peak(books)


# In runs --------------------------------------------------------------------------------------------------------------


def test_watching_changes_no_force_and_no_motion_and_not_watching_has_no_columns() -> None:
    for changes in ({}, {"coupling.contact": "attached", "object.integrator": "implicit"}):
        watching, not_watching = (
            gx.run(spinning(**changes, **{"coupling.passivity": p}), duration=0.02) for p in ("observe", "off")
        )
        for column in not_watching.layout.columns:
            assert np.array_equal(watching.array(column), not_watching.array(column)), column
        assert not not_watching.energy and not_watching.summary()["leak"] is None
        assert not any("energy/" in name for name in not_watching.layout.columns)


def test_a_recording_on_disk_has_the_ledger(tmp_path: Any) -> None:
    made = gx.load("paper-spring", {"coupling.passivity": "control"})
    rec, kept = gx.run(made, duration=0.5, out=tmp_path / "run"), gx.run(made, duration=0.5)
    for name, values in kept.energy["object"].items():
        assert np.array_equal(rec.energy["object"][name], values)
    assert rec.summary()["braking"] == [0.0, 0.0, 0.0]


def test_after_a_fault_the_ledger_stands_still() -> None:
    rec = gx.run(
        spinning(**{"object.integrator": "explicit", "object.rotational_viscosity": 1e-5,
                    "coupling.contact": "attached", "coupling.external.stiffness": 1e5}), duration=1.0
    )  # fmt: skip
    [fault] = rec.faults
    for values in rec.energy["object"].values():
        late = values[fault.tick :]
        assert np.isfinite(values).all() and (late == late[0]).all()


def test_bad_values_and_the_plan(tmp_path: Path) -> None:
    driver = tmp_path / "massless.py"
    driver.write_text(
        "from graspfx.loop.device import Features\n\n\nclass Rod:\n    features = Features(1, 1)\n"
        "    def open(self, period): pass\n    def read(self): pass\n    def write(self, forces): pass\n"
        "    def stop(self): pass\n    def close(self): pass\n"
        "    def __enter__(self): return self\n    def __exit__(self, *exc): pass\n"
        "def connect():\n    return Rod()\n"
    )
    with pytest.raises(SceneError, match=r"coupling\.passivity: expected 'off', 'observe' or 'control'; given 'on'"):
        gx.load("paper-spring", {"coupling.passivity": "on"})
    with pytest.raises(SceneError, match=r"coupling\.passivity: 'control' requires every device to report its mass"):
        gx.load(
            "paper-spring",
            {"coupling.passivity": "control", "finger.1.device": {"name": str(driver)}, "finger.1.hand": None},
        )
    rows = {
        p: next(row for row in plan(gx.load("paper-spring", {"coupling.passivity": p})) if row.step == "energy")
        for p in ("off", "observe", "control")
    }
    assert not rows["off"].runs and rows["observe"].runs and "damped" in rows["control"].why


@pytest.mark.parametrize("coefficient", [0.0, 0.4])
def test_kernels_as_written_lowered_and_compiled_give_the_same_bits(coefficient: float) -> None:
    """All that an observer does, over samples of fingers that move at random on a body that moves."""
    grasp, observer = held(
        2 if coefficient else 3, 2, 150.0, 400.0, 0.3, 0.7, shaped=coefficient > 0.0, friction=coefficient
    )
    rng = np.random.default_rng(3)
    start = grasp.finger_position.copy() if not coefficient else np.array([[-0.019, 0.0], [0.018, 1e-3]])
    for k in range(12):
        grasp.finger_position[:] = start + 1e-4 * rng.normal(size=start.shape)
        motion = GraspState(grasp.block).body.motion
        motion.array(Motion.position)[:2] = 1e-5 * rng.normal(size=2)
        motion.angle = 1e-3 * float(rng.normal())
        orient(GraspState(grasp.block.data).body)
        assert grasp.sample() == 0
        ledger = LedgerState(observer.buffer)
        ledger.control = k % 2 == 1
        runs = [(grasp.block.copy(), observer.buffer.copy()) for _ in range(3)]
        for way, (S, B) in zip((written(watch), watch), runs, strict=False):
            way(GraspState(S.data), LedgerState(B.data), 1e-3)
        compiled(watch)(runs[2][0], 0, runs[2][1], 0, 1e-3)
        for S, B in runs[1:]:
            assert S.tobytes() == runs[0][0].tobytes()
            assert B.tobytes() == runs[0][1].tobytes()
        grasp.block[:], observer.buffer[:] = runs[0]
    assert LedgerState(observer.buffer).report.damping != Vector(0.0, 0.0, 0.0)


@pytest.mark.parametrize("singular", [False, True])
def test_springs_of_matrix_gains_hold_the_displacement_of_their_force(singular: bool) -> None:
    """K h = fe for the K of the sample, by numpy's solver; where K has no inverse, the displacement there is."""
    gains = Impedance([[70.0, 0.0], [0.0, 0.0]] if singular else [[70.0, 5.0], [5.0, 60.0]])
    grasp = GraspedObject(
        2, 2, 1e-3, Coupling(gains, gains, form="symmetric"), Rules(friction=0.4, fade=None),
        lambda state: fill_body(state, dimensions=2, mass=1.0, inertia=1e-3), shape=Box((0.04, 0.04)),
    )  # fmt: skip
    grasp.meet(np.array([[-0.021, 0.0], [0.021, 0.0]]))
    observer = Observer(
        grasp, NativeBody(grasp.body_state), 1e-3, control=False, friction=np.zeros(2), mass=np.full(2, 0.1)
    )
    for p in ([[-0.021, 0.0], [0.021, 0.0]], [[-0.018, 1e-4], [0.017, 3e-4]]):
        grasp.finger_position[:] = p
        assert grasp.sample() == 0
        observer.sample()
    h = LedgerState(observer.buffer).fingers.array(FingerBooks.stretch)[:, :2]
    block = GraspState(grasp.block)
    fe = block.fingers.array(FingerState.elastic)[:, :2]
    assert fe.any()
    if singular:
        assert np.array_equal(h, block.fingers.array(FingerState.displacement)[:, :2])
    else:
        expected = np.linalg.solve(grasp.state.stiffness.array(4), fe.ravel())
        np.testing.assert_allclose(h.ravel(), expected, rtol=0.0, atol=1e-14 * np.abs(expected).max())
