"""The brief figure and table: depth, squeeze and push alone, columns named as their recordings."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.__main__ import main
from graspfx.errors import InputError
from graspfx.recording.record import Recording
from graspfx.show.run_figures import sheet
from graspfx.show.style import EXTERNAL, INTERNAL, arranged
from graspfx.show.summary_table import BRIEF, ROWS
from tests.support.recordings import layout, recording
from tests.support.writing import faults, smallest

DURATION = 2.5


@pytest.fixture(scope="module")
def runs() -> list[Recording]:
    return [
        gx.run(gx.load("paper-waving", {"coupling.internal.stiffness": kip}, preset="light-hand"), duration=DURATION)
        for kip in (30.0, 70.0)
    ]


def curves(axes: Any) -> dict[str, Any]:
    return {line.get_label(): line for line in axes.get_lines() if not line.get_label().startswith("_")}


def test_three_rows_show_depth_squeeze_and_push(runs: list[Recording]) -> None:
    panels = sheet(runs, brief=True).panels
    assert panels.shape == (3, 2)
    assert [axes.get_ylabel() for axes in panels[:, 0]] == ["depth [mm]", "squeeze [N]", "push [N]"]
    for rec, (depth, squeeze, push) in zip(runs, panels.T, strict=True):
        (of_fingers,) = curves(depth).values()
        assert rec.gap is not None
        expected = 1e3 * np.where(rec.touching, -rec.gap, 0.0)
        assert np.allclose(of_fingers.get_ydata(), expected.mean(axis=1), rtol=0, atol=1e-12)
        band = depth.collections[0].get_datalim(depth.transData)
        assert (band.y0, band.y1) == pytest.approx((expected.min(), expected.max()), abs=1e-12)
        (internal,) = curves(squeeze).values()
        both = rec.touching.all(axis=1)
        assert np.allclose(internal.get_ydata()[both], rec.internal_force[both, 0, 0], rtol=0, atol=1e-6)
        assert internal.get_color() == INTERNAL
        x = curves(push)["external force, x"]
        assert np.allclose(x.get_ydata()[both], rec.external_force[both, :, 0].mean(axis=1), rtol=0, atol=1e-12)
        assert x.get_color() == EXTERNAL


def test_columns_are_named_and_the_preset_stands_over_all(runs: list[Recording]) -> None:
    picture = arranged(sheet(runs, brief=True, labels=["soft", "firm"]))
    words = [text.get_text().replace("\N{NO-BREAK SPACE}", " ") for text in picture.texts]
    assert "Waving a cube between two fingers (Figs. 11-13), preset light-hand" in words
    assert "soft: $k_p$ = 30 N/m" in words
    assert "firm: $k_{ep}$ = 30, $k_{ip}$ = 70 N/m" in words
    assert not any("hand.damping" in each for each in words)


@pytest.mark.parametrize("width", ["screen", "page", "column"])
def test_all_that_is_written_is_legible(runs: list[Recording], width: str) -> None:
    picture = arranged(sheet(runs, brief=True, labels=["soft", "firm"], width=width))
    assert faults(picture) == []
    assert smallest(picture) >= 7.0


def test_a_value_of_the_preset_that_was_replaced_is_named() -> None:
    changes = {"finger.*.hand.damping": 0.2}
    rec = gx.run(gx.load("paper-waving", changes, preset="light-hand"), duration=0.1)
    words = [text.get_text() for text in arranged(sheet([rec])).texts]
    assert any("finger.*.hand.damping = 0.2" in each for each in words)


def test_what_a_recording_does_not_say_is_left_out() -> None:
    bare = recording({"objects/object0/position": np.zeros((5, 2))}, layout())
    assert [axes.get_ylabel() for axes in sheet([bare], brief=True).panels[:, 0]] == ["depth [mm]"]
    none = gx.run("reference-1dof", duration=0.1)  # attached: no surface to be in
    assert [axes.get_ylabel() for axes in sheet([none], brief=True).panels[:, 0]] == ["squeeze [N]", "push [N]"]
    fingerless = recording({"objects/object0/position": np.zeros((5, 2))}, layout(n=0))
    with pytest.raises(InputError, match="brief"):
        sheet([fingerless], brief=True)
    with pytest.raises(InputError, match="labels"):
        sheet([bare], labels=["a", "b"])


def test_the_command_draws_and_prints_it(
    runs: list[Recording], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, rec in zip(("soft", "firm"), runs, strict=True):
        (tmp_path / name).mkdir()
        rec.save(tmp_path / name / "recording.h5")
    folders = [str(tmp_path / name) for name in ("soft", "firm")]
    assert main(["plot", *folders, "--brief", "--out", str(tmp_path)]) == 0
    table = capsys.readouterr().out
    rows = [line.split("│")[0].strip() for line in table.splitlines() if "│" in line]
    assert rows == [name for name, *_ in BRIEF]
    assert (tmp_path / "comparison.png").is_file()
    assert main(["plot", *folders, "--out", str(tmp_path), "--overwrite"]) == 0
    assert "ticks per second" in capsys.readouterr().out


def test_the_brief_table_s_numbers_are_rows_of_the_whole_one() -> None:
    whole = {key: (unit, scale) for _, key, unit, scale in ROWS}
    assert [whole[key] for _, key, _, _ in BRIEF] == [(unit, scale) for _, _, unit, scale in BRIEF]
