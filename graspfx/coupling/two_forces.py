"""External part P f of a grasp's forces, and P'e of a grasp's displacements; the remainder is internal."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspfx.coupling.grasp_state import FingerState, GraspState
from graspfx.grasp.rigid_modes import NO_ARM
from graspfx.objects.body_state import BodyState
from graspfx.spatial import SWEEPS

FloatArray = NDArray[np.float64]

FEWEST = 4  # from this number of samples on, numpy adds entry by entry
SLIGHT = 1e-40  # weight of a faded finger: negligible in sums over fingers, but the finger's motion stays defined
ROUNDING = 1e-31  # relative bound on the squared dot product of orthogonal rows
LEAST_ARM = 1e-6  # fraction of the largest arm below which rotations are separated by Jacobi's method


@dataclass(frozen=True)
class SplitRule:
    """Data that determine the projector P of a grasp, except contact points and gaps.

    Attributes:
        dimensions: Number of dimensions d.
        translations, rotations: Whether the object can move along, and rotate about, each world axis; three entries
            each.
        blend: Rms arms between which a rotation enters the external space [m]. If None, every rotation has full weight.
        fade: Gaps between which a free finger fades out of the grasp [m]; None for no fade.
        shares: Weight of each finger in the metric.
        patches: Patch length of each finger [m]; zero for hard fingers.
        reaction: Point at which the object receives a force, "fingertip" or "contact".
    """

    dimensions: int
    translations: tuple[bool, ...]
    rotations: tuple[bool, ...]
    blend: tuple[float, float] | None
    fade: tuple[float, float] | None
    shares: tuple[float, ...]
    patches: tuple[float, ...]
    reaction: str

    @classmethod
    def of(cls, grasp: GraspState) -> SplitRule:
        """Read the rule from a grasp's block."""
        body, arms = grasp.body, (grasp.arm_low, grasp.arm_high)
        return cls(
            dimensions=grasp.dimensions,
            translations=tuple((body.array(BodyState.free_translation) != 0.0).tolist()),
            rotations=tuple((body.array(BodyState.free_rotation) != 0.0).tolist()),
            blend=None if arms == (NO_ARM, NO_ARM) else arms,
            fade=(grasp.fade_start, grasp.fade_end) if grasp.fade else None,
            shares=tuple(grasp.fingers.array(FingerState.share).tolist()),
            patches=tuple(grasp.fingers.array(FingerState.patch).tolist()),
            reaction="contact" if grasp.at_contact else "fingertip",
        )

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> SplitRule:
        """Create a rule from a table as returned by `table`."""
        fields: dict[str, Any] = {k: tuple(value) if isinstance(value, list) else value for k, value in table.items()}
        return cls(**fields)

    def table(self) -> dict[str, Any]:
        """Return the rule as a table with lists instead of tuples, for JSON."""
        return {key: list(value) if isinstance(value, tuple) else value for key, value in asdict(self).items()}

    @property
    def soft(self) -> bool:
        """Whether some finger exerts torsion."""
        return any(self.patches)

    @property
    def is_local(self) -> bool:
        """Whether P depends on the object's centre: the object can rotate, and some translation is locked."""
        return any(self.rotations) and not all(self.translations[: self.dimensions])


class Samples(NamedTuple):
    """Contacts of one grasp over r samples.

    Attributes:
        contact: Contact points c in world axes, (n, d, r) [m]; relative to the object's centre if `rule.is_local`.
        gap: Gaps (n, r) [m]; None without a fade.
        normal: Normals into the object in world axes, (n, 3, r); None without soft fingers.
    """

    contact: FloatArray
    gap: FloatArray | None = None
    normal: FloatArray | None = None


def divide(
    rule: SplitRule, samples: Samples, whole: FloatArray, torsion: FloatArray | None = None, *, dual: bool = False
) -> FloatArray:
    """Compute the external part P f of forces f, or P'e of displacements e, in r samples.

    The result of a sample does not depend on the other samples.

    With the orthonormal modes q_k and the blends beta_k of `rigid_modes`, weights w, and z_k = sum_i q_k(i) . f_i /
    sqrt(w_i),

        P f = sqrt(w_i) sum_k beta_k q_k(i) z_k,    P' e = sum_k beta_k q_k(i) / sqrt(w_i) sum_j sqrt(w_j) q_k(j) . e_j.

    Args:
        rule: Data that determine P.
        samples: Contacts of the grasp.
        whole: Forces f [N] or displacements e [m] in world axes, (n, d, r).
        torsion: Torsion of soft fingers, (n, r): tau / rho [N], or rho theta [m] if `dual`. None counts as zero.
        dual: Whether `whole` contains displacements.

    Returns:
        The external part, (n, d, r). With soft fingers, its shape is (n, 4, r), and the last component is the torsion.
    """
    n, d, r = whole.shape
    if 0 < r < FEWEST:

        def more(values: FloatArray | None) -> Any:
            return None if values is None else values[..., np.arange(FEWEST) % r]

        many = Samples(*map(more, samples))
        return divide(rule, many, more(whole), more(torsion), dual=dual)[..., :r]
    share = np.array(rule.shares)[:, None]
    weight = np.broadcast_to(share, (n, 1))
    if rule.fade is not None and samples.gap is not None:
        weight = share * (1.0 - _smoothstep(samples.gap, *rule.fade))
    alive = (np.abs(whole).sum(axis=(0, 1)) + (0.0 if torsion is None else np.abs(torsion).sum(axis=0)) != 0.0) & (
        weight.sum(axis=0) != 0.0
    )
    counts, weight = weight > 0.0, np.maximum(weight, SLIGHT)
    total, root = weight.sum(axis=0), np.sqrt(weight)[:, None]
    external = np.zeros((n, d + rule.soft, r))
    for a in range(d):
        if rule.translations[a]:
            mean = (weight * whole[:, a]).sum(axis=0) / total if dual else whole[:, a].sum(axis=0) / total
            external[:, a] = mean if dual else weight * mean
    if any(rule.rotations):
        modes, square, blend = _rotations(rule, samples, weight, root, total)
        if rule.soft:
            whole = np.concatenate([whole, np.zeros((n, 1, r)) if torsion is None else torsion[:, None]], axis=1)
        scaled = (whole * root if dual else whole / root).reshape(-1, r)
        for mode, length, beta in zip(modes, square, blend, strict=True):
            z = (mode * scaled).sum(axis=0)
            z = beta * np.divide(z, length, out=np.zeros(r), where=(beta > 0.0) & (length > 0.0))
            motion = mode.reshape(external.shape)
            external += motion / root * z if dual else motion * root * z
    if not dual and not counts.all():
        external *= counts[:, None]
    return np.where(alive, external, 0.0)


def _smoothstep(x: FloatArray, low: float, high: float) -> FloatArray:
    """Compute the smoothstep: 0 up to `low`, 1 from `high` on, and 3 t^2 - 2 t^3 between, with t from 0 to 1."""
    t = np.clip((x - low) / (high - low), 0.0, 1.0) if high > low else np.greater(x, low).astype(float)
    return np.asarray(t * t * (3.0 - 2.0 * t))


def _rotations(
    rule: SplitRule, samples: Samples, weight: FloatArray, root: FloatArray, total: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Compute orthogonal motions of the contacts for the free rotations, as in `rigid_modes`.

    Returns:
        Motions times sqrt(w), (k, n c, r), for k rotations and n contacts with c entries; squared norms of these rows,
        (k, r); and blends, (k, r).
    """
    contact, d = samples.contact, rule.dimensions
    n, _, r = contact.shape
    heaviest = weight.argmax(axis=0)  # reference contact: differences from it are exact far from the origin
    origin = contact[heaviest[0]] if len(heaviest) == 1 else contact[heaviest, :, np.arange(r)].T
    arm = contact - origin
    mean = (weight[:, None] * arm).sum(axis=0) / total
    arm -= mean
    centre = np.zeros((3, r))
    if not all(rule.translations[:d]):
        centre[:d] = origin + mean
    free = [k for k in range(3) if rule.rotations[k]]
    motions = np.zeros((len(free), n, d + rule.soft, r))
    for mode, k in zip(motions, free, strict=True):
        a, b = (k + 1) % 3, (k + 2) % 3  # a rotation about axis k turns axis a towards axis b
        for to, of, sign in ((a, b, -1.0), (b, a, 1.0)):
            if to < d:
                shift = arm[:, of] if of < d else 0.0
                mode[:, to] = sign * (shift if rule.translations[to] else shift + centre[of])
        if rule.soft and samples.normal is not None:
            mode[:, d] = np.array(rule.patches)[:, None] * samples.normal[:, k]
    modes = (motions * root).reshape(len(free), -1, r)
    low, high = rule.blend or (NO_ARM, NO_ARM)
    if len(free) > 1:
        modes = _orthogonal(modes, high * np.sqrt(total))
    square = (modes * modes).sum(axis=1)
    return modes, square, _smoothstep(np.sqrt(square / total), low, high)


def _orthogonal(modes: FloatArray, enough: FloatArray) -> FloatArray:
    """Orthogonalise rows (k, m, r) by rotations, or by Gram-Schmidt if all arms are above `enough`.

    If all arms are above `enough`, every blend is 1, and P depends only on the span of the rows. Otherwise the rows
    must be singular vectors. The smallest singular value is at least the volume divided by the largest product of the
    other singular values.
    """
    plain = modes.copy()
    square = np.empty((len(plain), plain.shape[2]))
    for k, row in enumerate(plain):
        for j in [*range(k)] * 2:  # two passes make the rows orthogonal to rounding
            along = (plain[j] * row).sum(axis=0)
            row -= np.divide(along, square[j], out=np.zeros_like(along), where=square[j] > 0.0) * plain[j]
        square[k] = (row * row).sum(axis=0)
    trace = (modes * modes).sum(axis=(0, 1))
    volume = np.sqrt(square.prod(axis=0))
    least = volume / np.maximum(np.sqrt(trace) if len(plain) == 2 else 0.5 * trace, SLIGHT)
    rest = np.flatnonzero(~((least >= enough) & (least >= LEAST_ARM * np.sqrt(trace))))
    if len(rest):
        few = np.resize(rest, max(len(rest), FEWEST))
        plain[:, :, rest] = _jacobi(modes[:, :, few])[:, :, : len(rest)]
    return plain


def _jacobi(rows: FloatArray) -> FloatArray:
    """Orthogonalise k rows of m entries for each of r samples, (k, m, r), in place, by one-sided Jacobi rotations.

    The rotations remain accurate for rows of small norm.
    """
    for _ in range(SWEEPS):
        is_turned = False
        for p in range(len(rows) - 1):
            for q in range(p + 1, len(rows)):
                u, v = rows[p], rows[q]
                uu, vv, uv = (u * u).sum(axis=0), (v * v).sum(axis=0), (u * v).sum(axis=0)
                turns = ~(uv * uv <= ROUNDING * uu * vv + SLIGHT * SLIGHT)
                if not turns.any():
                    continue
                is_turned = True
                zeta = np.divide(vv - uu, 2.0 * uv, out=np.zeros_like(uv), where=turns)
                t = np.where(turns, np.copysign(1.0 / (np.abs(zeta) + np.sqrt(1.0 + zeta * zeta)), zeta), 0.0)
                c = 1.0 / np.sqrt(1.0 + t * t)
                rows[p], rows[q] = c * u - c * t * v, c * t * u + c * v
        if not is_turned:
            break
    return rows


def torsion_over_patch(rule: SplitRule, moment: FloatArray, axis: FloatArray) -> FloatArray:
    """Compute torsions tau / rho, (..., n) [N], from moments tau a, (..., n, 3), with axes a; zero for hard fingers."""
    square = (axis * axis).sum(axis=-1) * np.array(rule.patches)
    along = (moment * axis).sum(axis=-1)
    return np.asarray(np.divide(along, square, out=np.zeros_like(along), where=square > 0.0))


def moment_of(rule: SplitRule, torsion: FloatArray, axis: FloatArray) -> FloatArray:
    """Compute moments tau a, (..., n, 3) [N m], from torsions tau / rho, (..., n) [N], with axes a."""
    return np.asarray((np.array(rule.patches) * torsion)[..., None] * axis)
