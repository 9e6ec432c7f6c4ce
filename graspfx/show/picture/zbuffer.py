"""Triangles in space as pixels: of all that lie behind one another the nearest, smooth where the surface is."""

from __future__ import annotations

from math import cos, radians

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

CREASE = 30.0  # [degrees] between triangles, from which on their edge is sharp
WELD = 1e-7  # of the extent: corners nearer to one another are one
BEHIND = -np.inf
ROUND = 1e-9  # by which rounding may put a pixel on an edge beside it
AMBIENT, DIFFUSE, GLOSS = 0.55, 0.45, 0.14
SHARPNESS = 24.0
LIGHT = (-0.45, 0.65, 0.75)  # to the right, up, towards the viewer


class Layer:
    """Pixels with the depth and the colour of what is nearest.

    Args:
        low, high: corners of what is seen, to the right and up (2,) [m].
        pixels: along the longer side.
    """

    def __init__(self, low: FloatArray, high: FloatArray, pixels: int) -> None:
        self.low, self.high = low, high
        self.cell = float((high - low).max()) / pixels
        width, height = np.maximum(np.ceil((high - low) / self.cell).astype(int), 1)
        self.depth = np.full((height, width), BEHIND)
        self.normal = np.zeros((height, width, 3), dtype=np.float32)
        self.colour = np.zeros((height, width, 3), dtype=np.float32)

    def add(self, corners: FloatArray, normals: FloatArray, colour: tuple[float, float, float]) -> None:
        """Add triangles: corners as seen (f, 3, 3) [m], the surface's normals there (f, 3, 3)."""
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
        """Shade by Blinn and Phong: ambient, diffuse and gloss; (h, w, 4), transparent where nothing is."""
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

    def clear_depth(self, reach: int) -> FloatArray:
        """Give at each pixel the farthest depth within a reach: what lies behind that is hidden, also at rims."""
        depth = self.depth.copy()
        for one in (depth, depth.T):  # along columns, then along rows
            whole = one.copy()
            for k in range(1, reach + 1):
                np.minimum(one[k:], whole[:-k], out=one[k:])
                np.minimum(one[:-k], whole[k:], out=one[:-k])
        return depth

    def copy(self) -> Layer:
        """Copy the layer, to add more to it."""
        other = Layer.__new__(Layer)
        other.low, other.high, other.cell = self.low, self.high, self.cell
        other.depth, other.normal, other.colour = self.depth.copy(), self.normal.copy(), self.colour.copy()
        return other

    def pixel(self, flat: FloatArray) -> IntArray:
        """Find the pixels (row, column) of points (k, 2) [m]; of one outside, the nearest."""
        height, width = self.depth.shape
        at = np.floor((flat - self.low) / self.cell).astype(np.int64)
        return np.clip(at, 0, [width - 1, height - 1])[:, ::-1]


def halved(rgba: NDArray[np.float32]) -> NDArray[np.float32]:
    """Average two by two pixels, so that rims are smooth."""
    height, width = (size // 2 for size in rgba.shape[:2])
    four = rgba[: 2 * height, : 2 * width].reshape(height, 2, width, 2, 4)
    alpha = four[..., 3:].sum(axis=(1, 3))
    colour = (four[..., :3] * four[..., 3:]).sum(axis=(1, 3)) / np.maximum(alpha, 1e-12)
    return np.concatenate([colour, alpha / 4.0], axis=2, dtype=np.float32)


def weld(vertices: FloatArray, faces: IntArray) -> IntArray:
    """Number the corners of faces (f, 3) so that those at one place have one number."""
    extent = float(np.ptp(vertices, axis=0).max()) or 1.0
    _, label = np.unique(np.round(vertices / (WELD * extent)), axis=0, return_inverse=True)
    return np.asarray(label.reshape(-1)[faces], dtype=np.int64)


def corner_normals(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Average the normals (f, 3, 3) of the triangles around each corner, as far as no crease is between."""
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
