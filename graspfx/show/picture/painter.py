"""Triangles and lines in space drawn from far to near, shaded, on flat axes: a parallel projection."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import cos, radians, sin
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.show.picture.surfaces import Surface, finer

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FloatArray = NDArray[np.float64]

CELL = 1.0 / 36.0  # longest side of what is sorted by its middle, as a share of the picture
NEARER = 0.012  # by which lines on a surface come before it, as a share of the picture
CREASE = 30.0  # [degrees] between triangles, from which on their edge is drawn
AMBIENT, DIFFUSE, GLOSS = 0.52, 0.48, 0.16
SHARPNESS = 24.0
SEAM = 0.3  # [points]: the stroke that closes the hairlines between neighbours
OUTLINE = 0.8  # [points]
LIGHT = (-0.45, 0.65, 0.75)  # to the right, up, towards the viewer


@dataclass(frozen=True)
class Camera:
    """A viewer infinitely far away.

    Args:
        azimuth: [degrees] from x towards y.
        elevation: [degrees] above the plane of x and y.
    """

    azimuth: float
    elevation: float

    @property
    def axes(self) -> FloatArray:
        """To the right, up and towards the viewer, unit vectors in rows (3, 3)."""
        a, e = radians(self.azimuth), radians(self.elevation)
        return np.array(
            [
                [-sin(a), cos(a), 0.0],
                [-sin(e) * cos(a), -sin(e) * sin(a), cos(e)],
                [cos(e) * cos(a), cos(e) * sin(a), sin(e)],
            ]
        )

    def project(self, points: ArrayLike) -> FloatArray:
        """Project points (..., 3) to right, up and nearness (..., 3) [m]."""
        return np.asarray(np.asarray(points, dtype=float) @ self.axes.T)


@dataclass
class Painter:
    """Collects what is to be seen, then draws all of it in one go, so that everything hides what is behind it.

    Args:
        camera: from where it is seen.
        extent: size of the picture [m].
    """

    camera: Camera
    extent: float
    _corners: list[FloatArray] = field(default_factory=list)  # (k, 3, 3) as seen
    _depths: list[FloatArray] = field(default_factory=list)
    _faces: list[FloatArray] = field(default_factory=list)  # colours, with alpha zero for lines
    _edges: list[FloatArray] = field(default_factory=list)
    _widths: list[FloatArray] = field(default_factory=list)
    _hiding: list[FloatArray] = field(default_factory=list)

    def add(self, solid: Surface, colour: str, *, outline: str = "", both_sides: bool = False) -> None:
        """Add a surface of this colour; with an outline, its creases and its rim against what is behind.

        Args:
            both_sides: it is open, and seen from behind too.
        """
        corners = self.camera.project(finer(solid, CELL * self.extent).vertices.reshape(-1, 3, 3))
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        lengths = np.linalg.norm(normals, axis=1)
        whole = lengths > 0.0
        corners, normals = corners[whole], normals[whole] / lengths[whole, None]
        if both_sides:
            normals[normals[:, 2] < 0.0] *= -1.0
        front = normals[:, 2] > 0.0
        corners, colours = corners[front], _shaded(normals[front], colour)
        self._put(corners, colours, colours, SEAM)
        self._hiding.append(corners)
        if outline:
            self.segments(_edges(solid, self.camera), outline, OUTLINE)

    def line(self, points: FloatArray, colour: str, width: float) -> None:
        """Add a line through points (k, 3), hidden where something is before it."""
        self.segments(np.stack([points[:-1], points[1:]], axis=1), colour, width)

    def segments(self, ends: FloatArray, colour: str, width: float) -> None:
        """Add straight pieces (k, 2, 3), each hidden where something is before it."""
        from matplotlib.colors import to_rgba

        if not len(ends):
            return
        longest = CELL * self.extent
        parts = []
        for a, b in ends:
            steps = 1 + int(np.linalg.norm(b - a) / longest)
            cuts = a + np.linspace(0.0, 1.0, steps + 1)[:, None] * (b - a)
            parts.append(np.stack([cuts[:-1], cuts[1:], cuts[1:]], axis=1))
        corners = self.camera.project(np.concatenate(parts))
        edges = np.tile(to_rgba(colour), (len(corners), 1))
        self._put(corners, np.zeros((len(corners), 4)), edges, width, NEARER * self.extent)

    def hidden(self, points: FloatArray) -> NDArray[np.bool_]:
        """Tell which of points (n, 3) are behind a surface that was added so far."""
        projected = self.camera.project(points)
        mask = np.zeros(len(projected), dtype=bool)
        if not self._hiding:
            return mask
        a, b, c = np.moveaxis(np.concatenate(self._hiding), 1, 0)
        doubled = _cross(b - a, c - a)
        with np.errstate(divide="ignore", invalid="ignore"):
            for i, p in enumerate(projected):
                u, v = _cross(p - a, c - a) / doubled, _cross(b - a, p - a) / doubled
                inside = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0)
                nearness = a[:, 2] + u * (b - a)[:, 2] + v * (c - a)[:, 2]
                mask[i] = bool((nearness[inside] > p[2] + 2.0 * NEARER * self.extent).any())
        return mask

    def bounds(self) -> FloatArray:
        """Lower and upper corner (2, 2) of all surfaces that were added, to the right and up; lines may leave them."""
        flat = np.concatenate(self._hiding)[..., :2].reshape(-1, 2)
        return np.array([flat.min(axis=0), flat.max(axis=0)])

    def draw(self, axes: Axes) -> None:
        """Draw everything, from far to near."""
        from matplotlib.collections import PolyCollection

        order = np.argsort(np.concatenate(self._depths), kind="stable")
        corners = np.concatenate(self._corners)[order, :, :2]
        drawn = PolyCollection(
            corners,  # type: ignore[arg-type]
            facecolors=np.concatenate(self._faces)[order],
            edgecolors=np.concatenate(self._edges)[order],
            linewidths=np.concatenate(self._widths)[order],
            joinstyle="round", capstyle="round", zorder=1,
        )  # fmt: skip
        axes.add_collection(drawn, autolim=False)

    def _put(
        self, corners: FloatArray, faces: FloatArray, edges: FloatArray, width: float, nearer: float = 0.0
    ) -> None:
        self._corners.append(corners)
        self._depths.append(corners[:, :, 2].mean(axis=1) + nearer)
        self._faces.append(faces)
        self._edges.append(edges)
        self._widths.append(np.full(len(corners), width))


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _shaded(normals: FloatArray, colour: str) -> FloatArray:
    """Shade by Blinn and Phong: ambient, diffuse and gloss, for normals as seen (f, 3)."""
    from matplotlib.colors import to_rgb

    light = np.array(LIGHT) / np.linalg.norm(LIGHT)
    half = light + np.array([0.0, 0.0, 1.0])
    half /= np.linalg.norm(half)
    matt = AMBIENT + DIFFUSE * np.clip(normals @ light, 0.0, None)
    gloss = GLOSS * np.clip(normals @ half, 0.0, None) ** SHARPNESS
    rgb = np.clip(np.array(to_rgb(colour)) * matt[:, None] + gloss[:, None], 0.0, 1.0)
    return np.column_stack([rgb, np.ones(len(rgb))])


def _edges(solid: Surface, camera: Camera) -> FloatArray:
    """List edges (k, 2, 3) at creases that are seen, at the rim, and where a surface ends."""
    extent = float(np.ptp(solid.vertices, axis=0).max())
    _, label = np.unique(np.round(solid.vertices / (1e-7 * extent)), axis=0, return_inverse=True)
    f = label.reshape(-1)[solid.faces]
    corners = solid.vertices[solid.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    whole = lengths > 1e-14 * extent**2
    f, corners, normals = f[whole], corners[whole], normals[whole] / lengths[whole, None]
    front = camera.project(normals)[:, 2] > 0.0
    ends = np.stack([corners, corners[:, [1, 2, 0]]], axis=2).reshape(-1, 2, 3)
    sides = np.sort(np.stack([f, f[:, [1, 2, 0]]], axis=2).reshape(-1, 2), axis=1)
    owner = np.repeat(np.arange(len(f)), 3)
    _, first, group, count = np.unique(sides, axis=0, return_index=True, return_inverse=True, return_counts=True)
    last = np.zeros(len(first), dtype=np.int64)
    last[group.reshape(-1)] = np.arange(len(sides))
    one, two = owner[first], owner[last]
    crease = (normals[one] * normals[two]).sum(axis=1) < cos(radians(CREASE))
    visible = (crease & (front[one] | front[two])) | (front[one] != front[two]) | (count == 1)
    return np.asarray(ends[first[visible]])
