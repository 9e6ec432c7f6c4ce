"""The public Python face as a page, from the names that its modules list and the first lines of their docstrings.

`python -m tests.support.face` prints it: docs/reference/python.md.
"""

from __future__ import annotations

import ast
import inspect
from collections.abc import Iterator
from importlib import import_module
from types import ModuleType
from typing import Any

import graspfx as gx
from graspfx.recording.history import Stored
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
    ("gx.experiment", gx.experiment, "Sessions with people, and thresholds."),
    ("gx.testing", gx.testing, "Conformance kits, for pytest."),
    (
        "graspfx.testing.wire",
        wire,
        "Emulators of hardware, for tests of drivers: `from graspfx.testing.wire import SerialWire`.",
    ),
    ("gx.style", gx.style, "The one style of every figure, for figures of one's own."),
    ("gx.errors", gx.errors, "`GraspFXError` is the base of all."),
)
MODULES = {title.replace("gx.", "graspfx."): module for title, module, _ in PARTS}
GROUPS = {  # of graspfx; those that are in none go to "more"
    "grasps": ["grasp_matrix", "Grasp", "Split", "Impedance", "Coupling", "PointCoupling", "unilateral_force"],
    "runs": ["Scene", "load", "run", "Recording", "replay", "open", "Session", "RealTimeSession"],
    "certificates": [
        "check",
        "Report",
        "certify",
        "Certificates",
        "certify_operators",
        "OperatorCertificate",
        "tune",
        "Tuning",
    ],
}
NOUNS = (gx.Scene, gx.Recording, gx.Session, gx.Batch, gx.Report, gx.Certificates, gx.experiment.Experiment)


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
        lines += [f"| `{name}` | {text} |" for name, text in members(noun)]
        lines.append("")
    return "\n".join(lines)


def _about(module: ModuleType, name: str) -> str:
    value = getattr(module, name)
    if inspect.isclass(value) or inspect.isroutine(value) or inspect.ismodule(value):
        return _sentence(value)
    shown = list(value) if isinstance(value, dict) else value
    return f"`{str(shown).replace('typing.', '').replace('collections.abc.', '')}`: {constant_text(module, name)}"


def constant_text(module: ModuleType, name: str) -> str:
    """Look up the text below a constant, in the module that assigns it; none if there is none."""
    body = ast.parse(inspect.getsource(module)).body
    for statement, after in zip(body, [*body[1:], None], strict=True):
        match statement:
            case ast.ImportFrom(module=str(home), names=names) if any(
                (each.asname or each.name) == name for each in names
            ):
                return constant_text(import_module(home), next(n.name for n in names if (n.asname or n.name) == name))
            case ast.Assign(targets=[ast.Name(id=target)]) | ast.AnnAssign(target=ast.Name(id=target)) if (
                target == name
            ):
                match after:
                    case ast.Expr(value=ast.Constant(value=str(text))):
                        return " ".join(text.split())
    return ""


def members(noun: type) -> Iterator[tuple[str, str]]:
    own = [each for each in noun.__mro__ if each.__module__.startswith("graspfx")]
    seen: dict[str, Any] = {}
    for each in reversed(own):
        seen |= {name: value for name, value in vars(each).items() if not name.startswith(("_", "model_"))}
    for name, value in sorted(seen.items()):
        getter = value if isinstance(value, Stored) else getattr(value, "fget", None) or getattr(value, "func", None)
        if getter is not None:
            yield name, _sentence(getter)
        elif inspect.isfunction(value) or isinstance(value, classmethod):
            yield f"{name}()", _sentence(value)


def names(module: str, group: str = "") -> list[str]:
    """List the public names of a module, or of a group of them, without modules, which have pages of their own."""
    values = MODULES[module]
    every = [n for n in values.__all__ if not n.startswith("__") and not inspect.ismodule(getattr(values, n))]
    if not group:
        return every
    others = {name for names in GROUPS.values() for name in names}
    return GROUPS[group] if group in GROUPS else [name for name in every if name not in others]


def home(value: Any, name: str) -> str:
    """Name the module under whose name an object stands in the index: of several the first, but errors for an error."""
    homes = [path for path, module in MODULES.items() if name in module.__all__ and getattr(module, name) is value]
    return homes[-1] if "graspfx.errors" in homes else homes[0]


def _sentence(value: Any) -> str:
    text = inspect.cleandoc(value.__doc__ or "").split("\n\n")[0]
    return " ".join(text.split()).replace("|", r"\|")


if __name__ == "__main__":
    print(page(), end="")
