"""Parts of others' making that do by their methods what ours do as kernels."""

from __future__ import annotations

from pathlib import Path
from typing import Any

DEVICES = '''
"""Point devices: called as methods, on a plant that is called, or failing at a tick."""
from graspfx.devices import simulated
from graspfx.errors import DeviceError

class Called(simulated.PointDevice):
    fails, ticks = None, 0

    def read(self):
        self.ticks += 1
        if self.fails is not None and self.ticks > self.fails:
            raise DeviceError("the cable is out")
        return super().read()

    def write(self, forces):
        super().write(forces)

class Plant:
    def __init__(self, real, fails):
        self.real, self.fails, self.ticks = real, fails, 0
        self.position, self.velocity, self.place = real.position, real.velocity, real.place

    def advance(self, force, hand, T):
        self.ticks += 1
        if self.fails is not None and self.ticks > self.fails:
            raise DeviceError("the finger is stuck")
        self.real.advance(force, hand, T)

class OnCalledPlant(simulated.PointDevice):
    fails = None

    @staticmethod
    def plant(devices):
        return Plant(simulated.PointDevice.plant(devices), devices[0].fails)

def connect(*, what, mass, dimensions, damping=0.0, fails=None):
    kind = {"device": Called, "plant": OnCalledPlant}[what]
    made = kind(mass=mass, damping=damping, fingers=1, dimensions=dimensions, resolution=0.0, velocity_window=1,
                delay=0, force_limit=None, workspace=None)
    made.fails = fails
    return made
'''

HANDS = '''
"""A hand that squeezes and waves: ours, or the same called as a method, which may lose its way."""
import math
from graspfx.loop.hand import Hand
from graspfx.loop.motion.motion import Sine

class Called:
    def __init__(self, real, ends):
        self.real, self.stiffness, self.damping, self.ends = real, real.stiffness, real.damping, ends

    def target(self, time):
        position, velocity = self.real.target(time)
        return (position, velocity) if time < self.ends else (position * math.nan, velocity)

def hold(rest, inward, *, called, ends=math.inf):
    axis = [1.0] + [0.0] * (rest.shape[1] - 1)
    hand = Hand.arm_and_grip(rest, arm=(60.0, 0.5), grip=(90.0, 0.3), motion=Sine(0.01, 1.5, axis), squeeze=0.004,
                             inward=inward)
    return Called(hand, ends) if called else hand
'''

BODIES = '''
"""The native body, called as methods; it may break."""
from graspfx.errors import GraspFXError
from graspfx.objects.body import NativeBody

class Called:
    fails = None

    def __init__(self, state):
        self.real, self.state, self.ticks = NativeBody(state), state, 0

    def free_motion(self, T):
        self.real.free_motion(T)

    def step(self, T):
        self.ticks += 1
        if self.fails is not None and self.ticks > self.fails:
            raise GraspFXError("the object broke")
        self.real.step(T)

def create(state):
    return Called(state)
'''
BREAKING = BODIES.replace("fails = None", "fails = 20", 1)


def write(folder: Path) -> dict[str, str]:
    """The files, by what is in them."""
    found = {}
    for name, text in (("devices", DEVICES), ("hands", HANDS), ("bodies", BODIES), ("breaking", BREAKING)):
        file = folder / f"{name}.py"
        file.write_text(text)
        found[name] = str(file)
    return found


def device(files: dict[str, str], what: str, **settings: Any) -> dict[str, Any]:
    return {"name": files["devices"], "what": what, **settings}
