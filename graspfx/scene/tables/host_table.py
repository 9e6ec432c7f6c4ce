"""Table `host` of a scene: another program simulates the object, and the loop displays that program's forces."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import Field

from graspfx.scene.tables.fields import Name, NotNegative, Positive, Table

# Object and coupling of a scene with a host: placeholders, because the host simulates the object.
OBJECT: Mapping[str, Any] = {"name": "host", "mass": 1.0, "viscosity": 0.0}
COUPLING: Mapping[str, Any] = {"contact": "attached", "external": {"stiffness": 0.0}, "internal": {"stiffness": 0.0}}


class Host(Table):
    """Host program whose forces the devices display, in place of an object and its coupling (`gx.Feedback`)."""

    name: Name = Field(description="name under which the host finds the loop: `feedback.connect(name)`")
    predict: Literal["hold", "linear", "model"] = Field(
        default="hold",
        description="forces between two samples: constant, extrapolated linearly, or by the stiffnesses below",
    )
    push_stiffness: NotNegative = Field(
        default=0.0,
        description='stiffness that a finger feels if all fingers move together, for `predict = "model"` [N/m]',
    )
    squeeze_stiffness: NotNegative = Field(
        default=0.0, description='stiffness that a finger feels in a squeeze, for `predict = "model"` [N/m]'
    )
    silence: Positive = Field(
        default=0.1,
        description="time without a new sample after which forces fade to zero in 20 ms and a fault follows [s]",
    )
    tank: NotNegative = Field(
        default=0.05, description="initial energy of the push tank and of the squeeze tank [J]; 0 switches both off"
    )
    tank_room: NotNegative = Field(default=0.5, description="largest energy of a tank [J]")
    speed: Positive = Field(
        default=1.0, description="largest speed of a finger for which the tanks are valid; beyond it the run ends [m/s]"
    )
    largest: Positive = Field(
        default=1e3, description="largest plausible force of a finger from the host; a larger one is a fault [N]"
    )
