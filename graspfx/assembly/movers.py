"""The bodies of a scene: each object's own, or a world for those that meet obstacles or one another."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from graspfx import plugins
from graspfx.assembly import encounters
from graspfx.loop.parts import BodyGroup
from graspfx.objects.surroundings import Meeting, Member

if TYPE_CHECKING:
    from graspfx.assembly.resolve import Parts

FloatArray = NDArray[np.float64]


def make_movers(parts: Parts, states: Sequence[FloatArray], stack: ExitStack) -> Iterator[BodyGroup]:
    """Make what moves the objects whose blocks these are; closed with the stack.

    Raises:
        PluginError: what code of another raises when it makes a body.
    """
    scene, world = parts.scene, parts.scene.world
    meeting = Meeting(world.friction, world.restitution, world.stiffness, encounters.collide(scene))
    for group in encounters.groups(scene):
        module = plugins.load_blaming("dynamics", scene.object[group[0]].dynamics, parts.folder)
        file = Path(module.__file__ or module.__name__)
        make_world = getattr(module, "create_world", None)
        if make_world is None or not encounters.in_world(scene, group):
            for i in group:
                with plugins.blaming(file):
                    body = module.create(states[i])
                stack.callback(getattr(body, "close", _nothing))
                yield BodyGroup(body, [i])
            continue
        members = [Member(states[i], parts.objects[i].solid.shape) for i in group]
        with plugins.blaming(file):
            body = make_world(members, parts.obstacles, meeting)
        stack.callback(getattr(body, "close", _nothing))
        yield BodyGroup(body, group)


def _nothing() -> None:
    return None
