"""Kernels that compute the target positions of a hand's fingers from motions, squeeze and rotations."""

from __future__ import annotations

from graspfx import elementary
from graspfx.compile.kernel import inline, kernel
from graspfx.compile.records import Floats
from graspfx.loop.follower import follow
from graspfx.loop.motion.state import (
    LEVELS,
    PATH,
    REACH,
    SINE,
    TREMOR,
    Course,
    Displacement,
    GuidedHandState,
    HandState,
    JoinedHandsState,
    LevelsPart,
    MotionPart,
    OtherPart,
    PathPart,
    ReachPart,
    SinePart,
    TremorPart,
    Turning,
)
from graspfx.spatial import ZERO, Matrix, Vector, cross


def minimum_jerk(s: float) -> tuple[float, float]:
    """Compute the minimum-jerk step 10 s^3 - 15 s^4 + 6 s^5 and its derivative; the step is 0 for s < 0, 1 for s > 1.

    Of all motions that start and end with zero velocity and acceleration, this motion has the smallest integral of the
    squared jerk (T. Flash and N. Hogan, The coordination of arm movements, J. Neuroscience 5(7), 1985).
    """
    if s <= 0.0:
        return 0.0, 0.0
    if s >= 1.0:
        return 1.0, 0.0
    return s * s * s * (10.0 + s * (6.0 * s - 15.0)), 30.0 * s * s * (1.0 - s) * (1.0 - s)


def step(since: float, duration: float) -> tuple[float, float]:
    """Compute a minimum-jerk step from 0 to 1 and its rate [1/s].

    If the duration is zero, the step is 1 and the rate is 0.

    Args:
        since: Time since the start of the step [s].
        duration: Duration of the step [s].
    """
    if duration > 0.0:
        s, ds = minimum_jerk(since / duration)
        return s, ds / duration
    return 1.0, 0.0


@kernel
def count_until(times: Floats, count: int, t: float) -> int:
    """Count the times that are not later than t; `times` must be increasing."""
    low, high = 0, count
    while low < high:
        middle = (low + high) // 2
        if t < times[middle]:
            high = middle
        else:
            low = middle + 1
    return low


# Motions --------------------------------------------------------------------------------------------------------------


@kernel
def add_sine(part: SinePart, t: float, now: Displacement) -> None:
    """Add the displacement and rate of a sine at the time t."""
    since = t - part.begin
    if since < 0.0:
        return
    s, ds = step(since, part.ramp)
    a, w = part.amplitude, part.angular_frequency
    sin, cos = elementary.sin_cos(w * since)
    length, rate = a * s * sin, a * (s * w * cos + ds * sin)
    for j in range(part.dimensions):
        now.value[j] += length * part.direction[j]
        now.rate[j] += rate * part.direction[j]


@kernel
def add_reach(part: ReachPart, t: float, now: Displacement) -> None:
    """Add the displacement and rate of a reach at the time t."""
    s, ds = step(t - part.begin, part.duration)
    for j in range(part.dimensions):
        now.value[j] += s * part.displacement[j]
        now.rate[j] += ds * part.displacement[j]


@kernel
def add_path(part: PathPart, t: float, now: Displacement) -> None:
    """Add the displacement and rate of a path at the time t; outside the path's times, the nearest end point."""
    count, d = part.count, part.dimensions
    times, cubics, last = part.times, part.cubics, part.last
    if t >= times[count - 1]:
        for j in range(d):
            now.value[j] += last[j]
    elif t <= times[0]:
        for j in range(d):
            now.value[j] += cubics[0, 3 * d + j]
    else:
        k = count_until(times, count, t) - 1
        s = t - times[k]
        cubic = cubics[k]
        for j in range(d):
            c3, c2, c1 = cubic[j], cubic[d + j], cubic[2 * d + j]
            now.value[j] += ((c3 * s + c2) * s + c1) * s + cubic[3 * d + j]
            now.rate[j] += (3.0 * c3 * s + 2.0 * c2) * s + c1


@kernel
def add_levels(part: LevelsPart, t: float, now: Displacement) -> None:
    """Add the displacement and rate of steps between levels at the time t."""
    count, durations, levels = part.count, part.durations, part.levels
    k = count_until(part.begins, count, t) - 1
    level = levels[k + 1]
    if k >= 0:
        since, duration = t - part.begins[k], durations[k]
        if since < duration:
            before = levels[k]
            s, ds = step(since, duration)
            change = level - before
            now.value[0] += before + s * change
            now.rate[0] += ds * change
            return
    now.value[0] += level


@kernel
def add_tremor(part: TremorPart, t: float, now: Displacement) -> None:
    """Add the displacement and rate of a tremor at the time t."""
    since = t - part.begin
    if since < 0.0:
        return
    s, ds = step(since, part.ramp)
    a, frequency, phase = part.amplitude, part.frequency, part.phase
    for j in range(part.dimensions):
        x = dx = 0.0
        for k in range(part.count):
            w = frequency[j, k]
            sin, cos = elementary.sin_cos(w * t + phase[j, k])
            x += sin
            dx += w * cos
        now.value[j] += a * s * x
        now.rate[j] += a * (s * dx + ds * x)


@kernel
def add_other(part: OtherPart, now: Displacement) -> None:
    """Add the displacement and rate of a third-party motion, which Python has written."""
    for j in range(part.dimensions):
        now.value[j] += part.now.value[j]
        now.rate[j] += part.now.rate[j]


@kernel
def displace(course: Course, t: float, now: Displacement) -> None:
    """Compute the displacement and rate of a motion at the time t, as the sum of its terms."""
    now.value = ZERO
    now.rate = ZERO
    at = course.parts.offset
    for _ in range(course.count):
        part = MotionPart(course.buffer, at)
        kind = part.kind
        if kind == SINE:
            add_sine(SinePart(course.buffer, at), t, now)
        elif kind == REACH:
            add_reach(ReachPart(course.buffer, at), t, now)
        elif kind == PATH:
            add_path(PathPart(course.buffer, at), t, now)
        elif kind == LEVELS:
            add_levels(LevelsPart(course.buffer, at), t, now)
        elif kind == TREMOR:
            add_tremor(TremorPart(course.buffer, at), t, now)
        else:
            add_other(OtherPart(course.buffer, at), now)
        at += part.entries


# Turns ----------------------------------------------------------------------------------------------------------------


@inline
def vector_at(components: Floats, i: int) -> Vector:
    """Return vector i of an array of three-dimensional vectors."""
    return Vector(components[3 * i], components[3 * i + 1], components[3 * i + 2])


@inline
def axis_matrix(u: Vector, cos: float, sin: float) -> Matrix:
    """Compute the rotation matrix u u' + cos (I - u u') + sin [u]x about the unit vector u."""
    x, y, z = u.x, u.y, u.z
    xx, yy, zz = x * x + cos * (1.0 - x * x), y * y + cos * (1.0 - y * y), z * z + cos * (1.0 - z * z)
    xy, xz, yz = x * y * (1.0 - cos), x * z * (1.0 - cos), y * z * (1.0 - cos)
    sx, sy, sz = sin * x, sin * y, sin * z
    return Matrix(xx, xy - sz, xz + sy, xy + sz, yy, yz - sx, xz - sy, yz + sx, zz)


@kernel
def turn_plane(turning: Turning, position: Floats, velocity: Floats, n: int) -> None:
    """Rotate positions and velocities (n, 2) about the centre by the present angle and its rate."""
    angle, rate, c = turning.now.value.x, turning.now.rate.x, turning.centre
    sin, cos = elementary.sin_cos(angle)
    for i in range(n):
        x, y = position[2 * i] - c.x, position[2 * i + 1] - c.y
        ax, ay = cos * x - sin * y, sin * x + cos * y
        vx, vy = velocity[2 * i], velocity[2 * i + 1]
        position[2 * i] = c.x + ax
        position[2 * i + 1] = c.y + ay
        velocity[2 * i] = cos * vx - sin * vy - rate * ay
        velocity[2 * i + 1] = sin * vx + cos * vy + rate * ax


@kernel
def turn_space(turning: Turning, position: Floats, velocity: Floats, n: int) -> None:
    """Rotate positions and velocities (n, 3) about the axis through the centre, by the present angle and its rate."""
    angle, rate, c, u = turning.now.value.x, turning.now.rate.x, turning.centre, turning.axis
    sin, cos = elementary.sin_cos(angle)
    R = axis_matrix(u, cos, sin)
    for i in range(n):
        arm = R @ (vector_at(position, i) - c)
        v = R @ vector_at(velocity, i) + rate * cross(u, arm)
        place = c + arm
        position[3 * i], position[3 * i + 1], position[3 * i + 2] = place.x, place.y, place.z
        velocity[3 * i], velocity[3 * i + 1], velocity[3 * i + 2] = v.x, v.y, v.z


@kernel
def turn(turning: Turning, t: float, position: Floats, velocity: Floats, n: int, d: int) -> int:
    """Rotate positions r and velocities v (n, d) in place by the angle at the time t; return 1 if they change, else 0.

        r -> c + R (r - c),   v -> R v + angle' u x R (r - c),   R = u u' + cos (I - u u') + sin [u]x

    for the centre c, the unit vector u along the axis, and cos and sin of the angle.
    """
    displace(turning.angle, t, turning.now)
    if turning.now.value.x == 0.0 and turning.now.rate.x == 0.0:
        return 0
    if d == 2:
        turn_plane(turning, position, velocity, n)
    else:
        turn_space(turning, position, velocity, n)
    return 1


# Hands ----------------------------------------------------------------------------------------------------------------


@kernel
def target(hand: HandState, t: float) -> None:
    """Compute the target positions r and velocities r' of a hand at the time t (`graspfx.loop.hand.Hand`)."""
    if hand.turns == 0 and hand.motion.count == 0 and hand.squeeze.count == 0:
        return  # r is constant and was written when the hand was made
    displace(hand.squeeze, t, hand.closing)
    displace(hand.motion, t, hand.shift)
    arrange(hand, t)


@kernel
def arrange(hand: HandState, t: float) -> None:
    """Compute r and r' of a hand from the present squeeze and motion in the block, and rotations at the time t."""
    n, d, turns = hand.fingers, hand.dimensions, hand.turns
    closing, shift = hand.closing, hand.shift
    position, velocity, rest, along = hand.position, hand.velocity, hand.rest, hand.along
    s, ds = closing.value.x, closing.rate.x
    for a in range(d):
        dx = dv = 0.0
        if turns == 0:  # otherwise the offset is added after the turns
            dx = shift.value[a]
            dv = shift.rate[a]
        for j in range(a, n * d, d):
            position[j] = rest[j] + s * along[j] + dx
            velocity[j] = ds * along[j] + dv
    if turns == 0:
        return
    at = hand.turning.offset
    for _ in range(turns):
        turning = Turning(hand.buffer, at)
        turn(turning, t, position, velocity, n, d)
        at = turning.angle.offset + turning.course_entries
    for a in range(d):
        dx, dv = shift.value[a], shift.rate[a]
        for j in range(a, n * d, d):
            position[j] += dx
            velocity[j] += dv


@kernel
def follow_goals(guide: GuidedHandState, t: float) -> None:
    """Advance the followers of a guided hand to the time t; do nothing if t is not later than their present time."""
    h = t - guide.time
    if h <= 0.0:
        return
    guide.time = t
    w = 1.0 / guide.lag
    share = elementary.exp(-w * h)
    guide.squeeze, guide.squeeze_rate = follow(w, h, share, guide.squeeze_goal, guide.squeeze, guide.squeeze_rate)
    goal, lead, rate = guide.goal, guide.lead, guide.lead_rate
    for j in range(guide.fingers * guide.dimensions):
        lead[j], rate[j] = follow(w, h, share, goal[j], lead[j], rate[j])


@kernel
def guided_target(guide: GuidedHandState, t: float) -> None:
    """Compute r and r' of a guided hand at the time t (`graspfx.loop.guided_hand.GuidedHand`)."""
    follow_goals(guide, t)
    hand = guide.hand
    displace(hand.squeeze, t, hand.closing)
    displace(hand.motion, t, hand.shift)
    s = hand.closing.value.x + guide.squeeze
    ds = hand.closing.rate.x + guide.squeeze_rate
    hand.closing.value = Vector(s, 0.0, 0.0)
    hand.closing.rate = Vector(ds, 0.0, 0.0)
    arrange(hand, t)
    position, velocity, lead, rate = hand.position, hand.velocity, guide.lead, guide.lead_rate
    for j in range(guide.fingers * guide.dimensions):
        position[j] += lead[j]
        velocity[j] += rate[j]


@kernel
def joined_guided_target(joined: JoinedHandsState, t: float) -> None:
    """Compute r and r' of joined hands with guided hands at the time t (`graspfx.loop.hand.JoinedHands`)."""
    for h in range(joined.hands):
        start = int(joined.starts[h])
        if start < 0:
            guided_target(GuidedHandState(joined.buffer, joined.offset - start), t)
    joined_target(joined, t)


@kernel
def joined_target(joined: JoinedHandsState, t: float) -> None:
    """Compute r and r' of joined hands at the time t (`graspfx.loop.hand.JoinedHands`).

    The targets of guided hands must have been computed before.
    """
    d = joined.dimensions
    for h in range(joined.hands):
        start = int(joined.starts[h])
        if start > 0:
            target(HandState(joined.buffer, joined.offset + start), t)
    for i in range(joined.fingers):
        r = Floats(joined.buffer, joined.offset + int(joined.sources[i, 0]))
        v = Floats(joined.buffer, joined.offset + int(joined.sources[i, 1]))
        for a in range(d):
            joined.position[i * d + a] = r[a]
            joined.velocity[i * d + a] = v[a]
