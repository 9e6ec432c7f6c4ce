"""Stability limits of the internal, external and conventional gain, as functions of one or two keys of a scene."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.analysis.blas_threads import one_blas_thread
from graspfx.analysis.sampled_plant import Plant
from graspfx.analysis.stability.modes import COMMUTING, common_axes
from graspfx.certificate.certificate import plain
from graspfx.certificate.first_loss import Line, WholeLoop, reach
from graspfx.certificate.linearise import Linearised, linearise
from graspfx.certificate.mode_limits import mode_limits, reduced
from graspfx.errors import InputError
from graspfx.progress import waiting
from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]

MOST_POINTS = 10_000_000
MOST_SCENES = 20_000  # largest number of scenes that are created one by one

# keys that are parameters of a closed form; without a preload a gain changes neither its own limit nor that of the
# other gain
MODAL = {
    "period": "T",
    "object.mass": "m_v",
    "object.viscosity": "b_v",
    "object.rotational_viscosity": "b_w",
    "coupling.external.damping": "ked",
    "coupling.internal.damping": "kid",
    "coupling.external.stiffness": "",
    "coupling.internal.stiffness": "",
    "finger.*.device.mass": "m",
    "finger.*.device.damping": "b",
    "finger.*.device.friction": "b",
    "finger.*.hand.stiffness": "k_s",
    "finger.*.hand.damping": "b_s",
}


@dataclass(frozen=True)
class Sweep:
    """Values of one key of a scene for which limits are computed."""

    key: str
    values: FloatArray

    @classmethod
    def read(cls, text: str) -> Sweep:
        """Parse a text KEY=FROM:TO:COUNT: `COUNT` evenly spaced values, including both ends.

        Raises:
            InputError: If the text has another form, or the ends or the number of values are out of range.
        """
        form = "KEY=FROM:TO:COUNT, as in object.viscosity=0.8:1.5:15"
        key, equals, span = text.partition("=")
        parts = span.split(":")
        if not key.strip() or not equals or len(parts) != 3:
            raise InputError("--sweep", text, form)
        try:
            first, last, count = float(parts[0]), float(parts[1]), int(parts[2])
        except ValueError as error:
            raise InputError("--sweep", text, form) from error
        if not (math.isfinite(first) and math.isfinite(last)) or not 1 <= count <= MOST_POINTS:
            raise InputError("--sweep", text, f"finite ends and from 1 to {MOST_POINTS:,} values")
        if count > 1 and not last > first:
            raise InputError("--sweep", text, "an upper end above the lower end")
        return cls(key.strip(), np.linspace(first, last, count))


@dataclass(frozen=True, eq=False)
class SweptLimits:
    """Stability limits for all values of one or two keys.

    The arrays of limits have the shape () without a sweep, (n,) for one sweep and (n1, n2) for two sweeps. A limit is
    inf if every gain is stable.

    Attributes:
        sweeps: Keys and their values; empty for the unchanged scene.
        internal: Limits of kip with the scene's kep [N/m].
        external: Limits of kep with the scene's kip, for translations and rotations together [N/m].
        conventional: Limits of a single gain kp = kep = kip [N/m].
        modal: Whether the limits were computed in closed form from separate modes. Otherwise, the scene was linearised
            for each point.
        seconds: Computing time [s].
    """

    sweeps: tuple[Sweep, ...]
    internal: FloatArray
    external: FloatArray
    conventional: FloatArray
    modal: bool
    seconds: float

    def to_dict(self) -> dict[str, Any]:
        """Return the limits as data for JSON; inf is replaced by None."""
        values = [sweep.values.tolist() for sweep in self.sweeps]
        table = {"keys": [s.key for s in self.sweeps], "sweep": values[0] if len(values) == 1 else values}
        return table | {f"{name}_limit": plain(part) for name, part in self._parts()}

    def lines(self) -> Iterator[str]:
        """Yield lines of text: the keys, the first, last, smallest and largest value of each limit, and the method."""
        for sweep in self.sweeps:
            yield f"{sweep.key} from {sweep.values[0]:g} to {sweep.values[-1]:g}, {len(sweep.values)} values"
        for name, part in self._parts():
            first, last = (f"{v:.4g}" if v < math.inf else "no limit" for v in (part.flat[0], part.flat[-1]))
            finite = part[part < math.inf]
            span = f", within {finite.min():.4g} ... {finite.max():.4g} N/m" if finite.size else ""
            yield f"  {name:<13} {first} -> {last}{span}"
        how = "modes in closed form" if self.modal else "a scene linearised for each point"
        yield f"  {self.internal.size} points, {how}, {self.seconds:.2g} s"

    def _parts(self) -> list[tuple[str, FloatArray]]:
        return [("internal", self.internal), ("external", self.external), ("conventional", self.conventional)]


@one_blas_thread()
def swept_limits(scene: Scene, sweeps: Sequence[Sweep], at: str = "squeezed") -> SweptLimits:
    """Compute the stability limits of a scene with one grasped object, for all values of one or two keys.

    If the modes are separate and the keys are parameters of the closed forms of their limits, these formulas are
    evaluated for all points at once. Otherwise, the scene is linearised for each point.

    Args:
        scene: Scene.
        sweeps: One or two keys with their values.
        at: State about which the scene is linearised, as for `linearise`.

    Raises:
        InputError: If there are no sweeps or more than two; there are too many points; the scene has several grasped
            objects; a key occurs twice; or a gain is not a positive number.
        SceneError: If the scene does not accept a key, or a value at an end of the range.
    """
    if not 1 <= len(sweeps) <= 2:
        raise InputError("--sweep", len(sweeps), "one or two sweeps")
    if len({sweep.key for sweep in sweeps}) < len(sweeps):
        raise InputError("--sweep", sweeps[0].key, "two different keys")
    points = math.prod(len(sweep.values) for sweep in sweeps)
    if points > MOST_POINTS:
        raise InputError("--sweep", points, f"at most {MOST_POINTS:,} points")
    corners = list(product(*({float(s.values[0]), float(s.values[-1])} for s in sweeps)))
    ends = [scene.replace(_overrides(sweeps, corner)) for corner in corners]
    _require_numbers(ends[0])
    began = perf_counter()
    loop = linearise(ends[0], at)
    if all(_is_modal(made_from, sweeps, linearise(made_from, at)) for made_from in ends):
        limits = _modal(ends[0], loop, sweeps)
        if limits is not None:
            return SweptLimits(tuple(sweeps), *limits, True, perf_counter() - began)
    if points > MOST_SCENES:
        keys = ", ".join(sweep.key for sweep in sweeps)
        raise InputError(
            "--sweep", points, f"at most {MOST_SCENES:,} points over {keys}", "the scene is linearised for each point"
        )
    shape = tuple(len(sweep.values) for sweep in sweeps)
    rows = []
    with waiting(f"sweeping {' and '.join(sweep.key for sweep in sweeps)}", points, "points") as wait:
        for values in product(*(sweep.values.tolist() for sweep in sweeps)):
            rows.append(_point(scene.replace(_overrides(sweeps, values)), at))
            wait.done += 1
    internal, external, conventional = (np.array(column).reshape(shape) for column in zip(*rows, strict=True))
    return SweptLimits(tuple(sweeps), internal, external, conventional, False, perf_counter() - began)


@one_blas_thread()
def limits_of_scene(scene: Scene, at: str = "squeezed") -> SweptLimits:
    """Compute the stability limits of an unchanged scene; the arrays of limits have the shape ()."""
    _require_numbers(scene)
    began = perf_counter()
    internal, external, conventional = (np.array(value) for value in _point(scene, at))
    return SweptLimits((), internal, external, conventional, False, perf_counter() - began)


def _overrides(sweeps: Sequence[Sweep], values: Sequence[float]) -> Mapping[str, Any]:
    return {sweep.key: value for sweep, value in zip(sweeps, values, strict=True)}


def _require_numbers(scene: Scene) -> None:
    for name, part in (("external", scene.coupling.external), ("internal", scene.coupling.internal)):
        if not isinstance(part.stiffness, int | float) or part.stiffness <= 0.0:
            raise InputError(
                f"coupling.{name}.stiffness", part.stiffness, "one positive number, for a limit of this gain"
            )
    if len(set(scene.finger_objects)) > 1:
        raise InputError(
            "scene", len(scene.object), "one grasped object", "`graspfx check` computes the limits of each"
        )


def _point(scene: Scene, at: str) -> tuple[float, float, float]:
    loop = linearise(scene, at)
    rows = {row.mode: row for row in mode_limits(scene, loop, halves=False, compare=False)}
    internal, external = (rows[name].limit if name in rows else math.inf for name in ("internal", "external"))
    if all(row.exact for row in rows.values()):
        return internal, external, min(internal, external)
    unit = float(loop.linear.mass.mean()) / scene.period**2 / 100.0
    # from one hundredth of the limit of a bare mass: the first loss above the stable gains
    stiffness = loop.conventional(1.0)
    if loop.pads is None:
        line = Line(np.zeros_like(stiffness), unit * stiffness)
        edge = reach(WholeLoop(loop.linear, [stiffness]), line)
    else:
        edge = reach(loop.linear, lambda s: loop.conventional(s * unit))
    return internal, external, unit * edge.factor


def _is_modal(scene: Scene, sweeps: Sequence[Sweep], loop: Linearised) -> bool:
    keys = [_of_lone_object(scene, sweep.key) for sweep in sweeps]
    point = all(not isinstance(f.device, str) and f.device.name == "simulated" for f in scene.finger)
    devices = any(key.startswith("finger.*.device") for key in keys)
    if "period" in keys and loop.linear.latency.any():
        return False  # a fixed lateness is a different fraction of each period
    return all(key in MODAL for key in keys) and (point or not devices) and bool(reduced(loop))


def _of_lone_object(scene: Scene, key: str) -> str:
    """Return a key without the number or `*` of the object if the scene has one object, such as object.mass."""
    first, *rest = key.split(".")
    if first == "object" and len(scene.object) == 1 and rest and rest[0] in ("0", "*"):
        rest = rest[1:]
    return ".".join([first, *rest])


def _modal(scene: Scene, loop: Linearised, sweeps: Sequence[Sweep]) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Compute the internal, external and conventional limits at all points from the closed forms of separate modes.

    The object contributes the inertia m_v t_i + J_i and the viscosity b_v t_i + b_w w_i to external mode i. Here m_v is
    the mass, b_v the viscosity and b_w the rotational viscosity of the object, which the sweeps may change; t_i, J_i
    and w_i do not depend on them, except that J_i is proportional to the mass if the shape determines it.

    The result is None if the modes are not separate.
    """
    linear, table = loop.linear, scene.object[scene.finger_objects[0]]
    m, r = linear.coordinates
    root = np.sqrt(linear.mass / linear.mass.mean())
    left, sizes, _ = np.linalg.svd(linear.G * root)
    shifts = sum(scene.free(table)[: scene.dimensions])
    of_shifts, of_turns = np.diag(np.arange(r) < shifts).astype(float), np.diag(np.arange(r) >= shifts).astype(float)
    per_root = left @ np.diag(1.0 / sizes) @ left.T
    m_v = float(linear.inertia[0, 0]) if shifts else 1.0
    parts = [per_root @ A @ per_root for A in (of_shifts, linear.inertia - m_v * of_shifts, of_turns)]
    turn = common_axes(parts, COMMUTING) if r else np.zeros((0, 0))
    if turn is None:
        return None
    t, J, w = (np.diag(turn.T @ A @ turn) for A in parts)
    values: dict[str, Any] = {
        "T": linear.period,
        "m_v": m_v,
        "b_v": table.viscosity,
        "b_w": table.rotational_viscosity or 0.0,
        "ked": float(np.asarray(scene.coupling.external.damping)),
        "kid": float(np.asarray(scene.coupling.internal.damping)),
        "m": float(linear.mass.mean()),
        "b": float((linear.friction / root**2).mean()),
        "k_s": float(np.trace(linear.hand_stiffness / np.outer(root, root))) / m,
        "b_s": float(np.trace(linear.hand_damping / np.outer(root, root))) / m,
    }
    for axis, sweep in enumerate(sweeps):
        name = MODAL[_of_lone_object(scene, sweep.key)]
        shape = [1] * len(sweeps)
        shape[axis] = -1
        if name:
            values[name] = sweep.values.reshape(shape)
    whole = tuple(len(sweep.values) for sweep in sweeps)
    # the moment of inertia of a solid shape is proportional to its mass
    growth = values["m_v"] / m_v if table.inertia is None else 1.0
    internal, external = np.full(whole, math.inf), np.full(whole, math.inf)
    device = Plant(
        values["m"], values["b"], values["T"], values["k_s"], values["b_s"],
        delay=int(linear.delay[0]), latency=float(linear.latency[0]), integrator=linear.integrator,
    )  # fmt: skip
    if m > r:
        internal[...] = replace(device, coupling_damping=values["kid"]).checked().limit_map()
    device = replace(device, coupling_damping=values["ked"])
    for t_i, J_i, w_i in np.unique(np.round(np.stack([t, J, w], axis=1), 14), axis=0):
        M, B = values["m_v"] * t_i + growth * J_i, values["b_v"] * t_i + values["b_w"] * w_i
        np.minimum(external, replace(device, object_mass=M, object_damping=B).checked().limit_map(), out=external)
    return internal, external, np.minimum(internal, external)
