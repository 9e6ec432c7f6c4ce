"""Names and units of a scene's keys, for the axes of figures and the coordinates of files."""

from __future__ import annotations

UNITS = {
    "viscosity": "N s/m",
    "rotational_viscosity": "N m s/rad",
    "mass": "kg",
    "period": "s",
    "duration": "s",
    "stiffness": "N/m",
    "damping": "N s/m",
    "friction": "N s/m",
    "squeeze": "m",
    "radius": "m",
}
NAMES = {
    "object.viscosity": "viscosity of the object $b_v$",
    "object.mass": "mass of the object $m_v$",
    "object.rotational_viscosity": "rotational viscosity of the object",
    "period": "sampling period $T$",
    "finger.*.device.mass": "mass of a device $m$",
    "finger.*.device.damping": "damping of a device $b$",
    "finger.*.device.friction": "damping of a device $b$",
    "finger.*.hand.stiffness": "stiffness of a finger",
    "finger.*.hand.damping": "damping of a finger",
    "coupling.external.damping": "$k_{ed}$",
    "coupling.internal.damping": "$k_{id}$",
}
NO_UNIT = ("coupling.friction",)  # though others of the last name have one


def label_of(key: str) -> str:
    """Name a key with its unit, as far as it has a name and one."""
    unit = unit_of(key)
    return f"{NAMES.get(key, key)} [{unit}]" if unit else NAMES.get(key, key)


def unit_of(key: str) -> str:
    """Tell the unit of a key's numbers; empty where none is sure."""
    last = key.rsplit(".", 1)[-1]
    return "" if key in NO_UNIT else UNITS.get(last, "")
