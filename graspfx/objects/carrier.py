"""Bodies in a world of another program: what all such programs' bodies have in common."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from graspfx.compile.calls import Call, in_turn
from graspfx.compile.kernel import source_function
from graspfx.errors import InputError
from graspfx.objects import guest
from graspfx.objects.body import BlockBody, FloatArray
from graspfx.objects.body_state import BodyState, Motion
from graspfx.objects.decay import decay_integrals
from graspfx.objects.guest import GuestState
from graspfx.spatial import Quaternion, Vector, rotate


class CarriedBody(BlockBody):
    """A block's body in another program's world, pushed before the world's step and read after it.

    Viscosity b is the force (f + m g - b v) (1 - E)/(b T/m), E = exp(-b T/m), held over the sample: the velocity is
    that of the viscous body, the position x+ = x + T v+. Rotation likewise, about the principal axes.

    A locked freedom gets no force and its entries in the block are never written.

    Args:
        state: (SIZE,) the block, filled by `fill_body`. The motion is read from it once, then written only.
        part: (guest.SIZE,) of the buffer, for the wrench and the motion; overwritten whole.
    """

    handing: Callable[..., None] = staticmethod(guest.hand_over)
    taking: Callable[..., int] = staticmethod(guest.take_over)

    def __init__(self, state: FloatArray, part: FloatArray) -> None:
        super().__init__(state)
        d = self.dimensions
        own = BodyState(state)
        free = np.append(own.array(BodyState.free_translation), own.array(BodyState.free_rotation)) != 0.0
        self.fixed = not free.any()
        self.shifts = tuple(int(a) for a in range(3) if free[a])
        self.turns = tuple(int(a) for a in range(3) if free[3 + a])
        self.start = (0.0, 0.0, 0.0, 1.0) if d == 2 else numbers_of(own.motion, Motion.quaternion)
        self.place = numbers_of(own.motion, Motion.position)
        self.moments = self._seen_moments()
        part[:] = 0.0
        own_part = self.part = GuestState(memoryview(part))
        own_part.array(GuestState.free_translation)[:d] = free[:d]
        own_part.free_rotation = Vector(*free[3:])
        own_part.turns, own_part.axis = len(self.turns), self.turns[0] if self.turns else 0
        own_part.moments, own_part.start = Vector(*self.moments), Quaternion(*self.start)
        own_part.start_angle = self._body.motion.angle
        own_part.place = Vector(*self.place)

    def hold(self, T: float) -> None:
        """Compute the shares of viscosity over samples of T [s]."""
        body, own_part = self._body, self.part
        own_part.share = decay_integrals(body.viscosity * T / body.mass)[1]
        b, J = body.rotational_viscosity, own_part.moments
        own_part.shares = Vector(*(decay_integrals(b * T / moment)[1] for moment in (J.x, J.y, J.z)))

    def hand_over(self, T: float) -> None:
        """Hand over the wrench in the block, with gravity and viscosity, for a push over T [s]."""
        self.handing(self._body, self.part, T)

    def take_over(self, T: float) -> int:
        """Write the motion after a step of T [s] to the block; give 0, or a code if the body cannot go on."""
        body, part = self._body, self.part  # as numbers, since every call of a run ends here
        return int(source_function(self.taking)(body.buffer, body.offset, part.buffer, part.offset, T))

    @property
    def speed(self) -> float:
        """Speed of rotation at the last reading [rad/s]."""
        return float(np.linalg.norm(self.part.array(GuestState.spin)))

    def _seen_moments(self) -> tuple[float, ...]:
        """Compute moments of inertia of which each free rotation by itself takes the one that it should."""
        moments = numbers_of(self._body, BodyState.inertia)
        if not self.turns:
            return 1.0, 1.0, 1.0
        if len(self.turns) > 1 or moments[0] == moments[1] == moments[2] > 0.0:
            return moments
        axis = [1.0 if a in self.turns else 0.0 for a in range(3)]
        if self.dimensions == 3:
            own = rotate(Quaternion(*self.start).conjugate, Vector(*axis))
            axis = [own.x, own.y, own.z]
        J = sum(moment * e * e for moment, e in zip(moments, axis, strict=True))
        return J, J, J


class Carrier:
    """Bodies in one world of another program that is their own: a guest of the tick.

    Args:
        buffer: (bodies guest.SIZE,), flat; each body of `carried` has its part of it.
        carried: the bodies.
        calls: of an exchange, in their order.
    """

    program = "the other program"  # in messages
    handing: Callable[..., None] = staticmethod(guest.hand_over)
    taking: Callable[..., int] = staticmethod(guest.take_over)

    def __init__(self, buffer: FloatArray, carried: Sequence[CarriedBody], calls: Sequence[Call]) -> None:
        self.buffer, self.carried = buffer, carried
        moves = [not one.fixed for one in carried]
        self.places = tuple(i * guest.SIZE if m else -1 for i, m in enumerate(moves))
        self.structure = tuple(o + k for o in self.places if o >= 0 for k in range(guest.STRUCTURE))
        self._moving = [one for one, m in zip(carried, moves, strict=True) if m]
        self._T = 0.0
        self._calls = calls
        self._exchange = in_turn(calls)

    @property
    def calls(self) -> Sequence[Call]:
        """Calls of an exchange; none if a subclass exchanges in a way of its own."""
        return self._calls if type(self).exchange is Carrier.exchange else ()

    def hold(self, T: float) -> None:
        """Set the period of every sample from here on to T [s].

        Raises:
            InputError: T is no finite time above zero.
        """
        if T != self._T:
            if not 0.0 < T < math.inf:
                raise InputError("T", T, "a finite time above zero [s]")
            for one in self._moving:
                one.hold(T)
            self._set_step(T)
            self._T = T

    def exchange(self) -> None:
        """Push every body, let the world step, read every body: all that a tick needs of it."""
        self._exchange()

    def take(self) -> int:
        """Write the last reading to the blocks; give 0, or the code of the first body that cannot go on."""
        return next((code for one in self._moving if (code := one.take_over(self._T))), 0)

    def fault_text(self, code: int) -> str:
        """Explain why a body cannot go on."""
        return str(self._fault(code))

    def step(self, T: float) -> None:
        """Advance every body by T [s] under the wrench in its block, held, and its contacts.

        Raises:
            InputError: T is no finite time above zero; a body cannot go on.
        """
        self.hold(T)
        for one in self._moving:
            one.hand_over(T)
        self.exchange()
        code = self.take()
        if code:
            raise self._fault(code)

    def free_motion(self, T: float) -> None:
        """Raise InputError: the program cannot solve for a new state."""
        raise InputError(
            "integrator", "implicit", f"another one: {self.program} has one integrator", "use native dynamics"
        )

    def _set_step(self, T: float) -> None:
        raise NotImplementedError

    def _fault(self, code: int) -> InputError:
        raise NotImplementedError


def numbers_of(record: Any, field: Any) -> tuple[float, ...]:
    """Give the numbers of a record's field."""
    return tuple(record.array(field).tolist())
