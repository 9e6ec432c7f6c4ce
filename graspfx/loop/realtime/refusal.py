"""Refusal of hardware where no clock paces the ticks."""

from __future__ import annotations

from collections.abc import Sequence

from graspfx.errors import InputError


def require_simulations(hardware: Sequence[str]) -> None:
    """Refuse hardware in a run that is not on the wall's clock.

    Args:
        hardware: the scene's devices that are no simulations, by name.

    Raises:
        InputError: there is one.
    """
    if hardware:
        raise InputError(
            "real_time", False, "True: this scene has hardware; its clock is the wall's",
            f"run it with graspfx run SCENE --real-time, or gx.run(scene, real_time=True); it is {', '.join(hardware)}",
        )  # fmt: skip
