"""Tables of an operator's hand: its springs, its intended motion, and its operator model."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, ConfigDict, Discriminator, Field, Tag

from graspfx.scene.tables.fields import (
    Count,
    Name,
    NotNegative,
    Number,
    NumberOrVector,
    Positive,
    Setting,
    Table,
    Vector,
    Vectors,
    by_kind,
    no_negative,
    number_or_list,
)


def _form(value: Any) -> str:
    """Return the tag of a value: <table>, <list>, or <word> for a word or a number."""
    if isinstance(value, Mapping | Table):
        return "<table>"
    return "<list>" if isinstance(value, list | tuple) or getattr(value, "ndim", None) else "<word>"


_by_form = Discriminator(_form)
Axis = Annotated[Annotated[Literal[0, 1, 2, "x", "y", "z"], Tag("<word>")] | Annotated[Vector, Tag("<list>")], _by_form]


class Rest(Table):
    """The hand does not move."""

    kind: Literal["rest"]


class Sine(Table):
    """A sinusoidal motion r(t) = rest + A(t) sin(2 pi f (t - begin)) along a direction, from `begin` on."""

    kind: Literal["sine"]
    amplitude: Number = Field(description="A [m]")
    frequency: Positive = Field(description="f [Hz]")
    axis: Axis = Field(default=0, description="direction of motion: 0, 1, 2 or x, y, z, or a vector (d,) of any length")
    begin: Number = Field(default=0.0, description="start time [s]")
    ramp: NotNegative = Field(default=0.0, description="duration of the growth of A(t) from 0 to A [s]")


class Reach(Table):
    """A minimum-jerk movement by `displacement` that begins at `begin` and lasts `duration`."""

    kind: Literal["reach"]
    displacement: Vector = Field(description="displacement from rest, (d,) [m]")
    begin: Number = Field(default=0.0, description="start time [s]")
    duration: Positive = Field(description="duration [s]")


class Path(Table):
    """A recorded motion, as offsets from the rest position: a CSV file with columns t, x[, y[, z]], or two lists."""

    kind: Literal["path"]
    file: str | None = Field(
        default=None,
        description="path relative to the scene's file",
        json_schema_extra={"excludes": "`times`, `positions`"},
    )
    times: Vector | None = Field(
        default=None, description="increasing times [s]", json_schema_extra={"excludes": "`file`"}
    )
    positions: Vectors | None = Field(
        default=None, description="offset (d,) at each time [m]", json_schema_extra={"excludes": "`file`"}
    )


MOTIONS = ("rest", "sine", "reach", "path")
_check_motion, _motion_by_kind = by_kind(MOTIONS, field="motion")
Motion = Annotated[
    Annotated[Rest, Tag("<rest>")]
    | Annotated[Sine, Tag("<sine>")]
    | Annotated[Reach, Tag("<reach>")]
    | Annotated[Path, Tag("<path>")],
    _motion_by_kind,
    _check_motion,
]
by_table_or_list = Discriminator(lambda value: "<list>" if isinstance(value, list | tuple) else "<table>")
Motions = Annotated[Annotated[Motion, Tag("<table>")] | Annotated[tuple[Motion, ...], Tag("<list>")], by_table_or_list]


class Turning(Table):
    """Axis and start time of a rotation, which is about z in the plane and about `axis` in space."""

    axis: Axis | None = Field(
        default=None,
        description="direction of the axis: x, y, z, 0, 1, 2 or a vector of any length; required in space",
        json_schema_extra={"excludes": "`dimensions = 2`, where rotations are about z"},
    )
    centre: Vector | None = Field(
        default=None, description="point on the axis, (d,) [m]; the object's initial centre if not given"
    )
    begin: Number = Field(default=0.0, description="start time [s]")


class TurnSine(Turning):
    """A rotation by the angle A(t) sin(2 pi f (t - begin)), from `begin` on."""

    kind: Literal["sine"]
    amplitude: Number = Field(description="A [rad]")
    frequency: Positive = Field(description="f [Hz]")
    ramp: NotNegative = Field(default=0.0, description="duration of the growth of A(t) from 0 to A [s]")


class TurnReach(Turning):
    """A minimum-jerk rotation by `angle` that begins at `begin` and lasts `duration`."""

    kind: Literal["reach"]
    angle: Number = Field(description="angle of rotation about the axis, right-handed [rad]")
    duration: Positive = Field(description="duration [s]")


_check_turn, _turn_by_kind = by_kind(("sine", "reach"), field="turn")
Turn = Annotated[Annotated[TurnSine, Tag("<sine>")] | Annotated[TurnReach, Tag("<reach>")], _turn_by_kind, _check_turn]
Turns = Annotated[Annotated[Turn, Tag("<table>")] | Annotated[tuple[Turn, ...], Tag("<list>")], by_table_or_list]


class Step(Table):
    """A minimum-jerk change of the squeeze to a new value."""

    to: Number = Field(description="squeeze after the change [m]; a negative value opens the hand")
    begin: Number = Field(description="start time [s]")
    duration: Positive = Field(description="duration [s]")


Squeeze = Annotated[
    Annotated[Number, Tag("<word>")] | Annotated[Step, Tag("<table>")] | Annotated[tuple[Step, ...], Tag("<list>")],
    _by_form,
]


def _depth(value: Any) -> str:
    """Return the tag of a value: <lists> for a list of lists, otherwise <list>."""
    first = value[0] if isinstance(value, list | tuple) and value else None
    nested = isinstance(first, list | tuple) or getattr(value, "ndim", 1) > 1
    return "<lists>" if nested else "<list>"


PerAxis = Annotated[
    Annotated[NotNegative, Tag("<number>")] | Annotated[Vector, AfterValidator(no_negative), Tag("<list>")],
    number_or_list,
]


class Spring(Table):
    """Stiffness and damping of the arm or the grip of a shared hand."""

    stiffness: PerAxis = Field(description="stiffness K [N/m], a number or one per axis")
    damping: PerAxis = Field(default=0.0, description="damping B [N s/m], a number or one per axis")


Offsets = Annotated[Annotated[Vector, Tag("<list>")] | Annotated[Vectors, Tag("<lists>")], Discriminator(_depth)]


class Guide(Table):
    """Offsets of the hand's intended positions that can be changed during a run, and are then smoothed."""

    lag: Positive = Field(default=0.02, description="time constant of the critically damped smoothing [s]")
    offset: Offsets | None = Field(
        default=None, description="offset of the intended positions, (d,) or one per finger [m]; zero if not given"
    )
    squeeze: Number = Field(default=0.0, description="offset of the squeeze [m]")


class Limb(Table):
    """Mass between the intended position r and the fingertip p, which gives an operator model of five parameters.

    The position y of the mass follows M y'' = K_l (r - y) + B_l (r' - y') - F. The force on the fingertip is
    F = K (y - p) + B (y' - p'), with the stiffness K and the damping B of the hand.
    """

    mass: Positive = Field(description="mass M of finger, hand and arm that moves with each fingertip [kg]")
    stiffness: PerAxis = Field(
        description="stiffness K_l between the intention r and the mass [N/m], a number or one per axis"
    )
    damping: PerAxis = Field(default=0.0, description="damping B_l [N s/m], a number or one per axis")


class Stiffening(Table):
    """Stiffness K + k G and damping B + b G that grow with the grip force G, the filtered displayed force |u|."""

    stiffness: NotNegative = Field(description="stiffness k per newton of grip [N/m per N]")
    damping: NotNegative = Field(default=0.0, description="damping b per newton of grip [N s/m per N]")
    lag: Positive = Field(description="time constant of the low-pass filter from the displayed force |u| to G [s]")


class Reaction(Table):
    """A voluntary force k (r - p) + b (r' - p') - g u, in response to values that were sensed `delay` ago.

    Here r is the intended position, p the fingertip's position, and u the displayed force.
    """

    delay: Positive = Field(description="time between sensation and muscle force, rounded to samples [s]")
    stiffness: NotNegative = Field(default=0.0, description="stiffness k against displacement [N/m]")
    damping: NotNegative = Field(default=0.0, description="damping b against velocity [N s/m]")
    force: NotNegative = Field(
        default=0.0, description="fraction g of the displayed force that the voluntary force counteracts"
    )


class Tremor(Table):
    """Tremor of the intended positions: a sum of sines with random frequencies in a band and random phases."""

    amplitude: NotNegative = Field(description="root-mean-square amplitude on each axis [m]")
    frequency: Positive = Field(default=10.0, description="centre of the band [Hz]")
    width: NotNegative = Field(default=4.0, description="width of the band [Hz]; zero for a single sine")
    seed: Count = Field(default=0, description="seed of the random numbers, which are different for each hand")
    begin: Number = Field(default=0.0, description="start time [s]")
    ramp: NotNegative = Field(default=0.5, description="duration of the growth from zero to `amplitude` [s]")


class Noise(Table):
    """Noise of the muscle force, with an amplitude proportional to the muscle force."""

    share: NotNegative = Field(description="coefficient of variation: standard deviation of the force over its mean")
    cutoff: Positive = Field(description="cutoff frequency, below which the noise has a flat spectrum [Hz]")
    lag: Positive = Field(description="time constant with which the noise amplitude follows the muscle force [s]")
    seed: Count = Field(default=0, description="seed of the random numbers, which are different for each finger")


class Moving(Table):
    """Motion and operator model of a hand, for the hand of one fingertip and for the hand of several fingertips."""

    motion: Motions = Field(default=Rest(kind="rest"), description="motion, or list of motions that are added")
    turn: Turns | None = Field(
        default=None,
        description="rotation, or list of rotations applied in sequence",
        json_schema_extra={"excludes": "`dimensions = 1`"},
    )
    squeeze: Squeeze = Field(
        default=0.0,
        description="displacement of the intended positions r along `closing` [m]: a number that is reached in the "
        "time `squeeze_ramp`, or a list of changes with their times",
    )
    squeeze_ramp: NotNegative = Field(
        default=0.5,
        description="time in which a squeeze that is a number is reached [s]",
        json_schema_extra={"excludes": "a `squeeze` that is a table or list, which has its own times"},
    )
    guide: Guide | None = Field(
        default=None, description="offsets of the intended positions, to change during a run; none if not given"
    )
    limb: Limb | None = Field(
        default=None, description="mass between intended position and fingertip; none if not given"
    )
    stiffening: Stiffening | None = Field(
        default=None, description="increase of stiffness with the grip force; none if not given"
    )
    reaction: Reaction | None = Field(default=None, description="delayed voluntary force; none if not given")
    tremor: Tremor | None = Field(default=None, description="tremor of the intended positions; none if not given")
    noise: Noise | None = Field(default=None, description="noise proportional to the muscle force; none if not given")


class OwnHand(Moving):
    """The hand of one fingertip p with the intended position r, which exerts the force K (r - p) + B (r' - p')."""

    form: ClassVar[Literal["own"]] = "own"

    stiffness: PerAxis = Field(description="stiffness K [N/m], a number or one per axis")
    damping: PerAxis = Field(default=0.0, description="damping B [N s/m], a number or one per axis")
    rest: Vector | None = Field(default=None, description="r without motion, (d,) [m]; the finger's start if not given")
    closing: Annotated[Annotated[Literal["normal"], Tag("<word>")] | Annotated[Vector, Tag("<list>")], _by_form] = (
        Field(default="normal", description="direction of the squeeze: the initial contact normal, or a vector (d,)")
    )


class SharedHand(Moving):
    """The hand of several fingertips: an arm that moves their mean, and a grip that closes them on the mean."""

    form: ClassVar[Literal["shared"]] = "shared"

    name: Name = Field(description="name by which fingers refer to the hand")
    arm: Spring = Field(description="spring between the intended and the actual mean position of the fingertips")
    grip: Spring = Field(description="spring for each fingertip's position relative to the mean position")
    closing: Annotated[
        Annotated[Literal["normal", "centre"], Tag("<word>")] | Annotated[Vectors, Tag("<list>")], _by_form
    ] = Field(
        default="normal",
        description="direction of the squeeze of each finger: the initial contact normal, towards the centre of the "
        "fingers' starts, or a vector (d,) per finger",
    )
    share: NumberOrVector = Field(default=1.0, description="factor on the squeeze, a number or one per finger")


class MadeHand(Table):
    """A hand from a Python file or an installed package; the other keys are the arguments of its `hold`."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, Setting]
    form: ClassVar[Literal["made"]] = "made"

    kind: str = Field(description="path of a .py file, or a name that `graspfx list` shows")

    @property
    def settings(self) -> dict[str, Any]:
        """Keys of the table that are arguments of `hold`."""
        return dict(self.model_extra or {})


class SharedMadeHand(MadeHand):
    """A hand from a Python file or an installed package that holds several fingertips."""

    name: Name = Field(description="name by which fingers refer to the hand")


def _hand_form(value: Any) -> str:
    if isinstance(value, str):
        return "<name>"
    is_plugin = "kind" in value if isinstance(value, Mapping) else isinstance(value, MadeHand)
    return "<made>" if is_plugin else "<table>"


HandOrName = Annotated[
    Annotated[str, Tag("<name>")] | Annotated[OwnHand, Tag("<table>")] | Annotated[MadeHand, Tag("<made>")],
    Discriminator(_hand_form),
]
AnySharedHand = Annotated[
    Annotated[SharedHand, Tag("<table>")] | Annotated[SharedMadeHand, Tag("<made>")], Discriminator(_hand_form)
]
