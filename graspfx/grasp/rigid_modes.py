"""The grasp mathematics of one sample on a flat buffer: rigid modes and stiffness in contact frames.

Every function takes the buffer `S` (float64) and integer offsets, allocates nothing and uses scalars only, so that
the same source runs interpreted and compiled. Fingers stand in rows of `stride` entries that start at `rows`.
"""

from __future__ import annotations

import math
from typing import Any

from graspfx.spatial import write_orthogonal as orthogonalise

NO_ARM = 1e-9  # [m]: an rms arm up to this is rounding, and contacts lie on a line


def smoothstep(x: float, low: float, high: float) -> float:
    """0 up to `low`, 1 from `high` on, 3 t^2 - 2 t^3 between."""
    if x <= low:
        return 0.0
    if x >= high:
        return 1.0
    t = (x - low) / (high - low)
    return t * t * (3.0 - 2.0 * t)


def rigid_modes(
    S: Any, rows: int, stride: int, point: int, weight: int, n: int, d: int,
    axes: int, shifts: int, turns: int, low: float, high: float, out: int, normal: int = 0, patch: int = -1,
) -> tuple[int, int]:  # fmt: skip
    """Orthonormal rigid motions of weighted contacts, q_k(i) = sqrt(w_i) (u_k + a_k x c_i) / norm, and their blend.

    The external projector is P = sum_k beta_k q_k q_k' (eq. 3) on displacements scaled by sqrt(w). Rotations enter with
    beta = smoothstep of their rms arm between `low` and `high` [m], translations with 1.

    `axes` holds `shifts` unit directions of free translation, then `turns` unit axes of free rotation about the
    origin of the points, three entries each, all in the points' frame. Mode k is written at
    out + k (1 + 3 n): beta_k, then three entries per finger. Returns the number of modes, and how many rotations with
    an arm of their own, more than `NO_ARM`, are not in it whole.

    With `patch` >= 0 a finger has a fourth entry, torsion about its normal in units of its patch length rho:
    sqrt(w_i) rho_i a_k . n_i / norm; rho = 0 for one that exerts none.
    """
    width = 4 if patch >= 0 else 3
    size = 1 + width * n
    total = 0.0
    base = rows
    for i in range(n):
        w = S[rows + i * stride + weight]
        if w > S[base + weight]:
            base = rows + i * stride
        total += w
    if total <= 0.0:
        return 0, 0
    root = math.sqrt(total)
    base += point
    x0, y0, z0 = S[base], S[base + 1], S[base + 2]
    mx = my = mz = 0.0  # the centroid, from the heaviest point: exact differences for contacts far from the origin
    for i in range(n):
        r = rows + i * stride
        w = S[r + weight]
        mx += w * (S[r + point] - x0)
        my += w * (S[r + point + 1] - y0)
        mz += w * (S[r + point + 2] - z0)
    mx, my, mz = mx / total, my / total, mz / total

    for k in range(shifts):
        o = out + k * size
        S[o] = 1.0
        for i in range(n):
            w = math.sqrt(S[rows + i * stride + weight]) / root
            for a in range(3):
                S[o + 1 + width * i + a] = w * S[axes + 3 * k + a]
            if width > 3:
                S[o + 4 + width * i] = 0.0

    for k in range(turns):
        o = out + (shifts + k) * size
        b = axes + 3 * (shifts + k)
        ax, ay, az = S[b], S[b + 1], S[b + 2]
        # the field of the centroid, less what the free translations already hold: zero when all of them are free
        cx, cy, cz = x0 + mx, y0 + my, z0 + mz
        tx, ty, tz = ay * cz - az * cy, az * cx - ax * cz, ax * cy - ay * cx
        if shifts == d:
            tx = ty = tz = 0.0
        else:
            for j in range(shifts):
                u = axes + 3 * j
                along = tx * S[u] + ty * S[u + 1] + tz * S[u + 2]
                tx, ty, tz = tx - along * S[u], ty - along * S[u + 1], tz - along * S[u + 2]
        for i in range(n):
            r = rows + i * stride
            w = math.sqrt(S[r + weight])
            x = S[r + point] - x0 - mx
            y = S[r + point + 1] - y0 - my
            z = S[r + point + 2] - z0 - mz
            fx, fy, fz = ay * z - az * y, az * x - ax * z, ax * y - ay * x
            S[o + 1 + width * i] = w * (fx + tx)
            S[o + 2 + width * i] = w * (fy + ty)
            S[o + 3 + width * i] = w * (fz + tz)
            if width > 3:
                m = r + normal
                S[o + 4 + width * i] = w * S[r + patch] * (ax * S[m] + ay * S[m + 1] + az * S[m + 2])
    orthogonalise(S, out + shifts * size, turns, size)

    count, blended = shifts, 0
    for k in range(turns):
        o = out + (shifts + k) * size
        norm = 0.0
        for j in range(1, size):
            norm += S[o + j] * S[o + j]
        norm = math.sqrt(norm)
        beta = smoothstep(norm / root, low, high)
        if beta < 1.0 and norm > NO_ARM * root:
            blended += 1
        if beta > 0.0:
            to = out + count * size
            S[to] = beta
            for j in range(1, size):
                S[to + j] = S[o + j] / norm
            count += 1
    return count, blended


def gain_matrix(
    S: Any, rows: int, stride: int, weight: int, frame: int, n: int, d: int,
    modes: int, count: int, external: float, internal: float, out: int, lead: int, row: int,
) -> None:  # fmt: skip
    """Adds sqrt(W) [k_i I + (k_e - k_i) P] sqrt(W) in contact frames to the square at `out` (eq. 4, scalar gains).

    The square has `lead` entries per row; `row` (6 entries) is scratch. With d = 4 modes and frames have torsion too.
    """
    width = 4 if d > 3 else 3
    size = 1 + width * n
    for i in range(n):
        ri = rows + i * stride
        wi = math.sqrt(S[ri + weight])
        for a in range(d):
            p = i * d + a
            S[out + p * lead + p] += internal * S[ri + weight]
            f = ri + frame + 3 * a
            for k in range(count):
                m = modes + k * size + 1 + width * i
                g = S[m + 3] if a > 2 else S[f] * S[m] + S[f + 1] * S[m + 1] + S[f + 2] * S[m + 2]
                S[row + k] = wi * (external - internal) * S[modes + k * size] * g
            for j in range(n):
                rj = rows + j * stride
                wj = math.sqrt(S[rj + weight])
                for b in range(d):
                    h = rj + frame + 3 * b
                    total = 0.0
                    for k in range(count):
                        m = modes + k * size + 1 + width * j
                        g = S[m + 3] if b > 2 else S[h] * S[m] + S[h + 1] * S[m + 1] + S[h + 2] * S[m + 2]
                        total += S[row + k] * g
                    S[out + p * lead + j * d + b] += wj * total
