"""The safety chain in runs: the first tick, growth, readings that stop, speed, walls, faults, and every engine."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.compile.kernel import kernel
from graspfx.compile.machine import compiled
from graspfx.coupling.grasp_state import FingerState, GraspState
from graspfx.coupling.grasped import GraspedObject
from graspfx.coupling.limit import limit
from graspfx.coupling.rules import Rules
from graspfx.coupling.sample import conclude, couple
from graspfx.loop.safety.chain import SafetyChain, SafetyLimits
from graspfx.loop.safety.restrain import restrain
from graspfx.loop.safety.safety_state import Pace, SafetyState
from graspfx.loop.safety.soften import apply_gain, soften
from graspfx.objects.body import fill_body
from graspfx.recording.record import Recording
from graspfx.surfaces.closed_form.shape import Box
from tests.support.closed_paths import gain_per_loop
from tests.support.engines import recorded, same
from tests.support.grasps import law
from tests.support.optional import require
from tests.support.pinches import PERIOD as T
from tests.support.pinches import flick, pinch

GAINS = [f"coupling.{share}.{quantity}" for share in ("external", "internal") for quantity in ("stiffness", "damping")]


def sizes(rec: Recording) -> np.ndarray:
    """Sizes of the displayed forces, (N, n) [N]."""
    return np.linalg.norm(rec.displayed_force, axis=2)


def scale(rec: Recording) -> np.ndarray:
    """Shares that the chain leaves, (N, 4)."""
    return require(rec.objects["object"].scale)


# The start --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("inside", [-0.0005, 0.002, 0.008])
def test_the_first_force_is_zero_and_grows_no_quicker_than_the_rate(inside: float) -> None:
    """Wherever it starts, in the object or before it: nothing in tick 0, then at most 5 N/s from what was displayed."""
    scene = pinch(safety={"rate": 5.0, "soft_start": 0.1, "force": 1.0})
    starts = {
        f"finger.{i}.start": ((0.025 - inside) / 0.0255 * np.array(finger.start)).tolist()
        for i, finger in enumerate(scene.finger)
    }
    rec = recorded(scene.replace(starts), "interpreted", ticks=120)
    f, size = rec.displayed_force, sizes(rec)
    assert not rec.faults
    assert not f[0].any()
    assert np.diff(size, axis=0).max() <= 5.0 * T * (1.0 + 1e-12)
    assert size.max() > 0.1
    if inside > 0.0:
        assert size[1:20].any()
        assert np.diff(size, axis=0).max() > 5.0 * T * (1.0 - 1e-9)


def test_a_soft_start_scales_stiffness_and_damping() -> None:
    """3 x^2 - 2 x^3 of the time, on both sides: forces are those of the law with the gains so scaled, to rounding."""
    soft = recorded(pinch(safety={"soft_start": 0.2, "force": 50.0}), "interpreted", ticks=90)
    x = np.arange(90) / 100.0
    np.testing.assert_allclose(scale(soft)[:, 0], x * x * (3.0 - 2.0 * x), rtol=1e-14)
    assert (scale(soft)[:, 1:] == 1.0).all()
    with gx.open(pinch(), live=GAINS) as session:
        for k in range(90):
            share = max(scale(soft)[k, 0], 1e-12)
            session.set({
                "coupling.external.stiffness": 60.0 * share, "coupling.external.damping": 0.05 * share,
                "coupling.internal.stiffness": 150.0 * share, "coupling.internal.damping": 0.1 * share,
            })  # fmt: skip
            session.step()
        scaled = session.recording
    np.testing.assert_allclose(soft.finger_force, scaled.finger_force, rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(soft.object_position, scaled.object_position, rtol=0.0, atol=1e-13)


def test_a_chain_that_does_not_bite_changes_no_bit() -> None:
    """Limits far away and no soft start: every column of a run without the chain."""
    for changes in ({}, {"coupling__friction": 0.5}, {"object__integrator": "implicit"}):
        free = recorded(pinch(**changes), "interpreted", ticks=60)
        far = recorded(
            pinch(safety={"force": 50.0, "rate": 1e6, "speed": 9.0, "soft_start": 0.0}, **changes),
            "interpreted", ticks=60,
        )  # fmt: skip
        assert (scale(far) == 1.0).all()
        for column in free.layout.columns:
            assert np.array_equal(free.array(column), far.array(column)), column


# Engines ----------------------------------------------------------------------------------------------------------

SOFT = {
    f"finger__{i}__{key}": value
    for i in range(3)
    for key, value in (("model", "soft"), ("patch", 0.008), ("pad", {"kind": "hertz", "stiffness": 2e4}))
}
KINDS: dict[str, tuple[int, dict[str, Any]]] = {
    "line": (1, {"coupling__passivity": "control"}),
    "plane, friction": (2, {"coupling__friction": 0.5, "coupling__passivity": "observe"}),
    "plane, attached": (2, {"coupling__contact": "attached"}),
    "space, implicit": (3, {"coupling__friction": 0.6, "object__integrator": "implicit"}),
    "space, soft pads": (3, {"coupling__friction": 0.6, "coupling__passivity": "observe"} | SOFT),
    "space, matrices": (3, {"coupling__external__stiffness": [60.0, 61.0, 62.0], "coupling__form": "symmetric"}),
}
TIGHT = {"force": 0.2, "rate": 6.0, "soft_start": 0.05, "workspace": [[-0.03], [0.03]]}


@pytest.mark.parametrize("kind", KINDS)
def test_every_engine_gives_the_same_bits(kind: str) -> None:
    """Interpreted and compiled, with every limit biting; wrench, work and displayed force are of one force."""
    d, changes = KINDS[kind]
    box = [[-0.027] * d, [0.027] * d]
    scene = pinch(d, safety=TIGHT | {"workspace": box}, **changes)
    rec = recorded(scene, "interpreted", ticks=160)
    assert not rec.faults
    for engine in ("compiled",):
        assert same(rec, recorded(scene, engine, ticks=160)), engine
    assert np.array_equal(rec.displayed_force, -rec.finger_force)
    size = sizes(rec)
    assert size.max() <= 0.2
    assert np.diff(size, axis=0).max() <= 6.0 * T * (1.0 + 1e-12)
    p, f = rec.finger_position, rec.displayed_force
    assert not (((p > 0.027) & (f > 0.0)) | ((p < -0.027) & (f < 0.0))).any()
    assert (p > 0.027).any()
    assert scale(rec)[:, 3].min() < 1.0
    np.testing.assert_allclose(rec.wrench[:, :d], rec.finger_force.sum(axis=1), rtol=0.0, atol=1e-14)
    work = (rec.displayed_force[:-1] * np.diff(require(rec.true_position), axis=0)).sum(axis=2).cumsum(axis=0)
    np.testing.assert_allclose(rec.device_energy[1:], work, rtol=0.0, atol=1e-15)
    if rec.layout.observed:
        assert rec.summary()["ledger_gap"] < 1e-14


def test_batches_are_single_runs() -> None:
    """Four masses and two stiffnesses under a chain that bites, to the last bit."""
    scene = pinch(1, safety={"force": 0.05, "rate": 6.0, "soft_start": 0.05})
    values = {"object.mass": [0.05, 0.1, 0.2, 0.4], "coupling.internal.stiffness": [120.0, 150.0]}
    batch = gx.run_batch(scene, values, duration=0.1, keep="recordings")
    for index in np.ndindex(batch.shape):
        alone = gx.run(scene.replace({key: float(v[index]) for key, v in batch.values.items()}), duration=0.1)
        assert alone.rows.tobytes() == require(batch.recordings).item(index).rows.tobytes()
        assert alone.saturated is not None
        assert alone.saturated.any()


# Readings, speed --------------------------------------------------------------------------------------------------

DRIVER = '''
"""A point device, called in Python, that may stop bringing news, or bring nonsense."""
from graspfx.devices import simulated

class Odd(simulated.PointDevice):
    ticks, old = 0, None
    rules = {}

    def read(self):
        self.ticks += 1
        k = self.ticks - 1
        position, velocity, time = super().read()
        position, velocity = position.copy(), velocity.copy()
        for first, stop in self.rules["still"]:
            if first <= k < stop:
                return self.old
        if k == self.rules["at"]:
            array = {"position": position, "velocity": velocity}[self.rules["where"]]
            array[0, self.rules["axis"]] = float(self.rules["value"])
        self.old = position, velocity, time
        return self.old

def connect(*, mass, dimensions, damping=0.0, still=(), at=-1, where="position", axis=0, value="nan"):
    made = Odd(mass=mass, damping=damping, fingers=1, dimensions=dimensions, resolution=0.0, velocity_window=1,
               delay=0, force_limit=None, workspace=None)
    made.rules = {"still": still, "at": at, "where": where, "axis": axis, "value": value}
    return made
'''


def odd(folder: Path, safety: dict[str, Any], **settings: Any) -> gx.Scene:
    """The pinch, whose first finger has that device."""
    (folder / "odd.py").write_text(DRIVER)
    device = {"name": str(folder / "odd.py"), "mass": 0.1, "damping": 0.2, **settings}
    return pinch(safety=safety, finger__0__device=device)


@pytest.mark.parametrize("engine", ["interpreted", "compiled"])
def test_late_readings_are_let_pass_then_forces_decay_to_a_fault(tmp_path: Path, engine: str) -> None:
    """Three samples without a reading change nothing, from the fourth on forces decay in 20 ms.

    At a period of 2 ms that is a tenth a sample; the tenth sample after the third is the fault. Readings that come
    again before are trusted as slowly.
    """
    safety = {"force": 1.0, "soft_start": 0.02, "hold": 3}
    rec = recorded(odd(tmp_path, safety, still=[[50, 53], [80, 87], [120, 400]]), engine, ticks=160)
    trust = scale(rec)[:, 1]
    assert (trust[:80] == 1.0).all()
    np.testing.assert_allclose(trust[80:94], [1, 1, 1, 0.9, 0.8, 0.7, 0.6, 0.7, 0.8, 0.9, 1, 1, 1, 1], rtol=1e-12)
    np.testing.assert_allclose(trust[120:132], [1, 1, 1, *np.linspace(0.9, 0.1, 9)], rtol=1e-12)
    [fault] = rec.faults
    assert fault.tick == 132
    assert fault.message.startswith("no new reading of the device of finger0")
    assert fault.message.endswith("for more than 3 samples; all forces are zero")
    assert not rec.displayed_force[132:].any()
    assert sizes(rec)[131].any()


@pytest.mark.parametrize("engine", ["interpreted", "compiled"])
@pytest.mark.parametrize("where", ["position", "velocity"])
@pytest.mark.parametrize("value", ["nan", "inf", "-inf"])
def test_a_reading_that_is_no_number_gives_no_force_in_that_tick(
    tmp_path: Path, where: str, value: str, engine: str
) -> None:
    rec = recorded(odd(tmp_path, {"soft_start": 0.02}, at=70, where=where, axis=1, value=value), engine, ticks=90)
    [fault] = rec.faults
    assert fault.tick == 70
    assert "not finite" in fault.message
    assert sizes(rec)[69].any()
    assert not rec.displayed_force[70:].any()


def test_a_reading_far_off_displays_no_more_than_the_limits(tmp_path: Path) -> None:
    """One reading 1 m inside the object, then 1e30 m off: at most 1 N, and no more growth than 50 N/s."""
    for value in ("-1.0", "1e30"):
        rec = recorded(
            odd(tmp_path, {"force": 1.0, "rate": 50.0, "soft_start": 0.02}, at=70, value=value), "interpreted", ticks=90
        )
        assert sizes(rec).max() <= 1.0
        assert np.diff(sizes(rec), axis=0).max() <= 50.0 * T * (1.0 + 1e-12)


def test_too_quick_a_finger_decays_and_is_a_fault() -> None:
    """Beyond 0.05 m/s the waving finger's 0.06 m/s is too much: a tenth less force a sample, then none."""
    rec = recorded(pinch(safety={"speed": 0.05, "soft_start": 0.0}), "interpreted", ticks=300)
    [fault] = rec.faults
    quick = np.linalg.norm(rec.finger_velocity, axis=2)
    first = int(np.flatnonzero((quick > 0.05).any(axis=1))[0])
    name = rec.layout.fingers[int((quick[first] > 0.05).argmax())]
    assert fault.message == f"{name} exceeded safety.speed, 0.05 m/s; all forces are zero"
    assert fault.tick == first + 10
    np.testing.assert_allclose(scale(rec)[first : first + 10, 1], np.linspace(1.0, 0.1, 10), rtol=1e-12)
    assert not rec.displayed_force[fault.tick :].any()


def test_a_step_over_two_samples_is_half_as_quick_for_friction(tmp_path: Path) -> None:
    """A ledger credits a device's friction with b d^2/t: where each second reading is the last one again, t is 2 T.

    The fingers wave without force, so that nothing but friction stands in the balance, and steps over 2 T cannot take
    more than those over T do.
    """
    loose = {"external": {"stiffness": 1e-6}, "internal": {"stiffness": 1e-6}, "contact": "attached",
             "passivity": "observe"}  # fmt: skip
    spent = []
    for still in ([], [[k, k + 1] for k in range(1, 250, 2)]):
        scene = odd(tmp_path, {"soft_start": 0.0}, still=still)
        table = scene.model_dump(exclude_unset=True) | {"coupling": loose}
        table["finger"] = [each | {"device": table["finger"][0]["device"]} for each in table["finger"]]
        rec = recorded(gx.Scene(**table), "interpreted", ticks=250)
        assert not rec.faults
        spent.append(rec.array("objects/object/energy/balance")[-1].sum())
    assert 0.9 * spent[0] < spent[1] < spent[0]


def test_limits_of_a_finger_stand_for_its_own() -> None:
    """0.1 N for one of three; and the device's own 0.2 N where it has less than the scene, 0.3 N."""
    scene = pinch(safety={"force": 0.3, "soft_start": 0.05}, finger__1__device__force_limit=0.2)
    most = sizes(recorded(scene, "interpreted", ticks=200)).max(axis=0)
    assert most[1] == pytest.approx(0.2, rel=1e-12)
    assert 0.2 < most[[0, 2]].max() <= 0.3
    own = scene.replace({"finger.0.safety.force": 0.1})
    most = sizes(recorded(own, "interpreted", ticks=200)).max(axis=0)
    assert most[0] == pytest.approx(0.1, rel=1e-12)
    assert most[1:].max() > 0.1


# Energy -----------------------------------------------------------------------------------------------------------


@kernel
def limited(grasp: GraspState, safety: SafetyState, pace: Pace) -> int:
    """Forces of a sample as the chain leaves them, up to their restraint."""
    code = soften(grasp, safety, pace, couple(grasp))
    code = limit(grasp, code)
    apply_gain(grasp, safety)
    return conclude(grasp, code)


@pytest.mark.parametrize("gain", [1.0, 0.4])
@pytest.mark.parametrize("rules", [Rules(attached=True), Rules(friction=3.0, fade=None)], ids=["attached", "mu"])
def test_saturated_closed_motions_make_no_energy(rules: Rules, gain: float) -> None:
    """Object and four fingers in space, nearly always at the chain's 0.08 N: 1e-6 of the peak, the integration's error.

    Half way through a soft start as well, with the gain that it has there.
    """
    start = 0.022 * np.array([[1.0, 0.1, 0.2], [-1.0, 0.2, -0.1], [0.1, 1.0, 0.1], [-0.2, -1.0, 0.1]])

    def fill(state: np.ndarray) -> None:
        fill_body(state, dimensions=3, mass=0.1, inertia=4e-5, rotational_viscosity=1e-4)

    g = GraspedObject(4, 3, 0.005, law(40.0, 160.0), rules, fill, shape=Box((0.06,) * 3), limit=np.inf)
    far = np.full((4, 3), np.inf)
    every = np.full(4, np.inf)
    chain = SafetyChain(SafetyLimits(np.full(4, 0.08), every, every, -far, far, 3, 0.0), [(g, np.arange(4))], 4, 0.005)
    [buffer], pace = chain.buffers, Pace(chain.pace)
    pace.soft, pace.trust = gain, 1.0
    chain.buffers[0][:] = buffer
    law_of, restraint = compiled(limited), compiled(restrain)
    shares = []

    def ask(g: GraspedObject) -> int:
        assert law_of(g.block, 0, buffer, 0, chain.pace, 0) == 0
        shares.append(g.array(FingerState.saturated).mean())
        return int(restraint(g.block, 0, buffer, 0, chain.pace, 0))

    if rules.attached:
        g.attach(start)
    else:
        g.meet(1.5 * start)
        for share in np.linspace(1.5, 1.0, 50):
            g.finger_position[:] = share * start
            assert ask(g) == 0
    shares.clear()
    assert abs(gain_per_loop(g, start, 0, steps=6144, ask=ask)) < 1e-6
    assert np.mean(shares) > (0.5 if rules.attached else 0.9)


@pytest.mark.parametrize("safety", [{"force": 0.5}, {"force": 0.5, "rate": 200.0}, {"force": 0.5, "soft_start": 0.02}])
def test_a_flick_gives_the_object_no_more_than_the_user_did(safety: dict[str, float]) -> None:
    """Under control: at most what one sample lets pass, L v T/2 = 6 uJ of 1.2 to 1.7 mJ, in the end.

    A rate makes energy where it bites (0.4 mJ here), and a soft start under load takes it from the tank (0.5 mJ): the
    brake takes it back.
    """
    rec = gx.run(flick(coupling__passivity="control", safety={"soft_start": 0.0} | safety))
    gained = 0.05 * float(rec.object_velocity[-1, 0]) ** 2
    work = -float(rec.device_energy[-1, 0])
    assert rec.saturated is not None
    assert rec.saturated.any()
    assert gained > 1e-3
    assert gained - work < 8e-6
    assert rec.summary()["ledger_gap"] < 1e-14


def test_a_flick_at_the_limit_makes_no_energy_without_a_brake() -> None:
    """But for what holding forces over samples makes: L v T, 0.1 mJ of 1.7."""
    rec = gx.run(flick(safety={"soft_start": 0.0, "force": 0.5}))
    gained = 0.05 * float(rec.object_velocity[-1, 0]) ** 2
    assert gained > 1e-3
    assert gained + float(rec.device_energy[-1, 0]) < 0.5 * 1.0 * 2 * 1e-4


def test_shares_are_exported_by_name(tmp_path: Path) -> None:
    """In a file and back, and as columns of a table."""
    rec = recorded(pinch(safety={"force": 0.2, "soft_start": 0.1}), "interpreted", ticks=30)
    rec.save(tmp_path / "recording.h5")
    again = Recording.load(tmp_path / "recording.h5")
    np.testing.assert_array_equal(scale(again), scale(rec))
    rec.to_csv(tmp_path / "recording.csv")
    names = (tmp_path / "recording.csv").read_text().splitlines()[0].split(",")
    assert [each for each in names if each.startswith("object_scale")] == [
        f"object_scale.object.{share}" for share in ("soft", "trust", "squeeze", "outer")
    ]
    assert recorded(pinch(), "interpreted", ticks=5).objects["object"].scale is None
