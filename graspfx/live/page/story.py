"""Data that a page gives to its script: scenery, motion, charts, values and texts, with arrays encoded as base64."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

import graspfx
from graspfx.errors import InputError
from graspfx.live.frame import STATES
from graspfx.live.page.played_frames import Motion, motion_of
from graspfx.live.scenery import SLAB, Scenery, Solid, scenery
from graspfx.recording.record import Recording
from graspfx.show.panels import pushes
from graspfx.show.picture import painter, portrait
from graspfx.show.picture.instant import apart_on_a_line, slid
from graspfx.show.picture.painter import corner_normals
from graspfx.show.picture.portrait import nice
from graspfx.show.picture.surfaces import Surface
from graspfx.show.squeeze_and_push import Modes
from graspfx.show.style import CONTACTS, EXTERNAL, INTERNAL, MARGIN, PUSHES, SQUEEZE

IntArray = NDArray[np.int64]

RESOLUTION = 2.0**-24  # largest relative error of a number, from rounding to 24 bits
NORMAL = 127  # scale of unit normals as integers
SAME = 1e-3  # difference below which normals are merged


class Packed(NamedTuple):
    """Triangles with one normal per vertex; vertices on creases are duplicated."""

    vertices: FloatArray
    normals: FloatArray
    faces: IntArray


def packed(values: ArrayLike, kind: str = "f4") -> dict[str, str]:
    """Encode an array as little-endian numbers in base64.

    Args:
        values: Array of any shape; the shape is not stored.
        kind: NumPy type without byte order: "f4", "i1", "u1", "u2" or "u4".
    """
    array = np.asarray(values)
    if kind == "f4":  # overflow gives infinity, underflow gives zero, and NaN is kept
        with np.errstate(over="ignore", under="ignore"):
            array = array.astype("<f4")
    return {"kind": kind, "data": b64encode(np.ascontiguousarray(array, dtype=f"<{kind}").tobytes()).decode("ascii")}


def packed_solid(solid: Solid, number: int) -> dict[str, Any]:
    """Encode an object or an obstacle; `number` is the index of the object with whose pose it moves, -1 if fixed."""
    mesh = with_normals(solid.vertices, solid.faces)
    return {
        "name": solid.name, "colour": solid.colour, "endless": solid.endless,
        "object": number,
        "vertices": packed(mesh.vertices), "normals": packed(np.round(NORMAL * mesh.normals), "i1"),
        "faces": packed(mesh.faces, "u2" if len(mesh.vertices) < 1 << 16 else "u4"),
    }  # fmt: skip


def with_normals(vertices: FloatArray, faces: IntArray) -> Packed:
    """Compute vertex normals as in pictures, and merge equal vertices that have equal normals."""
    normals = corner_normals(vertices, faces).reshape(-1, 3)
    keys = np.column_stack([faces.reshape(-1), np.round(normals / SAME).astype(np.int64)])
    _, first, number = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    return Packed(vertices[faces.reshape(-1)[first]], normals[first], number.reshape(-1, 3))


FloatArray = NDArray[np.float64]

WORDS = {
    "free": "free fingertip",
    "touch": "touching fingertip",
    "stick": "sticking fingertip",
    "slide": "sliding fingertip",
    "limit": "fingertip at its force limit",
}
ARROWS = 0.2  # room for arrows around fingertips, as a share of the extent
ROOM = 0.15  # room around a live scene, as a share of the extent
FAR = 10.0  # distance from the middle beyond which points are ignored, in extents
CELLS, LINES = 10.0, 10  # grid cells along the scene; grid lines on each side of its middle
FIELD = 40.0  # vertical field of view [degrees]
OBLIQUE = (0.28, 0.32, 1.0)  # direction to the camera for planar scenes
DEPTH = 1.1  # width of the lines of depths [points]
PIXELS = 4.0 / 3.0  # CSS pixels per point
THICK = 1.1  # thickness of arrows relative to still pictures
TYPICAL = 0.995  # quantile of the forces that gets the longest arrow


Source = Literal["recording", "own", "live"]


def story_of(recording: Recording, folder: Path | None = None, *, source: Source = "recording") -> dict[str, Any]:
    """Collect all data of a page.

    Args:
        recording: Recording of a run.
        folder: Folder to which mesh paths are relative; None for the scene's folder.
        source: Source of the page's frames: "recording" for the recording, "own" for a run in the page, or "live" for a
            run in the program that serves the page. A run produces its own frames and charts, so the motion in the
            recording is then omitted.

    Raises:
        InputError: If the recording has no ticks.
    """
    if not len(recording):
        raise InputError("recording", 0, "a recording with at least one tick")
    drawn, is_run = scenery(recording.header, recording.layout, folder), source != "recording"
    motion = motion_of(recording, drawn.apart)
    low, high = _bounds(drawn, motion)
    if source == "live":  # the future motion is unknown
        half = 0.5 * drawn.extent / np.sqrt(3.0)
        low = np.minimum(low, drawn.middle - half) - ROOM * drawn.extent
        high = np.maximum(high, drawn.middle + half) + ROOM * drawn.extent
    reach, middle = max(float(np.linalg.norm(high - low)), drawn.extent), 0.5 * (low + high)
    objects = tuple(motion.poses)
    layout, header = recording.layout, recording.header
    title = header.title or Path(header.scene).stem or "A recording"
    possible = ("free", *(("stick", "slide") if layout.slips else ("touch",)), *(("limit",) if layout.limits else ()))
    seen = [name for k, name in enumerate(STATES) if (name in possible if is_run else (motion.states == k).any())]
    step = motion.rows * recording.row_period
    motions = {} if is_run else {
        "fingertips": packed(motion.fingertips), "contacts": packed(motion.contacts),
        "states": packed(motion.states, "u1"), "force": None if motion.internal is not None else _packed(motion.force),
        "internal": _packed(motion.internal), "external": _packed(motion.external),
    }  # fmt: skip
    return {
        "title": title, "facts": _facts(recording, source),
        "about": _versions(recording, source) if is_run else _about(recording, motion),
        "notes": _notes(recording, drawn), "description": _description(recording, title),
        "dimensions": layout.dimensions, "attached": not layout.gaps,
        "frames": len(motion), "start": recording.start * recording.row_period, "step": step,
        "ticks": motion.rows * header.every,
        "up": drawn.up.tolist(), "extent": drawn.extent,
        "bounds": [low.tolist(), high.tolist()], "camera": _camera(motion, layout.dimensions, reach),
        "grid": _grid(drawn, low, middle, reach),
        "lighting": {
            "light": painter.LIGHT, "ambient": painter.AMBIENT, "diffuse": painter.DIFFUSE, "gloss": painter.GLOSS,
            "sharpness": painter.SHARPNESS,
        },
        "colours": {"internal": INTERNAL, "external": EXTERNAL},
        "contacts_states": [[name, CONTACTS[name], WORDS[name]] for name in STATES], "states_seen": seen,
        "arrow": {
            "scale": _arrow_scale(motion, drawn), "longest": portrait.LONGEST, "shortest": portrait.SHORTEST,
            "shaft": portrait.SHAFT, "head": portrait.HEAD, "wide": portrait.WIDE, "most": portrait.MOST_HEAD,
            "along": portrait.ALONG, "apart": portrait.APART, "thick": THICK * min(reach, 2.0 * drawn.extent),
        },
        "fingers": [
            {
                "name": name, "colour": drawn.colours[i], "radius": float(drawn.radii[i]),
                "ball": bool(drawn.is_ball[i]), "object": _place(layout.objects[layout.finger_objects[i]], objects),
            }
            for i, name in enumerate(drawn.fingers)
        ],
        "solids": [
            packed_solid(_widened(each, middle, reach / drawn.extent), _place(each.object, objects))
            for each in drawn.solids if each.object is None or each.object in objects
        ],
        **motions, "apart": (drawn.apart * apart_on_a_line(len(layout.fingers))).tolist(),
        "objects": [
            {"name": name} if is_run else {"name": name, "position": packed(place), "wxyz": packed(turn)}
            for name, (place, turn) in motion.poses.items()
        ],
        "charts": _charts(motion, drawn, source),
        "changes": [
            {"time": change.tick * recording.period, "words": str(change)} for change in recording.changes
        ],
        "faults": [{"time": fault.tick * recording.period, "words": fault.message} for fault in recording.faults],
        "values": values_of(recording),
    }  # fmt: skip


def bare_story(title: str) -> dict[str, Any]:
    """Return the data of a page that shows no scene, such as a page that only asks a question."""
    nothing: tuple[str, ...] = (
        "about", "notes", "contacts_states", "states_seen", "fingers", "solids", "objects", "charts", "changes",
        "faults", "values", "apart",
    )  # fmt: skip
    return dict.fromkeys(nothing, ()) | {
        "title": title, "facts": "", "description": "", "bare": True, "dimensions": 2, "attached": False, "frames": 0,
        "step": 1.0, "ticks": 1, "up": [0.0, 1.0, 0.0], "extent": 1.0, "bounds": [[0.0] * 3, [1.0] * 3],
        "camera": {"towards": [0.0, 0.0, 1.0], "field": FIELD},
        "grid": {"cell": 1.0, "count": 1, "origin": [0.0] * 3, "u": [1.0, 0.0, 0.0], "v": [0.0, 1.0, 0.0]},
        "arrow": {"scale": 0.0, "longest": portrait.LONGEST},
    }  # fmt: skip


def _place(name: str | None, objects: Sequence[str]) -> int:
    """Return the index of an object among the objects with a recorded position; -1 if it is not among them."""
    return objects.index(name) if name in objects else -1


def _widened(solid: Solid, middle: FloatArray, factor: float) -> Solid:
    """Enlarge the drawn part of an infinite surface to cover all of the motion."""
    if not solid.endless or solid.object is not None or len(solid.vertices) != 4:
        return solid
    whole = Surface(solid.vertices.mean(axis=0) + factor * (solid.vertices - solid.vertices.mean(axis=0)), solid.faces)
    return replace(solid, vertices=slid(whole, middle).vertices)


def _packed(values: FloatArray | None) -> dict[str, str] | None:
    return None if values is None else packed(values)


def _bounds(scenery: Scenery, motion: Motion) -> tuple[FloatArray, FloatArray]:
    """Compute two corners (3,) [m] of the box that contains everything drawn at any time, except distant outliers."""
    tips, room = motion.fingertips.reshape(-1, 3), ARROWS * scenery.extent
    corners = [tips - room, tips + room]
    for solid in scenery.solids:
        if solid.endless:
            continue
        if solid.object is None:
            corners.append(solid.vertices)
        elif solid.object in motion.poses:
            size = float(np.linalg.norm(solid.vertices, axis=1).max(initial=0.0)) / np.sqrt(3.0)
            place = motion.poses[solid.object][0]
            corners += [place - size, place + size]
    points = np.concatenate(corners)
    near = np.linalg.norm(points - scenery.middle, axis=1) < FAR * scenery.extent  # NaN is not near
    points = points[near] if near.any() else scenery.middle[None]
    return points.min(axis=0), points.max(axis=0)


def _camera(motion: Motion, dimensions: int, reach: float) -> dict[str, Any]:
    """Choose the direction to the camera.

    In a three-dimensional scene, the direction is the one that best shows the contacts in the frame with the most
    contacts. Other scenes are seen obliquely from the front.
    """
    towards = np.array(OBLIQUE) / np.linalg.norm(OBLIQUE)
    if dimensions == 3:
        tips = motion.fingertips[int((motion.states > 0).sum(axis=1).argmax())]
        tips = tips[np.isfinite(tips).all(axis=1)]
        out = tips - tips.mean(axis=0) if len(tips) else tips
        towards = painter.Camera(*painter.best_view(tips, out, reach)).axes[2]
    return {"towards": towards.tolist(), "field": FIELD}


def _grid(scenery: Scenery, low: FloatArray, middle: FloatArray, reach: float) -> dict[str, Any]:
    """Place a grid with a round cell size on the ground or, if the scene is not three-dimensional, behind the scene."""
    cell = nice(reach / CELLS * 1.001)
    origin = np.round(middle / cell) * cell
    ground = [each.vertices[:, 2].mean() for each in scenery.solids if each.endless]
    in_space = bool(scenery.up[2])
    origin[2] = (max(ground, default=low[2])) if in_space else -0.5 * SLAB * scenery.extent
    return {"cell": cell, "count": LINES, "origin": origin.tolist(), "u": [1.0, 0.0, 0.0], "v": [0.0, 1.0, 0.0]}


def _arrow_scale(motion: Motion, scenery: Scenery) -> float:
    """Choose the scale of arrows [m/N]; 0 if no finger exerts a force."""
    parts = (motion.force,) if motion.internal is None else (motion.internal, motion.external)
    forces = [np.linalg.norm(each, axis=2).max(axis=1) for each in parts if each is not None]
    sizes = np.concatenate([*forces, np.zeros(1)])
    sizes = sizes[np.isfinite(sizes) & (sizes > 0.0)]
    return portrait.LONGEST * scenery.extent / float(np.quantile(sizes, TYPICAL)) if len(sizes) else 0.0


def _charts(motion: Motion, scenery: Scenery, source: Source) -> list[dict[str, Any]]:
    """List the charts: forces on each object, as in `graspfx plot`, and penetration depths of the fingers.

    The lines of a recording contain values. A run has no values yet; all its lines are listed, in the order of
    `Motion.vectors`.
    """
    is_recorded, is_one = source == "recording", len(motion.squeeze) == 1
    charts = [
        _chart("Forces of the fingers" if is_one else f"Forces on {name}", "N", _forces(name, motion, source))
        for name in motion.squeeze
    ]
    if motion.depth is not None and (not is_recorded or np.isfinite(motion.depth).any()):
        lines = [
            _line(name, scenery.colours[i], DEPTH) | (_values(motion.depth[:, i]) if is_recorded else {})
            for i, name in enumerate(scenery.fingers)
        ]
        charts.append(_chart("Penetration depth of the fingers", "mm", lines))
    return charts


def _chart(title: str, unit: str, lines: list[dict[str, Any]]) -> dict[str, Any]:
    return {"title": title, "unit": unit, "lines": lines}


def _forces(name: str, motion: Motion, source: Source) -> list[dict[str, Any]]:
    """List the lines in the chart of an object: squeeze, push along each axis, and friction margin of the grip."""
    squeeze, push, is_recorded = motion.squeeze[name], motion.push[name], source == "recording"
    largest = Modes(squeeze, np.fmax(np.abs(push[..., 1]), np.abs(push[..., 2])))
    axes = pushes([largest]) if is_recorded else range(motion.dimensions)
    lines = [(_push(axis, motion.dimensions), push[:, axis]) for axis in axes]
    if not is_recorded or np.isfinite(squeeze).any():
        lines.insert(0, (_line("squeeze", SQUEEZE.colour, SQUEEZE.width), squeeze))
    margin = motion.margin.get(name) if source != "own" else None  # not computed by a page that runs a scene
    if margin is not None and (not is_recorded or np.isfinite(margin).any()):
        lines.append((_line("grip margin", "", MARGIN.width, (1.0, 2.0)), margin))
    return [line | (_values(values) if is_recorded else {}) for line, values in lines]


def _push(axis: int, dimensions: int) -> dict[str, Any]:
    dashes, along = PUSHES[axis].dashes, f" along {'xyz'[axis]}" if dimensions > 1 else ""
    drawn = () if isinstance(dashes, str) else dashes[1]
    return _line(f"push{along}", PUSHES[axis].colour, PUSHES[axis].width, drawn)


def _line(name: str, colour: str, width: float, dashes: tuple[float, ...] = ()) -> dict[str, Any]:
    return {"name": name, "colour": colour, "width": round(PIXELS * width, 2), "dashes": list(dashes)}


def _values(values: FloatArray) -> dict[str, Any]:
    return {"now": packed(values[:, 0]), "low": packed(values[:, 1]), "high": packed(values[:, 2])}


def _facts(recording: Recording, source: Source) -> str:
    fingers, objects = len(recording.layout.fingers), len(recording.layout.objects)
    scene = recording.header.scene
    parts = [
        f"Scene {Path(scene).stem}" if scene else "", f"{fingers} finger{'s' * (fingers != 1)}",
        f"{objects} object{'s' * (objects != 1)}" if objects > 1 else "",
        ("on a line", "in the plane", "in space")[recording.layout.dimensions - 1],
        (f"{recording.end:.4g} s in " if source == "recording" else "") + f"ticks of {1e3 * recording.period:g} ms"
        + (", run by this page" if source == "own" else ""),
    ]  # fmt: skip
    return ", ".join(each for each in parts if each)


def _description(recording: Recording, title: str) -> str:
    """Return a description of the picture for screen readers."""
    objects, fingers = ", ".join(recording.layout.objects), ", ".join(recording.layout.fingers)
    return f"{title}: the fingers {fingers} on {objects} in three dimensions, with their forces as arrows"


def _versions(recording: Recording, source: Source) -> list[tuple[str, str]]:
    """List the version of GraspFX, where the scene runs, and how to open recordings that the page writes."""
    lines = [
        ("GraspFX", recording.header.versions.get("graspfx", graspfx.__version__)),
        ("preset", recording.header.preset),
        *(
            [
                ("runs", "in this page, in WebAssembly; nothing is loaded or sent"),
                ("download", 'gx.Recording.load("recording.h5.part")'),
            ]
            if source == "own"
            else [("runs", "in the program that serves this page")]
        ),
    ]
    return [(name, words) for name, words in lines if words]


def _about(recording: Recording, motion: Motion) -> list[tuple[str, str]]:
    header = recording.header
    every = motion.rows * header.every
    lines = [
        ("recorded", header.created.replace("T", " ").replace("+00:00", " UTC")),
        ("preset", header.preset),
        ("GraspFX", header.versions.get("graspfx", graspfx.__version__)),
        ("frames", f"{len(motion)}, one in {every} ticks, {1.0 / (motion.rows * recording.row_period):.3g} per second"),
        ("chart", "minimum and maximum over all recorded rows"),
        ("numbers", f"as recorded, relative error {RESOLUTION:.0e}; linear interpolation between frames"),
    ]
    return [(name, words) for name, words in lines if words]


def _notes(recording: Recording, scenery: Scenery) -> list[str]:
    notes = [str(fault) for fault in recording.faults] + list(scenery.notes)
    if not recording.outcome.complete:
        notes.append("the run was interrupted or has not ended; the page shows the part that was recorded")
    if recording.layout.omitted:
        notes.append(f"columns that were not recorded: {', '.join(recording.layout.omitted)}")
    return notes


# Values of the scene --------------------------------------------------------------------------------------------------

GAINS = {  # gains of eq. (4) by key
    "coupling.external.stiffness": ("external stiffness, kep", "N/m"),
    "coupling.internal.stiffness": ("internal stiffness, kip", "N/m"),
    "coupling.external.damping": ("external damping, ked", "N s/m"),
    "coupling.internal.damping": ("internal damping, kid", "N s/m"),
    "coupling.friction": ("friction", ""),
}
OBJECTS = {
    "mass": ("mass", "kg"),
    "density": ("density", "kg/m³"),
    "viscosity": ("viscosity", "N s/m"),
    "rotational_viscosity": ("rotational viscosity", "N m s/rad"),
}
UNITS = {"stiffness": "N/m", "damping": "N s/m", "squeeze": "m", "offset": "m"} | {
    name: unit for name, (_, unit) in OBJECTS.items()
}
LONGEST_TEXT = 60  # longest text of a value
MOST_VALUES = 60  # most values listed

Table = Mapping[str, Any]


def values_of(recording: Recording) -> list[dict[str, Any]]:
    """List values of the scene with `key`, `label`, `unit` and `values`.

    `values` are pairs of text and the time from which it applies [s].
    """
    table = recording.header.scene_table
    rows = {key: (label, unit) for key, label, unit in _names(recording.layout.objects, table)}
    for change in recording.changes:
        rows.setdefault(change.key, (change.key, UNITS.get(change.key.rpartition(".")[2], "")))
    return [
        {"key": key, "label": label, "unit": unit, "values": _over_time(recording, key, table)}
        for key, (label, unit) in [*rows.items()][:MOST_VALUES]
    ]


def _names(objects: Sequence[str], table: Table) -> Iterator[tuple[str, str, str]]:
    """Yield key, label and unit of each gain and object parameter that the scene sets."""
    for key, (label, unit) in GAINS.items():
        if value_at(table, key) is not None:
            yield key, label, unit
    own = table.get("object", ())
    is_one = isinstance(own, Mapping)
    for i, name in enumerate(objects):
        for part, (label, unit) in OBJECTS.items():
            key = f"object.{part}" if is_one or len(objects) == 1 else f"object.{i}.{part}"
            if value_at(table, key) is not None:
                yield key, label if len(objects) == 1 else f"{label} of {name}", unit


def _over_time(recording: Recording, key: str, table: Table) -> list[tuple[float, str]]:
    start = value_at(table, key)
    changes = [(change.tick * recording.period, text_of(change.value)) for change in recording.changes
               if change.key == key]  # fmt: skip
    return [(0.0, "–" if start is None else text_of(start)), *changes]


def value_at(table: Any, key: str) -> Any:
    """Return the value at a dotted key in nested tables and lists; None if the key does not exist."""
    for part in key.split("."):
        if isinstance(table, list | tuple) and len(table) == 1 and not part.isdigit():
            table = table[0]
        if isinstance(table, Mapping) and part in table:
            table = table[part]
        elif isinstance(table, list | tuple) and part.isdigit() and int(part) < len(table):
            table = table[int(part)]
        else:
            return None
    return table


def text_of(value: Any) -> str:
    """Format a value as a short text."""
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list | tuple):
        return shorten(f"[{', '.join(map(text_of, value))}]")
    return shorten(str(value))


def shorten(text: str) -> str:
    """Shorten a text so that it fits into a table cell."""
    return text if len(text) <= LONGEST_TEXT else f"{text[: LONGEST_TEXT - 3]}..."
