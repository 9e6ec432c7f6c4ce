"""The tables of a scene that say how the operator's hand holds the fingertips and where it means to go."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, ConfigDict, Discriminator, Field, Tag
from pydantic_core import PydanticCustomError

from graspfx.errors import abbreviate
from graspfx.scene.tables.fields import (
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
    begin: Number = Field(default=0.0, description="[s]")
    ramp: NotNegative = Field(default=0.0, description="[s]")


class Reach(Table):
    """A minimum-jerk movement by `displacement` that begins at `begin` and lasts `duration`."""

    kind: Literal["reach"]
    displacement: Vector = Field(description="(d,) [m]")
    begin: Number = Field(default=0.0, description="[s]")
    duration: Positive = Field(description="[s]")


class Path(Table):
    """A recorded path of offsets from rest: a CSV file with columns t, x, y, z, or times and positions."""

    kind: Literal["path"]
    file: str | None = Field(default=None, description="relative to the scene's file")
    times: Vector | None = Field(default=None, description="rising [s]")
    positions: Vectors | None = Field(default=None, description="one (d,) per time [m]")


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

    axis: Axis | None = Field(default=None, description="x, y, z, 0, 1, 2 or a direction of any length; space only")
    centre: Vector | None = Field(
        default=None, description="a point of the axis, (d,) [m]; where the object's centre is at first if not given"
    )
    begin: Number = Field(default=0.0, description="[s]")


class TurnSine(Turning):
    """An angle A(t) sin(2 pi f (t - begin)) from `begin` on; A grows smoothly over `ramp`."""

    kind: Literal["sine"]
    amplitude: Number = Field(description="A [rad]")
    frequency: Positive = Field(description="f [Hz]")
    ramp: NotNegative = Field(default=0.0, description="[s]")


class TurnReach(Turning):
    """A minimum-jerk turn by `angle` that begins at `begin` and lasts `duration`."""

    kind: Literal["reach"]
    angle: Number = Field(description="[rad]")
    duration: Positive = Field(description="[s]")


_check_turn, _turn_by_kind = by_kind(("sine", "reach"), field="turn")
Turn = Annotated[Annotated[TurnSine, Tag("<sine>")] | Annotated[TurnReach, Tag("<reach>")], _turn_by_kind, _check_turn]
Turns = Annotated[Annotated[Turn, Tag("<table>")] | Annotated[tuple[Turn, ...], Tag("<list>")], by_table_or_list]


class Step(Table):
    """A minimum-jerk step of the squeeze to a level."""

    to: Number = Field(description="the squeeze after it [m]; less than zero is open")
    begin: Number = Field(description="[s]")
    duration: Positive = Field(description="[s]")


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

    stiffness: PerAxis = Field(description="[N/m], or one per axis")
    damping: PerAxis = Field(default=0.0, description="[N s/m], or one per axis")


Offsets = Annotated[Annotated[Vector, Tag("<list>")] | Annotated[Vectors, Tag("<lists>")], Discriminator(_depth)]


class Guide(Table):
    """Goals that lead a hand aside while a run goes on, each behind a critically damped follower."""

    lag: Positive = Field(default=0.02, description="time constant of the followers [s]")
    offset: Offsets | None = Field(
        default=None, description="goal by which the targets go aside, (d,) or one per finger [m]; zero if not given"
    )
    squeeze: Number = Field(default=0.0, description="goal that is added to the squeeze [m]")


class Moving(Table):
    """The motion in time that hands of every kind may have."""

    motion: Motions = Field(default=Rest(kind="rest"), description="one, or a list of motions that add up")
    turn: Turns | None = Field(default=None, description="one, or a list of turns made one after another")
    squeeze: Squeeze = Field(
        default=0.0,
        description="how far r lies inside, towards the object [m]: a number, taken up over squeeze_ramp, or steps",
    )
    squeeze_ramp: NotNegative = Field(default=0.5, description="time in which a number is taken up [s]")
    guide: Guide | None = Field(default=None, description="goals that change in mid-run; none if not given")


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

    name: Name
    arm: Spring
    grip: Spring
    closing: Annotated[
        Annotated[Literal["normal", "centre"], Tag("<word>")] | Annotated[Vectors, Tag("<list>")], _by_form
    ] = Field(
        default="normal",
        description="directions of the squeeze: each contact's normal at first, the mean of the fingers' starts, or "
        "one (d,) per finger",
    )
    share: NumberOrVector = Field(default=1.0, description="of the squeeze, or one per finger")


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
    """One that holds several fingertips, which name it."""

    name: Name


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
