"""Displayed forces are recorded: the force on the operator after limits, and nothing else on the object."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx import plugins
from graspfx.assembly.build import build
from graspfx.bench.timing import is_installed
from graspfx.certificate.plan import limits_inside, plan
from graspfx.coupling.limit import is_inside
from graspfx.errors import InputError
from graspfx.recording.record import Recording
from tests.support import foreign_parts
from tests.support.engines import recorded, same
from tests.support.optional import require
from tests.support.pinches import flick, pinch

TORQUE = 0.0012  # of a motor [N m], at a gear of 15 and links of 128 mm: 0.14 N at the finger


LIMIT: dict[str, Any] = {"finger__0__device__force_limit": 0.2}
COUPLINGS: dict[str, dict[str, Any]] = {
    "frictionless": {},
    "friction": {"coupling__friction": 0.5},
    "stick": {"coupling__friction": "stick"},
    "attached": {"coupling__contact": "attached"},
    "equal gains": {"coupling__internal": {"stiffness": 100.0, "damping": 0.1},
                    "coupling__external": {"stiffness": 100.0, "damping": 0.1}},
    "kep > kip": {"coupling__external__stiffness": 200.0},
    "matrices": {"coupling__external__stiffness": [60.0, 61.0, 62.0], "coupling__form": "symmetric"},
    "matrices and friction": {"coupling__external__stiffness": [60.0, 61.0, 62.0], "coupling__form": "symmetric",
                              "coupling__friction": 0.5},
    "implicit": {"object__integrator": "implicit"},
    "observed": {"coupling__passivity": "observe"},
    "controlled": {"coupling__passivity": "control", "coupling__friction": 0.5},
}  # fmt: skip


def require_consistent(rec: Recording, limits: np.ndarray, moment_error: float = 1e-15) -> None:
    """Require what a recording promises of forces, to the last bit where it is the same number."""
    assert rec.law_force is not None
    assert rec.saturated is not None
    assert np.array_equal(rec.displayed_force, -rec.finger_force)
    size = np.linalg.norm(rec.displayed_force, axis=2)
    assert (size <= limits).all()
    free = ~rec.saturated.any(axis=1)
    np.testing.assert_array_equal(rec.law_force[free], rec.finger_force[free])
    d = rec.layout.dimensions
    np.testing.assert_allclose(rec.wrench[:, :d], rec.finger_force.sum(axis=1), rtol=0.0, atol=1e-14)
    if d > 1 and rec.finger_moment is None:
        arm, force = rec.finger_position - rec.object_position[:, None], rec.finger_force
        if d == 2:
            moment = (arm[..., 0] * force[..., 1] - arm[..., 1] * force[..., 0]).sum(axis=1, keepdims=True)
        else:
            moment = np.cross(arm, force).sum(axis=1)
        np.testing.assert_allclose(rec.wrench[:, d:], moment, rtol=0.0, atol=moment_error)
    work = (rec.displayed_force[:-1] * np.diff(require(rec.true_position), axis=0)).sum(axis=2).cumsum(axis=0)
    np.testing.assert_allclose(rec.device_energy[1:], work, rtol=0.0, atol=1e-15)


@pytest.mark.parametrize("kind", COUPLINGS)
def test_what_is_displayed_is_recorded(kind: str) -> None:
    """One finger of three at 0.2 N: within it, wrench and work of what it got, and of nothing else.

    The implicit integrator's moment has the arms at the end of the sample, up to 1 mm on.
    """
    rec = recorded(pinch(**LIMIT, **COUPLINGS[kind]), "interpreted", ticks=200)
    assert not rec.faults
    require_consistent(rec, np.array([0.2, np.inf, np.inf]), 1e-3 if kind == "implicit" else 1e-15)
    assert rec.saturated is not None
    assert 0.1 < rec.saturated[:, 0].mean() < 1.0
    assert not rec.saturated[:, 1:].any()
    assert rec.law_force is not None
    assert np.linalg.norm(rec.law_force[:, 0], axis=1).max() > 0.25
    assert np.linalg.norm(rec.finger_force[:, 0], axis=1).max() == pytest.approx(0.2, rel=1e-12)


SOFT = {f"finger__{i}__{key}": value for i in range(3) for key, value in (("model", "soft"), ("patch", 0.008))}
ENGINES: dict[str, tuple[int, dict[str, Any]]] = {
    "line": (1, COUPLINGS["controlled"] | {"coupling__friction": 0}),
    "line, attached": (1, COUPLINGS["attached"]),
    "line, stick": (1, COUPLINGS["stick"]),
    "plane": (2, COUPLINGS["frictionless"]),
    "space, soft": (3, {"coupling__friction": 0.6} | SOFT),
}


@pytest.mark.parametrize("kind", ENGINES)
def test_limits_are_the_same_in_every_engine(kind: str) -> None:
    """To the last bit, interpreted and compiled; on a line, in the plane and in space."""
    d, changes = ENGINES[kind]
    scene = pinch(d, **changes, **LIMIT)
    rec = recorded(scene, "compiled", ticks=160)
    assert same(rec, recorded(scene, "interpreted", ticks=160))
    require_consistent(rec, np.array([0.2] + [np.inf] * (len(scene.finger) - 1)))
    assert rec.saturated is not None
    assert rec.saturated[:, 0].any()


@pytest.mark.parametrize("kind", ["friction", "attached", "stick", "implicit"])
def test_the_ledger_closes_at_limits(kind: str) -> None:
    """Inside the projection and scaled: the gap is rounding, and damping takes energy, as without limits."""
    rec = recorded(pinch(**COUPLINGS[kind], **LIMIT, coupling__passivity="observe"), "interpreted", ticks=150)
    assert rec.saturated is not None
    assert rec.saturated.any()
    assert rec.summary()["ledger_gap"] < 1e-14
    [energy] = rec.energy.values()
    assert (energy["damped"][-1] > -1e-12).all()


def test_batches_are_single_runs() -> None:
    """The reference scene at limits from 20 mN to 50 N and three gains, some saturated, to the last bit."""
    scene = gx.load("reference-1dof")
    values = {
        "finger.0.device.force_limit": [0.02, 0.05, 0.1, 50.0],
        "coupling.internal.stiffness": [40.0, 60.0, 90.0],
    }
    batch = gx.run_batch(scene, values, duration=0.2, keep="recordings")
    assert batch.recordings is not None
    hits = 0
    for index in np.ndindex(batch.shape):
        alone = gx.run(scene.replace({key: float(v[index]) for key, v in batch.values.items()}), duration=0.2)
        assert alone.rows.tobytes() == require(batch.recordings).item(index).rows.tobytes()
        assert alone.saturated is not None
        hits += bool(alone.saturated.any())
    assert 6 <= hits < 12


def test_a_limit_that_does_not_bite_changes_no_bit() -> None:
    """All columns are those of a run without a limit, at 50 N, besides those that say so."""
    for changes in COUPLINGS.values():
        free = recorded(pinch(**changes), "interpreted", ticks=60)
        far = recorded(pinch(**changes, finger__0__device__force_limit=50.0), "interpreted", ticks=60)
        assert free.law_force is None
        assert free.saturated is None
        assert far.saturated is not None
        assert not far.saturated.any()
        for column in free.layout.columns:
            assert np.array_equal(free.array(column), far.array(column)), column
        assert np.array_equal(free.displayed_force, far.displayed_force)
        assert np.array_equal(far.law_force, far.finger_force)  # type: ignore[arg-type]


def test_recordings_keep_what_was_displayed(tmp_path: Path) -> None:
    """In memory, on disk and loaded again; the summary counts samples at the limit."""
    rec = gx.run(pinch(**LIMIT), duration=0.3)
    rec.save(tmp_path / "recording.h5")
    again = Recording.load(tmp_path / "recording.h5")
    for name in ("displayed_force", "law_force", "saturated"):
        assert np.array_equal(getattr(rec, name), getattr(again, name))
    assert again.saturated is not None
    assert again.saturated.dtype == bool
    summary = rec.summary()
    assert summary["saturated"] == rec.saturated.mean(axis=0).tolist()  # type: ignore[union-attr]
    assert summary["peak_displayed_force"][0] == pytest.approx(0.2, rel=1e-12)
    free = gx.run(pinch(), duration=0.1)
    assert free.law_force is None
    assert free.summary()["saturated"] is None
    assert free.summary()["peak_displayed_force"] == free.summary()["peak_force"]


# A flick ----------------------------------------------------------------------------------------------------------


def test_a_flick_at_the_limit_makes_no_energy() -> None:
    """The object gains what the user gave it, but for what holding forces over samples makes: L v T, 0.05 mJ.

    With the limit of 0.5 N at the device alone it gained 48 mJ for 7.1 mJ of the user's work.
    """
    rec = gx.run(flick(finger__0__device__force_limit=0.5))
    gained = 0.05 * float(rec.object_velocity[-1, 0]) ** 2
    work = -float(rec.device_energy[-1, 0])
    assert rec.saturated is not None
    assert rec.saturated.mean() > 0.2
    assert gained > 1e-3
    assert abs(gained - work) < 0.5 * 1.0 * 2 * 1e-4


# Devices ----------------------------------------------------------------------------------------------------------


def test_a_device_of_ones_own_is_limited_as_ours(tmp_path: Path) -> None:
    """A driver called in Python that tells its peak force: the same recording, to the last bit."""
    driver = tmp_path / "called.py"
    driver.write_text(
        "from graspfx.devices import simulated\n\n\nclass Called(simulated.PointDevice):\n"
        "    def write(self, forces):\n        super().write(forces)\n\n\n"
        "def connect(*, mass, dimensions, damping=0.0, force_limit=None):\n"
        "    return Called(mass=mass, damping=damping, fingers=1, dimensions=dimensions, resolution=0.0,\n"
        "                  velocity_window=1, delay=0, force_limit=force_limit, workspace=None)\n"
    )
    ours = recorded(pinch(**LIMIT), "interpreted", ticks=200)
    device = {"name": str(driver), "mass": 0.1, "damping": 0.2, "force_limit": 0.2}
    for engine in ("interpreted", "compiled"):
        assert same(ours, recorded(pinch(finger__0__device=device), engine, ticks=200))
    require_consistent(ours, np.array([0.2, np.inf, np.inf]))


@pytest.mark.skipif(not is_installed("pybullet"), reason="PyBullet has no wheel for this Python")
def test_a_body_of_other_software_receives_what_was_displayed() -> None:
    """PyBullet's body in place of ours: limits, wrench and work, and a push of 0.2 N at most moves it."""
    scene = pinch(3, object__dynamics="bullet", coupling__friction=0.6, **LIMIT)
    rec = recorded(scene, "compiled", ticks=200)
    assert same(rec, recorded(scene, "interpreted", ticks=200))
    require_consistent(rec, np.array([0.2, np.inf, np.inf]))
    assert rec.saturated is not None
    assert rec.saturated[:, 0].any()


def arms(**settings: Any) -> gx.Scene:
    """The paper's arms at the object's sides, squeezing."""
    fingers = [
        {
            "start": [side * 0.0255, 0.0],
            "device": {"name": "two-link", "base": [side * 0.04, -0.18], "elbow": elbow} | settings,
            "hand": {"stiffness": 150.0, "damping": 1.0, "squeeze": 0.006, "closing": [-side, 0.0]},
        }
        for side, elbow in ((-1.0, "left"), (1.0, "right"))
    ]
    table = pinch(2).to_dict()
    return gx.Scene(**(table | {"finger": fingers, "duration": 0.5}))


@pytest.mark.parametrize("drive", ["base", "elbow"])
def test_torque_limits_are_the_frameworks_too(drive: str) -> None:
    """Motors of 1.2 mN m: what they reach in every direction where the arm stands limits both sides.

    The device's own limit then never acts: motors stay within their torque, and displayed is what was told.
    """
    two_link: Any = plugins.load("devices", "two-link")
    rec = recorded(arms(drive=drive, torque_limit=TORQUE), "compiled", ticks=250)
    assert same(rec, recorded(arms(drive=drive, torque_limit=TORQUE), "interpreted", ticks=250))
    assert not rec.faults
    assert rec.saturated is not None
    assert rec.saturated.mean() > 0.2
    device = two_link.connect(base=[-0.04, -0.18], drive=drive, torque_limit=TORQUE)
    positions, forces, limits = (
        require(rec.true_position)[::25, 0],
        rec.displayed_force[::25, 0],
        rec.saturated[::25, 0],
    )
    for p, f, at_limit in zip(positions, forces, limits, strict=True):
        J = device.arm.jacobian(*device.arm.angles(*p))
        if drive == "elbow":
            J[:, 0] += J[:, 1]
        largest = TORQUE * 15.0 / np.linalg.norm(J, axis=0).max()
        assert np.abs(J.T @ f).max() / 15.0 <= TORQUE
        assert np.linalg.norm(f) <= largest * (1.0 + 1e-3)  # encoders: the device knows where it stands to 13 um
        if at_limit:
            assert np.linalg.norm(f) == pytest.approx(largest, rel=1e-3)


def test_a_real_board_tells_its_largest_force_in_every_sample() -> None:
    """An arm behind a board is called in Python: its limit changes with its posture, and is read there."""
    two_link: Any = plugins.load("devices", "two-link")

    class Board:
        def __init__(self) -> None:
            self.at = 0

        def open(self, period: float) -> None: ...

        def counts(self) -> tuple[int, int]:
            self.at += 400
            return 10_000 + self.at, 20_000

        def torque(self, first: float, second: float) -> None: ...

        def close(self) -> None: ...

    device = two_link.connect(drive="elbow", elbow="right", board=Board(), torque_limit=TORQUE)
    device.open(0.002)
    seen = set()
    for _ in range(3):
        position, _, _ = device.read()
        reach = float(np.linalg.norm(position[0]))
        assert device.largest_force[0] == pytest.approx(TORQUE * 15.0 / max(reach, 0.128), rel=1e-12)
        seen.add(reach)
    assert seen


WEAKER = """from graspfx.devices import simulated
import numpy as np


class Weaker(simulated.PointDevice):
    ticks = 0

    @property
    def largest_force(self):
        return np.array([{largest}])

    def {method}(self, *given):
        self.ticks += 1
        return super().{method}(*given)


def connect(*, mass, dimensions, damping=0.0):
    return Weaker(mass=mass, damping=damping, fingers=1, dimensions=dimensions, resolution=0.0,
                  velocity_window=1, delay=0, force_limit=None, workspace=None)
"""


def test_a_limit_may_change_from_sample_to_sample(tmp_path: Path) -> None:
    """A driver in Python that grows weaker: each sample keeps what it told at that sample's reading."""
    driver = tmp_path / "weaker.py"
    driver.write_text(WEAKER.format(largest="0.3 if self.ticks < 120 else 0.1", method="read"))
    scene = pinch(finger__0__device={"name": str(driver), "mass": 0.1, "damping": 0.2})
    rec = recorded(scene, "interpreted", ticks=200)
    assert same(rec, recorded(scene, "compiled", ticks=200))
    limit = np.where(np.arange(1, 201) < 120, 0.3, 0.1)
    require_consistent(rec, np.column_stack([limit, np.full((200, 2), np.inf)]))
    assert rec.saturated is not None
    assert rec.saturated[119:, 0].all()
    assert "in every sample" in rows(scene)[0][1]


def test_a_largest_force_that_is_none_is_a_fault(tmp_path: Path) -> None:
    driver = tmp_path / "weaker.py"
    driver.write_text(WEAKER.format(largest="0.3 if self.ticks < 50 else float('nan')", method="read"))
    rec = recorded(pinch(finger__0__device={"name": str(driver), "mass": 0.1}), "interpreted", ticks=60)
    [fault] = rec.faults
    assert fault.tick == 49
    says = "reported largest forces of nan N, expected values above zero; all forces are zero"
    assert fault.message == f"the device of finger0 (Weaker) {says}"
    assert not rec.displayed_force[49:].any()


def test_a_kernels_largest_force_stands_in_its_block(tmp_path: Path) -> None:
    driver = tmp_path / "weaker.py"
    driver.write_text(WEAKER.format(largest="0.3", method="close"))
    with pytest.raises(InputError, match=r"largest_force: .*Weaker.*a view of the device's block"):
        gx.run(pinch(finger__0__device={"name": str(driver), "mass": 0.1}), duration=0.01)


@pytest.mark.parametrize("peak", [0.0, -1.0, float("nan"), True])
def test_a_peak_force_that_is_none_is_refused(tmp_path: Path, peak: object) -> None:
    driver = tmp_path / "odd.py"
    driver.write_text(
        "from dataclasses import replace\nfrom graspfx.devices import simulated\n\n\n"
        "class Odd(simulated.PointDevice):\n    @property\n    def features(self):\n"
        f"        return replace(super().features, peak_force=float('{peak}') if {peak is not True} else True)\n\n\n"
        "def connect(*, mass, dimensions, damping=0.0):\n"
        "    return Odd(mass=mass, damping=damping, fingers=1, dimensions=dimensions, resolution=0.0,\n"
        "               velocity_window=1, delay=0, force_limit=None, workspace=None)\n"
    )
    with pytest.raises(InputError, match=r"features.peak_force.*above zero"):
        gx.run(pinch(finger__0__device={"name": str(driver), "mass": 0.1}), duration=0.01)


def test_after_a_fault_nothing_is_displayed_and_nothing_saturates(tmp_path: Path) -> None:
    files = foreign_parts.write(tmp_path)
    scene = pinch(finger__1__device=foreign_parts.device(files, "device", mass=0.1, fails=150), **LIMIT)
    rec = recorded(scene, "interpreted", ticks=200)
    assert [fault.tick for fault in rec.faults] == [150]
    assert rec.law_force is not None
    assert rec.saturated is not None
    assert rec.saturated[:150].any()
    for values in (rec.displayed_force, rec.law_force, rec.saturated):
        assert not values[150:].any()


# The plan ---------------------------------------------------------------------------------------------------------


def rows(scene: gx.Scene) -> list[tuple[bool, str]]:
    return [(row.runs, row.why) for row in plan(scene) if row.step.endswith("limit")]


def test_the_plan_says_where_limits_come_from(tmp_path: Path) -> None:
    """The step, its figures and devices, and a driver that may clamp where nobody sees it."""
    assert rows(pinch()) == [(False, "no device states a largest force")]
    [(runs, why)] = rows(pinch(**LIMIT))
    assert runs
    assert "finger0 0.2 N (simulated)" in why
    for changes in COUPLINGS.values():
        scene = pinch(**LIMIT, **changes)
        with build(scene) as servo:
            [held] = servo.objects
            assert limits_inside(scene, scene.object[0]) == is_inside(held.grasped.state)
    assert "inside the projection" in why
    assert "scaled" in rows(pinch(**LIMIT, object__integrator="implicit"))[0][1]
    assert "in every sample" in rows(arms(drive="elbow"))[0][1]
    files = foreign_parts.write(tmp_path)
    hidden = rows(pinch(finger__1__device=foreign_parts.device(files, "device", mass=0.1)))
    assert hidden[0] == (False, "no device states a largest force")
    assert "finger1" in hidden[1][1]
    assert "not visible" in hidden[1][1]
