"""`graspfx stability` and the certificate of `graspfx check`: the paper's Fig. 15, maps, faults."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import graspfx as gx
from graspfx.__main__ import main
from graspfx.certificate.limit_sweep import Sweep, limits_of_scene, swept_limits
from graspfx.errors import InputError


def three(scene: gx.Scene) -> list[float]:
    found = limits_of_scene(scene)
    return [float(part) for part in (found.internal, found.external, found.conventional)]


def told(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, list[float]]:
    assert main(["stability", *arguments, "--json"]) == 0
    result: dict[str, list[float]] = json.loads(capsys.readouterr().out)
    return result


def test_figure_15(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """kep 51.8 -> 97.0, kip 80, crossing at b_v = 1.24; the conventional method has the smaller: the paper's claims."""
    found = told(capsys, "paper-spring", "--sweep", "object.viscosity=0.8:1.5:15", "--out", str(tmp_path))
    b_v, kep, kip = (np.array(found[key]) for key in ("sweep", "external_limit", "internal_limit"))
    assert b_v == pytest.approx(np.linspace(0.8, 1.5, 15))
    assert (kep[0], kep[-1]) == pytest.approx((51.8, 97.0), abs=0.06)
    assert kip == pytest.approx(80.1, abs=0.05)
    assert found["conventional_limit"] == np.minimum(kep, kip).tolist()
    assert np.interp(0.0, kep - 80.0, b_v) == pytest.approx(1.24, abs=0.005)
    assert (tmp_path / "stability.png").stat().st_size > 10_000


def test_closed_forms_are_scenes_one_by_one() -> None:
    """Two keys over a scene with modes by themselves, each point against the scene made with its values."""
    scene = gx.load("paper-spring")
    sweeps = [Sweep("object.mass", np.array([0.05, 0.3])), Sweep("finger.*.device.mass", np.array([0.05, 0.1, 0.2]))]
    found = swept_limits(scene, sweeps)
    assert found.modal
    assert found.external.shape == (2, 3)
    for i, m_v in enumerate(sweeps[0].values):
        for j, m in enumerate(sweeps[1].values):
            one = three(scene.replace({"object.mass": float(m_v), "finger.*.device.mass": float(m)}))
            here = [part[i, j] for part in (found.internal, found.external, found.conventional)]
            assert here == pytest.approx(one, rel=1e-9)


def test_rotation_by_its_closed_form() -> None:
    """Three fingers at rest in the plane: the moment grows with the mass, rotational viscosity is its own key."""
    from tests.support.small_scenes import attached

    scene = attached(2, "explicit")
    sweeps = [Sweep("object.mass", np.array([0.1, 0.3])), Sweep("object.rotational_viscosity", np.array([2e-4, 8e-4]))]
    found = swept_limits(scene, sweeps)
    for i, m_v in enumerate(sweeps[0].values):
        for j, b_w in enumerate(sweeps[1].values):
            one = three(scene.replace({"object.mass": float(m_v), "object.rotational_viscosity": float(b_w)}))
            here = [part[i, j] for part in (found.internal, found.external, found.conventional)]
            assert here == pytest.approx(one, rel=1e-8)


def test_other_keys_make_a_scene_for_each_point(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One hand softer than the other: no modes by themselves, and the command says how it was done."""
    sweep = "finger.0.hand.stiffness=20:40:3"
    assert main(["stability", "paper-spring", "--sweep", sweep, "--out", str(tmp_path)]) == 0
    text = capsys.readouterr().out
    assert "a scene linearised for each point" in text
    assert "wrote" in text


def test_a_map(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    keys = ["--sweep", "object.viscosity=0.8:1.5:30", "--sweep", "finger.*.device.damping=0.1:0.4:20"]
    found = told(capsys, "paper-spring", *keys, "--out", str(tmp_path))
    assert np.array(found["external_limit"]).shape == (30, 20)
    assert [len(values) for values in found["sweep"]] == [30, 20]  # type: ignore[arg-type]
    assert (tmp_path / "stability.png").stat().st_size > 10_000


def test_no_limit_is_null(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Implicit steps take any kep here."""
    arguments = ["--set", "object.integrator=implicit", "--sweep", "object.viscosity=0.8:1.5:3", "--out", str(tmp_path)]
    assert told(capsys, "paper-spring", *arguments)["external_limit"] == [None] * 3


def test_without_a_sweep(capsys: pytest.CaptureFixture[str]) -> None:
    assert told(capsys, "reference-1dof")["internal_limit"] == pytest.approx(80.1, abs=0.05)
    assert main(["stability", "reference-1dof"]) == 0
    assert "internal 70 N/m: limit 80.13, margin 1.14" in capsys.readouterr().out
    assert main(["check", "reference-1dof"]) == 0
    assert "internal 70 N/m: limit 80.13, margin 1.14" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("sweep", "said"),
    [
        ("object.viscosity", "expected KEY=FROM:TO:COUNT"),
        ("object.viscosity=1:2", "expected KEY=FROM:TO:COUNT"),
        ("object.viscosity=1:2:x", "expected KEY=FROM:TO:COUNT"),
        ("object.viscosity=2:1:5", "an upper end above the lower end"),
        ("object.viscosity=1:inf:5", "finite ends"),
        ("object.viscosity=1:2:0", "finite ends and from 1"),
        ("object.viscosty=1:2:3", "did you mean 'viscosity'?"),
        ("object.viscosity=-1:2:3", "expected no less than 0"),
    ],
)
def test_faults(sweep: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["stability", "paper-spring", "--sweep", sweep]) == 2
    assert said in capsys.readouterr().err


def test_gains_that_are_matrices_have_no_single_limit() -> None:
    scene = gx.load("paper-spring", {"coupling.external.stiffness": [50.0, 60.0]})
    with pytest.raises(InputError, match=r"coupling\.external\.stiffness"):
        swept_limits(scene, [Sweep("object.viscosity", np.array([1.0]))])
    with pytest.raises(InputError, match="two different keys"):
        swept_limits(scene, [Sweep("period", np.array([1.0])), Sweep("period", np.array([1.0]))])
