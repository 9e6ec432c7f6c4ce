"""Draws the map of docs/explanation/stability.md: `python docs/pictures/device_masses.py`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.optimize import brentq

import graspfx as gx

MASSES = (0.05, 0.1, 0.15, 0.2)  # [kg]
DASHES = ((0.0, (1.2, 1.4)), (0.0, (4.0, 1.5)), "-", (0.0, (7.0, 1.5, 1.5, 1.5)))
KIP, T, SPRING = 80.13, 0.005, 33.0  # [N/m], [s], [N/m]


def damping(mass: float) -> float:
    """Find the damping with which a device of this mass is stable up to kip [N s/m]."""
    return float(
        brentq(lambda b: gx.stability.wall_limit(mass=mass, damping=b, period=T, spring=SPRING) - KIP, 0.01, 1.0)
    )


def draw() -> None:
    b_v = np.linspace(0.8, 1.5, 71)
    with gx.style.look():
        sheet = gx.style.figure([2.6], columns=2)
        for axes, integrator in zip(sheet.panels[0], ("explicit", "exact"), strict=True):
            for mass, dashes in zip(MASSES, DASHES, strict=True):
                kep = gx.stability.external_limit_map(
                    mass, damping(mass), T, 0.1, b_v, spring=SPRING, integrator=integrator
                )
                axes.plot(b_v, kep, color=gx.style.EXTERNAL, ls=dashes, label=f"$k_{{ep}}$, {mass:g} kg")
            axes.axhline(KIP, color=gx.style.INTERNAL, ls="--", label="$k_{ip}$, all of them")
            gx.style.panel(axes, x="viscosity of the object $b_v$ [N s/m]", title=f"{integrator} steps")
        sheet.panels[0, 0].set(xlim=(0.8, 1.5), ylim=(0.0, 200.0))
        gx.style.panel(sheet.panels[0, 0], y="largest stable gain [N/m]")
        sheet.legend(0)
    gx.style.save(sheet, Path(__file__).parent / "stability.png")


if __name__ == "__main__":
    draw()
