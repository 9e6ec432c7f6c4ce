"""A scene whose fingers go where a touch screen says, and nowhere by themselves."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from graspfx.assembly.hands import holdings
from graspfx.errors import InputError
from graspfx.scene.model import Scene

if TYPE_CHECKING:
    from graspfx.assembly.hands import Holding

OWN = ("motion", "turn", "squeeze", "squeeze_ramp", "rest")  # what a hand does by itself


def touched_scene(scene: Scene) -> Scene:
    """Take from a scene's hands their own motions, turns and squeezes: each finger stays where it starts.

    Raises:
        InputError: a scene in space, or one without a hand that could be led.
    """
    if scene.dimensions > 2:
        raise InputError(
            "scene", scene.title or scene.source.name, "a scene on a line or in the plane",
            "a touch screen has no depth: `graspfx view` moves hands in space",
        )  # fmt: skip
    if not any(_is_led(each) for each in holdings(scene)):
        raise InputError(
            "scene", scene.title or scene.source.name, "a scene with a simulated finger that a hand of springs holds",
            "give a finger a table `hand = { stiffness = 60.0, damping = 1.0 }`",
        )  # fmt: skip
    table = scene.to_dict()
    for each in holdings(scene):
        if _is_led(each):
            own = _at(table, each.at)
            for key in OWN:
                own.pop(key, None)
    return Scene(scene.source, **table)


def _is_led(holding: Holding) -> bool:
    return holding.table is not None and holding.table.form != "made"


def _at(table: Any, place: tuple[str | int, ...]) -> dict[str, Any]:
    for key in place:
        table = table[key]
    own: dict[str, Any] = table
    return own
