"""Search for the tremor of Fig. 12: `python docs/pictures/the_tremor.py [RUNS]` prints the table of its page.

`python docs/pictures/the_tremor.py search` searches for unequal fingers by optimisation, in 73 344 evaluations.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import graspfx as gx

FloatArray = NDArray[np.float64]
Range = tuple[float, float]

GAINS = {"conventional": (30.0, 30.0), "proposed": (30.0, 70.0)}  # kep, kip [N/m]
SHARE = 0.8 * 0.05**2 / 6  # b_v a^2/6 [N m s/rad], which damps a turn as eq. (27) damps a shift
SECONDS, LATE = 10.0, 4.0
SLOWEST = 2.6  # [Hz]; below are the waving and its harmonics
VISIBLE = 1e-4  # [m], RMS
CALMER = 3.0
HELD = 0.98  # of the samples, for a finger that keeps its touch
BATCH = 50

OPERATOR: dict[str, Range] = {
    "finger.*.hand.stiffness": (60.0, 500.0),
    "finger.*.hand.damping": (0.02, 3.0),
    "finger.*.hand.squeeze": (0.002, 0.015),
}
UNEQUAL = {key.replace("*", str(i)): ends for key, ends in OPERATOR.items() for i in (0, 1)}
ARMS: dict[str, Range] = {"finger.*.device.joint_damping": (0.5e-3, 6e-3), "finger.*.device.counts": (60.0, 4000.0)}
POINTS: dict[str, Range] = {
    "finger.*.device.mass": (0.03, 0.3),
    "finger.*.device.damping": (0.1, 0.4),
    "finger.*.device.resolution": (1e-6, 1e-3),
}
TURNING: dict[str, Range] = {"object.rotational_viscosity": (1e-3 * SHARE, SHARE)}
SLIPPING: dict[str, Range] = {"coupling.friction": (0.2, 1.2)}


class Family(NamedTuple):
    """Grasps that differ only in the values of some keys; `fixed` has the common values."""

    name: str
    ranges: Mapping[str, Range]
    fixed: Mapping[str, Any] = {}
    turns: bool = False
    runs: float = 1.0  # as a share of those of the others


def points(delay: int) -> dict[str, Any]:
    return {"finger.*.device": {"name": "simulated", "mass": 0.15, "damping": 0.2, "delay": delay}}


def families() -> list[Family]:
    """List the families, with the cube's rotation locked as in eq. (27) and free."""
    every: list[Family] = []
    for turns in (False, True):
        own = TURNING if turns else {}
        arms, which = OPERATOR | ARMS | own, "free to turn" if turns else "turn locked"
        every += [
            Family(f"{which}: arms", arms, {}, turns),
            Family(f"{which}: arms, unequal fingers", UNEQUAL | ARMS | own, {}, turns),
            Family(f"{which}: arms, one sample late", arms, {"finger.*.device.delay": 1}, turns),
            Family(f"{which}: arms, two samples late", arms, {"finger.*.device.delay": 2}, turns),
            Family(f"{which}: arms, fingers that slide", arms | SLIPPING, {"coupling.friction": 0.5}, turns),
            Family(f"{which}: points", OPERATOR | POINTS | own, points(0), turns),
            Family(f"{which}: points, one sample late", OPERATOR | POINTS | own, points(1), turns),
            Family(f"{which}: arms, object exact", arms, {"object.integrator": "exact"}, turns),
            Family(f"{which}: arms, PyBullet", arms, {"object.dynamics": "bullet"}, turns, 0.1),
        ]
    stiff = OPERATOR | {"finger.*.hand.stiffness": (200.0, 300.0), "finger.*.hand.damping": (0.5, 3.0)}
    every.append(
        Family(
            "free to turn without viscosity: arms, operators of 200-300 N/m",
            stiff,
            {"object.rotational_viscosity": 0.0},
            True,
        )
    )
    return every


def drawn(ranges: Mapping[str, Range], count: int) -> dict[str, list[float]]:
    """Draw values, evenly in their logarithms."""
    random = np.random.default_rng(12)
    return {key: np.exp(random.uniform(*np.log(ends), count)).tolist() for key, ends in ranges.items()}


class Shake(NamedTuple):
    """Vibration of a run from `LATE` on."""

    size: float  # RMS of the worst finger along its worst axis, above SLOWEST [m]
    frequency: float  # [Hz]
    force: float  # RMS [N]
    holds: bool


def shake(recording: gx.Recording) -> Shake:
    late = recording.time >= LATE
    t, n = recording.time[late], int(late.sum())
    waving = [f(2 * np.pi * hertz * t) for hertz in np.arange(0.5, SLOWEST, 0.5) for f in (np.sin, np.cos)]
    basis = np.linalg.qr(np.stack([np.ones(n), t - t.mean(), *waving], axis=1))[0]

    def rest(values: FloatArray) -> FloatArray:
        flat = values[late].reshape(n, -1)
        return flat - basis @ (basis.T @ flat)

    if recording.faults or not np.isfinite(recording.finger_position).all():
        return Shake(np.inf, np.nan, np.inf, False)
    fingers, forces = rest(recording.finger_position), rest(recording.finger_force)
    hertz = np.fft.rfftfreq(n, recording.period)
    power = (np.abs(np.fft.rfft(fingers * np.hanning(n)[:, None], axis=0)) ** 2).sum(axis=1) * (hertz > SLOWEST)
    size, force = (float(np.sqrt((each**2).mean(axis=0)).max()) for each in (fingers, forces))
    return Shake(size, float(hertz[power.argmax()]), force, bool((recording.touching[late].mean(axis=0) > HELD).all()))


def shakes(family: Family, values: Mapping[str, Sequence[float]], kep: float, kip: float) -> list[Shake]:
    """Run a family's grasps with one pair of gains."""
    gains = {"coupling.external.stiffness": kep, "coupling.internal.stiffness": kip}
    scene = gx.load("paper-waving-turning" if family.turns else "paper-waving", {**family.fixed, **gains})
    count = len(next(iter(values.values())))
    if scene.object[0].dynamics != "native":
        changes = ({key: each[i] for key, each in values.items()} for i in range(count))
        return [shake(gx.run(scene.replace(change), duration=SECONDS)) for change in changes]
    every: list[Shake] = []
    for begin in range(0, count, BATCH):
        some = {key: each[begin : begin + BATCH] for key, each in values.items()}
        batch = gx.run_batch(scene, some, zip=True, keep="recordings", duration=SECONDS)
        every += [shake(recording) for recording in batch.recordings]
    return every


def row(family: Family, runs: int) -> str:
    """Run a family; write the number of trembling grasps for each pair of gains, and their motion."""
    count = max(1, round(family.runs * runs))
    values = drawn(family.ranges, count)
    before, after = (shakes(family, values, *gains) for gains in GAINS.values())
    trembling = [x for x in before if x.size > VISIBLE and x.holds]
    only = [
        x for x, y in zip(before, after, strict=True) if x.size > max(VISIBLE, CALMER * y.size) and x.holds and y.holds
    ]
    lost = sum(not x.holds and y.holds for x, y in zip(before, after, strict=True))
    other = sum(y.size > VISIBLE and y.holds for y in after)
    cells = [family.name, str(count), str(len(trembling)), str(other), str(len(only)), _span(only), str(lost)]
    return f"| {' | '.join(cells)} |"


def _span(some: Sequence[Shake]) -> str:
    if not some:
        return "-"
    sizes, hertz = [1e3 * each.size for each in some], [each.frequency for each in some]
    return f"{min(sizes):.1f}-{max(sizes):.1f} mm at {min(hertz):.1f}-{max(hertz):.1f} Hz"


PAIR = {"mass": (0.05, 0.3), "friction": (0.1, 0.4), "hand_stiffness": (30.0, 500.0), "hand_damping": (0.01, 3.0)}
DELAYS = [0, 0], [1, 0], [1, 1], [2, 0], [2, 1], [2, 2]  # of the fingers [samples]


def growths(pair: FloatArray, delay: Sequence[int], integrator: str) -> list[float]:
    """Compute the growth rate of the least stable motion with each pair of gains, with locked rotation [1/s].

    Args:
        pair: Values of the quantities in PAIR for both fingers, (8,).
        delay: Delays of both fingers [samples].
        integrator: Integrator of the cube.
    """
    mass, friction, stiffness, damping = pair.reshape(4, 2)
    split = gx.Grasp([[-0.025], [0.025]]).split()
    found = []
    for kep, kip in GAINS.values():
        loop = gx.stability.Linearisation(
            period=0.005, G=[[1.0, 1.0]], inertia=0.1, viscosity=0.8, integrator=integrator, mass=mass,
            stiffness=gx.Coupling(gx.Impedance(kep), gx.Impedance(kip)).stiffness(split), friction=friction,
            hand_stiffness=np.diag(stiffness), hand_damping=np.diag(damping), delay=np.array(delay),
        )  # fmt: skip
        found.append(float(np.log(gx.stability.spectral_radius(loop))) / 0.005)
    return found


def search() -> None:
    """Print, for each delay and integrator, the pair that trembles most at 30 N/m and not at 30 and 70."""
    from scipy.optimize import differential_evolution

    ends = [np.log(each) for each in PAIR.values() for _ in range(2)]
    for integrator in ("explicit", "exact"):
        for delay in DELAYS:

            def cost(logs: FloatArray, delay: Sequence[int] = delay, integrator: str = integrator) -> float:
                before, after = growths(np.exp(logs), delay, integrator)
                return -before + 100.0 * max(0.0, after)

            best = differential_evolution(
                cost, ends, popsize=4, maxiter=190, seed=12, polish=False, tol=0.0, atol=0.0, init="sobol"
            )
            pair = np.exp(best.x)
            print(integrator, delay, best.nfev, [round(each, 3) for each in growths(pair, delay, integrator)],
                  pair.round(4).tolist(), flush=True)  # fmt: skip


if __name__ == "__main__":
    if sys.argv[1:] == ["search"]:
        search()
        sys.exit()
    number = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    print("| cube, devices | grasps | trembles at 30 N/m | at 30 and 70 | only at 30 | tremor | lost only at 30 |")
    print("|---|---|---|---|---|---|---|")
    for each in families():
        print(row(each, number), flush=True)
