"""One style: colours that can be told apart, widths of journals, words in strips of their own, the same bytes twice."""

from __future__ import annotations

import subprocess
import sys
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from graspfx.errors import InputError
from graspfx.show import style
from graspfx.show.sheet import Sheet
from graspfx.show.style import EXTERNAL, FINGERS, INK, INTERNAL, WIDTHS, width_of
from tests.support.writing import faults

FloatArray = NDArray[np.float64]

# Machado, Oliveira and Fernandes (2009), severity 1: what remains of linear red, green and blue
SIGHT = {
    "full": np.eye(3),
    "no green": np.array([
        [0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]
    ]),
    "no red": np.array([
        [0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]
    ]),
}  # fmt: skip
TO_XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)


def linear(colour: str) -> FloatArray:
    c = np.array([int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5)])
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def lab(rgb: FloatArray) -> FloatArray:
    """CIE 1976 L*a*b* of linear sRGB."""
    t = TO_XYZ @ np.clip(rgb, 0.0, 1.0) / np.array([0.95047, 1.0, 1.08883])
    f = np.where(t > 0.008856, np.cbrt(t), 7.787 * t + 16.0 / 116.0)
    return np.array([116.0 * f[1] - 16.0, 500.0 * (f[0] - f[1]), 200.0 * (f[1] - f[2])])


@pytest.mark.parametrize("sight", SIGHT)
def test_colours_can_be_told_apart(sight: str) -> None:
    """A difference of 2 is just seen side by side, one of 20 at a glance; external and internal are farthest apart."""
    seen = {colour: lab(SIGHT[sight] @ linear(colour)) for colour in (EXTERNAL, INTERNAL, INK, *FINGERS)}
    for a, b in combinations(seen, 2):
        assert np.linalg.norm(seen[a] - seen[b]) > 20.0, (a, b)
    assert np.linalg.norm(seen[EXTERNAL] - seen[INTERNAL]) > 90.0


@pytest.mark.parametrize("colour", [EXTERNAL, INTERNAL, INK, *FINGERS])
def test_lines_stand_out_from_paper(colour: str) -> None:
    """The contrast to white of a line; 3 is what graphics on the web ought to have, and the least here is 2.9."""
    assert 1.05 / (linear(colour) @ TO_XYZ[1] + 0.05) > 2.9


def example(width: str = "screen", columns: int = 2, **options: bool) -> Sheet:
    with style.look(width):
        sheet = style.figure([1.5, 1.0], columns, width=width, **options)  # type: ignore[arg-type]
        for axes in sheet.panels.ravel():
            axes.plot([0.0, 1.0], [0.0, 2.0], label="a line with a long name")
            axes.plot([0.0, 1.0], [1.0, 2.0], label="another one")
        style.panel(sheet.panels[-1, 0], x="time [s]", y="force [N]", title="a panel")
        for row in range(2):
            sheet.legend(row)
        sheet.letters()
        sheet.title("A title of so many words that it has to be folded, whatever the width of the paper may be " * 2)
        sheet.title("over_a_column_without_a_blank_" * 4, 0)
    return sheet


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("width", WIDTHS)
def test_labels_of_points_stand_apart(width: str, side: float) -> None:
    """Points as close as times of two equally quick choices: each keeps a label of its own, none over another."""
    with style.look(width):
        sheet = style.figure([2.0], width=width)
        [axes] = sheet.panels[0]
        axes.plot([0.0, 1.0], [0.0, 1.0], "none")
        for x, y in ((0.5, 0.2), (0.5, 0.2), (0.51, 0.205), (0.52, 0.19), (0.1, 0.3)):
            axes.annotate("2.5 ms", (x, 0.5 + side * y), (8.0, 4.0 * side), textcoords="offset points")
    assert faults(style.arranged(sheet)) == []
    assert [text.xyann for text in axes.texts].count((8.0, 4.0 * side)) == 2  # one of the four, and that far away


@pytest.mark.parametrize("share", [True, False])
@pytest.mark.parametrize("columns", [1, 3])
@pytest.mark.parametrize("width", WIDTHS)
def test_words_have_places_of_their_own(width: str, columns: int, share: bool) -> None:
    picture = style.arranged(example(width, columns, share_x=share, share_y=share))
    assert faults(picture) == []
    assert picture.get_size_inches()[0] == width_of(width, columns).inches


def test_a_colour_bar_has_room() -> None:
    with style.look():
        sheet = style.figure([1.5], 2, bar=True)
        drawn = sheet.panels[0, 0].imshow([[0.0, 1e4]], aspect="auto")
        sheet.figure.colorbar(drawn, cax=sheet.bar, label="a quantity [m]")
    picture = style.arranged(sheet)
    assert faults(picture) == []
    assert sheet.bar is not None and sheet.bar.get_position().x0 > sheet.panels[0, 1].get_position().x1


def test_a_user_who_has_set_other_fonts_gets_the_same_figure(tmp_path: Path) -> None:
    import matplotlib as mpl

    plain = style.save(example(), tmp_path / "plain.svg").read_bytes()
    with mpl.rc_context({"font.size": 30.0, "lines.linewidth": 9.0, "svg.fonttype": "path", "axes.grid": False}):
        assert style.save(example(), tmp_path / "own.svg").read_bytes() == plain


@pytest.mark.parametrize("form", style.FORMATS)
def test_another_process_writes_the_same_bytes(form: str, tmp_path: Path) -> None:
    """With other hashes of words, too."""
    code = (
        "import sys; from pathlib import Path; from graspfx.show import style;"
        "from tests.show.test_style import example; style.save(example(), Path(sys.argv[1]))"
    )
    files = [tmp_path / f"{seed}.{form}" for seed in (1, 2)]
    for seed, file in enumerate(files, 1):
        environment = {"PYTHONHASHSEED": str(seed), "PYTHONPATH": ":".join(sys.path)}
        subprocess.run([sys.executable, "-c", code, str(file)], check=True, env=environment)
    assert files[0].read_bytes() == files[1].read_bytes()


def test_words_stay_words(tmp_path: Path) -> None:
    svg = style.save(example(), tmp_path / "a.svg").read_text("utf-8")
    assert "a line with a long name</text>" in svg and "force [N]</text>" in svg
    pdf = style.save(example(), tmp_path / "a.pdf").read_bytes()
    assert b"/Subtype /CIDFontType2" in pdf or b"/FontFile2" in pdf
    assert b"/Type3" not in pdf and b"CreationDate" not in pdf


def test_pixels_keep_the_colours_of_lines(tmp_path: Path) -> None:
    from matplotlib.image import imread

    with style.look():
        sheet = style.figure([2.0])
        for k, colour in enumerate((EXTERNAL, INTERNAL, *FINGERS)):
            sheet.panels[0, 0].plot([0.0, 1.0], [k, k + 0.5], color=colour)
    pixels = np.round(255.0 * imread(style.save(sheet, tmp_path / "a.png"))[..., :3]).astype(int).reshape(-1, 3)
    for colour in (EXTERNAL, INTERNAL, *FINGERS):
        own = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)])
        assert int((pixels == own).all(axis=1).sum()) > 100, colour


def test_other_widths_and_formats_are_errors(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="screen, page, column"), style.look("poster"):
        pass
    with pytest.raises(InputError, match=r"\.png"):
        style.save(example(), tmp_path / "a.strange")
    assert not list(tmp_path.iterdir())
