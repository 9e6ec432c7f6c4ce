"""A scene with a hand in a Python file of its own, steady.py."""

from __future__ import annotations

HAND = """
import numpy as np

class Steady:
    def __init__(self, rest):
        self.rest, n = rest, len(rest)
        self.stiffness, self.damping = 60.0 * np.eye(n)[None], 0.5 * np.eye(n)[None]

    def target(self, time):
        return 0.8 * self.rest, np.zeros_like(self.rest)

def hold(rest, broken=0):
    if broken:
        raise ValueError("a broken wrist")
    return Steady(rest)
"""
SCENE = """
dimensions = 1
engine = "interpreted"
period = 0.005
duration = 0.2
object = { mass = 0.1, viscosity = 0.8, shape = { kind = "box", size = [0.05] } }
coupling = { external = { stiffness = 30.0 }, internal = { stiffness = 70.0, damping = 0.1 } }
hand = [{ name = "own", kind = "steady.py" }]
finger = [
    { start = [-0.0251], device = { name = "simulated", mass = 0.15, damping = 0.2 }, hand = "own" },
    { start = [0.0252], device = { name = "simulated", mass = 0.15, damping = 0.2 }, hand = "own" },
]
"""
