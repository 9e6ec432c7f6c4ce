"""The tables of a scene file, field by field: object, obstacle, coupling, device, finger; SI units."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import AfterValidator, BeforeValidator, ConfigDict, Discriminator, Field, Tag, model_validator
from pydantic_core import PydanticCustomError

from graspfx.errors import abbreviate
from graspfx.objects.surroundings import STIFFNESS
from graspfx.scene.former import current
from graspfx.scene.tables.fields import (
    Count,
    Gain,
    Name,
    NotNegative,
    NotValid,
    NumberOrVector,
    Pair,
    Positive,
    Switch,
    Table,
    Vector,
    Vectors,
    as_float,
)
from graspfx.scene.tables.hands import HandOrName
from graspfx.scene.tables.safety_table import FingerSafety
from graspfx.scene.tables.shapes import Shape

BLEND_OF_OBJECT = (0.001, 0.01)  # [m]


class Object(Table):
    """The object in the fingers: m a + b v = f_v (27), translation and rotation."""

    name: Name = Field(default="object", description="name that fingers and recordings refer to")
    mass: Positive | None = Field(
        default=None, description="m [kg]; this or the density is required", json_schema_extra={"excludes": "`density`"}
    )
    density: Positive | None = Field(
        default=None,
        description="[kg/m^3], in space, of a shape that has a volume",
        json_schema_extra={"excludes": "`mass`, an open mesh, `dimensions` below 3"},
    )
    viscosity: NotNegative = Field(description="b [N s/m]")
    rotational_viscosity: NotNegative | None = Field(
        default=None, description="[N m s/rad]; required where a rotation is free"
    )
    inertia: NumberOrVector | None = Field(
        default=None,
        description="about the centre [kg m^2]; that of the solid shape if not given",
        json_schema_extra={"excludes": "`dimensions = 1`"},
    )
    shape: Shape | None = Field(default=None, description="where its surface is; required for unilateral contact")
    free: Annotated[tuple[Switch, ...], Field(description="which of the w freedoms move")] | None = None
    dynamics: str = Field(default="native", description="native, bullet, mujoco or another that `graspfx list` names")
    integrator: Literal["explicit", "semi-implicit", "exact", "implicit"] = Field(
        default="exact", description="its step under a held force; implicit solves force and motion together"
    )
    position: Vector | None = Field(
        default=None,
        description="place of the centre, or a mesh file's origin, at first, (d,) [m]; the origin",
    )
    orientation: NumberOrVector | None = Field(
        default=None,
        description="plane: an angle [rad]; space: a quaternion x, y, z, w",
        json_schema_extra={"excludes": "`dimensions = 1`"},
    )
    velocity: Vector | None = Field(default=None, description="(d,) [m/s]; at rest")
    angular_velocity: NumberOrVector | None = Field(
        default=None,
        description="[rad/s], space: (3,); at rest",
        json_schema_extra={"excludes": "`dimensions = 1`"},
    )


class Obstacle(Table):
    """A thing that objects meet and nothing moves: a floor, a wall, a table. Fingers pass through it."""

    name: Name = Field(default="obstacle", description="name that messages use")
    shape: Shape = Field(description="where its surface is")
    position: Vector | None = Field(default=None, description="place of its centre, (d,) [m]; the origin if not given")
    orientation: NumberOrVector | None = Field(
        default=None,
        description="plane: an angle [rad]; space: a quaternion x, y, z, w",
        json_schema_extra={"excludes": "`dimensions = 1`"},
    )


class World(Table):
    """How objects meet obstacles and one another; how fingers touch them is the coupling's."""

    friction: NotNegative = Field(default=0.5, description="Coulomb's coefficient of every pair")
    restitution: Annotated[NotNegative, Field(le=1)] = Field(
        default=0.0, description="speed of parting over speed of meeting; native objects take 0 only"
    )
    stiffness: Positive = Field(
        default=STIFFNESS, description="stiffness of a contact point of a native object on an obstacle [N/m]"
    )
    collide: Switch | None = Field(
        default=None,
        description="whether objects meet one another; by default those in space, with dynamics = 'bullet' or 'mujoco'",
    )


class Impedance(Table):
    """Stiffness and damping of eq. (4), as a number, one per finger, or matrices in the axes of `coupling.axes`."""

    stiffness: Gain = Field(description="K [N/m]: one, one per finger, or matrices")
    damping: Gain = Field(default=0.0, description="D [N s/m]: in any of the same forms")


class ObjectImpedance(Table):
    """Stiffness and damping of the object as it is felt, in its shape's axes, shared out among the fingers it has."""

    object_stiffness: Gain = Field(
        description="K_o at zero squeeze, w x w on the object's freedoms, forces before moments [N/m, N, N m/rad]; its "
        "diagonal as a list, or on a line a number"
    )
    object_damping: Gain | None = Field(default=None, description="D_o, in the same forms; none if not given")
    object_point: Vector | None = Field(
        default=None, description="where K_o and D_o are taken, from the object's centre of mass (d,) [m]; the centre"
    )

    @property
    def stiffness(self) -> tuple[tuple[float, ...], ...]:
        """K_o as a square."""
        return _square(self.object_stiffness)

    @property
    def damping(self) -> tuple[tuple[float, ...], ...]:
        """D_o as a square."""
        if self.object_damping is None:
            size = len(self.stiffness)
            return ((0.0,) * size,) * size
        return _square(self.object_damping)

    if not TYPE_CHECKING:  # a visible __getattr__ would hide misspelt names from the type checker

        def __getattr__(self, name: str) -> Any:
            if name in ("stiffness", "damping"):
                raise NotValid(name)  # of a draft that lacks what the property is made of
            return super().__getattr__(name)


def _square(gain: Any) -> tuple[tuple[float, ...], ...]:
    """Write a gain of an object as a square: a number and a list are its diagonal."""
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


_by_word = Discriminator(lambda value: "<name>" if isinstance(value, str) else "<list>")
PairOrAuto = Annotated[Annotated[Literal["auto"], Tag("<name>")] | Annotated[Pair, Tag("<list>")], _by_word]
PairOrOff = Annotated[Annotated[Literal["off"], Tag("<name>")] | Annotated[Pair, Tag("<list>")], _by_word]


AxesOrMatrix = Annotated[Annotated[str, Tag("<name>")] | Annotated[Vectors, Tag("<list>")], _by_word]


def _no_negative(values: tuple[float, float]) -> tuple[float, float]:
    if min(values) >= 0.0:
        return values
    raise PydanticCustomError("sign", "expected no less than 0; given {given}", {"given": abbreviate(list(values))})


def _friction(value: Any) -> Any:
    if isinstance(value, str) and value == "stick":
        return value
    if isinstance(value, int | float) and not isinstance(value, bool) and 0.0 <= as_float(value) < math.inf:
        return float(value)
    text = "expected 0 or 'stick' or a coefficient of more than 0; given {given}"
    raise PydanticCustomError("friction", text, {"given": abbreviate(value)})


def _model(value: Any) -> Any:
    if isinstance(value, str) and value in ("frictionless", "full"):
        text = "expected 'hard' or 'soft': {given} is a contact for analysis (gx.Grasp), no finger of a run"
        raise PydanticCustomError("model", text, {"given": abbreviate(value)})
    return value


class Coupling(Table):
    """How the fingers hold the object: eq. (4) and the rules of touching."""

    contact: Literal["unilateral", "attached"] = Field(
        default="unilateral",
        description="whether fingers only push, and let go, or hold a point of the object for ever",
    )
    external: ImpedanceOfEither = Field(
        description="kep and ked of eq. (4): what moves the object; or the object's own stiffness and damping"
    )
    internal: Impedance = Field(description="kip and kid of eq. (4): what squeezes it")
    form: Literal["literal", "symmetric"] = Field(
        default="literal",
        description="gains that differ by finger: eq. (4) as it is written, or P K P + (I - P) K (I - P)",
    )
    axes: Literal["object", "world", "contact"] = Field(
        default="object",
        description="in which gains that are matrices stand: those in which the object's shape is described, in which "
        "springs create no energy; the world's; or each contact's, the normal first, as diag(k_n, k_t) or "
        "diag(k_n, k_t, k_t)",
    )
    reaction: Literal["fingertip", "contact"] = Field(default="fingertip", description="where the object feels a force")
    friction: Annotated[Literal["stick"] | float, BeforeValidator(_friction)] = Field(
        default=0.0, description="0 (slips freely), 'stick' (holds where it touched) or a coefficient of Coulomb's law"
    )
    split: Literal["pseudoinverse", "mass", "weights"] = Field(
        default="pseudoinverse",
        description="how fingers count in the split and the gains: the same (eq. 3), by device mass, or by `weights`",
    )
    weights: Vector | None = Field(
        default=None,
        description="a number above zero for each finger of the scene, of any unit: their mean on an object is 1",
        json_schema_extra={"excludes": '`split = "pseudoinverse"`, `split = "mass"`'},
    )
    metric: Literal["equal", "mass"] = Field(
        default="equal", description='another name: "mass" is `split = "mass"`, "equal" is `split = "pseudoinverse"`'
    )
    absent: Literal["fade", "follow"] = Field(
        default="fade", description="whether a free finger leaves the split with its gap, or follows for ever"
    )
    fade: PairOrAuto = Field(
        default="auto",
        description="gaps between which a free finger leaves the split [m]; 'auto': [0.002, 0.01], and more where the "
        "gains and the hands' squeeze ask for it",
    )
    passivity: Literal["off", "observe", "control"] = Field(
        default="off", description="energies by mode: none, booked and recorded, or also damped where they are made"
    )
    damping_depth: NotNegative = Field(
        default=0.0,
        description="over which a touching finger's damping grows up to its value [m]; 0: it has all of it at once",
    )
    force_bound: Positive = Field(
        default=1e4,
        description="largest force of a finger that the law may give [N]: more is a fault that names the gain, and "
        "every force is zero",
    )
    enter: Literal["refuse", "ramp"] = Field(
        default="refuse",
        description="a finger of hardware that is inside its object when a run begins: refused, or let in gradually",
    )
    blend: PairOrOff = Field(
        default=(0.00025, 0.001),
        description="rms arms between which a rotation joins the external space [m]; 'off': as soon as it has an arm, "
        "eq. (4) to the letter; [0.001, 0.01] with an `object_stiffness`, which a short arm makes stiff at a fingertip",
    )

    @model_validator(mode="after")
    def _widen(self) -> Self:
        if isinstance(self.__dict__.get("external"), ObjectImpedance) and "blend" not in self.model_fields_set:
            self.__dict__["blend"] = BLEND_OF_OBJECT
        if self.__dict__.get("metric") == "mass" and "split" not in self.model_fields_set:
            self.__dict__["split"] = "mass"
        return self


class Frame(Table):
    """How a device stands in the scene: p = origin + scale R p_device; its forces are scale R' f, so power is kept."""

    origin: Vector | None = Field(default=None, description="place of the device, (d,) [m]; the scene's origin")
    axes: AxesOrMatrix | None = Field(
        default=None,
        description="the device's axis that each of the scene's is, 'x -z y', or R with a row for each axis of the "
        "scene; the same axes if not given",
    )
    scale: Positive = Field(default=1.0, description="metres of the scene for a metre of the device")


def _range(value: tuple[float, float]) -> tuple[float, float]:
    low, high = value
    if low <= high:
        return value
    text = "expected the lesser one first; given {given}"
    raise PydanticCustomError("range", text, {"given": abbreviate(list(value))})


class Measures(Table):
    """Figures of one's own device, as `graspfx calibrate` measures them: they stand before what its driver tells."""

    mass: Positive | None = Field(default=None, description="effective, at a fingertip [kg]")
    friction: NotNegative | None = Field(default=None, description="viscous, at a fingertip [N s/m]")
    resolution: Positive | None = Field(default=None, description="resolution of a fingertip position [m]")
    latency: NotNegative | None = Field(default=None, description="age of a sample when it is read [s]")
    lateness: NotNegative | None = Field(
        default=None,
        description="from the reading of a sample to its force, any time; half a hold is no part of it [s]",
    )
    jitter: Annotated[Pair, AfterValidator(_no_negative), AfterValidator(_range)] | None = Field(
        default=None, description="lateness of one sample in a hundred, and of all but one: the worse counts [s]"
    )
    round_trip: NotNegative | None = Field(
        default=None,
        description="time of a reading and a writing, a part of the lateness; a recording's own stands for it [s]",
    )


class Device(Table):
    """A driver and its settings: whatever its `connect` takes, besides the keys that are the scene's own."""

    model_config = ConfigDict(extra="allow")

    name: str = Field(description="a driver's name, or the path of a .py file")
    frame: Frame | None = Field(default=None, description="axes of hardware in the scene; the scene's own if not given")
    deadman: Count | None = Field(
        default=None,
        description="number of the device's switch, from 0, that has to be down: forces decay once it is up",
    )
    measures: Measures | None = Field(default=None, description="figures of one's own device, before its driver's")
    rate: Positive | None = Field(
        default=None, description="how often hardware is called at most [Hz]; in every tick if not given"
    )

    @property
    def settings(self) -> dict[str, Any]:
        """The table's other keys, each under the name that the driver has for it now."""
        return {current(self.name, key): value for key, value in (self.model_extra or {}).items()}

    @property
    def former(self) -> dict[str, str]:
        """Settings under former names: the name now, by the one in the table."""
        return {key: now for key in self.model_extra or {} if (now := current(self.name, key)) != key}


class SharedDevice(Device):
    """A device with several fingers, which name it by its label."""

    label: Name = Field(description="name that fingers refer to")


_by_name = Discriminator(lambda value: "<name>" if isinstance(value, str) else "<table>")
DeviceOrName = Annotated[Annotated[str, Tag("<name>")] | Annotated[Device, Tag("<table>")], _by_name]


class Pad(Table):
    """A compliant fingertip in series with the coupling: f_n = k depth^1.5 along the contact's normal (Hertz)."""

    kind: Literal["hertz"]
    stiffness: Positive = Field(description="k [N/m^1.5]; 4/3 E* sqrt(R) of a ball on a plane")


class Placement(Table):
    """A start on the way in to the object, along a direction from its centre, in the place of coordinates."""

    toward: Vector = Field(description="from the object's centre of mass at first, world axes, of any length (d,)")
    gap: NotNegative = Field(default=0.0, description="gap from the fingertip, its ball included, to the surface [m]")


_by_place = Discriminator(lambda value: "<table>" if isinstance(value, Mapping | Table) else "<list>")
PointOrPlacement = Annotated[Annotated[Vector, Tag("<list>")] | Annotated[Placement, Tag("<table>")], _by_place]


class Finger(Table):
    """A fingertip: the device that moves it, the hand that holds it, the object that it touches."""

    name: Name | None = Field(default=None, description="name in recordings and figures; its number if not given")
    device: DeviceOrName = Field(description="a table, or the label of a [[device]]")
    channel: Count = Field(default=0, description="which finger of the device")
    hand: HandOrName | None = Field(default=None, description="a table, or the name of a [[hand]]")
    start: PointOrPlacement = Field(
        description="(d,) [m]; or a direction from the object's centre, along which it comes in to a gap"
    )
    radius: NotNegative = Field(default=0.0, description="radius of the ball that the fingertip is; 0: a point [m]")
    object: Name | None = Field(default=None, description="the name of an [object]; the first if not given")
    model: Annotated[Literal["hard", "soft"], BeforeValidator(_model)] = Field(
        default="hard", description="a soft finger exerts torsion about the contact's normal too; in space"
    )
    patch: Positive | None = Field(
        default=None,
        description="rho of a soft finger: with friction mu its torsion is mu rho f_n at most [m]",
        json_schema_extra={"excludes": '`model = "hard"`'},
    )
    friction: NotNegative | None = Field(
        default=None,
        description="coefficient of its own; coupling.friction",
        json_schema_extra={"excludes": '`coupling.contact = "attached"`, `coupling.friction = "stick"`'},
    )
    pad: Pad | None = Field(
        default=None,
        description="a compliant fingertip: f_n = k depth^1.5 [N] along the normal, the depth [m] adds to e_n of "
        "eq. (4); for unilateral contacts",
        json_schema_extra={"excludes": '`coupling.contact = "attached"`, the integrator implicit with damping'},
    )
    safety: FingerSafety | None = Field(default=None, description="limits of its own, in a scene with [safety]")
