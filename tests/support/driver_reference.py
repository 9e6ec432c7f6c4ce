"""Settings of every driver on the shelf as a page, from the signatures and docstrings of their `connect`.

`python -m tests.support.driver_reference` prints it: docs/reference/drivers.md.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from types import ModuleType

from graspfx import plugins
from tests.support.scene_reference import UNIT, capital, unitless

HEAD = """# Settings of the drivers

Written from the code by `make reference`; a test holds it against the code. A scene names a driver in the table
`device` of a finger, or in a `[[device]]`, and its settings stand beside the name; `graspfx devices` says what is
plugged in. Keys that every device takes: [finger.device](scene.md#fingerdevice).
"""
WORDS = {  # of types, in this order
    r" \| None": "", r"tuple\[ArrayLike, ArrayLike\]|Sequence\[Sequence\[float\]\]": "matrix",
    r"Sequence\[Mapping.*": "list of tables", r"Sequence\[float\]": "numbers", r"Sequence\[str\]": "list of text",
    r"\bfloat\b": "number", r"\bint\b": "whole number", r"\bbool\b": "true or false",
    r"\b(str|Elbow|Drive|object)\b": "text", r"\bBoard\b": "an object, in Python", r" \| ": " or ",
}  # fmt: skip
PAGES = {
    "force-dimension": "hardware.md#force-dimension", "gamepad": "hardware.md#mouse-and-gamepad",
    "haply-2diy": "hardware.md#haply-2diy", "haply-inverse": "hardware.md#haply-inverse3",
    "mouse": "hardware.md#mouse-and-gamepad", "open-haptics": "hardware.md#touch-and-phantom-openhaptics",
    "rig": "hardware.md#the-rig-two-arms-on-one-controller", "touch-screen": "touch.md",
    "two-link": "device.md#a-two-link-arm-on-your-own-electronics",
}  # fmt: skip


def page() -> str:
    """Write the page."""
    parts = [HEAD]
    for name, origin in sorted(plugins.names("devices").items()):
        if origin.startswith("GraspFX"):
            parts += _section(name, plugins.load("devices", name))
    return "\n".join(parts)


def _section(name: str, module: ModuleType) -> list[str]:
    """Write a driver as a section with a row for each setting."""
    text = inspect.cleandoc(module.__doc__ or "").split("\n\n")[0]
    more = f" [How to use it](../how-to/{PAGES[name]})." if name in PAGES else ""
    lines = [f"## {name}\n", f"{' '.join(text.split())}{more}\n"]
    about = _about(module)
    lines += ["| setting | type | unit | default | meaning |", "|---|---|---|---|---|"]
    for setting, parameter in inspect.signature(module.connect).parameters.items():
        said = about.get(setting, "")
        unit = UNIT.search(said)
        default = (
            "**required**"
            if parameter.default is parameter.empty
            else "none"
            if parameter.default is None
            else f"`{parameter.default!r}`"
        )
        kind = _kind(str(parameter.annotation))
        cells = [f"`{setting}`", kind, unit[1] if unit else "", default, capital(unitless(said) if unit else said)]
        lines.append(f"| {' | '.join(cells)} |")
    return [*lines, ""]


def _kind(annotation: str) -> str:
    """Say in words what type a setting has."""
    for pattern, word in WORDS.items():
        annotation = re.sub(pattern, word, annotation)
    return annotation


def _about(module: ModuleType) -> dict[str, str]:
    """Read what the docstring says of each setting; of those of another driver, what that one says."""
    about = dict(_arguments(inspect.getdoc(module.connect) or ""))
    if module.__name__.endswith(".rig"):
        about = {**dict(_arguments(inspect.getdoc(plugins.load("devices", "two-link").connect) or "")), **about}
    return about


def _arguments(text: str) -> Iterator[tuple[str, str]]:
    """List the entries of a docstring's section `Args`."""
    section = text.partition("Args:\n")[2].partition("\n\n")[0]
    for entry in re.split(r"\n    (?=\w)", f"\n{section}")[1:]:
        names, _, said = entry.partition(":")
        for name in names.split(","):
            yield name.strip(), " ".join(said.split()).rstrip(".")


if __name__ == "__main__":
    print(page(), end="")
