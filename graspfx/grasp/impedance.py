"""Coupling impedances of the external and the internal part of contact forces, eq. (4)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx import log
from graspfx.card import Card, Carded
from graspfx.errors import InputError, UnknownNameError
from graspfx.grasp.gain import SYMMETRIC, Gain, block_diagonal, checked_gain, equal_gains, gain_text, turned_gain
from graspfx.grasp.matrix import transposed
from graspfx.grasp.object_impedance import ObjectImpedance, object_gain
from graspfx.grasp.point_sets import Numbers, point_force, point_forces
from graspfx.grasp.split import Split, fits
from graspfx.numeric import FEW, LARGEST, finite

FloatArray = NDArray[np.float64]
Form = Literal["literal", "symmetric"]
Pair = Literal["stiffness", "damping"]

LOOP_RADIUS = 0.005  # radius of the closed motion whose energy the warning states [m]
FLOAT = np.dtype(np.float64)
GROWN = 10.0  # growth that causes another warning; while a finger fades in, the skew part grows from a small value


class ActiveCouplingWarning(UserWarning):
    """Warning that a coupling can create energy."""


@dataclass(frozen=True, eq=False, init=False, repr=False)
class Impedance(Carded):
    """Spring and damper between contact displacements and forces, f = K e + D e'.

    A gain is a number, one number per finger (n,), a symmetric positive semidefinite matrix (d, d) for all fingers or
    (n, d, d) per finger in the axes of the contacts' force components, or a full matrix (m, m).

    Args:
        stiffness: Stiffness K [N/m].
        damping: Damping D [N s/m].

    Raises:
        InputError: If a number is negative or not finite, or a matrix is not symmetric positive semidefinite.
    """

    stiffness: Gain
    damping: Gain

    def __init__(self, stiffness: ArrayLike, damping: ArrayLike = 0.0) -> None:
        object.__setattr__(self, "stiffness", checked_gain("stiffness", stiffness))
        object.__setattr__(self, "damping", checked_gain("damping", damping))

    def _card(self) -> Card:
        return Card(f"Impedance: {self._text()}")

    def _text(self) -> str:
        return f"{gain_text(self.stiffness, 'N/m')}, {gain_text(self.damping, 'N s/m')}"


@dataclass(frozen=True, eq=False, repr=False)
class Coupling(Carded):
    """f = P (K_ep e + K_ed e') + (I - P) (K_ip e + K_id e') (Kawai and Yoshikawa, eq. 4), force on the object.

    Here e contains the displacements of the fingers from the contacts, e' the rates of the displacements, and P is the
    split's projector on forces. If the split has a metric M = L L with a symmetric L, a scalar gain k enters as k M,
    and gains K per finger and (d, d) matrices enter as L K L. Contacts with a small weight therefore have a small
    force. Full matrices enter as given.

    The form "literal" is eq. (4). The stiffness of this form is asymmetric if the gains do not commute with P. An
    asymmetric stiffness creates energy on some closed motions. A warning states the energy, and is repeated whenever
    the energy has grown tenfold. The form "symmetric", P K_ep P' + (I - P) K_ip (I - P)', never creates energy. The two
    forms agree for scalar gains.

    If the external and internal stiffness are equal, then f = K e exactly, without P, in both forms (the conventional
    method, eqs. 20-23). The same is true of equal damping.

    If the external impedance is an `ObjectImpedance`, K_ep is the object's stiffness distributed over the contacts, and
    P does not change K_ep. In this case, K = K_ep + (I - P) K_ip. In the form "symmetric", or if K_ip is a number, the
    internal part is (I - P) K_ip (I - P)'.

    Args:
        external: Impedance with K_ep and K_ed.
        internal: Impedance with K_ip and K_id.
        form: "literal" or "symmetric".

    Raises:
        UnknownNameError: If the form is neither "literal" nor "symmetric".
        InputError: If `external` or `internal` is not an impedance.
    """

    external: Impedance | ObjectImpedance
    internal: Impedance
    form: Form = "literal"
    _warned: dict[Pair, float] = field(default_factory=dict, init=False, repr=False)
    _matrices: dict[Pair, tuple[Split, FloatArray]] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        if str(self.form) not in get_args(Form):
            raise UnknownNameError("form of the coupling", str(self.form), get_args(Form))
        kinds: dict[str, tuple[type, ...]] = {"external": (Impedance, ObjectImpedance), "internal": (Impedance,)}
        for name, allowed in kinds.items():
            if not isinstance(getattr(self, name), allowed):
                expected = " or ".join(f"an {kind.__name__}" for kind in allowed)
                raise InputError(name, getattr(self, name), expected, f"{name}=Impedance(stiffness, damping)")

    def _card(self) -> Card:
        rows = [("external", self.external._text()), ("internal", self.internal._text()), ("form", self.form)]
        return Card("Coupling, eq. (4)", rows, ".stiffness(split), .damping(split), .force(split, e, de)")

    @property
    def of_object(self) -> bool:
        """Whether the external impedance is an `ObjectImpedance`."""
        return isinstance(self.external, ObjectImpedance)

    @property
    def equal(self) -> bool:
        """Whether external and internal gains are equal: the conventional method, which needs no split."""
        if self.of_object:
            return False
        pairs: tuple[Pair, ...] = get_args(Pair)
        return all(equal_gains(*self._pair(pair)) for pair in pairs)

    def turned(self, R: ArrayLike) -> Coupling:
        """Return the coupling with matrix gains rotated into the axes of the contact forces, R K R'.

        Scalar gains do not change.

        Args:
            R: Rotation from the axes of the gains, (d, d), or (n, d, d) with one per contact.
        """
        turn = finite("R", R)
        if turn.ndim not in (2, 3) or turn.shape[-2] != turn.shape[-1]:
            raise InputError("R", R, "a rotation (d, d), or (n, d, d) with one per contact")
        external, internal = (
            part.turned(turn)
            if isinstance(part, ObjectImpedance)
            else Impedance(turned_gain(part.stiffness, turn), turned_gain(part.damping, turn))
            for part in (self.external, self.internal)
        )
        assert isinstance(internal, Impedance)
        return Coupling(external, internal, self.form)

    def stiffness(self, split: Split) -> FloatArray:
        """Compute K of f = K e + D e', (..., m, m) [N/m], read-only. The result is cached for the last split."""
        return self._matrix("stiffness", split)

    def damping(self, split: Split) -> FloatArray:
        """Compute D of f = K e + D e', (..., m, m) [N s/m], read-only. The result is cached for the last split."""
        return self._matrix("damping", split)

    def force(self, split: Split, e: ArrayLike, de: ArrayLike | None = None) -> FloatArray:
        """Compute contact forces on the object, (m,) or (..., m) [N].

        With scalar gains, the kernels of `PointCoupling` compute forces of hard contacts on a free object in O(n),
        without a matrix. In this case, forces of many sets of contacts are bit-identical to the forces of each set
        alone; in other cases they agree up to rounding errors.

        Args:
            split: Split of the contacts.
            e: Displacement of the fingers from their contacts, p - c [m]: (m,), or (n, d) if each contact has d forces.
                Many displacements of one set have the shape (..., n, d), and displacements of many sets (..., m) or
                (..., n, d).
            de: Rate of the displacement [m/s], with the shape of e; zero if None.
        """
        _require_split(split)
        x = _motion("e", e, split)
        dx = None if de is None else _motion("de", de, split)
        if split.of_points and self._numbers is not None:
            return _point_force(split, self._numbers, x, dx)
        f, external = self._part("stiffness", split, x)
        if dx is not None:
            more, also = self._part("damping", split, dx)
            f = f + more
            external = also if external is None else external if also is None else external + also
        return f if external is None else f + split.project(external)

    @cached_property
    def _numbers(self) -> Numbers | None:
        """Gains kep, ked, kip and kid if all of them are numbers, else None."""
        kep, ked, kip, kid = (
            gain for part in (self.external, self.internal) for gain in (part.stiffness, part.damping)
        )
        if isinstance(kep, float) and isinstance(ked, float) and isinstance(kip, float) and isinstance(kid, float):
            return kep, ked, kip, kid
        return None

    def rule(self, pair: Pair) -> Literal["equal", "literal", "symmetric"]:
        """Return the rule that combines the external and the internal gain of a pair.

        The rule is "equal" if the gains are equal, "literal" if both are numbers, and otherwise the coupling's `form`.
        With an `ObjectImpedance`, the rule is "symmetric" if the internal gain is a number, and otherwise `form`.
        """
        outer, inner = self._pair(pair)
        if self.of_object:
            return "symmetric" if isinstance(inner, float) else self.form
        if equal_gains(outer, inner):
            return "equal"
        return "literal" if isinstance(outer, float) and isinstance(inner, float) else self.form

    def _pair(self, pair: Pair) -> tuple[Gain, Gain]:
        return getattr(self.external, pair), getattr(self.internal, pair)

    def _part(self, pair: Pair, split: Split, x: FloatArray) -> tuple[FloatArray, FloatArray | None]:
        """Compute b and a of the force b + P a for one pair of gains; a is None if P is not needed."""
        outer, inner = self._pair(pair)
        if isinstance(outer, float) and isinstance(inner, float):
            y = split.weigh(x)
            return inner * y, None if outer == inner else (outer - inner) * y
        K = self._matrix(pair, split)
        return (K @ x if x.ndim == 1 else np.asarray((K @ x[..., None])[..., 0])), None

    def _matrix(self, pair: Pair, split: Split) -> FloatArray:
        _require_split(split)
        cached = self._matrices.get(pair)
        if cached is not None and cached[0] is split:
            return cached[1]
        outer, inner = self._pair(pair)
        rule = self.rule(pair)
        share: FloatArray | float = 0.0
        if isinstance(self.external, ObjectImpedance):
            share, outer = object_gain(self.external, pair, split), 0.0
        if rule == "equal":
            K = np.array(np.broadcast_to(spread(outer, split), (*split.sets, split.components, split.components)))
        elif isinstance(outer, float) and isinstance(inner, float):
            K = spread(inner, split) + (outer - inner) * split.modal_metric() + share
        else:
            A, B, E = spread(outer, split), spread(inner, split), split.external
            if rule == "symmetric":
                K = E @ A @ transposed(E) + split.internal @ B @ transposed(split.internal)
                K = (K + transposed(K)) / 2 + share
            else:
                K = B + E @ (A - B) + share
                self.warn_if_active(pair, K)
        K.setflags(write=False)
        self._matrices[pair] = (split, K)
        return K

    def warn_if_active(self, pair: Pair, K: FloatArray) -> None:
        """Warn if a stiffness or damping can create energy.

        The warning is repeated when the energy has grown tenfold.
        """
        limit = GROWN * self._warned.get(pair, 0.0)
        if limit > 0.0 and float(np.linalg.norm(K - transposed(K))) <= 2.0 * limit:
            return  # this bound is at least the spectral norm, and cheap
        size = float(np.abs(K).max())
        skew, lowest = skew_part(K), float(np.linalg.eigvalsh((K + transposed(K)) / 2).min())
        worst = max(skew if pair == "stiffness" else 0.0, -lowest)
        if worst <= limit:
            return
        faults = []
        # a skew damping does no work; a skew stiffness does 2 pi r^2 k_s on a circle in its plane
        if pair == "stiffness" and skew > SYMMETRIC * size:
            energy = loop_energy(K, LOOP_RADIUS)
            faults.append(
                f"its skew part of {skew:.3g} N/m creates up to {energy * 1e3:.2g} mJ on each closed motion of "
                f"{LOOP_RADIUS * 1e3:g} mm radius"
            )
        if lowest < -SYMMETRIC * size:
            unit = "N/m" if pair == "stiffness" else "N s/m"
            faults.append(f"its symmetric part has the eigenvalue {lowest:.3g} {unit}")
        if faults:
            self._warned[pair] = worst
            log.warn(
                f"the {pair} of eq. (4) can create energy: {' and '.join(faults)}; use form='symmetric', which cannot",
                ActiveCouplingWarning,
            )


def spread(gain: Gain, split: Split) -> FloatArray:
    """Expand a gain to a matrix (m, m) on the components of a split: k M, L K L (metric M = L L), or the full matrix.

    Raises:
        InputError: If the gain's shape is wrong for these contacts.
    """
    m, grasp, M = split.components, split.grasp, split.metric
    if isinstance(gain, float):
        return gain * (np.diag(M) if M.ndim == 1 else M)
    n = 0 if grasp is None else grasp.fingers
    if grasp is not None and gain.shape == (n,):
        K = np.diag(gain[grasp.finger_of_column])
    elif grasp is not None and gain.shape in ((d := grasp.forces_of_each, d), (n, d, d)):
        K = block_diagonal(gain, n)
    elif gain.shape == (m, m):
        return gain.copy()
    else:
        expected = f"a number or a matrix ({m}, {m})"
        if grasp is None:
            raise InputError(
                "gain", gain, expected, "a split of a matrix has no information about fingers: use the split of a Grasp"
            )
        raise InputError(
            "gain",
            gain,
            f"{expected}, {n} numbers, or (d, d) or ({n}, d, d) where each contact has d forces and no moment",
        )
    return split.stretch(split.stretch(K).T).T  # L K L; without a metric K to the bit


def per_finger(gain: Gain, fingers: int, dimensions: int) -> FloatArray:
    """Expand a gain of point contacts to (n, d, d), a matrix per finger; return a full matrix (m, m) unchanged.

    Raises:
        InputError: If the gain's shape is wrong for these contacts.
    """
    n, d = fingers, dimensions
    gains = np.asarray(gain, dtype=float)
    if gains.shape in ((), (n,)):
        return np.broadcast_to(gains, n)[:, None, None] * np.eye(d)
    if gains.shape in ((d, d), (n, d, d)):
        return np.broadcast_to(gains, (n, d, d))
    if gains.shape == (n * d, n * d):
        return gains
    raise InputError(
        "gain", gain, f"a number, {n} numbers, or an array ({d}, {d}), ({n}, {d}, {d}) or ({n * d}, {n * d})"
    )


def skew_part(K: FloatArray) -> float:
    """Compute |(K - K')/2|, the largest singular value [N/m]; for many matrices (..., m, m), the maximum."""
    return float(np.linalg.norm((K - transposed(K)) / 2, 2, axis=(-2, -1)).max())


def loop_energy(K: FloatArray, radius: float) -> float:
    """Compute 2 pi r^2 |(K - K')/2|, the largest work of f = K e on a circle of displacements of radius r [J]."""
    return 2.0 * math.pi * radius**2 * skew_part(K)


def _require_split(value: object) -> None:
    if not isinstance(value, Split):
        raise InputError("split", value, "a Split", "gx.Split(G), or the split of a gx.Grasp")


def _motion(name: str, value: ArrayLike, split: Split) -> FloatArray:
    """Check displacements or rates; return them as (m,) or (..., m)."""
    m = split.components
    if (
        type(value) is np.ndarray and value.shape == (m,) and m <= FEW and value.dtype == FLOAT
        and sum(map(abs, value.tolist())) <= LARGEST
    ):  # fmt: skip
        return value  # nothing to convert or copy, and all numbers are finite
    x = finite(name, value)
    if x.shape == (m,):
        return x
    if split.grasp is not None and x.shape[-2:] == (split.grasp.fingers, split.grasp.forces_of_each):
        x = x.reshape(*x.shape[:-2], m)
        if fits(x.shape[:-1], split.sets):
            return x
    elif split.sets and x.shape[-1:] == (m,) and fits(x.shape[:-1], split.sets):
        return x
    shapes = f"an array ({m},), one entry per contact component"
    if split.sets:
        shapes = f"an array {(*split.sets, m)}, one entry per contact component"
    raise InputError(name, x, f"{shapes}, or (..., n, d) where each contact has d forces")


def _point_force(split: Split, gains: Numbers, x: FloatArray, dx: FloatArray | None) -> FloatArray:
    """Compute forces of hard contacts on free objects by a kernel, for one set of contacts or many."""
    points, tolerance = split.points, split.point_tolerance
    if not split.sets and x.ndim == 1 and (dx is None or dx.ndim == 1):
        return point_force(points, gains, tolerance, x, dx)
    sets = np.broadcast_shapes(split.sets, x.shape[:-1], () if dx is None else dx.shape[:-1])
    n, d = points.shape[-2:]
    every = np.broadcast_to(points, (*sets, n, d)).reshape(-1, n, d)
    rows, rates = (None if y is None else np.broadcast_to(y, (*sets, n * d)).reshape(-1, n * d) for y in (x, dx))
    assert rows is not None
    return point_forces(every, gains, tolerance, rows, rates).reshape(*sets, n * d)
