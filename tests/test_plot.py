"""The figure shows what a recording holds, in the manner of the paper's Figs. 12 and 13, and leaves no trace."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread
from recordings import PERIOD, layout, recording, waving

from graspfx.errors import InputError
from graspfx.show.plot import figure, main_axis


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


def test_two_fingers_as_in_the_paper(drawn: Any) -> None:
    rec = waving(50.0)  # 4 mm deep on either side of 50 mm, 3 mm ahead
    above, below = drawn(rec).axes
    positions, distances = lines(above), lines(below)
    assert {name: line.get_linestyle() for name, line in positions.items()} == {
        "object": "-",
        "finger0": "--",
        "finger1": "--",
    }
    assert np.allclose(positions["object"].get_ydata(), 50.0 * np.sin(np.pi * rec.time), atol=1e-9)  # [mm]
    assert np.allclose(positions["object"].get_xdata(), np.arange(2000) * PERIOD)
    assert distances["between fingers"].get_linestyle() == "-"
    assert np.allclose(distances["between fingers"].get_ydata(), 42.0)
    assert distances["object to centre of fingers"].get_linestyle() == "--"
    assert np.allclose(distances["object to centre of fingers"].get_ydata(), 3.0)
    assert np.allclose(distances["between contact points"].get_ydata(), 50.0)
    assert (above.get_ylabel(), below.get_ylabel(), below.get_xlabel()) == (
        "position x [mm]",
        "distance [mm]",
        "time [s]",
    )


def test_three_fingers_show_their_distances_from_the_centre(drawn: Any) -> None:
    _, below = drawn(waving(50.0, n=3)).axes
    found = lines(below)
    assert set(found) == {*(f"finger{i} to centre" for i in range(3)), "object to centre of fingers"}
    assert np.allclose(found["finger2 to centre"].get_ydata(), 21.0)  # 25 mm less 4 mm


def test_two_recordings_share_their_axes(drawn: Any) -> None:
    picture = drawn(waving(30.0), waving(70.0), titles=["conventional", "proposed"])
    a, b, c, d = picture.axes
    assert (a.get_ylim(), c.get_ylim()) == (b.get_ylim(), d.get_ylim())
    assert a.get_xlim() == d.get_xlim()
    assert [each.get_title(loc="left") for each in (a, b)] == ["conventional", "proposed"]
    assert c.get_ylim()[0] == 0.0


def test_the_title_names_the_gains(drawn: Any) -> None:
    above, _ = drawn(waving(N=50)).axes
    assert above.get_title(loc="left") == "By hand\n$k_{ep}$ = 30, $k_{ip}$ = 70 N/m"
    same = {"coupling": {"external": {"stiffness": 30.0}, "internal": {"stiffness": 30.0}}}
    rec = recording(
        {"objects/object0/position": np.zeros((5, 2))},
        layout(),
        title="",
        scene_table=same,
        overrides={"object.viscosity": 1.5},
    )
    above, _ = drawn(rec).axes
    assert above.get_title(loc="left") == "by-hand\n$k_p$ = 30 N/m, object.viscosity = 1.5"


def test_the_main_axis_is_that_of_the_object_or_of_the_fingers() -> None:
    x = np.zeros((10, 3))
    x[:, 1], x[:, 2] = np.linspace(0, 1, 10), np.linspace(0, 2, 10)
    assert main_axis(recording({"objects/object0/position": x}, layout(3))) == 2
    fingers = np.zeros((10, 2, 3))
    fingers[:, 1, 1] = np.linspace(0, 1, 10)
    assert main_axis(recording({"finger_position": fingers}, layout(3))) == 1


@pytest.mark.parametrize(("d", "n", "N"), [(1, 2, 1), (1, 1, 300), (3, 5, 20000)])
def test_any_run_can_be_drawn(d: int, n: int, N: int, tmp_path: Path) -> None:
    path = figure([waving(d=d, n=n, N=N)], tmp_path / "figure.png")
    picture = imread(path)
    assert picture.shape[0] > 600
    assert picture.std() > 0.05  # not blank


def test_only_the_fingers_of_the_first_object_are_drawn(drawn: Any) -> None:
    made = layout(1, 4, objects=2)
    above, _ = drawn(recording({"objects/object0/position": np.zeros((5, 1))}, made)).axes
    assert set(lines(above)) == {"object", "finger0", "finger2"}


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
