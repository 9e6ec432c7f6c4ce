"""Accounts of a grasp's energy: closed forms of held springs, dense projectors, the brake in a loop that leaks."""

from __future__ import annotations

from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.compile.kernel import written
from graspfx.compile.machine import compiled
from graspfx.compile.records import Many, Record, many, numbers, size_for
from graspfx.grasp.rigid_modes import Contact, Freedom, rigid_modes
from graspfx.loop.energy import leak as po
from graspfx.spatial import Vector, Vector4

T = 1e-3


class Finger(Contact):
    """A contact with what the kernels ask of it."""

    force: Vector4
    step: Vector4
    displacement: Vector4


class Books(Record):
    """Fingers and their accounts."""

    count: int
    accounts: po.Accounts
    freedom: Freedom
    fingers: Many[Finger] = many("count")


class Observed:
    """n fingers, their modes and accounts."""

    def __init__(self, points: np.ndarray, weights: np.ndarray | None = None) -> None:
        self.n, self.d = points.shape
        turns = {1: 0, 2: 1, 3: 3}[self.d]
        self.S = np.zeros(size_for(Books, count=self.n))
        self.modes = np.zeros(size_for(po.ModeSplit, fingers=self.n, width=3))
        self.split = po.ModeSplit(self.modes.data)
        self.split.fingers, self.split.width, self.split.shifts = self.n, 3, self.d
        self.books = Books(self.S.data)
        self.books.count = self.n
        self.accounts, self.fingers = self.books.accounts, self.books.fingers
        self.weights, self.points = self.fingers.array(Finger.weight), self.fingers.array(Finger.contact)[:, : self.d]
        self.points[...] = points
        self.weights[...] = 1.0 if weights is None else weights
        freedom = self.books.freedom
        freedom.shifts, freedom.turns = self.d, turns
        for axis, row in zip(freedom.axes, np.vstack([np.eye(3)[: self.d], np.eye(3)[3 - turns :]]), strict=False):
            axis.vector = Vector(*row.tolist())
        self.split.count, _ = rigid_modes(self.fingers, freedom, self.d, 1e-9, 2e-9, 3, False, self.split.modes)

    def array(self, field: Any) -> np.ndarray:
        return self.fingers.array(field)[:, : self.d]

    def put(self, field: Any, vectors: Any) -> None:
        self.array(field)[...] = vectors

    def part(self, field: Any) -> Any:
        return self.fingers.part(field)

    def squares(self, run: Any = po.squares) -> Any:
        return run(self.split, self.fingers, self.part(Finger.step))

    def store(self, external: float, internal: float) -> None:
        """Energy of springs at the displacements, 1/2 k e'W Q e of each account."""
        squares = po.squares(self.split, self.fingers, self.part(Finger.displacement))
        for j, gain in enumerate((internal, external, external)):
            self.accounts.parts[j].stored = 0.5 * gain * squares[j]

    def open(self) -> None:
        """Start at zero, with what the springs hold now."""
        for account in self.accounts.parts:
            account.work.value = account.work.carry = account.spent = 0.0
            account.opened = account.stored

    def observe(self, drag: float = 0.0) -> None:
        """Book the work f'Q D of the held force on the step, by dense projectors, and friction on the step."""
        f, D = self.array(Finger.force).ravel(), self.array(Finger.step).ravel()
        for j, Q in enumerate(self.projectors):
            self.book(j, float(f @ Q @ D))
        if drag > 0.0:
            po.spend(self.accounts, drag, self.squares())

    def brake(self, most: float, run: Any = po.add_damping) -> Any:
        forces, steps = self.part(Finger.force), self.part(Finger.step)
        return run(self.accounts, self.split, self.fingers, forces, steps, T, most)

    def book(self, j: int, energy: float) -> None:
        po.book(self.accounts.parts[j].work, energy)

    def balances(self) -> np.ndarray:
        return np.array([po.balance(account) for account in self.accounts.parts])

    @cached_property
    def projectors(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """I - Q, Q of translations, Q of rotations, dense, in the metric of the weights; from grasp matrices."""
        if self.d == 1:
            mean = np.tile(self.weights / self.weights.sum(), (self.n, 1))
            return np.eye(self.n) - mean, mean, np.zeros_like(mean)
        W = np.repeat(self.weights, self.d)
        points = self.points
        every = gx.Split(gx.grasp_matrix(points), metric=W).displacement_external
        moves = gx.Split(gx.grasp_matrix(points, free=[True] * self.d + [False] * (2 * self.d - 3)), metric=W)
        shifts = moves.displacement_external
        return np.eye(len(W)) - every, shifts, every - shifts


def ring(n: int, d: int = 2, radius: float = 0.03) -> np.ndarray:
    angle = 2 * np.pi * np.arange(n) / n
    return radius * np.stack([np.cos(angle), np.sin(angle), 0.3 * np.sin(3 * angle + 1)], axis=1)[:, :d]


@pytest.mark.parametrize("samples", [4, 7, 100])
def test_a_held_spring_moved_in_a_sine_creates_energy_of_known_size(samples):
    """K N A^2 sin^2(pi/N) per cycle of N samples and finger, all of it squeezing, at the devices' port.

    Over a cycle sum f D = -1/2 K sum D^2, and D = 2 A sin(pi/N) cos(...) has the mean square 2 A^2 sin^2(pi/N).
    """
    K, A = 300.0, 0.002
    grasp = Observed(np.array([[-0.02], [0.02]]))
    x = A * np.sin(2 * np.pi * np.arange(samples + 1) / samples + 0.3)
    for k in range(samples):
        grasp.put(Finger.force, K * np.array([[x[k]], [-x[k]]]))
        grasp.put(Finger.step, (x[k + 1] - x[k]) * np.array([[1.0], [-1.0]]))
        grasp.observe()
    created = -grasp.balances()
    assert created[po.INTERNAL] == pytest.approx(2 * K * samples * A**2 * np.sin(np.pi / samples) ** 2, rel=1e-12)
    assert created[po.TRANSLATION] == pytest.approx(0.0, abs=1e-18)
    # the devices' friction covers it iff b >= K T/2: the wall's limit
    for factor, sign in ((1.001, 1.0), (0.999, -1.0)):
        grasp.open()
        for k in range(samples):
            grasp.put(Finger.force, K * np.array([[x[k]], [-x[k]]]))
            grasp.put(Finger.step, (x[k + 1] - x[k]) * np.array([[1.0], [-1.0]]))
            grasp.observe(drag=factor * K * T / 2 / T)
        assert sign * grasp.balances()[po.INTERNAL] > 0.0


def test_turning_is_told_from_shifting_where_the_mean_velocity_is_zero():
    """Three fingers turn an object about their centre against a held torsion spring: no linear velocity, all energy.

    Tangential forces k theta r/3 make the moment k r^2 theta, which takes that times a step's turn: a cycle creates
    1/2 k r^2 times the sum of its turns squared.
    """
    points, k, r, N, amplitude = ring(3), 100.0, 0.03, 40, 1e-4
    grasp = Observed(points)
    tangent = points[:, ::-1] * [-1.0, 1.0]  # z x r
    theta = amplitude * np.sin(2 * np.pi * np.arange(N + 1) / N)
    for j in range(N):
        grasp.put(Finger.force, k / 3 * theta[j] * tangent)
        grasp.put(Finger.step, (theta[j + 1] - theta[j]) * tangent)
        by_mean_velocity = grasp.array(Finger.force).sum(axis=0) @ grasp.array(Finger.step).mean(axis=0)
        assert by_mean_velocity == pytest.approx(0.0, abs=1e-22)  # what an observer of linear power would see
        grasp.observe()
    created = -grasp.balances()
    assert created[po.ROTATION] == pytest.approx(0.5 * k * r**2 * (np.diff(theta) ** 2).sum(), rel=1e-10)
    assert created[po.ROTATION] == pytest.approx(k * r**2 * N * amplitude**2 * np.sin(np.pi / N) ** 2, rel=1e-10)
    assert np.abs(created[[po.INTERNAL, po.TRANSLATION]]).max() < 1e-12 * created[po.ROTATION]


@pytest.mark.parametrize(
    ("n", "d", "weighted"), [(2, 1, False), (2, 2, True), (3, 2, False), (5, 3, False), (4, 3, True)]
)
def test_squares_are_those_of_the_dense_projectors(n, d, weighted):
    rng = np.random.default_rng(n + d)
    points = ring(n, d) + rng.normal(scale=0.003, size=(n, d))
    grasp = Observed(points, rng.uniform(0.2, 2.0, n) if weighted else None)
    D = 1e-4 * rng.normal(size=(n, d))
    grasp.put(Finger.step, D)
    W = np.repeat(grasp.weights, d)
    squares = list(numbers(grasp.squares()))
    for j, Q in enumerate(grasp.projectors):
        assert squares[j] == pytest.approx(
            (W * D.ravel()) @ Q @ D.ravel(), abs=float(1e-13 * (W * D.ravel()) @ D.ravel())
        )


def test_a_coupling_of_eq_4_leaks_half_its_stiffness_times_each_step_squared():
    """With what the springs hold in the books the balance is exact: -1/2 sum D'K D, mode by mode, from any start."""
    rng = np.random.default_rng(4)
    kep, kip = 40.0, 160.0
    grasp = Observed(ring(4, 3), rng.uniform(0.5, 1.5, 4))
    internal, shift, turn = grasp.projectors
    W = np.repeat(grasp.weights, 3)
    e = 1e-3 * rng.normal(size=(300, 12)).cumsum(axis=0)
    grasp.put(Finger.displacement, e[0].reshape(4, 3))
    grasp.store(kep, kip)
    grasp.open()
    expected = np.zeros(3)
    for now, then in pairwise(e):
        force = W * (kep * (shift + turn) @ now + kip * internal @ now)
        grasp.put(Finger.force, force.reshape(4, 3))
        grasp.put(Finger.step, (then - now).reshape(4, 3))
        grasp.observe()
        D = then - now
        expected += [-0.5 * g * (W * D) @ Q @ D for g, Q in ((kip, internal), (kep, shift), (kep, turn))]
    grasp.put(Finger.displacement, e[-1].reshape(4, 3))
    grasp.store(kep, kip)
    np.testing.assert_allclose(grasp.balances(), expected, rtol=1e-11)


def test_a_finger_of_no_weight_has_no_square():
    grasp = Observed(ring(3), np.array([1.0, 1.0, 0.0]))
    grasp.put(Finger.step, [[0.0, 0.0], [0.0, 0.0], [1e-3, 0.0]])
    assert grasp.squares() == Vector(0.0, 0.0, 0.0)


@pytest.mark.parametrize("leaking", [po.INTERNAL, po.TRANSLATION, po.ROTATION])
def test_the_brake_pays_a_debt_with_the_next_step_like_the_last_and_in_its_mode_alone(leaking):
    rng = np.random.default_rng(1)
    grasp = Observed(ring(4, 3), rng.uniform(0.5, 1.5, 4))
    D = 1e-4 * rng.normal(size=(4, 3))
    grasp.put(Finger.step, D)
    grasp.book(leaking, -3e-7)
    found = list(numbers(grasp.brake(1e9)))
    assert found[leaking] > 0.0 and sum(found) == found[leaking]
    assert found[leaking] == pytest.approx(3e-7 * T / grasp.squares()[leaking])
    force = grasp.array(Finger.force).ravel()
    W = np.repeat(grasp.weights, 3)
    expected = found[leaking] / T * W * (grasp.projectors[leaking] @ D.ravel())
    np.testing.assert_allclose(force, expected, rtol=1e-10, atol=1e-14)
    grasp.observe()
    assert abs(grasp.balances()[leaking]) < 1e-20
    assert np.abs(grasp.balances()).max() < 1e-18


def test_the_brake_is_limited_and_idle_where_nothing_is_owed():
    grasp = Observed(ring(3))
    grasp.put(Finger.step, 1e-4 * np.ones((3, 2)))
    assert grasp.brake(0.1) == Vector(0.0, 0.0, 0.0)
    assert not grasp.array(Finger.force).any()
    grasp.book(po.TRANSLATION, -1.0)
    grasp.book(po.INTERNAL, -1.0)
    damping = grasp.brake(0.1)
    assert damping in (Vector(0.1, 0.1, 0.0), Vector(0.0, 0.1, 0.0))  # squeezed by rounding, or not
    grasp.open()
    assert grasp.balances().tolist() == [0.0, 0.0, 0.0]


def squeeze(most: float) -> tuple[float, float, float]:
    """Two masses with friction squeeze through a held spring 1.5 times the limit while they move along.

    Returns:
        The largest squeeze of the first and of the last fifth of 4 s, and how far the middle went [m].
    """
    m, b, k = 0.1, 0.2, 600.0  # 2 b/T = 400 N/m: 0.1 N s/m are missing
    E = np.exp(-b * T / m)
    grasp = Observed(np.array([[-0.02], [0.02]]))
    x, v = np.array([1e-3, -1e-3]), np.full(2, 0.02)
    size = []
    for _ in range(4000):
        grasp.put(Finger.displacement, x[:, None])
        grasp.store(0.0, k)
        grasp.put(Finger.force, 0.5 * k * (x[0] - x[1]) * np.array([[1.0], [-1.0]]))
        if most > 0.0:
            grasp.brake(most)
        f = -grasp.array(Finger.force)[:, 0]
        new = x + (v - f / b) * m / b * (1 - E) + f / b * T
        v = E * v + (1 - E) / b * f
        grasp.put(Finger.step, (new - x)[:, None])
        x = new
        grasp.observe(drag=b / T)
        size.append(abs(x[0] - x[1]))
    return max(size[:800]), max(size[-800:]), float(x.mean())


def test_a_squeeze_beyond_its_devices_friction_grows_and_is_braked_without_braking_the_motion_along():
    first, last, went = squeeze(0.0)
    assert last > 3 * first
    first, last, still_went = squeeze(0.2)
    assert last < 0.3 * first
    assert still_went == pytest.approx(went, rel=1e-9)
    assert went == pytest.approx(0.02 * 0.1 / 0.2 * (1 - np.exp(-8.0)), rel=1e-9)  # v m/b: friction alone slows it


@pytest.mark.parametrize("seed", range(5))
def test_kernels_as_written_lowered_and_compiled_compute_the_same_numbers(seed: int) -> None:
    """Written and lowered to the bit, compiled by themselves to the bit."""

    def flat(kernel: Any) -> Any:
        machine = compiled(kernel)
        views = (Record, Many)

        def run(*arguments: Any) -> Any:
            given: list[Any] = []
            for a in arguments:
                given += [np.asarray(a.buffer), a.offset] if isinstance(a, views) else [a]
                given += [a.stride, a.count] if isinstance(a, Many) else []
            return machine(*given)

        return run

    results = []
    for way in (written, lambda kernel: kernel, flat):
        rng = np.random.default_rng(seed)
        grasp = Observed(ring(4, 3), rng.uniform(0.5, 1.5, 4))
        for _ in range(3):
            grasp.put(Finger.force, rng.normal(size=(4, 3)))
            grasp.put(Finger.step, 1e-4 * rng.normal(size=(4, 3)))
            squares = grasp.squares(run=way(po.squares))
            drained = squares if isinstance(squares, Vector) else Vector(*squares)
            po.spend(grasp.accounts, 10.0, drained)
        way(po.book)(grasp.accounts.parts[po.ROTATION].work, -1.0)
        damping = grasp.brake(0.3, run=way(po.add_damping))
        results.append(([*(damping if isinstance(damping, tuple) else numbers(damping))], grasp.S, grasp.modes))
    one, *others = results
    for other in others:
        assert one[0] == other[0]
        assert one[1].tobytes() == other[1].tobytes() and one[2].tobytes() == other[2].tobytes()
