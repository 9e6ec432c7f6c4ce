"""Programs that Python runs, beside those that are compiled."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any


def plain(source: str, *buffers: Any) -> Callable[..., int]:
    """The last function of a program on buffers, as a function of its numbers."""
    namespace: dict[str, Any] = {"math": math, "inf": math.inf, "nan": math.nan}
    exec(compile(source, "<program>", "exec"), namespace)
    entry = [f for f in namespace.values() if getattr(f, "__code__", None) is not None][-1]
    views = [memoryview(buffer) for buffer in buffers]
    return lambda *numbers: int(entry(*views, *numbers) or 0)
