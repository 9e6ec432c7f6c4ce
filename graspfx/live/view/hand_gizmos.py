"""Gizmos and squeeze sliders that move the hands of a run, or its fingers in a scene without hands."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from graspfx.live.scenery import Scenery
from graspfx.live.view.words_on_page import heading

if TYPE_CHECKING:
    import viser

    from graspfx.live.guides import Guide
    from graspfx.live.live_run import LiveRun

REACH = 2.0  # farthest goal from its initial position, in extents
SIZE = 0.34  # size of a gizmo, as a share of the extent
CLOSEST, WIDEST = 0.3, 0.15  # largest additional squeeze and opening of a hand, as shares of the extent
PREFIX = "/hands/"


class HandGizmos:
    """Gizmos and sliders that move the hands of a run.

    Args:
        server: Server of the page.
        scenery: Scenery of the scene.
        run: Run whose guides are moved.
        wake: Function called after each order, so that the page shows its effect.
    """

    def __init__(self, server: viser.ViserServer, scenery: Scenery, run: LiveRun, wake: Callable[[], None]) -> None:
        self._run, self._wake = run, wake
        self._extent, d = scenery.extent, run.layout.dimensions
        self._dimensions = d
        self._gizmos: list[Any] = []
        self._squeezes: list[Any] = []
        self._starts = [_spatial(guide.position) for guide in run.guides]
        if any(_squeezes(guide) for guide in run.guides):
            server.gui.add_html(heading("Hands" if len(run.guides) > 1 else "Hand"))
        for number, guide in enumerate(run.guides):
            gizmo = server.scene.add_transform_controls(
                f"{PREFIX}{number}", SIZE * scenery.extent, disable_rotations=True, disable_sliders=d == 1,
                active_axes=(True, d > 1, d > 2), depth_test=False, position=self._starts[number], line_width=2.5,
                opacity=0.5,
            )  # fmt: skip
            gizmo.on_update(self._leader(number))
            self._gizmos.append(gizmo)
            label = f"squeeze of {guide.name} [mm]" if len(run.guides) > 1 else "squeeze [mm]"
            if _squeezes(guide):
                size = 1e3 * scenery.extent
                step = 10.0 ** np.floor(np.log10(size / 200.0))
                least, most = (float(50.0 * step * round(share * size / (50.0 * step))) for share in (-WIDEST, CLOSEST))
                slider = server.gui.add_slider(
                    label, least, most, float(step), 0.0,
                    hint="squeeze in addition to the scene's; negative values open the hand",
                )  # fmt: skip
                slider.on_update(self._squeezer(number))
                self._squeezes.append(slider)

    def show(self, visible: bool) -> None:
        """Show or hide the gizmos, for example during a replay."""
        for gizmo in self._gizmos:
            gizmo.visible = visible

    def restart(self) -> None:
        """Move the gizmos to the initial positions of their hands."""
        for gizmo, start in zip(self._gizmos, self._starts, strict=True):
            gizmo.position = start
        for slider in self._squeezes:
            slider.value = 0.0

    def fits(self, message: dict[str, Any]) -> bool:
        """Tell whether a message is for one of these gizmos, and its position within reach."""
        name = message["name"]
        if not name.startswith(PREFIX) or not name[len(PREFIX) :].isdecimal():
            return False
        number = int(name[len(PREFIX) :])
        if number >= len(self._starts):
            return False
        if "position" not in message:
            return True
        away = np.asarray(message["position"], dtype=float) - self._starts[number]
        return bool(np.abs(away).max() <= REACH * self._extent)

    def _leader(self, number: int) -> Callable[[Any], Any]:
        async def lead(event: Any) -> None:  # on the page's thread, which keeps the order of events
            if event.phase == "update" and event.client_id is not None:
                offset = np.asarray(event.target.position, dtype=float) - self._starts[number]
                self._run.guide(number, offset[: self._dimensions])
                self._wake()

        return lead

    def _squeezer(self, number: int) -> Callable[[Any], Any]:
        async def squeeze(event: Any) -> None:
            if event.client_id is not None:
                self._run.guide(number, None, 1e-3 * float(event.target.value))
                self._wake()

        return squeeze


def _squeezes(guide: Guide) -> bool:
    """Tell whether a guide moves a whole hand, which can squeeze."""
    return guide.place is None


def _spatial(position: Any) -> Any:
    place = np.zeros(3)
    place[: len(position)] = position
    return place
