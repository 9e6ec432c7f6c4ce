"""Bode and Nyquist diagrams, Z-widths and measures over keys: what is drawn are their own numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import graspfx as gx
from graspfx.__main__ import main
from graspfx.show.variant_figures import Surface, variants_sheet


@pytest.fixture(scope="module")
def loci() -> gx.stability.Loci:
    return gx.stability.loci("paper-waving")


def test_a_bode_diagram_has_the_magnitudes_and_phases(loci: gx.stability.Loci) -> None:
    upper, lower = loci.bode().figure.axes
    drawn = [line for line in upper.get_lines() if len(line.get_xdata()) == len(loci.frequency)]
    assert len(drawn) == loci.response.shape[1]
    assert np.array_equal(drawn[0].get_ydata(), loci.magnitude[:, 0])
    assert upper.get_xscale() == upper.get_yscale() == "log"
    assert "frequency [Hz]" in lower.get_xlabel() and "degrees" in lower.get_ylabel()


def test_a_nyquist_diagram_has_the_loci_and_minus_one(loci: gx.stability.Loci) -> None:
    (ax,) = loci.nyquist().figure.axes
    drawn = [line for line in ax.get_lines() if len(line.get_xdata()) == len(loci.frequency)]
    assert len(drawn) == 2 * loci.response.shape[1]
    assert np.array_equal(drawn[1].get_ydata(), loci.response[:, 0].imag)
    assert ax.get_aspect() == 1.0
    assert any(line.get_label() == "-1" and line.get_xdata()[0] == -1.0 for line in ax.get_lines())


@pytest.mark.parametrize("mass", [None, 0.04])
def test_a_z_width_has_its_curves(mass: float | None) -> None:
    region = gx.passivity.z_width(0.8, 0.001, mass=mass)
    (ax,) = region.plot().figure.axes
    assert len(ax.get_lines()) == (1 if mass is None else 2)
    assert np.array_equal(ax.get_lines()[-1].get_xdata(), region.wall_damping)
    assert ax.get_xscale() == ("linear" if mass is None else "log")


def test_the_command_draws_what_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plots = ["--plot", "bode", "--plot", "nyquist", "--plot", "z-width", "--out", str(tmp_path)]
    assert main(["stability", "reference-1dof", *plots]) == 0
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["bode.png", "nyquist.png", "z-width.png"]
    said = capsys.readouterr().out
    assert all(f"wrote {tmp_path / name}" in said for name in names) and "stability of object" in said
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in tmp_path.iterdir())
    assert main(["stability", "reference-1dof", *plots]) == 2
    assert "exists already" in capsys.readouterr().err


@pytest.mark.parametrize(("name", "scale"), [("finger_force.growth", "log"), ("finger_force.peak", "linear")])
def test_growth_over_many_powers_has_a_logarithmic_axis(name: str, scale: str) -> None:
    values = np.array([0.5, 20.0, 1e6])
    sheet = variants_sheet(
        {"object.mass": np.array([0.1, 0.2, 0.3])}, [Surface(name, "", values)], np.zeros(3, bool), "scene"
    )
    ax = sheet.panels[0, 0]
    assert ax.get_yscale() == scale
    if scale == "log":
        assert ax.get_ylim()[0] < values.min() and ax.get_ylim()[1] > values.max()
