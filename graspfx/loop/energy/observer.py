"""Observer of an object's energy, which adds each sample to a ledger and damps motion that generates energy."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.memory import zeros
from graspfx.compile.records import layout, size_for, start_of
from graspfx.coupling.grasp_state import FingerState, GraspState
from graspfx.coupling.grasped import GraspedObject
from graspfx.loop.energy.books import EnergyReport, LedgerState
from graspfx.loop.energy.brake import watch
from graspfx.loop.energy.leak import ModeSplit
from graspfx.objects.body import NativeBody
from graspfx.objects.energy import SampleStart

FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]

MET = start_of(LedgerState, "start") + start_of(SampleStart, "contact_force")


class Observer:
    """Ledger of the energy of one object, and passivity controller of the object.

    Args:
        grasped: Object and its coupling; the observer lets the law of the coupling separate elastic and damping forces.
        body: Body of the object. For a native body, the work of obstacles is computed from their forces; for another
            body, it is the remainder of the energy balance.
        period: Sampling period T [s].
        control: Whether the passivity controller damps motion that generates energy.
        friction: Viscous friction of each finger's device (n,) [N s/m]; zero if unknown.
        mass: Mass of each finger's device (n,) [kg]; infinite if unknown.
        guarded: Whether the forces pass through a safety chain.

    Attributes:
        buffer: Memory of the ledger, `LedgerState`.
        met: Wrench (6,) [N, N m] of planes on the body in the previous sample, which must be copied to
            `buffer[MET : MET + 6]` before `watch`; None for a body without planes.
        where: Indices of entries of the buffer, by the names of columns in recordings.
    """

    declaration = LedgerState

    def __init__(
        self,
        grasped: GraspedObject,
        body: Any,
        period: float,
        *,
        control: bool,
        friction: FloatArray,
        mass: FloatArray,
        guarded: bool = False,
    ) -> None:
        self._T = period
        n, block = grasped.fingers, GraspState(grasped.block.data)
        matrices = grasped.matrices and not block.attached
        width = block.width
        room = size_for(ModeSplit, fingers=n, width=width)
        sizes = {"count": n, "components": n * grasped.state.coordinates if matrices else 0, "split_entries": room}
        self.buffer = B = zeros(size_for(LedgerState, **sizes))
        self._grasp, self._ledger = block, LedgerState(B.data)
        ledger = self._ledger
        ledger.count, ledger.components, ledger.split_entries = n, sizes["components"], room
        B[start_of(LedgerState, "split")] = ledger.split_room.offset
        split = ledger.split
        split.fingers, split.width, split.shifts = n, width, block.freedom.shifts
        block.observed = True
        share = block.fingers.array(FingerState.share)
        native = isinstance(body, NativeBody)
        ledger.elapsed = 1.0
        ledger.drag, ledger.mobility = min(friction / share, default=0.0), max(share / mass, default=0.0)
        ledger.foreign, ledger.control, ledger.guarded = not native, control, guarded
        self.met: FloatArray | None = getattr(body, "contact_wrench", None) if native else None
        first = start_of(LedgerState, "report")
        self.where = {
            name: np.arange(int(field.size)) + first + int(field.offset) for name, field in layout(EnergyReport).items()
        }

    def sample(self) -> None:
        """Copy the wrench of planes, and then process one sample by `watch`."""
        if self.met is not None:
            self.buffer[MET : MET + 6] = self.met
        watch(self._grasp, self._ledger, self._T)
