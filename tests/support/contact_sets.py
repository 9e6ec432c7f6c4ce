"""Contacts, free directions and their rigid modes in a block of their own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from graspfx.compile.records import Many, Record, Table, many, size_for, table
from graspfx.grasp.contact_state import Contact, Freedom
from graspfx.grasp.rigid_modes import rigid_modes


class ContactSet(Record):
    """Contacts, the directions in which their object is free, and the rigid modes of both."""

    count: int
    width: int  # entries of a contact in a mode
    freedom: Freedom
    contacts: Many[Contact] = many("count")
    modes: Table = table("6", "1 + width * count")


def contact_set(
    points: np.ndarray, weights: np.ndarray | None = None, axes: np.ndarray | None = None, shifts: int | None = None,
    width: int = 3,
) -> ContactSet:  # fmt: skip
    """Build the block of contacts at points (n, d); all directions are free unless axes are named."""
    n, d = points.shape
    turns = {1: 0, 2: 1, 3: 3}[d]
    if axes is None:
        axes, shifts = np.vstack([np.eye(3)[:d], np.eye(3)[3 - turns :]]), d
    assert shifts is not None
    contacts = ContactSet(np.zeros(size_for(ContactSet, count=n, width=width)))
    contacts.count, contacts.width = n, width
    contacts.freedom.shifts, contacts.freedom.turns = shifts, len(axes) - shifts
    for k, axis in enumerate(axes):
        contacts.buffer[contacts.freedom.axes[k].offset :][:3] = axis
    contacts.contacts.array(Contact.contact)[:, :d] = points
    contacts.contacts.array(Contact.weight)[:] = 1.0 if weights is None else weights
    return contacts


def modes_of(
    contacts: ContactSet, d: int, low: float, high: float, kernel: Callable[..., Any] = rigid_modes
) -> tuple[int, int]:
    """Compute the modes; give how many, and how many rotations are not in them whole."""
    count, blended = kernel(contacts.contacts, contacts.freedom, d, low, high, contacts.width, False, contacts.modes)
    return int(count), int(blended)
