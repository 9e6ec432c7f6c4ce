"""The devices, shapes and recorded paths of a scene, each connected or loaded once, whoever asks for it first."""

from __future__ import annotations

from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any

from graspfx.assembly.bodies import Solid, make_solid
from graspfx.compile.memory import Memory
from graspfx.loop.device import Device
from graspfx.loop.motion import motion

if TYPE_CHECKING:
    from graspfx.scene.tables.part_tables import Object, Obstacle

Location = tuple[str | int, ...]


class Stock:
    """Connected devices, shapes and recorded paths, by the places of their tables in the scene.

    The checks of a scene fill it, and the scene carries it on. A copy of a scene begins with an empty one: neither
    pickling nor `copy.deepcopy` takes a device along.

    Args:
        folder: where relative paths of the scene start; None for the current folder.
    """

    def __init__(self, folder: Path | None) -> None:
        self.folder = folder
        self.devices: dict[Location, Device] = {}
        self.starts: dict[int, tuple[float, ...] | None] = {}  # of fingers that come in along a direction
        self.memory = Memory()  # in which blocks of its devices stand
        self.parts: Any = None  # of `graspfx.assembly.resolve`, once they are asked for
        self.built: Any = None  # of `graspfx.assembly.build`: a servo that has run, and how it begins
        self._solids: dict[Location, Solid] = {}
        self._paths: dict[str, motion.Path] = {}
        self._lock = Lock()
        self._unused = True

    def solid(self, at: Location, table: Object | Obstacle) -> Solid:
        """Give the shape of the object or obstacle whose table stands there.

        Raises:
            InputError: naming the key of the shape's table that cannot be.
            MissingPackageError: the package that reads a mesh's file is not installed.
        """
        if at not in self._solids:
            self._solids[at] = make_solid(table, self.folder)
        return self._solids[at]

    def path(self, file: str) -> motion.Path:
        """Give the motion that a file records.

        Raises:
            InputError: no such file, or not such a table, with the line.
        """
        if file not in self._paths:
            self._paths[file] = motion.Path.read(file, self.folder)
        return self._paths[file]

    def claim(self) -> bool:
        """Tell the first caller that the devices are its own to open; every later one has to connect others."""
        with self._lock:
            first, self._unused = self._unused, False
        return first

    def take_built(self) -> Any:
        """Take what is `built`; nobody else has it then."""
        with self._lock:
            built, self.built = self.built, None
        return built

    def __deepcopy__(self, memo: Any) -> None:
        return None

    def __reduce__(self) -> tuple[type[None], tuple[()]]:
        return type(None), ()
