"""The page of a recording as a file: what it holds, how large it is, and that no text of others leaves its place."""

from __future__ import annotations

import base64
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import graspfx as gx
from graspfx.errors import InputError, RecordingError
from graspfx.live.frame import Frames
from graspfx.live.page.document import in_script, page_text, write_page
from graspfx.live.page.played_frames import motion_of
from graspfx.live.page.story import RESOLUTION, packed, story_of, value_at, values_of
from graspfx.recording.header import KeyChange, Outcome
from graspfx.recording.record import Recording
from tests.support.played import SECONDS, played
from tests.support.recordings import waving

Array = NDArray[Any]


def unpacked(data: dict[str, str], *shape: int) -> Array:
    return np.frombuffer(base64.b64decode(data["data"]), f"<{data['kind']}").reshape(shape or -1)


def story_in(text: str) -> dict[str, Any]:
    found = re.search(r'<script type="application/json" id="story">(.*?)</script>', text, re.DOTALL)
    assert found is not None
    data: dict[str, Any] = json.loads(found[1])
    return data


@pytest.mark.parametrize("name", SECONDS)
def test_a_page_holds_the_numbers_of_the_recording(name: str) -> None:
    run = played(name)
    story = story_in(page_text(run))
    rows, n = round(story["step"] / run.row_period), len(run.layout.fingers)
    assert 50.0 <= 1.0 / story["step"] <= 60.0
    assert story["frames"] == -(-len(run) // rows)
    apart = 0.5 * (n - 1) * story["attached"] * (run.layout.dimensions == 1)
    frames = Frames(run)
    for key, whole in (("fingertips", frames.fingertips), ("internal", require_parts(frames)[0]),
                       ("external", require_parts(frames)[1])):  # fmt: skip
        values = unpacked(story[key], -1, n, 3)
        exact = whole[::rows]
        error = np.abs(values - exact)[..., [0, 2]] if apart else np.abs(values - exact)
        limit = RESOLUTION * np.abs(exact)[..., [0, 2]] if apart else RESOLUTION * np.abs(exact)
        assert (error <= limit + 1e-45).all(), key
    assert np.array_equal(unpacked(story["states"], -1, n), frames.states[::rows])
    for each in story["objects"]:
        place, turn = frames.poses[each["name"]]
        assert np.array_equal(unpacked(each["position"], -1, 3), place[::rows].astype("f4"))
        assert np.array_equal(unpacked(each["wxyz"], -1, 4), turn[::rows].astype("f4"))


def require_parts(frames: Frames) -> tuple[Array, Array]:
    assert frames.parts is not None
    return frames.parts


@pytest.mark.parametrize("name", SECONDS)
def test_ten_seconds_are_less_than_two_megabytes(name: str, tmp_path: Path) -> None:
    run = played(name)
    times = int(np.ceil(10.0 / run.end))
    long = Recording(np.tile(run.rows, (times, 1)), run.layout, run.header, run.outcome)
    assert long.end >= 10.0
    assert write_page(long, tmp_path / "page.html").stat().st_size < 2e6


def test_charts_have_the_least_and_the_greatest_of_all_ticks() -> None:
    """A shake of 80 Hz that frames, 50 in a second, would not show."""
    run = waving(N=400)
    rows = run.rows.copy()
    force = run.layout.columns["finger_force"].where
    rows[:, force] *= 1.0 + 0.5 * np.cos(2.0 * np.pi * 80.0 * run.time)[:, None]
    shaken = Recording(rows, run.layout, replace(run.header, split=split_of("paper-waving")), Outcome())
    motion = motion_of(shaken, 0.0)
    assert motion.rows == 4
    (squeeze,) = motion.squeeze.values()
    exact = next(iter(Frames(shaken).modes.values())).mean_squeeze
    assert np.array_equal(squeeze[:, 0], exact[::4])
    assert np.array_equal(squeeze[:, 1], exact.reshape(-1, 4).min(axis=1))
    assert np.array_equal(squeeze[:, 2], exact.reshape(-1, 4).max(axis=1))


def split_of(name: str) -> dict[str, Any]:
    return {"object0": dict(next(iter(played(name).header.split.values())))}


def test_a_long_recording_is_read_in_parts_to_the_same_numbers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = played("sphere-three-fingers")
    run.save(tmp_path / "recording.h5")
    whole = story_of(run)
    monkeypatch.setattr("graspfx.live.page.played_frames.WHOLE", 0)
    run.store.step = 37
    assert story_of(Recording.load(tmp_path / "recording.h5")) == whole


def test_an_hour_has_fewer_frames_in_a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("graspfx.live.page.played_frames.MOST", 50)
    story = story_of(waving(N=1000))
    assert (story["frames"], story["step"]) == (50, pytest.approx(0.1))


def test_a_page_is_written_whole_and_over_nothing(tmp_path: Path) -> None:
    run, file = waving(N=20), tmp_path / "a page.html"
    file.write_text("mine")
    with pytest.raises(RecordingError, match=r"a page\.html"):
        write_page(run, file)
    assert file.read_text() == "mine"
    assert write_page(run, file, overwrite=True) == file
    assert file.read_text("utf-8").startswith("<!doctype html>")
    with pytest.raises(RecordingError, match="cannot be written"):
        write_page(run, tmp_path / "nowhere" / "page.html")
    assert [each.name for each in tmp_path.iterdir()] == ["a page.html"]


def test_a_page_is_written_over_no_recording(tmp_path: Path) -> None:
    run, file = waving(N=20), tmp_path / "recording.h5"
    run.save(file)
    before = file.read_bytes()
    for path in (file, tmp_path, ""):
        with pytest.raises(InputError, match=r"ends in \.html"):
            run.to_html(path, overwrite=True)
    with pytest.raises(InputError):
        run.to_html(3)  # type: ignore[arg-type]
    assert file.read_bytes() == before
    assert run.to_html(tmp_path / "page.html").read_text("utf-8") == page_text(run)


def test_an_empty_recording_is_refused() -> None:
    with pytest.raises(InputError, match="at least one tick"):
        page_text(waving(N=0))


def test_one_row_is_a_page() -> None:
    assert story_in(page_text(waving(N=1)))["frames"] == 1


def test_text_of_others_ends_no_script() -> None:
    text = "</script><!--<script>&amp;\u2028\udc80"
    data = in_script({"a": text, text: [float("nan"), 1.5]})
    assert not set("<>&\u2028") & set(data)
    assert json.loads(data) == {"a": text, text: [None, 1.5]}


def test_numbers_beyond_what_a_page_has_are_infinite_or_nothing() -> None:
    with np.errstate(all="raise"):
        values = unpacked(packed([1e300, float("nan"), -1e300, 1e-60]))
    assert np.isposinf(values[0])
    assert np.isnan(values[1])
    assert np.isneginf(values[2])
    assert values[3] == 0.0


def test_values_say_when_they_changed() -> None:
    run = played("paper-waving")
    changes = (KeyChange(200, "coupling.internal.stiffness", 80.0), KeyChange(300, "finger.0.hand.stiffness", 70.0))
    changed = Recording(run.rows.copy(), run.layout, run.header, replace(run.outcome, changes=changes))
    values = {each["key"]: each for each in values_of(changed)}
    gain = values["coupling.internal.stiffness"]
    assert (gain["label"], gain["unit"]) == ("internal stiffness, kip", "N/m")
    assert gain["values"] == [(0.0, "70"), (1.0, "80")]
    assert values["finger.0.hand.stiffness"]["values"] == [(0.0, "60"), (1.5, "70")]
    assert values["object.mass"]["values"] == [(0.0, "0.1")]
    assert story_of(changed)["changes"][0]["time"] == 1.0


def test_a_value_is_looked_up_by_its_key() -> None:
    table = {"object": [{"mass": 1.0}, {"mass": 2.0}], "coupling": {"external": {"stiffness": [1.0, 2.0]}}}
    assert value_at(table, "object.1.mass") == 2.0
    assert value_at(table, "object.mass") is None
    assert value_at({"object": {"mass": 3.0}}, "object.mass") == 3.0
    assert value_at({"object": [{"mass": 3.0}]}, "object.mass") == 3.0
    assert value_at(table, "coupling.external.stiffness.1") == 2.0
    assert value_at(table, "coupling.none.stiffness") is None


def test_a_recording_without_forces_has_a_page_without_arrows_and_charts() -> None:
    scene = gx.load("paper-waving").replace(
        {"duration": 0.1, "engine": "interpreted", "record.columns": ["finger_position", "objects"]}
    )
    story = story_in(page_text(gx.run(scene)))
    assert (story["internal"], story["force"], story["charts"]) == (None, None, [])
    assert story["arrow"]["scale"] == 0.0
    assert "columns that were not recorded" in " ".join(story["notes"])
