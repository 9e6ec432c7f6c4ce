"""Former names of the settings of GraspFX's own drivers: scenes that have them are still read, and a note says so."""

from __future__ import annotations

FORMER = {  # by driver: the former name of a setting and its name now
    "simulated": {"friction": "damping"},
    "two-link": {"joint_friction": "joint_damping"},
}


def current(driver: object, key: str) -> str:
    """Give the name that a driver's setting has now."""
    return FORMER.get(str(driver), {}).get(key, key)


def others(driver: object, key: str) -> set[str]:
    """List the other names of a driver's setting."""
    names = FORMER.get(str(driver), {})
    return {name for pair in names.items() if key in pair for name in pair} - {key}
