"""Relation of a device to its scene: frame (origin, axes and scale), deadman switch and call interval of the device."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import InputError
from graspfx.loop.device import Features

FloatArray = NDArray[np.float64]

LETTERS = "xyz"
ROUNDING = 1e-6  # tolerance of a rotation matrix, for axes written with seven digits


@dataclass(frozen=True, eq=False)
class Frame:
    """Transformation of positions p, velocities v and forces f from the axes of a device to the axes of a scene.

        p = origin + s R p_device,   v = s R v_device,   f_device = s R' f

    The transformation preserves the power: f'v = f_device'v_device.

    Attributes:
        origin: Origin of the device in the scene (d,) [m].
        axes: Rotation matrix R with one row for each axis of the scene (d, d).
        scale: Scale s, metres in the scene per metre of the device.
    """

    origin: FloatArray
    axes: FloatArray
    scale: float

    def place(self, positions: FloatArray) -> FloatArray:
        """Convert positions (k, d) from the device's coordinates to the scene's [m]."""
        placed: FloatArray = self.origin + self.turn(positions)
        return placed

    def turn(self, velocities: FloatArray) -> FloatArray:
        """Convert velocities (k, d) from the device's coordinates to the scene's [m/s]."""
        turned: FloatArray = self.scale * (velocities @ self.axes.T)
        return turned

    def pull(self, forces: FloatArray) -> FloatArray:
        """Convert forces (k, d) from the scene's coordinates to the device's [N]."""
        pulled: FloatArray = self.scale * (forces @ self.axes)
        return pulled

    def back(self, position: FloatArray) -> FloatArray:
        """Convert a position (d,) from the scene's coordinates to the device's [m]."""
        own: FloatArray = (position - self.origin) @ self.axes / self.scale
        return own

    def impedance(self, own: FloatArray) -> FloatArray:
        """Convert a matrix M of mass, damping or stiffness (d, d) from the device's coordinates to the scene's.

        The result is R M R'/s^2.
        """
        turned: FloatArray = self.axes @ own @ self.axes.T / self.scale**2
        return turned

    def features(self, own: Features) -> Features:
        """Convert features of the device to the scene: lengths times s, forces divided by s, impedances by s^2."""
        s = self.scale
        return replace(
            own,
            workspace=None if own.workspace is None else self._box(*own.workspace),
            continuous_force=_over(own.continuous_force, s),
            peak_force=_over(own.peak_force, s),
            stiffness=_over(own.stiffness, s * s),
            damping=_over(own.damping, s * s),
            mass=_over(own.mass, s * s),
            friction=_over(own.friction, s * s),
            resolution=_over(own.resolution, 1.0 / s),
        )

    def _box(self, lower: FloatArray, upper: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return a box along the scene's axes that lies inside the device's box.

        It is the bounding box of the device's box, scaled down about its centre.
        """
        half = 0.5 * (np.asarray(upper, dtype=float) - lower)
        middle = self.place(0.5 * (np.asarray(upper, dtype=float) + lower))
        outer = np.abs(self.axes) @ half
        share = float((half / (np.abs(self.axes).T @ outer)).min())
        return middle - self.scale * share * outer, middle + self.scale * share * outer


def _over(value: float | None, factor: float) -> float | None:
    return None if value is None else value / factor


def frame(
    dimensions: int, origin: Sequence[float] | None, axes: str | Sequence[Sequence[float]] | None, scale: float
) -> Frame:
    """Create a frame.

    Args:
        dimensions: Number of dimensions d.
        origin: Origin of the device in the scene (d,) [m]; None for the origin of the scene.
        axes: Device's axis along each axis of the scene, such as "x -z y", or R (d, d); None for the scene's axes.
        scale: Scale s, metres in the scene per metre of the device.

    Raises:
        InputError: If the shape of `origin` is wrong, or if the axes are not a rotation. In one and two dimensions, the
            axes may also be mirrored, because the device can be viewed from behind.
    """
    d = dimensions
    point = np.zeros(d) if origin is None else np.array(origin, dtype=float)
    if point.shape != (d,):
        raise InputError("origin", point.tolist(), f"{d} coordinates [m], one per dimension of the scene")
    R = np.eye(d) if axes is None else _letters(axes, d) if isinstance(axes, str) else np.array(axes, dtype=float)
    if R.shape != (d, d):
        raise InputError("axes", axes, f"a matrix {d} x {d}, one row for each axis of the scene")
    if np.abs(R @ R.T - np.eye(d)).max() > ROUNDING:
        raise InputError("axes", axes, "orthogonal rows of length 1", "set the scale with `scale`")
    if d == 3 and np.linalg.det(R) < 0.0:
        raise InputError(
            "axes",
            axes,
            "right-handed axes, because a rotation cannot mirror the device's axes",
            "change the sign of one axis",
        )
    return Frame(point, R, scale)


def _letters(axes: str, d: int) -> FloatArray:
    """Convert axes such as "x -z y" to a rotation matrix (d, d)."""
    words, letters = axes.split(), LETTERS[:d]
    if sorted(word.removeprefix("-") for word in words) != list(letters):
        example = " ".join(letters) if d < 3 else "x -z y"
        raise InputError(
            "axes", axes, f"each of {', '.join(letters)} once, with or without a minus sign, such as {example!r}",
            "the first letter is the device's axis along the scene's x axis",
        )  # fmt: skip
    R = np.zeros((d, d))
    for row, word in enumerate(words):
        R[row, letters.index(word[-1])] = -1.0 if word.startswith("-") else 1.0
    return R


@dataclass(frozen=True, eq=False)
class Fitting:
    """Relation of a device to its scene.

    Attributes:
        frame: Frame of the device in the scene; None for the frame of the scene.
        deadman: Index of the deadman switch, which must be held to allow forces; None if there is none.
        every: Number of ticks from one exchange with the device to the next.
        measures: Features measured on this device; they replace the features that the driver reports.
        jitter: 1st and 99th percentile of the lateness [s]; None if unknown.
        round_trip: Part of the lateness that is caused by reading and writing [s].
    """

    frame: Frame | None = None
    deadman: int | None = None
    every: int = 1
    measures: Mapping[str, Any] = field(default_factory=dict)
    jitter: tuple[float, float] | None = None
    round_trip: float = 0.0

    @property
    def scale(self) -> float:
        """Metres in the scene per metre of the device."""
        return 1.0 if self.frame is None else self.frame.scale

    def features(self, own: Features) -> Features:
        """Return the features of a device in the scene's coordinates, with measured features and added delay.

        An exchange every m ticks adds m - 1 samples to the delay.

        Args:
            own: Features that the driver reports.
        """
        if self.measures:
            own = replace(own, **self.measures)
        if self.every > 1:
            own = replace(own, delay=(own.delay or 0) + self.every - 1)
        return own if self.frame is None else self.frame.features(own)


PLAIN = Fitting()
