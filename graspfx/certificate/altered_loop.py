"""A linearised loop with other gains, and other numbers of its object, at the rest that it has."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeGuard

import numpy as np

from graspfx.analysis.linearisation import Linearisation
from graspfx.build.live import GAINS, numbered, value_of
from graspfx.build.numbers import general
from graspfx.certificate.linearise import Linearised
from graspfx.scene.model import Scene

FRICTION = ("coupling.friction", "finger.*.friction")
FIELDS = dict(zip(GAINS, ("external", "external_damping", "internal", "internal_damping"), strict=True))
OF_OBJECT = {
    "object.*.mass": "mass", "object.*.viscosity": "viscosity", "object.*.rotational_viscosity": "rotational_viscosity",
}  # fmt: skip


@dataclass(frozen=True)
class Change:
    """A change of a loop: factors of its gains, and numbers of its object.

    Attributes:
        external, internal: factors of the stiffness.
        external_damping, internal_damping: factors of the damping.
        mass: of the object [kg]; None where it stays.
        viscosity: [N s/m]; None where it stays.
        rotational_viscosity: [N m s]; None where it stays.
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
        """Whether the external stiffness alone changes, if anything does."""
        return self == Change(external=self.external)


def change_of(scene: Scene, name: str, values: Mapping[str, Any]) -> Change | None:
    """Give the change of an object's loop that leads from a scene to one with these values by live key.

    None where the loop changes otherwise: matrices, gains from zero, other keys of objects, hands, devices.

    Raises:
        InputError, UnknownNameError: keys that the scene does not have.
    """
    changes: dict[str, float] = {}
    for key, value in values.items():
        plain, old = general(key), value_of(scene, numbered(scene, key))
        if plain in FRICTION or old == value:
            continue  # contacts stick whatever their friction is
        if plain in FIELDS:
            if not (_is_number(old) and _is_number(value)) or old <= 0.0 or value < 0.0:
                return None
            changes[FIELDS[plain]] = value / old
        elif plain in OF_OBJECT and _is_number(value):
            if old is None:
                return None
            if _is_of(scene, key, name):
                changes[OF_OBJECT[plain]] = float(value)
        else:
            return None
    return Change(**changes)


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_of(scene: Scene, key: str, name: str) -> bool:
    """Tell whether a key of objects is of the one with this name."""
    number = numbered(scene, key).split(".")[1]
    index = int(number) if number.isdecimal() else 0
    return number == "*" or scene.object[index].name == name


def altered(scene: Scene, loop: Linearised, change: Change) -> Linearisation:
    """Give the matrices of a loop with a change, but for those of its stiffness."""
    linear = loop.linear
    table = next(each for each in scene.object if each.name == loop.objects[0])
    shifts = sum(scene.free(table)[: scene.dimensions])
    inertia, viscosity = linear.inertia.copy(), linear.viscosity.copy()
    if change.mass is not None and table.mass is not None:
        ratio = change.mass / table.mass
        inertia[:shifts, :shifts] *= ratio
        if table.inertia is None:  # the moment of a solid shape grows with its mass
            inertia[shifts:, shifts:] *= ratio
    arrays: dict[str, np.ndarray] = {"inertia": inertia}
    for value, old, first, last in (
        (change.viscosity, table.viscosity, 0, shifts),
        (change.rotational_viscosity, table.rotational_viscosity, shifts, len(viscosity)),
    ):
        if value is not None:  # what torsion adds stays
            places = np.arange(first, last)
            viscosity[places, places] += value - (old or 0.0)
    arrays["viscosity"] = viscosity
    if linear.preload is not None:
        arrays["preload"] = linear.preload * _squeeze_ratio(scene, linear, change)
    return linear.with_arrays(**arrays, damping=loop.damping(change.external_damping, change.internal_damping))


def _squeeze_ratio(scene: Scene, linear: Linearisation, change: Change) -> float:
    """Give what the squeeze becomes: that of a hand and the internal stiffness in series, closed as far as before."""
    gain = scene.coupling.internal.stiffness
    if change.internal == 1.0 or not _is_number(gain):
        return 1.0
    _, sizes, V = np.linalg.svd(linear.G)
    internal = V[int((sizes > 1e-6 * sizes.max(initial=0.0)).sum()) :]
    if not len(internal):
        return 1.0
    hand = float(np.trace(internal @ linear.hand_stiffness @ internal.T)) / len(internal)
    return change.internal * (hand + gain) / (hand + change.internal * gain)
