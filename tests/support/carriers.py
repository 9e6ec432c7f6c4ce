"""Other programs that move objects, PyBullet and MuJoCo, as tests ask for them: each has to pass the same ones."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from graspfx import plugins
from graspfx.objects import integrators as at
from graspfx.objects.body import NativeBody
from graspfx.objects.dynamics_table import dynamics_of

Array = NDArray[np.float64]

CARRIERS = ("bullet", "mujoco")


def require(name: str) -> Any:
    """Import the module behind dynamics, or skip the test where their package is missing."""
    facts = dynamics_of(name)
    if facts.missing:
        pytest.skip(f"{facts.package} is not installed: it has no wheel for every Python and platform")
    return plugins.load("dynamics", name)


@pytest.fixture(params=CARRIERS)
def carrier(request: pytest.FixtureRequest) -> str:
    """Name each program in turn; a module of tests that has it as `carrier` runs with all of them."""
    name = str(request.param)
    require(name)
    return name


@contextmanager
def maker(create: Callable[..., Any]) -> Iterator[Callable[..., Any]]:
    """Give a function that creates bodies or worlds, and close at the end what it has created."""
    with ExitStack() as stack:

        def make(*arguments: Any) -> Any:
            created = create(*arguments)
            stack.callback(created.close)
            return created

        yield make


class PushAndDrift(NativeBody):
    """A native body with the integrator "exact" that is pushed first, and then drifts for the sample: no viscosity."""

    def step(self, T: float) -> None:
        """Advance by v+ = v + T f/m and w+ = w + T J^-1 M, then freely."""
        state = self.state
        wrench = state[at.FORCE : at.MOMENT + 3]
        push = wrench.copy()
        R = state[at.ROTATION : at.ROTATION + 9].reshape(3, 3)
        state[at.VELOCITY : at.VELOCITY + 3] += T * push[:3] / state[at.MASS]
        moment = R.T @ push[-3:]
        state[at.ANGULAR_VELOCITY : at.ANGULAR_VELOCITY + 3] += T * R @ (moment / state[at.INERTIA : at.INERTIA + 3])
        wrench[:] = 0.0
        super().step(T)
        wrench[:] = push
