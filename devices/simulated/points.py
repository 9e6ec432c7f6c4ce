"""Plant of point masses held by a hand, with exact motion over a sample."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from graspfx.devices._plant import HeldPlant, PlantState, unfit
from graspfx.protocols import Floats, Many, Record, expm1, floats, kernel, layout, many

FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]


class CoupledFingers(Record):
    """A group of fingers that the hand's gains couple on an axis."""

    axis: int
    count: int  # number g of fingers in the group
    first: int  # index of the group's first finger in the plant's `members`
    matrix: int  # index of the first entry in `matrices`, (2 g, 6 g)


class PointPlantState(PlantState):  # type: ignore[misc] # mypy does not see devices from inside the package
    """Point masses: groups of coupled fingers, and the matrices that move them over a sample."""

    group_count: int  # number of groups
    inputs: Floats = floats("6 * fingers")  # room for the inputs of one group
    groups: Many[CoupledFingers] = many("fingers * dimensions")
    members: Floats = floats("fingers * dimensions")  # fingers, ordered by group
    matrices: Floats = floats("12 * fingers * fingers * dimensions")


@kernel
def advance(plant: PointPlantState) -> int:
    """Advance the plant by one sample; targets at the end of the sample become targets at the beginning of the next.

        (x - x_0, x') = M (x_0 - r_0, x_0', u, r_1 - r_0, r_0', r_1')      for each group of coupled fingers on an axis

    x are the positions, r the targets and u the efforts of the g fingers of a group; the subscripts 0 and 1 denote the
    beginning and the end of the sample. `_step` computes M (2 g, 6 g). The last three inputs are zero if targets are
    constant, and are then left out.
    """
    d = plant.dimensions
    step = plant.fingers * d
    x, v, u = plant.position, plant.velocity, plant.effort
    r0, dr0, r1, dr1 = plant.start, plant.start_rate, plant.end, plant.end_rate
    still = plant.still
    code: int = unfit(u, 1 if still else 5, step)  # the targets follow the efforts in memory
    if code != 0:
        return code
    q, groups, members, matrices = plant.inputs, plant.groups, plant.members, plant.matrices
    for k in range(plant.group_count):
        group = groups[k]
        axis, g, first, top = group.axis, group.count, group.first, group.matrix
        for j in range(g):
            i = int(members[first + j]) * d + axis
            q[j] = x[i] - r0[i]
            q[g + j] = v[i]
            q[2 * g + j] = u[i]
            if not still:
                q[3 * g + j] = r1[i] - r0[i]
                q[4 * g + j] = dr0[i]
                q[5 * g + j] = dr1[i]
        width = 6 * g
        for j in range(g):
            i = int(members[first + j]) * d + axis
            a, b = top + j * width, top + (g + j) * width
            dx = dv = 0.0
            for c in range(3 * g if still else width):
                dx += matrices[a + c] * q[c]
                dv += matrices[b + c] * q[c]
            x[i] += dx
            v[i] = dv
    if not still:
        for i in range(step):
            r0[i], dr0[i] = r1[i], dr1[i]
    plant.ticks += 1.0
    return 0


class PointPlant(HeldPlant):  # type: ignore[misc] # mypy does not see devices from inside the package
    """Point masses and the hand that holds them, with exact motion under held efforts.

        m_i x_i'' + b_i x_i' = u_i + sum_j K_ij (r_j - x_j) + B_ij (r_j' - x_j')      on every axis

    m_i and b_i are the mass and damping of finger i, x_i its position, u_i its effort and r_i its intended position; K
    and B are the stiffness and damping of the hand. Over each sample, r_i follows the cubic through the values and
    velocities of r_i at both ends of the sample. For these inputs the motion is exact. The matrix of the motion, a
    matrix exponential, is recomputed when the hand's gains or the period change.

    Args:
        mass: Masses of the n fingertips (n,) [kg].
        damping: Viscous damping of the fingertips (n,) [N s/m].
        dimensions: Number of dimensions d.

    Attributes:
        live: Whether mechanics and hand may change during a run; must be set before the run is built.
    """

    kernel = staticmethod(advance)
    live = False

    def __init__(self, mass: Sequence[float], damping: Sequence[float], dimensions: int) -> None:
        super().__init__(PointPlantState, len(mass), dimensions)
        self._block = PointPlantState(self.state)
        self._mass, self._damping = np.array(mass, dtype=float), np.array(damping, dtype=float)
        self._matrix_inputs: tuple[bytes, bytes, float] | None = None

    @property
    def structure(self) -> Index:
        """Indices of the entries `fingers`, `dimensions` and, unless the plant is `live`, `still` in the block."""
        names = ("fingers", "dimensions") + (() if self.live else ("still",))
        return np.array([layout(PointPlantState)[name].place(self._block) for name in names])

    def adopt(self, other: PointPlant) -> None:
        """Copy the masses and dampings of another plant of the same structure; call `hold` afterwards."""
        self.mechanics = other.mechanics

    @property
    def mechanics(self) -> FloatArray:
        """Masses [kg] and dampings [N s/m] as rows (2, n); call `hold` after setting this property."""
        return np.stack([self._mass, self._damping])

    @mechanics.setter
    def mechanics(self, values: FloatArray) -> None:
        self._mass, self._damping = values.copy()
        self._matrix_inputs = None

    def _put(self, position: FloatArray) -> None:
        """Do nothing: positions and velocities are the whole state."""

    def _grip(self, K: FloatArray, B: FloatArray, T: float) -> None:
        inputs = K.tobytes(), B.tobytes(), T
        if inputs == self._matrix_inputs:
            return
        d, block = self.position.shape[1], self._block
        m, b = self._mass, self._damping
        groups, members, matrices = block.groups, block.members.offset, block.matrices.offset
        count = listed = end = 0
        starts: dict[tuple[bytes, ...], int] = {}
        for axis in range(d):
            for fingers in _coupled_groups((K[axis] != 0.0) | (B[axis] != 0.0)):
                rows = np.ix_(fingers, fingers)
                parts = m[fingers], b[fingers], K[axis][rows], B[axis][rows]
                key = tuple(part.tobytes() for part in parts)
                if key not in starts:
                    step = _step(*parts, T)
                    self.state[matrices + end : matrices + end + step.size] = step.ravel()
                    starts[key] = end
                    end += step.size
                group = groups[count]
                group.axis, group.count, group.first, group.matrix = axis, len(fingers), listed, starts[key]
                self.state[members + listed : members + listed + len(fingers)] = fingers
                count, listed = count + 1, listed + len(fingers)
        block.group_count = count
        self._matrix_inputs = inputs


def _step(m: FloatArray, b: FloatArray, K: FloatArray, B: FloatArray, T: float) -> FloatArray:
    """Compute the matrix M (2 g, 6 g) of `advance` from the matrix exponential of the system with its inputs.

        e' = w,   w' = T^2/m (u + K (rho - e)) + T/m (B rho' - (b + B) w)

    The prime is d/ds with s = t/T. The states are e = x - r_0 and w = de/ds, and the input is the target
    rho = r - r_0 = c_1 s + c_2 s^2 + c_3 s^3; x, r, r_0 and u are those of `advance`.
    """
    g = len(m)
    I = np.eye(g)  # noqa: E741 (the identity's letter)
    per_mass = (T / m)[:, None]
    A = np.zeros((7, g, 7, g))  # blocks e, w, rho, rho', rho'', rho''', u
    A[0, :, 1], A[2, :, 3], A[3, :, 4], A[4, :, 5] = I, I, I, I
    A[1, :, 0], A[1, :, 2], A[1, :, 6] = -T * per_mass * K, T * per_mass * K, T * per_mass * I
    A[1, :, 1], A[1, :, 3] = -per_mass * (np.diag(b) + B), per_mass * B
    E = expm1(A.reshape(7 * g, 7 * g)).reshape(7, g, 7, g)[:2]
    # At s = 0 rho' = c_1 = h_0, rho'' = 2 c_2 = 6 D - 4 h_0 - 2 h_1, rho''' = 6 c_3 = -12 D + 6 h_0 + 6 h_1,
    # D = r_1 - r_0, h = T r' (Hermite).
    M = np.empty((2, g, 6, g))
    M[:, :, 0], M[:, :, 1], M[:, :, 2] = E[:, :, 0], T * E[:, :, 1], E[:, :, 6]
    M[:, :, 3] = 6.0 * E[:, :, 4] - 12.0 * E[:, :, 5]
    M[:, :, 4] = T * (E[:, :, 3] - 4.0 * E[:, :, 4] + 6.0 * E[:, :, 5])
    M[:, :, 5] = T * (6.0 * E[:, :, 5] - 2.0 * E[:, :, 4])
    M[1, :, 1] += T * I  # expm1 excludes the identity: row 0 is the change of x
    M[1] /= T
    return M.reshape(2 * g, 6 * g)


def _coupled_groups(linked: NDArray[np.bool_]) -> list[list[int]]:
    """List the groups of fingers that are coupled directly or through other fingers, in ascending order each."""
    left = list(range(len(linked)))
    groups = []
    while left:
        group = [left.pop(0)]
        for i in group:
            neighbours = [j for j in left if linked[i, j] or linked[j, i]]
            group += neighbours
            left = [j for j in left if j not in neighbours]
        groups.append(sorted(group))
    return groups
