"""A MuJoCo step with Coulomb friction and Newton's restitution, which correct MuJoCo's own contact law."""

from __future__ import annotations

from typing import Any

import numpy as np

from graspfx.objects.body import FloatArray

ROUNDS = 30
ACCURACY = 1e-9  # relative to the largest lift: accuracy of the lifts


class ContactStep:
    """Step of a world whose contacts have friction, restitution or both.

    MuJoCo's forces f solve y = A f + a0 - a_ref + R f, with y in the dual friction cone and orthogonal to f. Two of its
    reference accelerations are corrected:

    - In the dual cone a contact that slides by y_t separates by mu |y_t|: a box at 0.5 m/s hops 2 mm high. This lift is
      subtracted from the normal reference, and the problem is solved again until the lift is that of its solution. The
      law is then Coulomb's (De Saxce and Feng 1998). If all contacts stick or separate, MuJoCo's solution already
      satisfies it.
    - A contact that closes with the speed v < 0 separates with -e v, or with the larger speed that removes a
    penetration;
      not with the sum of both.

    Args:
        library: The MuJoCo package.
        model, data: Model and data of the world. Its only constraints are contacts, of three rows, or one row without
            friction. The Jacobian is dense, and the normal reference is (share r/T - v)/T with the penetration r.
        friction: Coefficient mu of every contact.
        restitution: Coefficient e of every contact.
    """

    def __init__(self, library: Any, model: Any, data: Any, friction: float, restitution: float) -> None:
        self._library, self._model, self._data = library, model, data
        self._friction, self._restitution = friction, restitution
        self._rows = 3 if friction > 0.0 else 1
        self._sliding = int(library.mjtConstraintState.mjCNSTRSTATE_CONE)
        self._lifts: FloatArray = np.zeros(0)

    def __call__(self) -> None:
        """Step the world."""
        library, model, data = self._library, self._model, self._data
        library.mj_step1(model, data)
        library.mj_fwdAcceleration(model, data)
        if self._restitution > 0.0:
            self._bounce()
        library.mj_fwdConstraint(model, data)
        if self._friction > 0.0 and self._sliding in data.efc_state:
            self._slide()
        else:
            self._lifts = np.zeros(0)
        library.mj_Euler(model, data)

    def _bounce(self) -> None:
        """Raise the normal references to those of restitution."""
        data, T = self._data, self._model.opt.timestep
        across, speeds = data.efc_aref[:: self._rows], data.efc_vel[:: self._rows]
        np.maximum(across, -(1.0 + self._restitution) / T * speeds, out=across, where=speeds < 0.0)

    def _slide(self) -> None:
        """Solve until the lifts are those of the solution; start from the last step's if their number fits."""
        solve, model, data, rows = self._library.mj_fwdConstraint, self._model, self._data, self._rows
        aref, R, qacc = data.efc_aref, data.efc_R, data.qacc
        J = data.efc_J.reshape(len(aref), -1)
        across = aref[::rows]
        unlifted = across.copy()
        lifts = self._lifts
        if len(lifts) == len(across):
            across[:] = unlifted - lifts
            solve(model, data)
        for _ in range(ROUNDS):
            y = J @ qacc - aref + R * data.efc_force
            new = self._friction * np.hypot(y[1::rows], y[2::rows])
            settled = len(lifts) == len(new) and np.abs(new - lifts).max() <= ACCURACY * new.max()
            lifts = new
            if settled:
                break
            across[:] = unlifted - lifts
            solve(model, data)
        self._lifts = lifts
