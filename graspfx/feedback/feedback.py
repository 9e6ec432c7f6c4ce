"""Squeeze and push of another simulator's contacts, with separate gains, as forces on the operator."""

from __future__ import annotations

import math
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.card import Card, Carded
from graspfx.compile.kernel import source_function
from graspfx.compile.machine import compiled
from graspfx.compile.records import size_for
from graspfx.errors import InputError, MissingPackageError
from graspfx.feedback.contact_split import ContactSplitState, Shown, divide_contacts
from graspfx.feedback.host_limits import gain_limits
from graspfx.grasp.direct import PointGrasp
from graspfx.numeric import LARGEST, finite, number, real, single

if TYPE_CHECKING:
    from graspfx.feedback.host_link import HostLink

FloatArray = NDArray[np.float64]

TOLERANCE = 1e-6  # tolerance of the split's rank, as in `Split`
ROOM = 8  # initial capacity for contacts
SCALARS = ("contacts", "normals", "torques", "referred", "faulty", "time", "grip")
NO_CONTACT = "no contact: all forces fade to zero"


class Feedback(Carded):
    """Convert the forces of a grasp in another simulator, or of a real gripper, to forces for haptic devices.

        f = f_e + f_i,   f_e = P f,   f_i = (I - P) f                      (Kawai and Yoshikawa, eq. 3)
        fingers = Kp f_e + Ks f_i,   push = Kp sum_i f_e,i,   grip = mean_i n_i.(Ks f_i,i)

    Here f contains the forces of all fingers, P is the projector on external forces, and n_i is the unit normal of
    finger i into the object. The sum of the fingers' forces does not contain the squeeze, and the sum of their
    magnitudes has no direction. `Feedback` therefore separates the squeeze, and scales it by a separate gain. P is
    computed as by `graspfx.divide` (pseudoinverse, hard contacts).

    `forces` act from the object on the fingers; results are forces on the operator. With the opposite sign, the
    feedback would be positive: a hand that closes on an object would be closed further.

    When a finger makes or breaks contact, the split changes at once, but the displayed forces are continuous. The
    difference from the previous forces decreases linearly to zero within `fade`.

    Args:
        push_gain: Gain Kp of the external forces: a number, or a matrix (d, d).
        squeeze_gain: Gain Ks of the internal forces: a number, or a matrix (d, d).
        moment_gain: Gain of the moment. If None, `push_gain` is used if it is a number, else 1.
        fingers: Number n of fingers. If None, the largest number in any sample so far is used.
        fade: Time over which the jump of forces at a change of contacts is faded out [s].
        largest: Largest plausible component of a contact force [N].
        engine: "auto", "compiled" or "interpreted".

    Raises:
        InputError: If an argument is invalid.
        MissingPackageError: If the engine is "compiled" and llvmlite is missing.
    """

    def __init__(
        self,
        push_gain: ArrayLike = 1.0,
        squeeze_gain: ArrayLike = 1.0,
        *,
        moment_gain: float | None = None,
        fingers: int | None = None,
        fade: float = 0.05,
        largest: float = 1e3,
        engine: str = "auto",
    ) -> None:
        self._gains = {"push_gain": _gain("push_gain", push_gain), "squeeze_gain": _gain("squeeze_gain", squeeze_gain)}
        push = self._gains["push_gain"]
        given = (float(push) if push.ndim == 0 else 1.0) if moment_gain is None else moment_gain
        self._gains["moment_gain"] = np.array(number("moment_gain", given, "a number, zero or above"))
        self.fade = number("fade", fade, "a time above zero [s]", zero=False)
        self.largest = number("largest", largest, "a force above zero [N]", zero=False)
        if fingers is not None and (type(fingers) is not int or fingers < 1):
            raise InputError("fingers", fingers, "an integer of at least 1, or None")
        if str(engine) not in ("auto", "compiled", "interpreted"):
            raise InputError("engine", engine, "'auto', 'compiled' or 'interpreted'")
        self._fixed, self._engine = fingers, engine
        self._state: ContactSplitState | None = None
        self._dimensions, self._time = 0, -math.inf

    def update(
        self,
        points: ArrayLike,
        forces: ArrayLike,
        time: float,
        normals: ArrayLike | None = None,
        torques: ArrayLike | None = None,
        *,
        finger: ArrayLike | None = None,
        reference: ArrayLike | None = None,
    ) -> Shown:
        """Compute the forces on the operator for the contacts of one sample.

        Args:
            points: Contact points (m, d) [m]; (0, d) without contacts.
            forces: Forces of the object on the fingers at these points, (m, d) [N].
            time: Time of the sample on the host's clock [s]; it must increase from call to call.
            normals: Normals into the object (m, d), of any length. If None, the vectors from each finger's point to the
                mean of the other fingers' points are used.
            torques: Torques of the object on the fingers, (m, 3), or (m,) in the plane [N m]; `moment` includes them.
            finger: Index of the finger of each contact, (m,); a finger may have several contacts. If None, contact j
                belongs to finger j.
            reference: Reference point of the moment in this sample, (d,) [m], such as the object's present centre. If
                None, the mean of the fingers' points is used.

        Returns:
            Forces on the operator.

        Raises:
            InputError: If values are not finite, a force exceeds `largest`, shapes do not agree, or the time does not
                increase.
        """
        p, f = real("points", points), real("forces", forces)
        if p.ndim != 2 or p.shape != f.shape or p.shape[1] not in (1, 2, 3):
            raise InputError("points, forces", (p.shape, f.shape), "two arrays of the same shape (m, d), d = 1, 2 or 3")
        m, d = p.shape
        numbers = None
        if finger is not None:
            with suppress(ValueError):  # a list that is no array
                numbers = np.asarray(finger)
            if (
                numbers is None
                or numbers.shape != (m,)
                or (m and (numbers.dtype.kind not in "iu" or numbers.min() < 0))
            ):
                raise InputError("finger", finger, f"{m} non-negative integers: the finger of each contact")
        most = m if numbers is None else int(numbers.max(initial=-1)) + 1
        self._prepare(d, m, most)
        t = single("time", time, "a time [s]")
        if not t > self._time:
            raise InputError("time", time, f"a time after that of the previous sample, {self._time:g} s")
        view, at = self._view, self._at
        view[at["contacts"]], view[at["time"]] = m, t
        view[at["normals"]], view[at["torques"]], view[at["referred"]] = (
            float(each is not None) for each in (normals, torques, reference)
        )
        if m:
            self._point[:m, :d], self._force[:m, :d] = p, f
            if numbers is not None:
                self._finger[:m], self._is_plain = numbers, False
            elif not self._is_plain:
                self._finger[:], self._is_plain = self._range, True
            if normals is not None:
                self._normal[:m, :d] = _fitting("normals", normals, (m, d))
            if torques is not None:
                width = slice(0, 3) if d == 3 else slice(2, 3)
                shape = (m, 3) if d == 3 else (m,)
                self._torque[:m, width] = _fitting("torques", torques, shape).reshape(m, -1)
        if reference is not None:
            self._reference[:d] = _fitting("reference", reference, (d,))
        self._compute()
        if view[at["faulty"]]:
            self._refuse(f, p)
        self._time = t
        return self._shown(d, m)

    def _shown(self, d: int, m: int) -> Shown:
        out, n = self._out.copy(), self._n  # rows: push, moment, three per finger, and which fingers touch
        rows = out[6 : 6 + 9 * n].reshape(3, n, 3)
        if d < 3:
            rows = rows[:, :, :d]
        felt, external, internal = rows
        moment = out[3:6] if d == 3 else out[5:6]
        grip, touching = self._view[self._at["grip"]], out[6 + 9 * n :] != 0.0
        return Shown(out[:d], moment, grip, felt, external, internal, touching, "" if m else NO_CONTACT)

    def _refuse(self, f: FloatArray, p: FloatArray) -> None:
        """Raise an InputError that names the invalid value."""
        finite("points", p, do="the simulator has diverged, or a contact has no values")
        finite("forces", f, do="the simulator has diverged; the forces of the device become zero")
        if abs(f).max(initial=0.0) > self.largest:
            raise InputError(
                "forces", float(abs(f).max()), f"forces of at most {self.largest:g} N per component",
                "check the unit; for impacts with stiff contacts increase Feedback(largest=...)",
            )  # fmt: skip
        expected = f"finite numbers of at most {LARGEST:g} in SI units"
        raise InputError("normals, torques, reference, time", "a number that is not finite or too large", expected)

    def _prepare(self, d: int, contacts: int, most: int) -> None:
        """Allocate memory for contacts and fingers, unless the present memory is large enough."""
        n = 1
        if self._state is not None:
            if d != self._dimensions:
                raise InputError("points", f"(m, {d})", f"(m, {self._dimensions}), as in the previous samples")
            if contacts <= self._capacity and most <= self._n:
                return
            n = self._n
        n = max(most, n) if self._fixed is None else self._fixed
        if most > n:
            raise InputError("finger", most - 1, f"contacts of fingers 0 to {n - 1}, because of Feedback(fingers={n})")
        for name, gain in self._gains.items():
            if gain.ndim and gain.shape != (d, d):
                raise InputError(name, gain, f"a number or a matrix ({d}, {d}), because points have {d} coordinates")
        self._make(d, n, 2 * contacts if contacts > ROOM else ROOM)

    def _make(self, d: int, n: int, capacity: int) -> None:
        """Create a state, and copy the previous forces on the operator to it."""
        old, before = self._state, None if self._state is None else self._views()
        grasp = size_for(PointGrasp, count=n, dimensions=d)
        counts = {"fingers": n, "dimensions": d, "capacity": capacity, "grasp_entries": grasp}
        block = np.zeros(size_for(ContactSplitState, **counts))
        self._state = state = ContactSplitState(block)
        for name, count in counts.items():
            setattr(state, name, count)
        state.grasp.tolerance, state.fade, state.largest = TOLERANCE, self.fade, self.largest
        self._n, self._dimensions, self._capacity = n, d, capacity
        for name, gain in self._gains.items():
            matrix = np.zeros((3, 3))
            size = 3 if name == "moment_gain" else d
            matrix[:size, :size] = gain if gain.ndim else float(gain) * np.eye(size)
            state.array(getattr(ContactSplitState, name))[:] = matrix.ravel()
        for name, values in self._views().items():
            if before is not None:
                values[: len(before[name])] = before[name]
        if old is not None:
            for name in ("grip", "grip_offset", "changed", "moment", "moment_offset", "push", "begun", "before"):
                setattr(state, name, getattr(old, name))
        self._bind(state, block)

    def _views(self) -> dict[str, FloatArray]:
        """Return views, by name, of the fingers' forces and of the marks of touching fingers."""
        assert self._state is not None
        names = ("touched", "external", "internal", "external_offset", "internal_offset")
        views = {name: self._state.array(getattr(ContactSplitState, name)) for name in names}
        return {name: each if name == "touched" else each.reshape(-1, 3) for name, each in views.items()}

    def _bind(self, state: ContactSplitState, block: FloatArray) -> None:
        """Store views of the block, and the kernel bound to the block."""

        def table(name: str) -> FloatArray:
            return state.array(getattr(ContactSplitState, name)).reshape(-1, 3)

        self._point, self._force, self._normal, self._torque = map(table, ("point", "force", "normal", "torque"))
        self._finger, self._range = state.array(ContactSplitState.finger), np.arange(float(self._capacity))
        self._reference = state.array(ContactSplitState.reference)
        self._view: Any = memoryview(block)
        self._at = {name: int(getattr(ContactSplitState, name).place(state)) for name in SCALARS}
        place = int(ContactSplitState.push.place(state))  # type: ignore[attr-defined]
        self._out, self._is_plain = block[place : place + 6 + 10 * self._n], False
        kernel: Any = divide_contacts
        if self._engine != "interpreted":
            try:
                self._compute = compiled(kernel).bound(block)
                return
            except MissingPackageError:
                if self._engine == "compiled":
                    raise
        source, view = source_function(kernel), memoryview(block)
        self._compute = lambda: source(view)

    def connect(self, name: str, *, timeout: float = 10.0) -> HostLink:
        """Connect to the real-time loop of the scene with this `host.name`; use the link in a `with` block.

        Args:
            name: Name of the record, `host.name` of the scene.
            timeout: Time to wait for the loop [s].

        Raises:
            DeviceError: If no loop with this name runs.
        """
        from graspfx.feedback.host_link import HostLink

        return HostLink(name, timeout=timeout)

    limits = staticmethod(gain_limits)

    def _card(self) -> Card:
        rows = [(name.replace("_", " "), str(gain.tolist())) for name, gain in self._gains.items()]
        rows += [("fade", f"{self.fade:g} s"), ("fingers", str(self._fixed or "as many as touch"))]
        return Card(
            "Feedback of another simulator's grasp", rows, ".update(points, forces, time), .connect(name), .limits(...)"
        )


def _gain(name: str, argument: ArrayLike) -> FloatArray:
    value = finite(name, argument, "a number, or a matrix (d, d)")
    is_matrix = value.ndim == 2 and value.shape[0] == value.shape[1] in (1, 2, 3)
    if not is_matrix and not (value.ndim == 0 and value >= 0.0):
        raise InputError(name, argument, "a number, zero or above, or a matrix (d, d)")
    if value.ndim == 2 and np.linalg.eigvalsh(value + value.T).min(initial=0.0) < -1e-12 * np.abs(value).max():
        raise InputError(name, argument, "a matrix whose symmetric part has no negative eigenvalue")
    return value


def _fitting(name: str, argument: ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    value = real(name, argument, f"an array {shape}")
    if value.shape != shape:
        raise InputError(name, value.shape, f"an array {shape}")
    return value
