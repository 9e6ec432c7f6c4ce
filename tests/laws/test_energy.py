"""No energy from nowhere: the work of eq. (4) around closed motions of fingers and object, quasi-statically."""

from __future__ import annotations

import numpy as np
import pytest

from graspfx.coupling.grasped import GraspedObject
from graspfx.coupling.rules import Rules
from graspfx.objects.body import fill_body
from graspfx.surfaces.closed_form.shape import Box
from tests.support.closed_paths import gain_per_loop
from tests.support.grasps import law


def held(n: int, rules: Rules, seed: int = 3) -> tuple[GraspedObject, np.ndarray]:
    start = np.random.default_rng(seed).uniform(-0.03, 0.03, (n, 3))

    def fill(state: np.ndarray) -> None:
        fill_body(state, dimensions=3, mass=0.1, inertia=4e-5, rotational_viscosity=1e-4)

    g = GraspedObject(n, 3, 0.005, law(40.0, 160.0), rules, fill, shape=Box((0.06, 0.06, 0.06)))
    g.attach(start)
    return g, start


@pytest.mark.parametrize("n", [2, 3, 5])
def test_fingertip_reaction_makes_no_energy(n: int) -> None:
    """Contacts fixed in a turning object, kep = 40, kip = 160, no damping: zero to rounding."""
    g, start = held(n, Rules(attached=True))
    assert max(abs(gain_per_loop(g, start, seed)) for seed in range(3)) < 1e-12


@pytest.mark.parametrize("n", [2, 3, 5])
def test_contact_reaction_does(n: int) -> None:
    """The paper's (2) to the letter makes or takes per cent of the stored peak per loop: why it is not the default."""
    g, start = held(n, Rules(attached=True, at_contact=True))
    assert max(abs(gain_per_loop(g, start, seed)) for seed in range(3)) > 0.01
