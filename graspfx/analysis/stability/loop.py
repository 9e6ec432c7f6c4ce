"""Sampled closed loop of a grasp as a matrix, its spectral radius, and the loop opened at the coupling's forces."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspfx.analysis.blas_threads import one_blas_thread
from graspfx.analysis.discrete import samples_and_part
from graspfx.analysis.linearisation import Linearisation, OperatorMatrices, Subject, linear_of
from graspfx.analysis.stability.late_roots import LateLoop, farthest_root
from graspfx.errors import InputError
from graspfx.exponential import expm1

FloatArray = NDArray[np.float64]
Motions = tuple[FloatArray, ...]

MOST_LATE = 80  # largest number of delayed reaction samples, over all coordinates, that are states of a loop
MOST_WALKED = 100_000  # largest delay [samples] times squared number of coordinates of a part; more takes minutes
DRIFT = 1e-10  # relative to the largest stiffness: motions that stretch springs less are free


@one_blas_thread()
def spectral_radius(linear: Subject, recording: object = None, *, drift: bool = False) -> float:
    """Compute the spectral radius of the sampled closed loop of a grasp; the loop is stable if it is below 1.

    Args:
        linear: `Linearisation`, scene, or name or path of a scene.
        recording: Recording of the scene, or path of the recording; the scene is linearised at the last sample. A
            recording of hardware also provides the lateness of forces: the less stable of its 1st and 99th percentiles
            is used. None to use the scene alone.
        drift: Whether to include common motions of fingers and object that do not change any force.
    """
    return radius_of(linear_of(linear, recording), drift=drift)


def radius_of(linear: Linearisation, *, drift: bool = False) -> float:
    """Compute the spectral radius of `loop_matrix`, including motions that do not change any force only if `drift`."""
    if is_late(linear):
        return abs(farthest_root(late_loop(linear, drift=drift)))
    A = loop_matrix(linear)
    if not drift:
        A = without_drift(linear, A)
    return float(np.abs(np.linalg.eigvals(A)).max(initial=0.0))


def loop_matrix(subject: Subject, motions: Motions | None = None) -> FloatArray:
    """Build the matrix A of the closed loop s_(k+1) = A s_k from sample k to the next.

    The state s consists of the device positions x and velocities x', the object's coordinates q and velocities q', and,
    where needed: x of the previous sample, earlier readings (if positions have an age), the ground's wrench (with the
    integrator "implicit"), delayed forces and wrenches, and, with an operator, the positions and velocities of limbs,
    the grip's force, and delayed reactions. Devices and hands advance by the exponential of their coupled equations,
    and the object by its integrator.

    Args:
        subject: `Linearisation`, scene, or name or path of a scene.
        motions: Result of `uncoupled`, which does not depend on the gains; computed if None.
    """
    return LoopRows(linear_of(subject), motions).closed()


class OpenLoop(NamedTuple):
    """Loop opened at the coupling's forces, s_(k+1) = A s_k + B u_k, f_k = C s_k, with `period` T [s].

    The inputs u (m,) are forces on devices and object in place of the coupling's forces f (m,). `hand` (states, m) is
    the input matrix of an operator's forces on the device coordinates, held over a sample.
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray
    hand: FloatArray
    period: float


def open_loop(subject: Subject) -> OpenLoop:
    """Open the loop at the coupling's forces f; with u = f, the open loop s_(k+1) = A s_k + B u_k is `loop_matrix`.

    With the integrator "implicit", C includes the coupling's prediction of the object.

    Args:
        subject: `Linearisation`, scene, or name or path of a scene.
    """
    linear = linear_of(subject)
    rows = LoopRows(linear, inputs=linear.coordinates[0])
    A, B, f = rows.opened()
    return OpenLoop(A, B, f, rows.hand, linear.period)


def is_late(linear: Linearisation) -> bool:
    """Return whether reactions have a delay of so many samples that one state for each would take too long."""
    operator = linear.operator
    return operator is not None and operator.reacts and int(operator.delay.max()) * len(linear.mass) > MOST_LATE


def late_loop(linear: Linearisation, motions: Motions | None = None, *, drift: bool = False) -> LateLoop:
    """Build the loop of an operator with a delayed reaction, with the reaction as input (`LateLoop`).

    Args:
        linear: Loop with a reaction.
        motions: Result of `uncoupled`; computed if None.
        drift: Whether to include motions that do not change any force.

    Raises:
        InputError: If the delay has too many samples for the number of device coordinates.
    """
    operator = linear.operator
    assert operator is not None
    m = len(linear.mass)
    samples, most = int(operator.delay.max()), MOST_WALKED // m**2
    if samples > most:
        raise InputError(
            "reaction.delay", f"{samples} samples",
            f"at most {most}, with {m} finger coordinates, for a stability analysis",
            "use a shorter delay, a longer period or fewer fingers; the scene can be run without this analysis",
        )  # fmt: skip
    plant = LoopRows(linear, motions, opened=True)
    rows = plant.closed()
    A, B, C = rows[:, : plant.size], rows[:, plant.size :], plant.sensed[:, : plant.size]
    basis = None if drift else drift_free(linear, plant.size)
    if basis is not None:
        A, B, C = basis.T @ A @ basis, basis.T @ B, C @ basis
    active = C.any(axis=1)
    return LateLoop(A, B[:, active], C[active], operator.delay[active])


class LoopRows:
    """Equations of devices, hands and object, as matrix rows that multiply the state and the inputs.

    The force of sample k acts on a device from (n + phi) T after the start of the sample, and its reading is (a + psi)
    T old, with integers n and a, and 0 <= phi, psi < 1. The device's state s = (x, x') advances by

        s_(k+1) = E(T) s_k + Gamma(T - phi T) F_(k-n) + [Gamma(T) - Gamma(T - phi T)] F_(k-n-1)

    under the force F on the device. Its position at the time of the reading is computed in the same way over (1 - psi)
    T. E(t) and Gamma(t) are the exact motion of devices and hands under a force held for t.

    Args:
        linear: Loop.
        motions: Result of `uncoupled`; computed if None.
        inputs: Number of input forces u that replace the coupling's forces.
        opened: Whether delayed reactions are inputs too.

    Attributes:
        size: Number of states.
        at: Rows that select each part of the state, by name of the part.
        reading: Rows of the positions that the coupling uses.
    """

    def __init__(
        self, linear: Linearisation, motions: Motions | None = None, inputs: int = 0, *, opened: bool = False
    ) -> None:
        m, r = linear.coordinates
        T, self.linear, self.operator = linear.period, linear, linear.operator
        late, self._phi = np.array([samples_and_part(seconds, T) for seconds in linear.lateness.tolist()]).T
        self._whole = late.astype(int) + linear.delay
        back, self._psi = np.array([samples_and_part(seconds, T) for seconds in linear.age.tolist()]).T
        self._back = back.astype(int)
        self._steps: dict[float, tuple[FloatArray, FloatArray]] = {}
        self.readings = late_readings(linear)
        self.lag = int((self._whole + (self._phi > 0.0)).max())
        self.differenced = linear.rate == "difference" and bool(linear.damping.any())
        self.implicit, self.grounded = linear.integrator == "implicit", linear.ground is not None
        parts = {"x": m, "v": m, "q": r, "w": r, "old": m if self.differenced else 0}
        parts |= {f"y{i}": m for i in range(self.readings)}
        parts |= {f"dy{i}": m for i in range(self.readings if linear.rate == "state" else 0)}
        parts["g"] = r if self.implicit and self.grounded else 0
        parts |= {f"f{i}": m for i in range(1, self.lag + 1)}
        parts |= {f"g{i}": r for i in range(1, linear.object_delay + 1)}
        operator = linear.operator
        self.reacts = operator is not None and operator.reacts
        if operator is not None:
            parts |= {"limb": operator.limbs, "limb_rate": operator.limbs, "grip": m if operator.grip.any() else 0}
            parts |= {f"s{i}": m for i in range(1, 1 + int(operator.delay.max()) * (self.reacts and not opened))}
        self.size = sum(parts.values())
        parts |= {"u": inputs, "h": m if self.reacts and opened else 0}
        whole, start = np.eye(sum(parts.values())), 0
        at: dict[str, FloatArray] = {}
        for name, width in parts.items():
            at[name] = whole[start : start + width]
            start += width
        self.at = at
        self.drift, self.hold, p, self.shift, R, self.push = uncoupled(linear) if motions is None else motions
        self.translation, self.spun = at["q"] + p @ at["w"], R @ at["w"]  # object without a wrench
        self.reading = self._read("x", "y")
        self.speed_reading = self._read("v", "dy") if linear.rate == "state" else at["v"]

    def closed(self) -> FloatArray:
        """Return the rows of the next state of the closed loop."""
        f, extra = self.coupling()
        return self.advanced(f + extra[: len(f)], self.linear.G @ f - extra[len(f) :])

    def opened(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the matrices A, B and C of `open_loop`: next state, with input forces, and forces of the coupling."""
        f, extra = self.coupling()
        u, m = self.at["u"], len(f)
        rows = self.advanced(u + extra[:m], self.linear.G @ u - extra[m:])
        return rows[:, : self.size], rows[:, self.size :], f[:, : self.size]

    @property
    def hand(self) -> FloatArray:
        """Input matrix of an operator's forces on the device coordinates, held over a sample, (states, m)."""
        m = len(self.linear.mass)
        push = self.hold.copy()
        for part, rows in _groups(np.tile(self._psi, 2)):
            push[rows] = self._step(1.0 - part)[1][rows]
        limbs = self.hold[2 * m :].reshape(2, -1, m)
        pushes = {"x": self.hold[:m], "v": self.hold[m : 2 * m], "limb": limbs[0], "limb_rate": limbs[1]}
        pushes |= {"y0": push[:m], "dy0": push[m : 2 * m]}
        entry = np.zeros((self.size, m))
        for name, each in pushes.items():
            if name in self.at:
                entry += self.at[name][:, : self.size].T @ each
        return entry

    def coupling(self) -> tuple[FloatArray, FloatArray]:
        """Return the rows of the coupling's forces, and the rows of the preload's forces on devices and object."""
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
        """Return the rows of the next state, from those of the displayed forces and of the wrench on the object."""
        linear, at, object_lag = self.linear, self.at, self.linear.object_delay
        late = [display_force, *(at[f"f{i}"] for i in range(1, self.lag + 1))]
        wrench = [felt, *(at[f"g{i}"] for i in range(1, object_lag + 1))][object_lag]
        motion = np.concatenate([at["x"], at["v"], *((at["limb"], at["limb_rate"]) if self.operator else ())])
        m = len(at["x"])
        displayed = np.stack([late[n][i] for i, n in enumerate(self._whole)])
        ended = np.stack([late[n + (self._phi[i] > 0.0)][i] for i, n in enumerate(self._whole)])
        state = self._moved(1.0, motion, displayed, ended)
        readings = self._newest(state, motion, displayed, ended)
        own: list[FloatArray] = []
        if self.operator is not None:
            push, own = self._operated(self.operator, displayed)
            state = state + push
            own = [state[2 * m :], *own]
            state = state[: 2 * m]
        q, s = self.shift, self.push
        borne = wrench + ground_wrench(linear, s, self.translation + q @ wrench, self.spun + s @ wrench)
        rows = [state, self.translation + q @ borne, self.spun + s @ borne]
        rows += [self.reading] if self.differenced else []
        rows += readings
        rows += [borne - wrench] if self.implicit and self.grounded else []
        rows += late[: self.lag] + [felt, *(at[f"g{i}"] for i in range(1, object_lag))][:object_lag]
        return np.concatenate(rows + own)

    def _read(self, fresh: str, name: str) -> FloatArray:
        """Return the rows of the readings that the coupling uses: part `fresh` without age, otherwise parts `name`."""
        if not self.readings:
            return self.at[fresh]
        return np.stack([self.at[f"{name}{a}"][i] for i, a in enumerate(self._back)])

    def _moved(self, part: float, motion: FloatArray, begun: FloatArray, ended: FloatArray) -> FloatArray:
        """Return the rows of (x, x') after a part of the sample, in which forces `ended` change to forces `begun`."""
        E, Gamma = self._step(part)
        state = E @ motion - Gamma @ begun
        if self._phi.any():
            fresh = Gamma.copy()
            for late, columns in _groups(self._phi):
                fresh[:, columns] = self._step(part - late)[1][:, columns] if part > late else 0.0
            state = state + (Gamma - fresh) @ (begun - ended)
        return np.asarray(state)

    def _newest(
        self, state: FloatArray, motion: FloatArray, begun: FloatArray, ended: FloatArray
    ) -> list[FloatArray]:  # fmt: skip
        """Return the rows of the readings in the next state; none if positions have no age."""
        if not self.readings:
            return []
        m, newest = len(self._psi), state.copy()
        for part, rows in _groups(np.tile(self._psi, 2)):
            newest[rows] = self._moved(1.0 - part, motion, begun, ended)[rows]
        rows_ = [newest[:m], *(self.at[f"y{i}"] for i in range(self.readings - 1))]
        if self.linear.rate == "state":
            rows_ += [newest[m : 2 * m], *(self.at[f"dy{i}"] for i in range(self.readings - 1))]
        return rows_

    def _step(self, part: float) -> tuple[FloatArray, FloatArray]:
        """Return E and Gamma (`LoopRows`) over a part of the sample."""
        if part == 1.0:
            return self.drift, self.hold
        if part not in self._steps:
            self._steps[part] = held_devices(self.linear, part * self.linear.period)
        return self._steps[part]

    def _operated(self, operator: OperatorMatrices, displayed: FloatArray) -> tuple[FloatArray, list[FloatArray]]:
        """Return the rows of grip and reaction forces' effect on (x, x', y, y'), and the rows of their next states."""
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


def _groups(parts: FloatArray) -> Sequence[tuple[float, NDArray[np.intp]]]:
    """List the distinct positive values of `parts`, each with the indices of the coordinates that have this value."""
    return [(part, np.flatnonzero(parts == part)) for part in np.unique(parts[parts > 0.0]).tolist()]


def late_readings(linear: Linearisation) -> int:
    """Return the number of readings of each coordinate that a loop's state contains; zero if positions have no age."""
    if not linear.age.any():
        return 0
    return 1 + max(samples_and_part(age, linear.period)[0] for age in linear.age.tolist())


def ground_wrench(linear: Linearisation, s: FloatArray, position: FloatArray, speed: FloatArray) -> FloatArray:
    """Compute the ground's wrench F_g from position q and velocity w of the object after a sample without ground.

    F_g = -Y [K_g (q + a w) + B_g w] with Y = [I + (T K_g + B_g) s]^-1, where s maps a wrench to a change of velocity.
    The lookahead a (`objects.floor.rest`) is chosen so that, for every integrator, a change of w changes the position
    at which the ground acts by T times as much.
    """
    if linear.ground is None:
        return np.zeros_like(position)
    K, B = linear.ground
    lead = {"explicit": 1.0, "exact": 0.5}.get(linear.integrator, 0.0) * linear.period
    met = K @ (position + lead * speed) + B @ speed
    return np.asarray(-np.linalg.solve(np.eye(len(K)) + (linear.period * K + B) @ s, met))


# Motions under held forces ------------------------------------------------------------------------------------------


def uncoupled(linear: Linearisation) -> Motions:
    """Return the results of `held_devices` and `object_matrices`, the motions under forces held over a sample."""
    matrices = object_matrices(linear.integrator, linear.inertia, linear.viscosity, linear.period)
    return *held_devices(linear), *matrices


def held_devices(linear: Linearisation, duration: float | None = None) -> tuple[FloatArray, FloatArray]:
    """Return the matrices from the devices' state and from held forces on devices to the state after T.

    The state is (x, x'), and the matrices are (2 m, 2 m) and (2 m, m). With limbs y (l,), the state is (x, x', y, y'),
    and the matrices are (2 m + 2 l, 2 m + 2 l) and (2 m + 2 l, m).

    Args:
        linear: Loop.
        duration: Duration [s]; the sampling period if None.
    """
    m, T = len(linear.mass), linear.period if duration is None else duration
    K, B = linear.hand_stiffness, linear.hand_damping + np.diag(linear.friction)
    if linear.operator is not None and linear.operator.limbs:
        E = _with_limbs(linear, linear.operator, T)
        states = len(E)
        return E[:, :states], E[:, states : states + m]
    if linear.operator is not None:
        B = B + linear.operator.friction
    if (K - np.diag(np.diag(K))).any() or (B - np.diag(np.diag(B))).any():
        per_mass = 1.0 / linear.mass[:, None]
        E = advance(per_mass * K, per_mass * B, per_mass * np.eye(m), T)
        return E[:, : 2 * m], E[:, 2 * m :]
    # coordinates that hands do not couple are independent
    wide, i = np.zeros((2, m, 3, m)), np.arange(m)
    rows = zip(linear.mass.tolist(), np.diag(B).tolist(), np.diag(K).tolist(), strict=True)
    wide[:, i, :, i] = [_advance_alone(k / mass, b / mass, 1.0 / mass, T) for mass, b, k in rows]
    E = wide.reshape(2 * m, 3 * m)
    return E[:, : 2 * m], E[:, 2 * m :]


def held_limbs(linear: Linearisation) -> FloatArray:
    """Return the matrix from held forces on limbs to the state (x, x', y, y') after T, (2 m + 2 l, l)."""
    if linear.operator is None or not linear.operator.limbs:
        return np.zeros((2 * len(linear.mass), 0))
    E = _with_limbs(linear, linear.operator, linear.period)
    return E[:, len(E) + len(linear.mass) :]


def _with_limbs(linear: Linearisation, operator: OperatorMatrices, T: float) -> FloatArray:
    """Return the matrix from (x, x', y, y') and held forces on devices and limbs to (x, x', y, y') after T."""
    m, limbs = operator.limb.shape
    S, tip, damper = operator.limb, linear.hand_stiffness, linear.hand_damping
    push = np.zeros((m + limbs, m + limbs))
    push[:m, :m], push[m:, m:] = np.diag(1.0 / linear.mass), np.linalg.inv(operator.limb_mass)
    K = np.block([[tip, -tip @ S], [-S.T @ tip, S.T @ tip @ S + operator.limb_stiffness]])
    B = np.block([[damper, -damper @ S], [-S.T @ damper, S.T @ damper @ S + operator.limb_damping]])
    B[:m, :m] += np.diag(linear.friction) + operator.friction
    E = advance(push @ K, push @ B, push, T)
    at = np.arange(3 * (m + limbs)).reshape(3, m + limbs)
    order = np.concatenate([at[0, :m], at[1, :m], at[0, m:], at[1, m:]])
    return np.asarray(E[np.ix_(order, np.concatenate([order, at[2]]))])


def advance(stiffness: FloatArray, damping: FloatArray, push: FloatArray, T: float) -> FloatArray:
    """Return the matrix (2 m, 3 m) from (x, x', F) to (x, x') after T, for x'' = -stiffness x - damping x' + push F."""
    m = len(push)
    A = np.zeros((3 * m, 3 * m))
    A[:m, m : 2 * m] = np.eye(m)  # in s = t/T, for x and T x'
    A[m : 2 * m, :m] = -T * T * stiffness
    A[m : 2 * m, m : 2 * m] = -T * damping
    A[m : 2 * m, 2 * m :] = T * T * push
    E = expm1(A)[: 2 * m]
    np.einsum("ii->i", E[:, : 2 * m])[:] += 1.0
    E[:m, m : 2 * m] *= T
    E[m:] /= T
    E[m:, m : 2 * m] *= T
    return E


@lru_cache(maxsize=256)
def _advance_alone(stiffness: float, damping: float, push: float, T: float) -> FloatArray:
    """Compute `advance` for one coordinate, cached for coordinates with equal properties."""
    one = np.ones((1, 1))
    return advance(stiffness * one, damping * one, push * one, T)


def object_matrices(
    integrator: str, inertia: FloatArray, viscosity: FloatArray, T: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the matrices (P, Q, R, S), each (r, r), of an object's step q+ = q + P w + Q F, w+ = R w + S F.

    The wrench F acts on the object of position q and velocity w over the sampling period T. With the integrator
    "implicit", Q and S are also used to solve for the force.
    """
    figures = (np.ascontiguousarray(each, dtype=float).tobytes() for each in (inertia, viscosity))
    return _object_matrices(integrator, len(inertia), *figures, T)


@lru_cache(maxsize=64)
def _object_matrices(
    integrator: str, n: int, inertia_entries: bytes, viscosity_entries: bytes, T: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Compute `object_matrices`, cached by the object's properties."""
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


# Motions that change no force ----------------------------------------------------------------------------------------


def without_drift(linear: Linearisation, A: FloatArray) -> FloatArray:
    """Remove from A the motions (x, q) that do not change any force, which are eigenvectors with eigenvalue 1."""
    basis = drift_free(linear, len(A))
    return A if basis is None else np.asarray(basis.T @ A @ basis, dtype=float)


def drift_free(linear: Linearisation, states: int) -> FloatArray | None:
    """Find an orthonormal basis of the complement, in a loop's states, of the motions that do not change any force.

    Return None if every motion changes a force.
    """
    m, r = linear.coordinates
    K = np.zeros((m + r, m + r))
    K[:m, :m] = linear.stiffness
    K[:m, m:] = -linear.stiffness @ linear.G_displacement.T
    K[m:] = -linear.G @ K[:m]
    if linear.preload is not None:
        K += linear.preload
    if linear.ground is not None:
        K[m:, m:] += linear.ground[0]
    holding = linear.hand_stiffness  # its product with x is zero if a displacement x stretches no hand
    if linear.operator is not None:
        holding = np.vstack([holding, linear.operator.pull])
    hand = np.hstack([holding, np.zeros((len(holding), r))])
    # coordinates scaled by the root of their mass or inertia, so that metres and radians are comparable
    length = np.sqrt(np.concatenate([linear.mass, np.diag(linear.inertia)]) / linear.mass.mean())
    stretch = np.vstack([K / length[:, None], hand]) / length
    _, sizes, motions = np.linalg.svd(stretch)
    free = motions[sizes <= DRIFT * max(float(sizes[0]), 1e-300)] / length
    if not len(free):
        return None
    drifts = np.zeros((states, len(free)))
    drifts[:m], drifts[2 * m : 2 * m + r] = free.T[:m], free.T[m:]
    remembered = int(linear.rate == "difference" and linear.damping.any()) + late_readings(linear)
    drifts[2 * (m + r) : 2 * (m + r) + m * remembered] = np.tile(free.T[:m], (remembered, 1))
    return np.linalg.qr(drifts, mode="complete")[0][:, len(free) :]
