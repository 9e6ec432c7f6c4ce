"""Common parts of drivers: closing after a `with` block, a handle with a force limit, and loading of libraries."""

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
    """A device that is closed at the end of a `with` block."""

    @abstractmethod
    def close(self) -> None:
        """Set zero force and release the hardware; raise no error if the hardware is lost or already released."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


class Handle(Closing):
    """A device with one finger in space and a force limit.

    Args:
        most: Largest accepted value of `force_limit` [N].
        force_limit: Largest force at the handle [N].
        resolution: Resolution of the measured positions [m].
        velocity_window: Largest number of samples in the window of the velocity estimate.
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
        """Display a force (1, 3) [N]; if it exceeds `force_limit`, scale it down to this limit.

        If the force is not finite, display zero force and raise DeviceError.
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
        """Display a force (3,) [N], which is finite and at most `force_limit`."""

    def _display_zero(self) -> None:
        self.stop()

    def _estimator_at(self, period: float) -> VelocityEstimator:
        """Return an estimator of velocities from positions sampled every `period` seconds."""
        return VelocityEstimator(period, (3,), 0.5 * self.resolution, self._window)


# Vendors' libraries ---------------------------------------------------------------------------------------------------


def library_path(library: object, title: str) -> Any:
    """Check the setting `library`; return a path, a loaded library, or None for the library's usual file names.

    Args:
        library: Value of the setting.
        title: Name of the library in messages.
    """
    path = str(library) if isinstance(library, PathLike) else library
    if not (path is None or isinstance(path, ctypes.CDLL) or (isinstance(path, str) and path)):
        raise InputError("library", library, f"the path of {title}, a ctypes.CDLL, or None for its usual file names")
    return path


def load_library(
    library: str | ctypes.CDLL | None, title: str, names: Mapping[str, Sequence[str]], others: Sequence[str]
) -> ctypes.CDLL:
    """Load a vendor's library.

    Args:
        library: Result of `library_path`.
        title: Name of the library in messages.
        names: Usual file names of the library for values of `sys.platform`.
        others: Usual file names on systems that are not in `names`.

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
    """Set the argument and result types of functions of a loaded library, and return the functions by name.

    Args:
        loaded: Loaded library.
        title, file: Name and file name of the library in messages.
        signatures: For each function's name, the type of the result and then of each argument.

    Raises:
        DeviceError: If the library lacks one of the functions.
    """
    functions = {}
    for name, (result, *arguments) in signatures.items():
        function = getattr(loaded, name, None)
        if function is None:
            raise DeviceError(
                f"{title} has no function {name}: install a newer SDK, or set `library` to the path of {file}"
            )
        function.restype, function.argtypes = result, arguments
        functions[name] = function
    return functions
