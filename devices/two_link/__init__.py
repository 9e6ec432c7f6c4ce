"""A planar two-link arm with two motors and two encoders: Kawai and Yoshikawa's hardware, simulated or real.

One device is one arm and moves one finger.

The paper (section IV.1) specifies links of 128 mm and a sampling period of 5 ms; the other values of the preset are our
choice:

| quantity | preset |
|---|---|
| links | l1 = l2 = 0.128 m |
| masses, inertias about the centres | 0.060 and 0.050 kg, 8.2e-5 and 7.5e-5 kg m^2 |
| centres of mass from the link's joint | 0.064 and 0.070 m (the thimble makes link 2 heavier at its tip) |
| drive | both motors at the base; the second motor turns link 2 through a belt; gear ratio 15 |
| rotors | 5.8e-6 and 9.5e-6 kg m^2 (a coreless motor of 60 W; the second with the belt's pulleys) |
| viscous damping at the joints | 3.28e-3 N m s/rad each |
| encoders | 1000 lines, 4000 counts per revolution of the motor and 60 000 of the joint: 13 um at the tip |
| torque of a motor | at most 0.06 N m: 7 N at the tip |

Two arms that hold the 50 mm cube between them, with fingers at (-0.025, 0) and (0.025, 0) m, are based at
(-0.04, -0.18) m with the elbow to the left and at (0.04, -0.18) m with the elbow to the right. At these positions an
arm's effective mass is 0.150 kg along x and 0.149 along y, with an off-diagonal entry of 0.0003, and its effective
damping 0.201 and 0.199 N s/m. While the first finger moves along x from -0.09 to 0.04 m, the effective mass in every
direction stays between 0.130 and 0.178 kg, the effective damping between 0.169 and 0.246 N s/m, and the condition
number of the Jacobian below 1.21.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import MappingProxyType

from graspfx.devices._settings import number, pair, whole
from graspfx.devices.two_link.arm import Arm, Drive, Elbow, Mechanics, Pair
from graspfx.devices.two_link.arm_device import Board, SimulatedTwoLink, TwoLink, Wiring
from graspfx.protocols import LARGEST, SMALLEST, WINDOW, InputError, former_settings

__all__ = ["PRESET", "Board", "TwoLink", "connect"]

PRESET: MappingProxyType[str, Pair] = MappingProxyType(
    {
        "link_masses": (0.060, 0.050),  # [kg]
        "link_inertias": (8.2e-5, 7.5e-5),  # [kg m^2]
        "link_centres": (0.064, 0.070),  # [m]
        "rotor_inertias": (5.8e-6, 9.5e-6),  # [kg m^2]
        "joint_damping": (3.28e-3, 3.28e-3),  # [N m s/rad]
    }
)

ANY, NOT_NEGATIVE, POSITIVE = (
    "two finite numbers",
    "two finite numbers of zero or more",
    "two finite numbers above zero",
)


@former_settings(joint_friction="joint_damping")
def connect(
    *,
    base: Sequence[float] = (0.0, 0.0),
    elbow: Elbow = "left",
    links: Sequence[float] = (0.128, 0.128),
    link_masses: Sequence[float] | None = None,
    link_inertias: Sequence[float] | None = None,
    link_centres: Sequence[float] | None = None,
    rotor_inertias: Sequence[float] | None = None,
    joint_damping: float | Sequence[float] | None = None,
    drive: Drive = "base",
    counts: float | Sequence[float] = 4000,
    gear: float | Sequence[float] = 15.0,
    zero: Sequence[float] = (0.0, 0.0),
    torque_limit: float | Sequence[float] = 0.06,
    margin: float = 0.01,
    velocity_window: int = WINDOW,
    delay: int = 0,
    board: Board | None = None,
) -> TwoLink | SimulatedTwoLink:
    """Connect one arm, which moves one finger: a real arm if `board` is given, otherwise a simulated arm.

    A pair of values, one for each joint, can be given as a single number if the values are equal. The five mechanical
    settings are those from `link_masses` to `joint_damping`. In a simulated arm, those that are omitted have the values
    of `PRESET`. A real arm has known mass and damping only if all five are given.

    Args:
        base: Position of the first joint [m].
        elbow: Side of the elbow, "left" or "right", seen from the base towards the finger.
        links: Lengths of the links [m].
        link_masses: Masses of the links [kg].
        link_inertias: Moments of inertia about each link's centre of mass [kg m^2].
        link_centres: Distances from a link's first joint to its centre of mass [m].
        rotor_inertias: Moments of inertia of the motors, before the gear [kg m^2].
        joint_damping: Viscous damping of the joints, after the gear [N m s/rad].
        drive: "base" if both motors are at the base and the second one drives link 2 through a belt or parallelogram;
            "elbow" if the second motor is at the elbow.
        counts: Counts of an encoder per revolution of its motor, counting all edges.
        gear: Revolutions of the motor per revolution of the joint; negative if the joint turns the other way.
        zero: Joint positions at zero counts [rad]: directions of both links from the x axis, or with `drive="elbow"`
            the direction of link 1 and the angle from it to link 2.
        torque_limit: Torque limit of a motor, before the gear [N m].
        margin: Smallest distance of the finger from the stretched or folded posture [m].
        velocity_window: Largest number of samples in the window of the velocity estimate.
        delay: Output delay of a simulated arm [samples].
        board: Board with the encoders and motors of a real arm; None for a simulated arm.
    """
    arm = Arm(
        base=pair("base", base, -LARGEST, ANY, one=True),
        links=pair("links", links, SMALLEST, POSITIVE, one=True),
        elbow=elbow,
        drive=drive,
        margin=number("margin", margin, -LARGEST, expected="a finite length [m]"),
    )
    wiring = Wiring(
        counts=pair("counts", counts, SMALLEST, POSITIVE, one=True),
        gear=pair("gear", gear, -LARGEST, ANY, one=True),
        zero=pair("zero", zero, -LARGEST, ANY, one=True),
        torque_limit=pair("torque_limit", torque_limit, SMALLEST, POSITIVE, one=True),
    )
    settings = {
        "link_masses": link_masses,
        "link_inertias": link_inertias,
        "link_centres": link_centres,
        "rotor_inertias": rotor_inertias,
        "joint_damping": joint_damping,
    }
    figures = {
        name: pair(name, value, 0.0, NOT_NEGATIVE, one=True) for name, value in settings.items() if value is not None
    }
    window, late = whole("velocity_window", velocity_window, 1), whole("delay", delay, 0)
    if board is None:
        return SimulatedTwoLink(arm, wiring, _mechanics(arm, wiring, PRESET | figures), window, late)
    if late:
        raise InputError("delay", delay, "0 with a board", "only a simulated arm has a delay")
    mechanics = _mechanics(arm, wiring, figures) if len(figures) == len(PRESET) else None
    return TwoLink(arm, wiring, board, mechanics=mechanics, velocity_window=window)


def _mechanics(arm: Arm, wiring: Wiring, figures: dict[str, Pair]) -> Mechanics:
    gear, rotors = wiring.gear, figures["rotor_inertias"]
    return Mechanics(
        arm,
        masses=figures["link_masses"],
        inertias=figures["link_inertias"],
        centres=figures["link_centres"],
        reflected=(rotors[0] * gear[0] ** 2, rotors[1] * gear[1] ** 2),
        damping=figures["joint_damping"],
    )
