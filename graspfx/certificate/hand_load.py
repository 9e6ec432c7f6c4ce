"""Loads on a grasp: what fingers have to exert on their object for its weight, its drag and the hands' motion."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from graspfx.build.resolve import resolve
from graspfx.certificate.linearise import Linearised
from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]

INSTANTS = 400  # of a motion that are looked at
TINY = 1e-12  # [N]


@dataclass(frozen=True, eq=False)
class HandCourse:
    """The motion that hands intend for an object: velocity and acceleration of their fingers' mean, (k, d) each."""

    velocity: FloatArray
    acceleration: FloatArray


def hand_course(scene: Scene, index: int) -> HandCourse:
    """Follow the hands' intended motion of an object's fingers, no squeeze and no turns; plug-ins' hands stay still.

    Args:
        scene: with the hands.
        index: of the object.
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
    """Compute the wrenches (k, r) about the object's centre that fingers exert, m (a - g) + b v, moments zero."""
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
    """Compute by how much the squeeze at rest exceeds the least one with which no finger slides or lets go.

    With f_i the internal part of the forces at rest and f_e = P-weighted least forces of a load, the least share s of
    the squeeze with f_e + s f_i in every finger's cone, f_t <= mu f_n, f_n >= 0; grip = 1/s for the worst instant of
    the hands' motion. Fingers without a coefficient (that stick, or slip freely) have to push, no more. Torsion of
    soft fingers does not count.

    Returns:
        1 where the squeeze just suffices; inf where none is needed, or contacts are attached; 0 where no squeeze along
        f_i holds; nan without forces at rest.
    """
    if scene.coupling.contact == "attached":
        return float("inf")
    n, d = loop.contacts.shape
    if np.isnan(loop.forces).any():
        return float("nan")
    split = loop.splits[0]
    internal = np.asarray(split.divide(loop.forces.ravel())[1]).reshape(n, d)
    matrix = np.asarray(split.points.matrix)
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
    """Find the least s >= 0 with external (k, d) + s internal (d,) in the cone of every row; inf where none is."""
    n_e, n_i = external @ normal, float(internal @ normal)
    t_e, t_i = external - n_e[:, None] * normal, internal - n_i * normal
    if n_i <= TINY:  # nothing presses: the load alone has to
        inside = n_e >= -TINY if np.isinf(mu) else np.linalg.norm(t_e, axis=1) <= mu * n_e + TINY
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
