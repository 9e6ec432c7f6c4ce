"""Lines that somebody types while a program does something else."""

from __future__ import annotations

import select
import sys


def is_watched() -> bool:
    """Tell whether somebody sits at a terminal whose lines can be waited for: on Windows nobody's can."""
    return sys.platform != "win32" and sys.stdin is not None and sys.stdin.isatty()


def takes_line() -> bool:
    """Take a line that has been typed, without a wait; tell whether there was one."""
    return bool(select.select([sys.stdin], [], [], 0)[0] and sys.stdin.readline())
