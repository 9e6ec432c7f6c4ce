"""What an object's grasp does with energy, watched while it runs, and braked where it makes some."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.coupling import block as at
from graspfx.coupling.grasped import GraspedObject
from graspfx.loop import brake, ledger
from graspfx.objects import energy
from graspfx.objects.body import NativeBody

FloatArray = NDArray[np.float64]

BY_MODE = ("work", "stored", "damped", "slipped", "reshaped", "leaked", "balance", "braked", "damping")
OF_OBJECT = ("fingers", "wrench", "kinetic", "gravity", "contact", "viscous", "defect", "gap")

MET = ledger.BODY + energy.CONTACT


class Observer:
    """The ledger of one object, and its brake.

    Args:
        grasped: the object and its coupling; from here on it tells elastic forces from damping.
        body: what moves it. Of a native one the work of obstacles is computed, of others it is what is left over.
        period: T [s].
        control: whether the forces of modes that leak are damped.
        friction: of each finger's device, (n,) [N s/m]; zero where it is not known.
        mass: of each finger's device, (n,) [kg]; infinite where it is not known.
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
        self.control = control
        self._grasped, self._T = grasped, period
        n = grasped.fingers
        S = grasped.block
        self._S: Any = memoryview(S)
        self.buffer = B = np.zeros(ledger.size(n))
        self._B: Any = memoryview(B)
        S[at.OBSERVED] = 1.0
        share = grasped.rows[:, at.SHARE]
        B[ledger.DRAG] = min(friction / share, default=0.0)
        B[ledger.LIGHT] = max(share / mass, default=0.0)
        B[ledger.OTHERS] = not isinstance(body, NativeBody)
        B[ledger.GIVEN] = grasped.matrices and not S[at.ATTACHED]
        native = isinstance(body, NativeBody)
        self._met: FloatArray | None = getattr(body, "contact_wrench", None) if native else None  # of a body on planes
        self.where = self._entries()

    def sample(self) -> None:
        """Books the sample that has ended, brakes if asked to, and keeps what the next one holds."""
        S, B = self._S, self._B
        if self._met is not None:
            self.buffer[MET : MET + 6] = self._met
        if B[ledger.GIVEN]:
            self._solve()
        ledger.observe(S, B, self._T)
        if self.control:
            brake.control(S, B, self._T)
        ledger.hold(S, B)
        ledger.report(S, B)

    def _solve(self) -> None:
        """h of fe = K h, where gains are matrices."""
        g = self._grasped
        n, d = g.fingers, g.dimensions
        m, o = n * d, at.dense(n, d)
        K = g.block[o : o + m * m].reshape(m, m)
        h = np.linalg.solve(K, g.rows[:, at.ELASTIC : at.ELASTIC + d].ravel())
        rows = self.buffer[ledger.ROWS : ledger.ROWS + n * ledger.STRIDE].reshape(n, ledger.STRIDE)
        rows[:, ledger.STRETCH : ledger.STRETCH + d] = h.reshape(n, d)

    def _entries(self) -> dict[str, NDArray[np.intp]]:
        """Which entries of the buffer hold what a recording asks for."""
        o = ledger.OUT
        found = {name: np.arange(o + 3 * k, o + 3 * k + 3) for k, name in enumerate(BY_MODE)}
        o += 3 * len(BY_MODE)
        return found | {name: np.array([o + k]) for k, name in enumerate(OF_OBJECT)}
