"""The programs of docs/how-to/feedback.md, taken from the page and run beside a loop with simulated devices."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import graspfx as gx

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "feedback.md"
LONGEST = 30  # lines of a host


def blocks(language: str) -> list[str]:
    """Give the page's blocks of a language, but for those of doctest."""
    found = re.findall(rf"^```{language}\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    return [block for block in found if ">>>" not in block]


def code_lines(block: str) -> int:
    """Count the lines that are neither blank nor a comment."""
    return sum(bool(line.strip()) and not line.strip().startswith("#") for line in block.splitlines())


def scene(folder: Path, **overrides: Any) -> gx.Scene:
    """Load the page's scene."""
    path = folder / "feedback.toml"
    path.write_text(blocks("toml")[0], encoding="utf-8")
    return gx.load(path, {"engine": "compiled", **overrides})


def run_host(
    block: str,
    loop: gx.Scene,
    duration: float,
    names: dict[str, Any] | None = None,
    watch: Callable[..., None] | None = None,
) -> tuple[dict[str, Any], gx.Recording]:
    """Run a host of the page beside its loop in real time; give the host's variables and the loop's recording.

    Args:
        block: Text of the host.
        loop: Scene of the loop.
        duration: Time that the host runs [s].
        names: Further names that the host takes as given.
        watch: Called with each `Shown`, its time and its operator.
    """
    name = loop.host.name  # type: ignore[union-attr]
    space = {"DURATION": duration, **(names or {})}
    code = block.replace('connect("hand")', f'connect("{name}")')
    if watch is not None:
        code = re.sub(r"^( +)(device\.show\(.*\))$", r"\1\2\n\1WATCH(shown, hand, globals())", code, flags=re.MULTILINE)
        space["WATCH"] = watch
    with gx.open(loop, real_time=True) as session:
        exec(compile(code, str(PAGE), "exec"), space)
        session.wait(0.01)
        fault = session.fault
    assert fault is None or "host has ended" in str(fault), fault
    return space, session.recording
