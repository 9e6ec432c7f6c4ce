"""Tables of the parts of a scene, in SI units: object, obstacle, coupling, device and finger."""

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
    """An object that fingers move by eq. (27), m a + b v = f_v, in translation and in rotation."""

    name: Name = Field(default="object", description="name by which fingers and recordings refer to the object")
    mass: Positive | None = Field(
        default=None,
        description="mass m [kg]; required if there is no density",
        json_schema_extra={"excludes": "`density`"},
    )
    density: Positive | None = Field(
        default=None,
        description="density [kg/m^3]; only in space, and for a shape with a volume",
        json_schema_extra={"excludes": "`mass`, an open mesh, `dimensions` below 3"},
    )
    viscosity: NotNegative = Field(description="viscosity b [N s/m]")
    rotational_viscosity: NotNegative | None = Field(
        default=None, description="rotational viscosity [N m s/rad]; required if a rotation is free"
    )
    inertia: NumberOrVector | None = Field(
        default=None,
        description="moment of inertia about the centre [kg m^2]; computed from the shape, solid or shell, if not "
        "given",
        json_schema_extra={"excludes": "`dimensions = 1`"},
    )
    shape: Shape | None = Field(default=None, description="shape of the surface; required for unilateral contact")
    free: (
        Annotated[tuple[Switch, ...], Field(description="mask (w,) of the free degrees of freedom; all if not given")]
        | None
    ) = None
    dynamics: str = Field(
        default="native", description="dynamics engine: native, bullet, mujoco, or a name that `graspfx list` shows"
    )
    integrator: Literal["explicit", "semi-implicit", "exact", "implicit"] = Field(
        default="exact",
        description="integrator of the motion under a force that is constant over a tick; with implicit, force and "
        "motion are solved for together",
    )
    position: Vector | None = Field(
        default=None,
        description="initial position of the centre, or of the origin of a mesh file, (d,) [m]; zero if not given",
    )
    orientation: NumberOrVector | None = Field(
        default=None,
        description="initial orientation: an angle [rad] in the plane, a unit quaternion (x, y, z, w) in space",
        json_schema_extra={"excludes": "`dimensions = 1`"},
    )
    velocity: Vector | None = Field(default=None, description="initial velocity, (d,) [m/s]; zero if not given")
    angular_velocity: NumberOrVector | None = Field(
        default=None,
        description="initial angular velocity [rad/s]: a number in the plane, (3,) in space; zero if not given",
        json_schema_extra={"excludes": "`dimensions = 1`"},
    )


class Obstacle(Table):
    """A fixed body, such as a floor, a wall or a table, that objects can touch; fingers pass through it."""

    name: Name = Field(default="obstacle", description="name in error messages")
    shape: Shape = Field(description="shape of the surface")
    position: Vector | None = Field(default=None, description="position of the centre, (d,) [m]; zero if not given")
    orientation: NumberOrVector | None = Field(
        default=None,
        description="orientation: an angle [rad] in the plane, a unit quaternion (x, y, z, w) in space",
        json_schema_extra={"excludes": "`dimensions = 1`"},
    )


class World(Table):
    """Contact of objects with obstacles and with one another; the table `coupling` defines contact with fingers."""

    friction: NotNegative = Field(default=0.5, description="coefficient of friction of every pair")
    restitution: Annotated[NotNegative, Field(le=1)] = Field(
        default=0.0, description="ratio of separation speed to approach speed, 0 to 1; must be 0 for native objects"
    )
    stiffness: Positive = Field(
        default=STIFFNESS, description="stiffness of a contact point of a native object on an obstacle [N/m]"
    )
    collide: Switch | None = Field(
        default=None,
        description="whether objects collide with one another; if not given, true in space with bullet or mujoco "
        "dynamics",
    )


class Impedance(Table):
    """Stiffness and damping of eq. (4): a number, one per finger, or matrices in the axes of `coupling.axes`."""

    stiffness: Gain = Field(description="stiffness K [N/m]: a number, one per finger, or matrices")
    damping: Gain = Field(default=0.0, description="damping D [N s/m], in the same forms as the stiffness")


class ObjectImpedance(Table):
    """Displayed stiffness and damping of an object in the axes of its shape, which determine its fingers' gains."""

    object_stiffness: Gain = Field(
        description="stiffness K_o without squeeze, (w, w), translations before rotations [N/m, N, N m/rad]; or a list "
        "of its diagonal entries; on a line a number"
    )
    object_damping: Gain | None = Field(
        default=None, description="damping D_o, in the same forms as K_o; zero if not given"
    )
    object_point: Vector | None = Field(
        default=None,
        description="reference point of K_o and D_o, relative to the centre of mass, (d,) [m]; the centre of mass if "
        "not "
        "given",
    )

    @property
    def stiffness(self) -> tuple[tuple[float, ...], ...]:
        """Stiffness K_o as a square matrix."""
        return _square(self.object_stiffness)

    @property
    def damping(self) -> tuple[tuple[float, ...], ...]:
        """Damping D_o as a square matrix."""
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
    """Return a gain of an object as a square matrix; a number or a list contains the diagonal entries."""
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
    """Coupling of fingers and objects: gains of eq. (4) and rules of contact."""

    contact: Literal["unilateral", "attached"] = Field(
        default="unilateral",
        description="unilateral: fingers can only push, and can separate from the object; attached: they always hold a "
        "point of the object",
    )
    external: ImpedanceOfEither = Field(
        description="kep and ked of eq. (4), which move the object; or stiffness and damping of the object itself"
    )
    internal: Impedance = Field(description="kip and kid of eq. (4), which squeeze the object")
    form: Literal["literal", "symmetric"] = Field(
        default="literal",
        description="rule for gains that differ between fingers: eq. (4) as printed, or P K P + (I - P) K (I - P)",
    )
    axes: Literal["object", "world", "contact"] = Field(
        default="object",
        description="axes of gains that are matrices: those of the object's shape, with which springs create no "
        "energy; "
        "those of the world; or those of each contact, normal first, as in diag(k_n, k_t) or diag(k_n, k_t, k_t)",
    )
    reaction: Literal["fingertip", "contact"] = Field(
        default="fingertip", description="point where a force acts on the object"
    )
    friction: Annotated[Literal["stick"] | float, BeforeValidator(_friction)] = Field(
        default=0.0,
        description="0 (contacts slip freely), 'stick' (contacts stay where they first touched) or a coefficient of "
        "friction",
    )
    split: Literal["pseudoinverse", "mass", "weights"] = Field(
        default="pseudoinverse",
        description="weights of the fingers in the split and in the gains: equal (eq. 3), device masses, or `weights`",
    )
    weights: Vector | None = Field(
        default=None,
        description="weight of each finger of the scene, above zero; on each object, weights are scaled to a mean of 1",
        json_schema_extra={"excludes": '`split = "pseudoinverse"`, `split = "mass"`'},
    )
    metric: Literal["equal", "mass"] = Field(
        default="equal",
        description='other name of `split`: "mass" is `split = "mass"`, "equal" is `split = "pseudoinverse"`',
    )
    absent: Literal["fade", "follow"] = Field(
        default="fade",
        description="treatment of a free finger: fade out of the split as its gap grows, or remain in the split",
    )
    fade: PairOrAuto = Field(
        default="auto",
        description="gaps at which a free finger begins and ends to fade out of the split [m]; 'auto': [0.002, 0.01], "
        "or "
        "larger gaps if the gains and the squeeze of the hands require them",
    )
    passivity: Literal["off", "observe", "control"] = Field(
        default="off",
        description="energy of each mode: not computed, recorded, or recorded and dissipated in modes that create "
        "energy",
    )
    damping_depth: NotNegative = Field(
        default=0.0,
        description="penetration depth over which the damping of a touching finger grows from zero to its value [m]; "
        "no growth if 0",
    )
    force_bound: Positive = Field(
        default=1e4,
        description="largest force of a finger from the coupling law [N]; a larger force is a fault that names the "
        "gain "
        "and sets all forces to zero",
    )
    enter: Literal["refuse", "ramp"] = Field(
        default="refuse",
        description="start of a run in which a hardware finger is inside its object: refuse the run, or increase the "
        "finger's force gradually",
    )
    blend: PairOrOff = Field(
        default=(0.00025, 0.001),
        description="rms lever arms between which a rotation fades into the external space [m]; 'off': rotations are "
        "external with any arm, as in eq. (4); with an `object_stiffness` the default is [0.001, 0.01], because short "
        "arms make a fingertip stiff",
    )

    @model_validator(mode="after")
    def _widen(self) -> Self:
        if isinstance(self.__dict__.get("external"), ObjectImpedance) and "blend" not in self.model_fields_set:
            self.__dict__["blend"] = BLEND_OF_OBJECT
        if self.__dict__.get("metric") == "mass" and "split" not in self.model_fields_set:
            self.__dict__["split"] = "mass"
        return self


class Frame(Table):
    """Pose of a device: p = origin + scale R p_device; forces on the device are scale R' times the scene's forces."""

    origin: Vector | None = Field(
        default=None, description="position of the device, (d,) [m]; the scene's origin if not given"
    )
    axes: AxesOrMatrix | None = Field(
        default=None,
        description="axis of the device along each axis of the scene, as in 'x -z y', or the matrix R with one row per "
        "axis of the scene; the same axes if not given",
    )
    scale: Positive = Field(default=1.0, description="metres in the scene per metre of the device")


def _range(value: tuple[float, float]) -> tuple[float, float]:
    low, high = value
    if low <= high:
        return value
    text = "expected the smaller number first; given {given}"
    raise PydanticCustomError("range", text, {"given": abbreviate(list(value))})


class Measures(Table):
    """Measured properties of a device, as written by `graspfx calibrate`; they replace those that its driver states."""

    mass: Positive | None = Field(default=None, description="effective mass at a fingertip [kg]")
    friction: NotNegative | None = Field(default=None, description="viscous friction at a fingertip [N s/m]")
    resolution: Positive | None = Field(default=None, description="resolution of a fingertip position [m]")
    latency: NotNegative | None = Field(default=None, description="age of a sample when it is read [s]")
    lateness: NotNegative | None = Field(
        default=None,
        description="time from the reading of a sample to the force computed from it, without the half period of the "
        "hold [s]",
    )
    jitter: Annotated[Pair, AfterValidator(no_negative), AfterValidator(_range)] | None = Field(
        default=None, description="1st and 99th percentile of the lateness; certificates use the less stable one [s]"
    )
    round_trip: NotNegative | None = Field(
        default=None,
        description="duration of reading and writing [s], as part of the lateness; a recording's value replaces it",
    )


class Device(Table):
    """A device driver with its settings: the keys of all devices, and the arguments of the driver's `connect`."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, Setting]

    name: str = Field(description="name of a driver, or path of a .py file")
    frame: Frame | None = Field(default=None, description="pose of the device in the scene; identity if not given")
    deadman: Count | None = Field(
        default=None,
        description="index, from 0, of the switch that must be held to allow forces; forces decay on its release",
    )
    measures: Measures | None = Field(
        default=None, description="measured properties of the device, which replace those that its driver states"
    )
    rate: Positive | None = Field(
        default=None, description="largest rate of exchanges with hardware [Hz]; one exchange per tick if not given"
    )

    @property
    def settings(self) -> dict[str, Any]:
        """Keys of the table that are arguments of `connect`, under the current names of the settings."""
        return {current_setting(self.name, key): value for key, value in (self.model_extra or {}).items()}

    @property
    def former(self) -> dict[str, str]:
        """Current names of the settings that the table gives by former names, by former name."""
        return {key: now for key in self.model_extra or {} if (now := current_setting(self.name, key)) != key}


class SharedDevice(Device):
    """A device with several fingers, to which the fingers refer by its label."""

    label: Name = Field(description="name by which fingers refer to the device")


_by_name = Discriminator(lambda value: "<name>" if isinstance(value, str) else "<table>")
DeviceOrName = Annotated[Annotated[str, Tag("<name>")] | Annotated[Device, Tag("<table>")], _by_name]


class Pad(Table):
    """A compliant fingertip in series with the coupling: f_n = k depth^1.5 along the contact normal (Hertz)."""

    kind: Literal["hertz"]
    stiffness: Positive = Field(description="stiffness k [N/m^1.5]; 4/3 E* sqrt(R) for a ball on a plane")


class Placement(Table):
    """A start position, given by a direction from the object's centre and a gap between fingertip and surface."""

    toward: Vector = Field(
        description="direction from the object's initial centre of mass, in world axes, (d,), of any length"
    )
    gap: NotNegative = Field(default=0.0, description="gap between the fingertip (with its radius) and the surface [m]")


_by_place = Discriminator(lambda value: "<table>" if isinstance(value, Mapping | Table) else "<list>")
PointOrPlacement = Annotated[Annotated[Vector, Tag("<list>")] | Annotated[Placement, Tag("<table>")], _by_place]


class Finger(Table):
    """A fingertip with its device, its hand, and the object that it touches."""

    name: Name | None = Field(default=None, description="name in recordings and figures; finger0, ... if not given")
    device: DeviceOrName = Field(description="device table, or label of a [[device]]")
    channel: Count = Field(default=0, description="index of the finger on the device")
    hand: HandOrName | None = Field(default=None, description="hand table, or name of a [[hand]]")
    start: PointOrPlacement = Field(
        description="start position, (d,) [m]; or a direction from the object's centre and a gap"
    )
    radius: NotNegative = Field(default=0.0, description="radius of a ball fingertip [m]; 0 for a point")
    object: Name | None = Field(
        default=None, description="name of the object that the finger touches; the first if not given"
    )
    model: Annotated[Literal["hard", "soft"], BeforeValidator(_model)] = Field(
        default="hard",
        description="contact model; in space, a soft finger also exerts a torsion about the contact normal",
    )
    patch: Positive | None = Field(
        default=None,
        description="patch length rho of a soft finger [m]; its torsion is at most mu rho f_n, with its coefficient of "
        "friction mu and normal force f_n",
        json_schema_extra={"excludes": '`model = "hard"`'},
    )
    friction: NotNegative | None = Field(
        default=None,
        description="coefficient of friction of the finger; coupling.friction if not given",
        json_schema_extra={"excludes": '`coupling.contact = "attached"`, `coupling.friction = "stick"`'},
    )
    pad: Pad | None = Field(
        default=None,
        description="compliant fingertip with f_n = k depth^1.5 [N] along the normal, for unilateral contacts; the "
        "normal displacement in eq. (4) is reduced by the depth [m]",
        json_schema_extra={"excludes": '`coupling.contact = "attached"`, `integrator = "implicit"` with damping'},
    )
    safety: FingerSafety | None = Field(default=None, description="limits of the finger, if the scene has [safety]")


def _listed(value: Any) -> Any:
    return [value] if isinstance(value, str) else value


class Record(Table):
    """Columns and ticks of a recording; a list of columns is equivalent to a table with `columns`."""

    columns: Annotated[tuple[str, ...], BeforeValidator(_listed)] = Field(
        default=(), description="names of the file's variables, or of groups of them; all if not given"
    )
    every: Annotated[int, Field(strict=True, ge=1)] = Field(default=1, description="number of ticks from row to row")
    compression: Literal["none", "lzf", "gzip"] = Field(default="none", description="compression of the file")
