"""The tables of a scene that say how the operator's hand holds the fingertips and where it means to go."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Discriminator, Field, Tag
from pydantic_core import PydanticCustomError

from graspfx.errors import shown
from graspfx.scene.fields import Name, NotNegative, Number, Positive, Table, Vector, by_kind, number_or_list

Axis = Literal[0, 1, 2, "x", "y", "z"]


class Rest(Table):
    """The hand stays where it starts."""

    kind: Literal["rest"]


class Sine(Table):
    """r(t) = rest + A(t) sin(2 pi f (t - begin)) along one axis from `begin` on; A grows smoothly over `ramp`."""

    kind: Literal["sine"]
    amplitude: Number = Field(description="A [m]")
    frequency: Positive = Field(description="f [Hz]")
    axis: Axis = Field(default=0, description="0, 1, 2 or x, y, z")
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
    positions: tuple[Vector, ...] | None = Field(default=None, description="one (d,) per time [m]")


MOTIONS = ("rest", "sine", "reach", "path")
_check_motion, _motion_by_kind = by_kind(MOTIONS, what="motion")
Motion = Annotated[
    Annotated[Rest, Tag("<rest>")]
    | Annotated[Sine, Tag("<sine>")]
    | Annotated[Reach, Tag("<reach>")]
    | Annotated[Path, Tag("<path>")],
    _motion_by_kind,
    _check_motion,
]


def _no_negative(values: tuple[float, ...]) -> tuple[float, ...]:
    if any(value < 0 for value in values):
        raise PydanticCustomError("sign", "expected no less than 0; given {given}", {"given": shown(list(values))})
    return values


PerAxis = Annotated[
    Annotated[NotNegative, Tag("<number>")] | Annotated[Vector, AfterValidator(_no_negative), Tag("<list>")],
    number_or_list,
]


class Spring(Table):
    """Stiffness and damping of one half of a hand."""

    stiffness: PerAxis = Field(description="[N/m], or one per axis")
    damping: PerAxis = Field(default=0.0, description="[N s/m], or one per axis")


class Hand(Table):
    """What holds one fingertip: K (r - p) + B (r' - p')."""

    stiffness: PerAxis = Field(description="K [N/m], or one per axis")
    damping: PerAxis = Field(default=0.0, description="B [N s/m], or one per axis")
    rest: Vector | None = Field(
        default=None, description="r without motion, (d,) [m]; where the finger starts if not given"
    )
    motion: Motion = Rest(kind="rest")
    squeeze: Number = Field(default=0.0, description="how far r lies inside, towards the object [m]")
    squeeze_ramp: NotNegative = Field(default=0.5, description="time in which the squeeze is taken up [s]")


class SharedHand(Table):
    """What holds several fingertips together: an arm that carries their mean, a grip that closes on it."""

    name: Name
    arm: Spring
    grip: Spring
    motion: Motion = Rest(kind="rest")
    squeeze: Number = Field(default=0.0, description="how far each r lies inside, towards the object [m]")
    squeeze_ramp: NotNegative = Field(default=0.5, description="[s]")


by_name = Discriminator(lambda value: "<name>" if isinstance(value, str) else "<table>")
HandOrName = Annotated[Annotated[str, Tag("<name>")] | Annotated[Hand, Tag("<table>")], by_name]
