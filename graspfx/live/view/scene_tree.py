"""The scene on the page: objects, obstacles, fingertips by the state of their contacts, and forces as arrows."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx.live.arrow_places import Scale, arrows
from graspfx.live.frame import Frame
from graspfx.live.scenery import Scenery, Solid
from graspfx.live.view.force_arrow import ForceArrow, rgb
from graspfx.show.style import CONTACTS, EXTERNAL, GRID, INTERNAL, PALE

if TYPE_CHECKING:
    import viser

FloatArray = NDArray[np.float64]

FARTHER = 2.0  # than pictures are seen from: panels take a part of the page, and hands move
SKY, SUN = 2.0, 1.2  # intensities of light
OPACITY = 0.45  # of objects: what touches them from behind is seen
CELLS = 20  # along the floor's grid


class SceneTree:
    """A scene as it is drawn in space.

    Args:
        server: of the page.
        scenery: of the scene.

    Attributes:
        scale: of the arrows.
    """

    def __init__(self, server: viser.ViserServer, scenery: Scenery) -> None:
        self._scenery, self.scale = scenery, Scale(scenery.extent)
        self._api = api = server.scene
        camera, start = scenery.camera, server.initial_camera
        offset = camera.position - camera.target
        self._towards = offset / np.linalg.norm(offset)
        api.set_up_direction(_triple(scenery.up))
        start.position, start.look_at = _triple(camera.target + FARTHER * offset), _triple(camera.target)
        start.up, start.fov = _triple(camera.up), float(np.radians(camera.field))
        start.near, start.far = 1e-3 * scenery.extent, 100.0 * scenery.extent
        api.set_background_image(np.full((1, 1, 3), 252, dtype=np.uint8))
        self._lights()
        self._objects: dict[str, list[Any]] = {}
        for solid in scenery.solids:
            handle = self._solid(solid)
            if solid.object is not None:
                self._objects.setdefault(solid.object, []).append(handle)
        self._floor()
        self._tips = [
            api.add_icosphere(f"/fingers/{i}", float(scenery.radii[i]), rgb(CONTACTS["free"]), subdivisions=3)
            for i in range(len(scenery.fingers))
        ]
        self._colours = [""] * len(self._tips)
        self._tip_places = np.full((len(self._tips), 3), np.nan)
        self._arrows = {
            (i, is_internal): ForceArrow(api, f"/forces/{i}-{kind}", colour, scenery.extent)
            for i in range(len(scenery.fingers))
            for is_internal, kind, colour in ((True, "internal", INTERNAL), (False, "external", EXTERNAL))
        }
        self._last = float("nan")

    def show(self, frame: Frame) -> bool:
        """Draw an instant; tell whether the arrows' scale has changed."""
        for name, pose in frame.objects.items():
            for handle in self._objects.get(name, ()):
                if np.isfinite(pose.position).all():
                    handle.position, handle.wxyz = pose.position, pose.wxyz
        for i, tip in enumerate(self._tips):
            place, state = frame.fingertips[i], frame.states[i]
            if np.isfinite(place).all() and not np.array_equal(place, self._tip_places[i]):
                tip.position = self._tip_places[i] = place
            if state != self._colours[i]:
                tip.color, self._colours[i] = rgb(CONTACTS[state]), state
        elapsed = frame.time - self._last
        self._last = frame.time
        changed = self.scale.follow(frame, elapsed if 0.0 <= elapsed < 1.0 else 0.0)
        scenery = self._scenery
        places = arrows(frame, self.scale.metres, scenery.radii, scenery.extent, self._towards)
        placed = {(each.finger, each.is_internal): each for each in places}
        for key, arrow in self._arrows.items():
            arrow.show(placed.get(key))
        return changed

    def _solid(self, solid: Solid) -> Any:
        moves = solid.object is not None and not solid.fixed
        return self._api.add_mesh_simple(
            f"/{'objects' if solid.object is not None else 'obstacles'}/{solid.name}", solid.vertices, solid.faces,
            color=rgb(solid.colour), opacity=OPACITY if moves else None, flat_shading=False,
            side="double" if solid.endless else "front", cast_shadow=False, receive_shadow=False,
        )  # fmt: skip

    def _lights(self) -> None:
        """Light the scene so that what faces the camera has the colours of figures."""
        self._api.configure_default_lights(enabled=False, cast_shadow=False)
        self._api.configure_environment_map(None)
        self._api.add_light_ambient("/lights/sky", intensity=SKY)
        over = self._towards + self._scenery.up
        self._api.add_light_directional("/lights/sun", intensity=SUN, position=_triple(over))

    def _floor(self) -> None:
        """Draw a grid below, or behind what happens in the plane, of round cells."""
        scenery = self._scenery
        low = min((float((s.vertices @ scenery.up).min()) for s in scenery.solids if s.object is None), default=0.0)
        is_space = bool(scenery.up[2])
        cell = 10.0 ** np.ceil(np.log10(scenery.extent / 8.0))
        cell = next(each * cell for each in (0.1, 0.2, 0.5, 1.0) if each * cell >= scenery.extent / 8.0)
        depth = min(low, float(scenery.middle[2]) - 0.62 * scenery.extent) if is_space else -0.35 * scenery.extent
        at = np.round(scenery.middle / cell) * cell
        self._api.add_grid(
            "/grid", width=CELLS * cell, height=CELLS * cell, plane="xy", cell_size=cell, section_size=5.0 * cell,
            cell_color=rgb(GRID), section_color=rgb(PALE), cell_thickness=0.6, section_thickness=0.8,
            position=(float(at[0]), float(at[1]), depth), shadow_opacity=0.0,
        )  # fmt: skip


def _triple(vector: FloatArray) -> tuple[float, float, float]:
    x, y, z = (float(each) for each in vector)
    return x, y, z
