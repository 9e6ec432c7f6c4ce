"""No energy from nowhere: the work of eq. (4) around closed motions of fingers and object, quasi-statically."""

from __future__ import annotations

import numpy as np
import pytest

from graspfx.coupling.grasped import GraspedObject
from graspfx.coupling.rules import Rules
from tests.support.closed_paths import gain_per_loop
from tests.support.grasps import grasped, law


def held(n: int, rules: Rules) -> tuple[GraspedObject, np.ndarray]:
    start = np.random.default_rng(3).uniform(-0.03, 0.03, (n, 3))
    return grasped(n, 3, law(40.0, 160.0), rules, contacts=start), start


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
