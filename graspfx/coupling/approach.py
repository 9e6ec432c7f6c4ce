"""From motion to displacement, in the object's frame: contact points, e = p - c, its rate, the fingers' weights."""

from __future__ import annotations

import math
from typing import Any

from graspfx.cones.cone import contact_frame
from graspfx.cones.problem import SLIDE
from graspfx.coupling import block as at
from graspfx.grasp.rigid_modes import rigid_modes, smoothstep
from graspfx.objects import integrators as body
from graspfx.surfaces.closed_form.proxy import MESH, closest
from graspfx.surfaces.triangles.ball import ball_contact
from graspfx.surfaces.triangles.walk import mesh_contact

NOT_FINITE = 1  # a finger's motion is NaN or infinite, or its square would be
UNRESOLVED = 2  # the projection did not settle
LOST = 3  # the object's motion or a force is not finite
AGAIN = 4  # a contact point has moved: the split and the forces are asked for once more
LARGEST = 1e150  # of which the square is still a number; NaN compares false with it
QUARTER = 2.0  # 4 cos^2 of half the angle, of a quarter turn


def approach(S: Any) -> int:
    """Contact point, displacement, rate and weight of every finger; returns 0, NOT_FINITE or LOST.

    A ball fingertip is its centre p, which touches the shape grown by the radius: c is the point of that surface where
    the centre would be if the ball just touched. The reaction at the fingertip acts at the centre, that at the contact
    at c, so that a ball has the energy balance of a point.

    With the reaction at the fingertip the rate is e' = p' - v - w x (p - x), else e' = p' - v - w x (c - x), so that
    damping never creates energy.
    """
    n = int(S[at.FINGERS])
    d = int(S[at.DIMENSIONS])
    bilateral = S[at.ATTACHED] != 0.0
    x, R, v, w = pose(S)
    total = 0.0
    for a in range(3):
        total += S[x + a] + S[v + a] + S[w + a] + S[R + 3 * a] + S[R + 3 * a + 1] + S[R + 3 * a + 2]
    if not abs(total) <= LARGEST:
        return LOST
    for i in range(n):
        r = at.ROW + i * at.STRIDE
        total = 0.0
        for a in range(d):
            total += S[r + at.POSITION + a] + S[r + at.VELOCITY + a]
        if not abs(total) <= LARGEST:
            return NOT_FINITE
        px = S[r + at.POSITION] - S[x]
        py = S[r + at.POSITION + 1] - S[x + 1]
        pz = S[r + at.POSITION + 2] - S[x + 2]
        gx, gy, gz = px, py, pz
        if d > 1:
            gx = S[R] * px + S[R + 3] * py + S[R + 6] * pz
            gy = S[R + 1] * px + S[R + 4] * py + S[R + 7] * pz
            gz = S[R + 2] * px + S[R + 5] * py + S[R + 8] * pz
        if not bilateral:
            touch(S, r, d, gx, gy, gz)
        displace(S, r, gx, gy, gz)
    return 0


def displace(S: Any, r: int, gx: float, gy: float, gz: float) -> None:
    """Displacement, rate and contact in the world of the finger in row r, which is at g in the object's frame."""
    x, R, v, w = pose(S)
    cx, cy, cz = S[r + at.CONTACT], S[r + at.CONTACT + 1], S[r + at.CONTACT + 2]
    S[r + at.DISPLACEMENT] = gx - cx
    S[r + at.DISPLACEMENT + 1] = gy - cy
    S[r + at.DISPLACEMENT + 2] = gz - cz
    qx, qy, qz = cx, cy, cz
    if S[at.DIMENSIONS] > 1.0:
        qx = S[R] * cx + S[R + 1] * cy + S[R + 2] * cz
        qy = S[R + 3] * cx + S[R + 4] * cy + S[R + 5] * cz
        qz = S[R + 6] * cx + S[R + 7] * cy + S[R + 8] * cz
    S[r + at.CONTACT_WORLD] = S[x] + qx
    S[r + at.CONTACT_WORLD + 1] = S[x + 1] + qy
    S[r + at.CONTACT_WORLD + 2] = S[x + 2] + qz
    if S[at.DAMPED] != 0.0:
        if S[at.AT_CONTACT] == 0.0:
            qx = S[r + at.POSITION] - S[x]
            qy = S[r + at.POSITION + 1] - S[x + 1]
            qz = S[r + at.POSITION + 2] - S[x + 2]
        wx, wy, wz = S[w], S[w + 1], S[w + 2]
        ux = S[r + at.VELOCITY] - S[v] - (wy * qz - wz * qy)
        uy = S[r + at.VELOCITY + 1] - S[v + 1] - (wz * qx - wx * qz)
        uz = S[r + at.VELOCITY + 2] - S[v + 2] - (wx * qy - wy * qx)
        S[r + at.RATE] = S[R] * ux + S[R + 3] * uy + S[R + 6] * uz
        S[r + at.RATE + 1] = S[R + 1] * ux + S[R + 4] * uy + S[R + 7] * uz
        S[r + at.RATE + 2] = S[R + 2] * ux + S[R + 5] * uy + S[R + 8] * uz
    if S[at.COORDINATES] > 3.0:
        twist(S, r)


def twist(S: Any, r: int) -> None:
    """Torsion of the finger in row r, rho theta, its rate, and the direction in which it acts on the object.

    A fingertip does not turn: theta is minus the angle about the normal n of the object's rotation since its anchor, in
    swing and twist: 2 atan2(v . n, w) of the quaternion (v, w). It changes by minus a . (turn), a = [w^2 n + w n x v +
    (v . n) v] / (w^2 + (v . n)^2): torsion that acts along a is conservative; a = n as the paper's forces act at c.
    """
    if S[r + at.TOUCHING] == 0.0:
        set_anchor(S, r, S[r + at.RETAINED + 3])
    _, R, _, w = pose(S)
    A = r + at.ANCHOR
    x = y = z = 0.0
    W = 1.0  # 4 w^2, and x, y, z = 4 w v, from the matrix of the rotation
    for k in range(0, 9, 3):
        x += S[A + k + 2] * S[R + k + 1] - S[A + k + 1] * S[R + k + 2]
        y += S[A + k] * S[R + k + 2] - S[A + k + 2] * S[R + k]
        z += S[A + k + 1] * S[R + k] - S[A + k] * S[R + k + 1]
        W += S[A + k] * S[R + k] + S[A + k + 1] * S[R + k + 1] + S[A + k + 2] * S[R + k + 2]
    nx, ny, nz = S[r + at.NORMAL], S[r + at.NORMAL + 1], S[r + at.NORMAL + 2]
    P = x * nx + y * ny + z * nz
    rho = S[r + at.PATCH]
    S[r + at.DISPLACEMENT + 3] = S[r + at.KEPT] - 2.0 * rho * math.atan2(P, W)
    ax, ay, az = nx, ny, nz
    length = W * W + P * P
    if S[at.AT_CONTACT] == 0.0 and length > 0.0:
        ax = (W * W * nx + W * (ny * z - nz * y) + P * x) / length
        ay = (W * W * ny + W * (nz * x - nx * z) + P * y) / length
        az = (W * W * nz + W * (nx * y - ny * x) + P * z) / length
    S[r + at.TWIST_AXIS], S[r + at.TWIST_AXIS + 1], S[r + at.TWIST_AXIS + 2] = ax, ay, az
    if S[at.DAMPED] != 0.0:
        wx, wy, wz = S[w], S[w + 1], S[w + 2]
        rate = ax * (S[R] * wx + S[R + 3] * wy + S[R + 6] * wz)
        rate += ay * (S[R + 1] * wx + S[R + 4] * wy + S[R + 7] * wz)
        rate += az * (S[R + 2] * wx + S[R + 5] * wy + S[R + 8] * wz)
        S[r + at.RATE + 3] = -rho * rate
    if W < QUARTER:  # long before half a turn, where the angle would jump
        set_anchor(S, r, S[r + at.DISPLACEMENT + 3])


def set_anchor(S: Any, r: int, kept: float) -> None:
    """From here on the torsion of the finger in row r counts from the object's rotation now, where it is `kept`."""
    R = pose(S)[1]
    for k in range(9):
        S[r + at.ANCHOR + k] = S[R + k]
    S[r + at.KEPT] = kept


def pose(S: Any) -> tuple[int, int, int, int]:
    """Offsets of the object's position, rotation, velocity and angular velocity that this sample is about."""
    if S[at.IMPLICIT] != 0.0:
        return (
            at.BODY + body.NEXT_POSITION,
            at.BODY + body.NEXT_ROTATION,
            at.BODY + body.NEXT_VELOCITY,
            at.BODY + body.NEXT_ANGULAR_VELOCITY,
        )
    return (
        at.BODY + body.POSITION,
        at.BODY + body.ROTATION,
        at.BODY + body.VELOCITY,
        at.BODY + body.ANGULAR_VELOCITY,
    )


def touch(S: Any, r: int, d: int, gx: float, gy: float, gz: float) -> None:
    """Contact point, normal, gap and weight of the finger in row r, which is at g in the object's frame.

    With a coefficient the contact slips until the displacement left is what the last force goes with, e + s along the
    surface: that of a sliding finger before this sample's motion, that of a free one, which follows, after it. Where
    gains are matrices and contacts slip freely it does so after the motion, touching or not: then w = e + s = K^-1 f,
    which a force along the normal alone has along the surface too, is what the springs hold, and no energy is made.
    """
    c = r + at.CONTACT
    m = r + at.NORMAL
    touching = S[r + at.TOUCHING] != 0.0
    slips = S[r + at.COEFFICIENT] > 0.0
    if touching and slips and S[r + at.STATUS] == SLIDE:
        e = r + at.DISPLACEMENT
        hx, hy, hz = along_surface(S, r)
        place_contact(S, r, d, S[c] + S[e] - hx, S[c + 1] + S[e + 1] - hy, S[c + 2] + S[e + 2] - hz)
    if touching and (slips or S[at.STICK] != 0.0):
        S[r + at.GAP] = S[m] * (S[c] - gx) + S[m + 1] * (S[c + 1] - gy) + S[m + 2] * (S[c + 2] - gz)
    elif slips or S[at.DENSE] != 0.0:
        hx, hy, hz = along_surface(S, r)
        place_contact(S, r, d, gx - hx, gy - hy, gz - hz)
    else:
        place_contact(S, r, d, gx, gy, gz)
    if S[at.FADE] != 0.0 and weighs(S):
        fade(S, r)


def weighs(S: Any) -> bool:
    """Whether a free finger's weight is anything to anyone: not where each finger is by itself and nobody books."""
    alone = S[at.EQUAL] != 0.0 and S[at.DENSE] == 0.0 and S[at.IMPLICIT] == 0.0
    return not alone or S[at.FRICTION] != 0.0 or S[at.OBSERVED] != 0.0


def fade(S: Any, r: int) -> None:
    """The weight of the finger in row r, by its gap."""
    S[r + at.WEIGHT] = S[r + at.SHARE] * (1.0 - smoothstep(S[r + at.GAP], S[at.NEAR], S[at.FAR]))


def along_surface(S: Any, r: int) -> tuple[float, float, float]:
    """The displacement that the finger in row r retains, without its part along the normal."""
    m, h = r + at.NORMAL, r + at.RETAINED
    x, y, z = S[m], S[m + 1], S[m + 2]
    deep = x * S[h] + y * S[h + 1] + z * S[h + 2]
    return S[h] - deep * x, S[h + 1] - deep * y, S[h + 2] - deep * z


def place_contact(S: Any, r: int, d: int, gx: float, gy: float, gz: float) -> None:
    """Contact point, normal, contact frame, face and gap of the finger in row r if it were at g, object's frame."""
    c = r + at.CONTACT
    m = r + at.NORMAL
    radius = S[r + at.RADIUS]
    if S[at.SHAPE] == MESH:
        o = int(S[at.WALKS]) + at.WALK * ((r - at.ROW) // at.STRIDE)
        if radius > 0.0:
            face, cx, cy, cz, nx, ny, nz, gap = ball_contact(S, int(S[at.MESH]), S, o, radius, gx, gy, gz)  # type: ignore[arg-type, call-arg, misc] # flat
        else:
            face, cx, cy, cz, nx, ny, nz, gap = mesh_contact(S, int(S[at.MESH]), S, o, gx, gy, gz)  # type: ignore[arg-type, call-arg, misc] # flat
    else:
        face, cx, cy, cz, nx, ny, nz, gap = closest(  # type: ignore[call-arg, misc] # flat
            int(S[at.SHAPE]), d, S[at.PARAMETERS], S[at.PARAMETERS + 1], S[at.PARAMETERS + 2],
            gx, gy, gz, int(S[r + at.FACE]),  # type: ignore[arg-type] # flat
            S[c] + radius * S[m], S[c + 1] + radius * S[m + 1], S[c + 2] + radius * S[m + 2],
        )  # fmt: skip
        gap -= radius  # type: ignore[has-type] # flat
    S[c], S[c + 1], S[c + 2] = cx - radius * nx, cy - radius * ny, cz - radius * nz  # type: ignore[has-type] # flat
    S[m], S[m + 1], S[m + 2] = nx, ny, nz  # type: ignore[has-type] # flat
    S[r + at.FACE] = face  # type: ignore[has-type] # flat
    S[r + at.GAP] = gap
    f = r + at.FRAME
    (
        S[f], S[f + 1], S[f + 2], S[f + 3], S[f + 4], S[f + 5], S[f + 6], S[f + 7], S[f + 8],
    ) = contact_frame(S[m], S[m + 1], S[m + 2], d)  # type: ignore[call-arg, misc] # flat  # fmt: skip  # type: ignore[call-arg, misc] # flat


def refactor(S: Any) -> None:
    """The rigid modes of the contacts, only if a contact, a weight or a free direction has changed in the object."""
    n = int(S[at.FINGERS])
    d = int(S[at.DIMENSIONS])
    known = S[at.SPLIT_KNOWN] != 0.0 and S[at.MIXED] == 0.0
    soft = S[at.COORDINATES] > 3.0
    for i in range(n):
        r = at.ROW + i * at.STRIDE
        same = S[r + at.WEIGHT] == S[r + at.SPLIT_WEIGHT]
        for a in range(d):
            same = same and S[r + at.CONTACT + a] == S[r + at.SPLIT_CONTACT + a]
            if soft:
                same = same and S[r + at.NORMAL + a] == S[r + at.SPLIT_NORMAL + a]
        if not same:
            known = False
            S[r + at.SPLIT_WEIGHT] = S[r + at.WEIGHT]
            for a in range(d):
                S[r + at.SPLIT_CONTACT + a] = S[r + at.CONTACT + a]
                S[r + at.SPLIT_NORMAL + a] = S[r + at.NORMAL + a]
    if not known:
        S[at.COUNT], S[at.BLENDED] = rigid_modes(
            S, at.ROW, at.STRIDE, at.CONTACT, at.WEIGHT, n, d,
            at.AXES, int(S[at.SHIFTS]), int(S[at.TURNS]), S[at.ARM_LOW], S[at.ARM_HIGH], at.modes(n),
            at.NORMAL, at.PATCH if soft else -1,
        )  # fmt: skip
        S[at.SPLIT_KNOWN] = 1.0


def turn_axes(S: Any) -> None:
    """The free world directions in the object's frame, translations first."""
    R = pose(S)[1]
    k = at.AXES
    for half in range(2):
        for a in range(3):
            if S[at.BODY + body.FREE + 3 * half + a] != 0.0:
                S[k], S[k + 1], S[k + 2] = S[R + 3 * a], S[R + 3 * a + 1], S[R + 3 * a + 2]
                k += 3
