"""Common parts of drivers: the end of a `with` block, vendors' libraries, and a handle in space with a force limit."""

from __future__ import annotations

import ctypes
import sys
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from graspfx.devices._settings import number, whole
from graspfx.protocols import SMALLEST, WINDOW, DeviceError, InputError, VelocityEstimator

FloatArray = NDArray[np.float64]


class Closing(ABC):
    """A device that the end of a `with` block closes."""

    @abstractmethod
    def close(self) -> None:
        """Set zero force and release the hardware, without an error if the hardware is lost or already closed."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


class Handle(Closing):
    """One finger in space, whose force is limited.

    Args:
        most: Largest value of `force_limit` [N].
        force_limit: Largest force at the handle [N].
        resolution: Resolution of a position [m].
        velocity_window: Longest window of the velocity estimate [samples].
    """

    def __init__(
        self, most: float, *, force_limit: object = 1.0, resolution: object = 1e-5, velocity_window: object = WINDOW
    ) -> None:  # fmt: skip
        self.force_limit = number("force_limit", force_limit, SMALLEST, most)
        self.resolution = number("resolution", resolution, SMALLEST)
        self._window = whole("velocity_window", velocity_window, 1)
        self._position: FloatArray = np.zeros((1, 3))
        self._velocity: FloatArray = np.zeros((1, 3))

    def write(self, forces: FloatArray) -> None:
        """Display a force (1, 3) [N], scaled down to the limit.

        A non-finite force is displayed as zero and raises DeviceError.
        """
        self._opened()
        if np.shape(forces) != (1, 3):
            raise InputError("forces", forces, "an array of shape (1, 3): one finger in space")
        force = np.array(forces[0], dtype=float)
        size = float(np.linalg.norm(force))
        if not np.isfinite(size):
            self._display_zero()
            raise DeviceError(
                f"a force of {force.tolist()} N is not finite and cannot be displayed: the motors are at zero force"
            )
        if size > self.force_limit:
            force *= self.force_limit / size
        self._display(force)

    @abstractmethod
    def stop(self) -> None:
        """Display zero force immediately."""

    @abstractmethod
    def _opened(self) -> object:
        """Raise DeviceError if the device is not open."""

    @abstractmethod
    def _display(self, force: FloatArray) -> None:
        """Display a finite force (3,) within the limit [N]."""

    def _display_zero(self) -> None:
        self.stop()

    def _estimator_at(self, period: float) -> VelocityEstimator:
        """Return an estimator of velocities from positions sampled every `period` seconds."""
        return VelocityEstimator(period, (3,), 0.5 * self.resolution, self._window)


# Vendors' libraries ---------------------------------------------------------------------------------------------------


def library_path(library: object, title: str) -> Any:
    """Return the path of a library, None to try its usual file names, or a library that is already loaded.

    Args:
        library: Value of the setting.
        title: Name of the library in messages.
    """
    path = str(library) if isinstance(library, PathLike) else library
    if not (path is None or isinstance(path, ctypes.CDLL) or (isinstance(path, str) and path)):
        raise InputError("library", library, f"the path of {title}, a ctypes.CDLL, or None for its usual names")
    return path


def load_library(
    library: str | ctypes.CDLL | None, title: str, names: Mapping[str, Sequence[str]], others: Sequence[str]
) -> ctypes.CDLL:
    """Load a vendor's library.

    Args:
        library: Result of `library_path`.
        title: Name of the library in messages.
        names: Usual file names, by `sys.platform`.
        others: Usual file names on other systems.

    Raises:
        DeviceError: If the library cannot be loaded.
    """
    if isinstance(library, ctypes.CDLL):
        return library
    for name in names.get(sys.platform, others) if library is None else (library,):
        try:
            return ctypes.CDLL(name)
        except OSError as error:
            reason = error
    raise DeviceError(
        f"{title} cannot be loaded ({reason}): install the vendor's SDK, or set the library's path as `library`"
    ) from reason


def library_functions(
    loaded: ctypes.CDLL, title: str, file: str, signatures: Mapping[str, Sequence[Any]]
) -> dict[str, Any]:  # fmt: skip
    """Return functions of a loaded library by name, with their types.

    Args:
        loaded: Library.
        title, file: Name and file of the library in messages.
        signatures: Type of the result and of each argument, by the function's name.

    Raises:
        DeviceError: If the library has no such function.
    """
    functions = {}
    for name, (result, *arguments) in signatures.items():
        function = getattr(loaded, name, None)
        if function is None:
            raise DeviceError(f"{title} has no function {name}: install a newer SDK, or set `library` to {file}")
        function.restype, function.argtypes = result, arguments
        functions[name] = function
    return functions
