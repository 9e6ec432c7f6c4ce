"""Answers of `gx.check` and `graspfx check`: a verdict first, then limits, notes and the plan."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

import graspfx as gx
from graspfx.__main__ import main
from graspfx.analysis.passivity.grasp_leak import CouplingLimits
from graspfx.certificate.certificate import Certificate, Limit, limit_lines, lines
from graspfx.certificate.certify import certificates

BEYOND = "coupling.external.stiffness=60"
KEP_LIMIT = 51.8497  # [N/m] of paper-spring


def said(capsys: pytest.CaptureFixture[str], *arguments: str, code: int = 0) -> list[str]:
    assert main(["check", *arguments]) == code
    return capsys.readouterr().out.splitlines()


def test_the_verdict_stands_first_then_limits_notes_and_the_plan(capsys: pytest.CaptureFixture[str]) -> None:
    wild = "coupling.internal.stiffness=9000.0"
    first, *rest = said(capsys, "paper-spring", "--set", wild)
    assert first.startswith("NOT STABLE: object, spectral radius ")
    assert "internal 9000 N/m: limit 80.13, margin 0.01" in first
    kinds = [line.split()[0].rstrip(":") for line in rest if not line.startswith("  ")]
    assert list(dict.fromkeys(kinds)) == ["stability", "note", "a"]
    assert kinds[:2] == ["stability", "note"]
    rows = [
        line for line in said(capsys, "paper-spring", "--set", wild, "-v") if line.split()[0] in ("runs", "skipped")
    ]
    runs = sum(row.startswith("runs") for row in rows)
    assert rest[-1] == f"a tick runs {runs} steps and skips {len(rows) - runs}: -v lists them, with the reasons"
    assert len(rows) == len(gx.check("paper-spring").plan) > 20


def test_check_prints_what_is_judged_and_the_plan_where_it_is_asked_for(capsys: pytest.CaptureFixture[str]) -> None:
    short, long = said(capsys, "mug"), said(capsys, "mug", "-v")
    assert len(short) < 20 and long[: len(short) - 1] == short[:-1]
    assert said(capsys, "mug", "-q") == short[:-1]
    assert list(gx.check("mug").lines(plan=False)) == short[:-1]
    assert json.loads("\n".join(said(capsys, "mug", "--json")))["plan"]


def test_brief_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    stable = said(capsys, "reference-1dof", "--brief")
    beyond = said(capsys, "paper-spring", "--brief", "--set", BEYOND)
    assert len(stable) == len(beyond) == 1
    assert stable[0].startswith("stable: object, spectral radius 0.9") and "internal 70 N/m: limit 80.13" in stable[0]
    assert beyond[0].startswith("NOT STABLE: object") and "external 60 N/m: limit 51.85, margin 0.86" in beyond[0]


@pytest.mark.parametrize(
    ("arguments", "code", "begins"),
    [
        (["reference-1dof"], 0, "stable"),
        (["paper-spring", "--set", BEYOND], 1, "NOT STABLE"),
        (["quiet.toml"], 1, "not judged: the device of finger0: given None, expected a device that reports its mass"),
    ],
)
def test_strict_ends_with_1_unless_the_scene_is_stable(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    code: int,
    begins: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    quiet(tmp_path)
    assert said(capsys, *arguments, "--brief", "--strict", code=code)[0].startswith(begins)
    assert said(capsys, *arguments, "--brief")[0].startswith(begins)


def test_a_scene_with_a_fault_is_refused_as_before(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for options in ([], ["--strict"], ["--json"], ["--brief"]):
        assert main(["check", "reference-1dof", "--set", "object.mass=-1", *options]) == 2
        printed = capsys.readouterr()
        assert (printed.out == "" and "object.0.mass" in printed.err) or "object.mass" in printed.err


def test_json_is_the_reports_data(capsys: pytest.CaptureFixture[str]) -> None:
    data = json.loads("\n".join(said(capsys, "paper-spring", "--json", "--set", BEYOND)))
    # what a program would take is an estimate of this process: the rest is the same
    other = gx.check("paper-spring", {"coupling.external.stiffness": 60}).to_dict()
    same = [key for key in data if key != "plan"]
    assert {key: data[key] for key in same} == {key: other[key] for key in same}
    assert [row["step"] for row in data["plan"]] == [row["step"] for row in other["plan"]]
    assert list(data) == [
        "scene",
        "ok",
        "verdict",
        "faults",
        "certificates",
        "doubts",
        "notes",
        "plan",
        "presets",
        "preset",
    ]
    assert data["ok"] is False and data["faults"] == []
    (certificate,) = data["certificates"]
    external = next(row for row in certificate["limits"] if row["mode"] == "external")
    assert external["gain_N_per_m"] == 60.0 and external["limit_N_per_m"] == pytest.approx(KEP_LIMIT, rel=1e-5)
    assert certificate["stable"] is False and certificate["spectral_radius"] > 1.0
    assert {"step", "runs", "why"} == data["plan"][0].keys()


def test_no_limit_is_null() -> None:
    data = gx.Report("made", certificates=(certificate("cube", 0.9, row("external", 30.0, math.inf)),)).to_dict()
    external = data["certificates"][0]["limits"][0]
    assert external["limit_N_per_m"] is None and external["margin"] is None
    json.dumps(data, allow_nan=False)


def test_a_name_a_path_and_a_scene_give_the_same_report(tmp_path: Path) -> None:
    scene = gx.load("paper-spring", {"coupling.external.stiffness": 60.0})
    copy = tmp_path / "spring.toml"
    copy.write_text(scene.source.text.replace("stiffness = 50.0", "stiffness = 60.0"))
    one, other = gx.check(scene), gx.check(copy)
    assert one.verdict == other.verdict == gx.check("paper-spring", {"coupling.external.stiffness": 60.0}).verdict
    assert not one.ok and "NOT STABLE" in one.verdict
    assert one.verdict in repr(one) and "runs" in repr(one)


def test_faults_are_a_report_too(tmp_path: Path) -> None:
    broken = tmp_path / "broken.toml"
    broken.write_text("dimensions = 1\nperiod = -1\n")
    report = gx.check(broken)
    assert not report.ok and report.verdict.startswith("not judged: ") and len(report.faults) > 1
    assert not report.certificates and not report.plan
    assert any("period" in text for text in report.to_dict()["faults"])


def test_a_device_that_does_not_tell_its_mass_leaves_it_not_judged(tmp_path: Path) -> None:
    report = gx.check(quiet(tmp_path))
    assert not report.ok and report.verdict.startswith("not judged: the device of finger0")
    assert report.plan and not report.certificates


def test_the_worst_object_comes_first(monkeypatch: pytest.MonkeyPatch) -> None:
    roomy = certificate("block", 0.9, row("external", 30.0, 90.0))
    close = certificate("base", 0.99, row("external", 30.0, 33.0))
    lost = certificate("lid", 1.01, row("external", 30.0, 20.0), row("internal", 10.0, 90.0))
    found = [roomy, close, lost]
    monkeypatch.setattr("graspfx.certificate.certify.certificates", lambda scene: found)
    report = gx.check("two-objects")
    assert [each.object for each in report.certificates] == ["lid", "base", "block"]
    assert report.verdict.startswith(
        "NOT STABLE: lid, spectral radius 1.010000; external 30 N/m: limit 20, margin 0.67"
    )
    found.remove(lost)
    verdict = gx.check("two-objects").verdict
    assert verdict.startswith("stable: base, ") and verdict.endswith("; the other objects have larger margins")


def test_a_radius_below_one_is_that_in_the_air_where_the_support_decides() -> None:
    found = certificate("block", 0.86, row("standing on table", 600.0, 359.0))
    assert found.verdict == "NOT STABLE, spectral radius 0.860000 in the air"
    assert certificate("block", 0.86, row("standing on table", 600.0, 900.0)).verdict.endswith("0.860000")


def test_a_limit_of_zero_is_explained() -> None:
    """No value of either gain is stable: the others have to change too."""
    text = "\n".join(lines(certificate("block", 1.66, row("internal", 600.0, 0.0), row("external", 250.0, 0.0))))
    assert text.count("limit 0: with the other gains as they are, no value of this gain is stable") == 1
    assert "limit 0:" not in "\n".join(lines(certificate("block", 0.9, row("internal", 600.0, 700.0))))


def test_twenty_alike_rows_become_one_with_a_range() -> None:
    (at_start,) = certificates(gx.load("twenty-fingers"), at="start")
    (pushing,) = (line for line in lines(at_start) if "pushing with" in line)
    alone = [row for row in at_start.limits if row.mode.startswith("pushing with")]
    least = min(alone, key=lambda row: row.margin)
    assert len(alone) == 20 and len({f"{row.limit:.4g}" for row in alone}) > 3
    assert pushing.startswith("  pushing with one of 20 fingers 381 N/m: limit ")
    assert f"{min(row.limit for row in alone):.4g} ... {max(row.limit for row in alone):.4g}" in pushing
    assert pushing.endswith(f"smallest with {least.mode.removeprefix('pushing with ')}")


def test_a_few_rows_stay_as_they_are_and_equal_ones_share_a_line() -> None:
    rows = [row("internal", 70.0, 80.0), row("external", 30.0, 60.0)]
    rows += [row(f"pushing with finger{i}", 40.0, 50.0 + (i > 1)) for i in range(3)]
    assert list(limit_lines(rows)) == [
        "internal 70 N/m: limit 80, margin 1.14, lost at 5 Hz",
        "external 30 N/m: limit 60, margin 2.00, lost at 5 Hz",
        "pushing with finger0 | finger1 40 N/m: limit 50, margin 1.25, lost at 5 Hz",
        "pushing with finger2 40 N/m: limit 51, margin 1.27, lost at 5 Hz",
    ]
    many = [row(f"pushing with f{i}", 40.0, float("inf") if i == 9 else 50.0 + i) for i in range(10)]
    (line,) = limit_lines(many)
    assert line == (
        "pushing with one of 10 fingers 40 N/m: limit 50 ... 58 ... no limit, margin 1.25 ... 1.45 ... no limit, "
        "lost at 5 Hz, smallest with f0"
    )


def test_pushing_that_is_lost_is_said_of_a_grasp_that_is_stable() -> None:
    limits = (row("external", 30.0, 60.0), row("pushing with thumb", 40.0, 36.0))
    report = gx.Report("made", certificates=(certificate("cube", 0.99, *limits),))
    assert report.ok and report.verdict.startswith("stable: cube")
    assert "pushing with thumb is not stable, 40 N/m: limit 36, margin 0.90" in report.verdict


@pytest.mark.parametrize("name", ["paper-waving", "paper-spring-arms", "prism", "unequal-devices"])
def test_scenes_of_the_shelf_are_stable(name: str) -> None:
    report = gx.check(name)
    assert report.ok, report.verdict
    json.dumps(report.to_dict(), allow_nan=False)


def certificate(name: str, radius: float, *limits: Limit) -> Certificate:
    passive = CouplingLimits(1.0, 1.0, np.ones(1))
    return Certificate(name, "squeezed", radius, limits, (), passive)


def row(mode: str, gain: float, limit: float) -> Limit:
    return Limit(mode, gain, limit, limit / gain, 5.0, False)


def quiet(folder: Path) -> Path:
    """A scene of devices that do not tell their mass."""
    driver = """
import numpy as np
from graspfx.loop.device import Features
class Still:
    features = Features(fingers=1, dimensions=1)
    def __init__(self): self.x = np.zeros((1, 1))
    def open(self, period): pass
    def read(self): return self.x, self.x, 0.0
    def write(self, forces): pass
    def stop(self): pass
    def close(self): pass
    def __enter__(self): return self
    def __exit__(self, *exc): pass
def connect(): return Still()
"""
    (folder / "still.py").write_text(driver)
    lines = (gx.load("reference-1dof").source.text).splitlines()
    kept = (line for line in lines if not line.startswith("hand"))
    text = ['device = { name = "still.py" }' if line.startswith("device") else line for line in kept]
    path = folder / "quiet.toml"
    path.write_text("\n".join(text))
    return path


def torus(count: int = 60, around: int = 44) -> dict[str, object]:
    """A ring of 100 mm and 20 mm as a mesh."""
    a, b = np.meshgrid(np.arange(count) * 2 * np.pi / count, np.arange(around) * 2 * np.pi / around, indexing="ij")
    out = 0.05 + 0.01 * np.cos(b)
    vertices = np.stack([out * np.cos(a), out * np.sin(a), 0.01 * np.sin(b)], axis=-1).reshape(-1, 3)
    i, j = (each.ravel() for each in np.meshgrid(np.arange(count), np.arange(around), indexing="ij"))
    p, q = i * around + j, (i + 1) % count * around + j
    r, s = (i + 1) % count * around + (j + 1) % around, i * around + (j + 1) % around
    faces = np.concatenate([np.stack([p, q, r], axis=1), np.stack([p, r, s], axis=1)])
    return {"kind": "mesh", "vertices": vertices.tolist(), "faces": faces.tolist()}


def test_a_fault_of_building_is_a_fault_of_the_check(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A ring over a floor, of more triangles than MuJoCo is given: a run is refused, and so is the check."""
    pytest.importorskip("mujoco")
    table = gx.load("two-objects", {"object.*.dynamics": "mujoco"}).to_dict()
    table["obstacle"] = [*table["obstacle"], {"name": "ring", "shape": torus(), "position": [0.0, 0.4, 0.02]}]
    scene = gx.Scene(**table)
    with pytest.raises(gx.errors.GraspFXError, match="concave mesh with 5280 triangles"):
        gx.run(scene, duration=0.01)
    report = gx.check(scene)
    assert not report.ok and not report.certificates
    assert report.verdict.startswith("not judged: 1 fault") and "concave mesh with 5280 triangles" in report.verdict
    (tmp_path / "ring.py").write_text(f"import graspfx as gx\n\n\ndef scene():\n    return gx.Scene(**{table!r})\n")
    assert main(["check", str(tmp_path / "ring.py"), "--brief"]) == 2
    printed = capsys.readouterr()
    assert not printed.out and "concave mesh with 5280 triangles" in printed.err


def test_dynamics_that_raise_when_they_are_made_are_a_fault_of_the_check(tmp_path: Path) -> None:
    (tmp_path / "refusing.py").write_text(
        '"""Dynamics that take no body."""\n\n\ndef create(state):\n    raise ValueError("no body of 0.1 kg")\n'
    )
    text = gx.load("reference-1dof").source.text.replace("[object]", '[object]\ndynamics = "refusing.py"')
    path = tmp_path / "refused.toml"
    path.write_text(text.replace('integrator = "exact"', ""))
    report = gx.check(path)
    assert not report.ok and report.verdict.startswith("not judged: 1 fault") and "no body of 0.1 kg" in report.verdict
