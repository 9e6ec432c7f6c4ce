"""The tank on random grasps: what springs gain by a change of gains at rest, by numpy, is what the tank has paid."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.compile.machine import compiled
from graspfx.coupling.grasp_state import FingerState
from graspfx.coupling.grasped import GraspedObject
from graspfx.coupling.limit import limit
from graspfx.coupling.rules import Rules
from graspfx.coupling.sample import conclude, couple
from graspfx.loop.safety.chain import GAINS, SafetyChain, SafetyLimits
from graspfx.loop.safety.safety_state import SafetyState
from graspfx.loop.safety.soften import apply_gain, soften
from graspfx.loop.safety.tank import adjust
from graspfx.loop.safety.trust import keep_pace
from graspfx.objects.body import fill_body
from graspfx.surfaces.closed_form.shape import Box
from tests.support.grasps import law

KINDS = {
    "attached": (Rules(attached=True), np.inf),
    "frictionless": (Rules(fade=None), np.inf),
    "friction": (Rules(friction=0.4, fade=None), np.inf),
    "at the limits": (Rules(attached=True), 0.5),
    "friction at the limits": (Rules(friction=0.4, fade=None), 0.5),
}
LIVE = frozenset({*GAINS, "equal", "rays", "damped", "singular", "gradual"})


class Bench:
    """Four fingers in a box that stands still, or attached to it, whose gains move from one pair to another."""

    def __init__(self, rng: np.random.Generator, rules: Rules, most: float, kep: float, kip: float) -> None:
        self.rules, self.most = rules, most
        self.start = 0.022 * np.array([[1.0, 0.1, 0.2], [-1.0, 0.2, -0.1], [0.1, 1.0, 0.1], [-0.2, -1.0, 0.1]])

        def fill(state: np.ndarray) -> None:
            fill_body(state, dimensions=3, mass=0.1, inertia=4e-5, rotational_viscosity=1e-4)

        self.g = g = GraspedObject(
            4, 3, 0.005, law(kep, kip), rules, fill, shape=Box((0.06,) * 3), limit=np.inf, live=LIVE
        )
        far, every = np.full((4, 3), np.inf), np.full(4, np.inf)
        limits = SafetyLimits(np.full(4, most if most < np.inf else 1e6), every, every, -far, far, 3, 0.0)
        self.chain = SafetyChain(limits, [(g, np.arange(4))], 4, 0.005, live=LIVE)
        self.state = SafetyState(self.chain.buffers[0])
        self.steps: list[Any] = [compiled(each) for each in (couple, soften, limit, apply_gain, conclude)]
        self.pace, self.adjust = compiled(keep_pace), compiled(adjust)
        if rules.attached:
            g.attach(self.start)
        else:
            g.meet(1.5 * self.start)
            for share in np.linspace(1.5, 1.1, 20):
                g.finger_position[:] = share * self.start
                self.ask()
        slide = 0.004 if rules.attached else 0.002
        g.finger_position[:] = self.start + rng.uniform(-slide, slide, (4, 3))
        self.ask()

    def ask(self) -> None:
        """Run a sample up to the reaction."""
        block, buffer, pace = self.g.block, self.chain.buffers[0], self.chain.pace
        assert int(self.pace(pace, 0, 0)) == 0
        code = int(self.steps[0](block, 0))
        code = int(self.steps[1](block, 0, buffer, 0, pace, 0, code))
        code = int(self.steps[2](block, 0, code))
        self.steps[3](block, 0, buffer, 0)
        assert int(self.steps[4](block, 0, code)) == 0

    def stored(self) -> float:
        """Energy that the springs can return, f'(e + s) - f'K^-1 f/2 with P of the contacts by the pseudoinverse.

        With f = K (e + s) that is f'K^-1 f/2. A limit slips on its own, and back: what is beyond it comes back too.
        """
        G = gx.grasp_matrix(self.g.array(FingerState.contact))
        P, block = np.linalg.pinv(G) @ G, self.g.state
        K = block.external_stiffness * P + block.internal_stiffness * (np.eye(12) - P)
        f = self.g.array(FingerState.elastic)[:, :3].ravel()
        w = np.linalg.solve(K, f)
        if np.isinf(self.most):
            return 0.5 * float(f @ w)
        reach = FingerState.displacement if self.rules.attached else FingerState.retained
        return float(f @ self.g.array(reach)[:, :3].ravel()) - 0.5 * float(f @ w)

    def change(self, kep: float, kip: float) -> None:
        """Send the gains on their way, and take the first step."""
        goal = self.state.goal
        goal.external_stiffness, goal.internal_stiffness, self.state.changing = kep, kip, True
        self.adjust(self.g.block, 0, self.chain.buffers[0], 0)
        self.ask()


@pytest.mark.parametrize("kind", KINDS)
def test_springs_gain_no_more_than_the_tank_pays(kind: str) -> None:
    """40 random changes each, half of them with too little in the tank: dV <= the tank's loss; equal where attached.

    From equal gains the price is an upper bound, as it is where contacts slide or forces stand at their limits.
    """
    rules, most = KINDS[kind]
    rng = np.random.default_rng(sum(map(ord, kind)))
    parts = stiffer = 0
    for trial in range(40):
        kep, kip = np.exp(rng.uniform(np.log(20.0), np.log(400.0), 2))
        bench = Bench(rng, rules, most, kep, kip if trial % 4 else kep)
        before = bench.stored()
        bench.state.tank.most = 20.0
        bench.state.tank.level = level = 10.0 if trial % 2 else 0.2 * before
        bench.change(*np.exp(rng.uniform(np.log(20.0), np.log(400.0), 2)))
        gained, paid = bench.stored() - before, level - bench.state.tank.level
        assert bench.state.tank.level >= -1e-15
        assert gained <= paid + 1e-9 * (before + abs(paid)), (trial, gained, paid)
        if kind == "attached" and trial % 4:
            assert gained == pytest.approx(paid, rel=1e-9, abs=1e-12 * before)
        parts += bool(bench.state.changing)
        stiffer += gained > 0.0
    assert parts > 3
    assert stiffer > 10
