"""What an object's grasp does with energy, watched while it runs, and braked where it makes some."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.records import start_of
from graspfx.coupling import block as at
from graspfx.coupling.grasped import GraspedObject
from graspfx.loop.energy import ledger
from graspfx.loop.energy.watch import watch
from graspfx.objects import energy
from graspfx.objects.body import NativeBody

FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]

BY_MODE = ("work", "stored", "damped", "slipped", "reshaped", "leaked", "balance", "braked", "damping")
OF_OBJECT = ("fingers", "wrench", "kinetic", "gravity", "contact", "viscous", "defect", "gap")

MET = ledger.BODY + start_of(energy.SampleStart, "contact_force")


class Observer:
    """The ledger of one object, and its brake.

    Args:
        grasped: the object and its coupling; from here on it tells elastic forces from damping.
        body: what moves it. Of a native one the work of obstacles is computed, of others it is what is left over.
        period: T [s].
        control: whether the forces of modes that leak are damped.
        friction: of each finger's device, (n,) [N s/m]; zero where it is not known.
        mass: of each finger's device, (n,) [kg]; infinite where it is not known.

    Attributes:
        buffer: beside the object's block; `watch` works on the two.
        met: of a body on planes what they did to it in the sample that has ended, (6,), to be copied to
            `buffer[MET : MET + 6]` before `watch`; else None.
        where: which entries of the buffer hold what a recording asks for.
    """

    def __init__(
        self,
        grasped: GraspedObject,
        body: Any,
        period: float,
        *,
        control: bool,
        friction: FloatArray,
        mass: FloatArray,
    ) -> None:
        self._T = period
        n, S = grasped.fingers, grasped.block
        self._S: Any = memoryview(S)
        given = grasped.matrices and not S[at.ATTACHED]
        self.buffer = B = np.zeros(ledger.size(n, n * grasped.dimensions if given else 0))
        self._B: Any = memoryview(B)
        S[at.OBSERVED] = 1.0
        share = grasped.rows[:, at.SHARE]
        native = isinstance(body, NativeBody)
        B[ledger.DRAG] = min(friction / share, default=0.0)
        B[ledger.LIGHT] = max(share / mass, default=0.0)
        B[ledger.OTHERS] = not native
        B[ledger.GIVEN] = given
        B[ledger.CONTROL] = control
        self.met: FloatArray | None = getattr(body, "contact_wrench", None) if native else None
        self.where = self._entries()

    @property
    def structure(self) -> Index:
        """Entries of `buffer` that never change and choose what is computed."""
        fixed = [ledger.OTHERS, ledger.GIVEN, ledger.CONTROL]
        return np.array(fixed if self.buffer[ledger.DRAG] else [ledger.DRAG, *fixed], dtype=np.intp)

    def sample(self) -> None:
        """Books the sample that has ended, brakes if asked to, and keeps what the next one holds."""
        if self.met is not None:
            self.buffer[MET : MET + 6] = self.met
        watch(self._S, self._B, self._T)

    def _entries(self) -> dict[str, Index]:
        """Which entries of the buffer hold what a recording asks for."""
        o = ledger.OUT
        found = {name: np.arange(o + 3 * k, o + 3 * k + 3) for k, name in enumerate(BY_MODE)}
        o += 3 * len(BY_MODE)
        return found | {name: np.array([o + k]) for k, name in enumerate(OF_OBJECT)}
