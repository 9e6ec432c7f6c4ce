"""Native rigid bodies with four integrators: protocol of a body, and its memory block with parameters and state."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.compile.kernel import kernel
from graspfx.compile.records import Record
from graspfx.errors import InputError, UnknownNameError
from graspfx.numeric import SMALLEST, finite, number
from graspfx.objects import integrators as at
from graspfx.objects.body_state import BodyState, Motion
from graspfx.spatial import Quaternion, Vector

FloatArray = NDArray[np.float64]

INTEGRATORS = {
    "explicit": at.EXPLICIT,
    "semi-implicit": at.SEMI_IMPLICIT,
    "exact": at.EXACT,
    "implicit": at.IMPLICIT,
}
FREEDOMS = {1: (0,), 2: (0, 1, 5), 3: (0, 1, 2, 3, 4, 5)}  # entries from FREE on, for the rows of G, by d
UNIT = 1e-6  # tolerance for the norm of a quaternion
VISCOUS_LIMIT = 2.0  # b T/m from which viscosity treated explicitly is unstable


class Body(Protocol):
    """Protocol of an object's body. One block of memory contains the body's parameters, state and present wrench."""

    @property
    def state(self) -> FloatArray:
        """Block of the body, (SIZE,); `objects.integrators` defines the offsets of its entries."""
        ...

    def step(self, T: float) -> None:
        """Move the body by T [s] under the wrench in the block, which is constant over the sample."""

    def free_motion(self, T: float) -> None:
        """Fill the NEXT and COMPLIANCE entries: motion after T [s] without a wrench, and displacement per wrench."""


class BlockBody:
    """Body whose attributes are views of a memory block."""

    def __init__(self, state: FloatArray) -> None:
        self.state = _block(state)
        self.dimensions = d = BodyState(state).dimensions
        if d not in FREEDOMS:
            raise InputError("state", f"{d} dimensions", "a block written by fill_body")
        self._body = BodyState(state.data)  # items of a memoryview are Python floats, twice as fast as an array's
        motion = BodyState(state).motion
        self.position, self.velocity = motion.array(Motion.position)[:d], motion.array(Motion.velocity)[:d]
        self._quaternion = motion.array(Motion.quaternion)
        self._angular_velocity = motion.array(Motion.angular_velocity)

    @property
    def orientation(self) -> float | FloatArray | None:
        """Orientation: None on a line; unwrapped angle [rad] in the plane; quaternion (x, y, z, w) in space."""
        if self.dimensions == 3:
            return self._quaternion
        return self._body.motion.angle if self.dimensions == 2 else None

    @property
    def angular_velocity(self) -> float | FloatArray | None:
        """Angular velocity [rad/s]: None on a line; a number, about z, in the plane; (3,), in world axes, in space."""
        if self.dimensions == 3:
            return self._angular_velocity
        return float(self._angular_velocity[2]) if self.dimensions == 2 else None


def _block(state: object) -> FloatArray:
    """Check that an array may be a body's block, and return it."""
    if not (
        isinstance(state, np.ndarray) and state.dtype == np.float64
        and state.shape == (at.SIZE,) and state.flags.c_contiguous
    ):  # fmt: skip
        raise InputError("state", state, f"a contiguous float64 array of shape ({at.SIZE},)")
    return state


@kernel
def advance(body: BodyState, beside: Record, T: float) -> int:
    """Move a body without obstacles by T [s]; the record `beside` is unused."""
    at.step(body, T)
    return 0


@kernel
def expect(body: BodyState, beside: Record, T: float) -> None:
    """Predict the motion of a body without obstacles or wrench over T [s], with the implicit integrator."""
    at.predict(body, T)


class NativeBody(BlockBody):
    """A rigid body that is moved by the integrator stored in its block.

    A run may call the kernels `stepping(S, o, F, f, T)`, which moves the body and returns 0 or a fault code, and
    `predicting(S, o, F, f, T)`. The body's block starts at S[o], and the `buffer` at F[f]; without `buffer`, F is S.

    Args:
        state: Block filled by `fill_body`, (SIZE,), which the body updates in place.
    """

    stepping: Callable[..., int] = staticmethod(advance)
    predicting: Callable[..., None] = staticmethod(expect)
    buffer: FloatArray | None = None

    def fault_text(self, code: int) -> str:
        """Raise InputError, because the kernel `stepping` of this body never returns a fault code."""
        raise InputError("code", code, "0, because the step of a body without contacts cannot fail")

    def step(self, T: float) -> None:
        """Move the body by T [s] under the wrench in the block, which is constant over the sample."""
        at.step(self._body, T)

    def free_motion(self, T: float) -> None:
        """Fill the NEXT and COMPLIANCE entries for a sample of T [s].

        Raises:
            InputError: If the integrator is not "implicit". The entries do not describe a step of other integrators.
        """
        if self._body.integrator != at.IMPLICIT:
            name = next(name for name, kind in INTEGRATORS.items() if kind == self._body.integrator)
            raise InputError("integrator", name, "'implicit', because only this integrator solves for the new state")
        at.predict(self._body, T)


def create(state: FloatArray) -> NativeBody:
    """Return the body for `dynamics = "native"`."""
    return NativeBody(state)


def fill_body(
    state: FloatArray,
    *,
    dimensions: int,
    mass: float,
    inertia: float | ArrayLike | None = None,
    viscosity: float = 0.0,
    rotational_viscosity: float = 0.0,
    integrator: str = "semi-implicit",
    free: Sequence[bool] | None = None,
    gravity: ArrayLike | None = None,
    position: ArrayLike | None = None,
    orientation: float | ArrayLike | None = None,
    velocity: ArrayLike | None = None,
    angular_velocity: float | ArrayLike | None = None,
) -> None:
    """Write a body's parameters and initial state to its block.

    Args:
        state: Block, a contiguous float64 array (SIZE,); all entries are overwritten.
        dimensions: Number of dimensions d: 1, 2 or 3.
        mass: Mass m [kg].
        inertia: Moment of inertia about the centre of mass [kg m^2]: a number or, in space, the principal moments (3,)
            about the body's axes. The plane also accepts (3,) and uses the third. Required if a rotation is free.
        viscosity: Viscosity b [N s/m].
        rotational_viscosity: Rotational viscosity b_w [N m s/rad].
        integrator: Name of the integrator: "explicit", "semi-implicit", "exact" or "implicit".
        free: Mask of the free degrees of freedom: 1, 3 or 6 entries for d = 1, 2 or 3, first the translations, then the
            rotations. All are free by default.
        gravity: Gravity, (d,) [m/s^2]; None for zero.
        position: Position, (d,) [m]; None for zero.
        orientation: Angle [rad] in the plane, or unit quaternion (x, y, z, w) in space; None for no rotation.
        velocity: Velocity, (d,) [m/s]; None for zero.
        angular_velocity: Angular velocity [rad/s]: a number in the plane, or (3,), in world axes, in space; None for
            zero.

    Raises:
        InputError: If an argument is invalid; the message names the argument.
        UnknownNameError: If there is no integrator of this name.
    """
    d = int(number("dimensions", dimensions, "1, 2 or 3"))
    if d not in FREEDOMS or d != dimensions:
        raise InputError("dimensions", dimensions, "1, 2 or 3")
    kinds = FREEDOMS[d]
    moves = np.ones(len(kinds)) if free is None else finite("free", free, f"{len(kinds)} values true or false")
    if moves.shape != (len(kinds),) or not np.isin(moves, (0, 1)).all():
        raise InputError("free", free, f"{len(kinds)} values true or false", "translations first, then rotations")
    if str(integrator) not in INTEGRATORS:
        raise UnknownNameError("integrator", str(integrator), INTEGRATORS)
    _block(state)[:] = 0.0
    body = BodyState(state)
    motion = body.motion
    body.dimensions, body.integrator = d, INTEGRATORS[integrator]
    movable = np.zeros(6)
    movable[list(kinds)] = moves
    body.free_translation, body.free_rotation = Vector(*movable[:3]), Vector(*movable[3:])
    body.mass = number("mass", mass, "a finite number above zero [kg]", zero=False)
    body.inertia = Vector(*_moments(inertia, d, bool(movable[3:].any())))
    body.viscosity = number("viscosity", viscosity, "a finite number, zero or above [N s/m]")
    body.rotational_viscosity = number(
        "rotational_viscosity", rotational_viscosity, "a finite number, zero or above [N m s/rad]"
    )
    body.array(BodyState.gravity)[:d] = _vector("gravity", gravity, d)
    motion.array(Motion.position)[:d] = _vector("position", position, d)
    motion.array(Motion.velocity)[:d] = _vector("velocity", velocity, d)
    motion.quaternion = Quaternion(0.0, 0.0, 0.0, 1.0)
    if d == 1:
        for name, argument in (("orientation", orientation), ("angular_velocity", angular_velocity)):
            if argument is not None:
                raise InputError(name, argument, "None, because a body on a line cannot rotate")
    if d == 2:
        motion.angle = float(_vector("orientation", orientation, 0))
        motion.angular_velocity = Vector(0.0, 0.0, float(_vector("angular_velocity", angular_velocity, 0)))
    if d == 3:
        motion.angular_velocity = Vector(*_vector("angular_velocity", angular_velocity, 3))
        if orientation is not None:
            quaternion = _vector("orientation", orientation, 4)
            norm = float(np.linalg.norm(quaternion))
            if abs(norm - 1.0) > UNIT:
                raise InputError("orientation", f"a quaternion of norm {norm:.6g}", "x y z w of norm 1")
            motion.quaternion = Quaternion(*(quaternion / norm))
    locked = movable == 0.0
    for name, field, argument, still in (
        ("velocity", Motion.velocity, velocity, locked[:3]),
        ("angular_velocity", Motion.angular_velocity, angular_velocity, locked[3:]),
    ):
        if motion.array(field)[still].any():
            raise InputError(name, argument, "zero where `free` is false")
    at.orient(body)


def _vector(name: str, argument: float | ArrayLike | None, length: int, expected: str = "") -> FloatArray:
    """Return an argument as an array of `length` numbers, or of shape () if `length` is 0; None becomes zeros."""
    shape = (length,) if length else ()
    if argument is None:
        return np.zeros(shape)
    expected = expected or (f"{length} finite numbers" if length else "a finite number")
    value = finite(name, argument, expected)
    if value.shape != shape:
        raise InputError(name, argument, expected)
    return value


def _moments(inertia: float | ArrayLike | None, d: int, needed: bool) -> FloatArray:
    """Return the principal moments (3,) for the block [kg m^2]; `needed` is True if a rotation is free."""
    if inertia is None:
        if needed:
            raise InputError(
                "inertia",
                None,
                "a moment of inertia [kg m^2]",
                "a rotation is free: give the inertia, or lock the rotation",
            )
        return np.zeros(3)
    expected = "a number above zero, or three principal moments [kg m^2]"
    moments = finite("inertia", inertia, expected)
    if moments.shape not in ((), (3,)):
        raise InputError("inertia", inertia, expected)
    values = np.full(3, moments)
    if d == 2:
        values[:2] = 0.0
    counted = values[2:] if d == 2 else values
    if needed and not (counted >= SMALLEST).all():
        raise InputError("inertia", inertia, expected)
    if d == 3 and 2.0 * values.max() > values.sum() * (1.0 + 1e-9):
        raise InputError(
            "inertia", inertia, "moments, none of which exceeds the sum of the others", "check their units"
        )
    return values
