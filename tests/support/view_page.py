"""A page of viser for tests: served by a thread while a browser looks on."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from graspfx.live.recording_view import RecordingView
from graspfx.live.view.live_view import LiveView

PLAIN = "document.head.insertAdjacentHTML('beforeend', '<style>#webgl-software-rendering{display:none}</style>')"


@contextmanager
def serving(view: LiveView | RecordingView) -> Iterator[None]:
    """Let a thread serve a page within."""
    over = threading.Event()
    thread = threading.Thread(target=view.serve, args=(over.is_set,))
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join(60.0)
        assert not thread.is_alive()
