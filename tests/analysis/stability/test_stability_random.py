"""Random grasps, stable or not: what the linearisation says against how the framework moves them.

A few run with the suite; `pytest -m large -s tests/analysis/stability/test_stability_random.py` runs a thousand.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from itertools import count

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import graspfx as gx
from graspfx.analysis.stability import spectral_radius
from graspfx.analysis.stability.loop import held_devices, loop_matrix
from tests.support.random_scenes import Case, boundary, random_case, scaled

LEAST, MOST, COSTLY = 15, 4000, 1500  # ticks of a run; of one in space under the implicit integrator
CLEAR = 5.0  # N |log rho| of a run at least: motion grows or shrinks by exp(5) or more
WANTED = 7.0
WILD = 12.0  # N |log rho| at most: what was started 1e-9 m wide is then still small
KINDS = ("as drawn", "3 % below", "3 % above")
# fmt: off
QUICK = (
    1008, 1014, 1017, 1020, 1023, 1035, 1038, 1047, 1128, 1152,  # as drawn
    1099, 1156, 1177, 1207, 1255, 1423, 1459, 1654, 1723, 1729,  # 3 % below
    1004, 1019, 1046, 1052, 1088, 1106, 1124, 1160, 1172, 1418,  # 3 % above
)
# fmt: on


@dataclass(frozen=True)
class Verdict:
    """One grasp that was run, or why it was not."""

    seed: int
    kind: str
    label: str
    excluded: str = ""
    radius: float = math.nan
    growth: float = math.nan  # of the last third of the run against the third before
    rate_error: float = math.nan  # of the rate of the slowest mode, relative

    @property
    def contradicts(self) -> bool:
        return not self.excluded and (self.growth > 1.0) != (self.radius > 1.0)

    @property
    def stable(self) -> bool:
        return self.radius < 1.0


def judged(seed: int) -> Verdict:
    """Draw a grasp, take its gains as they are or 3 % beside the first boundary, predict, run, compare."""
    case, kind, factor = random_case(seed), KINDS[seed % 3], 1.0
    if kind != "as drawn":
        edge = boundary(case)
        if edge is None:
            return Verdict(seed, kind, case.label, "no boundary from 0.05 to 20 times the gains")
        factor = edge * (0.97 if kind == "3 % below" else 1.03)
        case = scaled(case, factor)
    radius = spectral_radius(case.linear)
    per_tick = abs(math.log(radius)) if radius > 0.0 else math.inf
    most = COSTLY if case.linear.integrator == "implicit" and case.table["dimensions"] == 3 else MOST
    if most * per_tick < CLEAR:
        return Verdict(seed, kind, case.label, f"too slow: less than exp({CLEAR:g}) in {most} ticks", radius)
    if radius > 1.0 and LEAST * per_tick > WILD:
        return Verdict(seed, kind, case.label, f"too fast: more than exp({WILD:g}) in {LEAST} ticks", radius)
    if radius < 1.0:  # what decays may start wider, and stays further above rounding
        case = scaled(random_case(seed, 1e-6), factor)
    ticks = min(most, max(LEAST, math.ceil(WANTED / per_tick)))
    rec = gx.run(gx.Scene(**case.table, duration=ticks * case.linear.period))
    assert not rec.faults, (seed, case.label, rec.faults)
    return Verdict(seed, kind, case.label, "", radius, growth(rec, case), rate_error(rec, case, radius))


def growth(rec: gx.Recording, case: Case) -> float:
    """RMS of all speeds over the last third of a run against that over the third before; nothing of the prediction.

    Speeds, since what nobody holds may come to rest anywhere.
    """
    assert rec.true_position is not None
    fingers = np.diff(rec.true_position, axis=0).reshape(len(rec) - 1, -1) / case.linear.period
    parts = [fingers * np.sqrt(case.linear.mass), object_speed(rec, case)[1:] * np.sqrt(np.diag(case.linear.inertia))]
    size = (np.hstack(parts) ** 2).sum(axis=1)
    third = len(size) // 3
    return float(np.sqrt(size[-third:].mean() / size[-2 * third : -third].mean()))


def object_speed(rec: gx.Recording, case: Case) -> np.ndarray:
    """Velocity and angular velocity on the free axes, (N, r)."""
    motion = rec.objects["object"]
    spin = np.zeros((len(rec), 0)) if motion.angular_velocity is None else motion.angular_velocity.reshape(len(rec), -1)
    return np.hstack([motion.velocity, spin])[:, np.array(case.table["object"]["free"])]


def rate_error(rec: gx.Recording, case: Case, radius: float) -> float:
    """Fit the relative error of log |z| of the slowest mode: the run's states, seen along its left eigenvector.

    The fingers' velocities are not recorded; they follow from two positions and the force held between them.
    """
    assert rec.true_position is not None
    linear, N = case.linear, len(rec)
    m, _ = linear.coordinates
    x = (rec.true_position - case.start).reshape(N, m)
    f = (rec.finger_force - case.force).reshape(N, m)
    lag = int(linear.delay.max())
    line = np.vstack([np.zeros((lag, m)), f])  # f of sample k at row k + lag
    shown = np.stack([line[lag - late : lag - late + N, i] for i, late in enumerate(linear.delay)], axis=1)
    E, H = held_devices(linear)
    v = np.linalg.solve(E[:m, m:], (x[1:] - x[:-1] @ E[:m, :m].T + shown[:-1] @ H[:m].T).T).T
    motion = rec.objects["object"]
    place = [motion.position]
    if motion.orientation is not None and case.table["dimensions"] == 2:
        place.append(motion.orientation.reshape(N, 1))
    elif motion.orientation is not None:
        place.append(Rotation.from_quat(motion.orientation).as_rotvec())
    q = np.hstack(place)[:, np.array(case.table["object"]["free"])]
    state = [x, np.vstack([v, v[-1:]]), q, object_speed(rec, case)]
    if linear.damping.any():
        state.append(np.vstack([x[:1], x[:-1]]))
    state += [line[lag - late : lag - late + N] for late in range(1, lag + 1)]

    values, vectors = np.linalg.eig(loop_matrix(linear).T)
    slowest = int(np.argmin(np.abs(np.abs(values) - radius) + 10.0 * (np.abs(values - 1.0) < 1e-9)))
    # differences: a motion about another state of rest than the expected one
    along = np.abs(np.diff(np.hstack(state) @ vectors[:, slowest]))
    first, last = N // 4, N - 3
    measured = math.log(along[last] / along[first]) / (last - first)
    return abs(measured / math.log(radius) - 1.0)


def check(found: list[Verdict]) -> None:
    """No contradiction; rates to 0.5 %, what is not linear in a motion 1e-6 m wide: it falls in proportion to that."""
    assert not [each for each in found if each.contradicts]
    worst = max((each for each in found if not each.excluded), key=lambda each: each.rate_error)
    assert worst.rate_error < 5e-3, worst


def test_thirty_random_grasps() -> None:
    """Ten of each kind, which take little time; in 1, 2 and 3 dimensions, by each integrator."""
    found = [judged(seed) for seed in QUICK]
    assert Counter(each.kind for each in found if not each.excluded) == dict.fromkeys(KINDS, 10)
    assert sum(each.stable for each in found) == 12
    check(found)


@pytest.mark.large
@pytest.mark.parametrize("part", range(4))
def test_a_thousand_random_grasps(part: int) -> None:
    """Four parts of 250 that were run; says how many were not, and why."""
    found: list[Verdict] = []
    ran = 0
    for seed in count(1000 + part, 4):
        found.append(judged(seed))
        ran += not found[-1].excluded
        if ran == 250:
            break
    kinds = Counter((each.kind, "stable" if each.stable else "unstable") for each in found if not each.excluded)
    worst = max((each for each in found if not each.excluded), key=lambda each: each.rate_error)
    print(f"\npart {part}: {ran} run of {len(found)}; {dict(kinds)}")
    print(f"excluded: {dict(Counter((each.kind, each.excluded) for each in found if each.excluded))}")
    print(f"contradictions: {[each for each in found if each.contradicts]}; worst rate: {worst}", flush=True)
    check(found)
