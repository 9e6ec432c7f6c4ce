"""The two forces of a recording: against singular values, in sum, as wrenches, in energy, and through files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import graspfx as gx
from graspfx import plugins
from graspfx.loop.columns import RunFault
from graspfx.recording.header import SPLIT, KeyChange, Outcome
from graspfx.recording.record import Recording
from graspfx.recording.recorded_split import RowSplit, splits_of
from graspfx.recording.sink import FileSink
from tests.support.optional import require
from tests.support.outside_split import external, motions
from tests.support.parts import abandon
from tests.support.recordings import layout, recording
from tests.support.scenes import random_table

SHELF = sorted(name for name, origin in plugins.names("scenes").items() if origin.startswith("GraspFX"))
FREE = {1: [[True]], 2: [[True] * 3, [True, False, True], [True, True, False]]}
FREE[3] = [[True] * 6, [False] * 5 + [True], [True, False, True, False, True, True]]
SECONDS = 2.5  # a shelf scene has squeezed and moved by then


def check(rec: Recording, least: float = 1.0) -> None:
    """Compare a run's two forces with P f by numpy, and ask of them what they promise, to rounding.

    Args:
        rec: a run.
        least: blend from which on no rotation is in the band.
    """
    f, internal = rec.finger_force, rec.internal_force
    size = np.abs(f).max(initial=1e-9)
    # both are rounded: half a unit in the last place each
    assert (
        np.abs(internal + rec.external_force - f).max() <= np.finfo(float).eps * size
    )  # two roundings of half a unit each
    for name in rec.objects:
        fingers, force, moment, blend = external(rec, name)
        assert np.abs(force - rec.external_force[:, fingers]).max() < 1e-13 * size
        whole = blend >= least
        rest, wrench = internal[whole][:, fingers], 0.0
        soft = rec.finger_moment is not None and any(rec.header.split[name]["patches"])
        normal = rec.array("contact_normal")[:, fingers] if soft else None
        if normal is not None:
            turning = require(rec.external_moment)[:, fingers]
            assert np.abs(moment - turning).max() < 1e-13 * size
            held = np.einsum("nfi,nfi->nf", require(rec.internal_moment)[whole][:, fingers], normal[whole])
            about = np.stack([normal[whole] @ axis for axis in np.eye(3)], axis=-1)
            wrench = np.einsum("nf,nfk->nk", held, about[..., np.array(rec.header.split[name]["rotations"])])
        place = "centre" if rec.layout.objects.index(name) in rec.layout.predicted else "position"
        contact = rec.contact_position[:, fingers] - rec.array(f"objects/{name}/{place}")[:, None]
        shifts, turns = (each[whole][:, :, : f.shape[2]] for each in motions(rec.header.split[name], contact, None))
        assert np.abs(np.einsum("nfi,nfik->nk", rest, shifts)).max(initial=0.0) < 1e-14 * size * len(fingers)
        assert np.abs(np.einsum("nfi,nfik->nk", rest, turns) + wrench).max(initial=0.0) < 1e-14 * size
        if not soft:  # torsion has a part in it there, of which a recording tells no displacement
            power = (rest * rec.external_displacement[whole][:, fingers]).sum(axis=(1, 2))
            assert np.abs(power).max(initial=0.0) < 1e-14 * size * np.abs(rec.external_displacement).max(initial=0.0)
    energy = rec.internal_energy + rec.external_energy
    assert np.abs(energy - rec.device_energy).max() < 1e-13 * max(np.abs(rec.device_energy).max(), 1e-6)
    e = rec.finger_position - rec.contact_position
    assert np.abs(rec.internal_displacement + rec.external_displacement - e).max() < 1e-15


@pytest.mark.parametrize("name", SHELF)
def test_the_two_forces_of_every_scene(name: str) -> None:
    """The thin plate's contacts are in the band of the blend in every sample: there P is blended by the test's own."""
    scene = gx.load(name)
    rec = gx.run(scene, duration=min(scene.duration, SECONDS))
    check(rec)
    assert (rec.summary()["internal_moment"] is None) is not any(
        any(rule["rotations"]) and rule["reaction"] == "fingertip" for rule in rec.header.split.values()
    )


@pytest.mark.parametrize("seed", range(12))
def test_the_two_forces_of_random_grasps(seed: int) -> None:
    """Attached and not, in the band and not, by every integrator, with locked freedoms, mixed ones among them."""
    table = random_table(np.random.default_rng(seed + 500))
    d = table["dimensions"]
    table["object"]["free"] = FREE[d][seed % len(FREE[d])]
    table["object"].pop("velocity")
    table["object"].pop("angular_velocity", None)
    table["coupling"]["blend"] = [[0.00025, 0.001], [0.01, 0.1], "off"][seed % 3]
    check(gx.run(gx.Scene(**table, engine="interpreted")))


def test_a_rail_under_the_implicit_integrator_records_the_centre_that_its_split_is_about() -> None:
    """An object that slides along x and turns: the split is about where it will be, which is not where it is."""
    table = next(each for each in map(random_table, map(np.random.default_rng, range(99))) if len(each["finger"]) == 3)
    table |= {"dimensions": 2, "duration": 0.03}
    table["object"] = {
        "integrator": "implicit", "free": [True, False, True], "velocity": [0.3, 0.0], "mass": 0.1, "viscosity": 0.5,
        "rotational_viscosity": 1e-4, "shape": {"kind": "sphere", "radius": 0.025},
    }  # fmt: skip
    for i, finger in enumerate(table["finger"]):
        ray = np.array([np.cos(2.0 * i + 1.0), np.sin(2.0 * i + 1.0)])
        finger["start"], finger["hand"]["rest"] = (0.024 * ray).tolist(), (0.01 * ray).tolist()
    rec = gx.run(gx.Scene(**table, engine="interpreted"))
    assert rec.layout.predicted == (0,)
    centre, position = rec.array("objects/object/centre"), rec.object_position
    assert np.abs(centre - position)[:, 0].max() > 1e-5
    assert np.array_equal(centre[:, 1], position[:, 1])
    check(rec)
    whole = rec.external_force
    moved = replace(rec.layout, predicted=())
    columns = [name for name in rec.layout.columns if not name.endswith("/centre")]
    rows = np.concatenate([rec.rows[:, rec.layout.columns[name].where] for name in columns], axis=1)
    other = Recording(rows, moved, rec.header)
    assert np.abs(other.external_force - whole).max() > 1e-6 * np.abs(rec.finger_force).max()


def test_soft_fingers_with_the_reaction_at_the_contact_twist_about_their_normals() -> None:
    rec = gx.run("soft-pinch", {"coupling.reaction": "contact", "duration": 0.4})
    assert not rec.layout.torsion_axes
    assert np.abs(rec.finger_moment).max() > 1e-4  # type: ignore[arg-type]
    check(rec)
    assert rec.summary()["internal_moment"] is None


def test_the_summary_tells_the_two_forces() -> None:
    """Two fingers on a line: 0.5 N and 0.7 N, of which 0.6 N squeeze and 0.1 N push; the second one lets go."""
    made = layout(1, 2)
    touching = np.array([[1.0, 1.0], [1.0, 1.0], [1.0, 0.0]])
    force = np.array([[0.5, -0.7], [0.5, -0.7], [0.2, 0.0]])
    rule = {
        "dimensions": 1, "translations": [True, False, False], "rotations": [False] * 3, "blend": None, "fade": None,
        "shares": [1.0, 1.0], "patches": [0.0, 0.0], "reaction": "fingertip",
    }  # fmt: skip
    rec = recording({"finger_force": force, "touching": touching}, made, split={"object0": rule})
    summary = rec.summary()
    assert summary["internal_force_peak"] == pytest.approx([0.6, 0.6])
    assert summary["external_force_peak"] == pytest.approx([0.1, 0.1])
    assert summary["internal_force_mean"] == pytest.approx((4 * 0.6 + 0.1) / 5)
    assert summary["external_force_mean"] == pytest.approx((4 * 0.1 + 0.1) / 5)
    assert summary["internal_moment"] is None
    assert np.abs(rec.external_force[2, :, 0] - 0.1).max() < 1e-16  # a free finger that follows: equal and opposite
    assert np.abs(rec.internal_force[2, :, 0] - [0.1, -0.1]).max() < 1e-16
    assert "internal_force_vibration" in summary
    assert recording({"finger_force": force}, made).summary()["internal_force_peak"] is None


def test_internal_forces_turn_the_object_by_what_their_fingertips_are_off() -> None:
    """Forces of 1 N along the line of two contacts 40 mm apart, tips 2 mm aside: 4 mN m over sqrt(2) N times 20 mm."""
    made = layout(2, 2)
    rule = {
        "dimensions": 2, "translations": [True, True, False], "rotations": [False, False, True], "blend": None,
        "fade": None, "shares": [1.0, 1.0], "patches": [0.0, 0.0], "reaction": "fingertip",
    }  # fmt: skip
    contact = np.array([[[-0.02, 0.0], [0.02, 0.0]]])
    columns = {
        "finger_force": np.array([[[1.0, 0.0], [-1.0, 0.0]]]),
        "contact_position": contact,
        "finger_position": contact + np.array([[[0.0, 0.002], [0.0, -0.002]]]),
    }
    rec = recording(columns, made, split={"object0": rule})
    assert rec.summary()["internal_moment"] == pytest.approx(0.004 / (np.sqrt(2.0) * 0.02))
    at_contact = recording(columns, made, split={"object0": rule | {"reaction": "contact"}})
    assert at_contact.summary()["internal_moment"] is None


def test_a_file_has_the_two_forces_for_other_programs_to_the_same_bits(tmp_path: Path) -> None:
    rec = gx.run("soft-pinch", {"duration": 2.6, "engine": "interpreted"}, out=tmp_path)
    names = ("internal_force", "external_force", "internal_moment", "external_moment")
    with h5py.File(tmp_path / "recording.h5") as file:
        for name in names:
            assert file[name][:].tobytes() == rec.array(name).tobytes() == getattr(rec, name).tobytes()
            assert file[name].attrs["units"] == ("N" if name.endswith("force") else "N m")
            assert "of the finger's" in file[name].attrs["long_name"]
            assert [scale[0].name for scale in file[name].dims][:2] == ["/time", "/finger"]
            assert (file[name].fletcher32, file[name].chunks[0]) == (True, len(rec))
    rec.save(tmp_path / "again.h5")
    again = Recording.load(tmp_path / "again.h5")
    assert again.header.split == rec.header.split
    for name in (*names, "internal_energy", "external_displacement"):
        assert getattr(again, name).tobytes() == getattr(rec, name).tobytes()


def test_the_part_of_a_run_that_was_killed_divides_too(tmp_path: Path) -> None:
    rec = gx.run("paper-waving", {"duration": 1.0, "engine": "interpreted"})
    sink = FileSink(tmp_path / "r.h5", rec.layout, rec.header)
    sink.write(rec.rows[:80], ())
    abandon(sink)
    part = Recording.load(tmp_path / "r.h5")
    assert len(part) == 80
    assert part.internal_force.tobytes() == rec.internal_force[:80].tobytes()


def test_a_recording_without_a_split_says_so() -> None:
    rec = recording({"finger_force": np.ones((3, 2, 1))}, layout(1, 2))
    for name in ("internal_force", "external_moment", "internal_displacement", "external_energy"):
        with pytest.raises(gx.errors.RecordingError, match=r"how its forces divide .*: run its scene again"):
            getattr(rec, name)


@pytest.mark.parametrize(
    ("split", "why"),
    [
        (
            {"object": {"foo": 1}},
            r"the forces of 'object' divide cannot be read.*unknown entries \['foo'\], missing entries",
        ),
        ({"other": {}}, r"does not say how the forces of 'object' divide; it has the rules of \['other'\] only"),
    ],
)
def test_a_split_that_is_damaged_says_what_is_wrong(split: dict[str, Any], why: str) -> None:
    rec = gx.run("paper-waving", {"duration": 0.02})
    damaged = Recording(rec.rows, rec.layout, replace(rec.header, split=split), rec.outcome)
    with pytest.raises(gx.errors.RecordingError, match=why):
        assert damaged.external_force


def test_no_work_is_booked_after_a_fault() -> None:
    """The work of the last sample before it counts where the books had come first, as in a tick."""
    rec = gx.run("paper-waving", {"duration": 1.0, "engine": "interpreted"})
    rows = rec.rows.copy()
    forces, energy = (rec.layout.columns[name].where for name in ("finger_force", "device_energy"))
    rows[100:, forces] = 0.0
    for booked in (99, 100):
        rows[booked + 1 :, energy] = rows[booked, energy]
        rows[100, energy] = rec.device_energy[booked]
        rows[101:, energy] = rows[100, energy]
        broken = Recording(rows.copy(), rec.layout, rec.header, Outcome((RunFault(100, "unplugged"),)))
        total = broken.internal_energy + broken.external_energy
        assert np.abs(total - broken.device_energy).max() < 1e-15
        assert np.abs(broken.device_energy[-1]).max() > 1e-9


def test_what_is_displayed_is_divided_where_it_is_another_force() -> None:
    """A recording of old, with a limit at the device alone."""
    rec = gx.run("paper-waving", {"duration": 1.0, "engine": "interpreted"})
    made = replace(rec.layout, limits=True)
    columns = {name: rec.array(name) for name in rec.layout.columns}
    columns["displayed_force"] = -0.5 * rec.finger_force
    rows = np.zeros((len(rec), made.width))
    for name, column in columns.items():
        rows[:, made.columns[name].where] = column.reshape(len(rec), -1)
    half = Recording(rows, made, rec.header)
    assert np.abs(half.internal_energy - 0.5 * rec.internal_energy).max() < 1e-15
    assert np.abs(half.external_energy - 0.5 * rec.external_energy).max() < 1e-15


def test_a_steered_run_divides_by_the_rule_of_each_tick(tmp_path: Path) -> None:
    """The automatic fade follows a gain: from that tick on free fingers weigh otherwise."""
    with gx.open("unequal-devices", live=["coupling.external.stiffness"], out=tmp_path) as session:
        assert not session.external_force.any()
        session.step(300)
        session.set("coupling.external.stiffness", 20.0)
        session.step(300)
        now = session.internal_force, session.external_force
    rec = session.recording
    assert np.array_equal(now[0], rec.internal_force[-1])
    assert np.array_equal(now[1], rec.external_force[-1])
    assert np.abs(now[1]).max() > 1e-4
    assert [change.key for change in rec.changes] == ["coupling.external.stiffness"]
    splits = splits_of(rec.header, rec.outcome.changes)
    assert [tick for tick, _ in splits] == [0, 300]
    assert splits[0][1]["puck"]["fade"] != splits[1][1]["puck"]["fade"]
    loaded = Recording.load(tmp_path)
    assert splits_of(loaded.header, loaded.outcome.changes) == splits
    assert loaded.internal_force.tobytes() == rec.internal_force.tobytes()
    with h5py.File(tmp_path / "recording.h5") as file:
        assert file["internal_force"][:].tobytes() == rec.internal_force.tobytes()


def test_rows_from_the_middle_of_a_run_divide_by_their_own_rule() -> None:
    rec = gx.run("sphere-three-fingers", {"duration": 0.4, "engine": "interpreted"})
    name, rule = next(iter(rec.header.split.items()))
    other = {name: {**rule, "shares": [1.0, 2.0, 3.0]}}
    changes = (KeyChange(30, SPLIT, other), KeyChange(60, SPLIT, dict(rec.header.split)))
    whole = Recording(rec.rows.copy(), rec.layout, rec.header, Outcome(changes=changes))
    splits: Any = splits_of(whole.header, changes)
    for first, last in ((0, 30), (20, 70), (45, 50), (61, 90)):
        piece, _ = RowSplit(rec.rows[first:last], rec.layout, splits, first).external_forces()
        assert np.moveaxis(piece, -1, 0).tobytes() == whole.external_force[first:last].tobytes()
    assert np.array_equal(whole.external_force[:30], rec.external_force[:30])
    assert not np.array_equal(whole.external_force[30:60], rec.external_force[30:60])
    assert np.array_equal(whole.external_force[60:], rec.external_force[60:])
