"""Pages of the built-in scenes that run by themselves, beside the site's own: run/NAME.html."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import graspfx as gx
from graspfx import plugins
from graspfx.errors import InputError

if TYPE_CHECKING:
    from sphinx.application import Sphinx

FOLDER = "run"
FRONT = "two-stiffnesses"  # on the front page
GAINS = "coupling.external.stiffness", "coupling.internal.stiffness"
PAIRS = {"too soft": (30.0, 30.0), "unstable": (80.0, 80.0), "both good": (30.0, 80.0)}  # [N/m]
PRESETS = {f"{name}: {a:g} and {b:g} N/m": {GAINS[0]: a, GAINS[1]: b} for name, (a, b) in PAIRS.items()}


LARGE = ("twenty-fingers",)  # a page of 3 MB


@cache
def runnable() -> tuple[str, ...]:
    """List the built-in scenes that a page can run: those of GraspFX's own parts."""
    from graspfx.live.page.running import require_runnable

    found = []
    for path in sorted(plugins.shelf("scenes").glob("[!_]*.*")):
        name = path.stem.replace("_", "-")
        try:
            require_runnable(gx.load(name))
        except InputError:
            continue
        if name not in LARGE:
            found.append(name)
    return tuple(found)


def _write(app: Sphinx, error: Exception | None) -> None:
    if error is not None or app.builder.format != "html":
        return
    folder = Path(app.outdir, FOLDER)
    folder.mkdir(exist_ok=True)
    for name in runnable():
        gx.load(name).to_html(folder / f"{name}.html", overwrite=True)
    scene = gx.load("paper-waving", preset="light-hand")
    scene.to_html(folder / f"{FRONT}.html", presets=PRESETS, overwrite=True)


def setup(app: Sphinx) -> dict[str, bool]:
    """Write the pages when the others are there."""
    app.connect("build-finished", _write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
