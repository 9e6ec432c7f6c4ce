"""A value in another unit than SI's is asked about, with its probable meaning; those of the shelf are not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import graspfx as gx
from graspfx import plugins
from graspfx.__main__ import main
from graspfx.errors import SceneError

REACH = {"kind": "reach", "displacement": [0.0, 0.0, 80.0], "duration": 0.5}
ANGLE = {"kind": "reach", "angle": -90.0, "axis": "y", "duration": 0.5}
BOX = {"kind": "box", "size": [50.0]}


@pytest.mark.parametrize(
    ("name", "changes", "said"),
    [
        ("mug", {"finger.1.radius": 7.0}, "finger.1.radius = 7 m: check the unit (7 mm would be 0.007)"),
        (
            "mug",
            {"finger.1.start": [0.0, 30.0, 40.0]},
            "finger.1.start from its object = 50 m: check the unit (50 mm would be 0.05)",
        ),
        ("paper-spring", {"object.mass": 100.0}, "object.0.mass = 100 kg: check the unit (100 g would be 0.1)"),
        (
            "paper-spring",
            {"coupling.internal.stiffness": 0.6},
            "coupling.internal.stiffness = 0.6 N/m: check the unit (0.6 N/mm would be 600)",
        ),
        (
            "paper-spring",
            {"coupling.external.stiffness": [0.05, 0.05], "coupling.form": "symmetric"},
            "coupling.external.stiffness = 0.05 N/m: check the unit (0.05 N/mm would be 50)",
        ),
        (
            "paper-spring",
            {"finger.1.hand.stiffness": 0.033},
            "finger.1.hand.stiffness = 0.033 N/m: check the unit (0.033 N/mm would be 33)",
        ),
        (
            "paper-spring",
            {"finger.0.device.mass": 150.0},
            "finger.0.device.mass = 150 kg: check the unit (150 g would be 0.15)",
        ),
        ("paper-spring", {"object.shape": BOX}, "object.0.shape = 50 m across: check the unit (50 mm would be 0.05)"),
        (
            "paper-spring",
            {"finger.0.hand.squeeze": 3.0},
            "finger.0.hand.squeeze = 3 m: check the unit (3 mm would be 0.003)",
        ),
        (
            "mug",
            {"hand.squeeze": [{"to": 15, "begin": 0, "duration": 1}]},
            "hand.0.squeeze = 15 m: check the unit (15 mm would be 0.015)",
        ),
        ("mug", {"hand.motion": REACH}, "hand.0.motion.displacement = 80 m: check the unit (80 mm would be 0.08)"),
        ("mug", {"hand.turn": ANGLE}, "hand.0.turn.angle = -90 rad: check the unit (-90 degrees would be -1.571)"),
        (
            "sphere-three-fingers",
            {"object.mass": None, "object.density": 2.7},
            "object.0.density = 2.7 kg/m^3: check the unit (2.7 g/cm^3 would be 2700)",
        ),
        (
            "pick-and-place",
            {"gravity": [0.0, 0.0, -9810.0]},
            "gravity = 9810 m/s^2: check the unit (9810 mm/s^2 would be 9.81)",
        ),
    ],
)
def test_a_wrong_unit_is_asked_about(name: str, changes: dict[str, Any], said: str) -> None:
    """Above the verdict of a scene that can run, and first among the faults of one that cannot."""
    report = gx.check(name, changes)
    doubts = report.doubts or tuple(f"{each.key} = {each.message.removeprefix('given ')}" for each in report.faults)
    assert said in [doubt.removesuffix(" (set by an override)") for doubt in doubts]
    if not report.faults:
        assert list(report.lines())[: len(report.doubts)] == [f"note: {doubt}" for doubt in report.doubts]


@pytest.mark.parametrize(
    ("period", "meant"),
    [(2.0, "2 ms would be 0.002"), (1000.0, "1000 Hz would be 0.001"), (0.5, "0.5 ms would be 0.0005")],
)
def test_a_period_in_milliseconds_is_asked_about_before_what_follows_from_it(period: float, meant: str) -> None:
    faults = gx.check("pick-and-place", {"period": period}).faults
    assert faults[0].key == "period" and f"check the unit ({meant})" in faults[0].message
    assert [fault.key for fault in faults[1:]] == ["world.stiffness"]
    (doubt,) = gx.check("reference-1dof", {"period": period}).doubts
    assert doubt == f"period = {period:g} s: check the unit ({meant})"


def test_doubts_stand_above_the_verdict_also_in_brief_and_in_runs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    changes = ["--set", "coupling.internal.stiffness=0.6", "object.mass=100"]
    expected = [
        "note: object.0.mass = 100 kg: check the unit (100 g would be 0.1)",
        "note: coupling.internal.stiffness = 0.6 N/m: check the unit (0.6 N/mm would be 600)",
    ]
    for options in ([], ["--brief"]):
        assert main(["check", "paper-spring", *options, *changes]) == 0
        lines = capsys.readouterr().out.splitlines()
        assert lines[:2] == expected and lines[2].startswith("stable: ")
    assert (
        main(["run", "paper-spring", "--no-figure", "--duration", "0.02", "--out", str(tmp_path / "o"), *changes]) == 0
    )
    assert capsys.readouterr().err.splitlines()[:2] == expected


def test_a_mesh_in_millimetres_is_asked_about_above_the_verdict(tmp_path: Path) -> None:
    """A tetrahedron of 60 mm, as a file that takes a millimetre for its unit has it."""
    corners = [[0.0, 0.0, 0.0], [60.0, 0.0, 0.0], [0.0, 60.0, 0.0], [0.0, 0.0, 60.0]]
    lines = ["solid a"]
    for face in ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)):
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += [f"vertex {x} {y} {z}" for x, y, z in (corners[k] for k in face)] + ["endloop", "endfacet"]
    (tmp_path / "a.stl").write_text("\n".join([*lines, "endsolid a"]))
    (tmp_path / "scene.toml").write_text(
        """dimensions = 3
period = 0.001
duration = 0.1
[object]
shape = { mesh = "a.stl" }
mass = 0.1
viscosity = 0.1
rotational_viscosity = 1e-3
[coupling]
external = { stiffness = 30.0 }
internal = { stiffness = 70.0 }
[[finger]]
device = { name = "simulated", mass = 0.1, damping = 0.5 }
start = { toward = [0.0, 0.0, -1.0], gap = 0.0 }
"""
    )
    first, *_ = gx.check(tmp_path / "scene.toml").lines()
    assert first.startswith("note: object.0.shape = 60 m across: check the unit (60 mm would be 0.06; scale = 0.001")
    assert gx.check(tmp_path / "scene.toml", {"object.shape.scale": 0.001}).doubts == ()


def test_the_shelf_is_in_si_units() -> None:
    for name, owner in plugins.names("scenes").items():
        if owner.startswith("GraspFX"):
            assert gx.check(name).doubts == (), name


def test_a_start_of_another_length_is_told_and_no_unit_is_asked_about() -> None:
    with pytest.raises(SceneError, match=r"finger.1.start: expected 3 numbers"):
        gx.load("pick-and-place", {"finger.1.start": [0.041, 0.0, 0.035, 0.0], "object.position": [0.0, 0.0, 0.03]})
