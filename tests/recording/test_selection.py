"""Columns and ticks that a scene asks for: the same bits as those of the whole run, and clear words for the rest."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import graspfx as gx
from graspfx.__main__ import main
from graspfx.errors import RecordingError, SceneError, UnknownNameError
from graspfx.loop.columns import Selection, chosen_layout
from graspfx.recording.record import Recording
from tests.support.recordings import layout, rows

SECONDS = 0.6  # 120 ticks


def run(overrides: dict[str, object], engine: str = "interpreted", out: Path | None = None) -> Recording:
    return gx.run("paper-waving", {"engine": engine, **overrides}, duration=SECONDS, out=out)


@pytest.mark.parametrize("engine", ["interpreted", "compiled"])
@pytest.mark.parametrize("every", [2, 7, 119, 500])
def test_every_nth_tick_has_the_bits_of_the_whole_run(every: int, engine: str, tmp_path: Path) -> None:
    if engine == "compiled":
        pytest.importorskip("llvmlite")
    whole, some = run({}), run({"record.every": every}, engine, tmp_path)
    assert some.rows.tobytes() == whole.rows[::every].tobytes()
    assert np.array_equal(some.time, whole.time[::every])
    assert (some.ticks, some.end, some.row_period) == (120, SECONDS, every * 0.005)
    assert some.internal_force.tobytes() == whole.internal_force[::every].tobytes()
    summary = some.summary()
    assert (summary["ticks"], summary["duration"]) == (120, SECONDS)
    assert f"one per {every} ticks" in summary["recorded"]
    assert whole.summary()["recorded"] is None


def test_columns_have_the_bits_of_the_whole_run_and_others_are_said_to_be_missing(tmp_path: Path) -> None:
    whole = run({})
    some = run({"record": ["finger_force", "objects/object"]}, out=tmp_path)
    assert [*some.layout.columns] == [
        "finger_force", *(name for name in whole.layout.columns if name.startswith("objects/object/")),
    ]  # fmt: skip
    for name in some.layout.columns:
        assert some.array(name).tobytes() == whole.array(name).tobytes()
    for name in ("finger_position", "gap", "touching"):
        with pytest.raises(RecordingError, match=rf"{name}: not in this recording, because record\.columns lists"):
            getattr(some, name)
    with pytest.raises(RecordingError, match=r"contact_position, gap: not in this recording"):
        _ = some.internal_force
    with pytest.raises(UnknownNameError, match="did you mean 'finger_force'"):
        some.array("finger_forse")
    summary = some.summary()
    assert summary["peak_force"] == whole.summary()["peak_force"]
    assert summary["touching"] is None and summary["internal_force_peak"] is None
    assert "finger_position" in summary["recorded"]


def test_a_variable_that_follows_from_columns_brings_them(tmp_path: Path) -> None:
    whole, some = run({}), run({"record.columns": ["internal_force"], "record.every": 3}, out=tmp_path)
    assert some.internal_force.tobytes() == whole.internal_force[::3].tobytes()
    assert "finger_velocity" in some.layout.omitted


def test_both_spellings_and_overrides(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = gx.load("paper-waving").source.text
    for spelling, sets in (
        ('record = ["finger_force", "touching"]', []),
        ('record = { columns = ["finger_force", "touching"] }', []),
        ("", ["--set", 'record=["finger_force", "touching"]']),
    ):
        (tmp_path / "mine.toml").write_text(f"{spelling}\n{text}")
        arguments = [*sets, "--set", "record.every=10", "--set", "record.compression=gzip"]
        out = str(tmp_path / "out")
        assert main(["run", str(tmp_path / "mine.toml"), *arguments, "--no-figure", "--out", out, "--overwrite"]) == 0
        assert "one per 10 ticks" in capsys.readouterr().out
        rec = gx.Recording.load(out)
        assert ([*rec.layout.columns], rec.header.every) == (["finger_force", "touching"], 10)


def test_a_name_that_is_none_is_a_fault_of_the_scene() -> None:
    with pytest.raises(SceneError, match=r"record\.columns\.0: .* 'finger_forze'; did you mean 'finger_force'\?"):
        gx.load("paper-waving", {"record": ["finger_forze"]})
    with pytest.raises(SceneError, match=r"record\.every"):
        gx.load("paper-waving", {"record.every": 0})
    with pytest.raises(UnknownNameError, match="unknown column 'gap'"):  # which attached contacts do not have
        gx.run("reference-1dof", {"record": ["gap"]}, duration=0.01)


def test_a_session_records_what_is_asked_for_and_shows_every_tick(tmp_path: Path) -> None:
    whole = run({})
    sets = {"engine": "interpreted", "record.every": 4, "record.columns": ["finger_force", "touching"]}
    with gx.open("paper-waving", sets, out=tmp_path) as session:
        for steps in (1, 6, 33):
            session.step(steps)
            assert session.position.tobytes() == whole.finger_position[session.tick - 1].tobytes()
        assert session.recording.finger_force.tobytes() == whole.finger_force[:40:4].tobytes()
        session.step(80)
    assert session.recording.finger_force.tobytes() == whole.finger_force[::4].tobytes()
    assert session.recording.ticks == 120


def test_energies_over_fewer_rows_are_refused_where_they_would_be_wrong() -> None:
    some = run({"record.every": 2})
    with pytest.raises(RecordingError, match=r"one row per 2 ticks: set record\.every = 1, or use device_energy"):
        _ = some.internal_energy


def test_cutting_keeps_the_ticks_that_are_multiples() -> None:
    made = layout()
    narrow = chosen_layout(made, ["touching", "objects"])
    values = rows(made, 50)
    selection = Selection(made, narrow, 7)
    cut = np.concatenate([selection.cut(values[a:b], a) for a, b in ((0, 3), (3, 21), (21, 50))])
    assert cut.shape == (8, narrow.width)
    assert np.array_equal(cut, values[::7][:, selection.numbers])


@pytest.mark.parametrize(
    ("columns", "panels"),
    [
        (["finger_force"], 1),
        (["finger_position"], 1),
        (["device_energy"], 1),
        (["internal_force", "touching", "finger_position"], 3),
    ],
)
def test_a_figure_leaves_out_what_is_not_recorded_and_says_so(columns: list[str], panels: int) -> None:
    pytest.importorskip("matplotlib")
    from graspfx.show.run_figures import LEFT_OUT, sheet

    rec = gx.run("paper-waving", {"record": columns}, duration=0.5)
    drawing = sheet([rec])
    assert len(drawing.panels) == panels
    words = [text.get_text() for text in drawing.arrange().findobj() if hasattr(text, "get_text")]
    assert any(LEFT_OUT in word for word in words)
    assert ("not recorded" in words) is (columns == ["device_energy"])
    whole = sheet([gx.run("paper-waving", duration=0.5)]).arrange()
    assert not any(LEFT_OUT in text.get_text() for text in whole.findobj() if hasattr(text, "get_text"))
