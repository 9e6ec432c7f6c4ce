"""Point masses in an operator's hand: each model against an oracle of its own, and the same bits by every engine."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from graspfx.compile.kernel import written
from graspfx.compile.machine import compiled
from graspfx.devices.simulated import connect, points
from graspfx.devices.simulated.operated_points import OperatedPlant, OperatedPlantState, advance, room_for
from graspfx.errors import DeviceError, InputError
from graspfx.loop.hand import Hand, join
from graspfx.loop.motion.motion import Sine
from graspfx.loop.operator import Operator, joined

T, M, B = 0.002, 0.12, 0.3  # [s], [kg], [N s/m]
K_HAND, B_HAND = 300.0, 3.0
MASS, K_LIMB, B_LIMB = 0.4, 250.0, 6.0


def operated(hand: Hand, **parts: Any) -> tuple[OperatedPlant, Hand]:
    """A plant of a mass for each finger of a hand, which is given these parts."""
    d, n, _ = hand.stiffness.shape
    operator = Operator(n)
    for name, values in parts.items():
        getattr(operator, f"set_{name}")(**values)
    hand.operator = operator
    plant = OperatedPlant([M] * n, [B] * n, d, room_for(operator.reach, T))
    plant.place(np.zeros((n, d)))
    return plant, hand


def quick(plant: OperatedPlant) -> OperatedPlant:
    """Let machine code move a plant, for many samples."""
    machine = compiled(advance)
    plant.kernel = lambda S, o: machine(plant.state, o)
    return plant


def moving(n: int = 1, d: int = 1) -> Hand:
    return Hand(np.zeros((n, d)), K_HAND, B_HAND, Sine(0.01, 1.3, 0, dimensions=d))


def forces(count: int, n: int = 1, d: int = 1) -> Any:
    return np.random.default_rng(3).normal(0.0, 0.8, (count, n, d))


@pytest.mark.parametrize(("k", "b", "period"), [(300.0, 3.0, 0.001), (1000.0, 40.0, 0.005), (1e5, 1.0, 0.005)])
def test_without_parts_it_is_the_plant_of_springs_and_dampers(k: float, b: float, period: float) -> None:
    """Whose steps are matrix exponentials; hands that couple their fingers included, and any number of substeps."""
    rest = np.array([[-0.02, 0.0], [0.02, 0.01]])
    hands = [
        Hand.arm_and_grip(rest, arm=(k, b), grip=(0.4 * k, 2.0 * b), motion=Sine(0.01, 3.0, [1.0, 1.0])) for _ in "ab"
    ]
    hands[1].operator = Operator(2)
    plants: list[Any] = [kind([0.1, 0.2], [0.5, 0.3], 2) for kind in (points.PointPlant, OperatedPlant)]
    for plant in plants:
        plant.place(rest)
    for u in forces(400, 2, 2):
        for plant, hand in zip(plants, hands, strict=True):
            plant.advance(u, hand, period)
    assert np.abs(plants[0].position - plants[1].position).max() < 1e-13
    assert np.abs(plants[0].velocity - plants[1].velocity).max() < 1e-11


def test_a_limb_moves_as_the_matrix_exponential_of_five_parameters() -> None:
    """Device and limb, targets on a cubic: z' = A z with r, r', r'', r''' among the states."""
    plant, hand = operated(
        moving(), limb={"mass": MASS, "stiffness": np.array([K_LIMB]), "damping": np.array([B_LIMB])}
    )
    A = np.zeros((9, 9))  # p, p', y, y', r, r', r'', r''', u
    A[0, 1] = A[2, 3] = A[4, 5] = A[5, 6] = A[6, 7] = 1.0
    A[1, :4] = np.array([-K_HAND, -(B_HAND + B), K_HAND, B_HAND]) / M
    A[1, 8] = 1.0 / M
    A[3, :6] = np.array([K_HAND, B_HAND, -K_HAND - K_LIMB, -B_HAND - B_LIMB, K_LIMB, B_LIMB]) / MASS
    step, z, worst = expm(A * T), np.zeros(4), 0.0
    for k, u in enumerate(forces(1000)):
        (r0, v0), (r1, v1) = (tuple(float(x[0, 0]) for x in hand.target(time)) for time in (k * T, (k + 1) * T))
        c2 = (3.0 * (r1 - r0) / T - 2.0 * v0 - v1) / T
        c3 = (v0 + v1 - 2.0 * (r1 - r0) / T) / T**2
        z = (step @ np.concatenate([z, [r0, v0, 2.0 * c2, 6.0 * c3, u[0, 0]]]))[:4]
        plant.advance(u, hand, T)
        block = OperatedPlantState(plant.state)
        mine = [plant.position[0, 0], plant.velocity[0, 0], block.limb[0], block.limb_rate[0]]
        worst = max(worst, float(np.abs((np.array(mine) - z) * [1.0, T, 1.0, T]).max()))
    assert worst < 1e-14


def test_stiffness_and_damping_rise_with_the_displayed_force_behind_its_lag() -> None:
    plant, hand = operated(
        Hand(np.full((1, 2), 0.01), K_HAND, B_HAND), stiffening={"stiffness": 80.0, "damping": 0.5, "lag": 0.05}
    )
    z, grip = np.zeros((2, 2)), 0.0
    for u in forces(300, 1, 2):
        grip += (1.0 - np.exp(-T / 0.05)) * (float(np.linalg.norm(u)) - grip)
        k, b = K_HAND + 80.0 * grip, B_HAND + 0.5 * grip
        A = np.zeros((3, 3))
        A[0, 1], A[1] = 1.0, np.array([-k, -(b + B), 1.0]) / M
        for a in range(2):
            r = np.array([0.01, 0.0])
            z[a] = r + (expm(A * T) @ np.append(z[a] - r, u[0, a]))[:2]
        plant.advance(u, hand, T)
    assert plant.position[0] == pytest.approx(z[:, 0], abs=1e-14)


def test_a_reaction_comes_as_many_samples_late_as_its_delay_and_not_one_sooner() -> None:
    """Against a state that holds the whole line; the first samples feel nothing of it."""
    delay = 7
    plant, hand = operated(moving(), reaction={"delay": delay * T, "stiffness": 90.0, "damping": 2.0, "force": 0.3})
    plain = points.PointPlant([M], [B], 1)
    plain.place(np.zeros((1, 1)))
    line = [0.0] * delay
    for k, u in enumerate(forces(300)):
        r, v = (float(x[0, 0]) for x in hand.target(k * T))
        line.append(90.0 * (r - plain.position[0, 0]) + 2.0 * (v - plain.velocity[0, 0]) - 0.3 * u[0, 0])
        plain.advance(u + line[k], moving(), T)
        plant.advance(u, hand, T)
        assert plant.position[0, 0] == pytest.approx(plain.position[0, 0], abs=1e-14), k


def test_noise_has_the_same_share_at_every_force() -> None:
    """A finger that is held at rest by a constant force: the coefficient of variation of the muscle's force."""
    shares = []
    for push in (0.5, 4.0):
        noise = {"share": 0.03, "cutoff": 12.0, "lag": 0.1, "seeds": [(5, 0)]}
        plant, hand = operated(Hand(np.array([[push / K_HAND]]), K_HAND, B_HAND), noise=noise)
        h = []
        quick(plant)
        for _ in range(20_000):
            plant.advance(np.array([[-push]]), hand, T)
            h.append(OperatedPlantState(plant.state).pull[0])
        shares.append(float(np.std(h[2000:])) / push)
    assert shares == pytest.approx([0.03, 0.03], rel=0.05)
    assert shares[0] == pytest.approx(shares[1], rel=1e-6)


def whole(d: int = 2) -> tuple[OperatedPlant, Hand]:
    parts: dict[str, Any] = {
        "limb": {"mass": MASS, "stiffness": np.full(d, K_LIMB), "damping": np.full(d, B_LIMB)},
        "stiffening": {"stiffness": 80.0, "damping": 0.5, "lag": 0.05},
        "reaction": {"delay": 0.011, "stiffness": 40.0, "damping": 1.0, "force": 0.1},
        "noise": {"share": 0.03, "cutoff": 12.0, "lag": 0.1, "seeds": [(5, 0), (5, 1)]},
    }
    return operated(moving(2, d), **parts)


def test_every_engine_gives_the_same_bits() -> None:
    states = []
    for engine in (advance, written(advance), compiled(advance)):
        plant, hand = whole()
        at = plant.ports
        for k, u in enumerate(forces(60, 2, 2)):
            if k == 0:
                plant.hold(hand, T)
            plant.state[at.effort : at.effort + 4] = u.ravel()
            for j, each in enumerate(hand.target((k + 1) * T)):
                plant.state[at.end + 4 * j : at.end + 4 * j + 4] = each.ravel()
            if engine is compiled(advance):
                assert engine(plant.state, 0) == 0
            else:
                assert engine(OperatedPlantState(plant.state.data)) == 0
        states.append(plant.state.copy())
    assert np.array_equal(states[0], states[1])
    assert np.array_equal(states[0], states[2])


def test_a_fresh_start_forgets_and_numbers_pass_from_plant_to_plant() -> None:
    plant, hand = whole()
    first = []
    for _ in range(2):
        for u in forces(40, 2, 2):
            plant.advance(u, hand, T)
        first.append(plant.position.copy())
        plant.place(np.zeros((2, 2)))
    assert np.array_equal(*first)
    other, own = operated(moving(2, 2), reaction={"delay": 0.011, "stiffness": 0.0, "damping": 0.0, "force": 0.0})
    other.hold(own, T)
    plant.hold(hand, T)
    other.adopt(plant)
    other.hold(own, T)
    assert np.array_equal(other.mechanics, plant.mechanics)


def test_operators_join_finger_by_finger() -> None:
    one, two = Operator(2), Operator(1)
    one.set_stiffening(10.0, 0.1, 0.1)
    two.set_reaction(0.1, 5.0, 0.0, 0.0)
    whole_ = joined([one, None, two], [2, 1, 1], [3, 0, 2, 1])
    assert whole_ is not None
    assert [whole_.finger(i).rise for i in range(4)] == [0.0, 10.0, 0.0, 10.0]
    assert [whole_.finger(i).delay for i in range(4)] == [0.1, 0.0, 0.0, 0.0]
    assert joined([None, None], [1, 1], [0, 1]) is None
    hands = [Hand(np.zeros((1, 1)), 1.0) for _ in "ab"]
    hands[1].operator = two
    both: Any = join(hands)
    assert [both.operator.finger(i).pull for i in range(2)] == [0.0, 5.0]


def test_the_stiffness_at_rest_is_that_of_a_run_which_came_to_rest() -> None:
    u = np.array([[-1.2], [0.7]])
    parts: dict[str, Any] = {
        "limb": {"mass": MASS, "stiffness": np.array([K_LIMB]), "damping": np.array([B_LIMB])},
        "stiffening": {"stiffness": 80.0, "damping": 0.5, "lag": 0.01},
        "reaction": {"delay": 0.02, "stiffness": 40.0, "damping": 1.0, "force": 0.1},
    }
    for names in (("limb", "stiffening", "reaction"), ("stiffening", "reaction"), ("limb",)):
        hand = Hand.arm_and_grip(np.array([[0.0], [0.01]]), arm=(200.0, 6.0), grip=(300.0, 6.0))
        plant, hand = operated(hand, **{name: parts[name] for name in names})
        quick(plant)
        for _ in range(8000):
            plant.advance(u, hand, T)
        assert hand.operator is not None
        K = hand.operator.at_rest(hand.stiffness, -u)[0]
        assert K @ (np.array([0.0, 0.01]) - plant.position[:, 0]) == pytest.approx(-u[:, 0], rel=1e-9), names


def test_faults() -> None:
    plant, hand = operated(Hand(np.zeros((1, 1)), 1e15))
    with pytest.raises(DeviceError, match="too stiff"):
        plant.advance(np.zeros((1, 1)), hand, T)
    plant, hand = operated(moving())
    with pytest.raises(DeviceError, match="not finite"):
        plant.advance(np.array([[np.nan]]), hand, T)
    assert plant.position[0, 0] == 0.0
    plant, hand = operated(moving(), reaction={"delay": 0.01, "stiffness": 1.0, "damping": 0.0, "force": 0.0})
    assert hand.operator is not None
    hand.operator.set_reaction(0.5, 1.0, 0.0, 0.0)
    with pytest.raises(InputError, match="size"):
        plant.hold(hand, T)
    device = connect(mass=M, dimensions=1)
    late = Operator(1)
    late.set_reaction(0.15, 1.0, 0.0, 0.0)
    moved = type(device).operated_plant([device], late, 0.001)
    assert OperatedPlantState(moved.state).room == 256
    assert room_for(0.0, T) == 0
