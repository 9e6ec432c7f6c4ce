"""Properties of a scene that are computed from its tables, for validated scenes and for scenes from the cache."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from graspfx.scene.tables.part_tables import Coupling, Finger, Object, Record

WIDTHS = {1: 1, 2: 3, 3: 6}  # number w of an object's freedoms, by dimension
AXES = {"x": 0, "y": 1, "z": 2}


def listed(value: Any) -> tuple[Any, ...]:
    """Return the value of a field that is a table or a tuple of tables as a tuple; empty for None."""
    if value is None:
        return ()
    return value if isinstance(value, tuple) else (value,)


class Readable:
    """Properties that are computed from the fields of a complete scene."""

    if TYPE_CHECKING:
        dimensions: int
        object: tuple[Object, ...]
        coupling: Coupling
        finger: tuple[Finger, ...]
        record: Record

    @property
    def finger_names(self) -> tuple[str, ...]:
        """Name of each finger; finger0, finger1, ... for fingers without a name."""
        return tuple(finger.name or f"finger{i}" for i, finger in enumerate(self.finger))

    @property
    def finger_objects(self) -> tuple[int, ...]:
        """Index of the object that each finger touches."""
        numbers = {thing.name: i for i, thing in enumerate(self.object)}
        return tuple(numbers[finger.object] if finger.object else 0 for finger in self.finger)

    @property
    def coefficients(self) -> tuple[float, ...]:
        """Coefficient of friction of each finger; 0 for slip without friction, and if fingers stick or are attached."""
        shared = self.coupling.friction
        if isinstance(shared, str) or self.coupling.contact == "attached":
            return (0.0,) * len(self.finger)
        return tuple(shared if finger.friction is None else finger.friction for finger in self.finger)

    def free(self, thing: Object) -> tuple[bool, ...]:
        """Return the mask (w,) of the free degrees of freedom of an object."""
        return thing.free if thing.free is not None else (True,) * WIDTHS[self.dimensions]

    def turns(self, thing: Object) -> bool:
        """Return whether at least one rotation of an object is free."""
        return any(self.free(thing)[self.dimensions :])
