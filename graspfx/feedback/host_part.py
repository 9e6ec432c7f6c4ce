"""The loop's side of a host: settings, record and bridge."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.memory import zeros
from graspfx.compile.records import size_for
from graspfx.feedback.bridge import HOLD, LINEAR, MODEL, HostState
from graspfx.feedback.host_record import HOST_FIRST, LOOP_SIZE, HostRecord, make_record
from graspfx.grasp.direct import PointGrasp

FloatArray = NDArray[np.float64]
METHODS = {"hold": HOLD, "linear": LINEAR, "model": MODEL}


@dataclass(frozen=True, eq=False)
class HostPart:
    """A host's record and its bridge.

    Attributes:
        record: Record shared with the host.
        block: Memory of the bridge, `HostState`.
        silence: Time without a new sample after which forces fade [s].
    """

    record: HostRecord
    block: FloatArray
    silence: float

    @property
    def state(self) -> HostState:
        """The bridge."""
        return HostState(self.block)


def make_host(table: Any, most: FloatArray, dimensions: int, period: float) -> HostPart:
    """Create the bridge of a scene's table `host`.

    Args:
        table: Table `host` of the scene.
        most: Largest force of each finger, (n,) [N].
        dimensions: Number of dimensions d.
        period: Sampling period T [s].
    """
    n, d = len(most), dimensions
    grasp = size_for(PointGrasp, count=n, dimensions=d)
    counts = {"fingers": n, "dimensions": d, "size": n * d, "grasp_entries": grasp}
    block = zeros(size_for(HostState, **counts))
    state = HostState(block)
    for name, count in counts.items():
        setattr(state, name, count)
    state.period, state.method, state.silence = period, METHODS[table.predict], table.silence / period
    state.largest, state.stride, state.tanked = table.largest, table.speed * period, table.tank > 0.0
    state.push_model, state.squeeze_model = table.push_stiffness, table.squeeze_stiffness
    for tank in (state.push_tank, state.squeeze_tank):
        tank.level, tank.most, tank.share = table.tank, max(table.tank_room, table.tank), 1.0
    state.array(HostState.most)[:] = most
    state.grasp.count, state.grasp.dimensions, state.grasp.tolerance = n, d, 1e-6
    state.grasp.external_stiffness = 1.0
    record = make_record(table.name, n, d, period)
    state.host_first, state.host_size, state.loop_first, state.loop_size = record.words[HOST_FIRST : LOOP_SIZE + 1]
    return HostPart(record, block, table.silence)
