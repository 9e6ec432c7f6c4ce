"""Three devices of 50, 100 and 300 g wave a puck; with the metric "mass", the motion does not disturb the squeeze."""

from __future__ import annotations

import numpy as np

import graspfx as gx

MASSES = np.array([0.05, 0.1, 0.3])  # m_i [kg]
RADIUS = 0.03  # radius of the puck [m]
KIP = 400.0  # [N/m]


def scene(metric: str = "mass", pinch: float = 0.4) -> gx.Scene:
    """Make the scene, in which all stiffness and damping of a device and its hand are proportional to its mass.

    This proportionality decouples the internal and external modes. The fingers start in equilibrium: finger i has the
    penetration depth pinch/(kip M_i), and the spring of its hand, with stiffness k_i, is stretched by pinch/k_i. M_i is
    the mass of device i divided by the mean mass, or 1 for the metric "equal". The puck does not rotate, like the
    paper's cube; with rotation, the modes would decouple only approximately.

    Args:
        metric: Metric of the split into internal and external forces, "mass" or "equal".
        pinch: Force of each finger [N].
    """
    angles = np.pi * np.array([1 / 2, 7 / 6, 11 / 6])
    outward = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    M = MASSES / MASSES.mean() if metric == "mass" else np.ones(3)
    k = 2000.0 * MASSES  # 100, 200, 600 N/m
    start = (RADIUS - pinch / (KIP * M))[:, None] * outward
    rest = start - (pinch / k)[:, None] * outward
    wave = {"kind": "sine", "amplitude": 0.03, "frequency": 1.0, "axis": "x", "begin": 0.2, "ramp": 0.5}
    return gx.Scene(
        title="Three unequal devices wave a puck",
        dimensions=2,
        period=0.002,
        duration=3.0,
        object={
            "name": "puck",
            "mass": 0.1,
            "viscosity": 0.5,
            "shape": {"kind": "sphere", "radius": RADIUS},
            "free": [True, True, False],
        },
        coupling={
            "external": {"stiffness": 200.0, "damping": 0.5},
            "internal": {"stiffness": KIP, "damping": 0.5},
            "friction": "stick",
            "metric": metric,
        },
        finger=[
            {
                "name": name,
                "start": start[i].tolist(),
                "device": {"name": "simulated", "mass": m, "damping": 4.0 * m},
                "hand": {"stiffness": k[i], "damping": 40.0 * m, "rest": rest[i].tolist(), "motion": wave},
            }
            for i, (name, m) in enumerate(zip(("light", "middle", "heavy"), MASSES, strict=True))
        ],
    )
