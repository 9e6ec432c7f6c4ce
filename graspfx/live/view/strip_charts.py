"""Strip charts of the last seconds: squeeze and push, and penetration depth of the fingers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx.live.frame import Frames
from graspfx.loop.columns import Layout
from graspfx.show.style import EXTERNAL, FINGERS, INK, INTERNAL, NOTE

if TYPE_CHECKING:
    import viser

FloatArray = NDArray[np.float64]

SECONDS = 6.0  # time shown [s]
EVERY = 0.02  # interval between points [s]
COUNT = int(SECONDS / EVERY)
DASHES: tuple[list[int] | None, ...] = (None, [6, 3], [2, 2])  # line styles of x, y and z, as in figures
HEIGHT = 190  # height of a chart [pixels]


class StripCharts:
    """Strip charts; the right edge is the present time.

    Args:
        server: Server of the page.
        fingers: Names of the fingers.
        layout: Columns of the rows; depth and friction margin are drawn if they are recorded.
    """

    def __init__(self, server: viser.ViserServer, fingers: tuple[str, ...], layout: Layout) -> None:
        has_depth = "gap" in layout.columns
        self._has_margin = has_margin = "grip_margin" in [column.name for column in layout.derived]
        self._axes = min(layout.dimensions, 3)
        self._time = np.linspace(-SECONDS + EVERY, 0.0, COUNT)
        self._forces = np.zeros((1 + self._axes + has_margin, COUNT))
        self._depths = np.zeros((len(fingers), COUNT))
        pushes = [
            _series(f"push {'xyz'[axis]} [N]", EXTERNAL, DASHES[axis], 2.0 if axis == 0 else 1.5)
            for axis in range(self._axes)
        ]
        squeeze = _series("squeeze, mean [N]", INTERNAL, None, 2.5)
        margin = [_series("grip margin [N]", INK, None, 1.5)] if has_margin else []
        self._force_chart = _chart(server, "Force [N]", self._time, self._forces, [squeeze, *pushes, *margin])
        own = [_series(name, FINGERS[i % len(FINGERS)], None, 1.5) for i, name in enumerate(fingers)]
        self._depth_chart = (
            _chart(server, "Depth of fingers [mm]", self._time, self._depths, own) if has_depth else None
        )
        self._next = -np.inf

    def clear(self) -> None:
        """Clear the charts, for example for a new run."""
        self._forces[:], self._depths[:], self._next = 0.0, 0.0, -np.inf

    def wants(self, time: float) -> bool:
        """Tell whether a row at this time [s] adds a point."""
        return time < self._next - 1.0 or time >= self._next

    def add(self, frames: Frames) -> None:
        """Add the last frame as a point."""
        time = float(frames.time[-1])
        if time < self._next - 1.0:  # a new run, or an earlier time of a recording
            self.clear()
        steps = 1 if not np.isfinite(self._next) else 1 + min(COUNT - 1, int((time - self._next) / EVERY))
        self._next = time + EVERY if not np.isfinite(self._next) else self._next + steps * EVERY
        squeezes = [each for each in frames.modes.values() if np.isfinite(each.mean_squeeze[-1])]
        point = np.zeros(len(self._forces))
        if frames.modes:
            first = squeezes[0] if squeezes else next(iter(frames.modes.values()))
            point[0], point[1 : 1 + self._axes] = first.mean_squeeze[-1], first.push[-1][: self._axes]
        if self._has_margin:
            point[-1] = frames.history.grip_margin[-1]
        _shift(self._forces, np.nan_to_num(point), steps)
        if self._depth_chart is not None:
            gap = frames.history.array("gap")[-1]
            _shift(self._depths, 1e3 * np.maximum(0.0, -np.nan_to_num(gap)), steps)

    def draw(self) -> None:
        """Send the charts to the page; the abscissa is the run's time."""
        time = self._time + (self._next - EVERY if np.isfinite(self._next) else 0.0)
        self._force_chart.data = (time, *self._forces.copy())
        if self._depth_chart is not None:
            self._depth_chart.data = (time, *self._depths.copy())


def _shift(values: FloatArray, point: FloatArray, steps: int) -> None:
    values[:, :-steps] = values[:, steps:]
    values[:, -steps:] = point[:, None]


def _series(label: str, colour: str, dash: list[int] | None, width: float) -> dict[str, Any]:
    return {"label": label, "stroke": colour, "width": width, "points": {"show": False}} | (
        {"dash": dash} if dash else {}
    )


def _chart(
    server: viser.ViserServer, title: str, time: FloatArray, values: FloatArray, series: list[dict[str, Any]]
) -> Any:
    axis: Any = {"stroke": NOTE, "font": "11px sans-serif", "ticks": {"show": False}, "gap": 4}
    axes: Any = (axis | {"size": 28}, axis | {"size": 40})
    return server.gui.add_uplot(
        (time, *values), ({"label": "time [s]"}, *series),  # type: ignore[arg-type]
        title=title, height=HEIGHT, scales={"x": {"time": False, "auto": True}, "y": {"auto": True}},
        axes=axes, padding=(8, 12, 0, 0), legend={"live": False},
    )  # fmt: skip
