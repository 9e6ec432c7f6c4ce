"""3-D scene on the page: objects, obstacles, fingertips coloured by contact state, and forces as arrows."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspfx.live.frame import Frame
from graspfx.live.scenery import Scenery, Solid
from graspfx.show.style import CONTACTS, EXTERNAL, GRID, INTERNAL, PALE

if TYPE_CHECKING:
    import viser

SHAFT, HEAD, LONG = 0.009, 0.022, 0.05  # radius of shaft, radius of head, length of head, as shares of the extent
MOST_HEAD = 0.6  # longest head, as a share of the arrow
ROUGH = 0.01  # relative change of length below which an arrow is not redrawn


def rgb(colour: str) -> tuple[int, int, int]:
    """Convert "#rrggbb" to three numbers up to 255."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def linear(colour: str) -> tuple[int, int, int]:
    """Convert "#rrggbb" to linear colour (IEC 61966-2-1), which viser expects for arrows only."""
    shares = [each / 255.0 for each in rgb(colour)]
    light = [each / 12.92 if each <= 0.04045 else ((each + 0.055) / 1.055) ** 2.4 for each in shares]
    red, green, blue = (round(255.0 * each) for each in light)
    return red, green, blue


class ForceArrow:
    """Arrow along its own z axis.

    A browser moves a node at once but redraws its geometry later. The arrow is therefore moved as a node, so that it
    does not lag behind its finger, and redrawn only when its length changes.

    Args:
        api: Scene API of the page.
        name: Name of the node.
        colour: Colour as "#rrggbb".
        extent: Size of the scene [m].
    """

    def __init__(self, api: Any, name: str, colour: str, extent: float) -> None:
        self._extent, self._length, self._pulls = extent, 0.0, False
        self._node = api.add_arrows(
            name, np.array([[[0.0, 0.0, -extent], [0.0, 0.0, 0.0]]]), linear(colour), shaft_radius=SHAFT * extent,
            head_radius=HEAD * extent, head_length=LONG * extent, visible=False,
        )  # fmt: skip

    def show(self, arrow: Arrow | None) -> None:
        """Show a force; None hides the arrow."""
        if arrow is None:
            if self._node.visible:
                self._node.visible = False
            return
        if abs(arrow.length - self._length) > ROUGH * self._length or arrow.pulls != self._pulls:
            self._length, self._pulls = arrow.length, arrow.pulls
            ends = (0.0, arrow.length) if arrow.pulls else (-arrow.length, 0.0)
            self._node.points = np.array([[[0.0, 0.0, z] for z in ends]], dtype=np.float32)
            head = min(LONG * self._extent, MOST_HEAD * arrow.length)
            if head != self._node.head_length:
                self._node.head_length = head
        self._node.position, self._node.wxyz = arrow.at, from_z(arrow.along)
        if not self._node.visible:
            self._node.visible = True


def from_z(along: Any) -> tuple[float, float, float, float]:
    """Return the shortest rotation from the z axis to a unit vector, as a quaternion w, x, y, z."""
    x, y, z = (float(each) for each in along)
    if z < -1.0 + 1e-9:
        return 0.0, 1.0, 0.0, 0.0
    w = float(np.sqrt(0.5 * (1.0 + z)))
    return w, -0.5 * y / w, 0.5 * x / w, 0.0


LONGEST = 0.42  # longest arrow, as a share of the extent
SHORTEST = 0.04  # shortest arrow, as a share of the longest
BESIDE = 0.014  # lateral offset of an arrow, as a share of the extent
NICE = (1.0, 2.0, 5.0)
LEAST_FORCE, MOST_FORCE = 1e-6, 1e6  # range of the force of a full-length arrow [N]


class Arrow(NamedTuple):
    """Arrow of a force.

    Attributes:
        finger: Number of the finger.
        is_internal: Whether the force is internal (squeeze) or external (push).
        at: Point on the fingertip where the arrow ends, or begins if it pulls (3,) [m].
        along: Unit vector of the force (3,).
        length: Length of the arrow [m].
        pulls: Whether the force points away from the object.
    """

    finger: int
    is_internal: bool
    at: FloatArray
    along: FloatArray
    length: float
    pulls: bool


def arrows(frame: Frame, scale: float, radii: FloatArray, extent: float, towards: FloatArray) -> list[Arrow]:
    """Place arrows outside the object: a pushing arrow ends at the fingertip, a pulling one begins there.

    Args:
        frame: Frame to draw.
        scale: Scale of arrows [m/N].
        radii: Radii of the fingertips (n,) [m].
        extent: Size of the scene [m].
        towards: Unit vector to the camera (3,); the two arrows of a finger are drawn side by side for this view.
    """
    result = list[Arrow]()
    for is_internal, forces in ((True, frame.internal), (False, frame.external)):
        if forces is None or frame.force is None:
            continue
        sizes = np.linalg.norm(forces, axis=1)
        seen = np.isfinite(sizes) & (sizes * scale > SHORTEST * LONGEST * extent)
        for i in np.flatnonzero(seen & np.isfinite(frame.fingertips).all(axis=1)):
            along = forces[i] / sizes[i]
            sideways = np.cross(towards, frame.force[i])
            width = float(np.linalg.norm(sideways))
            sideways = (
                (1.0 if is_internal else -1.0) * BESIDE * extent * sideways / width if width > 0.0 else np.zeros(3)
            )
            pulls = bool(forces[i] @ frame.force[i] < 0.0)
            at = frame.fingertips[i] + sideways + (1.0 if pulls else -1.0) * radii[i] * along
            length = min(float(sizes[i]) * scale, 3.0 * LONGEST * extent)
            result.append(Arrow(int(i), is_internal, at, along, length, pulls))
    return result


class Scale:
    """Scale of arrows: 1, 2 or 5 times a power of ten; it changes only when forces leave its range.

    Args:
        extent: Size of the scene [m].

    Attributes:
        full: Force of a full-length arrow [N].
        metres: Length of an arrow per force [m/N].
    """

    def __init__(self, extent: float) -> None:
        self._extent = extent
        self._greatest = 0.0
        self.full = 0.0

    @property
    def metres(self) -> float:
        return LONGEST * self._extent / (self.full or 1.0)

    def follow(self, frame: Frame, seconds: float) -> bool:
        """Adapt to the forces of a frame, `seconds` after the last one; return whether the scale changes."""
        parts = [part for part in (frame.internal, frame.external) if part is not None]
        now = max((float(np.nanmax(np.linalg.norm(part, axis=1), initial=0.0)) for part in parts), default=0.0)
        now = min(now, MOST_FORCE) if np.isfinite(now) else 0.0
        self._greatest = max(now, self._greatest * 0.5 ** (seconds / 4.0))  # halves in 4 s
        if self._greatest < LEAST_FORCE or (self.full / 6.0 < self._greatest <= self.full):
            return False
        before, self.full = self.full, _nice_above(1.1 * self._greatest)
        return self.full != before

    @property
    def text(self) -> str:
        """Description of the scale."""
        return f"1 N is {1e3 * self.metres:.3g} mm long" if self.full else "no force yet"


def _nice_above(value: float) -> float:
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(each * power for each in (*NICE, 10.0) if each * power >= value * (1.0 - 1e-9)))


FloatArray = NDArray[np.float64]

FARTHER = 2.0  # distance of the camera relative to pictures, because of panels and moving hands
SKY, SUN = 2.0, 1.2  # intensities of the lights
OPACITY = 0.45  # opacity of objects, so that fingers behind them are visible
CELLS = 20  # cells along the floor's grid


class SceneTree:
    """3-D scene on the page.

    Args:
        server: Server of the page.
        scenery: Scenery of the scene.

    Attributes:
        scale: Scale of the arrows.
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
        """Draw a frame; return whether the scale of the arrows has changed."""
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
        """Set the lights so that surfaces facing the camera have the colours of figures."""
        self._api.configure_default_lights(enabled=False, cast_shadow=False)
        self._api.configure_environment_map(None)
        self._api.add_light_ambient("/lights/sky", intensity=SKY)
        over = self._towards + self._scenery.up
        self._api.add_light_directional("/lights/sun", intensity=SUN, position=_triple(over))

    def _floor(self) -> None:
        """Draw a grid below the scene, or behind a planar one, with round cell sizes."""
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
