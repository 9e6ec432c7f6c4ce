"""Stability limits of the modes of a grasp: internal, external, on a support, and with fingers that push alone."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from graspfx.analysis.grasp_stiffness import alike_sets, in_series, springs_in_series, symmetries, without_freedoms
from graspfx.analysis.linearisation import Linearisation
from graspfx.analysis.stability.modes import Mode, modes
from graspfx.certificate.certificate import PUSHING, STANDING, Limit, is_stable
from graspfx.certificate.first_loss import Family, Line, Reach, Stiffness, WholeLoop, least_reaches, reach, reaches
from graspfx.certificate.linearise import Linearised
from graspfx.errors import InputError
from graspfx.grasp.object_impedance import ObjectImpedance, modal_gain
from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]

ALL_SETS = 5  # with more fingers, only single fingers are examined, not every set of pushing fingers
TIE = 1e-9  # margins with a smaller relative difference are equal; of these, the limit with nearby fingers is listed
ROOM = 0.5  # relative to the limit of all gains together: the other gains if the loop is unstable at present


def spectral_radius(linear: Linearisation) -> float:
    """Compute the spectral radius of a loop."""
    return Family(WholeLoop(linear, [linear.stiffness]), lambda s: linear.stiffness).radius(1.0)


def mode_limits(scene: Scene, loop: Linearised, *, halves: bool = True, compare: bool = True) -> list[Limit]:
    """Compute the stability limits of the internal and the external gain.

    Args:
        scene: Scene.
        loop: One or all grasped objects of the scene, linearised.
        halves: Whether to compute also limits of the external gain in translations only and in rotations only.
        compare: Whether a limit in closed form is compared with that of a search in the whole loop.
    """
    kep, kip = (number_of(part.stiffness) for part in (scene.coupling.external, scene.coupling.internal))
    names = {name: scaled for name, scaled in _parts(loop) if halves or " " not in name}
    gains = {name: kip if name == "internal" else kep for name in names}
    exact = {name: mode for name, mode in reduced(loop).items() if name in gains and not math.isnan(gains[name])}
    searches = {
        name: scaled
        for name, scaled in names.items()
        if name not in exact or (compare and 0.0 < exact[name][0] < math.inf and gains[name] > 0.0)
    }
    edges: dict[str, Reach] = {}
    if searches:
        whole = WholeLoop(loop.linear, loop.gains)
        others = _others(loop, whole)
        families = [Family(whole, _scaled(loop, scaled, others)) for scaled in searches.values()]
        edges = dict(zip(searches, reaches(families), strict=True))
    rows = []
    for name, gain in gains.items():
        edge = edges.get(name)
        if name in exact:
            limit, frequency = exact[name]
            difference = math.nan if edge is None else abs(gain * edge.factor / limit - 1.0)
            rows.append(Limit(name, gain, limit, _over(limit, gain), frequency, True, difference))
        elif edge is not None:
            rows.append(Limit(name, gain, gain * edge.factor, edge.factor, edge.frequency, False))
    return rows


def reduced(loop: Linearised) -> dict[str, tuple[float, float]]:
    """Return limits in closed form: for each name of a mode, the smallest limit [N/m] and its frequency [Hz].

    The result is empty if the modes of the loop are not separate, or if fingertips are compliant.
    """
    if loop.pads is not None:
        return {}  # with compliances in series, the stiffness of a mode is not proportional to the gain
    try:
        parts = modes(loop.linear)
    except InputError:
        return {}
    weakest: dict[str, tuple[float, float]] = {}
    for part in parts:
        if part.limits is None:
            return {}
        name = _name(part, loop)
        entry = (part.limits.limit, part.limits.frequency)
        for each in dict.fromkeys([name, name.split()[0]]):
            weakest[each] = min(weakest.get(each, (math.inf, math.nan)), entry, key=lambda pair: pair[0])
    return weakest


def _parts(loop: Linearised) -> Iterator[tuple[str, tuple[bool, bool, bool]]]:
    """Yield the name of each mode, and which stiffnesses its gain scales: translations, rotations, internal."""
    m, _ = loop.linear.coordinates
    rank = sum(split.rank for split in loop.splits)
    d = loop.contacts.shape[1]
    if rank < m:
        yield "internal", (False, False, True)
    if not rank:
        return
    yield "external", (True, True, False)
    least = 1e-9 * np.abs(loop.linear.stiffness).max()
    halves = (("translation", (True, False, False)), ("rotation", (False, True, False)))
    there = [
        (f"external {name}", scaled)
        for name, scaled in halves
        if np.abs(loop.stiffness(float(scaled[0]), float(scaled[1]), 0.0)).max() > least
    ]
    if len(there) == 2 and d > 1:
        yield from there


def _name(mode: Mode, loop: Linearised) -> str:
    if mode.kind == "internal":
        return "internal"
    if loop.contacts.shape[1] == 1:
        return "external"
    n, d = loop.contacts.shape
    motion = mode.motions[:, 0].reshape(n, d)
    together = n * float((motion.mean(axis=0) ** 2).sum()) / float((motion**2).sum())
    return "external translation" if together > 0.5 else "external rotation"


def _others(loop: Linearised, whole: WholeLoop) -> float:
    """Return the factor of the gains that are not varied: 1 if the loop is stable with the scene's gains.

    If the loop is unstable, the factor is half the limit of all gains together, but at most 1.
    """
    common = _scaled(loop, (True, True, True), 1.0)
    if is_stable(Family(whole, common).radius(1.0)):
        return 1.0
    return min(1.0, ROOM * reach(whole, common).factor)


def _scaled(loop: Linearised, scaled: tuple[bool, bool, bool], others: float) -> Stiffness:
    """Return the stiffness as a function of s, which multiplies the gains in the mask `scaled`.

    The other gains are multiplied by the constant `others`.
    """
    if loop.gains is None:
        return lambda s: loop.stiffness(*(s if is_scaled else others for is_scaled in scaled))
    zero = np.zeros_like(loop.linear.stiffness)
    still = sum((others * K for K, is_scaled in zip(loop.gains, scaled, strict=True) if not is_scaled), zero)
    return Line(still, sum((K for K, is_scaled in zip(loop.gains, scaled, strict=True) if is_scaled), zero))


def _all_scaled(linear: Linearisation) -> Family:
    """Return a loop as a function of a factor of its stiffness matrix."""
    K = linear.stiffness
    return Family(WholeLoop(linear, [K]), Line(np.zeros_like(K), K))


def standing_limits(loop: Linearised) -> Iterator[Limit]:
    """Yield the common limit of all gains with the object on its support at the start, if it is on a support."""
    ground = loop.standing[0]
    if ground is None or len(loop.standing) > 1:
        return
    linear = loop.linear.with_arrays(ground=(ground.stiffness, ground.damping))
    [edge], gain = reaches([_all_scaled(linear)]), _stiffest(linear)
    mode = f"{STANDING} {' and '.join(ground.names)}"
    yield Limit(mode, gain, gain * edge.factor, edge.factor, edge.frequency, False)


def pushing_limits(scene: Scene, loop: Linearised) -> list[Limit]:
    """Compute the common limit of all gains for every set of fingers that push while the others exert no force.

    With more than five fingers, only single fingers are examined. The result is empty if contacts are attached, or if
    the object has only one finger.
    """
    n = len(loop.fingers)
    if scene.coupling.contact == "attached" or n == 1:
        return []
    sizes: Sequence[int] = range(1, n) if n <= ALL_SETS else [1]
    sets = [places for size in sizes for places in combinations(range(n), size)]
    free = np.array(scene.free(next(thing for thing in scene.object if thing.name == loop.objects[0])), dtype=bool)
    alike = alike_sets(sets, symmetries(loop.linear, loop.contacts, free))
    loops = {k: list(_pushes(scene, loop, tuple(loop.fingers[i] for i in sets[k]))) for k in dict.fromkeys(alike)}
    answers = least_reaches([[_all_scaled(linear) for linear in each] for each in loops.values()])
    edges = {
        k: [(_stiffest(linear), edge) for linear, edge in zip(each, answer, strict=True)]
        for (k, each), answer in zip(loops.items(), answers, strict=True)
    }
    rows = []
    for places, k in zip(sets, alike, strict=True):
        pushers = [loop.fingers[i] for i in places]
        least = min(edge.factor for _, edge in edges[k])
        gain, edge = next(pair for pair in edges[k] if pair[1].factor <= least * (1.0 + TIE))
        who = ", ".join(scene.finger_names[i] for i in pushers)
        rows.append(Limit(f"{PUSHING}{who}", gain, gain * edge.factor, edge.factor, edge.frequency, False))
    return rows


def _pushes(scene: Scene, loop: Linearised, pushers: tuple[int, ...]) -> Iterator[Linearisation]:
    """Yield the loops in which only the fingers `pushers` exert forces.

    In the first loop, the other fingers are still part of the split, because they are near the object. If absent
    fingers fade out of the split, a second loop omits them from the split.
    """
    near = without_freedoms(loop.linear, np.isin(loop.finger_of_column, pushers))
    yield near
    if scene.coupling.absent == "fade":
        alone = gone_without(scene, loop, near, pushers)
        if alone is not None:
            yield alone


def gone_without(scene: Scene, loop: Linearised, near: Linearisation, pushers: tuple[int, ...]) -> Linearisation | None:
    """Return the loop whose split contains only the fingers that push.

    The result is None if gains are not numbers, the split is weighted, or no finger has friction.

    Args:
        scene: Scene.
        loop: Linearised loop with all fingers.
        near: Loop in which only the fingers that push exert forces.
        pushers: Indices of the fingers that push.
    """
    coupling = scene.coupling
    kep, kip = number_of(coupling.external.stiffness), number_of(coupling.internal.stiffness)
    outer = loop.laws[0].external
    of_object = isinstance(outer, ObjectImpedance)
    if math.isnan(kip if of_object else kep + kip) or coupling.split != "pseudoinverse":
        return None
    if loop.contacts.shape[1] > 1 and coupling.friction != "stick" and not any(scene.coefficients):
        return None
    U = np.linalg.svd(near.G, full_matrices=False)
    basis = U[2][U[1] > 1e-6 * U[1].max(initial=0.0)]
    P = basis.T @ basis
    inner = np.eye(len(P)) - P
    ked, kid = number_of(coupling.external.damping), number_of(coupling.internal.damping)
    pushing = np.isin(loop.finger_of_column, pushers)
    shares = [kep * P, ked * P]
    if isinstance(outer, ObjectImpedance):
        table = next(thing for thing in scene.object if thing.name == loop.objects[0])
        free = np.array(scene.free(table), dtype=bool)
        about = outer.about(np.zeros(loop.contacts.shape[1]))
        gains = (gain[np.ix_(free, free)] for gain in (about.stiffness, about.damping))
        moments = np.arange(len(free))[free] >= loop.contacts.shape[1]
        shares = [basis.T @ modal_gain(gain, near.G @ basis.T, moments) @ basis for gain in gains]
    K, D = shares[0] + kip * inner, shares[1] + kid * inner
    damping = in_series(D, loop.compliance[pushing]) if np.isfinite(D).all() else near.damping
    if loop.pads is not None:
        K = springs_in_series(K, loop.pads[0][pushing], loop.pads[1])
    return near.with_arrays(stiffness=K, damping=damping)


def _stiffest(linear: Linearisation) -> float:
    return float(np.linalg.eigvalsh((linear.stiffness + linear.stiffness.T) / 2)[-1])


def number_of(gain: object) -> float:
    return float(gain) if isinstance(gain, int | float) else math.nan


def _over(limit: float, gain: float) -> float:
    return limit / gain if gain > 0.0 else math.inf
