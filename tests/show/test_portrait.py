"""The picture of one instant: surfaces of the right size, near hides far, arrows to scale, no names that overlap."""

from __future__ import annotations

from dataclasses import replace
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.image import imread
from numpy.typing import NDArray

import graspfx as gx
from graspfx import plugins
from graspfx.__main__ import main
from graspfx.coupling.two_forces import SplitRule
from graspfx.errors import InputError
from graspfx.recording.record import Recording
from graspfx.show.picture.instant import instant
from graspfx.show.picture.painter import Camera, Layer, Painter, Solid, corner_normals
from graspfx.show.picture.portrait import arrows, head, portrait
from graspfx.show.picture.surfaces import Surface, ball, rotation, surface
from graspfx.show.style import EXTERNAL, INK, INTERNAL
from tests.support.recordings import layout, recording, waving
from tests.support.writing import faults

FloatArray = NDArray[np.float64]

SOLIDS: dict[str, tuple[Any, Any, Any]] = {
    "box": ({"size": [0.02, 0.03, 0.05]}, 3e-5, 1e-12),
    "sphere": ({"radius": 0.03}, 4 / 3 * pi * 0.03**3, 2e-3),
    "capsule": ({"radius": 0.02, "length": 0.05}, pi * 0.02**2 * (0.05 + 4 / 3 * 0.02), 2e-3),
    "cylinder": ({"radius": 0.02, "length": 0.05}, pi * 0.02**2 * 0.05, 2e-3),
    "ellipsoid": ({"semi_axes": [0.01, 0.02, 0.03]}, 4 / 3 * pi * 6e-6, 2e-3),
}  # volume [m^3], and how much the facets may take: a polygon of 96 sides has 0.07 % less area than its circle
FLAT: dict[str, tuple[Any, Any, Any]] = {
    "box": ({"size": [0.02, 0.03]}, 6e-4, 1e-12),
    "sphere": ({"radius": 0.03}, pi * 9e-4, 1e-3),
    "capsule": ({"radius": 0.02, "length": 0.05}, pi * 4e-4 + 0.04 * 0.05, 1e-3),
    "ellipsoid": ({"semi_axes": [0.01, 0.02]}, pi * 2e-4, 1e-3),
}


def volume(made: Surface) -> float:
    a, b, c = np.moveaxis(made.vertices[made.faces], 1, 0)
    return float(np.einsum("fi,fi->", a, np.cross(b, c)) / 6.0)


def held(
    shape: dict[str, Any] | None = None, n: int = 5, radius: float = 0.0, obstacles: tuple[Any, ...] = (), **head: Any
) -> Recording:
    """n fingers around a ball of 40 mm, pushing inwards, the k-th with (1 + k/n) N; three ticks, the second twice."""
    k = np.arange(n) + 0.5
    z, angle = 1.0 - 2.0 * k / n, pi * (1.0 + 5**0.5) * k
    s = np.sqrt(1.0 - z**2)
    out = np.column_stack([s * np.cos(angle), s * np.sin(angle), z])
    force = -out * (1.0 + np.arange(n) / n)[:, None] * np.array([1.0, 2.0, 1.0])[:, None, None]
    still = np.tile(0.04 * out, (3, 1, 1))
    columns = {
        "finger_position": still + radius * out,
        "true_position": still + radius * out,
        "contact_position": still,
        "finger_force": force,
        "touching": np.ones((3, n)),
        "objects/object0/orientation": np.tile([0.0, 0.0, 0.0, 1.0], (3, 1)),
    }
    table: dict[str, Any] = {
        "object": [{"name": "object0", "shape": shape or {"kind": "sphere", "radius": 0.04}}],
        "finger": [{"radius": radius}] * n,
        "obstacle": list(obstacles),
    }
    return recording(columns, layout(3, n), **({"scene_table": table, "title": "By hand"} | head))


def drawn(recorded: Recording, **options: Any) -> Any:
    drawing = portrait(recorded, **options)
    return drawing.figure, drawing.notes


@pytest.mark.parametrize("kind", SOLIDS)
def test_a_solid_is_closed_faces_outwards_and_has_its_volume(kind: str) -> None:
    lengths, expected, facets = SOLIDS[kind]
    made = surface({"kind": kind, **lengths}, 3, 0.1)
    assert expected * (1.0 - facets) <= volume(made) <= expected * (1.0 + 1e-12)


@pytest.mark.parametrize("kind", FLAT)
def test_an_outline_has_its_area(kind: str) -> None:
    lengths, expected, facets = FLAT[kind]
    x, y = surface({"kind": kind, **lengths}, 2, 0.1).vertices.T
    area = 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))
    assert expected * (1.0 - facets) <= area <= expected * (1.0 + 1e-12)


@pytest.mark.parametrize("kind", ["plane", "half-space"])
def test_an_endless_surface_is_a_piece_across_its_normal(kind: str) -> None:
    shape = {"kind": kind, "normal": [1.0, 2.0, 2.0]}
    assert np.abs(surface(shape, 3, 0.1).vertices @ [1.0, 2.0, 2.0]).max() < 1e-16
    ground = surface({"kind": kind, "normal": [3.0, 4.0]}, 2, 0.1).vertices @ [0.6, 0.8]
    assert ground.max() < 1e-16 and (ground.min() < -1e-3) == (kind == "half-space")


def test_a_mesh_by_its_corners_and_from_a_file() -> None:
    box = surface({"kind": "box", "size": [0.08, 0.06, 0.001]}, 3, 0.1)
    corners = {"vertices": box.vertices.tolist(), "faces": box.faces.tolist()}
    assert volume(surface(corners, 3, 0.1)) == pytest.approx(4.8e-6, rel=1e-12)
    table = {"mesh": "meshes/plate.ply", "scale": 1e-3}
    assert volume(surface(table, 3, 0.1, plugins.shelf("scenes"))) == pytest.approx(4.8e-6, rel=1e-12)


def test_normals_are_smooth_up_to_creases() -> None:
    """Those of a ball point away from its middle, up to half a facet's angle; those of a box along its axes."""
    round_ = ball(0.02, 96)
    normals = corner_normals(round_.vertices, round_.faces)
    away = round_.vertices[round_.faces] / 0.02
    assert (normals * away).sum(axis=2).min() > np.cos(pi / 96)
    box = surface({"kind": "box", "size": [0.02, 0.03, 0.05]}, 3, 0.1)
    assert np.abs(corner_normals(box.vertices, box.faces)).max(axis=2).min() > 1.0 - 1e-12


def test_the_nearest_of_two_triangles_is_painted() -> None:
    """Two that cut one another: left of the line where they meet the one is nearer, right of it the other."""
    layer = Layer(np.array([0.0, 0.0]), np.array([1.0, 1.0]), 100)
    flat = np.array([[-1.0, -1.0], [3.0, -1.0], [0.5, 3.0]])
    up, down = (np.column_stack([flat, sign * (flat[:, 0] - 0.5)])[None] for sign in (1.0, -1.0))
    normals = np.tile([0.0, 0.0, 1.0], (1, 3, 1))
    layer.add(up, normals, (1.0, 0.0, 0.0))
    layer.add(down, normals, (0.0, 0.0, 1.0))
    assert (layer.colour[:, :50, 2] == 1.0).all() and (layer.colour[:, 50:, 0] == 1.0).all()
    x = (np.arange(100) + 0.5) / 100
    assert layer.depth[50] == pytest.approx(np.abs(x - 0.5), abs=1e-12)


def test_an_arrow_has_its_head_however_short() -> None:
    for length in (1.0, 0.1, 0.01):
        corners = head(np.array([[0.0, 0.0], [length, 0.0]]), 0.01)
        assert corners[1].tolist() == [length, 0.0]
        assert 0.0 < corners[0, 0] < length and corners[0, 1] == -corners[2, 1] > 0.0


def test_two_arrows_stand_outside_and_beside_one_another() -> None:
    """A squeeze of 1 N on either side, and 0.5 N to the right: in from outside, and out where it pulls."""
    p = np.array([[-0.025, 0.0], [0.025, 0.0]])
    f = np.array([[1.5, 0.0], [-0.5, 0.0]])
    columns = {
        "finger_position": p[None], "true_position": p[None], "contact_position": p[None], "finger_force": f[None],
        "touching": np.ones((1, 2)),
    }  # fmt: skip
    rule = SplitRule(2, (True, True, False), (False,) * 3, None, None, (1.0, 1.0), (0.0, 0.0), "fingertip")
    table = {"object": {"name": "object0", "shape": {"kind": "box", "size": [0.05, 0.05]}}}
    now = instant(recording(columns, layout(2, 2), scene_table=table, split={"object0": rule.table()}))
    placed = arrows(now, 0.01, "two", np.eye(2))
    ends = [(each.finger, each.colour, each.tail[0], each.tip[0]) for each in placed]
    assert [each[:2] for each in ends] == [(0, INTERNAL), (0, EXTERNAL), (1, INTERNAL), (1, EXTERNAL)]
    assert [each[2:] for each in ends] == [
        pytest.approx(pair) for pair in ((-0.035, -0.025), (-0.03, -0.025), (0.035, 0.025), (0.025, 0.03))
    ]
    sides = [np.sign(each.offset * (each.tip - each.tail)[0]) for each in placed]  # above or below the line
    assert sides[0] == -sides[1] != 0.0 and sides[2] == -sides[3] != 0.0
    assert [each.offset for each in arrows(now, 0.01, "total", np.eye(2))] == [0.0, 0.0]


def test_a_surface_turns_as_its_quaternion_says() -> None:
    """A quarter turn about z takes x to y; an angle does the same in the plane."""
    half = np.sqrt(0.5)
    assert np.allclose(rotation([0.0, 0.0, half, half], 3) @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], atol=1e-15)
    assert np.allclose(rotation(pi / 2, 2) @ [1.0, 0.0], [0.0, 1.0], atol=1e-15)


@pytest.mark.parametrize("view", [(-60.0, 22.0), (10.0, -30.0), (200.0, 89.0)])
def test_the_camera_keeps_lengths_and_hands(view: tuple[float, float]) -> None:
    axes = Camera(*view).axes
    assert np.allclose(axes @ axes.T, np.eye(3), atol=1e-15)
    assert np.allclose(np.cross(axes[0], axes[1]), axes[2], atol=1e-15)


def test_what_is_near_hides_what_is_far() -> None:
    """From +x: a point behind a ball is hidden, beside it or before it not."""
    painter = Painter(Camera(0.0, 0.0), 0.1, [Solid(ball(0.02), "red")])
    points = np.array([[-0.03, 0.0, 0.0], [0.03, 0.0, 0.0], [-0.03, 0.03, 0.0], [0.0, 0.0, 0.0]])
    assert painter.hidden(points).tolist() == [True, False, False, True]


def test_the_nearer_finger_is_painted_over_the_object(tmp_path: Path) -> None:
    """Two fingers at the ends of a diameter, seen along it: the near green one is there, of the far one its name."""
    p = np.array([[0.0, -0.05, 0.0], [0.0, 0.05, 0.0]])
    columns = {
        "finger_position": p[None], "true_position": p[None], "contact_position": 0.8 * p[None],
        "touching": np.ones((1, 2)), "finger_force": np.zeros((1, 2, 3)),
        "objects/object0/orientation": np.array([[0.0, 0.0, 0.0, 1.0]]),
    }  # fmt: skip
    table = {
        "object": [{"name": "object0", "shape": {"kind": "sphere", "radius": 0.04}}],
        "finger": [{"radius": 0.01}] * 2,
    }
    file = tmp_path / "picture.png"
    portrait(recording(columns, layout(3, 2), scene_table=table, title=""), view=(-90.0, 0.0)).save(file)
    pixels = imread(file)[..., :3]
    red, green, blue = (pixels[..., k] for k in range(3))
    ball_of_finger = ((green > 2.0 * red) & (green > 1.2 * blue)).sum()
    assert ball_of_finger > 1000
    assert ((red > 2.5 * green) & (red > 1.3 * blue)).sum() < 0.2 * ball_of_finger


@pytest.mark.parametrize(("n", "radius"), [(1, 0.0), (5, 0.0), (5, 0.008), (20, 0.0)])
def test_names_do_not_overlap(n: int, radius: float) -> None:
    made, notes = drawn(held(n=n, radius=radius))
    assert not notes
    check_names(made, n)


def test_names_do_not_overlap_in_a_tall_picture() -> None:
    """An object that fell far below its fingers: the height of the panel, not its width, sets the scale."""
    rec = held(n=4, radius=0.007)
    rows = rec.rows.copy()
    rows[:, rec.layout.columns["objects/object0/position"].where.start + 2] -= 1.0
    rows[:, rec.layout.columns["finger_force"].where] = 0.0
    made, _ = drawn(Recording(rows, rec.layout, rec.header, rec.outcome), time=0.0, view=(120.0, 15.0))
    check_names(made, 4)


def test_a_host_has_the_object_which_is_not_drawn() -> None:
    rec = held(n=2, radius=0.005)
    hosted = replace(rec.header, scene_table={"host": {"name": "hand"}, "finger": [{"radius": 0.005}] * 2})
    assert [thing.name for thing in instant(rec, 0.0).things] == ["object0"]
    now = instant(Recording(rec.rows, rec.layout, hosted, rec.outcome), 0.0)
    assert not now.things and len(now.tips) == 2


def check_names(made: Any, n: int) -> None:
    """Check that each of n names is inside the figure and overlaps no other."""
    axes = made.axes[0]
    named = [text for text in axes.texts if text.get_text() and text.get_color() != INK]
    assert len(named) == n
    made.draw_without_rendering()  # at the resolution that the figure now has
    boxes = [text.get_window_extent(made.canvas.get_renderer()) for text in named]
    for i, box in enumerate(boxes):
        assert not any(box.overlaps(other) for other in boxes[:i]), named[i].get_text()
        assert made.bbox.contains(box.x0, box.y0) and made.bbox.contains(box.x1, box.y1)


def test_axes_are_equal_and_hold_every_surface() -> None:
    made, _ = drawn(held())
    axes = made.axes[0]
    assert axes.get_aspect() == 1.0
    (painting,) = axes.images
    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    left, right, low, high = painting.get_extent()
    assert x0 < left < right < x1 and y0 < low < high < y1
    width, height = (axes.get_window_extent().width, axes.get_window_extent().height)
    assert (x1 - x0) / width == pytest.approx((y1 - y0) / height, rel=1e-3)


def test_nothing_is_written_over_anything_else() -> None:
    for width in ("screen", "page", "column"):
        for rec in (held(n=3), with_shape(waving())):
            made, _ = drawn(rec, width=width)
            assert faults(made) == []


def test_arrows_and_their_scale_agree() -> None:
    """In the plane: an arrow's length over the scale's length is its force over the scale's."""
    made, _ = drawn(with_shape(waving(50.0)), time=0.0, forces="total")
    axes = made.axes[0]
    shafts = [p.get_xy()[:, 0] for p in axes.patches if hasattr(p, "get_xy") and len(p.get_xy()) == 5][1:]
    heads = [p.get_xy()[:, 0] for p in axes.patches if p.get_label() == "_head"]
    lengths = [np.ptp(np.concatenate(pair)) for pair in zip(shafts, heads, strict=True)]
    bar = next(t for t in axes.texts if getattr(t, "arrowprops", None) and t.arrowprops["arrowstyle"] == "-|>")
    value = float(next(text.get_text() for text in axes.texts if text.get_text().endswith(" N")).split()[0])
    width = (bar.xy[0] - bar.xyann[0]) * np.ptp(axes.get_xlim())
    f = np.abs(waving(50.0).finger_force[0, :, 0])
    assert lengths == pytest.approx((f / value * width).tolist(), rel=1e-9)


def with_shape(recorded: Recording) -> Recording:
    table = {"object": {"name": "object0", "shape": {"kind": "box", "size": [0.05, 0.05]}}}
    head = recorded.header
    return Recording(recorded.rows, recorded.layout, type(head)(**{**vars(head), "scene_table": table}))


def test_twenty_thousand_triangles_over_a_floor() -> None:
    floor = {"shape": {"kind": "half-space", "normal": [0.0, 0.0, 1.0]}, "position": [0.0, 0.0, -0.05]}
    post = {
        "name": "post",
        "shape": {"kind": "cylinder", "radius": 0.005, "length": 0.05},
        "position": [0.07, 0.0, 0.0],
    }
    shape = {"mesh": "meshes/potato.ply", "scale": 1e-3}
    made, notes = drawn(held(shape, obstacles=(floor, post)), folder=plugins.shelf("scenes"))
    assert not notes
    (painting,) = made.axes[0].images
    assert np.asarray(painting.get_array())[..., 3].mean() > 0.2  # of the picture is covered


@pytest.mark.parametrize(
    ("shape", "words"),
    [
        ({"kind": "klein-bottle"}, "klein-bottle"),
        ({"kind": "box"}, "size"),
        ({"mesh": "nowhere.stl"}, "nowhere.stl"),
        ({"vertices": [[0.0, 0.0, 0.0]], "faces": []}, "triangles"),
    ],
)
def test_what_cannot_be_drawn_is_skipped_with_a_note(shape: dict[str, Any], words: str) -> None:
    strange = {"name": "strange"}
    _, notes = drawn(held(shape, obstacles=(strange,)))
    assert any("object0" in note and words in note for note in notes)
    assert any("strange" in note for note in notes)


def test_the_instant_is_where_forces_are_largest_else_the_end() -> None:
    assert instant(held()).time == pytest.approx(0.005)  # the second tick
    assert instant(held(), 0.0).time == 0.0
    idle = recording({"objects/object0/position": np.zeros((4, 2))}, layout(2))
    assert instant(idle).time == pytest.approx(0.015)
    wrong: list[Any] = [-0.1, 0.02, np.nan, np.inf, "a", [0.0], {}]
    for time in wrong:
        with pytest.raises(InputError, match=r"^time: .*from 0 to 0\.01 s"):
            instant(held(), time)


def test_a_view_is_two_angles() -> None:
    wrong: list[Any] = [(1,), (1.0, 2.0, 3.0), 30.0, "ab", (np.nan, 0.0), (), {}]
    for view in wrong:
        with pytest.raises(InputError, match=r"^view: .* two numbers, the azimuth and the elevation"):
            held().picture(view=view)
    gx.run("sphere-three-fingers", duration=0.01).picture(view=np.array([30.0, 20.0]))  # type: ignore[arg-type]


def test_a_finger_that_is_nowhere_is_left_out() -> None:
    lost = held()
    rows = lost.rows.copy()
    rows[:, lost.layout.columns["true_position"].where.start] = np.nan
    made, notes = drawn(Recording(rows, lost.layout, lost.header))
    assert "without finite positions" in notes[0] and "finger0" not in {text.get_text() for text in made.axes[0].texts}


@pytest.mark.parametrize("scene", ["reference-1dof", "paper-waving"])
def test_the_command_runs_a_scene_or_takes_a_recording(
    scene: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["picture", scene, "--time", "0.2", "--out", "there/one.svg"]) == 0
    assert capsys.readouterr().out == "wrote there/one.svg\n" and "<svg" in Path("there/one.svg").read_text()
    assert main(["run", scene, "--duration", "0.1", "--no-figure", "--out", "here"]) == 0
    assert main(["picture", "here"]) == 0
    assert imread("here/picture.png").shape[2] == 4
    assert main(["picture", "here", "--set", "object.mass=0.2"]) == 2
    assert main(["picture", "here", "--out", "strange.ending"]) == 2
    assert main(["picture", "missing.h5"]) == 2
    said = capsys.readouterr().err
    assert "a scene instead of a recording" in said and ".png" in said and "missing.h5" in said


def test_a_shape_stands_where_its_scene_describes_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """A recording that knows the frame of a mesh's file from the centre of mass says so itself."""
    pose = np.tile([0.1, 0.0, 0.0], (3, 1)), np.tile([0.0, 0.0, 0.0, 1.0], (3, 1))
    monkeypatch.setattr(Recording, "described_pose", lambda self, name: pose, raising=False)
    (thing,) = instant(held({"mesh": "meshes/plate.ply", "scale": 1e-3}), folder=plugins.shelf("scenes")).things
    assert thing.surface.vertices.mean(axis=0) == pytest.approx([0.1, 0.0, 0.0], abs=1e-12)
    assert not thing.path.any()  # of the centre of mass


@pytest.mark.parametrize("name", ["sphere-three-fingers", "reference-1dof"])
def test_an_instant_without_a_finite_position_is_an_error(name: str) -> None:
    """As at the end of a run that diverged."""
    rec = gx.run(name, duration=0.02)
    rows = np.array(rec.rows)
    rows[-1] = np.nan
    lost = Recording(rows, rec.layout, rec.header, rec.outcome)
    with pytest.raises(InputError, match=r"time: .* finite position \[s\]; the run may have diverged"):
        lost.picture(rec.time[-1])
    assert lost.picture(rec.time[-2]).figure.axes


def test_a_recording_knows_where_its_meshes_are(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Drawn from anywhere, after the file has been written and read."""
    rec = gx.run(gx.load("thin-plate"), duration=0.02)
    rec.save(tmp_path / "recording.h5")
    monkeypatch.chdir(tmp_path)
    assert portrait(gx.Recording.load(tmp_path / "recording.h5")).notes == ()
