"""Page of a recording of any length, served in parts that are small enough for a browser."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from graspfx.errors import InputError
from graspfx.live.page.document import document
from graspfx.live.page.played_frames import MOST, rows_per_frame
from graspfx.live.page.story import story_of
from graspfx.live.view.page_server import Order, PageServer
from graspfx.resource import Resource

if TYPE_CHECKING:
    from graspfx.recording.record import Recording

LARGEST = 1 << 28  # most bytes of rows of a part
IDLE = 0.1  # interval between checks whether to stop [s]


class RecordingPage(Resource):
    """Page that plays a recording at up to 60 frames per second.

    A long recording has several parts, which are linked to each other; only the rows of the part that is shown are
    read.

    Args:
        recording: Recording of any length.
        folder: Folder to which mesh paths are relative; None for the scene's folder.
        port: Port number on 127.0.0.1; None for the first free port from 8080 on, 0 for any free port.

    Attributes:
        server: Server of the page.
        rows: Number of rows of a part.

    Raises:
        InputError: If the recording has no ticks, or the port is in use.
        MissingPackageError: If websockets is not installed.
    """

    def __init__(self, recording: Recording, *, folder: Path | None = None, port: int | None = None) -> None:
        if not len(recording):
            raise InputError("recording", 0, "a recording with at least one tick")
        self._recording, self._folder = recording, folder
        most = max(1, LARGEST // (8 * max(1, recording.layout.width)))
        self.rows = min(MOST * rows_per_frame(recording.row_period), most)
        self.server = PageServer(self, port).__enter__()

    def close(self) -> None:
        """Close the page in all browsers."""
        self.server.__exit__()

    def serve(self, stop: Callable[[], bool], seconds: float | None = None) -> None:
        """Serve the page until `stop` returns True, or for a number of seconds."""
        end = None if seconds is None else time.monotonic() + seconds
        while not stop() and (end is None or time.monotonic() < end):
            time.sleep(IDLE if end is None else min(IDLE, max(0.0, end - time.monotonic())))

    def document(self, path: str, host: str) -> str | None:
        """Return the page of a part of the recording: "/" is the first part, "/2" the second part."""
        count, name = -(-len(self._recording) // self.rows), path.removeprefix("/") or "1"
        number = int(name) if name.isascii() and name.isdecimal() and len(name) < 9 else 0
        if not 1 <= number <= count:
            return None
        first = (number - 1) * self.rows
        part = self._recording.part(first, min(first + self.rows, len(self._recording)))
        links = [(f"Part {each} of {count}", f"/{each}") for each in (number - 1, number + 1) if 1 <= each <= count]
        return document(story_of(part, self._folder) | {"links": links})

    def order(self, order: Order) -> bool:
        """Return False, because this page sends no orders."""
        return False
