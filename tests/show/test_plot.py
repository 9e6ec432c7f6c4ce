"""The figure shows all that a recording holds, in the manner of the paper's Figs. 12 and 13, and leaves no trace."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.image import imread

import graspfx as gx
from graspfx.coupling.two_forces import SplitRule
from graspfx.errors import InputError
from graspfx.loop.columns import RunFault
from graspfx.recording.record import Recording
from graspfx.show.panels import _axes_worth_showing
from graspfx.show.run_figures import sheet
from graspfx.show.style import EXTERNAL, FINGERS, INTERNAL, arranged, save
from tests.support.recordings import PERIOD, layout, recording, waving
from tests.support.writing import faults, legends, smallest


def drawn(*recordings: Recording, **options: Any) -> Any:
    return arranged(sheet(recordings, **options))


def divided(rec: Recording) -> Recording:
    """The recording with a split of free translations: external is the mean."""
    names, of = rec.layout.objects, rec.layout.finger_objects
    d = rec.layout.dimensions
    moves = tuple(a < d for a in range(3))
    split = {
        name: SplitRule(
            d, moves, (False,) * 3, None, None, (1.0,) * of.count(k), (0.0,) * of.count(k), "fingertip"
        ).table()
        for k, name in enumerate(names)
    }
    return Recording(rec.rows, rec.layout, type(rec.header)(**{**vars(rec.header), "split": split}))


def lines(axes: Any) -> dict[str, Any]:
    return {line.get_label(): line for line in axes.get_lines() if line.get_label() != "_zero"}


def names(picture: Figure) -> list[list[str]]:
    """List the words of each legend, from the top."""
    ordered = sorted(legends(picture), key=lambda each: -each.get_window_extent().y0)
    return [[text.get_text() for text in each.get_texts()] for each in ordered]


def titles(picture: Figure) -> list[str]:
    """Titles from the top left, without the letters of the rows."""
    lines = [text for text in picture.texts if not text.get_text().startswith("(")]
    ordered = sorted(lines, key=lambda text: (-round(text.get_position()[1], 3), text.get_position()[0]))
    return [text.get_text().replace("\N{NO-BREAK SPACE}", " ") for text in ordered]


def inside(picture: Figure, axes: Any) -> Any:
    """Cut out what is painted within a panel, clear of its edges, (rows, columns, 3)."""
    pixels = np.asarray(picture.canvas.buffer_rgba())[..., :3] / 255.0  # type: ignore[attr-defined]
    box = axes.get_window_extent()
    top, bottom = len(pixels) - int(box.y1) + 4, len(pixels) - int(box.y0) - 4
    return pixels[top:bottom, int(box.x0) + 4 : int(box.x1) - 4]


def shows(panel: Any, colour: str) -> int:
    """How many pixels have a colour, up to what smoothing does to it."""
    return int((np.abs(panel - to_rgb(colour)).max(axis=2) < 0.1).sum())


def test_two_fingers_as_in_the_paper() -> None:
    """Eqs. (13) to (19), signed: 4 mm in on either side and 3 mm ahead, of 50 N/m by 7 mm and by -1 mm."""
    rec = divided(waving(50.0))
    above, displacement, force = drawn(rec).axes
    positions, shifts, forces = lines(above), lines(displacement), lines(force)
    assert {name: (line.get_linestyle(), line.get_marker()) for name, line in positions.items()} == {
        "object": ("-", ""),
        "finger0": ("--", "o"),
        "finger1": ("--", "s"),
    }
    assert np.allclose(positions["object"].get_ydata(), 50.0 * np.sin(np.pi * rec.time), atol=1e-9)  # [mm]
    assert np.allclose(positions["object"].get_xdata(), np.arange(2000) * PERIOD)
    for curves, squeeze, push in ((shifts, 4.0, 3.0), (forces, 0.2, 0.15)):
        assert np.allclose(curves["internal (squeeze)"].get_ydata(), squeeze)
        assert np.allclose(curves["external (push), x"].get_ydata(), push)
    assert [each.get_ylabel() for each in (above, displacement, force)] == [
        "position x [mm]",
        "displacement [mm]",
        "force [N]",
    ]
    assert force.get_xlabel() == "time [s]" and force.get_xlim() == (0.0, 10.0)


def test_squeeze_and_push_have_their_signs() -> None:
    """Fingers pulled apart, and behind the object: both below zero, and zero is marked."""
    rec = waving(50.0)
    p = 2.0 * rec.contact_position - rec.finger_position
    columns = {name: rec.array(name) for name in ("contact_position", "touching", "objects/object0/position")}
    back = recording(columns | {"finger_position": p, "finger_force": -rec.finger_force}, layout())
    _, displacement, force = drawn(divided(back)).axes
    assert lines(displacement)["internal (squeeze)"].get_ydata()[0] == pytest.approx(-4.0)
    assert lines(force)["external (push), x"].get_ydata()[0] == pytest.approx(-0.15)
    low, high = displacement.get_ylim()
    assert low < 0.0 < high and np.allclose(displacement.get_lines()[-1].get_ydata(), 0.0)


def test_external_and_internal_keep_their_colours() -> None:
    assert not {EXTERNAL, INTERNAL} & set(FINGERS)
    for rec in (divided(waving()), divided(waving(n=3)), divided(waving(d=3, n=7))):
        for axes in drawn(rec).axes:
            for name, line in lines(axes).items():
                own = INTERNAL if name.startswith("internal") else EXTERNAL if name.startswith("external") else ""
                assert (line.get_color() == own) if own else line.get_color() not in (INTERNAL, EXTERNAL)


def test_three_fingers_show_the_mean_and_range_of_the_squeeze() -> None:
    """Each 4 mm in: without the 3 mm ahead, which are external, all squeeze alike."""
    rec = divided(waving(50.0, n=3))
    *_, displacement, force, by_finger = drawn(rec).axes
    name = "internal (squeeze), mean and range"
    assert np.allclose(lines(displacement)[name].get_ydata(), 4.0)
    assert np.allclose(lines(force)[name].get_ydata(), 0.2)
    assert len(displacement.collections) == 1  # the band
    assert set(lines(by_finger)) == {"finger0", "finger1", "finger2"}
    assert np.allclose(lines(by_finger)["finger2"].get_ydata(), np.linalg.norm(rec.finger_force[:, 2], axis=1))


def test_a_free_finger_squeezes_nothing() -> None:
    """While a finger is away its two parts are recorded, and not drawn: the push is the other one's."""
    rec = waving(50.0, N=100)
    rows = rec.rows.copy()
    rows[:40, rec.layout.columns["touching"].where.start] = 0.0
    rows[:40, rec.layout.columns["finger_force"].where.start] = 0.0
    *_, force = drawn(divided(Recording(rows, rec.layout, rec.header))).axes
    squeeze, push = (lines(force)[name].get_ydata() for name in ("internal (squeeze)", "external (push), x"))
    assert np.isnan(squeeze[:40]).all() and np.allclose(squeeze[40:], 0.2)
    assert np.allclose(push, [-0.025] * 40 + [0.15] * 60)


def test_many_fingers_are_a_mean_and_a_range() -> None:
    rec = divided(waving(50.0, d=3, n=7, N=200))
    picture = drawn(rec)
    above = picture.axes[0]
    assert set(lines(above)) == {"object", "fingers: mean and range"}
    assert np.allclose(
        lines(above)["fingers: mean and range"].get_ydata(), 1e3 * rec.finger_position[:, :, 0].mean(axis=1)
    )
    (band,) = above.collections
    corners = band.get_paths()[0].vertices
    assert corners[:, 1].max() == pytest.approx(1e3 * rec.finger_position[:, :, 0].max(), rel=1e-6)
    assert len(set(lines(picture.axes[-1]))) == 1
    assert len(lines(drawn(divided(waving(d=3, n=5, N=50))).axes[0])) == 6  # five have a line each


def test_one_finger_only_pushes() -> None:
    _, displacement, _ = drawn(divided(waving(50.0, n=1))).axes
    assert {name: line.get_ydata()[0] for name, line in lines(displacement).items()} == {
        "external (push), x": pytest.approx(7.0)  # 4 mm in, 3 mm ahead
    }


def test_a_recording_of_an_earlier_format_shows_its_forces() -> None:
    """It does not say what is external: the magnitude of each finger's force stands in their place."""
    _, force = drawn(waving(50.0)).axes
    assert {name: line.get_ydata()[0] for name, line in lines(force).items()} == {
        "finger0": pytest.approx(0.35),
        "finger1": pytest.approx(0.05),
    }


@pytest.mark.parametrize("order", [(2, 3), (3, 2)])
def test_the_legend_names_every_finger_of_both_recordings(order: tuple[int, int]) -> None:
    positions, modes, forces = names(drawn(*(divided(waving(n=n)) for n in order)))
    assert sorted(positions) == ["finger0", "finger1", "finger2", "object"]
    assert modes == ["internal (squeeze), mean and range", "external (push), x"]
    assert sorted(forces) == ["finger0", "finger1", "finger2"]


def test_fingers_of_other_names_have_other_strokes() -> None:
    made = layout(2, 2, fingers=("thumb", "_index"))  # a leading underscore would hide a name from a legend
    x = np.outer(np.linspace(0.0, 1.0, 50), [1.0, 0.0])
    picture = drawn(waving(), recording({"objects/object0/position": x}, made))
    assert names(picture)[0] == ["object", "finger0", "finger1", "thumb", " _index"]
    colours = {line.get_color() for axes in picture.axes[:2] for line in axes.get_lines()}
    assert len(colours) == 5


def test_every_axis_of_motion_has_its_row_and_label() -> None:
    """Recordings that move along x and along z; each panel holds the coordinate that its row's label says."""
    t = np.linspace(0.0, 1.0, 100)
    x, z = np.outer(t, [0.05, 0.0, 0.0]), np.outer(t, [0.0, 0.0025, 0.02])  # y: an eighth of z, less than 15 %
    recs = [recording({"objects/object0/position": each}, layout(3)) for each in (x, z)]
    picture = drawn(*recs)
    a, b, c, d = picture.axes[:4]
    assert [each.get_ylabel() for each in (a, c)] == ["position x [mm]", "position z [mm]"]
    ends = [lines(each)["object"].get_ydata()[-1] for each in (a, b, c, d)]
    assert ends == pytest.approx([50.0, 0.0, 0.0, 20.0])


def test_a_panel_without_its_quantity_says_so() -> None:
    z = np.outer(np.linspace(0.0, 1.0, 100), [0.0, 0.0, 0.02])
    picture = drawn(waving(), recording({"objects/object0/position": z}, layout(3)))
    assert picture.axes[2].get_lines()[:] == []
    assert [text.get_text() for text in picture.axes[2].texts if text.get_text() == "does not apply"]


@pytest.mark.parametrize("n", [2, 3, 4, 5])
def test_fingers_that_coincide_can_all_be_seen(n: int) -> None:
    """All on one point: every colour has at least 20 pixels left, about a marker, in every row that shows fingers."""
    made = layout(2, n)
    wave = np.zeros((500, 2))
    wave[:, 0] = 0.05 * np.sin(np.linspace(0.0, 12.0, 500))
    together = np.repeat(wave[:, None], n, axis=1)
    picture = drawn(
        recording({"objects/object0/position": wave, "finger_position": together, "finger_force": together}, made)
    )
    above, force = picture.axes
    picture.canvas.draw()
    for axes in (above, force):
        panel = inside(picture, axes)
        for name, line in lines(axes).items():
            assert shows(panel, line.get_color()) >= 20, name
    drawings = {(line.get_color(), line.get_marker(), line.get_markevery()) for line in lines(above).values()}
    assert len(drawings) == n + 1


def test_a_squeeze_and_a_push_that_coincide_can_both_be_seen() -> None:
    rec = waving(50.0)
    columns = {name: rec.array(name) for name in ("contact_position", "touching", "objects/object0/position")}
    x = np.zeros((2000, 2, 2))
    x[:, 0, 0] = 0.01 * np.sin(rec.time)  # of one finger alone: half of it is internal, half external
    both = recording(columns | {"finger_position": rec.contact_position + x, "finger_force": x}, layout())
    picture = drawn(divided(both))
    picture.canvas.draw()
    for axes in picture.axes[1:]:
        panel = inside(picture, axes)
        assert shows(panel, INTERNAL) > 300 and shows(panel, EXTERNAL) > 300


def test_small_motions_far_apart_are_shown_as_changes() -> None:
    """0.1 mm about -22 mm and 22 mm is 0.2 % of the range, so the change is drawn, and fills half the panel."""
    swing = 1e-4 * np.sin(np.linspace(0.0, 12.0, 500))
    p = np.stack([-0.022 - swing, 0.022 + swing], axis=1)
    c = np.tile([-0.025, 0.025], (500, 1))
    columns = {"finger_position": p, "contact_position": c, "objects/object0/position": np.zeros(500)}
    picture = drawn(recording(columns, layout(1)))
    above = picture.axes[0]
    assert above.get_ylabel() == "change of x [mm]"
    line = lines(above)["finger1 (from 22.0)"]
    assert line.get_ydata() == pytest.approx(1e3 * swing)
    low, high = above.get_ylim()
    assert np.ptp(line.get_ydata()) > 0.5 * (high - low)
    assert names(picture)[0] == ["object (from 0.0)", "finger0 (from \N{MINUS SIGN}22.0)", "finger1 (from 22.0)"]


def test_fast_lines_are_drawn_thinner() -> None:
    """100 periods go 200 times up and down."""
    widths = []
    for periods in (3, 100):
        x = np.outer(0.05 * np.sin(np.linspace(0.0, 2.0 * np.pi * periods, 4000)), [1.0, 0.0])
        above, *_ = drawn(recording({"objects/object0/position": x}, layout())).axes
        widths.append(lines(above)["object"].get_linewidth())
    assert widths[1] == pytest.approx(0.5 * widths[0])


def test_an_object_that_turns_in_the_plane_shows_its_angle() -> None:
    angle = np.linspace(0.3, 0.3 + 4.0 * np.pi, 100)
    picture = drawn(recording({"objects/object0/orientation": angle}, layout()))
    turn = picture.axes[-1]
    assert turn.get_ylabel() == "turn [degrees]"
    assert lines(turn)["about z"].get_ydata()[-1] == pytest.approx(720.0)
    assert len(drawn(recording({"objects/object0/orientation": 1e-4 * angle}, layout())).axes) == 2  # 0.07 degrees


def test_an_object_that_turns_in_space_shows_the_axes_it_turns_about() -> None:
    """From a quarter turn about x, by 0.6 and 0.8 of an angle about the world's y and z; scipy composes them."""
    from scipy.spatial.transform import Rotation

    angle = np.linspace(0.0, 3.0 * np.pi, 400)
    turned = Rotation.from_rotvec(np.outer(angle, [0.0, 0.6, 0.8])) * Rotation.from_rotvec([np.pi / 2, 0.0, 0.0])
    q = turned.as_quat() * np.where(np.arange(400) % 7 == 0, -1.0, 1.0)[:, None]  # q and -q are one rotation
    turn = lines(drawn(recording({"objects/object0/orientation": q}, layout(3))).axes[-1])
    assert set(turn) == {"about y", "about z"}
    assert turn["about y"].get_ydata() == pytest.approx(np.degrees(0.6 * angle), abs=1e-6)
    assert turn["about z"].get_ydata() == pytest.approx(np.degrees(0.8 * angle), abs=1e-6)


def test_every_object_that_fingers_touch_has_its_column() -> None:
    made = layout(1, 4, objects=2)
    x = np.linspace(0.0, 0.1, 5)
    picture = drawn(recording({"objects/object0/position": x, "objects/object1/position": -x}, made), titles=["two"])
    left, right = picture.axes[:2]
    assert set(lines(left)) == {"object", "finger0", "finger2"}
    assert set(lines(right)) == {"object", "finger1", "finger3"}
    assert lines(right)["object"].get_ydata()[-1] == pytest.approx(-100.0)
    assert titles(picture) == ["two", "two", "object object0", "object object1"]


def test_recordings_side_by_side_share_their_axes() -> None:
    recs = [divided(waving(k)) for k in (30.0, 50.0, 70.0)]
    picture = drawn(*recs, titles=["soft", "middle", "stiff"])
    panels = np.array(picture.axes).reshape(3, 3)
    assert all(len({axes.get_ylim() for axes in row}) == 1 for row in panels)
    assert len({axes.get_xlim() for axes in panels.ravel()}) == 1
    assert titles(picture) == ["soft", "middle", "stiff"]
    squeeze = [lines(axes)["internal (squeeze)"].get_ydata()[0] for axes in panels[1]]
    assert squeeze == pytest.approx([200.0 / 30.0, 4.0, 200.0 / 70.0])


def test_the_title_states_the_first_fault() -> None:
    rec = waving(N=50)
    both = RunFault(20, "the device is lost"), RunFault(30, "it cannot be stopped")
    lost = Recording(rec.rows, rec.layout, rec.header, replace(rec.outcome, faults=both))
    texts = titles(drawn(rec, lost))
    said = [text for text in texts if f"fault at {20 * PERIOD:g} s" in text.replace("\n", " ")]
    assert len(said) == 1 and said[0] == texts[-1]  # over its own column


def test_the_titles_name_the_gains() -> None:
    assert titles(drawn(waving(N=50))) == ["By hand", "$k_{ep}$ = 30, $k_{ip}$ = 70 N/m"]
    same = {"coupling": {"external": {"stiffness": 30.0}, "internal": {"stiffness": 30.0}}}
    rec = recording(
        {"objects/object0/position": np.zeros((5, 2))},
        layout(),
        title="",
        scene_table=same,
        overrides={"object.viscosity": 1.5, "finger.0.device.name": "$a_b"},
    )
    assert " ".join(titles(drawn(rec))) == (
        r"by-hand $k_p$ = 30 N/m, object.viscosity = 1.5, finger.0.device.name = \$a_b"
    )
    assert titles(drawn(rec, waving(N=50)))[:2] == ["by-hand", "By hand"]  # two scenes: each over its column


LONG = "A title of many words that is as long as a line in it may be, and then goes on, " * 3
MANY = [
    ((divided(waving(N=200)),), "two fingers"),
    ((divided(waving(n=6, N=200)), divided(waving(N=200))), "two recordings"),
    ((divided(waving(d=1, N=200)), waving(d=3, n=4, N=200)), "two dimensions"),
    (tuple(divided(waving(k, N=200)) for k in (30.0, 50.0, 70.0)), "three"),
    ((recording({"objects/object0/position": np.linspace(0.0, 0.1, 5)}, layout(1, 4, objects=2), title=LONG),), "long"),
]


@pytest.mark.parametrize("width", ["screen", "page", "column"])
@pytest.mark.parametrize("recs", [recs for recs, _ in MANY], ids=[name for _, name in MANY])
def test_all_that_is_written_is_inside_the_picture_and_legible(recs: Any, width: str) -> None:
    """No text smaller than 7 points, none cut off, none over another, none over data; panels of some height."""
    picture = drawn(*recs, width=width)
    assert faults(picture) == []
    assert smallest(picture) >= 7.0
    for axes in picture.axes:
        assert axes.get_window_extent().height / picture.dpi > 0.8


@pytest.mark.parametrize(("width", "inches"), [("page", 7.2), ("column", 3.5)])
def test_a_width_of_a_journal_is_kept(width: str, inches: float) -> None:
    for recs in ((waving(N=50),), tuple(waving(N=50) for _ in range(4))):
        assert drawn(*recs, width=width).get_size_inches()[0] == inches


@pytest.mark.parametrize(("d", "n", "N"), [(1, 2, 1), (1, 1, 300), (3, 5, 20000)])
def test_any_run_can_be_drawn(d: int, n: int, N: int, tmp_path: Path) -> None:
    picture = imread(save(sheet([waving(d=d, n=n, N=N)]), tmp_path / "figure.png"))
    assert picture.shape[0] > 600
    assert picture.std() > 0.05  # not blank


def test_a_run_that_diverged_can_be_drawn() -> None:
    x = np.zeros((100, 2))
    x[:, 0] = 10.0 ** np.linspace(-3.0, 300.0, 100)
    x[90:] = np.nan
    above, *_ = drawn(
        recording({"objects/object0/position": x, "finger_force": x[:, None] + [[0], [0]]}, layout())
    ).axes
    assert np.isfinite(above.get_ylim()).all()


def test_a_long_run_keeps_its_peaks() -> None:
    x = np.zeros((50001, 2))
    x[12345, 0], x[-1, 0] = 0.07, -0.01
    above, *_ = drawn(recording({"objects/object0/position": x}, layout())).axes
    line = lines(above)["object"]
    assert len(line.get_ydata()) < 10000
    assert (line.get_ydata().max(), line.get_ydata()[-1]) == pytest.approx((70.0, -10.0))
    assert line.get_xdata()[line.get_ydata().argmax()] == pytest.approx(12345 * PERIOD)


@pytest.mark.parametrize("form", ["png", "svg", "pdf"])
def test_a_figure_has_the_format_that_is_asked_for(form: str, tmp_path: Path) -> None:
    """Equal bytes twice; words are words in what is not pixels."""
    first, second = (save(sheet([divided(waving(N=100))]), tmp_path / f"{i}", form=form).read_bytes() for i in range(2))
    assert first == second
    assert first.startswith({"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}[form])
    if form == "svg":
        assert b"internal (squeeze)</text>" in first and b"<dc:date>" not in first


def test_nothing_global_is_touched(tmp_path: Path) -> None:
    before, backend = dict(mpl.rcParams), mpl.get_backend()
    save(sheet([waving(N=10)]), tmp_path / "figure.svg")
    assert dict(mpl.rcParams) == before
    assert mpl.get_backend() == backend
    assert (tmp_path / "figure.svg").read_text().startswith("<?xml")


def test_what_cannot_be_drawn_is_an_error() -> None:
    for none in ((), (waving(N=0),)):
        with pytest.raises(InputError, match="at least one tick"):
            drawn(*none)
    with pytest.raises(InputError, match="one per recording, 1 in all"):
        drawn(waving(N=5), titles=["a", "b"])
    for other in ("finger_force", None, 3):
        with pytest.raises(InputError, match=rf"recordings: given {other!r}, expected a recording"):
            waving(N=5).plot(other)  # type: ignore[arg-type]


def test_a_recording_draws_itself() -> None:
    """In a notebook, which asks for `_repr_png_`, beside others, and to a file."""
    rec = gx.run("reference-1dof", duration=0.5)
    drawing = rec.plot(rec, titles=["one", "two"])
    assert drawing._repr_png_().startswith(b"\x89PNG")  # type: ignore[attr-defined]
    assert len(drawing.figure.axes) == 6 and "8.6 x" in repr(drawing)
    with pytest.raises(InputError, match="screen, page, column"):
        rec.plot(width="poster")  # type: ignore[arg-type]


def test_no_pyplot_draws() -> None:
    """A process of its own: others of this one may have loaded it."""
    code = "import sys, graspfx as gx; gx.run('reference-1dof', duration=0.1).plot()._repr_png_(); print(*sys.modules)"
    modules = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert "matplotlib.figure" in modules
    assert "matplotlib.pyplot" not in modules


def test_an_axis_that_would_look_flat_beside_others_is_not_drawn() -> None:
    """A share of the farthest way of all views counts: they share an ordinate."""
    shakes, calm = np.array([1.0, 0.02]), np.array([0.05, 0.03])
    assert _axes_worth_showing([calm]) == [0, 1]
    assert _axes_worth_showing([shakes, calm]) == [0]
    assert _axes_worth_showing([shakes, np.array([0.0, 0.4])]) == [0, 1]
    assert _axes_worth_showing([np.zeros(2)]) == [0]
    assert _axes_worth_showing([]) == [0]
