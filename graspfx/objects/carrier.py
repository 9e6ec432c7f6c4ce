"""Common base classes of bodies simulated by another program."""

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
    """A body in another program's world; it receives the block's wrench before the world's step and is read afterwards.

    The force (f + m g - b v) (1 - E)/(b T/m), E = exp(-b T/m), is constant over the sample and models viscosity b: the
    velocity after the sample is exactly that of the viscous body, and the position is x+ = x + T v+. Moments about the
    principal axes are computed in the same way.

    No force acts along a locked degree of freedom, and its entries in the block are never written.

    Args:
        state: Block filled by `fill_body`, (SIZE,). The motion in the block is read once, and afterwards only written.
        part: Body's part of the buffer, (guest.SIZE,), for wrench and motion; overwritten completely.
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
        """Compute the fractions of force and moment that remain under viscosity, for samples of T [s]."""
        body, own_part = self._body, self.part
        own_part.share = decay_integrals(body.viscosity * T / body.mass)[1]
        b, J = body.rotational_viscosity, own_part.moments
        own_part.shares = Vector(*(decay_integrals(b * T / moment)[1] for moment in (J.x, J.y, J.z)))

    def hand_over(self, T: float) -> None:
        """Send the wrench in the block, with gravity and viscosity, to the other program for a step of T [s]."""
        self.handing(self._body, self.part, T)

    def take_over(self, T: float) -> int:
        """Write the motion after a step of T [s] to the block; return 0, or a code if the body cannot continue."""
        body, part = self._body, self.part  # local names, because a run executes this in every tick
        return int(source_function(self.taking)(body.buffer, body.offset, part.buffer, part.offset, T))

    @property
    def speed(self) -> float:
        """Angular speed at the last reading [rad/s]."""
        return float(np.linalg.norm(self.part.array(GuestState.spin)))

    def _seen_moments(self) -> tuple[float, ...]:
        """Compute the moments of inertia for the other program; with a single free rotation, all equal its moment."""
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
    """Bodies simulated by another program, in a world that contains only them and is stepped once per tick.

    Args:
        buffer: Flat buffer, (bodies guest.SIZE,), with a part for each body of `carried`.
        carried: Bodies of the world.
        calls: Function calls of one exchange, in order.
    """

    program = "the other program"  # name of the program in messages
    handing: Callable[..., None] = staticmethod(guest.hand_over)
    taking: Callable[..., int] = staticmethod(guest.take_over)

    def __init__(self, buffer: FloatArray, carried: Sequence[CarriedBody], calls: Sequence[Call]) -> None:
        self.buffer, self.carried = buffer, carried
        moves = [not one.fixed for one in carried]
        self.places = tuple(i * guest.SIZE if m else -1 for i, m in enumerate(moves))
        self._moving = [one for one, m in zip(carried, moves, strict=True) if m]
        self._T = 0.0
        self._calls = calls
        self._exchange = in_turn(calls)

    @property
    def calls(self) -> Sequence[Call]:
        """Function calls of one exchange; empty if a subclass overrides `exchange`."""
        return self._calls if type(self).exchange is Carrier.exchange else ()

    def hold(self, T: float) -> None:
        """Set the period of all following samples to T [s].

        Raises:
            InputError: If T is not a finite time above zero.
        """
        if T != self._T:
            if not 0.0 < T < math.inf:
                raise InputError("T", T, "a finite time above zero [s]")
            for one in self._moving:
                one.hold(T)
            self._set_step(T)
            self._T = T

    def exchange(self) -> None:
        """Apply the wrench to every body, step the world, and read every body."""
        self._exchange()

    def take(self) -> int:
        """Write the last readings to the blocks; return 0, or the code of the first body that cannot continue."""
        return next((code for one in self._moving if (code := one.take_over(self._T))), 0)

    def fault_text(self, code: int) -> str:
        """Return the message for the fault code of a body that cannot continue."""
        return str(self._fault(code))

    def step(self, T: float) -> None:
        """Advance every body by T [s] under its contact forces and the wrench in its block, which is held constant.

        Raises:
            InputError: If T is not a finite time above zero, or a body cannot continue.
        """
        self.hold(T)
        for one in self._moving:
            one.hand_over(T)
        self.exchange()
        code = self.take()
        if code:
            raise self._fault(code)

    def free_motion(self, T: float) -> None:
        """Raise InputError, because the program cannot solve for a new state."""
        raise InputError(
            "integrator", "implicit", f"another one: {self.program} has one integrator", "use native dynamics"
        )

    def _set_step(self, T: float) -> None:
        raise NotImplementedError

    def _fault(self, code: int) -> InputError:
        raise NotImplementedError


def numbers_of(record: Any, field: Any) -> tuple[float, ...]:
    """Return the entries of a record's field."""
    return tuple(record.array(field).tolist())
