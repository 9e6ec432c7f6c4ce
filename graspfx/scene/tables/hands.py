"""The tables of a scene that say how the operator's hand holds the fingertips and where it means to go."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, ConfigDict, Discriminator, Field, Tag
from pydantic_core import PydanticCustomError

from graspfx.errors import abbreviate
from graspfx.scene.tables.fields import (
    Count,
    Name,
    NotNegative,
    Number,
    NumberOrVector,
    Positive,
    Table,
    Vector,
    Vectors,
    by_kind,
    number_or_list,
)


def _form(value: Any) -> str:
    """Tell the form of a field that takes a word or number, a list or a table."""
    if isinstance(value, Mapping | Table):
        return "<table>"
    return "<list>" if isinstance(value, list | tuple) or getattr(value, "ndim", None) else "<word>"


_by_form = Discriminator(_form)
Axis = Annotated[Annotated[Literal[0, 1, 2, "x", "y", "z"], Tag("<word>")] | Annotated[Vector, Tag("<list>")], _by_form]


class Rest(Table):
    """The hand stays where it starts."""

    kind: Literal["rest"]


class Sine(Table):
    """r(t) = rest + A(t) sin(2 pi f (t - begin)) along a direction from `begin` on; A grows smoothly over `ramp`."""

    kind: Literal["sine"]
    amplitude: Number = Field(description="A [m]")
    frequency: Positive = Field(description="f [Hz]")
    axis: Axis = Field(default=0, description="0, 1, 2 or x, y, z, or a direction (d,) of any length")
    begin: Number = Field(default=0.0, description="when it begins [s]")
    ramp: NotNegative = Field(default=0.0, description="time in which A grows to its value [s]")


class Reach(Table):
    """A minimum-jerk movement by `displacement` that begins at `begin` and lasts `duration`."""

    kind: Literal["reach"]
    displacement: Vector = Field(description="from rest, (d,) [m]")
    begin: Number = Field(default=0.0, description="when it begins [s]")
    duration: Positive = Field(description="how long it lasts [s]")


class Path(Table):
    """A recorded path of offsets from rest: a CSV file with columns t, x, y, z, or times and positions."""

    kind: Literal["path"]
    file: str | None = Field(
        default=None, description="relative to the scene's file", json_schema_extra={"excludes": "`times`, `positions`"}
    )
    times: Vector | None = Field(default=None, description="rising [s]", json_schema_extra={"excludes": "`file`"})
    positions: Vectors | None = Field(
        default=None, description="one (d,) per time [m]", json_schema_extra={"excludes": "`file`"}
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
    """Where a turn goes: about z in the plane, about an axis in space."""

    axis: Axis | None = Field(
        default=None,
        description="x, y, z, 0, 1, 2 or a direction of any length; required in space",
        json_schema_extra={"excludes": "`dimensions = 2`, where turns are about z"},
    )
    centre: Vector | None = Field(
        default=None, description="a point of the axis, (d,) [m]; where the object's centre is at first if not given"
    )
    begin: Number = Field(default=0.0, description="when it begins [s]")


class TurnSine(Turning):
    """An angle A(t) sin(2 pi f (t - begin)) from `begin` on; A grows smoothly over `ramp`."""

    kind: Literal["sine"]
    amplitude: Number = Field(description="A [rad]")
    frequency: Positive = Field(description="f [Hz]")
    ramp: NotNegative = Field(default=0.0, description="time in which A grows to its value [s]")


class TurnReach(Turning):
    """A minimum-jerk turn by `angle` that begins at `begin` and lasts `duration`."""

    kind: Literal["reach"]
    angle: Number = Field(description="about the axis, right-handed [rad]")
    duration: Positive = Field(description="how long it lasts [s]")


_check_turn, _turn_by_kind = by_kind(("sine", "reach"), field="turn")
Turn = Annotated[Annotated[TurnSine, Tag("<sine>")] | Annotated[TurnReach, Tag("<reach>")], _turn_by_kind, _check_turn]
Turns = Annotated[Annotated[Turn, Tag("<table>")] | Annotated[tuple[Turn, ...], Tag("<list>")], by_table_or_list]


class Step(Table):
    """A minimum-jerk step of the squeeze to a level."""

    to: Number = Field(description="the squeeze after it [m]; less than zero is open")
    begin: Number = Field(description="when it begins [s]")
    duration: Positive = Field(description="how long it lasts [s]")


Squeeze = Annotated[
    Annotated[Number, Tag("<word>")] | Annotated[Step, Tag("<table>")] | Annotated[tuple[Step, ...], Tag("<list>")],
    _by_form,
]


def _depth(value: Any) -> str:
    """Tell a list of lists from one of numbers."""
    first = value[0] if isinstance(value, list | tuple) and value else None
    nested = isinstance(first, list | tuple) or getattr(value, "ndim", 1) > 1
    return "<lists>" if nested else "<list>"


def _no_negative(values: tuple[float, ...]) -> tuple[float, ...]:
    if any(value < 0 for value in values):
        raise PydanticCustomError("sign", "expected no less than 0; given {given}", {"given": abbreviate(list(values))})
    return values


PerAxis = Annotated[
    Annotated[NotNegative, Tag("<number>")] | Annotated[Vector, AfterValidator(_no_negative), Tag("<list>")],
    number_or_list,
]


class Spring(Table):
    """Stiffness and damping of one half of a hand."""

    stiffness: PerAxis = Field(description="K [N/m], or one per axis")
    damping: PerAxis = Field(default=0.0, description="B [N s/m], or one per axis")


Offsets = Annotated[Annotated[Vector, Tag("<list>")] | Annotated[Vectors, Tag("<lists>")], Discriminator(_depth)]


class Guide(Table):
    """Goals that lead a hand aside while a run goes on, each behind a critically damped follower."""

    lag: Positive = Field(default=0.02, description="time constant of the followers [s]")
    offset: Offsets | None = Field(
        default=None, description="goal by which the targets go aside, (d,) or one per finger [m]; zero if not given"
    )
    squeeze: Number = Field(default=0.0, description="goal that is added to the squeeze [m]")


class Limb(Table):
    """A mass between the intention and the fingertip: with the hand's own spring and damper, five parameters.

    M y'' = K_l (r - y) + B_l (r' - y') - F, and F = K (y - p) + B (y' - p') pulls the fingertip p.
    """

    mass: Positive = Field(description="M, of finger, hand and arm that move with each fingertip [kg]")
    stiffness: PerAxis = Field(description="K_l, from the intention r to the mass [N/m], or one per axis")
    damping: PerAxis = Field(default=0.0, description="B_l [N s/m], or one per axis")


class Stiffening(Table):
    """Stiffness and damping that rise with the grip force: K + k F and B + b F, F behind the displayed force |u|."""

    stiffness: NotNegative = Field(description="k, what each newton of grip adds [N/m per N]")
    damping: NotNegative = Field(default=0.0, description="b [N s/m per N]")
    lag: Positive = Field(description="time constant with which F follows |u| [s]")


class Reaction(Table):
    """A voluntary force, a delay after what is felt: k (r - p) + b (r' - p') - g u, all of them `delay` ago."""

    delay: Positive = Field(description="from what is felt to the muscle's force [s]; to the nearest sample")
    stiffness: NotNegative = Field(default=0.0, description="k, against displacement [N/m]")
    damping: NotNegative = Field(default=0.0, description="b, against velocity [N s/m]")
    force: NotNegative = Field(default=0.0, description="g, share of the displayed force that it adds to the push back")


class Tremor(Table):
    """A tremor of the intention: sines of random frequencies in a band, and random phases."""

    amplitude: NotNegative = Field(description="root mean square on each axis [m]")
    frequency: Positive = Field(default=10.0, description="middle of the band [Hz]")
    width: NotNegative = Field(default=4.0, description="width of the band [Hz]; zero is one sine")
    seed: Count = Field(default=0, description="seed of the random numbers; each hand has numbers of its own")
    begin: Number = Field(default=0.0, description="[s]")
    ramp: NotNegative = Field(default=0.5, description="over which it fades in [s]")


class Noise(Table):
    """Noise of the muscle's force in proportion to it, the same share at every force."""

    share: NotNegative = Field(description="standard deviation over force, the coefficient of variation")
    cutoff: Positive = Field(description="the noise has all its power, evenly, below this frequency [Hz]")
    lag: Positive = Field(description="time constant with which the noise follows the muscle's force [s]")
    seed: Count = Field(default=0, description="seed of the random numbers; each finger has numbers of its own")


class Moving(Table):
    """The motion in time that hands of every kind may have."""

    motion: Motions = Field(default=Rest(kind="rest"), description="one, or a list of motions that add up")
    turn: Turns | None = Field(
        default=None,
        description="one, or a list of turns made one after another",
        json_schema_extra={"excludes": "`dimensions = 1`"},
    )
    squeeze: Squeeze = Field(
        default=0.0,
        description="how far r lies inside, towards the object [m]: a number, taken up over squeeze_ramp, or steps",
    )
    squeeze_ramp: NotNegative = Field(
        default=0.5,
        description="time in which a squeeze that is a number is taken up [s]",
        json_schema_extra={"excludes": "a `squeeze` in steps, which have times of their own"},
    )
    guide: Guide | None = Field(default=None, description="goals that change in mid-run; none if not given")
    limb: Limb | None = Field(default=None, description="a mass between intention and fingertip; none if not given")
    stiffening: Stiffening | None = Field(default=None, description="with the grip force; none if not given")
    reaction: Reaction | None = Field(default=None, description="a voluntary force, late; none if not given")
    tremor: Tremor | None = Field(default=None, description="tremor of the intention; none if not given")
    noise: Noise | None = Field(default=None, description="noise in proportion to muscle force; none if not given")


class OwnHand(Moving):
    """The hand of one fingertip: K (r - p) + B (r' - p')."""

    form: ClassVar[Literal["own"]] = "own"

    stiffness: PerAxis = Field(description="K [N/m], or one per axis")
    damping: PerAxis = Field(default=0.0, description="B [N s/m], or one per axis")
    rest: Vector | None = Field(
        default=None, description="r without motion, (d,) [m]; where the finger starts if not given"
    )
    closing: Annotated[Annotated[Literal["normal"], Tag("<word>")] | Annotated[Vector, Tag("<list>")], _by_form] = (
        Field(default="normal", description="direction of the squeeze: the contact's normal at first, or (d,)")
    )


class SharedHand(Moving):
    """The hand of several fingertips: an arm that carries their mean, a grip that closes on it."""

    form: ClassVar[Literal["shared"]] = "shared"

    name: Name = Field(description="name that fingers refer to")
    arm: Spring = Field(description="spring that carries the fingers' mean")
    grip: Spring = Field(description="spring that closes each finger on the mean")
    closing: Annotated[
        Annotated[Literal["normal", "centre"], Tag("<word>")] | Annotated[Vectors, Tag("<list>")], _by_form
    ] = Field(
        default="normal",
        description="directions of the squeeze: each contact's normal at first, the mean of the fingers' starts, or "
        "one (d,) per finger",
    )
    share: NumberOrVector = Field(default=1.0, description="share of the squeeze, or one per finger")


class MadeHand(Table):
    """A hand from a Python file or another distribution, and its settings: whatever its `hold` takes."""

    model_config = ConfigDict(extra="allow")
    form: ClassVar[Literal["made"]] = "made"

    kind: str = Field(description="the path of a .py file, or a name that `graspfx list` gives")

    @property
    def settings(self) -> dict[str, Any]:
        """The table's other keys."""
        return dict(self.model_extra or {})


class SharedMadeHand(MadeHand):
    """A hand of a plug-in that holds several fingertips, which name it."""

    name: Name = Field(description="name that fingers refer to")


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
