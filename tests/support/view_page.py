"""A page for tests: served by a thread while a browser looks on."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from graspfx.live.view.live_page import LivePage
from graspfx.live.view.recording_page import RecordingPage


@contextmanager
def serving(page: LivePage | RecordingPage) -> Iterator[None]:
    """Let a thread serve a page within."""
    over = threading.Event()
    thread = threading.Thread(target=page.serve, args=(over.is_set,))
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join(60.0)
        assert not thread.is_alive()
