"""The figure shows all that a recording holds, in the manner of the paper's Figs. 12 and 13, and leaves no trace."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.image import imread

from graspfx.errors import InputError
from graspfx.show.plot import figure
from tests.support.recordings import PERIOD, layout, recording, waving


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    """Draws, and gives the figure that was saved."""
    saved: list[Figure] = []
    save = Figure.savefig

    def keep(self: Figure, *arguments: Any, **options: Any) -> None:
        saved.append(self)
        save(self, *arguments, **options)

    monkeypatch.setattr(Figure, "savefig", keep)

    def draw(*recordings: Any, **options: Any) -> Figure:
        figure(recordings, tmp_path / "figure.png", **options)
        return saved[-1]

    return draw


def lines(axes: Any) -> dict[str, Any]:
    return {line.get_label(): line for line in axes.get_lines()}


def legend(axes: Any) -> list[str]:
    found = axes.get_legend()
    return [text.get_text() for text in found.get_texts()] if found else []


def inside(picture: Figure, axes: Any) -> Any:
    """Cut out what is painted within a panel, clear of its edges, (rows, columns, 3)."""
    pixels = np.asarray(picture.canvas.buffer_rgba())[..., :3] / 255.0  # type: ignore[attr-defined]
    box = axes.get_window_extent()
    top, bottom = len(pixels) - int(box.y1) + 4, len(pixels) - int(box.y0) - 4
    return pixels[top:bottom, int(box.x0) + 4 : int(box.x1) - 4]


def shows(panel: Any, colour: str) -> int:
    """How many pixels have a colour, up to what smoothing does to it."""
    return int((np.abs(panel - to_rgb(colour)).max(axis=2) < 0.1).sum())


def test_two_fingers_as_in_the_paper(drawn: Any) -> None:
    rec = waving(50.0)  # 4 mm deep on either side of 50 mm, 3 mm ahead: 50 N/m by 1 mm or 7 mm
    above, below, force = drawn(rec).axes
    positions, distances = lines(above), lines(below)
    assert {name: line.get_linestyle() for name, line in positions.items()} == {
        "object": "-",
        "finger0": "--",
        "finger1": "--",
    }
    assert not any(line.get_marker() for line in positions.values())
    assert np.allclose(positions["object"].get_ydata(), 50.0 * np.sin(np.pi * rec.time), atol=1e-9)  # [mm]
    assert np.allclose(positions["object"].get_xdata(), np.arange(2000) * PERIOD)
    assert distances["between fingers"].get_linestyle() == "-"
    assert np.allclose(distances["between fingers"].get_ydata(), 42.0)
    assert distances["object to centre of fingers"].get_linestyle() == "--"
    assert np.allclose(distances["object to centre of fingers"].get_ydata(), 3.0)
    assert np.allclose(distances["between contact points"].get_ydata(), 50.0)
    assert np.allclose(lines(force)["finger0"].get_ydata(), 0.35)
    assert np.allclose(lines(force)["finger1"].get_ydata(), 0.05)
    assert [each.get_ylabel() for each in (above, below, force)] == ["position x [mm]", "distance [mm]", "force [N]"]
    assert force.get_xlabel() == "time [s]"


def test_three_fingers_show_their_distances_from_the_centre(drawn: Any) -> None:
    *_, below, _ = drawn(waving(50.0, n=3)).axes
    found = lines(below)
    assert set(found) == {*(f"finger{i}" for i in range(3)), "object to centre of fingers"}
    assert np.allclose(found["finger2"].get_ydata(), 21.0)  # 25 mm less 4 mm
    assert legend(below) == ["object to centre of fingers", "fingers as in (a): to their centre"]


def test_one_finger_shows_its_distance_from_the_object(drawn: Any) -> None:
    _, below, _ = drawn(waving(50.0, n=1)).axes
    assert {name: line.get_ydata()[0] for name, line in lines(below).items()} == {
        "object to finger": pytest.approx(18.0)  # 25 mm, 4 mm deep, 3 mm ahead
    }


@pytest.mark.parametrize("order", [(2, 3), (3, 2)])
def test_the_legend_names_every_finger_of_both_recordings(drawn: Any, order: tuple[int, int]) -> None:
    picture = drawn(*(waving(n=n) for n in order))
    assert sorted(legend(picture.axes[1])) == ["finger0", "finger1", "finger2", "object"]
    assert sorted(legend(picture.axes[3])) == [
        "between contact points",
        "between fingers",
        "fingers as in (a): to their centre",
        "object to centre of fingers",
    ]


def test_fingers_of_other_names_have_other_strokes(drawn: Any) -> None:
    made = layout(2, 2, fingers=("thumb", "_index"))  # a leading underscore would hide a name from a legend
    x = np.outer(np.linspace(0.0, 1.0, 50), [1.0, 0.0])
    picture = drawn(waving(), recording({"objects/object0/position": x}, made))
    assert legend(picture.axes[1]) == ["object", "finger0", "finger1", "thumb", " _index"]
    colours = {line.get_color() for axes in picture.axes[:2] for line in axes.get_lines()}
    assert len(colours) == 5


def test_every_axis_of_motion_has_its_row_and_label(drawn: Any) -> None:
    """Recordings that move along x and along z; each panel holds the coordinate that its row's label says."""
    t = np.linspace(0.0, 1.0, 100)
    x, z = np.outer(t, [0.05, 0.0, 0.0]), np.outer(t, [0.0, 0.0025, 0.02])  # y: an eighth of z, less than 15 %
    recs = [recording({"objects/object0/position": each}, layout(3)) for each in (x, z)]
    picture = drawn(*recs)
    a, b, c, d = picture.axes[:4]
    assert [each.get_ylabel() for each in (a, c)] == ["position x [mm]", "position z [mm]"]
    ends = [lines(each)["object"].get_ydata()[-1] for each in (a, b, c, d)]
    assert ends == pytest.approx([50.0, 0.0, 0.0, 20.0])


def test_a_panel_without_its_quantity_says_so(drawn: Any) -> None:
    z = np.outer(np.linspace(0.0, 1.0, 100), [0.0, 0.0, 0.02])
    picture = drawn(waving(), recording({"objects/object0/position": z}, layout(3)))
    assert picture.axes[2].get_lines()[:] == []
    assert [text.get_text() for text in picture.axes[2].texts if text.get_text() == "does not apply"]


@pytest.mark.parametrize("n", [2, 3, 4, 6])
def test_fingers_that_coincide_can_all_be_seen(drawn: Any, n: int) -> None:
    """All on one point: every colour has at least 20 pixels left, about a marker, in every row that shows fingers."""
    made = layout(2, n)
    wave = np.zeros((500, 2))
    wave[:, 0] = 0.05 * np.sin(np.linspace(0.0, 12.0, 500))
    together = np.repeat(wave[:, None], n, axis=1)
    picture = drawn(
        recording({"objects/object0/position": wave, "finger_position": together, "finger_force": together}, made)
    )
    above, _, force = picture.axes
    picture.set_dpi(150)
    picture.canvas.draw()
    for axes in (above, force):
        panel = inside(picture, axes)
        for name, line in lines(axes).items():
            assert shows(panel, line.get_color()) >= 20, name
    drawings = {(line.get_color(), line.get_marker(), line.get_markevery()) for line in lines(above).values()}
    assert len(drawings) == n + 1


def test_a_line_along_zero_is_clear_of_the_axis(drawn: Any) -> None:
    """The object's distance from the centre, 0 mm throughout, is not hidden: zero is 4 to 6 % of the panel up."""
    x = np.zeros((500, 2))
    x[:, 0] = 0.05 * np.sin(np.linspace(0.0, 12.0, 500))
    apart = np.array([[-0.02, 0.0], [0.02, 0.0]])
    picture = drawn(recording({"objects/object0/position": x, "finger_position": x[:, None] + apart}, layout()))
    below = picture.axes[1]
    low, high = below.get_ylim()
    assert 0.04 < -low / (high - low) < 0.06
    picture.set_dpi(150)
    picture.canvas.draw()
    assert shows(inside(picture, below), lines(below)["object to centre of fingers"].get_color()) > 150
    assert picture.axes[2].get_ylim()[0] < 0.0


def test_small_motions_far_apart_are_shown_as_changes(drawn: Any) -> None:
    """0.1 mm about -22 mm and 22 mm is 0.2 % of the range, so the change is drawn, and fills half the panel."""
    swing = 1e-4 * np.sin(np.linspace(0.0, 12.0, 500))
    p = np.stack([-0.022 - swing, 0.022 + swing], axis=1)
    c = np.tile([-0.025, 0.025], (500, 1))
    columns = {"finger_position": p, "contact_position": c, "objects/object0/position": np.zeros(500)}
    above, below, _ = drawn(recording(columns, layout(1))).axes
    assert [each.get_ylabel() for each in (above, below)] == ["displacement x [mm]", "change of distance [mm]"]
    assert lines(above)["finger1"].get_ydata() == pytest.approx(1e3 * swing)
    assert lines(below)["between fingers"].get_ydata() == pytest.approx(2e3 * swing)
    for axes, name in ((above, "finger1"), (below, "between fingers")):
        low, high = axes.get_ylim()
        assert np.ptp(lines(axes)[name].get_ydata()) > 0.5 * (high - low)
    notes = [" ".join(axes.texts[0].get_text().split()) for axes in (above, below)]
    assert notes == [
        "at t = 0: object 0.0, finger0 −22.0, finger1 22.0 mm",
        "at t = 0: between fingers 44.0, between contact points 50.0, object to centre of fingers 0.0 mm",
    ]


def test_fast_lines_are_drawn_thinner(drawn: Any) -> None:
    """100 periods go 200 times up and down."""
    widths = []
    for periods in (3, 100):
        x = np.outer(0.05 * np.sin(np.linspace(0.0, 2.0 * np.pi * periods, 4000)), [1.0, 0.0])
        above, *_ = drawn(recording({"objects/object0/position": x}, layout())).axes
        widths.append(lines(above)["object"].get_linewidth())
    assert widths[1] == pytest.approx(0.5 * widths[0])


def test_an_object_that_turns_in_the_plane_shows_its_angle(drawn: Any) -> None:
    angle = np.linspace(0.3, 0.3 + 4.0 * np.pi, 100)
    picture = drawn(recording({"objects/object0/orientation": angle}, layout()))
    turn = picture.axes[-1]
    assert turn.get_ylabel() == "turn [degrees]"
    assert lines(turn)["about z"].get_ydata()[-1] == pytest.approx(720.0)
    assert len(drawn(recording({"objects/object0/orientation": 1e-4 * angle}, layout())).axes) == 3  # 0.07 degrees


def test_an_object_that_turns_in_space_shows_the_axes_it_turns_about(drawn: Any) -> None:
    """From a quarter turn about x, by 0.6 and 0.8 of an angle about the world's y and z; scipy composes them."""
    from scipy.spatial.transform import Rotation

    angle = np.linspace(0.0, 3.0 * np.pi, 400)
    turned = Rotation.from_rotvec(np.outer(angle, [0.0, 0.6, 0.8])) * Rotation.from_rotvec([np.pi / 2, 0.0, 0.0])
    q = turned.as_quat() * np.where(np.arange(400) % 7 == 0, -1.0, 1.0)[:, None]  # q and -q are one rotation
    turn = lines(drawn(recording({"objects/object0/orientation": q}, layout(3))).axes[-1])
    assert set(turn) == {"about y", "about z"}
    assert turn["about y"].get_ydata() == pytest.approx(np.degrees(0.6 * angle), abs=1e-6)
    assert turn["about z"].get_ydata() == pytest.approx(np.degrees(0.8 * angle), abs=1e-6)


def test_every_object_that_fingers_touch_has_its_column(drawn: Any) -> None:
    made = layout(1, 4, objects=2)
    x = np.linspace(0.0, 0.1, 5)
    picture = drawn(recording({"objects/object0/position": x, "objects/object1/position": -x}, made), titles=["two"])
    left, right = picture.axes[:2]
    assert set(lines(left)) == {"object", "finger0", "finger2"}
    assert set(lines(right)) == {"object", "finger1", "finger3"}
    assert lines(right)["object"].get_ydata()[-1] == pytest.approx(-100.0)
    assert [each.get_title(loc="left") for each in (left, right)] == ["two\nobject object0", "object object1"]


@pytest.mark.parametrize(("count", "objects"), [(1, 2), (2, 1), (2, 2)])
def test_a_title_ends_before_the_next_one_begins(drawn: Any, count: int, objects: int) -> None:
    """One over several objects may go on above the next object's name, which stands a line lower."""
    found = {f"objects/object{i}/position": np.linspace(0.0, 0.1, 5) for i in range(objects)}
    title = "A title of many words that is as long as a line in it may be, and then goes on"
    picture = drawn(*[recording(found, layout(1, 4, objects=objects), title=title) for _ in range(count)])
    picture.canvas.draw()
    titles = [axes._left_title for axes in picture.axes[: count * objects]]
    ends = [each.get_window_extent().x1 for each in titles[::objects]]
    assert all(end < begin.get_window_extent().x0 for end, begin in zip(ends, titles[objects::objects], strict=False))
    assert sum(title[:7] in each.get_text() for each in titles) == count


def test_two_recordings_share_their_axes(drawn: Any) -> None:
    picture = drawn(waving(30.0), waving(70.0), titles=["conventional", "proposed"])
    a, b, c, d, e, f = picture.axes
    assert (a.get_ylim(), c.get_ylim(), e.get_ylim()) == (b.get_ylim(), d.get_ylim(), f.get_ylim())
    assert a.get_xlim() == f.get_xlim()
    assert [each.get_title(loc="left") for each in (a, b)] == ["conventional", "proposed"]


def test_the_title_names_the_gains(drawn: Any) -> None:
    above, *_ = drawn(waving(N=50)).axes
    assert above.get_title(loc="left") == "By hand\n$k_{ep}$ = 30, $k_{ip}$ = 70 N/m"
    same = {"coupling": {"external": {"stiffness": 30.0}, "internal": {"stiffness": 30.0}}}
    rec = recording(
        {"objects/object0/position": np.zeros((5, 2))},
        layout(),
        title="",
        scene_table=same,
        overrides={"object.viscosity": 1.5, "finger.0.device.name": "$a_b"},
    )
    above, *_ = drawn(rec).axes
    assert above.get_title(loc="left") == (
        "by-hand\n$k_p$ = 30 N/m, object.viscosity = 1.5,\nfinger.0.device.name = \\$a_b"
    )


@pytest.mark.parametrize("recs", [(waving(),), (waving(n=6), waving()), (waving(d=1), waving(d=3, n=4))])
def test_all_that_is_written_is_inside_the_picture_and_legible(drawn: Any, recs: Any) -> None:
    """No text smaller than 7 points, none cut off, no legend over a panel, panels at least an inch high."""
    picture = drawn(*recs)
    picture.set_dpi(150)
    picture.canvas.draw()
    page = picture.bbox
    for axes in picture.axes:
        assert axes.get_window_extent().height / picture.dpi > 1.0
        texts = [axes.title, axes._left_title, axes.xaxis.label, axes.yaxis.label, *axes.texts]
        found = axes.get_legend()
        if found:
            texts += found.get_texts()
            assert found.get_window_extent().x0 >= axes.get_window_extent().x1
            assert found.get_window_extent().height <= axes.get_window_extent().height + 1.0
        for text in filter(lambda text: text.get_text(), texts):
            box = text.get_window_extent()
            assert text.get_fontsize() >= 7.0
            assert box.x0 >= page.x0 and box.x1 <= page.x1 and box.y0 >= page.y0 and box.y1 <= page.y1


@pytest.mark.parametrize(("d", "n", "N"), [(1, 2, 1), (1, 1, 300), (3, 5, 20000)])
def test_any_run_can_be_drawn(d: int, n: int, N: int, tmp_path: Path) -> None:
    path = figure([waving(d=d, n=n, N=N)], tmp_path / "figure.png")
    picture = imread(path)
    assert picture.shape[0] > 600
    assert picture.std() > 0.05  # not blank


def test_a_run_that_diverged_can_be_drawn(drawn: Any) -> None:
    x = np.zeros((100, 2))
    x[:, 0] = 10.0 ** np.linspace(-3.0, 300.0, 100)
    x[90:] = np.nan
    above, *_ = drawn(
        recording({"objects/object0/position": x, "finger_force": x[:, None] + [[0], [0]]}, layout())
    ).axes
    assert np.isfinite(above.get_ylim()).all()


def test_a_long_run_keeps_its_peaks(drawn: Any) -> None:
    x = np.zeros((50001, 2))
    x[12345, 0], x[-1, 0] = 0.07, -0.01
    above, *_ = drawn(recording({"objects/object0/position": x}, layout())).axes
    line = lines(above)["object"]
    assert len(line.get_ydata()) < 10000
    assert (line.get_ydata().max(), line.get_ydata()[-1]) == pytest.approx((70.0, -10.0))
    assert line.get_xdata()[line.get_ydata().argmax()] == pytest.approx(12345 * PERIOD)


def test_a_figure_repeats_to_the_bit(tmp_path: Path) -> None:
    first, second = (figure([waving(n=3)], tmp_path / f"{i}.png").read_bytes() for i in range(2))
    assert first == second


def test_nothing_global_is_touched(tmp_path: Path) -> None:
    before, backend = dict(mpl.rcParams), mpl.get_backend()
    figure([waving(N=10)], tmp_path / "figure.svg")
    assert dict(mpl.rcParams) == before
    assert mpl.get_backend() == backend
    assert (tmp_path / "figure.svg").read_text().startswith("<?xml")


def test_nothing_to_draw_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="at least one tick"):
        figure([], tmp_path / "figure.png")
    with pytest.raises(InputError, match="at least one tick"):
        figure([waving(N=0)], tmp_path / "figure.png")


def test_another_number_of_titles_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="as many as recordings, 1"):
        figure([waving(N=5)], tmp_path / "figure.png", titles=["a", "b"])
