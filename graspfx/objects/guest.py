"""Bodies that other software moves: what is handed to it and what it tells, and the protocol of such a body."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Protocol, runtime_checkable

from graspfx.objects import integrators as at
from graspfx.objects.body import FloatArray
from graspfx.spatial import exponential_numbers as exponential
from graspfx.spatial import product
from graspfx.spatial import rotate_numbers as rotate

# Offsets in a body's part of the buffer. What it is like:
BY_SPIN = 0  # 1: it is handed the angular velocity after the step, 0: a moment
SHIFTS = 1  # 1 for each translation that is free, world axes
TURNS = 4  # and each rotation
TURNING = 7  # how many rotations are free
AXIS = 8  # the first of them
STRUCTURE = 9  # what is before never changes
SHARE = 9  # (1 - E)/(b T/m), E = exp(-b T/m): of a force, so that held over T it does what viscosity would leave of it
SHARES = 10  # the same about the principal axes
MOMENTS = 13  # of inertia, that the software has been given [kg m^2]
START = 16  # the quaternion from which one free rotation is counted
FIRST = 20  # the angle that the plane's began with [rad]
ANGLE = 21  # of one free rotation since then, unwrapped [rad]
# What is handed over, world axes:
PUSH = 22  # [N]
TWIST = 25  # [N m], or [rad/s]
# What is told, world axes:
WAITING = 28  # 1 if something was handed over whose outcome has not been taken yet
VELOCITY = 29  # [m/s]
PLACE = 32  # [m], of a body with a free rotation; of others it is x + T v
TURN = 35  # the quaternion since the start, or all of it if more than one rotation is free
SPIN = 39  # [rad/s]
SIZE = 42

TURN_LIMIT = 0.25 * math.pi  # PyBullet turns a body no further than this in one step, whatever its angular velocity
TOO_FAST = 1


@runtime_checkable
class Guest(Protocol):
    """A body, or a world of bodies, that other software moves by one call between two ticks.

    A run computes what that software is handed at the end of a tick, `handing(S, o, F, f, T)` for each body whose block
    starts at S[o] and whose part of the buffer at F[f]; calls `exchange`; and takes what it was told at the beginning
    of the next tick, `taking(S, o, F, f, T)`: 0, or a code if the body cannot go on.
    """

    @property
    def buffer(self) -> FloatArray:
        """What is handed over and told, the same array for its life."""
        ...

    @property
    def structure(self) -> Sequence[int]:
        """Entries of the buffer that never change and pick what the kernels do."""
        ...

    @property
    def places(self) -> Sequence[int]:
        """Where the part of each body starts; -1 for one that never moves."""
        ...

    @property
    def handing(self) -> Any: ...

    @property
    def taking(self) -> Any: ...

    def hold(self, T: float) -> None:
        """From here on every sample takes T [s]."""

    def exchange(self) -> None:
        """Hand over, step, be told: the only call of a tick that is no kernel."""

    def take(self) -> int:
        """What was told last, if it has not been taken yet; 0, or the code of the first body that cannot go on."""
        ...

    def fault_text(self, code: int) -> str:
        """Why a body cannot go on."""
        ...


def hand_over(S: Any, o: int, F: Any, f: int, T: float) -> None:
    """The force (f + m g - b v) (1 - E)/(b T/m), and the moment likewise or the angular velocity that it leads to."""
    b = S[o + at.VISCOSITY]
    for a in range(3):
        push = 0.0
        if F[f + SHIFTS + a] != 0.0:
            pull = S[o + at.FORCE + a] + S[o + at.MASS] * S[o + at.GRAVITY + a] - b * S[o + at.VELOCITY + a]
            push = F[f + SHARE] * pull
        F[f + PUSH + a] = push
    if F[f + TURNING] > 0.0:
        x, y, z = moment(S, o, F, f)
        if F[f + BY_SPIN] != 0.0:
            x, y, z = spin_after(S, o, F, f, T, x, y, z)
        F[f + TWIST], F[f + TWIST + 1], F[f + TWIST + 2] = x, y, z
    F[f + WAITING] = 1.0


def moment(S: Any, o: int, F: Any, f: int) -> tuple[float, float, float]:
    """The moment with exact viscosity, world axes [N m]."""
    m, v, free = o + at.MOMENT, o + at.ANGULAR_VELOCITY, o + at.FREE + 3
    b = S[o + at.ROTATIONAL_VISCOSITY]
    mx = S[free] * (S[m] - b * S[v])
    my = S[free + 1] * (S[m + 1] - b * S[v + 1])
    mz = S[free + 2] * (S[m + 2] - b * S[v + 2])
    p, q, r = F[f + SHARES], F[f + SHARES + 1], F[f + SHARES + 2]
    if p == q == r:
        return p * mx, p * my, p * mz
    n = o + at.QUATERNION
    x, y, z, w = S[n], S[n + 1], S[n + 2], S[n + 3]
    mx, my, mz = rotate(-x, -y, -z, w, mx, my, mz)
    return rotate(x, y, z, w, p * mx, q * my, r * mz)


def spin_after(S: Any, o: int, F: Any, f: int, T: float, mx: float, my: float, mz: float) -> tuple[float, float, float]:
    """w + T J^-1 M, world axes [rad/s]."""
    n, v, J = o + at.QUATERNION, o + at.ANGULAR_VELOCITY, f + MOMENTS
    x, y, z, w = S[n], S[n + 1], S[n + 2], S[n + 3]
    mx, my, mz = rotate(-x, -y, -z, w, mx, my, mz)
    mx, my, mz = rotate(x, y, z, w, T * mx / F[J], T * my / F[J + 1], T * mz / F[J + 2])
    return S[v] + mx, S[v + 1] + my, S[v + 2] + mz


def take_over(S: Any, o: int, F: Any, f: int, T: float) -> int:
    """The motion told after a step of T [s], into the block; TOO_FAST for a turn that was cut short."""
    if F[f + WAITING] == 0.0:
        return 0
    F[f + WAITING] = 0.0
    for a in range(3):
        if F[f + SHIFTS + a] != 0.0:
            v = F[f + VELOCITY + a]
            S[o + at.VELOCITY + a] = v
            S[o + at.POSITION + a] = S[o + at.POSITION + a] + T * v if F[f + TURNING] == 0.0 else F[f + PLACE + a]
    if F[f + TURNING] == 0.0:
        return 0
    s = f + SPIN
    speed = math.sqrt(F[s] * F[s] + F[s + 1] * F[s + 1] + F[s + 2] * F[s + 2])
    if not speed * T <= TURN_LIMIT:  # nor if it is not a number
        return TOO_FAST
    for a in range(3):
        if F[f + TURNS + a] != 0.0:
            S[o + at.ANGULAR_VELOCITY + a] = F[s + a]
    n = f + TURN
    x, y, z, w = F[n], F[n + 1], F[n + 2], F[n + 3]
    if F[f + TURNING] == 1.0:
        axis = int(F[f + AXIS])
        angle = 2.0 * math.atan2(F[n + axis], w)
        ahead = F[f + ANGLE] + T * F[s + axis]
        angle += 2.0 * math.pi * math.floor((ahead - angle) / (2.0 * math.pi) + 0.5)
        F[f + ANGLE] = angle
        if S[o + at.DIMENSIONS] == 2.0:
            S[o + at.ANGLE] = F[f + FIRST] + angle
            at.orient(S, o)
            return 0
        tx = angle if axis == 0 else 0.0
        ty = angle if axis == 1 else 0.0
        tz = angle if axis == 2 else 0.0
        x, y, z, w = exponential(tx, ty, tz)
        n = f + START
        x, y, z, w = product(x, y, z, w, F[n], F[n + 1], F[n + 2], F[n + 3])
    n = o + at.QUATERNION
    if x * S[n] + y * S[n + 1] + z * S[n + 2] + w * S[n + 3] < 0.0:  # its sign may change at will
        x, y, z, w = -x, -y, -z, -w
    S[n], S[n + 1], S[n + 2], S[n + 3] = x, y, z, w
    at.orient(S, o)
    return 0
