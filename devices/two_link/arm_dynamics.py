"""Motion of two-link arms held by one hand: rigid-body dynamics, integrated over a sample."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.devices._plant import HeldPlant, PlantState, unfit
from graspfx.devices.two_link.arm import Both, Mechanics, Point, links_at
from graspfx.protocols import Floats, Many, Record, Table, floats, kernel, many, size_of, start_of, table

FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Jacobian:
    """Derivative (x1, y1), (x2, y2) of a finger's position with respect to the directions a1, a2 of the links [m]."""

    x1: float
    x2: float
    y1: float
    y2: float


@dataclass(frozen=True, slots=True)
class Course:
    """A polynomial of degree five in u = time/T, where T is the sampling period."""

    c0: float
    c1: float
    c2: float
    c3: float
    c4: float
    c5: float

    def place(self, u: float) -> float:
        return self.c0 + u * (self.c1 + u * (self.c2 + u * (self.c3 + u * (self.c4 + u * self.c5))))

    def slope(self, u: float) -> float:
        return self.c1 + u * (2.0 * self.c2 + u * (3.0 * self.c3 + u * (4.0 * self.c4 + u * 5.0 * self.c5)))


@dataclass(frozen=True, slots=True)
class LinkMotion:
    """Directions of the links a1, a2 [rad] and their rates w1, w2 [rad/s], or the time derivatives of these four."""

    a1: float
    a2: float
    w1: float
    w2: float

    def __add__(self, other: LinkMotion) -> LinkMotion:
        return LinkMotion(self.a1 + other.a1, self.a2 + other.a2, self.w1 + other.w1, self.w2 + other.w2)

    def __sub__(self, other: LinkMotion) -> LinkMotion:
        return LinkMotion(self.a1 - other.a1, self.a2 - other.a2, self.w1 - other.w1, self.w2 - other.w2)

    def __mul__(self, k: float) -> LinkMotion:
        return LinkMotion(self.a1 * k, self.a2 * k, self.w1 * k, self.w2 * k)

    def __rmul__(self, k: float) -> LinkMotion:
        return LinkMotion(k * self.a1, k * self.a2, k * self.w1, k * self.w2)

    def __truediv__(self, k: float) -> LinkMotion:
        return LinkMotion(self.a1 / k, self.a2 / k, self.w1 / k, self.w2 / k)


class ArmStage(Record):
    """Motion of an arm at a stage of the integration, or the derivative of the motion."""

    motion: LinkMotion


class ArmStages(Record):
    """Motion of an arm, and the stages of the integration of this motion."""

    now: ArmStage
    trial: ArmStage
    slope1: ArmStage
    slope2: ArmStage
    slope3: ArmStage
    slope4: ArmStage
    slope5: ArmStage
    slope6: ArmStage
    slope7: ArmStage


class ArmConstants(Record):
    """Constants of one arm, with the letters of `Mechanics`, and quantities of the present sample."""

    base: Point  # [m]
    lengths: Both  # lengths of the links [m]
    inertia: Both  # I1, I2 [kg m^2]
    mixed: float  # m [kg m^2]
    rotors: float  # r [kg m^2]
    damping1: float  # d1, d, d2 [N m s/rad]
    damping12: float
    damping2: float
    elbow: bool  # the second motor is at the elbow
    torque: Both  # along the directions of the links, held over the sample [N m]
    jacobian: Jacobian  # at the last evaluated derivative
    error: Point  # target of the hand minus position of the finger [m]
    error_rate: Point  # [m/s]
    course_x: Course  # target over the sample [m]
    course_y: Course


class ArmPlantState(PlantState):  # type: ignore[misc] # mypy does not see devices from inside the package
    """Two-link arms: the hand's gains, the arms' constants and states, and the stages of the integration."""

    middle: Floats = floats("fingers * dimensions")  # target in the middle of the sample [m]
    middle_rate: Floats = floats("fingers * dimensions")  # [m/s]
    stiffness: Table = table("2 * fingers", "fingers")  # K by axis, finger and finger [N/m]
    damping: Table = table("2 * fingers", "fingers")  # B [N s/m]
    arms: Many[ArmConstants] = many("fingers")
    stages: Many[ArmStages] = many("fingers")


STEP = 0.12  # largest product of a substep and the fastest rate of arm and hand
MOST = 1000  # largest number of substeps per sample

TOO_FAST = 2  # code of `advance` in addition to NOT_FINITE, 1


@kernel
def derivative(plant: ArmPlantState, states: Many[ArmStage], slopes: Many[ArmStage], u: float) -> None:
    """Compute the derivatives of the arms' states at the time u T in the sample.

        M(a) a'' = tau + J'F - D a' + m sin(a2 - a1) (a2'^2, -a1'^2),   F = K (r - p) + B (r' - v)

    a are the directions of the links, tau the torques along a, and J = dp/da; M, D and m are those of `Mechanics`. F is
    the hand's force on the fingers at positions p with velocities v, for targets r, stiffness K and damping B.
    """
    arms, K, B = plant.arms, plant.stiffness, plant.damping
    n, T = arms.count, plant.period
    for i, arm in enumerate(arms):
        now = states[i].motion
        links = links_at(arm.lengths, now.a1, now.a2)
        arm.jacobian = Jacobian(-links.y1, -links.y2, links.x1, links.x2)
        course = arm.course_x
        error = course.place(u) - (arm.base.x + links.x1 + links.x2)
        rate = course.slope(u) / T + links.y1 * now.w1 + links.y2 * now.w2
        course = arm.course_y
        arm.error = Point(error, course.place(u) - (arm.base.y + links.y1 + links.y2))
        arm.error_rate = Point(rate, course.slope(u) / T - links.x1 * now.w1 - links.x2 * now.w2)
    for i, arm in enumerate(arms):
        fx = fy = 0.0
        kx, ky, bx, by = K[i], K[n + i], B[i], B[n + i]
        for j, other in enumerate(arms):
            fx += kx[j] * other.error.x + bx[j] * other.error_rate.x
            fy += ky[j] * other.error.y + by[j] * other.error_rate.y
        now = states[i].motion
        w1, w2 = now.w1, now.w2
        J, inertia = arm.jacobian, arm.inertia
        links = arm.lengths.first * arm.lengths.second
        turn = arm.mixed * (J.x2 * J.y1 - J.x1 * J.y2) / -links  # m sin(a2 - a1)
        mixed = arm.mixed * (J.x1 * J.x2 + J.y1 * J.y2) / links + arm.rotors
        q1 = arm.torque.first + J.x1 * fx + J.y1 * fy - arm.damping1 * w1 - arm.damping12 * w2 + turn * w2 * w2
        q2 = arm.torque.second + J.x2 * fx + J.y2 * fy - arm.damping12 * w1 - arm.damping2 * w2 - turn * w1 * w1
        determinant = inertia.first * inertia.second - mixed * mixed
        slopes[i].motion = LinkMotion(
            w1, w2, (inertia.second * q1 - mixed * q2) / determinant, (inertia.first * q2 - mixed * q1) / determinant
        )


@kernel
def integrate(plant: ArmPlantState, substeps: int) -> None:
    """Advance the arms' states by a sample with Butcher's sixth-order method in seven stages (1964), in equal substeps.

    For a period of 5 ms, one such substep takes less time than ten substeps of the classical fourth-order method, which
    have the same error.
    """
    h = plant.period / substeps
    stages = plant.stages
    y, z = stages.part(ArmStages.now), stages.part(ArmStages.trial)
    for step in range(substeps):
        derivative(plant, y, stages.part(ArmStages.slope1), step / substeps)
        for arm in stages:
            arm.trial.motion = arm.now.motion + h * arm.slope1.motion / 3.0
        derivative(plant, z, stages.part(ArmStages.slope2), (step + 1.0 / 3.0) / substeps)
        for arm in stages:
            arm.trial.motion = arm.now.motion + h * arm.slope2.motion * 2.0 / 3.0
        derivative(plant, z, stages.part(ArmStages.slope3), (step + 2.0 / 3.0) / substeps)
        for arm in stages:
            s = arm.slope1.motion + 4.0 * arm.slope2.motion - arm.slope3.motion
            arm.trial.motion = arm.now.motion + h * s / 12.0
        derivative(plant, z, stages.part(ArmStages.slope4), (step + 1.0 / 3.0) / substeps)
        for arm in stages:
            s = 18.0 * arm.slope2.motion - arm.slope1.motion - 3.0 * arm.slope3.motion - 6.0 * arm.slope4.motion
            arm.trial.motion = arm.now.motion + h * s / 16.0
        derivative(plant, z, stages.part(ArmStages.slope5), (step + 0.5) / substeps)
        for arm in stages:
            s = 9.0 * arm.slope2.motion - 3.0 * arm.slope3.motion - 6.0 * arm.slope4.motion + 4.0 * arm.slope5.motion
            arm.trial.motion = arm.now.motion + h * s / 8.0
        derivative(plant, z, stages.part(ArmStages.slope6), (step + 0.5) / substeps)
        for arm in stages:
            s = 9.0 * arm.slope1.motion - 36.0 * arm.slope2.motion + 63.0 * arm.slope3.motion
            arm.trial.motion = arm.now.motion + h * (s + 72.0 * arm.slope4.motion - 64.0 * arm.slope6.motion) / 44.0
        derivative(plant, z, stages.part(ArmStages.slope7), (step + 1.0) / substeps)
        for arm in stages:
            s = 11.0 * (arm.slope1.motion + arm.slope7.motion) + 81.0 * (arm.slope3.motion + arm.slope4.motion)
            arm.now.motion += h * (s - 32.0 * (arm.slope5.motion + arm.slope6.motion)) / 120.0


@kernel
def fastest_rate(plant: ArmPlantState) -> float:
    """Compute an upper bound of the rates of arm and hand [rad/s], which sets the number of substeps."""
    n, K, B = plant.fingers, plant.stiffness, plant.damping
    stiffness = damping = 0.0
    for row in range(2 * n):
        k = b = 0.0
        for j in range(n):
            k += abs(K[row, j])
            b += abs(B[row, j])
        stiffness = max(stiffness, k)
        damping = max(damping, b)
    rate = 0.0
    stages = plant.stages
    for i, arm in enumerate(plant.arms):
        I1, I2 = arm.inertia.first, arm.inertia.second
        mixed = abs(arm.mixed) + abs(arm.rotors)
        least = 0.5 * (I1 + I2) - math.sqrt(0.25 * (I1 - I2) * (I1 - I2) + mixed * mixed)  # smaller eigenvalue of M
        longer = max(arm.lengths.first, arm.lengths.second)
        rate = max(
            rate,
            math.sqrt(stiffness * longer * longer / least),
            (damping * longer * longer + max(arm.damping1, arm.damping2)) / least,
            2.0 * abs(stages[i].now.motion.w1),
            2.0 * abs(stages[i].now.motion.w2),
        )
    return rate


@kernel
def quintic(
    start: float, start_rate: float, middle: float, middle_rate: float, end: float, end_rate: float, T: float
) -> Course:
    """Return the polynomial through a target and its velocity at the beginning, the middle and the end of a sample."""
    r, h = start, start_rate * T
    # The difference between the target and r + h u is C at the middle and A at the end; its derivatives are D and B.
    C = middle - r - 0.5 * h
    D = middle_rate * T - h
    A = end - r - h
    B = end_rate * T - h
    c2 = 16.0 * C - 8.0 * D + 7.0 * A - B
    c3 = 32.0 * C - 6.0 * A + B - 4.0 * c2
    return Course(r, h, c2, c3, 5.0 * A - B - 3.0 * c2 - 2.0 * c3, B - 4.0 * A + 2.0 * c2 + c3)


@kernel
def show(plant: ArmPlantState) -> None:
    """Compute the tips' positions and velocities from the arms' states."""
    stages, x, v = plant.stages, plant.position, plant.velocity
    for i, arm in enumerate(plant.arms):
        now = stages[i].now.motion
        links = links_at(arm.lengths, now.a1, now.a2)
        x[2 * i] = arm.base.x + links.x1 + links.x2
        x[2 * i + 1] = arm.base.y + links.y1 + links.y2
        v[2 * i] = -links.y1 * now.w1 - links.y2 * now.w2
        v[2 * i + 1] = links.x1 * now.w1 + links.x2 * now.w2


@kernel
def plan(plant: ArmPlantState) -> None:
    """Convert the joint torques to torques along the directions of the links, and fit the targets' polynomials."""
    T, u = plant.period, plant.effort
    start, start_rate, end, end_rate = plant.start, plant.start_rate, plant.end, plant.end_rate
    middle, middle_rate = plant.middle, plant.middle_rate
    for i, arm in enumerate(plant.arms):
        x, y = 2 * i, 2 * i + 1
        arm.torque = Both(u[x] - u[y] if arm.elbow else u[x], u[y])
        arm.course_x = quintic(start[x], start_rate[x], middle[x], middle_rate[x], end[x], end_rate[x], T)
        arm.course_y = quintic(start[y], start_rate[y], middle[y], middle_rate[y], end[y], end_rate[y], T)


@kernel
def advance(plant: ArmPlantState) -> int:
    """Advance the plant by one sample; targets at the end of the sample become targets at the beginning of the next.

    Returns 0. If it returns NOT_FINITE or TOO_FAST, the plant has not moved.
    """
    n, T = plant.fingers, plant.period
    code: int = unfit(plant.effort, 7, 2 * n)  # the targets follow the efforts in memory
    if code != 0:
        return code
    rate = fastest_rate(plant)
    if not rate * T < STEP * MOST:
        return TOO_FAST
    plan(plant)
    integrate(plant, math.floor(rate * T / STEP) + 1)
    show(plant)
    for i in range(2 * n):
        plant.start[i], plant.start_rate[i] = plant.end[i], plant.end_rate[i]
    plant.ticks += 1.0
    return 0


class ArmPlant(HeldPlant):  # type: ignore[misc] # mypy does not see devices from inside the package
    """Plant of two-link arms and the hand that holds their tips; joint torques [N m] are held over each sample.

    The arms move in a horizontal plane, without gravity. Targets are interpolated from their positions and velocities
    at the beginning, the middle and the end of each sample. The number of substeps is chosen so that the tips stay
    within 1e-10 m of the exact motion.
    """

    kernel = staticmethod(advance)

    def __init__(self, mechanics: Sequence[Mechanics]) -> None:
        n = len(mechanics)
        self._geometry = [m.arm for m in mechanics]
        super().__init__(ArmPlantState, n, 2)
        block = self._block = ArmPlantState(self._entries)
        starts = [stages.now.offset for stages in block.stages]
        self._angles: Any = [self._entries[start : start + size_of(ArmStage)] for start in starts]
        K, B, gains = block.stiffness.offset, block.damping.offset, 2 * n * n
        self._stiffness = self.state[K : K + gains].reshape(2, n, n)
        self._damping = self.state[B : B + gains].reshape(2, n, n)
        for i, (m, arm) in enumerate(zip(mechanics, block.arms, strict=True)):
            base, away = m.arm.base, math.hypot(*m.arm.links)
            arm.base, arm.lengths = Point(*base), Both(*m.arm.links)
            I1, I2, arm.mixed, arm.rotors, arm.damping1, arm.damping12, arm.damping2 = m.constants
            arm.inertia, arm.elbow = Both(I1, I2), m.arm.drive == "elbow"
            self._turn(i, *m.arm.angles(base[0], base[1] + away))  # home position: the elbow at a right angle
        show(block)

    @property
    def structure(self) -> Index:
        """Indices of the entries `fingers`, `dimensions` and each arm's `elbow` in the block."""
        elbow = start_of(ArmConstants, "elbow")
        counts = [start_of(ArmPlantState, name) for name in ("fingers", "dimensions")]
        return np.array([*counts, *(arm.offset + elbow for arm in self._block.arms)])

    def sensed(self, i: int) -> int:
        """Return the index in the block of the direction a1 of the first link of arm i; a2 is the next entry."""
        start: int = self._block.stages[i].now.offset
        return start

    def angles(self, i: int) -> memoryview:
        """Return a view of a1, a2 [rad] and a1', a2' [rad/s] of arm i; every call returns the same view."""
        view: memoryview = self._angles[i]
        return view

    def fault_text(self, code: int) -> str:
        if code != TOO_FAST:
            text: str = super().fault_text(code)
            return text
        rate, T = fastest_rate(self._block), self._block.period
        return (
            f"the fastest rate of two-link arms and hand is {rate:.3g} rad/s, too fast for samples of {T:g} s: "
            "the motion has diverged, or the hand is too stiff"
        )

    def _put(self, position: FloatArray) -> None:
        postures = [arm.angles(x, y) for arm, (x, y) in zip(self._geometry, position.tolist(), strict=True)]
        for i, (a1, a2) in enumerate(postures):
            self._turn(i, a1, a2)

    def _grip(self, K: FloatArray, B: FloatArray, T: float) -> None:
        self._stiffness[...] = K
        self._damping[...] = B

    def _turn(self, i: int, a1: float, a2: float) -> None:
        at = self._angles[i]
        at[0], at[1], at[2], at[3] = a1, a2, 0.0, 0.0
