"""The motion of two-link arms: geometry against mpmath, dynamics against a Lagrangian, runs against DOP853."""

from __future__ import annotations

import importlib
import math
from typing import Any

import mpmath as mp
import numpy as np
import pytest
from numpy.typing import NDArray

from graspfx import plugins
from graspfx.compile.kernel import written
from graspfx.devices.two_link.arm import Both, joint_angles, link_directions
from graspfx.errors import DeviceError, InputError
from graspfx.loop.hand import Hand
from graspfx.loop.motion.motion import Sine

two_link: Any = plugins.load("devices", "two-link")
dynamics: Any = importlib.import_module("graspfx.devices.two_link.arm_dynamics")
FloatArray = NDArray[np.float64]

T = 0.005
LEFT: dict[str, Any] = {"base": (-0.04, -0.18), "elbow": "left"}
RIGHT: dict[str, Any] = {"base": (0.04, -0.18), "elbow": "right"}
ODD: dict[str, Any] = {  # nothing equal to anything else
    "base": (0.03, -0.01),
    "links": (0.11, 0.15),
    "link_masses": (0.07, 0.04),
    "link_inertias": (9e-5, 6e-5),
    "link_centres": (0.05, 0.08),
    "rotor_inertias": (4e-6, 3e-6),
    "joint_damping": (2e-3, 5e-3),
}
FREE = Hand([[0.0, 0.0]], 0.0)


def derivative(plant: Any, u: float) -> FloatArray:
    """a1', a2', a1'', a2'' of the only arm, by the kernel as it is written and lowered."""
    block = dynamics.ArmPlantState(plant.state)
    block.period = T
    stages, kind = block.stages, dynamics.ArmStages
    dynamics.derivative(block, stages.part(kind.now), stages.part(kind.slope1), u)
    written(dynamics.derivative)(block, stages.part(kind.now), stages.part(kind.slope2), u)
    slope = stages[0].slope1.motion
    assert slope == stages[0].slope2.motion
    return np.array([slope.a1, slope.a2, slope.w1, slope.w2])


@pytest.mark.parametrize("elbow", ["left", "right"])
@pytest.mark.parametrize("drive", ["base", "elbow"])
def test_geometry_against_mpmath(elbow: str, drive: str) -> None:
    """Tip, inverse and Jacobian within a few roundings of 30-digit values, over the whole reach, all around."""
    arm = two_link.connect(**ODD | {"elbow": elbow, "drive": drive}).arm
    rng = np.random.default_rng(1)
    low, high = arm.reach
    assert (low, high) == pytest.approx((0.05, 0.25), abs=1e-15)  # |l1 - l2| + 0.01, l1 + l2 - 0.01
    with mp.workdps(30):
        for _ in range(50):
            r, turn = rng.uniform(low, high), rng.uniform(-math.pi, math.pi)
            x, y = 0.03 + r * math.cos(turn), -0.01 + r * math.sin(turn)
            a1, a2 = arm.angles(x, y)

            def tip(b1: Any, b2: Any) -> tuple[Any, Any]:
                l1, l2 = mp.mpf(0.11), mp.mpf(0.15)
                return (
                    mp.mpf(0.03) + l1 * mp.cos(b1) + l2 * mp.cos(b2),
                    mp.mpf(-0.01) + l1 * mp.sin(b1) + l2 * mp.sin(b2),
                )

            exact = tip(mp.mpf(a1), mp.mpf(a2))
            assert arm.tip(a1, a2) == pytest.approx([float(c) for c in exact], abs=1e-16)
            assert max(abs(exact[0] - x), abs(exact[1] - y)) < 2e-15
            side = math.cos(a1) * (y + 0.01) - math.sin(a1) * (x - 0.03)  # > 0: the finger is to link 1's left
            assert (side < 0.0) == (elbow == "left")
            J = [[mp.diff(lambda b1, b2, k=k: tip(b1, b2)[k], (a1, a2), at) for at in ((1, 0), (0, 1))] for k in (0, 1)]
            np.testing.assert_allclose(arm.jacobian(a1, a2), np.array(J, dtype=float), rtol=0, atol=1e-16)
            q = (a1, a2) if drive == "base" else (a1, a2 - a1)
            assert joint_angles(drive == "elbow", a1, a2) == q
            assert link_directions(drive == "elbow", *q) == pytest.approx((a1, a2), abs=1e-15)


def kinetic_energy(s: dict[str, Any], drive: str, q: Any, w: Any) -> Any:
    """sum of m |c'|^2/2 + I a'^2/2 over the links and gear^2 J q'^2/2 over the rotors, from positions alone."""
    l1 = mp.mpf(s["links"][0])
    c1, c2 = map(mp.mpf, s["link_centres"])

    def places(t: Any) -> list[Any]:
        q1, q2 = q[0] + w[0] * t, q[1] + w[1] * t
        a1, a2 = q1, q2 if drive == "base" else q1 + q2
        elbow = l1 * mp.expj(a1)
        return [c1 * mp.expj(a1), elbow + c2 * mp.expj(a2)]

    speeds = [abs(mp.diff(lambda t, k=k: places(t)[k], 0)) for k in (0, 1)]
    turning = [w[0], w[1] if drive == "base" else w[0] + w[1]]
    energy = mp.mpf(0)
    for k in (0, 1):
        energy += s["link_masses"][k] * speeds[k] ** 2 / 2 + s["link_inertias"][k] * turning[k] ** 2 / 2
        energy += 225 * s["rotor_inertias"][k] * w[k] ** 2 / 2
    return energy


@pytest.mark.parametrize("drive", ["base", "elbow"])
def test_acceleration_against_lagrange(drive: str) -> None:
    """d/dt dE/dq' - dE/dq = tau - D q' + J'F, differentiated numerically at 40 digits in joint angles, to 1e-12."""
    device = two_link.connect(**ODD | {"drive": drive})
    plant = type(device).plant([device])
    rng = np.random.default_rng(2)
    block = dynamics.ArmPlantState(plant.state)
    [stages], [constants] = block.stages, block.arms
    for _ in range(4):
        a, rate, tau, F = rng.uniform(-3, 3, 2), rng.uniform(-9, 9, 2), rng.normal(0, 0.3, 2), rng.normal(0, 2, 2)
        stages.now.motion = dynamics.LinkMotion(*a, *rate)
        block.stiffness[0, 0] = block.stiffness[1, 0] = 1.0  # a unit spring, its target F away from the finger
        constants.torque = Both(*(tau if drive == "base" else (tau[0] - tau[1], tau[1])))
        tip = device.arm.tip(*a)
        constants.course_x, constants.course_y = (dynamics.Course(tip[k] + F[k], *[0.0] * 5) for k in (0, 1))
        got = derivative(plant, 0.3)
        with mp.workdps(40):
            q = [mp.mpf(v) for v in ((a[0], a[1]) if drive == "base" else (a[0], a[1] - a[0]))]
            w = [mp.mpf(v) for v in ((rate[0], rate[1]) if drive == "base" else (rate[0], rate[1] - rate[0]))]

            def E(q1: Any, q2: Any, w1: Any, w2: Any) -> Any:
                return kinetic_energy(ODD, drive, (q1, q2), (w1, w2))

            def reach(q1: Any, q2: Any) -> Any:
                return ODD["links"][0] * mp.expj(q1) + ODD["links"][1] * mp.expj(q2 if drive == "base" else q1 + q2)

            at = (*q, *w)
            unit = ((1, 0), (0, 1))
            M = mp.matrix([[mp.diff(E, at, (0, 0, i[0] + j[0], i[1] + j[1])) for j in unit] for i in unit])
            right = mp.matrix(2, 1)
            for k, i in enumerate(unit):
                lever = mp.diff(reach, tuple(q), i)
                right[k] = tau[k] - ODD["joint_damping"][k] * w[k] + lever.real * F[0] + lever.imag * F[1]
                right[k] += mp.diff(E, at, (*i, 0, 0))
                right[k] -= sum(mp.diff(E, at, (*j, *i)) * w[n] for n, j in enumerate(unit))
            acceleration = mp.lu_solve(M, right)
        expected = [float(v) for v in acceleration]
        if drive == "elbow":
            expected[1] += expected[0]
        np.testing.assert_allclose(got, [*rate, *expected], rtol=1e-12)


def test_effective_mass_and_friction() -> None:
    """1 N accelerates a finger at rest by Lambda^-1; its drag in motion is the effective damping."""
    device = two_link.connect(**ODD)
    where = (0.14, 0.12)
    plant = type(device).plant([device])
    [constants] = dynamics.ArmPlantState(plant.state).arms
    plant.place(np.array([where]))
    J = device.arm.jacobian(*device.arm.angles(*where))
    drag = device.effective_friction(where)
    for k in (0, 1):
        push = np.eye(2)[k]
        constants.torque = Both(*(J.T @ push))
        np.testing.assert_allclose(device.effective_mass(where) @ (J @ derivative(plant, 0.0)[2:]), push, atol=1e-13)
        w = np.linalg.solve(J, push)
        np.testing.assert_allclose(np.linalg.solve(J.T, [2e-3 * w[0], 5e-3 * w[1]]), drag @ push, rtol=1e-12)


def test_energy_is_kept() -> None:
    """No friction, no hand: after 5 s of free whirling (up to 20 rad/s) the energy is the first to 1e-9."""
    device = two_link.connect(**ODD | {"joint_damping": 0.0})
    plant = type(device).plant([device])
    plant.place(np.array([[0.15, 0.1]]))
    plant.angles(0)[2], plant.angles(0)[3] = 12.0, -9.0

    def energy() -> float:
        a1, a2, *w = plant.angles(0)
        return float(0.5 * np.array(w) @ device.mechanics.mass_matrix(a1, a2) @ np.array(w))

    first = energy()
    for _ in range(1000):
        plant.advance(np.zeros((1, 2)), FREE, T)
    assert plant.time == pytest.approx(5.0, abs=1e-12)
    assert abs(energy() / first - 1.0) < 1e-9


def exact_motion(devices: list[Any], hand: Any, start: FloatArray, torques: FloatArray) -> FloatArray:
    """Tips after each sample by DOP853 at 1e-13, the hand's own target at every stage, the arms in joint-free form."""
    from scipy.integrate import solve_ivp

    arms, mechanics = [d.arm for d in devices], [d.mechanics for d in devices]

    def slope(t: float, y: FloatArray, torque: FloatArray) -> FloatArray:
        a, w = y[:4].reshape(2, 2), y[4:].reshape(2, 2)
        r, dr = hand.target(t)
        J = [arm.jacobian(*row) for arm, row in zip(arms, a, strict=True)]
        e = r - np.array([arm.tip(*row) for arm, row in zip(arms, a, strict=True)])
        de = dr - np.array([j @ row for j, row in zip(J, w, strict=True)])
        F = np.stack([hand.stiffness[k] @ e[:, k] + hand.damping[k] @ de[:, k] for k in (0, 1)], axis=1)
        out = np.zeros((2, 2))
        for i, m in enumerate(mechanics):
            by_direction = (
                torque[i] if arms[i].drive == "base" else np.array([torque[i, 0] - torque[i, 1], torque[i, 1]])
            )
            swing = m.masses[1] * arms[i].links[0] * m.centres[1] * math.sin(a[i, 1] - a[i, 0])
            right = (
                by_direction
                + J[i].T @ F[i]
                - m.damping_matrix() @ w[i]
                + swing * np.array([w[i, 1] ** 2, -(w[i, 0] ** 2)])
            )
            out[i] = np.linalg.solve(m.mass_matrix(*a[i]), right)
        return np.concatenate([w.ravel(), out.ravel()])

    y = np.zeros(8)
    y[:4] = np.ravel([arm.angles(*p) for arm, p in zip(arms, start, strict=True)])
    tips = []
    for k, torque in enumerate(torques):
        y = solve_ivp(slope, (k * T, (k + 1) * T), y, "DOP853", rtol=1e-13, atol=1e-15, args=(torque,)).y[:, -1]
        tips.append([arm.tip(*y[2 * i : 2 * i + 2]) for i, arm in enumerate(arms)])
    return np.array(tips)


def grasped(
    drives: tuple[str, ...], arm: tuple[float, float] = (100.0, 2.0), grip: tuple[float, float] = (400.0, 6.0)
) -> tuple[list[Any], FloatArray, Hand, FloatArray]:
    """One or two arms with a hand that waves and squeezes, where the fingers start, and torques of 200 samples."""
    devices = [two_link.connect(**side, drive=drive) for side, drive in zip((LEFT, RIGHT), drives, strict=False)]
    n = len(devices)
    start = np.array([[-0.025, 0.0], [0.025, 0.0]])[:n]
    hand = Hand.arm_and_grip(
        start,
        arm=arm,
        grip=grip,
        motion=Sine(0.05, 0.5, (1.0, 0.2), ramp=0.5),
        squeeze=0.01,
        inward=[[1, 0], [-1, 0]][:n],
    )
    return devices, start, hand, np.random.default_rng(3).normal(0.0, 0.05, (200, n, 2))


@pytest.mark.parametrize(("arm", "grip"), [((33.0, 0.0), (33.0, 0.0)), ((100.0, 2.0), (400.0, 6.0))])
def test_motion_against_dop853(arm: tuple[float, float], grip: tuple[float, float]) -> None:
    """Two unlike arms that one hand waves and squeezes, random torques held over each sample: 1e-10 m after 1 s."""
    devices, start, hand, torques = grasped(("base", "elbow"), arm, grip)
    expected = exact_motion(devices, hand, start, torques)
    plant = type(devices[0]).plant(devices)
    plant.place(start)
    got = []
    for torque in torques:
        plant.advance(torque, hand, T)
        got.append(plant.position.copy())
    assert np.abs(np.diff(expected, axis=0)).max() > 5e-4  # it does move
    assert np.abs(np.array(got) - expected).max() < 1e-10


def test_integrator_is_of_sixth_order() -> None:
    """Error over 0.05 s with a stiff hand, 8 to 32 substeps: slope -6 (fit within 0.25)."""
    device = two_link.connect(**ODD)
    plant = type(device).plant([device])

    def end(substeps: int) -> FloatArray:
        plant.place(np.array([[0.15, 0.1]]))
        plant.hold(Hand([[0.0, 0.0]], 200.0), 0.05)
        block = dynamics.ArmPlantState(plant.state)
        [stages], [constants] = block.stages, block.arms
        stages.now.motion = dynamics.LinkMotion(stages.now.motion.a1, stages.now.motion.a2, 3.0, -4.0)
        constants.course_x = dynamics.Course(0.12, 0.05, 0.0, 0.0, 0.0, 0.0)
        constants.course_y = dynamics.Course(0.11, 0.0, 0.0, 0.0, 0.0, 0.0)
        dynamics.integrate(block, substeps)
        end = stages.now.motion
        return np.array([end.a1, end.a2, end.w1, end.w2])

    best = end(200)
    steps = np.array([8, 16, 32])
    errors = [np.abs(end(int(s)) - best).max() for s in steps]
    order = -np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert order == pytest.approx(6.0, abs=0.25)


def test_a_kernel_that_cannot_go_on_moves_nothing() -> None:
    """A code and what it means, for torques that are not numbers and for a hand too stiff; then as if never asked."""
    device = two_link.connect(**LEFT)
    plant = type(device).plant([device])
    start = np.array([[-0.025, 0.01]])
    plant.place(start)
    plant.hold(Hand(start, 1e12), T)
    assert "too fast for samples of 0.005 s" in plant.fault_text(plant.kernel(memoryview(plant.state), 0))
    plant.hold(Hand(start, 33.0), T)
    plant.state[plant.ports.effort] = math.nan
    assert "not finite" in plant.fault_text(plant.kernel(memoryview(plant.state), 0))
    assert plant.time == 0.0
    np.testing.assert_array_equal(plant.position, start)
    plant.advance(np.zeros((1, 2)), Hand(start, 33.0), T)
    assert np.abs(plant.position - start).max() < 1e-15


def test_hand_holds_still() -> None:
    """Nothing moves at the hand's rest position, and `place` puts the tip there to 1e-15 m."""
    device = two_link.connect(**LEFT)
    plant = type(device).plant([device])
    start = np.array([[-0.025, 0.01]])
    plant.place(start)
    assert np.abs(plant.position - start).max() < 1e-15
    for _ in range(20):
        plant.advance(np.zeros((1, 2)), Hand(start, 100.0, 1.0), T)
    assert np.abs(plant.position - start).max() < 1e-15
    assert np.abs(plant.velocity).max() < 1e-14


def test_plant_refuses() -> None:
    device = two_link.connect(**LEFT)
    plant = type(device).plant([device])
    with pytest.raises(InputError, match=r"position: .* shape \(1, 2\)"):
        plant.place(np.array([[math.nan, 0.0]]))
    with pytest.raises(InputError, match=r"force: .* shape \(1, 2\)"):
        plant.advance(np.zeros(2), FREE, T)
    with pytest.raises(DeviceError, match="efforts or the hand's targets are not finite"):
        plant.advance(np.array([[math.inf, 0.0]]), FREE, T)
    with pytest.raises(DeviceError, match=r"too fast for samples of 0.005 s: the motion has diverged"):
        plant.advance(np.zeros((1, 2)), Hand([[0.0, 0.0]], 1e12), T)
    with pytest.raises(InputError, match=r"devices: .* simulated two-link arm"):
        type(device).plant([])
