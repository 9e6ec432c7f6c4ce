"""Thousands of variants, whole calls, beside arrays of numpy, numba, JAX and runs one by one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

import graspfx as gx
from graspfx.bench.timing import Case, Method, is_installed, missing
from tests.bench.peers import imported, jax_in_double

FloatArray = NDArray[np.float64]
Values = dict[str, FloatArray]

TITLE = "Batches: a run of many variants"
LIMITS = """
Times are per variant, of whole calls: from the scene and the values to the last positions of all fingers and of the
object. Programs are in the cache. For keys other than gains, friction, masses, viscosities and numbers of devices and
hands, a scene is built for every value. The peers are written for this one system only, an hour's work each; they store
no row and detect no fault, and numba uses all processors, as run_batch does. "One by one" is
`gx.run(scene.replace(...))`, for a few of the variants. The error is that of the last positions against single runs,
relative to the largest of them; scenes with contact have no other peer than single runs.
"""

STIFFNESS, VISCOSITY, MASS = "coupling.external.stiffness", "object.viscosity", "object.mass"
RANGES = {STIFFNESS: (5.0, 60.0), VISCOSITY: (0.6, 1.5), MASS: (0.05, 0.2)}
CONTACT = ("sphere-three-fingers", "coupling.friction", 0.3, 0.9)  # a scene in which fingers slip, a key, its range
BOUND = 1e-12
CHECKED, SINGLES = 12, 4  # variants whose error is looked at, and that are run one by one
QUANTITIES: dict[str, Any] = {"measure": ["finger_position", "object_position"], "statistics": ["last"]}


@dataclass(frozen=True)
class Variants:
    """Values by dotted key, of each variant (V,), of a scene that runs for so many ticks."""

    scene: gx.Scene
    values: Values
    ticks: int

    def __len__(self) -> int:
        return len(next(iter(self.values.values())))

    def single(self, k: int) -> FloatArray:
        """Run one variant by itself; the last positions of fingers and object [m]."""
        changed = self.scene.replace({key: float(each[k]) for key, each in self.values.items()})
        run = gx.run(changed, duration=self.ticks * self.scene.period)
        return np.concatenate([run.finger_position[-1].ravel(), run.object_position[-1]])

    def batch(self) -> FloatArray:
        """Run all by `run_batch`; their last positions (V, n d + d) [m]."""
        found = gx.run_batch(self.scene, self.values, self.ticks * self.scene.period, zip=True, **QUANTITIES)
        parts = [found[quantity]["last"].reshape(len(self), -1) for quantity in QUANTITIES["measure"]]
        return np.concatenate(parts, axis=1)

    def error(self, last: Callable[[], FloatArray]) -> float:
        """Compare last positions with those of single runs: the largest difference, relative."""
        numbers, found = np.random.default_rng(3).integers(0, len(self), CHECKED), last()
        expected = np.stack([self.single(k) for k in numbers])
        return float((np.abs(found[numbers] - expected).max(axis=1) / np.abs(expected).max(axis=1)).max())

    def columns(self) -> list[FloatArray]:
        """Give k_ep, the object's viscosity and its mass of every variant, (V,) each."""
        own = {STIFFNESS: self.scene.coupling.external.stiffness, VISCOSITY: self.scene.object[0].viscosity,
               MASS: self.scene.object[0].mass}  # fmt: skip
        return [self.values.get(key, np.full(len(self), float(np.asarray(each)))) for key, each in own.items()]


def cases(quick: bool) -> Iterator[Case]:
    """Compare values of one key, random points of three, and a scene with contact."""
    many, points, ticks = (200, 50, 200) if quick else (10_000, 1000, 1000)
    scene, rng = gx.load("reference-1dof"), np.random.default_rng(7)
    one = Variants(scene, {STIFFNESS: np.linspace(*RANGES[STIFFNESS], many)}, ticks)
    three = Variants(scene, {key: rng.uniform(*each, points) for key, each in RANGES.items()}, ticks)
    for name, variants in ((f"{many} values of one key", one), (f"{points} random points of three keys", three)):
        yield Case("batches", f"{name}, {ticks} ticks", "relative", [*ours(variants), *peers(variants)], BOUND)
    name, key, low, high = CONTACT
    touching = Variants(gx.load(name), {key: np.linspace(low, high, 16 if quick else 1000)}, ticks)
    yield Case("batches", f"{name}, {len(touching)} values, {ticks} ticks", "relative", list(ours(touching)), BOUND)


def ours(variants: Variants) -> Iterator[Method]:
    """Call `run_batch` as a user does, and `gx.run` for a few variants."""
    if is_installed("llvmlite"):
        yield Method("GraspFX run_batch", variants.batch, partial(variants.error, variants.batch), calls=len(variants))
    else:
        yield missing("GraspFX run_batch", "llvmlite")
    singles = [partial(variants.single, k) for k in range(SINGLES)]
    yield Method("GraspFX gx.run one by one", lambda: [run() for run in singles], 0.0, "the others' oracle", SINGLES)


def peers(variants: Variants) -> Iterator[Method]:
    """List arrays of numpy, loops of numba, and JAX."""
    system = one_dof(variants.scene)
    columns = variants.columns()
    last = partial(by_numpy, system, variants.ticks, *columns)
    yield Method("numpy, arrays of variants", last, partial(variants.error, last), calls=len(variants))
    for name, make in (("numba, hand-written loops, parallel", numba_program), ("JAX, vmap of a scan", jax_program)):
        yield _later(name, partial(make, system, variants.ticks), variants)


def _later(name: str, make: Callable[[], Callable[..., FloatArray]], variants: Variants) -> Method:
    made: list[Callable[..., FloatArray]] = []

    def last() -> FloatArray:
        if not made:
            made.append(make())
        return made[0](*variants.columns())

    return Method(name, last, partial(variants.error, last), calls=len(variants))


@dataclass(frozen=True)
class OneDof:
    """Two devices m x'' + b x' + k x = u (eq. 5) that all variants share, and an internal stiffness.

    Attributes:
        T: [s].
        start: of the two fingers [m]; their hands rest at zero.
        A, B: of a device over a period, its force constant, (2, 2) and (2,).
        internal: kip [N/m].
    """

    T: float
    start: tuple[float, float]
    A: FloatArray
    B: FloatArray
    internal: float


def one_dof(scene: gx.Scene) -> OneDof:
    """Read what all variants share from the scene `reference-1dof`."""
    fingers: Any = scene.finger
    settings = fingers[0].device.settings
    m, b, k = settings["mass"], settings["damping"], float(np.asarray(fingers[0].hand.stiffness))
    E = np.asarray(expm(np.array([[0.0, 1.0, 0.0], [-k / m, -b / m, 1.0 / m], [0.0, 0.0, 0.0]]) * scene.period))
    first, second = (float(each.start[0]) for each in fingers)
    internal = float(np.asarray(scene.coupling.internal.stiffness))
    return OneDof(scene.period, (first, second), E[:2, :2], E[:2, 2], internal)


def by_numpy(g: OneDof, ticks: int, external: FloatArray, viscosity: FloatArray, mass: FloatArray) -> FloatArray:
    """Compute where the fingers and the object are at the last tick, (V, 3) [m], by eqs. (4)-(12)."""
    V = len(external)
    E = np.exp(-viscosity / mass * g.T)
    travel = (1.0 - E) * mass / viscosity
    drift, kick = 2.0 * external * (g.T - travel) / viscosity, 2.0 * external * travel / mass
    difference = external - g.internal
    q, v = np.repeat(np.array(g.start)[:, None], V, axis=1), np.zeros((2, V))
    x, speed, mean, y = (np.zeros(V) for _ in range(4))
    e, f, z = (np.empty((2, V)) for _ in range(3))
    a, b, c, d = g.A.ravel().tolist()
    to_place, to_speed = g.B.tolist()
    for _ in range(ticks - 1):
        np.subtract(q, x, out=e)
        np.add(e[0], e[1], out=mean)
        mean *= 0.5
        np.multiply(e, g.internal, out=f)
        f += np.multiply(difference, mean, out=y)
        x += np.multiply(travel, speed, out=y)  # the fingers' forces add up to 2 kep times their mean displacement
        x += np.multiply(drift, mean, out=y)
        speed *= E
        speed += np.multiply(kick, mean, out=y)
        np.multiply(q, c, out=z)
        q *= a
        q += np.multiply(v, b, out=e)
        q -= np.multiply(f, to_place, out=e)
        v *= d
        v += z
        v -= np.multiply(f, to_speed, out=e)
    return np.stack([*q, x], axis=1)


def numba_program(g: OneDof, ticks: int) -> Callable[..., FloatArray]:
    """Compile a loop over variants, on all processors, around a loop over ticks."""
    numba = imported("numba", "the peer of numba")
    prange, exp = numba.prange, np.exp
    T, internal, (p, r), (to_place, to_speed) = g.T, g.internal, g.start, g.B.tolist()
    a, b, c, d = g.A.ravel().tolist()

    def last(external: FloatArray, viscosity: FloatArray, mass: FloatArray) -> FloatArray:
        out = np.empty((len(external), 3))
        for k in prange(len(external)):
            E = exp(-viscosity[k] / mass[k] * T)
            travel = (1.0 - E) * mass[k] / viscosity[k]
            drift, kick = 2.0 * external[k] * (T - travel) / viscosity[k], 2.0 * external[k] * travel / mass[k]
            q0, q1, v0, v1, x, speed = p, r, 0.0, 0.0, 0.0, 0.0
            for _ in range(ticks - 1):
                mean = 0.5 * ((q0 - x) + (q1 - x))
                push = (external[k] - internal) * mean
                f0, f1 = internal * (q0 - x) + push, internal * (q1 - x) + push
                x += travel * speed + drift * mean
                speed = E * speed + kick * mean
                q0, v0 = a * q0 + b * v0 - to_place * f0, c * q0 + d * v0 - to_speed * f0
                q1, v1 = a * q1 + b * v1 - to_place * f1, c * q1 + d * v1 - to_speed * f1
            out[k, 0], out[k, 1], out[k, 2] = q0, q1, x
        return out

    program: Callable[..., FloatArray] = numba.njit(last, parallel=True)
    return program


def jax_program(g: OneDof, ticks: int) -> Callable[..., FloatArray]:
    """Map a scan over ticks over the variants."""
    jax = jax_in_double()
    np_, A, B = jax.numpy, g.A, g.B

    def last(external: Any, viscosity: Any, mass: Any) -> Any:
        E = np_.exp(-viscosity / mass * g.T)
        travel = (1.0 - E) * mass / viscosity
        drift, kick = 2.0 * external * (g.T - travel) / viscosity, 2.0 * external * travel / mass

        def tick(state: Any, _: Any) -> Any:
            q, x, speed = state
            e = q[0] - x
            mean = 0.5 * e.sum()
            f = g.internal * e + (external - g.internal) * mean
            return (A @ q - np_.outer(B, f), x + travel * speed + drift * mean, E * speed + kick * mean), None

        start = np_.array([g.start, (0.0, 0.0)]), 0.0, 0.0
        (q, x, _), _ = jax.lax.scan(tick, start, None, length=ticks - 1)
        return np_.append(q[0], x)

    program = jax.jit(jax.vmap(last))
    return lambda *columns: np.asarray(program(*columns))
