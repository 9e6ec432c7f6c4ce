"""The whole sampled closed loop of a grasp as one matrix."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspfx.analysis.linearisation import Linearisation, Subject, linear_of
from graspfx.analysis.operator_matrices import OperatorMatrices
from graspfx.analysis.stability.held_devices import advance, held_devices, held_limbs
from graspfx.analysis.stability.late_devices import LateDevices, late_readings
from graspfx.analysis.stability.late_roots import LateLoop, farthest_root
from graspfx.errors import InputError

FloatArray = NDArray[np.float64]

MOST_LATE = 80  # samples of reactions, over all coordinates, that are states of a loop
MOST_WALKED = 100_000  # samples of delay times coordinates squared of one part of a loop: beyond, judging takes minutes
DRIFT = 1e-10  # relative: motions that stretch nothing more than this part of the stiffest are free


Motions = tuple[FloatArray, ...]


def loop_matrix(subject: Subject, motions: Motions | None = None) -> FloatArray:
    """Build A of s_(k+1) = A s_k, s = (x, x', q, q', x_(k-1), readings, ground's wrench, forces undisplayed, unfelt).

    After them, of an operator: limbs and their rates, what the grip has added, and reactions to come. Readings are
    there where the positions that the coupling takes have an age.

    Devices and hands by the exponential of their coupled equations, the object by its integrator. The ground's last
    wrench is there under "implicit", whose prediction holds it.

    Args:
        subject: the grasp: a `Linearisation`, a scene, or the name or path of one.
        motions: `uncoupled` of it, if known: gains are no part of it.
    """
    linear = linear_of(subject)
    plant = Plant(linear, motions)
    f, extra = plant.coupling()
    return plant.advanced(f + extra[: len(f)], linear.G @ f - extra[len(f) :])


def open_loop(subject: Subject) -> OpenLoop:
    """Open the loop where forces meet the plants: s_(k+1) = A s_k + B u_k, f_k = C s_k; with u = f it is `loop_matrix`.

    Under "implicit" the coupling's own prediction of the object stays inside of C.

    Args:
        subject: the grasp: a `Linearisation`, a scene, or the name or path of one.
    """
    linear = linear_of(subject)
    m, _ = linear.coordinates
    plant = Plant(linear, inputs=m)
    f, extra = plant.coupling()
    u = plant.at["u"]
    rows = plant.advanced(u + extra[:m], linear.G @ u - extra[m:])
    return OpenLoop(rows[:, : plant.size], rows[:, plant.size :], f[:, : plant.size], plant.hand, linear.period)


def is_late(linear: Linearisation) -> bool:
    """Tell whether a loop has a reaction with so many samples of delay that a state for each would take too long."""
    operator = linear.operator
    return operator is not None and operator.reacts and int(operator.delay.max()) * len(linear.mass) > MOST_LATE


def late_loop(linear: Linearisation, motions: Motions | None = None, *, drift: bool = False) -> LateLoop:
    """Build the loop of an operator with a late reaction, opened where the reaction enters.

    Args:
        linear: of a loop with a reaction.
        motions: `uncoupled` of it, if known.
        drift: count motions of everything that change no force, too.

    Raises:
        InputError: more samples of delay than so many coordinates are judged with.
    """
    operator = linear.operator
    assert operator is not None
    m = len(linear.mass)
    samples, most = int(operator.delay.max()), MOST_WALKED // m**2
    if samples > most:
        raise InputError(
            "reaction.delay", f"{samples} samples", f"at most {most}, with {m} coordinates of fingers; not judged",
            "a shorter delay, a longer period or fewer fingers; the scene can be run as it is",
        )  # fmt: skip
    plant = Plant(linear, motions, opened=True)
    f, extra = plant.coupling()
    rows = plant.advanced(f + extra[: len(f)], linear.G @ f - extra[len(f) :])
    A, B, C = rows[:, : plant.size], rows[:, plant.size :], plant.sensed[:, : plant.size]
    basis = None if drift else drift_free(linear, plant.size)
    if basis is not None:
        A, B, C = basis.T @ A @ basis, basis.T @ B, C @ basis
    active = C.any(axis=1)
    return LateLoop(A, B[:, active], C[active], operator.delay[active])


class OpenLoop(NamedTuple):
    """A loop opened at the coupling's forces u (m,), which act as contact forces on the object do: A, B, C.

    `hand` (states, m) is how a force of the operator on each device coordinate, held over a sample, enters.
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray
    hand: FloatArray
    period: float


class Plant:
    """Devices, hands and object without their coupling, as rows over the state and, beside it, some inputs."""

    def __init__(
        self, linear: Linearisation, motions: Motions | None = None, inputs: int = 0, *, opened: bool = False
    ) -> None:
        m, r = linear.coordinates
        self.linear, self.object_lag = linear, linear.object_delay
        self.late = None if not linear.latency.any() else LateDevices(linear)
        self.lag = int(linear.delay.max()) if self.late is None else self.late.forces
        self.differenced = linear.rate == "difference" and bool(linear.damping.any())
        self.implicit, self.grounded = linear.integrator == "implicit", linear.ground is not None
        ground = r if self.implicit and self.grounded else 0
        parts = {"x": m, "v": m, "q": r, "w": r, "old": m if self.differenced else 0}
        parts |= {f"y{i}": m for i in range(0 if self.late is None else self.late.readings)}
        parts |= {f"dy{i}": m for i in range(0 if self.late is None or linear.rate != "state" else self.late.readings)}
        parts["g"] = ground
        parts |= {f"f{i}": m for i in range(1, self.lag + 1)} | {f"g{i}": r for i in range(1, self.object_lag + 1)}
        self.operator = operator = linear.operator
        self.reacts = operator is not None and operator.reacts
        if operator is not None:
            parts |= {"limb": operator.limbs, "limb_rate": operator.limbs, "grip": m if operator.grip.any() else 0}
            parts |= {f"s{i}": m for i in range(1, 1 + int(operator.delay.max()) * (self.reacts and not opened))}
        self.size = sum(parts.values())
        parts["u"] = inputs
        parts["h"] = inputs_h = m if self.reacts and opened else 0
        at: dict[str, FloatArray] = {}
        whole, start = np.eye(self.size + inputs + inputs_h), 0
        for name, width in parts.items():
            at[name] = whole[start : start + width]
            start += width
        self.at = at
        self.drift, self.hold, p, q, R, s = uncoupled(linear) if motions is None else motions
        self.shift, self.push = q, s
        self.translation, self.spun = at["q"] + p @ at["w"], R @ at["w"]  # the object without a wrench
        self.reading = at["x"] if self.late is None else self.late.pick(at, "x", "y")
        self.speed_reading = at["v"] if self.late is None or linear.rate != "state" else self.late.pick(at, "v", "dy")

    @property
    def hand(self) -> FloatArray:
        """How a force of the operator on each device coordinate, held over a sample, enters, (states, m)."""
        m = len(self.linear.mass)
        entry = np.zeros((self.size, m))
        entry[: 2 * m] = self.hold[: 2 * m]
        if self.operator is not None and self.operator.limbs:
            place = np.concatenate([self.at["limb"], self.at["limb_rate"]])[:, : self.size].argmax(axis=1)
            entry[place] = self.hold[2 * m :]
        if self.late is not None and self.late.readings:
            start = 2 * sum(self.linear.coordinates) + (m if self.differenced else 0)
            push = self.late.age_forced
            entry[start : start + m] = push[:m]
            if self.linear.rate == "state":
                start += m * self.late.readings
                entry[start : start + m] = push[m:]
        return entry

    def coupling(self) -> tuple[FloatArray, FloatArray]:
        """Give the coupling's forces f, and what the preload adds to devices and object, as rows over the state."""
        linear, at, q, s = self.linear, self.at, self.shift, self.push
        m, r = linear.coordinates
        T = linear.period
        x = self.reading
        rate = (x - at["old"]) / T if self.differenced else self.speed_reading
        N = np.zeros((m + r, m + r)) if linear.preload is None else linear.preload
        K, D, G, G_e = linear.stiffness, linear.damping, linear.G, linear.G_displacement
        pose, speed = (self.translation, self.spun) if self.implicit else (at["q"], at["w"])
        if self.implicit and self.grounded:
            pose, speed = self.translation + q @ at["g"], self.spun + s @ at["g"]
        f = K @ (x - G_e.T @ pose) + D @ (rate - G.T @ speed)
        extra = N @ np.concatenate([x, pose])
        if self.implicit and linear.G_contact is not None:
            # u = q (G_c K e + G D e') - q (G_c K G_c' + G D G'/T) u, then f = K (e - G_c'u) + D (e' - G'u/T)
            stretch, slip, c = x - G_e.T @ pose, rate - G.T @ speed, linear.G_contact
            implicit_part = np.eye(r) + q @ (c @ K @ c.T + G @ D @ G.T / T)
            u = np.linalg.solve(implicit_part, q @ (c @ K @ stretch + G @ D @ slip))
            f = f - K @ c.T @ u - D @ G.T @ u / T
        elif self.implicit:  # f = f_free - (K G_e' q + D G' s) (G f - extra_q)
            yields = K @ G_e.T @ q + D @ G.T @ s
            f = np.linalg.solve(np.eye(m) + yields @ G, f + yields @ extra[m:])
        return f, extra

    def advanced(self, display_force: FloatArray, felt: FloatArray) -> FloatArray:
        """Give the next state's rows, for the force to display on devices and the wrench that the object is to feel."""
        linear, at, lag, object_lag = self.linear, self.at, self.lag, self.object_lag
        late = [display_force, *(at[f"f{i}"] for i in range(1, lag + 1))]
        wrench = [felt, *(at[f"g{i}"] for i in range(1, object_lag + 1))][object_lag]
        motion = np.concatenate([at["x"], at["v"], *((at["limb"], at["limb_rate"]) if self.operator else ())])
        m = len(at["x"])
        readings: list[FloatArray] = []
        if self.late is None:
            displayed = np.stack([late[d][i] for i, d in enumerate(linear.delay)])
            state = self.drift @ motion - self.hold @ displayed
        else:
            state, readings = self.late.advanced(self.drift, self.hold, motion, late, at)
            displayed = self.late.begun(late)
        own: list[FloatArray] = []
        if self.operator is not None:
            push, own = self._operated(self.operator, displayed)
            state = state + push
            own = [state[2 * m :], *own]
            state = state[: 2 * m]
        translation, spun, q, s = self.translation, self.spun, self.shift, self.push
        borne = wrench + ground_wrench(linear, s, translation + q @ wrench, spun + s @ wrench)
        rows = [state, translation + q @ borne, spun + s @ borne]
        rows += [self.reading] if self.differenced else []
        rows += readings
        rows += [borne - wrench] if self.implicit and self.grounded else []
        rows += late[:lag] + [felt, *(at[f"g{i}"] for i in range(1, object_lag))][:object_lag]
        return np.concatenate(rows + own)

    def _operated(self, operator: OperatorMatrices, displayed: FloatArray) -> tuple[FloatArray, list[FloatArray]]:
        """Give what the operator's own forces add to (x, x', y, y'), and the rows of what it remembers."""
        at, S = self.at, operator.limb
        limbs = held_limbs(self.linear)
        push = np.zeros((len(self.hold), displayed.shape[1]))
        memory: list[FloatArray] = []
        if operator.grip.any():
            a = operator.grip_share[:, None]
            grip = a * at["grip"] - (1.0 - a) * (operator.grip @ displayed)
            push += self.hold @ grip - limbs @ (S.T @ grip)
            memory.append(grip)
        if self.reacts:
            self.sensed = operator.pull @ at["x"] + operator.pull_damping @ at["v"] - operator.counter @ displayed
            if len(at["h"]):
                h = at["h"]
            else:
                h = -np.stack([at[f"s{d}"][i] for i, d in enumerate(operator.delay)])
                memory += [self.sensed, *(at[f"s{i}"] for i in range(1, int(operator.delay.max())))]
            push += self.hold @ (h - S @ (S.T @ h)) + limbs @ (S.T @ h)
        return push, memory


def ground_wrench(linear: Linearisation, s: FloatArray, position: FloatArray, speed: FloatArray) -> FloatArray:
    """Compute F_g = -(K_g q_1 + B_g w_1) of the motion that it brings about, from position and speed without it.

    F_g = -Y [K_g (q + a w) + B_g w], Y = [I + (T K_g + B_g) s]^-1, with a as `objects.floor.rest` looks ahead, so that
    every integrator meets the ground as q_0 + T w_1.
    """
    if linear.ground is None:
        return np.zeros_like(position)
    K, B = linear.ground
    lead = {"explicit": 1.0, "exact": 0.5}.get(linear.integrator, 0.0) * linear.period
    met = K @ (position + lead * speed) + B @ speed
    return np.asarray(-np.linalg.solve(np.eye(len(K)) + (linear.period * K + B) @ s, met))


def uncoupled(linear: Linearisation) -> Motions:
    """Give `held_devices`, then `object_matrices`: how devices and object move under forces held over a sample."""
    matrices = object_matrices(linear.integrator, linear.inertia, linear.viscosity, linear.period)
    return *held_devices(linear), *matrices


def object_matrices(
    integrator: str, inertia: FloatArray, viscosity: FloatArray, T: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Compute (p, q, r, s) of q+ = q + p w + q F, w+ = r w + s F under a wrench F held over T, each (r, r).

    Under "implicit" q and s are also what the force is solved with.
    """
    figures = (np.ascontiguousarray(each, dtype=float).tobytes() for each in (inertia, viscosity))
    return _object_matrices(integrator, len(inertia), *figures, T)


@lru_cache(maxsize=64)
def _object_matrices(
    integrator: str, n: int, inertia_entries: bytes, viscosity_entries: bytes, T: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Compute `object_matrices`, once for an object whatever pushes it."""
    inertia, viscosity = (np.frombuffer(each).reshape(n, n) for each in (inertia_entries, viscosity_entries))
    I = np.eye(n)  # noqa: E741 (the identity's letter)
    per: FloatArray = np.asarray(np.linalg.inv(inertia), dtype=float)
    a: FloatArray = per @ viscosity
    if integrator == "explicit":
        return T * I, np.zeros((n, n)), I - T * a, T * per
    if integrator == "semi-implicit":
        return T * (I - T * a), T * T * per, I - T * a, T * per
    if integrator == "implicit":
        R: FloatArray = np.asarray(np.linalg.inv(I + T * a), dtype=float)
        return T * R, T * T * R @ per, R, T * R @ per
    E = advance(np.zeros((n, n)), a, per, T)
    R, s = E[n:, n : 2 * n], E[n:, 2 * n :]
    if integrator == "bullet":
        return T * R, T * s, R, s
    return E[:n, n : 2 * n], E[:n, 2 * n :], R, s


def radius_of(linear: Linearisation, *, drift: bool = False) -> float:
    """Find the largest |z| of the eigenvalues of `loop_matrix`, without free motions of everything unless `drift`."""
    if is_late(linear):
        return abs(farthest_root(late_loop(linear, drift=drift)))
    A = loop_matrix(linear)
    if not drift:
        A = without_drift(linear, A)
    return float(np.abs(np.linalg.eigvals(A)).max(initial=0.0))


def without_drift(linear: Linearisation, A: FloatArray) -> FloatArray:
    """Restrict A to the states up to the motions (x, q) that change no force: those stay where they are, A s = s."""
    basis = drift_free(linear, len(A))
    return A if basis is None else np.asarray(basis.T @ A @ basis, dtype=float)


def _holding(linear: Linearisation) -> FloatArray:
    """Give rows whose product with x is zero where a displacement x of the devices stretches no hand."""
    if linear.operator is None:
        return linear.hand_stiffness
    return np.vstack([linear.hand_stiffness, linear.operator.pull])


def drift_free(linear: Linearisation, states: int) -> FloatArray | None:
    """Find an orthonormal basis of the states without motions that change no force; None where all of them count."""
    m, r = linear.coordinates
    K = np.zeros((m + r, m + r))
    K[:m, :m] = linear.stiffness
    K[:m, m:] = -linear.stiffness @ linear.G_displacement.T
    K[m:] = -linear.G @ K[:m]
    if linear.preload is not None:
        K += linear.preload
    if linear.ground is not None:
        K[m:, m:] += linear.ground[0]
    holding = _holding(linear)
    hand = np.hstack([holding, np.zeros((len(holding), r))])
    # coordinates in units of the energy that they store, so that metres and radians compare
    length = np.sqrt(np.concatenate([linear.mass, np.diag(linear.inertia)]) / linear.mass.mean())
    stretch = np.vstack([K / length[:, None], hand]) / length
    _, sizes, motions = np.linalg.svd(stretch)
    free = motions[sizes <= DRIFT * max(float(sizes[0]), 1e-300)] / length
    if not len(free):
        return None
    drifts = np.zeros((states, len(free)))
    drifts[:m], drifts[2 * m : 2 * m + r] = free.T[:m], free.T[m:]
    start = 2 * (m + r)
    if linear.rate == "difference" and linear.damping.any():
        drifts[start : start + m] = free.T[:m]
        start += m
    for _ in range(late_readings(linear)):
        drifts[start : start + m] = free.T[:m]
        start += m
    return np.linalg.qr(drifts, mode="complete")[0][:, len(free) :]
