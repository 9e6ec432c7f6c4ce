"""Rendering of surfaces in space as pixels and lines: camera, choice of the view, depth and shading."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from math import cos, radians, sin
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.show.picture.surfaces import Surface

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

PIXELS = 1560  # pixels along the longer side before averaging
REACH = 2  # radius in pixels: a point is hidden if all pixels around it are nearer
NEARER = 0.004  # offset of lines in front of their surface, as a fraction of the extent
SHORTEST = 0.006  # shortest visible or hidden piece of a line, as a fraction of the extent
OUTLINE = 0.8  # [points]
BEFORE = 0.02  # margin around the surfaces, as a fraction of the extent
CREASE = 30.0  # angle between triangles above which their edge is sharp [degrees]
WELD = 1e-7  # fraction of the extent below which corners coincide
BEHIND = -np.inf
ROUND = 1e-9  # tolerance for pixels on an edge, for rounding
AMBIENT, DIFFUSE, GLOSS = 0.55, 0.45, 0.14
SHARPNESS = 24.0
LIGHT = (-0.45, 0.65, 0.75)  # to the right, up, towards the viewer


class Layer:
    """Image that stores, for each pixel, the depth, normal and colour of the surface nearest to the viewer.

    Args:
        low, high: Lower left and upper right corner of the image in view coordinates, each (2,) [m].
        pixels: Number of pixels along the longer side.
    """

    def __init__(self, low: FloatArray, high: FloatArray, pixels: int) -> None:
        self.low, self.high = low, high
        self.cell = float((high - low).max()) / pixels
        width, height = np.maximum(np.ceil((high - low) / self.cell).astype(int), 1)
        self.depth = np.full((height, width), BEHIND)
        self.normal = np.zeros((height, width, 3), dtype=np.float32)
        self.colour = np.zeros((height, width, 3), dtype=np.float32)

    def add(self, corners: FloatArray, normals: FloatArray, colour: tuple[float, float, float]) -> None:
        """Draw triangles of one colour, given by corners (f, 3, 3) [m] and normals at the corners in view coordinates.

        View coordinates are the distances to the right, up, and towards the viewer.
        """
        flat = (corners[..., :2] - self.low) / self.cell - 0.5  # pixel k has its middle at k
        height, width = self.depth.shape
        first = np.maximum(np.ceil(flat.min(axis=1)).astype(int), 0)
        last = np.minimum(np.floor(flat.max(axis=1)).astype(int), [width - 1, height - 1])
        a, u, v = flat[:, 0], flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
        doubled = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
        nearest = np.full(self.depth.shape, -1, dtype=np.int32)
        places = np.zeros((*self.depth.shape, 2), dtype=np.float32)
        depths = corners[:, :, 2]
        for k in np.flatnonzero((first <= last).all(axis=1) & (doubled != 0.0)):
            (x0, y0), (x1, y1) = first[k], last[k]
            box = np.s_[y0 : y1 + 1, x0 : x1 + 1]
            x = np.arange(x0, x1 + 1) - a[k, 0]
            y = (np.arange(y0, y1 + 1) - a[k, 1])[:, None]
            s = (x * v[k, 1] - y * v[k, 0]) / doubled[k]
            t = (y * u[k, 0] - x * u[k, 1]) / doubled[k]
            z = depths[k, 0] + s * (depths[k, 1] - depths[k, 0]) + t * (depths[k, 2] - depths[k, 0])
            near = (s >= -ROUND) & (t >= -ROUND) & (s + t <= 1.0 + ROUND) & (z > self.depth[box])
            self.depth[box][near] = z[near]
            nearest[box][near] = k
            places[box][near, 0], places[box][near, 1] = s[near], t[near]
        fresh = nearest >= 0
        own, (s, t) = normals[nearest[fresh]], places[fresh].T[:, :, None]
        self.normal[fresh] = (1.0 - s - t) * own[:, 0] + s * own[:, 1] + t * own[:, 2]
        self.colour[fresh] = colour

    def shaded(self) -> NDArray[np.float32]:
        """Return the image (h, w, 4) shaded by the Blinn-Phong model; pixels without a surface are transparent."""
        light = np.array(LIGHT, dtype=np.float32) / np.float32(np.linalg.norm(LIGHT))
        half = light + np.array([0.0, 0.0, 1.0], dtype=np.float32)
        half /= np.linalg.norm(half)
        seen = self.depth > BEHIND
        n = self.normal[seen]
        n /= np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-12)
        matt = AMBIENT + DIFFUSE * np.clip(n @ light, 0.0, None)
        gloss = GLOSS * np.clip(n @ half, 0.0, None) ** SHARPNESS
        rgba = np.zeros((*self.depth.shape, 4), dtype=np.float32)
        rgba[seen, :3] = np.clip(self.colour[seen] * matt[:, None] + gloss[:, None], 0.0, 1.0)
        rgba[seen, 3] = 1.0
        return rgba

    @cached_property
    def clear(self) -> FloatArray:
        """Depth of the farthest surface within `REACH` pixels of each pixel; points behind this depth are hidden."""
        from scipy.ndimage import minimum_filter

        return np.asarray(minimum_filter(self.depth, 2 * REACH + 1, mode="nearest"))

    def shows(self, points: FloatArray, nearer: float) -> BoolArray:
        """Return a mask (k,) of the visible points among `points` (k, 3), in view coordinates [m].

        Before the comparison with the depth of the image, the points are moved towards the viewer by `nearer` [m].
        """
        flat, (height, width) = points[:, :2], self.depth.shape
        inside = ((flat >= self.low) & (flat <= self.high)).all(axis=1)
        column, row = np.clip(np.floor((flat - self.low) / self.cell).astype(int), 0, [width - 1, height - 1]).T
        return np.asarray(~inside | (points[:, 2] + nearer >= self.clear[row, column]))


def halved(rgba: NDArray[np.float32]) -> NDArray[np.float32]:
    """Halve the resolution of an image by averaging blocks of two by two pixels, which smooths the edges."""
    height, width = (size // 2 for size in rgba.shape[:2])
    four = rgba[: 2 * height, : 2 * width].reshape(height, 2, width, 2, 4)
    alpha = four[..., 3:].sum(axis=(1, 3))
    colour = (four[..., :3] * four[..., 3:]).sum(axis=(1, 3)) / np.maximum(alpha, 1e-12)
    return np.concatenate([colour, alpha / 4.0], axis=2, dtype=np.float32)


def weld(vertices: FloatArray, faces: IntArray) -> IntArray:
    """Renumber the vertices in `faces` (f, 3) so that coincident vertices have the same number."""
    extent = float(np.ptp(vertices, axis=0).max()) or 1.0
    _, label = np.unique(np.round(vertices / (WELD * extent)), axis=0, return_inverse=True)
    return np.asarray(label.reshape(-1)[faces], dtype=np.int64)


def corner_normals(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Return unit normals at the corners of faces (f, 3, 3), for smooth shading.

    Each normal is the area-weighted mean of the normals of the faces at this corner that differ from the face's own
    normal by less than `CREASE` degrees.
    """
    corners = vertices[faces]
    doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])  # by area
    lengths = np.linalg.norm(doubled, axis=1, keepdims=True)
    unit = doubled / np.where(lengths > 0.0, lengths, 1.0)
    label = weld(vertices, faces).reshape(-1)
    order = np.argsort(label, kind="stable")
    starts = np.flatnonzero(np.r_[True, np.diff(label[order]) > 0])
    counts = np.diff(np.r_[starts, len(label)])
    group = np.repeat(np.arange(len(starts)), counts)
    one = np.repeat(np.arange(len(label)), counts[group])  # every pair of corners at one place
    two = np.arange(len(one)) - np.repeat(np.cumsum(counts[group]) - counts[group], counts[group])
    two = order[starts[group][one] + two]
    here, there = order[one] // 3, two // 3
    smooth = (unit[here] * unit[there]).sum(axis=1) > cos(radians(CREASE))
    normals = np.zeros((len(label), 3))
    np.add.at(normals, order[one][smooth], doubled[there][smooth])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    own = np.repeat(unit, 3, axis=0)
    return np.where(lengths > 0.0, normals / np.where(lengths > 0.0, lengths, 1.0), own).reshape(-1, 3, 3)


@dataclass(frozen=True)
class Camera:
    """Orthographic camera, given by the direction to the viewer.

    Args:
        azimuth: Angle of the direction from x towards y [degrees].
        elevation: Angle of the direction above the plane of x and y [degrees].
    """

    azimuth: float
    elevation: float

    @property
    def axes(self) -> FloatArray:
        """Matrix (3, 3) whose rows are the unit vectors to the right, up, and towards the viewer."""
        a, e = radians(self.azimuth), radians(self.elevation)
        return np.array(
            [
                [-sin(a), cos(a), 0.0],
                [-sin(e) * cos(a), -sin(e) * sin(a), cos(e)],
                [cos(e) * cos(a), cos(e) * sin(a), sin(e)],
            ]
        )

    def project(self, points: ArrayLike) -> FloatArray:
        """Return view coordinates (..., 3) of points (..., 3) [m]: to the right, up, and towards the viewer."""
        return np.asarray(np.asarray(points, dtype=float) @ self.axes.T)


class Solid(NamedTuple):
    """A surface in space with its appearance.

    Attributes:
        surface: Surface in the world frame.
        colour: Colour of the surface.
        both_sides: Whether the surface is open and both of its sides are drawn.
        hides: Whether lines behind the surface are hidden; False for a fingertip, which would hide its force's arrow.
    """

    surface: Surface
    colour: str
    both_sides: bool = False
    hides: bool = True


class Painter:
    """Renders surfaces and determines which points are hidden behind them.

    Args:
        camera: Camera of the view.
        extent: Size of the picture [m].
        solids: Surfaces to render.

    Attributes:
        bounds: Lower left and upper right corner (2, 2) of all surfaces in view coordinates [m].
    """

    def __init__(self, camera: Camera, extent: float, solids: Sequence[Solid]) -> None:
        self.camera, self.extent, self._solids = camera, extent, solids
        flat = np.concatenate([camera.project(each.surface.vertices)[:, :2] for each in solids])
        self.bounds = np.array([flat.min(axis=0), flat.max(axis=0)])
        room = BEFORE * extent
        self._hiding = Layer(self.bounds[0] - room, self.bounds[1] + room, PIXELS)
        self._paint(self._hiding, hides=True)
        self._all = deepcopy(self._hiding)
        self._paint(self._all, hides=False)

    def draw(self, axes: Axes, outline: str) -> None:
        """Render the surfaces, and draw their visible creases and silhouettes in the colour `outline`."""
        from matplotlib.collections import LineCollection

        layer = self._all
        rgba = halved(layer.shaded())
        height, width = rgba.shape[:2]
        (x0, y0), size = layer.low, 2.0 * layer.cell
        extent = (x0, x0 + width * size, y0, y0 + height * size)
        axes.imshow(rgba, extent=extent, origin="lower", interpolation="antialiased", zorder=1.0, aspect="equal")
        for solid in self._solids:
            cuts = (self._cut(ends, layer, 0.0) for ends in _edges(solid.surface, self.camera))
            pieces = [piece[[0, -1], :2] for each in cuts for piece, visible in each if visible]
            axes.add_collection(
                LineCollection(pieces, colors=outline, linewidths=OUTLINE, capstyle="round", zorder=1.2), autolim=False
            )

    def pieces(self, points: FloatArray, *, before_all: bool = False) -> Iterator[tuple[FloatArray, bool]]:
        """Yield the visible and hidden pieces of a polyline.

        Args:
            points: Vertices of the polyline in the world frame (k, 3) [m].
            before_all: Whether surfaces with `hides=False`, such as fingertips, also hide the polyline.

        Yields:
            Points of a piece in view coordinates (j, 3) [m], and whether the piece is visible.
        """
        return self._cut(points, self._all if before_all else self._hiding, SHORTEST * self.extent)

    def hidden(self, points: FloatArray) -> BoolArray:
        """Return a mask (n,) of the points (n, 3) that are behind a surface with `hides=True`."""
        return ~self._hiding.shows(self.camera.project(points), NEARER * self.extent)

    def _paint(self, layer: Layer, *, hides: bool) -> None:
        """Draw the surfaces whose attribute `hides` equals the argument `hides` into a layer."""
        from matplotlib.colors import to_rgb

        for surface, colour, both_sides, _ in (each for each in self._solids if each.hides == hides):
            corners = self.camera.project(surface.vertices)[surface.faces]
            normals = self.camera.project(corner_normals(surface.vertices, surface.faces))
            facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2]
            if both_sides:
                normals = normals * np.where(facing < 0.0, -1.0, 1.0)[:, None, None]
                facing = np.abs(facing)
            front = facing > 0.0
            layer.add(corners[front], normals[front], to_rgb(colour))

    def _cut(self, points: FloatArray, layer: Layer, shortest: float) -> Iterator[tuple[FloatArray, bool]]:
        seen, step = self.camera.project(points), 2.0 * layer.cell
        cuts = [
            a + np.linspace(0.0, 1.0, 1 + int(np.linalg.norm(b[:2] - a[:2]) / step), endpoint=False)[:, None] * (b - a)
            for a, b in pairwise(seen)
        ]
        line = np.concatenate([*cuts, seen[-1:]])
        visible = layer.shows(line, NEARER * self.extent)
        for begin, end in _runs(visible, int(shortest / step)):
            yield line[begin : min(end + 1, len(line))], bool(visible[(begin + end) // 2])


def _runs(visible: BoolArray, least: int) -> list[tuple[int, int]]:
    """Return start and end of each run of equal values; runs of up to `least` values join the previous run."""
    ends = [0, *(np.flatnonzero(np.diff(visible)) + 1).tolist(), len(visible)]
    runs: list[tuple[int, int]] = []
    for begin, end in pairwise(ends):
        if runs and (end - begin <= least or visible[begin] == visible[runs[-1][0]]):
            runs[-1] = (runs[-1][0], end)
        else:
            runs.append((begin, end))
    return runs


def _edges(solid: Surface, camera: Camera) -> Sequence[FloatArray]:
    """Return the edges of a surface to draw, each (2, 3): creases on the front, the silhouette and the boundary."""
    f = weld(solid.vertices, solid.faces)
    corners = solid.vertices[solid.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    whole = lengths > 1e-14 * float(np.ptp(solid.vertices, axis=0).max()) ** 2
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
    return list(ends[first[visible]])


ELEVATIONS = (22.0, 35.0, 50.0)
FRONT = -60.0  # default azimuth [degrees]
ALONG_AN_AXIS = (45, 60, 75)  # azimuths relative to FRONT at which a face of a box is almost edge-on [degrees]


def best_view(contacts: FloatArray, out: FloatArray, extent: float) -> tuple[float, float]:
    """Find the view in which the contacts face the viewer and are well separated.

    Among equally good views, the view nearest to the default view is selected.

    Args:
        contacts: Contact points (n, 3) [m].
        out: Outward directions of the object at the contact points (n, 3).
        extent: Size of the drawing [m].

    Returns:
        Azimuth and elevation [degrees].
    """
    lengths = np.linalg.norm(out, axis=1)
    out = out[lengths > 0.0] / lengths[lengths > 0.0, None]
    best, angles = -np.inf, (FRONT, ELEVATIONS[0])
    for elevation in ELEVATIONS:
        for turn in range(0, 360, 15):
            azimuth = FRONT + turn
            if turn % 90 in ALONG_AN_AXIS:
                continue
            project = Camera(azimuth, elevation).project
            facing = project(out)[:, 2] if len(out) else np.zeros(1)
            flat = project(contacts)[:, :2] / extent
            apart = np.linalg.norm(flat[:, None] - flat, axis=2) + np.eye(len(flat))
            worth = (
                np.clip(facing + 0.35, 0.0, 0.6).sum() + 0.5 * np.clip(apart.min(axis=1, initial=0.2), 0.0, 0.2).sum()
            )
            worth -= 1e-3 * (min(turn, 360 - turn) / 15 + abs(elevation - ELEVATIONS[0]) / 15)
            if worth > best + 1e-9:
                best, angles = worth, (azimuth, elevation)
    return angles
