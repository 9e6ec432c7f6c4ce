"""Force components of a contact: frictionless, hard, soft, full, or a selection matrix."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.errors import InputError, UnknownNameError
from graspfx.numeric import finite

FloatArray = NDArray[np.float64]

MODELS = ("frictionless", "hard", "soft", "full")
ALIASES = {  # names in the literature: Prattichizzo and Trinkle; Murray, Li and Sastry; SynGrasp
    "pcwof": "frictionless", "pwof": "frictionless", "fpc": "frictionless",
    "pcwf": "hard", "hf": "hard", "hard finger": "hard", "point": "hard",
    "sf": "soft", "sfc": "soft", "soft finger": "soft", "full contact": "full",
}  # fmt: skip
SELECTION = "selection"  # name of a model that is a matrix
Model = str | ArrayLike
MOMENTS = {1: 0, 2: 1, 3: 3}  # number of moments of a wrench: none on the line, t_z in the plane, three in space
UNIT = 1e-8  # tolerance for orthonormal frames, and for a frame's last axis to equal the normal


@dataclass(frozen=True, eq=False)
class Contacts:
    """n contacts in d dimensions, and m force components of the contacts, ordered by contact, forces before moments.

    | model | line | plane | space |
    |---|---|---|---|
    | frictionless | f_n | f_n | f_n |
    | hard | f | f_x f_y | f_x f_y f_z |
    | soft | as hard | as hard | hard, and the torsion about the normal |
    | full | as hard | hard, and t_z | hard, and t_x t_y t_z |

    A model may also be a selection matrix (k, d + moments). Each row defines a component by coefficients of the full
    model's components in the contact's axes, forces before moments. Rows are orthonormal. A row contains either only
    forces or only moments, and rows of forces precede rows of moments.

    In the plane and on the line there is no torsion about the normal, so a soft contact equals a hard contact. The axes
    of contacts are the world's axes unless frames are given.

    Leading array axes index many sets of n contacts with the same models.

    Attributes:
        points: Contact points, (..., n, d) [m].
        normals: Unit normals into the object, (..., n, d), or None.
        models: Names of the n models, "selection" for a matrix.
        finger: Index of the contact of each component, (m,).
        moment: Mask of the components that are moments [N m], (m,).
        force_axes: Unit direction of each force component, (m, d) or (..., m, d); zero for a moment.
        moment_axes: Unit axis of each moment component, (m, 0 | 1 | 3) or (..., m, 0 | 1 | 3); zero for a force.
    """

    points: FloatArray
    normals: FloatArray | None
    models: tuple[str, ...]
    finger: NDArray[np.int64]
    moment: NDArray[np.bool_]
    force_axes: FloatArray
    moment_axes: FloatArray


def contacts(
    points: ArrayLike,
    normals: ArrayLike | None = None,
    *,
    model: Model | Sequence[Model] = "hard",
    frames: ArrayLike | None = None,
) -> Contacts:
    """Check contacts and compute their force components.

    Args:
        points: Contact points, (n, d) [m] with d = 1, 2 or 3, or many sets of points, (..., n, d).
        normals: Normals into the object of any non-zero length, (n, d) or (..., n, d). Without frames, normals are
            required for frictionless contacts, and for soft contacts in space.
        model: Name or selection matrix, one for all contacts or one per contact.
        frames: Axes of each contact as orthonormal columns, (n, d, d) or (..., n, d, d); the last column is the normal
            into the object.

    Raises:
        InputError: If shapes are inconsistent, values are not finite, a normal is missing or zero, frames are not
            orthonormal, or the last axis of a frame is not the normal.
        UnknownNameError: If no model has that name.
    """
    p = contact_points(points)
    n, d = p.shape[-2:]
    models = _models(model, n)
    names = tuple(each if isinstance(each, str) else SELECTION for each in models)
    selections = {i: _selection(each, d, f"model[{i}]") for i, each in enumerate(models) if not isinstance(each, str)}
    unit = None if normals is None else unit_normals(normals, p.shape)
    axes = None if frames is None else _axes(frames, unit, p.shape)
    if axes is not None and unit is None:
        unit = axes[..., -1]
    if axes is None and all(name == "hard" for name in names):
        return point_contacts(p, unit)
    finger: list[int] = []
    moment: list[bool] = []
    force_axes: list[FloatArray] = []
    moment_axes: list[FloatArray] = []
    for i, name in enumerate(names):
        own = np.eye(d) if axes is None else np.swapaxes(axes[..., i, :, :], -1, -2)  # rows are the contact's axes
        if name == SELECTION:
            forces, moments = _selected(selections[i], d, own)
        else:
            forces, moments = _components(name, d, own, None if unit is None else unit[..., i, :], i)
        pushes, turns = forces.shape[-2], moments.shape[-2]
        force_axes += [forces, np.zeros((turns, d))]
        moment_axes += [np.zeros((pushes, MOMENTS[d])), moments]
        finger += [i] * (pushes + turns)
        moment += [False] * pushes + [True] * turns
    return Contacts(p, unit, names, np.array(finger), np.array(moment), _stacked(force_axes), _stacked(moment_axes))


def contact_points(points: ArrayLike) -> FloatArray:
    """Check contact points (..., n, d), and copy them.

    Raises:
        InputError: If the shape is wrong, or values are not finite.
    """
    p = finite("points", points)
    if p.ndim < 2 or not p.size or p.shape[-1] not in MOMENTS:
        raise InputError("points", p, "an array (n, d) with n > 0 and d = 1, 2 or 3, or many sets (..., n, d)")
    return p


def point_contacts(points: FloatArray, normals: FloatArray | None = None) -> Contacts:
    """Return the components of hard contacts in world axes, without checks."""
    n, d = points.shape[-2:]
    force = np.tile(np.eye(d), (n, 1))
    none = np.zeros(n * d, dtype=bool)
    return Contacts(
        points, normals, ("hard",) * n, np.repeat(np.arange(n), d), none, force, np.zeros((n * d, MOMENTS[d]))
    )


def _stacked(rows: Sequence[FloatArray]) -> FloatArray:
    """Stack arrays of row vectors (..., k, d) along k.

    An array without leading axes applies to all sets of contacts.
    """
    sets = np.broadcast_shapes(*(each.shape[:-2] for each in rows))
    return np.concatenate([np.broadcast_to(each, (*sets, *each.shape[-2:])) for each in rows], axis=-2)


def _models(model: Model | Sequence[Model], n: int) -> tuple[Model, ...]:
    models: tuple[Model, ...]
    if isinstance(model, str):
        models = (model,) * n
    else:
        try:
            items = list(cast("Sequence[Model]", model))
            one = bool(items) and all(not isinstance(item, str) and np.ndim(item) < 2 for item in items)
        except (TypeError, ValueError) as error:
            expected = f"one of {', '.join(MODELS)}, a selection matrix, or one for each contact"
            raise InputError("model", model, expected) from error
        models = (cast("Model", model),) * n if one else tuple(items)
    models = tuple(ALIASES.get(name.lower(), name) if isinstance(name, str) else name for name in models)
    for name in models:
        if isinstance(name, str) and name not in MODELS:
            raise UnknownNameError("contact model", name, MODELS)
    if len(models) != n:
        raise InputError("model", model, f"one name or matrix, or one for each of the {n} contacts")
    return models


def _selection(selection: Model, d: int, name: str) -> FloatArray:
    S = finite(name, selection)
    whole = d + MOMENTS[d]
    if S.ndim != 2 or S.shape[1] != whole or not 0 < S.shape[0] <= whole:
        columns = f"{d} forces and {MOMENTS[d]} moments" if MOMENTS[d] else "the force"
        raise InputError(name, S, f"a selection matrix (k, {whole}) with columns for {columns} in the contact's axes")
    pulls, turns = np.abs(S[:, :d]).max(axis=1) > 0.0, np.abs(S[:, d:]).max(axis=1, initial=0.0) > 0.0
    if (pulls & turns).any():
        raise InputError(
            name,
            S[pulls & turns][0].tolist(),
            "rows that contain only forces or only moments",
            "a force and a moment have different units and cannot be added",
        )
    if (np.diff(turns.astype(int)) < 0).any():
        raise InputError(name, S.tolist(), "rows of forces before rows of moments")
    error = np.abs(S @ S.T - np.eye(len(S))).max()
    if error > UNIT:
        raise InputError(name, S.tolist(), "orthonormal rows", f"the largest error is {error:.1e}")
    return S


def _selected(S: FloatArray, d: int, own: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return directions of forces and axes of moments, as `_components` does, for a selection matrix.

    The rows of `own` are the axes of the contact.
    """
    forces = np.abs(S[:, :d]).max(axis=1) > 0.0
    return S[forces, :d] @ own, S[~forces, d:] @ (own if d == 3 else np.eye(MOMENTS[d]))


def unit_normals(normals: ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    """Scale normals to unit length; normals of a single set apply to all sets of contacts."""
    vectors = finite("normals", normals, largest=np.inf)
    if vectors.shape not in (shape, shape[-2:]):
        raise InputError("normals", vectors, f"an array of shape {shape}, one normal for each point")
    largest = np.abs(vectors).max(axis=-1, keepdims=True)
    if not (largest > 0.0).all():
        place = _place(largest[..., 0], np.argmin)
        raise InputError(
            _name("normals", place), vectors[place].tolist(), "a direction", "a zero vector has no direction"
        )
    scaled = vectors / largest  # squares of tiny components would underflow
    return np.broadcast_to(scaled / np.linalg.norm(scaled, axis=-1, keepdims=True), shape)


def _place(of: FloatArray, extreme: Callable[[FloatArray], np.intp]) -> tuple[int, ...]:
    return tuple(int(i) for i in np.unravel_index(extreme(of), of.shape))


def _name(name: str, place: tuple[int, ...]) -> str:
    return f"{name}[{', '.join(map(str, place))}]"


def _axes(frames: ArrayLike, unit: FloatArray | None, shape: tuple[int, ...]) -> FloatArray:
    d = shape[-1]
    axes = finite("frames", frames)
    if axes.shape not in ((*shape, d), (*shape[-2:], d)):
        raise InputError("frames", axes, f"an array of shape {(*shape, d)}, each contact's axes as columns")
    axes = np.broadcast_to(axes, (*shape, d))
    error = np.abs(np.swapaxes(axes, -1, -2) @ axes - np.eye(d)).max(axis=(-1, -2))
    if error.max() > UNIT:
        i = _place(error, np.argmax)
        do = f"the largest error is {error[i]:.1e}"
        raise InputError(_name("frames", i), axes[i].tolist(), "orthonormal columns", do)
    if unit is not None:
        error = np.abs(axes[..., -1] - unit).max(axis=-1)
        if error.max() > UNIT:
            i = _place(error, np.argmax)
            raise InputError(
                _name("frames", i), axes[i].tolist(), f"the normal {unit[i].tolist()} as its last column",
                "the columns are the axes, and the normal points into the object",
            )  # fmt: skip
    return axes


def _components(name: str, d: int, own: FloatArray, normal: FloatArray | None, i: int) -> tuple[FloatArray, FloatArray]:
    """Return directions of a contact's forces (..., k, d) and axes of its moments (..., l, 0 | 1 | 3)."""
    along = name == "frictionless" or (name == "soft" and d == 3)
    if along and normal is None:
        raise InputError(
            "normals",
            None,
            f"a normal for contact {i}, which is {name}",
            "give normals (n, d) into the object, or frames",
        )
    none = np.zeros((0, MOMENTS[d]))
    if name == "frictionless":
        return np.asarray(normal)[..., None, :], none
    if name == "soft" and d == 3:
        return own, np.asarray(normal)[..., None, :]
    if name == "full" and d > 1:
        return own, own if d == 3 else np.ones((1, 1))
    return own, none
