"""Tables of a scene file in SI units: object, obstacle, coupling, device, finger."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import AfterValidator, BeforeValidator, ConfigDict, Discriminator, Field, Tag, model_validator
from pydantic_core import PydanticCustomError

from graspfx.errors import abbreviate
from graspfx.objects.surroundings import STIFFNESS
from graspfx.scene.keys import current_setting
from graspfx.scene.tables.fields import (
    Count,
    Gain,
    Name,
    NotNegative,
    NotValid,
    NumberOrVector,
    Pair,
    Positive,
    Setting,
    Switch,
    Table,
    Vector,
    Vectors,
    as_float,
    no_negative,
    word_or_list,
)
from graspfx.scene.tables.hand_tables import HandOrName
from graspfx.scene.tables.safety_table import FingerSafety
from graspfx.scene.tables.shapes import Shape

BLEND_OF_OBJECT = (0.001, 0.01)  # [m]


class Object(Table):
    """An object that fingers move by eq. (27), m a + b v = f_v, in translation and rotation."""

    name: Name = Field(default="object", description="name that fingers and recordings refer to")
    mass: Positive | None = Field(
        default=None,
        description="mass m [kg]; this or the density is required",
        json_schema_extra={"excludes": "`density`"},
    )
    density: Positive | None = Field(
        default=None,
        description="density [kg/m^3]; only in space, for a shape with a volume",
        json_schema_extra={"excludes": "`mass`, an open mesh, `dimensions` below 3"},
    )
    viscosity: NotNegative = Field(description="viscosity b [N s/m]")
    rotational_viscosity: NotNegative | None = Field(
        default=None, description="rotational viscosity [N m s/rad]; required if a rotation is free"
    )
    inertia: NumberOrVector | None = Field(
        default=None,
        description="moment of inertia about the centre [kg m^2]; that of the solid shape or shell if not given",
        json_schema_extra={"excludes": "`dimensions = 1`"},
    )
    shape: Shape | None = Field(default=None, description="shape of the surface; required for unilateral contact")
    free: (
        Annotated[tuple[Switch, ...], Field(description="mask of free degrees of freedom, (w,); default: all")] | None
    ) = None
    dynamics: str = Field(
        default="native", description="dynamics engine: native, bullet, mujoco or another name from `graspfx list`"
    )
    integrator: Literal["explicit", "semi-implicit", "exact", "implicit"] = Field(
        default="exact",
        description="integrator of the motion under a force that is constant over a tick; implicit solves for force "
        "and motion together",
    )
    position: Vector | None = Field(
        default=None,
        description="initial position of the centre, or of a mesh file's origin, (d,) [m]; zero if not given",
    )
    orientation: NumberOrVector | None = Field(
        default=None,
        description="initial orientation: an angle [rad] in the plane, a unit quaternion x, y, z, w in space",
        json_schema_extra={"excludes": "`dimensions = 1`"},
    )
    velocity: Vector | None = Field(default=None, description="initial velocity, (d,) [m/s]; zero if not given")
    angular_velocity: NumberOrVector | None = Field(
        default=None,
        description="initial angular velocity [rad/s]; in space (3,); zero if not given",
        json_schema_extra={"excludes": "`dimensions = 1`"},
    )


class Obstacle(Table):
    """A fixed body that objects meet: a floor, a wall, a table. Fingers pass through it."""

    name: Name = Field(default="obstacle", description="name in messages")
    shape: Shape = Field(description="shape of the surface")
    position: Vector | None = Field(default=None, description="position of the centre, (d,) [m]; zero if not given")
    orientation: NumberOrVector | None = Field(
        default=None,
        description="orientation: an angle [rad] in the plane, a unit quaternion x, y, z, w in space",
        json_schema_extra={"excludes": "`dimensions = 1`"},
    )


class World(Table):
    """Contact of objects with obstacles and with one another. The coupling defines contact with fingers."""

    friction: NotNegative = Field(default=0.5, description="Coulomb coefficient of every pair")
    restitution: Annotated[NotNegative, Field(le=1)] = Field(
        default=0.0, description="ratio of separation speed to approach speed; must be 0 for native objects"
    )
    stiffness: Positive = Field(
        default=STIFFNESS, description="stiffness of a contact point of a native object on an obstacle [N/m]"
    )
    collide: Switch | None = Field(
        default=None,
        description="whether objects meet one another; by default true in space with dynamics = 'bullet' or 'mujoco'",
    )


class Impedance(Table):
    """Stiffness and damping of eq. (4), as a number, one per finger, or matrices in the axes of `coupling.axes`."""

    stiffness: Gain = Field(description="K [N/m]: a number, one per finger, or matrices")
    damping: Gain = Field(default=0.0, description="D [N s/m], in the same forms")


class ObjectImpedance(Table):
    """Displayed stiffness and damping of the object, in the axes of its shape, distributed over its fingers."""

    object_stiffness: Gain = Field(
        description="K_o at zero squeeze, (w, w), translations before rotations [N/m, N, N m/rad]; or its diagonal as "
        "a list; on a line a number"
    )
    object_damping: Gain | None = Field(default=None, description="D_o, in the same forms; zero if not given")
    object_point: Vector | None = Field(
        default=None,
        description="reference point of K_o and D_o, from the centre of mass (d,) [m]; the centre of mass if not given",
    )

    @property
    def stiffness(self) -> tuple[tuple[float, ...], ...]:
        """K_o as a square matrix."""
        return _square(self.object_stiffness)

    @property
    def damping(self) -> tuple[tuple[float, ...], ...]:
        """D_o as a square matrix."""
        if self.object_damping is None:
            size = len(self.stiffness)
            return ((0.0,) * size,) * size
        return _square(self.object_damping)

    if not TYPE_CHECKING:  # a visible __getattr__ would hide misspelt names from the type checker

        def __getattr__(self, name: str) -> Any:
            if name in ("stiffness", "damping"):
                raise NotValid(name)  # in a draft that lacks the fields of the property
            return super().__getattr__(name)


def _square(gain: Any) -> tuple[tuple[float, ...], ...]:
    """Return a gain of an object as a square matrix; a number or a list is its diagonal."""
    rows = (gain,) if isinstance(gain, float) else gain
    if isinstance(rows[0], tuple):
        return tuple(rows)
    return tuple(tuple(value if i == j else 0.0 for j in range(len(rows))) for i, value in enumerate(rows))


_by_whose = Discriminator(lambda value: "<object>" if _is_of_object(value) else "<fingers>")
ImpedanceOfEither = Annotated[
    Annotated[Impedance, Tag("<fingers>")] | Annotated[ObjectImpedance, Tag("<object>")], _by_whose
]


def _is_of_object(value: Any) -> bool:
    keys = value if isinstance(value, Mapping) else ()
    return isinstance(value, ObjectImpedance) or any(str(key).startswith("object_") for key in keys)


PairOrAuto = Annotated[Annotated[Literal["auto"], Tag("<name>")] | Annotated[Pair, Tag("<list>")], word_or_list]
PairOrOff = Annotated[Annotated[Literal["off"], Tag("<name>")] | Annotated[Pair, Tag("<list>")], word_or_list]


AxesOrMatrix = Annotated[Annotated[str, Tag("<name>")] | Annotated[Vectors, Tag("<list>")], word_or_list]


def _friction(value: Any) -> Any:
    if isinstance(value, str) and value == "stick":
        return value
    if isinstance(value, int | float) and not isinstance(value, bool) and 0.0 <= as_float(value) < math.inf:
        return float(value)
    text = "expected a finite coefficient of friction, 0 or more, or 'stick'; given {given}"
    raise PydanticCustomError("friction", text, {"given": abbreviate(value)})


def _model(value: Any) -> Any:
    if isinstance(value, str) and value in ("frictionless", "full"):
        text = "expected 'hard' or 'soft': {given} is a contact for analysis (gx.Grasp), not for a run"
        raise PydanticCustomError("model", text, {"given": abbreviate(value)})
    return value


class Coupling(Table):
    """Coupling of fingers and object: eq. (4) and the rules of contact."""

    contact: Literal["unilateral", "attached"] = Field(
        default="unilateral",
        description="unilateral: fingers only push, and can let go; attached: they always hold a point of the object",
    )
    external: ImpedanceOfEither = Field(
        description="kep and ked of eq. (4), which move the object; or the stiffness and damping of the object itself"
    )
    internal: Impedance = Field(description="kip and kid of eq. (4), which squeeze the object")
    form: Literal["literal", "symmetric"] = Field(
        default="literal",
        description="rule for gains that differ between fingers: eq. (4) literally, or P K P + (I - P) K (I - P)",
    )
    axes: Literal["object", "world", "contact"] = Field(
        default="object",
        description="axes of gains that are matrices: those of the object's shape, in which springs create no energy; "
        "the world's; or each contact's, the normal first, as diag(k_n, k_t) or diag(k_n, k_t, k_t)",
    )
    reaction: Literal["fingertip", "contact"] = Field(
        default="fingertip", description="point where a force acts on the object"
    )
    friction: Annotated[Literal["stick"] | float, BeforeValidator(_friction)] = Field(
        default=0.0, description="0 (slips freely), 'stick' (holds the point of first touch) or a Coulomb coefficient"
    )
    split: Literal["pseudoinverse", "mass", "weights"] = Field(
        default="pseudoinverse",
        description="weights of fingers in the split and the gains: equal (eq. 3), by device mass, or `weights`",
    )
    weights: Vector | None = Field(
        default=None,
        description="weight of each finger of the scene, above zero; weights are scaled to a mean of 1 on each object",
        json_schema_extra={"excludes": '`split = "pseudoinverse"`, `split = "mass"`'},
    )
    metric: Literal["equal", "mass"] = Field(
        default="equal",
        description='alternative name of `split`: "mass" is `split = "mass"`, "equal" is `split = "pseudoinverse"`',
    )
    absent: Literal["fade", "follow"] = Field(
        default="fade",
        description="role of a free finger: it fades out of the split as its gap grows, or remains in the split",
    )
    fade: PairOrAuto = Field(
        default="auto",
        description="gaps between which a free finger fades out of the split [m]; 'auto': [0.002, 0.01], or more if "
        "the gains and the hands' squeeze require it",
    )
    passivity: Literal["off", "observe", "control"] = Field(
        default="off",
        description="energy of each mode: not computed, recorded, or also dissipated in the modes that create it",
    )
    damping_depth: NotNegative = Field(
        default=0.0,
        description="penetration depth over which a touching finger's damping grows to its value [m]; at once if 0",
    )
    force_bound: Positive = Field(
        default=1e4,
        description="largest force of a finger from the coupling law [N]; a larger one is a fault that names the gain, "
        "and all forces become zero",
    )
    enter: Literal["refuse", "ramp"] = Field(
        default="refuse",
        description="start of a run with a hardware finger inside its object: refuse it, or ramp the finger's force up",
    )
    blend: PairOrOff = Field(
        default=(0.00025, 0.001),
        description="rms lever arms between which a rotation fades into the external space [m]; 'off': it enters with "
        "any arm, as in eq. (4); [0.001, 0.01] with an `object_stiffness`, because short arms make a fingertip stiff",
    )

    @model_validator(mode="after")
    def _widen(self) -> Self:
        if isinstance(self.__dict__.get("external"), ObjectImpedance) and "blend" not in self.model_fields_set:
            self.__dict__["blend"] = BLEND_OF_OBJECT
        if self.__dict__.get("metric") == "mass" and "split" not in self.model_fields_set:
            self.__dict__["split"] = "mass"
        return self


class Frame(Table):
    """Pose of a device, p = origin + scale R p_device; its forces are scale R' times the scene's, at equal power."""

    origin: Vector | None = Field(
        default=None, description="position of the device, (d,) [m]; the scene's origin if not given"
    )
    axes: AxesOrMatrix | None = Field(
        default=None,
        description="device axis along each axis of the scene, as in 'x -z y', or R with a row for each axis of the "
        "scene; the same axes if not given",
    )
    scale: Positive = Field(default=1.0, description="metres in the scene per metre of the device")


def _range(value: tuple[float, float]) -> tuple[float, float]:
    low, high = value
    if low <= high:
        return value
    text = "expected the smaller number first; given {given}"
    raise PydanticCustomError("range", text, {"given": abbreviate(list(value))})


class Measures(Table):
    """Measured properties of a device, as written by `graspfx calibrate`; they replace its driver's values."""

    mass: Positive | None = Field(default=None, description="effective mass at a fingertip [kg]")
    friction: NotNegative | None = Field(default=None, description="viscous friction at a fingertip [N s/m]")
    resolution: Positive | None = Field(default=None, description="resolution of a fingertip position [m]")
    latency: NotNegative | None = Field(default=None, description="age of a sample when it is read [s]")
    lateness: NotNegative | None = Field(
        default=None,
        description="time from the reading of a sample to its force, without the half period of the hold [s]",
    )
    jitter: Annotated[Pair, AfterValidator(no_negative), AfterValidator(_range)] | None = Field(
        default=None, description="1st and 99th percentile of the lateness; certificates use the worse one [s]"
    )
    round_trip: NotNegative | None = Field(
        default=None,
        description="duration of reading and writing, included in the lateness; a recording's value replaces it [s]",
    )


class Device(Table):
    """A driver with its settings: keys that all devices have, and the arguments of the driver's `connect`."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, Setting]

    name: str = Field(description="a driver's name, or the path of a .py file")
    frame: Frame | None = Field(default=None, description="pose of the device in the scene; identity if not given")
    deadman: Count | None = Field(
        default=None,
        description="index of the device's switch, from 0, that must be pressed; forces decay when it is released",
    )
    measures: Measures | None = Field(
        default=None, description="measured properties of the device, which replace its driver's"
    )
    rate: Positive | None = Field(
        default=None, description="highest rate at which hardware is called [Hz]; every tick if not given"
    )

    @property
    def settings(self) -> dict[str, Any]:
        """Other keys of the table, under the current names of the driver's settings."""
        return {current_setting(self.name, key): value for key, value in (self.model_extra or {}).items()}

    @property
    def former(self) -> dict[str, str]:
        """Settings under former names, with their current names."""
        return {key: now for key in self.model_extra or {} if (now := current_setting(self.name, key)) != key}


class SharedDevice(Device):
    """A device with several fingers, which name it by its label."""

    label: Name = Field(description="name that fingers refer to")


_by_name = Discriminator(lambda value: "<name>" if isinstance(value, str) else "<table>")
DeviceOrName = Annotated[Annotated[str, Tag("<name>")] | Annotated[Device, Tag("<table>")], _by_name]


class Pad(Table):
    """A compliant fingertip in series with the coupling: f_n = k depth^1.5 along the contact's normal (Hertz)."""

    kind: Literal["hertz"]
    stiffness: Positive = Field(description="k [N/m^1.5]; 4/3 E* sqrt(R) for a ball on a plane")


class Placement(Table):
    """A start position given by a direction from the object's centre and a gap, instead of coordinates."""

    toward: Vector = Field(
        description="direction from the object's initial centre of mass, in world axes, of any length, (d,)"
    )
    gap: NotNegative = Field(
        default=0.0, description="gap between the fingertip, including its ball, and the surface [m]"
    )


_by_place = Discriminator(lambda value: "<table>" if isinstance(value, Mapping | Table) else "<list>")
PointOrPlacement = Annotated[Annotated[Vector, Tag("<list>")] | Annotated[Placement, Tag("<table>")], _by_place]


class Finger(Table):
    """A fingertip: its device, its hand, and the object that it touches."""

    name: Name | None = Field(default=None, description="name in recordings and figures; finger0, ... if not given")
    device: DeviceOrName = Field(description="device table, or label of a [[device]]")
    channel: Count = Field(default=0, description="index of the finger on the device")
    hand: HandOrName | None = Field(default=None, description="hand table, or name of a [[hand]]")
    start: PointOrPlacement = Field(
        description="start position, (d,) [m]; or a direction from the object's centre, and a gap"
    )
    radius: NotNegative = Field(default=0.0, description="radius of a ball fingertip [m]; 0 for a point")
    object: Name | None = Field(default=None, description="name of an [object]; the first if not given")
    model: Annotated[Literal["hard", "soft"], BeforeValidator(_model)] = Field(
        default="hard",
        description="contact model; a soft finger also exerts torsion about the contact's normal, in space",
    )
    patch: Positive | None = Field(
        default=None,
        description="patch length rho of a soft finger [m]; with friction mu its torsion is at most mu rho f_n",
        json_schema_extra={"excludes": '`model = "hard"`'},
    )
    friction: NotNegative | None = Field(
        default=None,
        description="finger's own coefficient of friction; coupling.friction if not given",
        json_schema_extra={"excludes": '`coupling.contact = "attached"`, `coupling.friction = "stick"`'},
    )
    pad: Pad | None = Field(
        default=None,
        description="compliant fingertip: f_n = k depth^1.5 [N] along the normal; eq. (4) receives e_n less the depth "
        "[m]; for unilateral contacts",
        json_schema_extra={"excludes": '`coupling.contact = "attached"`, `integrator = "implicit"` with damping'},
    )
    safety: FingerSafety | None = Field(default=None, description="finger's own limits, in a scene with [safety]")


def _listed(value: Any) -> Any:
    return [value] if isinstance(value, str) else value


class Record(Table):
    """Columns and ticks of a recording; a list is short for a table with these columns."""

    columns: Annotated[tuple[str, ...], BeforeValidator(_listed)] = Field(
        default=(), description="names of the file's variables, or of groups of them; all if not given"
    )
    every: Annotated[int, Field(strict=True, ge=1)] = Field(default=1, description="ticks from one row to the next")
    compression: Literal["none", "lzf", "gzip"] = Field(default="none", description="compression when the run ends")
