"""Former names of settings of built-in drivers; scenes that use them still load, with a note."""

from __future__ import annotations

FORMER = {  # for each driver: former name and current name of a setting
    "simulated": {"friction": "damping"},
    "two-link": {"joint_friction": "joint_damping"},
}


def current(driver: object, key: str) -> str:
    """Return the current name of a driver's setting."""
    return FORMER.get(str(driver), {}).get(key, key)


def others(driver: object, key: str) -> set[str]:
    """List the other names of a driver's setting."""
    names = FORMER.get(str(driver), {})
    return {name for pair in names.items() if key in pair for name in pair} - {key}
