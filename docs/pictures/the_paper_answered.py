"""Draws the pictures of docs/explanation/the-paper-answered.md: `python docs/pictures/the_paper_answered.py`."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import graspfx as gx

HERE = Path(__file__).parent
DEVICE = {"mass": 0.15, "damping": 0.2, "period": 0.005, "spring": 33.0}


def waving() -> None:
    """Draw Figs. 12 and 13 in the figure of a run."""
    kp, both = (gx.run("paper-waving", {"coupling.internal.stiffness": kip}) for kip in (30.0, 70.0))
    titles = ["Fig. 12: $k_p$ = 30 N/m", "Fig. 13: $k_{ep}$ = 30, $k_{ip}$ = 70 N/m"]
    kp.plot(both, titles=titles).save(HERE / "paper-figs-12-13.png")


def largest() -> None:
    """Draw Fig. 15, with runs 3 % above and below the curve of kep."""
    b_v = np.linspace(0.8, 1.5, 71)
    kip = gx.stability.wall_limit(**DEVICE)
    kep = gx.stability.external_limit_map(**DEVICE, object_mass=0.1, object_damping=b_v, integrator="explicit")
    with gx.style.look():
        sheet = gx.style.figure([3.0])
        axes = sheet.panels[0, 0]
        axes.plot(b_v, np.minimum(kip, kep), color=gx.style.PALE, lw=6.0, label="$k_p$, equal gains")
        axes.plot(b_v, np.full_like(b_v, kip), color=gx.style.INTERNAL, ls="--", label="$k_{ip}$, internal")
        axes.plot(b_v, kep, color=gx.style.EXTERNAL, label="$k_{ep}$, external")
        for factor, marker, face, text in (
            (1.03, "^", gx.style.EXTERNAL, "a run grows"),
            (0.97, "v", "white", "it dies out"),
        ):
            at = np.array([0.85, 1.0, 1.15, 1.3, 1.45])
            gain = factor * np.interp(at, b_v, kep)
            for k, v in zip(gain, at, strict=True):
                assert grows(k, v) == (factor > 1.0)
            axes.plot(at, gain, ls="", marker=marker, ms=6.0, mfc=face, mec=gx.style.EXTERNAL, label=text)
        axes.set(ylim=(0.0, 105.0), xlim=(0.8, 1.5))
        gx.style.panel(axes, x="viscosity of the object $b_v$ [N s/m]", y="largest stable gain [N/m]")
        sheet.legend(0)
    gx.style.save(sheet, HERE / "paper-fig-15.png")


def grows(kep: float, b_v: float) -> bool:
    """Return whether the external mode of `paper-spring` grows."""
    changes = {"coupling.contact": "attached", "coupling.external.stiffness": kep, "object.viscosity": b_v}
    x = gx.run("paper-spring", changes, duration=20.0).finger_position[:, :, 0].mean(axis=1)
    return bool(np.std(x[-1000:]) > np.std(x[1000:2000]))


def operators() -> None:
    """Draw limits of kep and kip over the stiffness of the operator's finger, and the passive limits."""
    spring = np.geomspace(10.0, 1e4, 200)
    device = {"mass": 0.15, "damping": 0.2, "period": 0.005, "spring": spring}
    with gx.style.look():
        sheet = gx.style.figure([3.0])
        axes = sheet.panels[0, 0]
        axes.axvline(33.0, color=gx.style.NEUTRAL, lw=0.8, label="the paper's spring")
        axes.plot(spring, gx.stability.wall_limit_map(**device), color=gx.style.INTERNAL, label="$k_{ip}$")
        for integrator, style in (("explicit", "-"), ("exact", "-.")):
            limit = gx.stability.external_limit_map(
                **device, object_mass=0.1, object_damping=1.5, integrator=integrator
            )
            axes.plot(spring, limit, color=gx.style.EXTERNAL, ls=style, label=f"$k_{{ep}}$, {integrator}")
        passive = gx.passivity.external_limit(0.2, 0.005, 0.75)
        axes.axhline(80.0, color=gx.style.INTERNAL, lw=1.0, ls=":", label="$k_{ip}$, passive")
        axes.axhline(passive, color=gx.style.EXTERNAL, lw=1.0, ls=":", label="$k_{ep}$, exact, passive")
        axes.set(xscale="log", xlim=(10.0, 1e4), ylim=(0.0, 200.0))
        gx.style.panel(axes, x="stiffness of the operator's finger [N/m]", y="limit [N/m]")
        sheet.legend(0)
    gx.style.save(sheet, HERE / "paper-operators.png")


if __name__ == "__main__":
    waving()
    largest()
    operators()
