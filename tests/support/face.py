"""The public Python face as a page, from the names that its modules list and the first lines of their docstrings.

`python -m tests.support.face` prints it: docs/reference/python.md.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from types import ModuleType
from typing import Any

import graspfx as gx
from graspfx.testing import wire

HEAD = """# The Python face

Written from the code by `make face`; a test holds it against the code. These names stay: `help(gx.run)`, or `gx.run?`
in a notebook, has arguments, units and errors of each.
"""
PARTS = (
    ("graspfx", gx, "`import graspfx as gx`"),
    ("gx.stability", gx.stability, "Delays are in samples."),
    ("gx.passivity", gx.passivity, "Delays are in seconds, of `z_width` in samples."),
    (
        "graspfx.protocols",
        gx.protocols,
        "All that a driver, a hand or a body imports.",
    ),
    ("gx.testing", gx.testing, "Conformance kits, for pytest."),
    (
        "graspfx.testing.wire",
        wire,
        "Emulators of hardware, for tests of drivers: `from graspfx.testing.wire import SerialWire`.",
    ),
    ("gx.style", gx.style, "The one style of every figure, for figures of one's own."),
    ("gx.errors", gx.errors, "`GraspFXError` is the base of all."),
)
NOUNS = (gx.Scene, gx.Recording, gx.Session, gx.Batch, gx.Report, gx.Certificates)


def page() -> str:
    """Write the page."""
    lines = [HEAD]
    for title, module, about in PARTS:
        lines += [f"## {title}\n", f"{about}\n", "| name | what |", "|---|---|"]
        lines += [f"| `{name}` | {_about(module, name)} |" for name in module.__all__ if not name.startswith("__")]
        lines.append("")
    lines += ["## What the nouns can do\n"]
    for noun in NOUNS:
        lines += [f"**{noun.__name__}**\n", "| name | what |", "|---|---|"]
        lines += [f"| `{name}` | {text} |" for name, text in _members(noun)]
        lines.append("")
    return "\n".join(lines)


def _about(module: ModuleType, name: str) -> str:
    value = getattr(module, name)
    if isinstance(value, int | float | tuple | dict):
        return f"`{value if not isinstance(value, dict) else list(value)}`"
    if inspect.isclass(value) or inspect.isroutine(value) or inspect.ismodule(value):
        return _sentence(value)
    return f"`{str(value).replace('typing.', '').replace('collections.abc.', '')}`"


def _members(noun: type) -> Iterator[tuple[str, str]]:
    own = [each for each in noun.__mro__ if each.__module__.startswith("graspfx")]
    seen: dict[str, Any] = {}
    for each in reversed(own):
        seen |= {name: value for name, value in vars(each).items() if not name.startswith(("_", "model_"))}
    for name, value in sorted(seen.items()):
        getter = getattr(value, "fget", None) or getattr(value, "func", None)
        if getter is not None:
            yield name, _sentence(getter)
        elif inspect.isfunction(value) or isinstance(value, classmethod):
            yield f"{name}()", _sentence(value)


def _sentence(value: Any) -> str:
    text = inspect.cleandoc(value.__doc__ or "").split("\n\n")[0]
    return " ".join(text.split()).replace("|", r"\|")


if __name__ == "__main__":
    print(page(), end="")
