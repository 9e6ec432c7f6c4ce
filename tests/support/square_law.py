"""A sample under the implicit integrator by its square system, as gains that are matrices take it."""

from __future__ import annotations

import numpy as np

from graspfx.coupling.grasp_state import GraspState
from graspfx.coupling.grasped import GraspedObject
from graspfx.coupling.sample import sample


def square_sample(g: GraspedObject) -> tuple[int, GraspState]:
    """Sample a copy of the block by the square, from no start; give the fault and the copy."""
    state = GraspState(np.array(g.block))
    state.recoils = state.rays = False
    if state.problem.offset != state.damping_problem.offset:
        for problem in (state.problem, state.damping_problem):
            problem.flexible = False
            problem.started = 0
            for unknown in problem.unknowns:
                unknown.value = 0.0
    return sample(GraspState(memoryview(state.buffer))), state
