"""Where a hand means its fingers to be at a time: motions, squeeze and turns on a flat block.

A motion stands as the number of its parts, then the parts one after another, each with KIND, SIZE, COUNT and its own
numbers; it is what its parts add up to. Entries of vectors are d, the number of dimensions that the caller gives.
"""

from __future__ import annotations

import math
from typing import Any

SINE, REACH, PATH, LEVELS, GIVEN = range(1, 6)
KIND, SIZE, COUNT, OWN = range(4)  # OWN: where a part's own numbers start

# A turn: its length, the centre c (3), the axis u (3), room for the angle and its rate, and the angle, a motion.
LENGTH, CENTRE, AXIS, ANGLE, COURSE = 0, 1, 4, 7, 9

# A hand: where its squeeze, its motion and its turns stand, and how many turns there are. Its arrays follow: r, r',
# rest and what each finger does of the squeeze, (n, d) each; room for the offset and its velocity, then for the squeeze
# and its rate.
FINGERS, DIMENSIONS, SQUEEZE, MOTION, TURNS, TURN, HAND = range(7)

# Hands joined: how many hands there are and where each one's block stands (0 for one whose targets the caller writes),
# then r and r' (n, d) of all, then for each finger where its r and its r' stand.
HANDS, WHOLE, SPACE, JOINED = range(4)


def minimum_jerk(s: float) -> tuple[float, float]:
    """Compute 10 s^3 - 15 s^4 + 6 s^5 and its derivative by s; 0 before s = 0, 1 after s = 1.

    The step with the least integral of squared jerk between two states of rest (T. Flash and N. Hogan, The coordination
    of arm movements, J. Neuroscience 5(7), 1985).
    """
    if s <= 0.0:
        return 0.0, 0.0
    if s >= 1.0:
        return 1.0, 0.0
    return s * s * s * (10.0 + s * (6.0 * s - 15.0)), 30.0 * s * s * (1.0 - s) * (1.0 - s)


def later(S: Any, first: int, count: int, t: float) -> int:
    """Count the increasing times from `first` on that are not after t."""
    low, high = 0, count
    while low < high:
        middle = (low + high) // 2
        if t < S[first + middle]:
            high = middle
        else:
            low = middle + 1
    return low


def sine(S: Any, o: int, t: float, x: int, d: int) -> None:
    """Add a sine; own numbers: a, 2 pi f, begin, ramp, u (d)."""
    since = t - S[o + 2]
    if since < 0.0:
        return
    s, ds = 1.0, 0.0
    ramp = S[o + 3]
    if ramp > 0.0:
        s, ds = minimum_jerk(since / ramp)
        ds /= ramp
    a, w = S[o], S[o + 1]
    sin, cos = math.sin(w * since), math.cos(w * since)
    length, rate = a * s * sin, a * (s * w * cos + ds * sin)
    for j in range(d):
        S[x + j] += length * S[o + 4 + j]
        S[x + d + j] += rate * S[o + 4 + j]


def reach(S: Any, o: int, t: float, x: int, d: int) -> None:
    """Add a reach; own numbers: begin, duration, displacement (d)."""
    s, ds = minimum_jerk((t - S[o]) / S[o + 1])
    ds /= S[o + 1]
    for j in range(d):
        S[x + j] += s * S[o + 2 + j]
        S[x + d + j] += ds * S[o + 2 + j]


def path(S: Any, o: int, count: int, t: float, x: int, d: int) -> None:
    """Add a path; own numbers: times (count), cubics (count - 1, 4, d) from the highest power on, last position (d)."""
    cubics = o + count
    if t >= S[cubics - 1]:
        last = cubics + 4 * d * (count - 1)
        for j in range(d):
            S[x + j] += S[last + j]
    elif t <= S[o]:
        for j in range(d):
            S[x + j] += S[cubics + 3 * d + j]
    else:
        k = later(S, o, count, t) - 1
        s = t - S[o + k]
        for j in range(d):
            c = cubics + 4 * d * k + j
            c3, c2, c1 = S[c], S[c + d], S[c + 2 * d]
            S[x + j] += ((c3 * s + c2) * s + c1) * s + S[c + 3 * d]
            S[x + d + j] += (3.0 * c3 * s + 2.0 * c2) * s + c1


def levels(S: Any, o: int, count: int, t: float, x: int) -> None:
    """Add levels; own numbers: begins (count), durations (count), levels (count + 1) from the first zero; d = 1."""
    k = later(S, o, count, t) - 1
    level = S[o + 2 * count + k + 1]
    if k >= 0:
        since, duration = t - S[o + k], S[o + count + k]
        if since < duration:
            before = S[o + 2 * count + k]
            s, ds = minimum_jerk(since / duration)
            change = level - before
            S[x] += before + s * change
            S[x + 1] += ds / duration * change
            return
    S[x] += level


def given(S: Any, o: int, x: int, d: int) -> None:
    """Add a motion of the caller's; own numbers: offset (d) and velocity (d) at the time, which the caller writes."""
    for j in range(2 * d):
        S[x + j] += S[o + j]


def motion_at(S: Any, o: int, t: float, x: int, d: int) -> None:
    """Compute the offset (d) at `x`, followed by its velocity (d), of the motion that stands at `o`, at the time t."""
    for j in range(2 * d):
        S[x + j] = 0.0
    part = o + 1
    for _ in range(int(S[o])):
        kind, count = int(S[part + KIND]), int(S[part + COUNT])
        if kind == SINE:
            sine(S, part + OWN, t, x, d)
        elif kind == REACH:
            reach(S, part + OWN, t, x, d)
        elif kind == PATH:
            path(S, part + OWN, count, t, x, d)
        elif kind == LEVELS:
            levels(S, part + OWN, count, t, x)
        else:
            given(S, part + OWN, x, d)
        part += int(S[part + SIZE])


def turn(S: Any, o: int, t: float, r: int, v: int, n: int, d: int) -> int:
    """Turn positions (n, d) at `r` and velocities at `v` in place; return 0 if there was nothing to turn.

    r -> c + R (r - c), v -> R v + angle' u x R (r - c), R = u u' + cos (I - u u') + sin [u]x.
    """
    motion_at(S, o + COURSE, t, o + ANGLE, 1)
    angle, rate = S[o + ANGLE], S[o + ANGLE + 1]
    if angle == 0.0 and rate == 0.0:
        return 0
    cos, sin = math.cos(angle), math.sin(angle)
    cx, cy, cz = S[o + CENTRE], S[o + CENTRE + 1], S[o + CENTRE + 2]
    if d == 2:
        for i in range(n):
            p, w = r + 2 * i, v + 2 * i
            x, y = S[p] - cx, S[p + 1] - cy
            ax, ay = cos * x - sin * y, sin * x + cos * y
            vx, vy = S[w], S[w + 1]
            S[p] = cx + ax
            S[p + 1] = cy + ay
            S[w] = cos * vx - sin * vy - rate * ay
            S[w + 1] = sin * vx + cos * vy + rate * ax
        return 1
    ux, uy, uz = S[o + AXIS], S[o + AXIS + 1], S[o + AXIS + 2]
    xx, yy, zz = ux * ux + cos * (1.0 - ux * ux), uy * uy + cos * (1.0 - uy * uy), uz * uz + cos * (1.0 - uz * uz)
    xy, xz, yz = ux * uy * (1.0 - cos), ux * uz * (1.0 - cos), uy * uz * (1.0 - cos)
    sx, sy, sz = sin * ux, sin * uy, sin * uz
    for i in range(n):
        p, w = r + 3 * i, v + 3 * i
        x, y, z = S[p] - cx, S[p + 1] - cy, S[p + 2] - cz
        ax = xx * x + (xy - sz) * y + (xz + sy) * z
        ay = (xy + sz) * x + yy * y + (yz - sx) * z
        az = (xz - sy) * x + (yz + sx) * y + zz * z
        vx, vy, vz = S[w], S[w + 1], S[w + 2]
        S[p] = cx + ax
        S[p + 1] = cy + ay
        S[p + 2] = cz + az
        S[w] = xx * vx + (xy - sz) * vy + (xz + sy) * vz + rate * (uy * az - uz * ay)
        S[w + 1] = (xy + sz) * vx + yy * vy + (yz - sx) * vz + rate * (uz * ax - ux * az)
        S[w + 2] = (xz - sy) * vx + (yz + sx) * vy + zz * vz + rate * (ux * ay - uy * ax)
    return 1


def target(S: Any, o: int, t: float) -> None:
    """Compute r (n, d), then r' (n, d), of the hand whose block starts at `o`, at time t (`graspfx.loop.hand.Hand`)."""
    n, d = int(S[o + FINGERS]), int(S[o + DIMENSIONS])
    squeeze, motion, turns = o + int(S[o + SQUEEZE]), o + int(S[o + MOTION]), int(S[o + TURNS])
    if turns == 0 and int(S[motion]) == 0 and int(S[squeeze]) == 0:
        return  # its rest stands there since the hand was made
    entries = n * d
    r = o + HAND
    v, rest, along, x = r + entries, r + 2 * entries, r + 3 * entries, r + 4 * entries
    q = x + 2 * d
    motion_at(S, squeeze, t, q, 1)
    motion_at(S, motion, t, x, d)
    s, ds = S[q], S[q + 1]
    for a in range(d):
        dx = dv = 0.0
        if turns == 0:  # else the offset comes after them
            dx = S[x + a]
            dv = S[x + d + a]
        for j in range(a, entries, d):
            S[r + j] = S[rest + j] + s * S[along + j] + dx
            S[v + j] = ds * S[along + j] + dv
    at = o + int(S[o + TURN])
    for _ in range(turns):
        turn(S, at, t, r, v, n, d)
        at += int(S[at + LENGTH])
    if turns == 0:
        return
    for a in range(d):
        dx, dv = S[x + a], S[x + d + a]
        for j in range(a, entries, d):
            S[r + j] += dx
            S[v + j] += dv


def joined_target(S: Any, o: int, t: float) -> None:
    """Compute r and r' of joined hands (`graspfx.loop.hand.JoinedHands`)."""
    hands, n, d = int(S[o + HANDS]), int(S[o + WHOLE]), int(S[o + SPACE])
    for h in range(hands):
        at = int(S[o + JOINED + h])
        if at > 0:
            target(S, o + at, t)
    r = o + JOINED + hands
    v = r + n * d
    places = v + n * d
    for i in range(n):
        a, b = o + int(S[places + 2 * i]), o + int(S[places + 2 * i + 1])
        for j in range(d):
            S[r + i * d + j] = S[a + j]
            S[v + i * d + j] = S[b + j]
