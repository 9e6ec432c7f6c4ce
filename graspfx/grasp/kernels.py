"""The grasp mathematics of one sample on a flat buffer: rigid modes, stiffness in contact frames, complementarity.

Every function takes the buffer `S` (float64) and integer offsets, allocates nothing and uses scalars only, so that
the same source runs interpreted and compiled. Fingers stand in rows of `stride` entries that start at `rows`.
"""

from __future__ import annotations

import math
from typing import Any

SWEEPS = 12  # Jacobi converges in three or four
ROUNDING = 1e-13  # what counts as no violation, relative to the largest force
SINGULAR = 1e-10  # what counts as no stiffness left, relative to what the coordinate had before others were released


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
    axes: int, shifts: int, turns: int, low: float, high: float, out: int,
) -> int:  # fmt: skip
    """Orthonormal rigid motions of weighted contacts, q_k(i) = sqrt(w_i) (u_k + a_k x c_i) / norm, and their blend.

    The external projector is P = sum_k beta_k q_k q_k' (eq. 3) on displacements scaled by sqrt(w). Rotations enter with
    beta = smoothstep of their rms arm between `low` and `high` [m], translations with 1.

    `axes` holds `shifts` unit directions of free translation, then `turns` unit axes of free rotation about the
    origin of the points, three entries each, all in the points' frame. Mode k is written at
    out + k (1 + 3 n): beta_k, then three entries per finger. Returns the number of modes.
    """
    size = 1 + 3 * n
    total = 0.0
    base = rows
    for i in range(n):
        w = S[rows + i * stride + weight]
        if w > S[base + weight]:
            base = rows + i * stride
        total += w
    if total <= 0.0:
        return 0
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
                S[o + 1 + 3 * i + a] = w * S[axes + 3 * k + a]

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
            S[o + 1 + 3 * i] = w * (fx + tx)
            S[o + 2 + 3 * i] = w * (fy + ty)
            S[o + 3 + 3 * i] = w * (fz + tz)
    orthogonalise(S, out + shifts * size, turns, size)

    count = shifts
    for k in range(turns):
        o = out + (shifts + k) * size
        norm = 0.0
        for j in range(1, size):
            norm += S[o + j] * S[o + j]
        norm = math.sqrt(norm)
        beta = smoothstep(norm / root, low, high)
        if beta > 0.0:
            to = out + count * size
            S[to] = beta
            for j in range(1, size):
                S[to + j] = S[o + j] / norm
            count += 1
    return count


def orthogonalise(S: Any, o: int, count: int, size: int) -> None:
    """One-sided Jacobi: rotates `count` vectors (one entry, then size - 1 components) until they are orthogonal.

    Small norms come out accurate relative to themselves, unlike through a 3 x 3 moment matrix.
    """
    for _ in range(SWEEPS):
        turned = False
        for p in range(count - 1):
            for q in range(p + 1, count):
                u, v = o + p * size, o + q * size
                uu = vv = uv = 0.0
                for j in range(1, size):
                    uu += S[u + j] * S[u + j]
                    vv += S[v + j] * S[v + j]
                    uv += S[u + j] * S[v + j]
                if uv * uv <= 1e-31 * uu * vv:
                    continue
                turned = True
                zeta = (vv - uu) / (2.0 * uv)
                t = 1.0 / (abs(zeta) + math.sqrt(1.0 + zeta * zeta))
                if zeta < 0.0:
                    t = -t
                c = 1.0 / math.sqrt(1.0 + t * t)
                s = c * t
                for j in range(1, size):
                    a, b = S[u + j], S[v + j]
                    S[u + j] = c * a - s * b
                    S[v + j] = s * a + c * b
        if not turned:
            return


def contact_frame(S: Any, normal: int, d: int, o: int) -> None:
    """Writes d orthonormal directions at o: the unit normal, then the tangents."""
    x, y, z = S[normal], S[normal + 1], S[normal + 2]
    S[o], S[o + 1], S[o + 2] = x, y, z
    if d == 2:
        S[o + 3], S[o + 4], S[o + 5] = -y, x, 0.0
    if d == 3:
        # Duff et al. (2017): a basis without a branch that loses digits
        sign = 1.0 if z >= 0.0 else -1.0
        a = -1.0 / (sign + z)
        b = x * y * a
        S[o + 3], S[o + 4], S[o + 5] = 1.0 + sign * x * x * a, sign * b, -sign * x
        S[o + 6], S[o + 7], S[o + 8] = b, sign + y * y * a, -y


def gain_matrix(
    S: Any, rows: int, stride: int, weight: int, frame: int, n: int, d: int,
    modes: int, count: int, external: float, internal: float, out: int, lead: int, row: int,
) -> None:  # fmt: skip
    """Adds sqrt(W) [k_i I + (k_e - k_i) P] sqrt(W) in contact frames to the square at `out` (eq. 4, scalar gains).

    The square has `lead` entries per row; `row` (6 entries) is scratch.
    """
    size = 1 + 3 * n
    for i in range(n):
        ri = rows + i * stride
        wi = math.sqrt(S[ri + weight])
        for a in range(d):
            p = i * d + a
            S[out + p * lead + p] += internal * S[ri + weight]
            f = ri + frame + 3 * a
            for k in range(count):
                m = modes + k * size + 1 + 3 * i
                g = S[f] * S[m] + S[f + 1] * S[m + 1] + S[f + 2] * S[m + 2]
                S[row + k] = wi * (external - internal) * S[modes + k * size] * g
            for j in range(n):
                rj = rows + j * stride
                wj = math.sqrt(S[rj + weight])
                for b in range(d):
                    h = rj + frame + 3 * b
                    total = 0.0
                    for k in range(count):
                        m = modes + k * size + 1 + 3 * j
                        total += S[row + k] * (S[h] * S[m] + S[h + 1] * S[m + 1] + S[h + 2] * S[m + 2])
                    S[out + p * lead + j * d + b] += wj * total


def pivot(S: Any, square: int, lead: int, vector: int, size: int, j: int) -> None:
    """Principal pivot on j of y = q + M x: x_j and y_j change places (q in `vector`, M in `square`)."""
    inverse = 1.0 / S[square + j * lead + j]
    q = S[vector + j] * inverse
    for i in range(size):
        if i == j:
            continue
        factor = S[square + i * lead + j]
        if factor != 0.0:
            S[vector + i] -= factor * q
            factor *= inverse
            for k in range(size):
                if k != j:
                    S[square + i * lead + k] -= factor * S[square + j * lead + k]
            S[square + i * lead + j] = factor
    for k in range(size):
        S[square + j * lead + k] *= -inverse
    S[square + j * lead + j] = inverse
    S[vector + j] = -q


def release(S: Any, square: int, lead: int, vector: int, size: int, m: int, marks: int, diagonal: int) -> None:
    """Pivots the marked ones (1.0) of m coordinates so that they carry no force; clears their marks.

    The stiffest first: a singular stiffness then shows as pivots of rounding size, and what no stiffness reaches
    carries no force already.
    """
    while True:
        best = SINGULAR
        chosen = -1
        for j in range(m):
            if S[marks + j] != 0.0 and S[diagonal + j] > 0.0:
                share = S[square + j * lead + j] / S[diagonal + j]
                if share > best:
                    best = share
                    chosen = j
        if chosen < 0:
            break
        pivot(S, square, lead, vector, size, chosen)
        S[marks + chosen] = 0.0
    for j in range(m):
        if S[marks + j] != 0.0:
            S[marks + j] = 0.0
            S[vector + j] = 0.0


def complement(
    S: Any, square: int, lead: int, vector: int, size: int, n: int, d: int, block: bool, back: bool,
    state: int, diagonal: int, scale: float,
) -> int:  # fmt: skip
    """Finds f_n >= 0, s_n >= 0, f_n s_n = 0 at every normal by principal pivoting; returns 0, or 1 if unresolved.

    Coordinates are contact by contact, the normal first (index i d). `state` has per finger 1 engaged, 0 released, -1
    not to be touched. `block` releases a finger's tangents with its normal; without `back` a released one stays so. In
    `vector` an engaged normal has its force and a released one its displacement s. `scale` is the size of the forces.
    The worst violation first; after 3 n pivots the first one, which ends for every matrix with positive principal
    minors (Murty 1974).
    """
    limit = 20 * n + 40
    for step in range(limit):
        worst = 0.0
        chosen = -1
        for i in range(n):
            j = i * d
            if S[state + i] < 0.0 or S[diagonal + j] <= 0.0 or (S[state + i] == 0.0 and not back):
                continue
            value = S[vector + j]
            if S[state + i] == 0.0:
                value *= S[diagonal + j]  # a displacement, compared as the force it would make
            if value < worst and value < -ROUNDING * scale:
                chosen = i
                if step >= 3 * n:
                    break
                worst = value
        if chosen < 0:
            return 0
        j = chosen * d
        if S[square + j * lead + j] == 0.0:
            return 1
        pivot(S, square, lead, vector, size, j)
        if block:
            for a in range(1, d):
                if S[square + (j + a) * lead + j + a] == 0.0:
                    return 1
                pivot(S, square, lead, vector, size, j + a)
        S[state + chosen] = 1.0 - S[state + chosen]
    return 1


def settle(
    S: Any, square: int, lead: int, vector: int, displacement: int, n: int, d: int, block: bool, state: int
) -> None:
    """Forces of the engaged fingers, f = K e over them alone, zero elsewhere, into `vector`.

    The square holds their stiffness with all others released, so that where a free finger is costs no digits.
    """
    for i in range(n):
        for a in range(d):
            p = i * d + a
            total = 0.0
            if S[state + i] > 0.0 and (block or a == 0):
                for j in range(n):
                    if S[state + j] > 0.0:
                        for b in range(d if block else 1):
                            q = j * d + b
                            total += S[square + p * lead + q] * S[displacement + q]
                if a == 0:
                    total = max(total, 0.0)
            S[vector + p] = total
