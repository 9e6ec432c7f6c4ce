"""Draws the pictures of docs/explanation/the-paper-answered.md: `python docs/pictures/the_paper_answered.py`."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np

import graspfx as gx

HERE = Path(__file__).parent
DEVICE = {"mass": 0.15, "damping": 0.2, "period": 0.005, "spring": 33.0}
INK, RED, BLUE, GREY = "#222222", "#b5372c", "#1f5fa8", "#8a8a8a"
STYLE = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e6e6e6",
    "legend.frameon": False,
    "savefig.dpi": 130,
}


def waving() -> None:
    """Figs. 12 and 13: positions above; below, the fingers' distance and how far the object is from their middle."""
    figure, axes = plt.subplots(2, 2, figsize=(9.0, 5.0), sharex=True, sharey="row", layout="constrained")
    for (high, low), kip, title in (
        (axes[:, 0], 30.0, "Fig. 12: conventional, $k_p$ = 30 N/m"),
        (axes[:, 1], 70.0, "Fig. 13: proposed, $k_{ep}$ = 30, $k_{ip}$ = 70 N/m"),
    ):
        rec = gx.run(gx.load("paper-waving", {"coupling.internal.stiffness": kip}))
        x, p = 1e3 * rec.object_position[:, 0], 1e3 * rec.finger_position[:, :, 0]
        high.plot(rec.time, p, color=RED, lw=1.0, ls="--", label=["fingers", None])
        high.plot(rec.time, x, color=INK, lw=1.4, label="object")
        high.set_title(title, loc="left", fontsize=10)
        low.axhline(50.0, color=GREY, lw=0.8, ls=":")
        low.plot(rec.time, p[:, 1] - p[:, 0], color=INK, lw=1.4, label="between the fingers (the cube has 50)")
        low.plot(rec.time, np.abs(x - p.mean(axis=1)), color=BLUE, lw=1.0, ls="--", label="object to their middle")
        low.set(xlabel="time [s]", ylim=(-2, 62))
    axes[0, 0].set_ylabel("position [mm]")
    axes[1, 0].set_ylabel("distance [mm]")
    axes[0, 1].legend(loc="lower right", ncols=2)
    axes[1, 1].legend(loc="center right")
    axes[0, 0].set_ylim(-120, 90)
    figure.savefig(HERE / "paper-figs-12-13.png")


def largest() -> None:
    """Fig. 15, with runs 3 % beside the curve of kep."""
    b_v = np.linspace(0.8, 1.5, 71)
    kip = gx.stability.wall_limit(**DEVICE)
    kep = gx.stability.external_limit_map(**DEVICE, object_mass=0.1, object_damping=b_v, integrator="explicit")
    figure, axis = plt.subplots(figsize=(6.2, 4.0), layout="constrained")
    axis.plot(b_v, np.full_like(b_v, kip), color=BLUE, ls="--", label="$k_{ip}$, proposed")
    axis.plot(b_v, kep, color=RED, ls=":", lw=2.0, label="$k_{ep}$, proposed")
    axis.plot(b_v, np.minimum(kip, kep), color=INK, lw=1.2, label="$k_p$, conventional")
    for factor, marker, face, text in ((1.03, "^", RED, "run: grows"), (0.97, "v", "white", "run: dies out")):
        at = np.array([0.85, 1.0, 1.15, 1.3, 1.45])
        gain = factor * np.interp(at, b_v, kep)
        for k, v in zip(gain, at, strict=True):
            assert grows(k, v) == (factor > 1.0)
        axis.plot(at, gain, ls="", marker=marker, ms=6, mfc=face, mec=RED, label=text)
    axis.set(xlabel="viscosity of the object $b_v$ [N s/m]", ylabel="largest stiffness [N/m]", ylim=(0, 105))
    axis.legend(loc="lower right", ncols=2)
    figure.savefig(HERE / "paper-fig-15.png")


def grows(kep: float, b_v: float) -> bool:
    """Whether the grasp of `paper-spring` shakes itself up along the external mode."""
    changes = {"coupling.contact": "attached", "coupling.external.stiffness": kep, "object.viscosity": b_v}
    x = gx.run(gx.load("paper-spring", changes), duration=20.0).finger_position[:, :, 0].mean(axis=1)
    return bool(np.std(x[-1000:]) > np.std(x[1000:2000]))


def operators() -> None:
    """Limits of kep and kip over the stiffness of the operator's finger, and the passive limits for any operator."""
    spring = np.geomspace(10.0, 1e4, 200)
    device = {"mass": 0.15, "damping": 0.2, "period": 0.005, "spring": spring}
    figure, axis = plt.subplots(figsize=(6.2, 4.0), layout="constrained")
    axis.plot(spring, gx.stability.wall_limit_map(**device), color=BLUE, ls="--", label="$k_{ip}$")
    for integrator, style in (("explicit", "-"), ("exact", "-.")):
        limit = gx.stability.external_limit_map(**device, object_mass=0.1, object_damping=1.5, integrator=integrator)
        axis.plot(spring, limit, color=RED, ls=style, label=f"$k_{{ep}}$, {integrator}")
    for limit, color, text in (
        (80.0, BLUE, "passive $k_{ip}$: 80"),
        (gx.passivity.external_limit(0.2, 0.005, 0.75), RED, "passive $k_{ep}$, exact: 63.2"),
    ):
        axis.axhline(limit, color=color, lw=0.8, ls=":")
        axis.text(10.0, limit - 2.0, text, color=color, va="top", fontsize=8)
    axis.axvline(33.0, color=GREY, lw=0.8)
    axis.text(34.5, 6.0, "the paper's spring", color=GREY, fontsize=8)
    axis.set(xscale="log", xlabel="stiffness of the operator's finger [N/m]", ylabel="limit [N/m]", ylim=(0, 200))
    axis.legend(loc="upper right")
    figure.savefig(HERE / "paper-operators.png")


if __name__ == "__main__":
    with mpl.rc_context(STYLE):
        waving()
        largest()
        operators()
