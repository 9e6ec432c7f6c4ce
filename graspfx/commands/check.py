"""graspfx check: a scene's faults, or what each sample will do and why."""

from __future__ import annotations

import sys
from argparse import ArgumentParser, Namespace

from graspfx.commands.arguments import add_scene
from graspfx.commands.certified import certify
from graspfx.commands.output import DONE, doubts, note

EXAMPLE = """  graspfx check paper-spring --set coupling.external.stiffness=60"""


def add_arguments(parser: ArgumentParser) -> None:
    add_scene(parser)


def execute(chosen: Namespace) -> int:
    from graspfx.scene.axes import axes_notes
    from graspfx.scene.blend import blend_notes
    from graspfx.scene.engine import engine_plan
    from graspfx.scene.load import load
    from graspfx.scene.plan import plan

    scene = load(chosen.scene, dict(chosen.overrides))
    scene.require_reach()
    for row in [*plan(scene), *engine_plan(scene)]:
        print(f"{'runs' if row.runs else 'skipped':<9}{row.step:<24}{row.why}")
    certify(scene)
    sys.stdout.flush()
    note([*doubts(scene), *axes_notes(scene), *blend_notes(scene)])
    return DONE
