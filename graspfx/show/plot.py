"""The figure of a run: where object and fingers were, and how far the fingers went into the object."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike, fspath
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from graspfx.loop.record import Recording

FloatArray = NDArray[np.float64]

MM = 1e3
OBJECT = "#1a1a1a"
FINGERS = ("#c1272d", "#0071bc", "#39803a", "#8e44ad", "#d35400", "#128c8c")
ASTRAY = "#e07b00"
CONTACTS = "#6b6b6b"
GAINS = ("coupling.external.stiffness", "coupling.internal.stiffness")
GRID = "#e4e4e4"
SMALL = 9.0  # [points]
LONGEST_TITLE = 56  # characters in a line
MOST_POINTS = 6000  # per line: more than a picture can show


def figure(recordings: Sequence[Recording], path: str | PathLike[str], titles: Sequence[str] | None = None) -> Path:
    """Draws one recording, or several side by side with shared axes, in the manner of Kawai and Yoshikawa, Figs. 12-13.

    Above, along the axis of main motion: the first object solid, its fingers dashed. Below, for two fingers: the
    distance between them solid, that between the object and their centre dashed, and dotted the distance at which they
    would just touch; for another number of fingers, each finger's distance from their centre solid.

    Args:
        recordings: one or more.
        path: of the picture; its ending chooses the format.
        titles: one per recording; the scene and its overrides if not given.

    Returns:
        The path.

    Raises:
        InputError: no recordings, or one without a tick.
    """
    if not recordings or not all(len(recording) for recording in recordings):
        raise InputError("recordings", len(recordings), "one or more recordings with at least one tick each")
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    names = list(titles) if titles is not None else [_title(recording) for recording in recordings]
    columns = len(recordings)
    picture = Figure(figsize=(2.2 + 4.6 * columns, 5.8), layout="constrained")
    FigureCanvasAgg(picture)
    axes = picture.subplots(2, columns, squeeze=False, sharex=True, sharey="row")
    for column, recording in enumerate(recordings):
        _draw_positions(axes[0, column], recording)
        _draw_distances(axes[1, column], recording)
        axes[0, column].set_title(names[column], loc="left", fontweight="bold", fontsize=SMALL + 1.0)
        axes[1, column].set_xlabel("time [s]", fontsize=SMALL)
    axes[0, 0].set_ylabel(f"position {_axis_name(recordings[0])} [mm]", fontsize=SMALL)
    axes[1, 0].set_ylabel("distance [mm]", fontsize=SMALL)
    for letter, row in zip("ab", axes, strict=True):
        row[0].text(-0.13, 1.02, f"({letter})", transform=row[0].transAxes, fontweight="bold", fontsize=SMALL)
        _add_legend(row[-1])
    for each in axes.flat:
        _tidy(each)
    picture.savefig(fspath(path), dpi=150)
    return Path(path)


def main_axis(recording: Recording) -> int:
    """The axis along which the first object moves most; the fingers', if it does not move."""
    spread = np.ptp(recording.object_position, axis=0)
    if not spread.any():
        spread = np.ptp(recording.finger_position, axis=0).max(axis=0)
    return int(np.argmax(spread))


def _draw_positions(axes: Axes, recording: Recording) -> None:
    a, every = main_axis(recording), _every(recording)
    t = recording.time[::every]
    for number, i in enumerate(_fingers(recording)):
        axes.plot(
            t, MM * recording.finger_position[::every, i, a], "--", linewidth=1.1,
            color=FINGERS[number % len(FINGERS)], label=recording.layout.fingers[i],
        )  # fmt: skip
    axes.plot(t, MM * recording.object_position[::every, a], linewidth=1.6, color=OBJECT, label="object")


def _draw_distances(axes: Axes, recording: Recording) -> None:
    every = _every(recording)
    t, fingers = recording.time[::every], _fingers(recording)
    p = recording.finger_position[::every][:, fingers]  # (N, n, d)
    centre = p.mean(axis=1)
    if len(fingers) == 2:
        c = recording.contact_position[::every][:, fingers]
        touch = np.linalg.norm(c[:, 1] - c[:, 0], axis=1)
        if touch.any():  # contacts attached to the object's centre have none
            axes.plot(t, MM * touch, ":", linewidth=1.0, color=CONTACTS, label="between contact points")
        apart = np.linalg.norm(p[:, 1] - p[:, 0], axis=1)
        axes.plot(t, MM * apart, linewidth=1.6, color=OBJECT, label="between fingers")
    else:
        for number, i in enumerate(fingers):
            away = np.linalg.norm(p[:, number] - centre, axis=1)
            name = f"{recording.layout.fingers[i]} to centre"
            axes.plot(t, MM * away, linewidth=1.4, color=FINGERS[number % len(FINGERS)], label=name)
    astray = np.linalg.norm(recording.object_position[::every] - centre, axis=1)
    axes.plot(t, MM * astray, "--", linewidth=1.2, color=ASTRAY, label="object to centre of fingers")
    axes.set_ylim(bottom=0.0)


def _fingers(recording: Recording) -> list[int]:
    """Those of the first object; all, if it has none."""
    own = [i for i, thing in enumerate(recording.layout.finger_objects) if thing == 0]
    return own or list(range(len(recording.layout.fingers)))


def _every(recording: Recording) -> int:
    return max(1, len(recording) // MOST_POINTS)


def _tidy(axes: Axes) -> None:
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color=GRID, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=SMALL)


def _add_legend(axes: Axes) -> None:
    lines = sorted(axes.get_lines(), key=lambda line: line.get_linestyle() != "-")
    axes.legend(
        handles=lines, loc="upper left", bbox_to_anchor=(1.0, 1.0), handlelength=2.6, frameon=False, fontsize=SMALL
    )


def _axis_name(recording: Recording) -> str:
    return "xyz"[main_axis(recording)]


def _title(recording: Recording) -> str:
    """The scene, its gains, and what else was set for this run."""
    header = recording.header
    name = fill(header.title or Path(header.scene).stem or "run", LONGEST_TITLE)
    others = [f"{key} = {value}" for key, value in header.overrides.items() if key not in GAINS]
    return "\n".join([name, ", ".join([*_gains(header.scene_table), *others])]).rstrip()


def _gains(scene: Mapping[str, Any]) -> list[str]:
    coupling = scene.get("coupling", {})
    kep, kip = (coupling.get(share, {}).get("stiffness") for share in ("external", "internal"))
    if not isinstance(kep, int | float) or not isinstance(kip, int | float):
        return []
    if kep == kip:
        return [rf"$k_p$ = {kep:g} N/m"]
    return [rf"$k_{{ep}}$ = {kep:g}, $k_{{ip}}$ = {kip:g} N/m"]
