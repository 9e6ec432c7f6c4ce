"""Stability of a scene with changed values: about the new equilibrium or, faster, about the present equilibrium."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import NDArray

from graspfx import plugins
from graspfx.analysis.blas_threads import one_blas_thread
from graspfx.analysis.linearisation import Linearisation
from graspfx.assembly.live import GAINS, numbered, value_of
from graspfx.assembly.resolve import resolve
from graspfx.certificate.certificate import STANDING, Limit, is_stable
from graspfx.certificate.linearise import Linearised, linearise
from graspfx.certificate.mode_limits import mode_limits, pushing_limits, spectral_radius, standing_limits
from graspfx.certificate.operating_point import NotGraspingError
from graspfx.errors import InputError, NoRestError
from graspfx.scene.keys import general
from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]

TINY = 1e-15  # smaller energies of a squeeze are rounding [J]
UNFELT = 1e-12  # smaller forces are treated as zero [N]
INSTANTS = 400  # number of instants of a motion that are examined
FRICTION = ("coupling.friction", "finger.*.friction")
FIELDS = dict(zip(GAINS, ("external", "external_damping", "internal", "internal_damping"), strict=True))
OF_OBJECT = {
    "object.*.mass": "mass", "object.*.viscosity": "viscosity", "object.*.rotational_viscosity": "rotational_viscosity",
}  # fmt: skip
MOVING = ("motion", "duration", "start", "position")  # keys with such parts change the course of a hand


@dataclass(frozen=True)
class ObjectLimit:
    """Stability limit of the grasp of one object, whose name is `object`."""

    object: str
    limit: Limit

    @property
    def text(self) -> str:
        """Mode, gain, limit, margin and frequency as text."""
        return f"{self.limit.mode} {self.limit.text}"


@dataclass(frozen=True)
class Judgement:
    """Stability of a scene with changed values.

    Attributes:
        values: Changed values by dotted key.
        stable: Whether the loop of every object is stable (`Certificate.stable`); False if no equilibrium was found.
        spectral_radius: Largest spectral radius of the objects' loops; inf if no equilibrium was found, or no finger
            touches an object.
        limits: Stability limits of all objects, except those of fingers that push alone.
        pushing: Stability limits of fingers that push alone; empty unless requested.
        grip: Ratio of the squeeze to the smallest squeeze that holds the load (`grip_of`); minimum over the objects.
            `grip` and the four attributes that follow are nan unless requested.
        depth: Largest distance of a fingertip from its contact point in equilibrium [m].
        squeeze: Largest internal force of a finger in equilibrium [N].
        force: Largest total force of a finger in equilibrium [N].
        displayed: Stiffness of the squeeze in equilibrium [N/m]: f.f/(f.e), with the internal forces f (n d,) of all
            fingers and the vectors e (n d,) from contact points to fingertips. Compliant fingertips are included.
            Minimum over the objects.
        at: State that is judged: "squeezed", or "start" if a finger on hardware does not touch in equilibrium. "" if no
            equilibrium was found, "apart" if no finger touches an object.
        assumed: Assumptions of the analysis, as sentences; the reason if `at` is "" or "apart".
        scene: Scene with the changed values.
    """

    values: Mapping[str, float]
    stable: bool
    spectral_radius: float
    limits: tuple[ObjectLimit, ...]
    pushing: tuple[ObjectLimit, ...] = ()
    grip: float = math.nan
    depth: float = math.nan
    squeeze: float = math.nan
    force: float = math.nan
    displayed: float = math.nan
    at: str = "squeezed"
    assumed: tuple[str, ...] = field(default=(), repr=False)
    scene: Scene | None = field(default=None, repr=False, compare=False)

    @property
    def worst(self) -> ObjectLimit | None:
        """Limit with the smallest margin; of equal margins, that of the most specific mode. None without limits."""
        return min(self.limits, key=lambda row: (round(row.limit.margin, 9), -len(row.limit.mode)), default=None)

    @property
    def margin(self) -> float:
        """Smallest margin of all modes. If the loop is unstable, the margin is at most 1/`spectral_radius`."""
        least = min((row.limit.margin for row in self.limits), default=math.inf)
        return least if self.stable else min(least, 1.0 / self.spectral_radius)

    def margin_of(self, mode: str) -> float:
        """Return the smallest margin over the objects of the mode with this name; inf if no object has the mode."""
        rows = (*self.limits, *self.pushing)
        return min((row.limit.margin for row in rows if row.limit.mode == mode), default=math.inf)


class Judge:
    """Computes the stability of a scene with changed values, each time about the equilibrium with these values.

    Args:
        scene: Scene whose values are changed.
        grips: Whether to compute also `grip`, `depth` and the forces of a `Judgement`.
    """

    def __init__(self, scene: Scene, *, grips: bool = False) -> None:
        self.scene, self.count = scene, 0
        self._touched = sorted(set(scene.finger_objects))
        if not self._touched:
            raise InputError("scene", scene.source.name, "a scene whose fingers touch an object")
        self._grips = grips
        self._courses: dict[int, HandCourse] = {}

    @contextmanager
    def session(self) -> Iterator[None]:
        """Make judgements within a block faster: installed plug-ins are searched once, and BLAS uses one thread."""
        with plugins.unchanged(), one_blas_thread():
            yield

    def loops(self, values: Mapping[str, Any]) -> tuple[Scene, list[Linearised]]:
        """Return the scene with changed values, and the linearised loop of each object that fingers touch."""
        scene = self.scene.replace(values) if values else self.scene
        return scene, [linearise(scene, "squeezed", scene.object[i].name) for i in self._touched]

    def judge(self, values: Mapping[str, Any], *, pushing: bool = False) -> Judgement:
        """Compute the stability of the scene with changed values.

        Args:
            values: Values by dotted key.
            pushing: Whether to compute also the limits of fingers that push alone.

        Raises:
            SceneError: If the scene does not accept a key or a value.
            InputError: If a device does not state its mass or friction.
        """
        self.count += 1
        try:
            scene, loops = self.loops(values)
        except (NotGraspingError, NoRestError) as error:
            apart, why = isinstance(error, NotGraspingError), (" ".join(str(error).split()),)
            grip, at, scene = 0.0 if apart else math.nan, "apart" if apart else "", self.scene.replace(values)
            return Judgement(dict(values), False, math.inf, (), grip=grip, at=at, assumed=why, scene=scene)
        rows, pushes, radius = [], [], 0.0
        for loop in loops:
            name = loop.objects[0]
            radius = max(radius, spectral_radius(loop.linear))
            limits = [*mode_limits(scene, loop, compare=False), *standing_limits(loop)]
            rows += [ObjectLimit(name, row) for row in limits]
            if pushing:
                pushes += [ObjectLimit(name, row) for row in pushing_limits(scene, loop)]
        standing = [row.limit for row in rows if row.limit.mode.startswith(STANDING)]
        stable = is_stable(radius) and all(row.margin >= 1.0 for row in standing)
        at = "start" if any("start" in loop.at for loop in loops) else "squeezed"
        assumed = tuple(dict.fromkeys(text for loop in loops for text in loop.assumed))
        numbers = self._numbers(scene, loops, values) if self._grips else {}
        return Judgement(
            dict(values), stable, radius, tuple(rows), tuple(pushes), at=at, assumed=assumed, scene=scene, **numbers
        )

    def _numbers(self, scene: Scene, loops: list[Linearised], values: Mapping[str, Any]) -> dict[str, float]:
        """Return the attributes `grip`, `depth`, `squeeze`, `force` and `displayed` of a judgement, by name."""
        each = []
        for index, loop in zip(self._touched, loops, strict=True):
            f, away = loop.forces, loop.tips - loop.contacts
            if np.isnan(f).any():  # no rest: no forces
                return {}
            internal = np.asarray(loop.splits[0].divide(f.ravel())[1]).reshape(f.shape)
            along = float((internal * away).sum())
            each.append((
                grip_of(scene, index, loop, self._course(scene, index, values)),
                float(np.linalg.norm(away, axis=1).max()),
                float(np.linalg.norm(internal, axis=1).max()),
                float(np.linalg.norm(f, axis=1).max()),
                float((internal**2).sum()) / along if along > TINY else math.nan,
            ))  # fmt: skip
        grip, depth, squeeze, force, displayed = zip(*each, strict=True)
        return {
            "grip": min(grip), "depth": max(depth), "squeeze": max(squeeze), "force": max(force),
            "displayed": min(displayed),
        }  # fmt: skip

    def _course(self, scene: Scene, index: int, values: Mapping[str, Any]) -> HandCourse:
        """Return the intended motion of an object's hands; it is recomputed only if a changed key affects it."""
        if any(part in key for key in values for part in MOVING):
            return hand_course(scene, index)
        if index not in self._courses:
            self._courses[index] = hand_course(self.scene, index)
        return self._courses[index]


# Loads ---------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class HandCourse:
    """Mean intended velocity and acceleration of the fingers on an object at k instants, (k, d) [m/s, m/s^2]."""

    velocity: FloatArray
    acceleration: FloatArray


def hand_course(scene: Scene, index: int) -> HandCourse:
    """Compute the mean intended motion of the fingers on an object over the scene's duration.

    Squeezing and rotations are omitted, and fingers of plug-in hands are treated as stationary.

    Args:
        scene: Scene with the hands.
        index: Index of the object.
    """
    parts = resolve(scene)
    d, start = scene.dimensions, parts.start
    fingers = parts.objects[index].fingers
    times = np.linspace(0.0, scene.duration, INSTANTS)
    position = np.zeros((INSTANTS, len(start), d))
    for hand in parts.hands:
        if hand.driver is None and hand.motion is not None:
            mover = replace(hand, squeeze=0.0, turns=(), guided=False).hold(start, np.zeros_like(start))
            rest = mover.target(0.0)[0].copy()
            for k, time in enumerate(times.tolist()):
                position[k, hand.fingers] = mover.target(time)[0] - rest
    mean = position[:, fingers].mean(axis=1)
    step = float(times[1] - times[0])
    velocity = np.gradient(mean, step, axis=0)
    return HandCourse(velocity, np.gradient(velocity, step, axis=0))


def loads(scene: Scene, index: int, loop: Linearised, course: HandCourse) -> FloatArray:
    """Compute the wrenches (k, r) that the fingers must exert on an object to move it as the hands intend.

    The force is m (a - g) + b v, with the object's mass m and viscosity b, gravity g, and the acceleration a and
    velocity v of `course`. Moments are zero.
    """
    table, d = scene.object[index], scene.dimensions
    free = scene.free(table)
    shifts = int(sum(free[:d]))
    wrench = np.zeros((len(course.velocity), len(loop.linear.inertia)))
    if not shifts:
        return wrench
    mass, viscosity = float(loop.linear.inertia[0, 0]), float(table.viscosity)
    gravity = np.zeros(d) if scene.gravity is None else np.array(scene.gravity)
    force = mass * (course.acceleration - gravity) + viscosity * course.velocity
    wrench[:, :shifts] = force[:, np.array(free[:d], dtype=bool)]
    return wrench


def grip_of(scene: Scene, index: int, loop: Linearised, course: HandCourse) -> float:
    """Compute the ratio of the squeeze in equilibrium to the smallest squeeze with which no finger slides or lets go.

    The squeeze f_i consists of the internal parts of the contact forces. At each instant of the hands' motion, the load
    (`loads`) requires external forces f_e, which are the smallest forces in the metric of the split that balance it.
    Let s be the smallest factor with which f_e + s f_i lies in every finger's friction cone at every instant; the
    result is 1/s. The cone is f_t <= mu f_n with the normal force f_n >= 0 and the tangential force f_t. Fingers
    without a coefficient of friction mu need only push, f_n >= 0. The torsion of soft fingers is ignored.

    Returns:
        Ratio 1/s. inf if the load needs no squeeze or contacts are attached, 0 if no factor is sufficient, nan if there
        is no equilibrium.
    """
    if scene.coupling.contact == "attached":
        return float("inf")
    n, d = loop.contacts.shape
    if np.isnan(loop.forces).any():
        return float("nan")
    split = loop.splits[0]
    internal = np.asarray(split.divide(loop.forces.ravel())[1]).reshape(n, d)
    matrix = np.asarray(split.matrix)
    wrench = loads(scene, index, loop, course)
    metric = np.broadcast_to(np.asarray(split.metric), (n * d,)) if np.ndim(split.metric) == 1 else np.ones(n * d)
    spread = metric[:, None] * matrix.T @ np.linalg.pinv((matrix * metric) @ matrix.T)  # M G'(G M G')^+
    external = (wrench @ spread.T).reshape(-1, n, d)
    coefficients = np.array([scene.coefficients[i] for i in loop.fingers])
    shares = [
        needed_share(external[:, k], internal[k], loop.normals[k], float(coefficients[k]) or np.inf) for k in range(n)
    ]
    most = float(np.max(shares))
    return 1.0 / most if most > 0.0 else float("inf")


def needed_share(external: FloatArray, internal: FloatArray, normal: FloatArray, mu: float) -> float:
    """Find the smallest s >= 0 for which the force external + s internal of a finger lies in its friction cone.

    Args:
        external: External force at k instants, (k, d) [N].
        internal: Internal force (d,) [N].
        normal: Unit normal into the object, (d,).
        mu: Coefficient of friction; inf if the finger need only push.

    Returns:
        Smallest factor that is sufficient at all instants; inf if there is none.
    """
    n_e, n_i = external @ normal, float(internal @ normal)
    t_e, t_i = external - n_e[:, None] * normal, internal - n_i * normal
    if n_i <= UNFELT:  # no squeeze: the load alone has to satisfy the cone
        inside = n_e >= -UNFELT if np.isinf(mu) else np.linalg.norm(t_e, axis=1) <= mu * n_e + UNFELT
        return 0.0 if bool(inside.all()) else float("inf")
    least = np.maximum(-n_e / n_i, 0.0)
    if np.isinf(mu):
        return float(least.max())
    a = mu**2 * n_i**2 - float(t_i @ t_i)
    if a <= 0.0:
        return float("inf")
    b, c = mu**2 * n_e * n_i - t_e @ t_i, mu**2 * n_e**2 - (t_e**2).sum(axis=1)
    root = (-b + np.sqrt(np.maximum(b**2 - a * c, 0.0))) / a
    return float(np.maximum(least, np.where(b**2 >= a * c, root, 0.0)).max())


# A loop with a change, at the rest that it has -----------------------------------------------------------------------


@dataclass(frozen=True)
class Change:
    """Change of the gains of a loop and of the properties of its object.

    Attributes:
        external, internal: Factors of the external and internal stiffness.
        external_damping, internal_damping: Factors of the external and internal damping.
        mass: New mass of the object [kg]; None if unchanged.
        viscosity: New viscosity of the object [N s/m]; None if unchanged.
        rotational_viscosity: New rotational viscosity of the object [N m s]; None if unchanged.
    """

    external: float = 1.0
    internal: float = 1.0
    external_damping: float = 1.0
    internal_damping: float = 1.0
    mass: float | None = None
    viscosity: float | None = None
    rotational_viscosity: float | None = None

    @property
    def is_external(self) -> bool:
        """Whether nothing but the external stiffness changes."""
        return self == Change(external=self.external)


def change_of(scene: Scene, name: str, values: Mapping[str, Any]) -> Change | None:
    """Return how values that are set during a run change the loop of an object.

    The result is None if a `Change` cannot describe it: a gain is a matrix, or is zero at present, or the values
    include a key that is neither a gain, a coefficient of friction, nor a mass or viscosity of an object.

    Args:
        scene: Scene with the present values.
        name: Name of the object.
        values: New values by key.

    Raises:
        InputError, UnknownNameError: If the scene does not have a key.
    """
    changes: dict[str, float] = {}
    for key, value in values.items():
        plain, old = general(key), value_of(scene, numbered(scene, key))
        if plain in FRICTION or old == value:
            continue  # contacts stick at any friction
        if plain in FIELDS:
            if not (is_number(old) and is_number(value)) or old <= 0.0 or value < 0.0:
                return None
            changes[FIELDS[plain]] = value / old
        elif plain in OF_OBJECT and is_number(value):
            if old is None:
                return None
            if _is_of(scene, key, name):
                changes[OF_OBJECT[plain]] = float(value)
        else:
            return None
    return Change(**changes)


def is_number(value: object) -> TypeGuard[float]:
    """Return whether a value is a finite number, and not a bool."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _is_of(scene: Scene, key: str, name: str) -> bool:
    """Return whether a key of an object's table refers to the object with this name."""
    number = numbered(scene, key).split(".")[1]
    index = int(number) if number.isdecimal() else 0
    return number == "*" or scene.object[index].name == name


def altered(scene: Scene, loop: Linearised, change: Change) -> Linearisation:
    """Return the matrices of a loop after a change, except for the stiffness matrix, which is not changed.

    The preload is scaled with the squeeze (`_squeeze_ratio`).
    """
    linear = loop.linear
    table = next(each for each in scene.object if each.name == loop.objects[0])
    shifts = sum(scene.free(table)[: scene.dimensions])
    inertia, viscosity = linear.inertia.copy(), linear.viscosity.copy()
    if change.mass is not None and table.mass is not None:
        ratio = change.mass / table.mass
        inertia[:shifts, :shifts] *= ratio
        if table.inertia is None:  # the moment of inertia of a solid shape is proportional to its mass
            inertia[shifts:, shifts:] *= ratio
    arrays: dict[str, np.ndarray] = {"inertia": inertia}
    for value, old, first, last in (
        (change.viscosity, table.viscosity, 0, shifts),
        (change.rotational_viscosity, table.rotational_viscosity, shifts, len(viscosity)),
    ):
        if value is not None:  # the part from torsion is unchanged
            places = np.arange(first, last)
            viscosity[places, places] += value - (old or 0.0)
    arrays["viscosity"] = viscosity
    if linear.preload is not None:
        arrays["preload"] = linear.preload * _squeeze_ratio(scene, linear, change)
    return linear.with_arrays(**arrays, damping=loop.damping(change.external_damping, change.internal_damping))


def _squeeze_ratio(scene: Scene, linear: Linearisation, change: Change) -> float:
    """Return the factor of the squeeze after a change of the internal stiffness.

    The squeeze is computed as for springs in series with the stiffness of the hand and the internal stiffness, with the
    same closing of the hands.
    """
    gain = scene.coupling.internal.stiffness
    if change.internal == 1.0 or not is_number(gain):
        return 1.0
    _, sizes, V = np.linalg.svd(linear.G)
    internal = V[int((sizes > 1e-6 * sizes.max(initial=0.0)).sum()) :]
    if not len(internal):
        return 1.0
    hand = float(np.trace(internal @ linear.hand_stiffness @ internal.T)) / len(internal)
    return change.internal * (hand + gain) / (hand + change.internal * gain)
