"""A validated scene, which is the input of a run, with its source."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Self

from pydantic import PrivateAttr
from pydantic_core import PydanticSerializationError, to_jsonable_python

from graspfx.card import Card, Carded, counted, listed, setting, span
from graspfx.errors import Fault, InputError, SceneError
from graspfx.scene.keys import Key, as_faults, parts_of
from graspfx.scene.overrides import by_key, is_within, overridden, replacing
from graspfx.scene.source import Source
from graspfx.scene.tables.reading import WIDTHS, Readable
from graspfx.scene.tables.scene_table import COUPLING, OBJECT, SceneTable
from graspfx.scene.toml_text import KeyLines

if TYPE_CHECKING:
    from graspfx.analysis.linearisation import Linearisation


class Scene(Carded, SceneTable):
    """A scene, validated when it is created, as in `Scene(dimensions=1, period=0.005, object={"mass": 0.1}, ...)`.

    The fields have the names of the keys of a scene file. The lists of tables `object`, `finger`, `device`, `hand` and
    `obstacle` are tuples.

    Raises:
        SceneError: If the scene has faults; the message lists all of them.
    """

    _source: Source = PrivateAttr(default_factory=Source)
    _stock: Any = PrivateAttr(default=None)  # devices and meshes that the checks loaded, for `graspfx.assembly.resolve`

    def __init__(self, source: Source | None = None, /, **table: Any) -> None:
        from graspfx.assembly.checks.faults import find_faults

        if source is not None and not isinstance(source, Source):
            raise InputError("Scene", source, "keys and values: Scene(dimensions=1, ...)", "pass a table as **table")
        if table.get("host") is not None:  # whose program simulates the object
            table = without_object(table)
        origin = source or Source()
        faults, stock = find_faults(table, origin)
        if faults:
            raise SceneError(origin.name, faults)
        valid = SceneTable(**table)  # reuses the validator of the checks, because building another validator takes time
        self.__setstate__({
            "__dict__": vars(valid), "__pydantic_fields_set__": valid.model_fields_set, "__pydantic_extra__": None,
            "__pydantic_private__": {"_source": origin, "_stock": stock},
        })  # fmt: skip

    def __eq__(self, other: object) -> bool:
        """Return whether two scenes have the same tables; their sources may differ."""
        return isinstance(other, Scene) and self.to_dict() == other.to_dict()

    __hash__ = None  # type: ignore[assignment]

    def __copy__(self) -> Self:
        """Return a copy without the loaded devices and meshes, so that a copy with other fields loads its own."""
        copy = super().__copy__()
        copy._stock = None
        return copy

    def _card(self) -> Card:
        return scene_card(self, self._source)

    def __str__(self) -> str:
        return repr(self)

    def __dir__(self) -> list[str]:
        own = {name for each in (Scene, Readable) for name in vars(each) if not name.startswith(("_", "model_"))}
        return sorted({*SceneTable.model_fields, *own})

    @property
    def source(self) -> Source:
        """Source of the scene: its file, preset and overrides."""
        return self._source

    def to_dict(self) -> dict[str, Any]:
        """Return the scene as nested tables, without default values, as accepted by `Scene(**table)`.

        Raises:
            InputError: If the scene contains an object that cannot be written as data.
        """
        serializer = SceneTable.__pydantic_serializer__
        try:
            table: dict[str, Any] = serializer.to_python(self, mode="json", exclude_unset=True)
        except PydanticSerializationError as error:
            raise not_data(serializer.to_python(self, exclude_unset=True)) from error
        return table

    def require_reach(self) -> None:
        """Require that each finger's start is within reach of its simulated device, as at the start of a run.

        Raises:
            SceneError: If a finger starts where its device cannot reach; the message lists all such fingers.
        """
        from graspfx.assembly.resolve import reach_faults

        faults = reach_faults(self)
        if faults:
            raise self.error(faults)

    def error(self, faults: Iterable[tuple[Key, str]]) -> SceneError:
        """Return an error for faults at keys of the scene; the message states the line of each key in a TOML file."""
        source = self._source
        is_toml = source.path is not None and source.path.suffix == ".toml"
        table = tomllib.loads(source.text) if is_toml else self.to_dict()
        return _placed(source, table, as_faults(table, faults), source.text if is_toml else None)

    def linearise(self, at: str = "squeezed") -> Linearisation:
        """Linearise small motions about an equilibrium of the scene's grasp, for use with `gx.stability`.

        Args:
            at: State about which to linearise. "squeezed": equilibrium with stationary hands that are closed to their
                largest squeeze. "start": state in which the fingers touch the object for the first time, without force.
                "provisional": one linear step of the squeeze from the start. (`certificate.linearise` also returns the
                assumptions of the linearisation.)

        Raises:
            InputError: If a device does not state its mass or damping, if objects have different integrators, or if no
                finger touches an object in equilibrium.
            NoRestError: If no equilibrium of the grasp is found.
        """
        from graspfx.certificate.linearise import linearise

        return linearise(self, at).linear

    def to_html(
        self,
        path: str | PathLike[str],
        *,
        presets: Mapping[str, Mapping[str, float]] = MappingProxyType({}),
        overwrite: bool = False,
    ) -> Path:
        """Write a page that runs the scene in a browser, as one file that needs no installation, server or network.

        The page computes the ticks of the scene in WebAssembly. Users drag fingertips with the mouse or by touch.
        Sliders change values of the scene; the stability limits of these values are computed when the page is written.
        The page can save recordings, which `gx.Recording.load` reads.

        Args:
            path: Path of the file, which must end in .html. The file appears when it is complete.
            presets: Buttons of the page, by name. Each button sets sliders to the given values, by key.
            overwrite: Whether to replace an existing file.

        Raises:
            InputError: If the path does not end in .html; if a part of the scene is plain Python, PyBullet, MuJoCo or
                hardware; or if a preset has a key without a slider, or a value outside the slider's range.
            RecordingError: If the file exists or cannot be written.
            MissingPackageError: If the page has to be compiled in a checkout, and `ziglang` or llvmlite is missing.
        """
        from graspfx.live.page.document import write_running_page

        return write_running_page(self, path, presets=presets, overwrite=overwrite)

    def replace(self, overrides: Mapping[str, Any]) -> Scene:
        """Return a copy of the scene with values replaced by dotted key, as by `--set` on the command line."""
        changes = by_key(overrides)
        source = replace(self._source, overrides={**self._source.overrides, **changes})
        return make_scene(self.to_dict(), changes, source)


def without_object(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return the tables of a scene with a host, with an added coupling and an added object that never moves."""
    d = table.get("dimensions")
    thing = {**OBJECT, "free": (False,) * WIDTHS.get(d, 1) if isinstance(d, int) else ()}
    return {"object": thing, "coupling": dict(COUPLING), **table}


def make_scene(
    table: Mapping[str, Any], overrides: Mapping[str, Any], source: Source, *, lines_from: str | None = None
) -> Scene:
    """Return a scene from nested tables and overrides.

    If `lines_from` is the TOML text of the scene, the faults in an error have the lines of their keys in this text.

    Raises:
        SceneError: If the scene has faults; the message lists all of them.
    """
    data, _, faults = overridden(table, overrides)
    try:
        scene = Scene(source, **data)
    except SceneError as error:
        raise _placed(source, table, [*faults, *error.faults], lines_from) from None
    if faults:
        raise _placed(source, table, faults, lines_from)
    return scene


def _placed(source: Source, table: Mapping[str, Any], faults: Sequence[Fault], lines_from: str | None) -> SceneError:
    """Return an error with faults sorted by line, first those without line; `table` is the scene before overrides."""
    lines = KeyLines(lines_from) if lines_from is not None else None
    _, replaced, _ = overridden(table, source.overrides)
    placed = [_with_line(fault, source, table, replaced, lines) for fault in faults]
    return SceneError(source.name, sorted(placed, key=lambda fault: fault.line or 0))


def _with_line(
    fault: Fault, source: Source, table: Mapping[str, Any], replaced: set[Key], lines: KeyLines | None
) -> Fault:
    key = parts_of(fault.key)
    if is_within(key, replaced):
        value = source.overrides.get(fault.key)
        quotes = isinstance(value, int | float) and fault.message.startswith("expected text")
        hint = f"text needs quotes: --set '{fault.key}=\"{str(value).lower()}\"'; " if quotes else ""
        return Fault(fault.key, f"{fault.message} ({hint}set by an override)")
    if (name := replacing(table, source.preset_values, key)) is not None:
        line = lines["preset", source.preset, "set", name] if lines is not None else None
        return Fault(fault.key, f"{fault.message} (set by preset {source.preset!r})", line)
    return Fault(fault.key, fault.message, lines[key] if lines is not None else None)


def schema() -> dict[str, Any]:
    """Return the JSON schema of a scene file, which has either an object and a coupling, or a host."""
    described = SceneTable.model_json_schema()
    asked = [name for name in described["required"] if name in ("object", "coupling")]
    described["required"] = [name for name in described["required"] if name not in asked]
    described["anyOf"] = [{"required": asked}, {"required": ["host"]}]
    return described


EXPECTED = "numbers, texts, lists and tables: a recording stores its whole scene as data"
DO = "create it in a driver of your own, a Python file whose `connect` takes settings (docs/how-to/device.md)"


def not_data(table: Any) -> InputError:
    """Return the error for the first value in a table that cannot be written as data."""
    return next((InputError(key, value, EXPECTED, DO) for key, value in _leaves(table, "") if not _is_data(value)),
                InputError("scene", table, EXPECTED, DO))  # fmt: skip


def _is_data(value: object) -> bool:
    try:
        to_jsonable_python(value)
    except PydanticSerializationError:
        return False
    return True


def _leaves(value: Any, key: str) -> Iterator[tuple[str, Any]]:
    """Yield all values in nested tables and lists that are not tables or lists, each with its dotted key."""
    if isinstance(value, Mapping):
        items = [(str(name), each) for name, each in value.items()]
    elif isinstance(value, list | tuple):
        items = [(str(i), each) for i, each in enumerate(value)]
    else:
        yield key, value
        return
    for name, each in items:
        yield from _leaves(each, f"{key}.{name}" if key else name)


# Card ----------------------------------------------------------------------------------------------------------------


MOST = 4  # largest number of objects, or hands, that have a line each


def scene_card(scene: SceneTable, source: Source) -> Card:
    """Return the card that a console or notebook shows for a scene."""
    name = source.path.stem.replace("_", "-") if source.path is not None else source.name
    title = f"Scene {name}: {scene.title}" if scene.title else f"Scene {name}"
    calls = "gx.run(scene), gx.check(scene), gx.certify(scene), gx.open(scene), .replace({key: value}), .to_dict()"
    return Card(title, [*_rows(scene, source)], calls)


def _rows(scene: SceneTable, source: Source) -> Iterator[tuple[str, str]]:
    ticks = round(scene.duration / scene.period)
    yield "time", f"{scene.duration:g} s in {counted(ticks, 'tick')} of {1e3 * scene.period:g} ms"
    yield "space", f"{counted(scene.dimensions, 'dimension')}{_gravity(scene)}"
    yield "objects" if len(scene.object) > 1 else "object", "\n".join(_some(map(_object, scene.object)))
    yield "obstacles", listed(f"{each.name} ({each.shape.kind})" for each in scene.obstacle)
    yield "coupling", "\n".join(_coupling(scene))
    yield "fingers", "\n".join(_fingers(scene))
    yield "hands", "\n".join(_some(f"{each.name}: {_hand(each)}" for each in scene.hand))
    yield "presets", listed(f"{name}{' (active)' if name == source.preset else ''}" for name in scene.preset)
    yield "set", listed(setting(key, value) for key, value in source.overrides.items())
    yield "file", str(source.path or "")


def _some(lines: Iterator[str]) -> Iterator[str]:
    for k, line in enumerate(lines):
        if k < MOST:
            yield line
        elif k == MOST:
            yield "..."


def _gravity(scene: SceneTable) -> str:
    if scene.gravity is None:
        return ", no gravity"
    return f", gravity ({', '.join(f'{each:g}' for each in scene.gravity)}) m/s^2"


def _object(thing: Any) -> str:
    weight = f"{thing.mass:g} kg" if thing.mass is not None else f"{thing.density:g} kg/m^3"
    shape = f", {_shape(thing.shape)}" if thing.shape is not None else ""
    mover = f"native, {thing.integrator}" if thing.dynamics == "native" else thing.dynamics
    locked = "" if thing.free is None or all(thing.free) else f", locked: {_locked(thing.free)}"
    return f"{thing.name}: {weight}{shape}, viscosity {thing.viscosity:g} N s/m, {mover}{locked}"


def _locked(free: tuple[bool, ...]) -> str:
    names = {1: ("x",), 3: ("x", "y", "turn"), 6: ("x", "y", "z", "turn x", "turn y", "turn z")}[len(free)]
    return ", ".join(name for name, moves in zip(names, free, strict=True) if not moves)


def _shape(shape: Any) -> str:
    sizes = getattr(shape, "size", None)
    if sizes is not None:
        return f"{shape.kind} {' x '.join(f'{1e3 * each:g}' for each in sizes)} mm"
    radius = getattr(shape, "radius", None)
    if isinstance(radius, float):
        return f"{shape.kind} of radius {1e3 * radius:g} mm"
    file = getattr(shape, "mesh", None)
    return f"mesh {file}" if isinstance(file, str) else str(shape.kind)


def _coupling(scene: SceneTable) -> Iterator[str]:
    law = scene.coupling
    for name, part in (("external", law.external), ("internal", law.internal)):
        yield f"{name} {_gain(part.stiffness, 'N/m')}, {_gain(part.damping, 'N s/m')}"
    friction = "contacts stick" if law.friction == "stick" else f"friction {law.friction:g}"
    touch = "attached contacts" if law.contact == "attached" else f"fingers only push, {friction}"
    passivity = "" if law.passivity == "off" else f", passivity {law.passivity}"
    yield f"{touch}{passivity}"


def _gain(gain: Any, unit: str) -> str:
    return f"{gain:g} {unit}" if isinstance(gain, int | float) else f"matrix [{unit}]"


def _fingers(scene: SceneTable) -> Iterator[str]:
    fingers = scene.finger
    drivers: dict[str, int] = {}
    labels = {each.label: each.name for each in scene.device}
    for finger in fingers:
        name = finger.device if isinstance(finger.device, str) else finger.device.name
        driver = labels.get(name, name)
        drivers[driver] = drivers.get(driver, 0) + 1
    yield f"{len(fingers)}: {listed(scene.finger_names)}"
    devices = listed(f"{count} x {driver}" for driver, count in drivers.items())
    balls = [finger.radius for finger in fingers if finger.radius]
    tips = f"balls of {span((1e3 * each for each in balls), 'mm')}" if balls else "points"
    yield f"devices {devices}; fingertips are {tips}"
    own = [finger.hand for finger in fingers if finger.hand is not None and not isinstance(finger.hand, str)]
    if own:
        yield f"{counted(len(own), 'hand')} of their own: {_hand(own[0])}"


def _hand(hand: Any) -> str:
    parts = []
    for key in ("arm", "grip"):
        part = getattr(hand, key, None)
        if part is not None:
            parts.append(f"{key} {_gain(part.stiffness, 'N/m')}")
    stiffness = getattr(hand, "stiffness", None)
    if stiffness is not None:
        parts.append(_gain(stiffness, "N/m"))
    for key in ("motion", "turn"):
        course = getattr(hand, key, None)
        courses = course if isinstance(course, tuple) else () if course is None else (course,)
        if courses:
            parts.append(f"{key} {' + '.join(str(each.kind) for each in courses)}")
    squeeze = getattr(hand, "squeeze", None)
    if isinstance(squeeze, int | float) and squeeze:
        parts.append(f"squeeze {1e3 * squeeze:g} mm")
    elif isinstance(squeeze, tuple) and squeeze:
        parts.append(f"squeeze in {counted(len(squeeze), 'step')}")
    return ", ".join(parts) or "held"
