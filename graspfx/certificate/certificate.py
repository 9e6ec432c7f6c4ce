"""What a scene's gains are, how far each can go before stability is lost, and what is passive for any operator."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.analysis.linearisation import Linearisation
from graspfx.analysis.passivity.grasp_leak import CouplingLimits, coupling_limits
from graspfx.analysis.pushing import without_freedoms
from graspfx.analysis.series import in_series
from graspfx.analysis.stability.modal import Mode, modes
from graspfx.certificate.limit_rows import limit_lines
from graspfx.certificate.linearise import Linearised, linearise
from graspfx.certificate.plain_data import plain
from graspfx.certificate.rest.cone_edge import said_of_grip, sliding_notes
from graspfx.certificate.whole_loop import Family, Reach, reach
from graspfx.errors import InputError
from graspfx.loop.recording.record import Recording
from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]

ALL_SETS = 5  # fingers up to which every set of them may push; of more, single ones
PLACES = {
    "squeezed": "squeezed",
    "recorded": "at the rest that the recording ends with",
    "provisional": "provisional, squeezed by one step from the start",
    "start": "at the start, not squeezed",
}
STANDING = "standing on"
ROOM = 0.5  # of the common limit: where the other gains are put when as they are they leave nothing stable


@dataclass(frozen=True)
class Limit:
    """One mode of a grasp.

    Attributes:
        mode: "internal", "external" (k_ep as it stands in the scene), "external translation" and "external rotation"
            (as if shifts and turns each had a k_ep of their own), "standing on ..." or "pushing with ...".
        gain: as the scene has it: kip, kep, and of standing and pushing the stiffest that is left [N/m]; nan for
            matrices.
        limit: of that gain [N/m]; inf where none is too large.
        margin: limit over gain.
        frequency: at which stability is lost [Hz]; nan without a limit.
        exact: from a mode in closed form, which the whole loop confirms to `difference`; else from the whole loop.
        difference: of the two, relative; nan where there is only one.
    """

    mode: str
    gain: float
    limit: float
    margin: float
    frequency: float
    exact: bool
    difference: float = math.nan


@dataclass(frozen=True, eq=False)
class Certificate:
    """Of one object of a scene.

    Attributes:
        object: its name.
        at: "squeezed", "recorded", "provisional" or "start".
        spectral_radius: of the loop as it is; below 1 it is stable.
        limits: of every mode.
        assumed: what that takes for granted.
        passive: largest gains that are passive to any operator, or None.
        why_not_passive: in a few words, where there is None.
        grip: f_t/(mu f_n) at rest by the finger's name, 1 on the cone's edge; of fingers with a coefficient.
        edge: the fingers on their cones' edges, which count as sticking.
        notes: what sliding of those could do.
        fade: where free fingers begin to leave the split, and where the forces at rest ask it to [m]; None for neither.
    """

    object: str
    at: str
    spectral_radius: float
    limits: tuple[Limit, ...]
    assumed: tuple[str, ...]
    passive: CouplingLimits | None
    why_not_passive: str = ""
    grip: Mapping[str, float] = field(default_factory=dict)
    edge: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    fade: tuple[float, float] | None = None

    @property
    def stable(self) -> bool:
        """Whether the loop is stable as it is, and also with the object on what carries it at the start."""
        return self.spectral_radius < 1.0 and all(
            row.margin > 1.0 for row in self.limits if row.mode.startswith(STANDING)
        )

    def to_dict(self) -> dict[str, Any]:
        """Write the certificate for JSON, with units in the names of keys; what is infinite, or no number, is None."""
        fields: dict[str, Any] = plain(self)
        return fields | {"stable": self.stable}


def certificates(scene: Scene, at: str = "squeezed", recording: Recording | None = None) -> list[Certificate]:
    """One for every object that fingers touch.

    Gains are those of the scene; a limit is that of one gain with the others as they are (half the common limit where
    as they are nothing is stable), the squeeze held.

    Raises:
        InputError: a device that does not tell its mass or friction.
    """
    touched = sorted(set(scene.finger_objects))
    return [_certificate(scene, linearise(scene, at, scene.object[i].name, recording)) for i in touched]


def _certificate(scene: Scene, found: Linearised) -> Certificate:
    linear = found.linear
    whole = Family(linear, lambda s: linear.stiffness)
    passive, why = _passive(scene, found)
    return Certificate(
        object=found.objects[0],
        at=found.at[0],
        spectral_radius=whole.radius(1.0),
        limits=(*mode_limits(scene, found), *_standing(found), *_pushing(scene, found)),
        assumed=found.assumed,
        passive=passive,
        why_not_passive=why,
        grip={
            scene.finger_names[i]: float(margin)
            for i, margin in zip(found.fingers, found.margins, strict=True)
            if not math.isnan(margin)
        },
        edge=tuple(scene.finger_names[i] for i in found.edge),
        notes=tuple(_sliding(scene, found)),
        fade=found.fade[0],
    )


def _sliding(scene: Scene, found: Linearised) -> Iterator[str]:
    """What contacts on their cones' edges could do if they slid; soft ones, which slide and spin at once, are named."""
    soft = [k for k, i in enumerate(found.edge) if scene.finger[i].patch]
    hard = [k for k in range(len(found.edge)) if k not in soft]
    T, V = found.slip
    yield from sliding_notes(found.linear, T[:, hard], V[:, hard], [scene.finger_names[found.edge[k]] for k in hard])
    if soft:
        yield f"what sliding of {', '.join(scene.finger_names[found.edge[k]] for k in soft)} does is not looked at"


def mode_limits(scene: Scene, found: Linearised, *, halves: bool = True, compare: bool = True) -> list[Limit]:
    """Of the internal and the external gain, and of the external one's shifts and turns by themselves."""
    kep, kip = (_number(part.stiffness) for part in (scene.coupling.external, scene.coupling.internal))
    exact = reduced(found)
    rows = []
    others: float | None = None
    for name, which in _parts(found):
        if " " in name and not halves:
            continue
        gain = kip if name == "internal" else kep
        mode = exact.get(name)
        if mode is not None and not math.isnan(gain):
            limit, frequency = mode
            difference = math.nan
            if compare and 0.0 < limit < math.inf and gain > 0.0:
                others = _others(found) if others is None else others
                difference = abs(gain * _reach(found, which, others).factor / limit - 1.0)
            rows.append(Limit(name, gain, limit, _over(limit, gain), frequency, True, difference))
        else:
            others = _others(found) if others is None else others
            edge = _reach(found, which, others)
            rows.append(Limit(name, gain, gain * edge.factor, edge.factor, edge.frequency, False))
    return rows


def reduced(found: Linearised) -> dict[str, tuple[float, float]]:
    """Limit [N/m] and frequency [Hz] of each mode that is one by itself, the weakest of its name; empty without any."""
    try:
        parts = modes(found.linear)
    except InputError:
        return {}
    weakest: dict[str, tuple[float, float]] = {}
    for part in parts:
        if part.limits is None:
            return {}
        name = _name(part, found)
        entry = (part.limits.limit, part.limits.frequency)
        for each in dict.fromkeys([name, name.split()[0]]):
            weakest[each] = min(weakest.get(each, (math.inf, math.nan)), entry, key=lambda pair: pair[0])
    return weakest


def _parts(found: Linearised) -> Iterator[tuple[str, tuple[bool, bool, bool]]]:
    """The modes that there are, and which of the gains for shifts, turns and squeezing each is."""
    m, _ = found.linear.coordinates
    rank = sum(split.rank for split in found.splits)
    d = found.contacts.shape[1]
    if rank < m:
        yield "internal", (False, False, True)
    if not rank:
        return
    yield "external", (True, True, False)
    least = 1e-9 * np.abs(found.linear.stiffness).max()
    halves = (("translation", (True, False, False)), ("rotation", (False, True, False)))
    there = [
        (f"external {name}", which)
        for name, which in halves
        if np.abs(found.stiffness(float(which[0]), float(which[1]), 0.0)).max() > least
    ]
    if len(there) == 2 and d > 1:
        yield from there


def _name(mode: Mode, found: Linearised) -> str:
    if mode.kind == "internal":
        return "internal"
    if found.contacts.shape[1] == 1:
        return "external"
    n, d = found.contacts.shape
    motion = mode.motions[:, 0].reshape(n, d)
    together = n * float((motion.mean(axis=0) ** 2).sum()) / float((motion**2).sum())
    return "external translation" if together > 0.5 else "external rotation"


def _others(found: Linearised) -> float:
    """The factor at which the other gains are held: 1 where that is stable."""
    if Family(found.linear, lambda s: found.linear.stiffness).radius(1.0) < 1.0:
        return 1.0
    return min(1.0, ROOM * reach(found.linear, lambda s: found.stiffness(s, s, s)).factor)


def _reach(found: Linearised, which: tuple[bool, bool, bool], others: float) -> Reach:
    def stiffness(s: float) -> FloatArray:
        return found.stiffness(*(s if chosen else others for chosen in which))

    return reach(found.linear, stiffness)


def _standing(found: Linearised) -> Iterator[Limit]:
    """The grasp with its object on what carries it at the start, all gains growing together."""
    ground = found.standing[0]
    if ground is None or len(found.standing) > 1:
        return
    linear = found.linear.with_changes(ground=(ground.stiffness, ground.damping))
    edge, gain = reach(linear, lambda s: s * linear.stiffness), _stiffest(linear)
    mode = f"{STANDING} {' and '.join(ground.names)}"
    yield Limit(mode, gain, gain * edge.factor, edge.factor, edge.frequency, False)


def _pushing(scene: Scene, found: Linearised) -> Iterator[Limit]:
    """Every set of fingers that may touch without the others; none where contacts cannot be left."""
    n = len(found.fingers)
    if scene.coupling.contact == "attached" or n == 1:
        return
    sizes: Sequence[int] = range(1, n) if n <= ALL_SETS else [1]
    names = scene.finger_names
    for size in sizes:
        for chosen in combinations(found.fingers, size):
            touching = np.isin(found.finger_of_column, chosen)
            pushes = _pushes(scene, found, touching, chosen)
            gain, edge = min(pushes, key=lambda pair: pair[1].factor)
            who = ", ".join(names[i] for i in chosen)
            yield Limit(f"pushing with {who}", gain, gain * edge.factor, edge.factor, edge.frequency, False)


def _pushes(
    scene: Scene, found: Linearised, touching: NDArray[np.bool_], chosen: tuple[int, ...]
) -> Iterator[tuple[float, Reach]]:
    """The stiffest that is left and how far it can grow: near fingers without force, and where they fade, gone ones."""
    near = without_freedoms(found.linear, touching)
    yield _stiffest(near), reach(near, lambda s: s * near.stiffness)
    if scene.coupling.absent == "fade":
        gone = gone_without(scene, found, near, chosen)
        if gone is not None:
            yield _stiffest(gone), reach(gone, lambda s: s * gone.stiffness)


def gone_without(scene: Scene, found: Linearised, near: Linearisation, chosen: tuple[int, ...]) -> Linearisation | None:
    """The loop of fingers that alone are in the split; None for gains per finger, or contacts that slip."""
    coupling = scene.coupling
    kep, kip = _number(coupling.external.stiffness), _number(coupling.internal.stiffness)
    if math.isnan(kep + kip) or coupling.metric != "equal":
        return None
    if found.contacts.shape[1] > 1 and coupling.friction != "stick" and not any(scene.coefficients):
        return None
    U = np.linalg.svd(near.G, full_matrices=False)
    held = U[2][U[1] > 1e-6 * U[1].max(initial=0.0)]
    P = held.T @ held
    I = np.eye(len(P))  # noqa: E741 (the identity's letter)
    ked, kid = _number(coupling.external.damping), _number(coupling.internal.damping)
    compliance = found.compliance[np.isin(found.finger_of_column, chosen)]
    damping = near.damping if math.isnan(ked + kid) else in_series(ked * P + kid * (I - P), compliance)
    return near.with_changes(stiffness=kep * P + kip * (I - P), damping=damping)


def _passive(scene: Scene, found: Linearised) -> tuple[CouplingLimits | None, str]:
    linear, coupling = found.linear, scene.coupling
    if linear.ground is not None:
        return None, "the object stands on something"
    dampings = [_number(part.damping) for part in (coupling.external, coupling.internal)]
    if any(math.isnan(value) for value in dampings):
        return None, "its damping is given by matrices"
    if found.compliance.any():
        return None, "its damping grows with depth, and is not whole here"
    if linear.delay.any():
        return None, "its devices display forces late"
    if linear.integrator != "exact":
        return None, f"it takes an object with the integrator exact, not {linear.integrator}"
    limits = coupling_limits(
        linear.G,
        float(linear.friction.min()),
        linear.period,
        np.diag(np.diag(linear.viscosity)),
        external_damping=dampings[0],
        internal_damping=dampings[1],
    )
    return limits, ""


def _stiffest(linear: Linearisation) -> float:
    return float(np.linalg.eigvalsh((linear.stiffness + linear.stiffness.T) / 2)[-1])


def _number(gain: object) -> float:
    return float(gain) if isinstance(gain, int | float) else math.nan


def _over(limit: float, gain: float) -> float:
    return limit / gain if gain > 0.0 else math.inf


def lines(certificate: Certificate) -> Iterator[str]:
    """A certificate as lines of text: one per mode, fingers that push alike in one, of larger sets the weakest."""
    of = f"of {certificate.object}, {PLACES[certificate.at]}"
    radius = certificate.spectral_radius
    yield f"stability {of}: {'stable' if certificate.stable else 'NOT STABLE'}, spectral radius {radius:.6f}"
    yield from (f"  {row}" for row in limit_lines(certificate.limits))
    if any(row.exact for row in certificate.limits):
        differences = [row.difference for row in certificate.limits if not math.isnan(row.difference)]
        checked = f"; the whole loop has the same limits to {max(differences):.0e}" if differences else ""
        yield f"  internal and external modes by themselves{checked}; pushing by the whole loop"
    elif certificate.limits:
        yield "  by the whole loop, each gain with the others as they are; pushing, what is left of them together"
    yield f"  {_said_of_passivity(certificate)}"
    if certificate.grip:
        yield f"  {said_of_grip(certificate.grip, certificate.edge)}"
    if certificate.fade is not None:
        begins, asked = (1e3 * gap for gap in certificate.fade)
        short = f": too short by {asked - begins:.3g} mm" if asked > begins else ""
        yield f"  the fade begins at {begins:.3g} mm; the forces at rest ask for {asked:.3g} mm{short}"
    yield from (f"  note: {note}" for note in certificate.notes)
    if certificate.assumed:
        yield f"  taken for granted: {'; '.join(certificate.assumed)}"


def _said_of_passivity(certificate: Certificate) -> str:
    passive = certificate.passive
    if passive is None:
        return f"passivity is not judged: {certificate.why_not_passive}"
    values = {"internal": passive.internal, "external": passive.external}
    if all(value == 0.0 for value in values.values()):
        return "passive for any operator: no gain; friction of devices and object does not cover what damping leaks"
    shown = ", ".join(f"{name} up to {value:.4g} N/m" for name, value in values.items() if value < math.inf)
    return f"passive for any operator: {shown}"
