"""Eq. (4): coupling impedances for the external and for the internal part of a grasp's forces."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.card import Card, Carded, span
from graspfx.errors import InputError, UnknownNameError
from graspfx.grasp.split import SYMMETRIC, Split
from graspfx.numeric import finite

FloatArray = NDArray[np.float64]
Gain = float | FloatArray
Form = Literal["literal", "symmetric"]
Pair = Literal["stiffness", "damping"]

LOOP_RADIUS = 0.005  # [m], of the closed motion for which the warning gives an energy
GROWN = 10.0  # times what the last warning told: a finger that fades in begins with nearly no skew part


class ActiveCouplingWarning(UserWarning):
    """A coupling that can create energy."""


@dataclass(frozen=True, eq=False, init=False, repr=False)
class Impedance(Carded):
    """A spring and a damper for contact displacements, f = K e + D e'.

    A gain is a number; one per finger (n,); a symmetric positive semidefinite matrix (d, d) for every finger, or
    (n, d, d) with one each, in the axes of the contacts' force components; or a full matrix (m, m).

    Args:
        stiffness: [N/m].
        damping: [N s/m].

    Raises:
        InputError: a negative or not finite number, a matrix that is not symmetric positive semidefinite.
    """

    stiffness: Gain
    damping: Gain

    def __init__(self, stiffness: ArrayLike, damping: ArrayLike = 0.0) -> None:
        object.__setattr__(self, "stiffness", _gain("stiffness", stiffness))
        object.__setattr__(self, "damping", _gain("damping", damping))

    def _card(self) -> Card:
        return Card(f"Impedance: {self._text()}")

    def _text(self) -> str:
        return f"{_gain_text(self.stiffness, 'N/m')}, {_gain_text(self.damping, 'N s/m')}"


@dataclass(frozen=True, eq=False, repr=False)
class Coupling(Carded):
    """f = P (K_ep e + K_ed e') + (I - P) (K_ip e + K_id e') (Kawai and Yoshikawa, eq. 4), f on the object.

    P is the split's projector on forces. With a metric M = L L, L symmetric, numbers enter as k M, and gains per finger
    and (d, d) matrices as L K L, so that contacts with a small weight get a small force; full matrices stand as given.

    The form "literal" is eq. (4). With gains that do not commute with P its stiffness is asymmetric: it creates energy
    on closed motions, and a warning says how much, once and whenever that has grown tenfold. The form "symmetric",
    P K_ep P' + (I - P) K_ip (I - P)', never does. With numbers for gains the two agree.

    Where the external and the internal stiffness are equal, f = K e without P in either form, exactly (the
    conventional method, eqs. 20-23); the same for the damping.

    Args:
        external: K_ep and K_ed.
        internal: K_ip and K_id.
        form: "literal" or "symmetric".

    Raises:
        UnknownNameError: another form.
    """

    external: Impedance
    internal: Impedance
    form: Form = "literal"
    _warned: dict[Pair, float] = field(default_factory=dict, init=False, repr=False)
    _matrices: dict[Pair, tuple[Split, FloatArray]] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        if str(self.form) not in get_args(Form):
            raise UnknownNameError("form of the coupling", str(self.form), get_args(Form))
        for name in ("external", "internal"):
            if not isinstance(getattr(self, name), Impedance):
                raise InputError(name, getattr(self, name), "an Impedance", f"{name}=Impedance(stiffness, damping)")

    def _card(self) -> Card:
        rows = [("external", self.external._text()), ("internal", self.internal._text()), ("form", self.form)]
        return Card("Coupling, eq. (4)", rows, ".stiffness(split), .damping(split), .force(split, e, de)")

    @property
    def equal(self) -> bool:
        """Whether external and internal gains are the same: the conventional method, which needs no split."""
        pairs: tuple[Pair, ...] = get_args(Pair)
        return all(_equal(*self._pair(pair)) for pair in pairs)

    def turned(self, R: ArrayLike) -> Coupling:
        """Write matrices that stand in other axes in those of the contact forces: R K R'; numbers have no axes.

        Args:
            R: (d, d), or (n, d, d) with one for each contact: from the axes in which the gains stand.
        """
        turn = np.asarray(R, dtype=float)
        external, internal = (
            Impedance(_turned(part.stiffness, turn), _turned(part.damping, turn))
            for part in (self.external, self.internal)
        )
        return Coupling(external, internal, self.form)

    def stiffness(self, split: Split) -> FloatArray:
        """Compute K of f = K e + D e', (m, m) [N/m], read-only; cached until another split is asked for."""
        return self._matrix("stiffness", split)

    def damping(self, split: Split) -> FloatArray:
        """Compute D of f = K e + D e', (m, m) [N s/m], read-only; cached until another split is asked for."""
        return self._matrix("damping", split)

    def force(self, split: Split, e: ArrayLike, de: ArrayLike | None = None) -> FloatArray:
        """Compute contact forces on the object (m,) [N], by one projection of one vector where the gains are numbers.

        Args:
            split: of the contacts.
            e: displacement of the fingers from their contacts, p - c, (m,) [m].
            de: its rate [m/s]; zero if None.
        """
        _require_split(split)
        x = _motion("e", e, split)
        dx = None if de is None else _motion("de", de, split)
        part = self._part("stiffness", split, x)
        if dx is None:
            return part[0] if part[1] is None else part[0] + split.project(part[1])
        rate = self._part("damping", split, dx)
        f = part[0] + rate[0]
        if part[1] is not None and rate[1] is not None:
            return f + split.project(part[1] + rate[1])
        difference = part[1] if rate[1] is None else rate[1]
        return f if difference is None else f + split.project(difference)

    def rule(self, pair: Pair) -> Literal["equal", "literal", "symmetric"]:
        """Say how a pair of gains makes a matrix: one alone where both are equal, else by the form."""
        outer, inner = self._pair(pair)
        if _equal(outer, inner):
            return "equal"
        return "literal" if isinstance(outer, float) and isinstance(inner, float) else self.form

    def _pair(self, pair: Pair) -> tuple[Gain, Gain]:
        return getattr(self.external, pair), getattr(self.internal, pair)

    def _part(self, pair: Pair, split: Split, x: FloatArray) -> tuple[FloatArray, FloatArray | None]:
        """Compute b and a of the force b + P a of one pair of gains; a is None where P is not needed."""
        outer, inner = self._pair(pair)
        if isinstance(outer, float) and isinstance(inner, float):
            y = split.weigh(x)
            return inner * y, None if outer == inner else (outer - inner) * y
        return self._matrix(pair, split) @ x, None

    def _matrix(self, pair: Pair, split: Split) -> FloatArray:
        _require_split(split)
        cached = self._matrices.get(pair)
        if cached is not None and cached[0] is split:
            return cached[1]
        outer, inner = self._pair(pair)
        rule = self.rule(pair)
        if rule == "equal":
            K = spread(outer, split)
        elif isinstance(outer, float) and isinstance(inner, float):
            K = spread(inner, split) + (outer - inner) * split.modal_metric()
        else:
            A, B, E = spread(outer, split), spread(inner, split), split.external
            if rule == "symmetric":
                K = E @ A @ E.T + split.internal @ B @ split.internal.T
                K = (K + K.T) / 2
            else:
                K = B + E @ (A - B)
                self.warn_if_active(pair, K)
        K.setflags(write=False)
        self._matrices[pair] = (split, K)
        return K

    def warn_if_active(self, pair: Pair, K: FloatArray) -> None:
        """Warn of a stiffness or damping that can create energy, once and whenever that has grown tenfold."""
        limit = GROWN * self._warned.get(pair, 0.0)
        if limit > 0.0 and float(np.linalg.norm(K - K.T)) <= 2.0 * limit:  # no less than the spectral norm, and cheap
            return
        size = float(np.abs(K).max())
        skew, lowest = skew_part(K), float(np.linalg.eigvalsh((K + K.T) / 2)[0])
        worst = max(skew if pair == "stiffness" else 0.0, -lowest)
        if worst <= limit:
            return
        faults = []
        # a skew damping does no work; a skew stiffness does, 2 pi r^2 k_s on a circle in its plane
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
            warnings.warn(
                f"the {pair} of eq. (4) can create energy: {' and '.join(faults)}; form='symmetric' cannot",
                ActiveCouplingWarning,
                stacklevel=4,
            )


def spread(gain: Gain, split: Split) -> FloatArray:
    """Write a gain as a matrix (m, m) on the split's components, with its metric: k M, L K L', or the full matrix.

    Raises:
        InputError: a gain that does not fit the contacts.
    """
    m, grasp, M = split.components, split.grasp, split.metric
    if isinstance(gain, float):
        return gain * (np.diag(M) if M.ndim == 1 else M)
    n = 0 if grasp is None else grasp.fingers
    if grasp is not None and gain.shape == (n,):
        K = np.diag(gain[grasp.finger_of_column])
    elif (
        grasp is not None
        and gain.ndim >= 2
        and _fits_each_finger(gain, grasp.finger_of_column, n, grasp.torsion_columns)
    ):
        d = gain.shape[-1]
        K = np.zeros((m, m))
        K.reshape(n, d, n, d)[np.arange(n), :, np.arange(n), :] = gain
    elif gain.shape == (m, m):
        return gain.copy()
    else:
        expected = f"a number or a matrix ({m}, {m})"
        if grasp is None:
            raise InputError(
                "gain", gain, expected, "a split of a bare matrix does not know its fingers; split a Grasp"
            )
        raise InputError(
            "gain",
            gain,
            f"{expected}, {n} numbers, or (d, d) or ({n}, d, d) where each contact has d forces and no moment",
        )
    return split.stretch(split.stretch(K).T).T  # L K L; without a metric K to the bit


def per_finger(gain: Gain, fingers: int, dimensions: int) -> FloatArray:
    """Write a gain of point contacts as (n, d, d), a matrix for each finger, or as the full matrix (m, m) that it is.

    Raises:
        InputError: a gain that does not fit the contacts.
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
    """Compute |(K - K')/2|, the largest singular value [N/m]."""
    return float(np.linalg.norm((K - K.T) / 2, 2))


def loop_energy(K: FloatArray, radius: float) -> float:
    """Compute 2 pi r^2 |(K - K')/2|, the most that f = K e can do on a circle of displacements e of radius r [J]."""
    return 2.0 * math.pi * radius**2 * skew_part(K)


def _fits_each_finger(gain: FloatArray, finger: NDArray[np.int64], n: int, torsion: NDArray[np.bool_]) -> bool:
    d = gain.shape[-1]
    return (
        gain.shape in ((d, d), (n, d, d)) and not torsion.any() and bool((np.bincount(finger, minlength=n) == d).all())
    )


def _turned(gain: Gain, R: FloatArray) -> Gain:
    """Rotate each finger's matrix, R K R'; a full one as far as it has one R for all."""
    K, d = np.asarray(gain), R.shape[-1]
    if K.ndim < 2:
        return gain
    if K.ndim == 2 and K.shape != (d, d):
        n = K.shape[0] // d
        whole = np.zeros(K.shape)
        whole.reshape(n, d, n, d)[np.arange(n), :, np.arange(n), :] = R
        return _even(whole @ K @ whole.T)
    return _even(R @ K @ np.swapaxes(R, -1, -2))


def _even(K: FloatArray) -> FloatArray:
    """Remove the skew part that rounding leaves in a rotated matrix."""
    return np.asarray(0.5 * (K + np.swapaxes(K, -1, -2)))


def _gain(name: str, argument: ArrayLike) -> Gain:
    value = finite(name, argument)
    if value.ndim == 0:
        if value < 0.0:
            raise InputError(name, float(value), "a number that is not negative")
        return float(value)
    if value.ndim == 1:
        if not len(value) or (value < 0.0).any():
            raise InputError(name, value.tolist(), "numbers that are not negative, one per finger")
    elif value.ndim > 3 or value.shape[-1] != value.shape[-2] or not value.size:
        raise InputError(name, value, "a number, or an array (n,), (d, d), (n, d, d) or (m, m)")
    else:
        size = np.abs(value).max()
        if np.abs(value - np.swapaxes(value, -1, -2)).max() > SYMMETRIC * size:
            raise InputError(name, value.tolist(), "a symmetric matrix")
        lowest = np.linalg.eigvalsh(value).min()
        if lowest < -SYMMETRIC * size:
            raise InputError(
                name, value.tolist(), "a positive semidefinite matrix", f"its smallest eigenvalue is {lowest:.3g}"
            )
    value.setflags(write=False)
    return value


def _gain_text(gain: Gain, unit: str) -> str:
    """Write a gain: the number, the range of those per finger, or the size of a matrix and its eigenvalues."""
    if isinstance(gain, float):
        return f"{gain:g} {unit}"
    if gain.ndim == 1:
        return f"{span(gain, unit)} for {len(gain)} fingers"
    return f"{' x '.join(map(str, gain.shape))} matrix of {span(np.linalg.eigvalsh(gain).ravel(), unit)}"


def _equal(outer: Gain, inner: Gain) -> bool:
    """Tell whether two gains are equal, also when one is written for every finger and the other for each."""
    a, b = np.asarray(outer), np.asarray(inner)
    if a.ndim == b.ndim:
        return np.array_equal(a, b)
    if {a.ndim, b.ndim} not in ({0, 1}, {2, 3}) or (a.ndim and b.ndim and a.shape[-2:] != b.shape[-2:]):
        return False
    return bool((a == b).all())


def _require_split(value: object) -> None:
    if not isinstance(value, Split):
        raise InputError("split", value, "a Split", "gx.Split(G), or the split of a gx.Grasp")


def _motion(name: str, value: ArrayLike, split: Split) -> FloatArray:
    x = finite(name, value)
    if x.shape != (split.components,):
        raise InputError(name, x, f"an array ({split.components},), one entry per contact component")
    return x
