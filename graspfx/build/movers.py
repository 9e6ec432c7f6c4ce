"""The bodies of a scene: each object's own, or a world for those that meet obstacles or one another."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from graspfx import plugins
from graspfx.build import encounters
from graspfx.build.bodies import make_shape
from graspfx.loop.parts import Mover
from graspfx.objects.surroundings import Meeting, Member

if TYPE_CHECKING:
    from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]


def make_movers(scene: Scene, states: Sequence[FloatArray], stack: ExitStack) -> Iterator[Mover]:
    """What moves the objects whose blocks are given; closed with the stack.

    Raises:
        PluginError: what code of another raises when it makes a body.
    """
    world, folder = scene.world, scene.source.folder
    meeting = Meeting(world.friction, world.restitution, world.stiffness, encounters.collide(scene))
    for group in encounters.groups(scene):
        module = plugins.load_blaming("dynamics", scene.object[group[0]].dynamics, folder)
        file = Path(module.__file__ or module.__name__)
        make_world = getattr(module, "create_world", None)
        if make_world is None or not encounters.in_world(scene, group):
            for i in group:
                with plugins.blaming(file):
                    body = module.create(states[i])
                stack.callback(getattr(body, "close", _nothing))
                yield Mover(body, [i])
            continue
        members = [Member(states[i], make_shape(scene.object[i], folder)) for i in group]
        obstacles = encounters.obstacles(scene, folder)
        with plugins.blaming(file):
            body = make_world(members, obstacles, meeting)
        stack.callback(getattr(body, "close", _nothing))
        yield Mover(body, group)


def _nothing() -> None:
    return None
