"""Linearised loop of a grasp about an equilibrium: devices, hands and operators, coupling, object, delays."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from os import PathLike
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.analysis.checked_arguments import LONGEST, lag_of_object, number, numbers, one_of, samples
from graspfx.analysis.discrete import INTEGRATORS
from graspfx.card import Card, Carded, listed, span
from graspfx.errors import InputError
from graspfx.numeric import SMALLEST

if TYPE_CHECKING:
    import control

FloatArray = NDArray[np.float64]

OF_LIMBS = ("limb_mass", "limb_stiffness", "limb_damping")  # matrices of operators, by the vectors that they map
FROM_MOTIONS, FROM_FORCES = ("pull", "pull_damping", "friction"), ("counter", "grip")


@dataclass(frozen=True, eq=False)
class OperatorMatrices:
    """Operators with limbs, delayed reactions or a variable grip, for small motions of m device coordinates x.

    Such operators add terms to the springs K_h and dampers B_h of `Linearisation`. The displayed force d opposes the
    device; limbs have the coordinates y (l,). Forces of the reaction h and of the grip g are held over a sample k.

        m x'' + b x' + R x' = -d - F + (I - S S') h + g                                                        devices
        M y'' + B y' + K y = S'F + S'h - S'g,    F = K_h (x - S y) + B_h (x' - S y')                             limbs
        h_k = -s_(k - n),    s = P x + Q x' - C d                                                            reactions
        g_k = a g_(k-1) - (1 - a) A d_k                           change of the hand's force with the stiffness of grip

    Attributes:
        limb: Matrix S (m, l), whose orthonormal columns are the coordinates with a limb.
        limb_mass, limb_stiffness, limb_damping: Matrices M, K, B of the limbs, (l, l) [kg, N/m, N s/m].
        pull, pull_damping, counter: Matrices P, Q, C of the reactions, (m, m) [N/m, N s/m, 1].
        delay: Delays n of the reactions, (m,) [samples]; they have no effect if P, Q and C are zero.
        grip: Matrix A (m, m), change of the hand's force per displayed force.
        grip_share: Factors a by which the grip's force decays in one sample, (m,).
        friction: Friction R of the devices in addition to b, (m, m) [N s/m].
    """

    limb: FloatArray
    limb_mass: FloatArray
    limb_stiffness: FloatArray
    limb_damping: FloatArray
    pull: FloatArray
    pull_damping: FloatArray
    counter: FloatArray
    delay: NDArray[np.int64]
    grip: FloatArray
    grip_share: FloatArray
    friction: FloatArray

    def __post_init__(self) -> None:
        m, limbs = self.limb.shape
        for name, size in (dict.fromkeys(OF_LIMBS, limbs) | dict.fromkeys((*FROM_MOTIONS, *FROM_FORCES), m)).items():
            matrix = getattr(self, name)
            if matrix.shape != (size, size) or not np.isfinite(matrix).all():
                raise InputError(name, matrix, f"a finite matrix ({size}, {size})")
        for name in ("delay", "grip_share"):
            if getattr(self, name).shape != (m,):
                raise InputError(name, getattr(self, name), f"({m},) numbers")
        if self.reacts and (self.delay < 1).any():
            raise InputError("delay", self.delay, "a delay of one sample or more for every reaction")

    @property
    def reacts(self) -> bool:
        """Whether any of P, Q and C is not zero, so that there are reactions."""
        return bool(self.pull.any() or self.pull_damping.any() or self.counter.any())

    @property
    def limbs(self) -> int:
        """Number l of device coordinates with a limb."""
        return int(self.limb.shape[1])

    @property
    def alike(self) -> bool:
        """Whether all coordinates are equivalent: all or none have a limb, and delays and decay factors are equal."""
        m, limbs = self.limb.shape
        whole = not limbs or (limbs == m and np.array_equal(self.limb, np.eye(m)))
        return whole and bool((self.delay == self.delay[0]).all() and (self.grip_share == self.grip_share[0]).all())

    @property
    def springs(self) -> list[FloatArray]:
        """Matrices M, K, B (l, l) and P, Q, R (m, m), which map motions to forces."""
        return [getattr(self, name) for name in (*OF_LIMBS, *FROM_MOTIONS)]

    @property
    def ratios(self) -> list[FloatArray]:
        """Matrices C and A (m, m), which map forces to forces."""
        return [getattr(self, name) for name in FROM_FORCES]

    def selected(self, coordinates: NDArray[np.bool_ | np.intp]) -> OperatorMatrices:
        """Return the operator of the given coordinates, a mask (m,) or indices; no force acts on the others."""
        S = self.limb[coordinates]
        limbs, own = np.nonzero(S)[1], np.arange(len(self.limb))[coordinates]  # limbs in the order of the coordinates
        places: dict[str, Any] = dict.fromkeys(OF_LIMBS, np.ix_(limbs, limbs))
        places |= dict.fromkeys((*FROM_MOTIONS, *FROM_FORCES), np.ix_(own, own)) | {"delay": own, "grip_share": own}
        return replace(self, limb=S[:, limbs], **{name: getattr(self, name)[place] for name, place in places.items()})

    def on(self, basis: FloatArray, forces: FloatArray) -> OperatorMatrices:
        """Return the operator in coordinates z (k,) with x = `basis` z.

        The operator must be `alike`, or `basis` must only rotate the axes of each finger.

        Args:
            basis: Matrix (m, k) from motions z to motions x, which also transforms limbs.
            forces: Matrix (m, k) from forces on z to forces on x; `basis.T @ forces` is the identity.
        """
        m, k = basis.shape
        limb = self.limb if self.limbs not in (0, m) else np.eye(k)[:, : self.limbs]
        W = self.limb.T @ basis @ limb
        changes: dict[str, Any] = {name: W.T @ getattr(self, name) @ W for name in OF_LIMBS}
        changes |= {name: basis.T @ getattr(self, name) @ basis for name in FROM_MOTIONS}
        changes |= {name: basis.T @ getattr(self, name) @ forces for name in FROM_FORCES}
        return replace(self, limb=limb, delay=self.delay[:k], grip_share=self.grip_share[:k], **changes)


@dataclass(frozen=True, eq=False, init=False, repr=False)
class Linearisation(Carded):
    """Small motions of m device coordinates x and r object coordinates q about the equilibrium of a grasp.

        m_i x'' + b_i x' + (K_h x + B_h x')_i = -(f + N_x (x, q))_i          devices, in continuous time
        M_o q'' + B_o q' = G f - N_q (x, q)                                  object, by its integrator
        f = K (x - G_e' q) + D (x' - G' q'),     x' = (x_k - x_(k-1))/T,     N = [N_x; N_q]

    The right-hand sides are held over a sample of length T. The force acts on devices `delay` samples and `lateness`
    seconds late, and on the object `object_delay` samples late; x and x' in f are `age` seconds old. If `rate` is
    "state", x' in f is the devices' velocity instead of the difference. A ground adds to the object's wrench

        -(K_g q_1 + B_g q_1'),    q_1 = q_0 + T q_1'

    where q_0 is the object's position at the start of the sample, and q_1' the object's velocity at the end, which is
    solved for together with the wrench. With the integrator "implicit", the coupling's prediction of the object assumes
    the ground's wrench of the previous sample.

    Args:
        period: Sampling period T [s].
        mass: Mass of the devices, one per coordinate (m,) or a number [kg].
        friction: Friction b of the devices, (m,) or a number [N s/m].
        G: Matrix (r, m) from contact forces f to the wrench on the object's free coordinates.
        inertia: Inertia M_o of the object, (r, r) or its diagonal (r,) [kg, kg m^2].
        viscosity: Viscosity B_o of the object, (r, r) or its diagonal (r,) [N s/m, N m s/rad].
        stiffness: Stiffness K of the coupling, (m, m), or a number for all coordinates [N/m].
        damping: Damping D of the coupling, (m, m), or a number [N s/m].
        hand_stiffness: Hand stiffness K_h, (m, m), its diagonal (m,), or a number [N/m].
        hand_damping: Hand damping B_h, (m, m), its diagonal (m,), or a number [N s/m].
        delay: Delay of the force [samples], one per coordinate or a number.
        lateness: Additional delay of the force on the device [s], one per coordinate or a number. It need not be a
            whole number of samples: the held force then changes within a sample.
        age: Age of the position and velocity that the coupling uses [s], one per coordinate or a number.
        object_delay: Delay of the force on the object [samples].
        integrator: Integrator of the object, one of `INTEGRATORS`.
        preload: Stiffness N (m + r, m + r) that the forces at equilibrium cause (`preloaded`); zero if None.
        G_displacement: Matrix G_e (r, m), whose transpose maps the object's motion to displacements at the contacts; G
            if None.
        rate: Source of x' in the force, "difference" or "state".
        ground: Stiffness and damping (K_g, B_g) of the ground, each (r, r) [N/m, N s/m]; None for an object without
            ground.
        G_contact: Matrix (r, m) of the contact points, with which the integrator "implicit" solves for the force and
            the object's displacement if `G` and `G_displacement` are those of the fingertips. If None, "implicit" uses
            `G`, `G_displacement` and the preload.
        operator: Limbs, reactions and variable grips of operators; None for hands that are springs and dampers.

    Raises:
        InputError: If an argument is invalid; the message names the argument.
        UnknownNameError: If the integrator or the rate is unknown.
    """

    period: float
    mass: FloatArray
    friction: FloatArray
    G: FloatArray
    inertia: FloatArray
    viscosity: FloatArray
    stiffness: FloatArray
    damping: FloatArray
    hand_stiffness: FloatArray
    hand_damping: FloatArray
    delay: NDArray[np.int64]
    lateness: FloatArray
    age: FloatArray
    object_delay: int
    integrator: str
    preload: FloatArray | None
    G_displacement: FloatArray = field(repr=False)
    rate: str
    ground: tuple[FloatArray, FloatArray] | None
    G_contact: FloatArray | None = field(repr=False)
    operator: OperatorMatrices | None = field(repr=False)

    def __init__(
        self,
        *,
        period: float,
        mass: ArrayLike,
        friction: ArrayLike,
        G: ArrayLike,
        inertia: ArrayLike,
        viscosity: ArrayLike,
        stiffness: ArrayLike,
        damping: ArrayLike = 0.0,
        hand_stiffness: ArrayLike = 0.0,
        hand_damping: ArrayLike = 0.0,
        delay: int | ArrayLike = 0,
        lateness: ArrayLike = 0.0,
        age: ArrayLike = 0.0,
        object_delay: int = 0,
        integrator: str = "exact",
        preload: ArrayLike | None = None,
        G_displacement: ArrayLike | None = None,
        rate: str = "difference",
        ground: tuple[ArrayLike, ArrayLike] | None = None,
        G_contact: ArrayLike | None = None,
        operator: OperatorMatrices | None = None,
    ) -> None:
        matrix = numbers("G", G, "1, m", negative=True)
        if matrix.ndim != 2 or not matrix.shape[1]:
            raise InputError("G", matrix, "a matrix (r, m), one row per free coordinate of the object")
        r, m = matrix.shape
        kind = one_of("integrator", integrator, INTEGRATORS)
        whole = np.array([samples("delay", d) for d in numbers("delay", delay, "1").ravel().tolist()], dtype=np.int64)
        if whole.shape not in ((1,), (m,)):
            raise InputError("delay", delay, f"one whole number, or {m} whole numbers")
        self._set(
            period=number("period", period, "s", zero=False),
            mass=_row("mass", mass, m, "kg", zero=False),
            friction=_row("friction", friction, m, "N s/m"),
            G=matrix,
            inertia=_positive("inertia", _square("inertia", inertia, r, "kg")),
            viscosity=_square("viscosity", viscosity, r, "N s/m"),
            stiffness=_square("stiffness", stiffness, m, "N/m"),
            damping=_square("damping", damping, m, "N s/m"),
            hand_stiffness=_square("hand_stiffness", hand_stiffness, m, "N/m"),
            hand_damping=_square("hand_damping", hand_damping, m, "N s/m"),
            delay=np.broadcast_to(whole, (m,)),
            lateness=_seconds("lateness", lateness, m, period),
            age=_seconds("age", age, m, period),
            object_delay=lag_of_object(object_delay, kind),
            integrator=kind,
            preload=None if preload is None else _shaped("preload", preload, (m + r, m + r), "N/m"),
            G_displacement=matrix
            if G_displacement is None
            else _shaped("G_displacement", G_displacement, (r, m), "1, m"),
            rate=one_of("rate", rate, ("difference", "state")),
            ground=None if ground is None else _ground(ground, r, kind),
            G_contact=None if G_contact is None else _shaped("G_contact", G_contact, (r, m), "1, m"),
            operator=operator,
        )
        if operator is not None and len(operator.limb) != m:
            raise InputError("operator", len(operator.limb), f"an operator with {m} coordinates")

    def _set(self, **values: Any) -> None:
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def _card(self) -> Card:
        m, r = self.coordinates
        extras = (("preload", self.preload), ("ground", self.ground), ("an operator's models", self.operator))
        late = f"{listed(dict.fromkeys(self.delay.tolist()))} samples, of the object's force {self.object_delay}"
        if self.latency.any():
            late += f"; and {span(1e3 * self.latency, 'ms')} of readings and forces"
        rows = [
            ("motions", f"{m} device coordinates and {r} of the object, sampled every {1e3 * self.period:g} ms"),
            ("devices", f"{span(self.mass, 'kg')}, {span(self.friction, 'N s/m')}"),
            ("object", f"{span(np.linalg.eigvalsh(self.inertia), 'kg or kg m^2')}, integrator {self.integrator}"),
            ("coupling", f"{_range(self.stiffness, 'N/m')}; {_range(self.damping, 'N s/m')}"),
            ("hands", f"{_range(self.hand_stiffness, 'N/m')}; {_range(self.hand_damping, 'N s/m')}"),
            ("delay", late if self.delay.any() or self.latency.any() or self.object_delay else "none"),
            ("with", listed(name for name, part in extras if part is not None)),
        ]
        calls = "gx.stability.spectral_radius(linear), gx.stability.loci(linear), .to_control(), .with_changes()"
        return Card("Linearisation of a grasp at rest", rows, calls)

    @property
    def coordinates(self) -> tuple[int, int]:
        """Number m of device coordinates and number r of object coordinates."""
        return self.G.shape[1], self.G.shape[0]

    @property
    def latency(self) -> FloatArray:
        """Sum of the age of the position and the lateness of the force, (m,) [s]."""
        return self.lateness + self.age

    def to_control(self, loop: str = "closed") -> control.StateSpace:
        """Convert to a python-control system in discrete time, sampled with the period T.

        Args:
            loop: "closed" or "open". Inputs of the closed loop are the operator's forces on the device coordinates,
                `hand[i]` [N], held over a sample; its outputs are device positions `x[i]` [m], object coordinates
                `q[j]` [m, rad] and coupling forces on the object `f[i]` [N]. The open loop is the return ratio: its
                inputs are forces `u[i]` [N] that replace those of the coupling, and its outputs are the negative forces
                of the coupling. `control.feedback(system, I)` of the open loop has the closed loop's eigenvalues.

        Raises:
            MissingPackageError: If python-control is missing; `pip install 'graspfx[control]'` installs it.
            UnknownNameError: If `loop` is unknown.
        """
        from graspfx.show.conversions import to_control

        return to_control(self, loop)

    def with_changes(self, **changes: Any) -> Linearisation:
        """Return a copy with some arguments of the constructor changed."""
        names = self.__dataclass_fields__
        return Linearisation(**({name: getattr(self, name) for name in names} | changes))

    def with_arrays(self, **arrays: Any) -> Linearisation:
        """Return a copy with some fields changed; arrays must have the shapes of their fields and are not checked."""
        copy = object.__new__(Linearisation)
        copy._set(**(vars(self) | arrays))
        return copy


@runtime_checkable
class Linearisable(Protocol):
    """Protocol of a scene that the analysis can linearise."""

    def linearise(self) -> Linearisation:
        """Linearise small motions about the equilibrium of the grasp."""


Subject = Linearisation | Linearisable | str | PathLike[str]


def linear_of(subject: Subject, recording: object = None) -> Linearisation:
    """Return `subject` if it is a `Linearisation`; otherwise load and linearise the scene.

    Args:
        subject: `Linearisation`, scene, or name or path of a scene.
        recording: Recording of the scene, or path of the recording; the grasp is linearised at the last sample. If
            None, the result is that of `Scene.linearise`.

    Raises:
        InputError: If the subject or the recording has another type, or a recording is given with a `Linearisation`.
            Other errors are those of `gx.load` and `Scene.linearise`.
    """
    if isinstance(subject, Linearisation):
        if recording is not None:
            raise InputError("recording", recording, "None with a Linearisation", "pass the scene of the recording")
        return subject
    if isinstance(subject, str | PathLike):
        from graspfx.scene.load import to_scene

        subject = to_scene(subject)
    if not isinstance(subject, Linearisable):
        raise InputError("linear", subject, "a Linearisation, a scene, or the name or path of one")
    if recording is not None:
        from graspfx.certificate.linearise import recorded_loop

        return recorded_loop(subject, recording)  # type: ignore[arg-type]  # it checks both arguments
    return subject.linearise()


def _range(matrix: FloatArray, unit: str) -> str:
    """Format the smallest and largest eigenvalue of the symmetric part of a matrix, with their unit."""
    return span(np.linalg.eigvalsh(0.5 * (matrix + matrix.T)), unit)


def _ground(parts: tuple[ArrayLike, ArrayLike], r: int, integrator: str) -> tuple[FloatArray, FloatArray]:
    if integrator == "bullet":
        raise InputError("ground", parts, 'None for the integrator "bullet", whose contacts are not springs')
    stiffness, damping = parts
    return _square("ground stiffness", stiffness, r, "N/m"), _square("ground damping", damping, r, "N s/m")


def _row(name: str, entries: ArrayLike, m: int, unit: str, *, zero: bool = True) -> FloatArray:
    value = numbers(name, entries, unit, zero=zero)
    if value.shape not in ((), (m,)):
        raise InputError(name, value, f"one number [{unit}], or {m} numbers")
    return np.array(np.broadcast_to(value, (m,)))


def _seconds(name: str, entries: ArrayLike, m: int, period: float) -> FloatArray:
    value = _row(name, entries, m, "s")
    if (value > LONGEST * period).any():
        raise InputError(name, value.tolist(), f"at most {LONGEST} periods [s]")
    return value


def _square(name: str, matrix: ArrayLike, size: int, unit: str) -> FloatArray:
    value = numbers(name, matrix, unit, negative=True)
    if value.ndim < 2 and value.shape in ((), (size,)):
        return np.diag(np.broadcast_to(value, (size,)))
    return _shaped(name, value, (size, size), unit)


def _shaped(name: str, matrix: ArrayLike, shape: tuple[int, int], unit: str) -> FloatArray:
    value = numbers(name, matrix, unit, negative=True)
    if value.shape != shape:
        raise InputError(name, value, f"a matrix {shape} [{unit}]")
    return value


def _positive(name: str, matrix: FloatArray) -> FloatArray:
    if not np.allclose(matrix, matrix.T, rtol=1e-9) or (matrix.size and np.linalg.eigvalsh(matrix)[0] < SMALLEST):
        raise InputError(name, matrix.tolist(), "a symmetric positive definite matrix")
    return matrix
