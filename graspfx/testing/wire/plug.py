"""The name of a port that stays while the pseudo-terminal behind it comes and goes."""

from __future__ import annotations

from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp


class Plug:
    """A link in a folder of its own, as an operating system keeps one for a device that is plugged in again.

    Attributes:
        folder: for whatever else belongs to the emulator.
        port: the name of the port.
    """

    def __init__(self) -> None:
        self.folder = Path(mkdtemp(prefix="graspfx-wire-"))
        self.port = str(self.folder / "port")

    def lead(self, terminal: str) -> None:
        """Have the port lead to this terminal."""
        self.pull()
        (self.folder / "port").symlink_to(terminal)

    def pull(self) -> None:
        """Have the port lead nowhere."""
        (self.folder / "port").unlink(missing_ok=True)

    def remove(self) -> None:
        """Delete the folder."""
        rmtree(self.folder, ignore_errors=True)
