"""Reading of a scene's tables, whether they have just been checked or come from the cache."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from graspfx.scene.tables.part_tables import Coupling, Finger, Object
    from graspfx.scene.tables.record_table import Record

WIDTHS = {1: 1, 2: 3, 3: 6}  # w, the freedoms of an object
AXES = {"x": 0, "y": 1, "z": 2}


def listed(value: Any) -> tuple[Any, ...]:
    """List the tables of a field that takes one or a list of them."""
    if value is None:
        return ()
    return value if isinstance(value, tuple) else (value,)


class Readable:
    """Properties that follow from a whole scene's fields."""

    if TYPE_CHECKING:
        dimensions: int
        object: tuple[Object, ...]
        coupling: Coupling
        finger: tuple[Finger, ...]
        record: Record

    @property
    def finger_names(self) -> tuple[str, ...]:
        """Each finger's name, or finger0, finger1, ..."""
        return tuple(finger.name or f"finger{i}" for i, finger in enumerate(self.finger))

    @property
    def finger_objects(self) -> tuple[int, ...]:
        """Which object each finger touches, by index."""
        numbers = {thing.name: i for i, thing in enumerate(self.object)}
        return tuple(numbers[finger.object] if finger.object else 0 for finger in self.finger)

    @property
    def coefficients(self) -> tuple[float, ...]:
        """Each finger's coefficient of friction; 0 where it slips freely or sticks."""
        shared = self.coupling.friction
        if isinstance(shared, str) or self.coupling.contact == "attached":
            return (0.0,) * len(self.finger)
        return tuple(shared if finger.friction is None else finger.friction for finger in self.finger)

    def free(self, thing: Object) -> tuple[bool, ...]:
        """Tell which of an object's w freedoms move."""
        return thing.free if thing.free is not None else (True,) * WIDTHS[self.dimensions]

    def turns(self, thing: Object) -> bool:
        """Tell whether a rotation of an object is free."""
        return any(self.free(thing)[self.dimensions :])
