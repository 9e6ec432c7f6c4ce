"""The energy of a grasp, sample by sample: from the fingers through the coupling to the object, entry by entry.

Between two samples the held forces f = fe + fd + fb (springs, damping, brake) move by d, the step of the fingers
against the object in its axes. With the displacement h that the springs hold, fe = K h, and a_j fe's part in mode j,

    stored      V_j = 1/2 a_j'h
    damped      fd_j'd
    braked      fb_j'd
    slipped     a_j'(d - h+ + h)           taken by contacts that slide, slip or let go, or lies beyond a limit
    reshaped    1/2 (a_j'h+ - a_j+'h)      taken where the split, a weight or a skew stiffness changes what is stored
    leaked      1/2 (a_j+ - a_j)'(h+ - h)  made by holding the force: 1/2 Dh'K Dh where nothing changes

so that f_j'd = V_j+ - V_j + damped + braked + slipped + reshaped - leaked: an identity, whatever the law did. The
fingers' work is the wrench's and f'd, the wrench's that of `graspfx.objects.energy`. All is summed by itself; the gap
between the fingers' work and all the rest is rounding, or the books are wrong.

A compliant fingertip adds its depth (fe_n/k)^(2/3) along the normal to h and stores 2/5 of its force times that, not
1/2: the tenth is taken from V_j, and what it changes by, of third order in a step, counts as reshaped.
"""

from __future__ import annotations

from typing import Any

from graspfx.cones.elimination import eliminate
from graspfx.coupling import block as at
from graspfx.grasp.rigid_modes import rigid_modes
from graspfx.loop.energy import leak as po
from graspfx.loop.energy.leak import balance, book, squares
from graspfx.objects import energy
from graspfx.objects import integrators as body
from graspfx.objects.energy import keep, kinetic, settle

# The buffer beside the object's block. Sums stand in fours, each with what rounding left out of them.
STARTED = 0
COUNT = 1  # modes
DRAG = 2  # least friction b_i/w_i of the devices [N s/m]
LIGHT = 3  # largest w_i/m_i of the devices [1/kg]
OTHERS = 4  # not our integrator: what the body met is what is left over
GIVEN = 5  # gains are matrices with cones: h = K^-1 fe
CONTROL = 6  # modes that leak are braked (`watch`)
SCALE = 7  # the largest energy so far [J]
LEDGER = 8  # of `passivity_observer`
DAMPED = LEDGER + po.SIZE
BRAKED = DAMPED + 8
SLIPPED = BRAKED + 8
RESHAPED = SLIPPED + 8
LEAKED = RESHAPED + 8
DONE = LEAKED + 8  # by fingers, wrench, gravity; and what obstacles did
LOST = DONE + 8  # viscous loss, the integrator's defect
BODY = LOST + 8  # what is kept of the body
FRAME = BODY + energy.SIZE  # axes that the held forces are in, row by row
AXES = FRAME + 9  # free directions, where the coupling needs no split
FIRST = AXES + 18  # kinetic energy at the start
ROW = FIRST + 1  # scratch
OUT = ROW + 6  # what is recorded, in the order of WRITTEN
WRITTEN = 9 * 3 + 9
ROWS = OUT + WRITTEN
# A finger's row.
CONTACT = 0
NORMAL = 3
PATCH = 6
WEIGHT = 7
PLACE = 8  # of the fingertip, world [m]
ARM = 11  # from the object's centre to where its force acts, world [m]
TWIST = 14  # direction of torsion times rho, world [m]
PUSH = 17  # the held force on the object, world [N]
STEP = 20  # d, four entries as below
TIP = 24  # the fingertip's own step
NEXT = 28  # the elastic force now; then scratch
BRAKE = 32  # fb now
HELD = 36  # h
STRETCH = 40  # h+
PARTS = 44  # of the held force f by mode, three times four entries
SPRINGS = 56  # of fe
BRAKES = 68  # of fb
NEW = 80  # of fe now
CURVED = 92  # by mode, what a pad stores less than half of its force times its depth: 1/10 of that
BEFORE = 95  # of the held force
STRIDE = 98


def modes(n: int) -> int:
    return ROWS + n * STRIDE


def square(n: int) -> int:
    """Offset of K and fe while h is found from them; present only where gains are matrices."""
    return modes(n) + 6 * (1 + 4 * n)


def size(n: int, m: int = 0) -> int:
    """Entries of the buffer; `m` is how many components the forces have where gains are matrices."""
    return square(n) + m * m + m


def observe(S: Any, B: Any, T: float) -> None:
    """Books the sample that has just ended; what the springs hold now is found from the forces of this sample."""
    if B[STARTED] != 0.0:
        move(S, B, T)
    load(S, B)
    n = int(S[at.FINGERS])
    if B[STARTED] != 0.0:
        book_springs(B, n)
        if S[at.PADDED] != 0.0:
            book_pads(B, n)
    for j in range(3):
        total = 0.0
        for i in range(n):
            r = ROWS + i * STRIDE
            for a in range(4):
                total += B[r + NEW + 4 * j + a] * B[r + STRETCH + a]
            if S[at.PADDED] != 0.0:
                total -= 2.0 * B[r + CURVED + j]
        B[LEDGER + po.STORED + j] = 0.5 * total
        if B[STARTED] == 0.0:
            B[LEDGER + po.OPENED + j] = 0.5 * total
    if B[STARTED] == 0.0:
        B[FIRST] = kinetic(S, at.BODY)
    for i in range(n):
        for a in range(4):
            B[ROWS + i * STRIDE + BRAKE + a] = 0.0


def move(S: Any, B: Any, T: float) -> None:
    """The motion of the sample that has ended, and all that was done along it but the springs' share."""
    n, o = int(S[at.FINGERS]), at.BODY
    work, fallen, met, loss, turning_loss, defect, turning_defect = settle(S, o, B, BODY, T)
    if B[OTHERS] != 0.0:
        gained = kinetic(S, o) - B[BODY + energy.ENERGY]
        met = gained - work - fallen + loss + turning_loss - defect - turning_defect
    book(B, DONE, 1, work)
    book(B, DONE, 2, fallen)
    book(B, DONE, 3, met)
    book(B, LOST, 0, loss + turning_loss)
    book(B, LOST, 1, defect + turning_defect)
    x, t = BODY + energy.SHIFT, BODY + energy.TURN
    tx, ty, tz = B[t], B[t + 1], B[t + 2]
    for i in range(n):
        r, s = ROWS + i * STRIDE, at.ROW + i * at.STRIDE
        done = 0.0
        for a in range(3):
            step = S[s + at.POSITION + a] - B[r + PLACE + a]
            B[r + NEXT + a] = step
            done += B[r + PUSH + a] * step
        book(B, DONE, 0, done)
        ax, ay, az = B[r + ARM], B[r + ARM + 1], B[r + ARM + 2]
        dx = B[r + NEXT] - B[x] - (ty * az - tz * ay)
        dy = B[r + NEXT + 1] - B[x + 1] - (tz * ax - tx * az)
        dz = B[r + NEXT + 2] - B[x + 2] - (tx * ay - ty * ax)
        px, py, pz = B[r + NEXT], B[r + NEXT + 1], B[r + NEXT + 2]
        for a in range(3):
            f = FRAME + a
            B[r + STEP + a] = B[f] * dx + B[f + 3] * dy + B[f + 6] * dz
            B[r + TIP + a] = B[f] * px + B[f + 3] * py + B[f + 6] * pz
        B[r + STEP + 3] = -(B[r + TWIST] * tx + B[r + TWIST + 1] * ty + B[r + TWIST + 2] * tz)
        B[r + TIP + 3] = 0.0
    lead = LEDGER
    if B[DRAG] > 0.0:
        width, shifts = 4 if S[at.COORDINATES] > 3.0 else 3, int(S[at.SHIFTS])
        moved = squares(B, ROWS, STRIDE, n, width, TIP, WEIGHT, modes(n), shifts, int(B[COUNT]), ROW)
        B[lead + po.SPENT + po.INTERNAL] += B[DRAG] / T * moved[0]
        B[lead + po.SPENT + po.TRANSLATION] += B[DRAG] / T * moved[1]
        B[lead + po.SPENT + po.ROTATION] += B[DRAG] / T * moved[2]
    B[lead + po.SPENT + po.TRANSLATION] += loss - defect
    B[lead + po.SPENT + po.ROTATION] += turning_loss - turning_defect


def load(S: Any, B: Any) -> None:
    """The modes of this sample, the elastic force by mode, and the displacement that goes with it."""
    n = int(S[at.FINGERS])
    width = 4 if S[at.COORDINATES] > 3.0 else 3
    for i in range(n):
        r, s = ROWS + i * STRIDE, at.ROW + i * at.STRIDE
        for a in range(3):
            B[r + CONTACT + a] = S[s + at.CONTACT + a]
            B[r + NORMAL + a] = S[s + at.NORMAL + a]
        B[r + PATCH] = S[s + at.PATCH]
        B[r + WEIGHT] = S[s + at.WEIGHT]
        for a in range(4):
            B[r + NEXT + a] = S[s + at.ELASTIC + a]
    lead = 1 + width * n
    if S[at.EQUAL] != 0.0:  # the law has no use for modes
        for k in range(18):
            B[AXES + k] = S[at.AXES + k]
        dimensions, low, high = int(S[at.DIMENSIONS]), S[at.ARM_LOW], S[at.ARM_HIGH]
        B[COUNT], _ = rigid_modes(B, ROWS, STRIDE, n, S, at.SHIFTS, dimensions, low, high, width, B, modes(n), lead)  # type: ignore[call-arg, arg-type] # flat
    else:
        B[COUNT] = S[at.COUNT]
        for k in range(int(S[at.COUNT]) * (1 + width * n)):
            B[modes(n) + k] = S[at.modes(n) + k]
    kep, kip = S[at.EXTERNAL_STIFFNESS], S[at.INTERNAL_STIFFNESS]
    split(B, n, width, int(S[at.SHIFTS]), NEXT, NEW)
    if B[GIVEN] != 0.0 and stretch_by_matrix(S, B):
        if S[at.PADDED] != 0.0:
            add_pads(S, B, n, True)
        return
    if B[GIVEN] == 0.0 and kep > 0.0 and kip > 0.0:
        stretch(B, n, width, kep, kip)
        if S[at.PADDED] != 0.0:
            add_pads(S, B, n, True)
    else:  # without cones, and where a K without an inverse leaves it open
        for i in range(n):
            for a in range(4):
                B[ROWS + i * STRIDE + STRETCH + a] = S[at.ROW + i * at.STRIDE + at.DISPLACEMENT + a]
        if S[at.PADDED] != 0.0:
            add_pads(S, B, n, False)


def split(B: Any, n: int, width: int, shifts: int, force: int, out: int) -> None:
    """The parts Q_j'f of a force: internal, translation, rotation; they sum to it."""
    lead = 1 + width * n
    for i in range(n):
        r = ROWS + i * STRIDE
        for a in range(4):
            B[r + out + a] = B[r + force + a]
            B[r + out + 4 + a] = 0.0
            B[r + out + 8 + a] = 0.0
    for k in range(int(B[COUNT])):
        m = modes(n) + k * lead
        z = B[m] * along(B, n, width, m, force)
        to = out + 4 if k < shifts else out + 8
        for i in range(n):
            r = ROWS + i * STRIDE
            w = B[r + WEIGHT] ** 0.5
            for a in range(width):
                share = w * B[m + 1 + width * i + a] * z
                B[r + to + a] += share
                B[r + out + a] -= share


def along(B: Any, n: int, width: int, m: int, force: int) -> float:
    """q'W^-1/2 f of the mode at m; a finger of no weight counts nothing."""
    total = 0.0
    for i in range(n):
        r = ROWS + i * STRIDE
        if B[r + WEIGHT] > 0.0:
            w = B[r + WEIGHT] ** -0.5
            for a in range(width):
                total += w * B[m + 1 + width * i + a] * B[r + force + a]
    return float(total)


def stretch(B: Any, n: int, width: int, kep: float, kip: float) -> None:
    """h = K^-1 fe of eq. (4) with numbers for gains, to STRETCH; zero at a finger of no weight."""
    for i in range(n):
        r = ROWS + i * STRIDE
        for a in range(4):
            B[r + STRETCH + a] = B[r + NEXT + a] / (kip * B[r + WEIGHT]) if B[r + WEIGHT] > 0.0 else 0.0
    for k in range(int(B[COUNT])):
        m = modes(n) + k * (1 + width * n)
        z = (1.0 / (kip + (kep - kip) * B[m]) - 1.0 / kip) * along(B, n, width, m, NEXT)
        for i in range(n):
            r = ROWS + i * STRIDE
            if B[r + WEIGHT] > 0.0:
                for a in range(width):
                    B[r + STRETCH + a] += z * B[m + 1 + width * i + a] * B[r + WEIGHT] ** -0.5


def add_pads(S: Any, B: Any, n: int, adds: bool) -> None:
    """The pads' depths (fe_n/k)^(2/3) along the normals, to h+ if it `adds`, and a tenth of what they make with fe."""
    for i in range(n):
        r, k = ROWS + i * STRIDE, S[at.ROW + i * at.STRIDE + at.PAD]
        normal = 0.0
        for a in range(3):
            normal += B[r + NORMAL + a] * B[r + NEXT + a]
        depth = 0.0
        if k > 0.0 and normal > 0.0:
            depth = (normal / k) ** (2.0 / 3.0)
        for j in range(3):
            part = 0.0
            for a in range(3):
                part += B[r + NEW + 4 * j + a] * B[r + NORMAL + a]
            B[r + CURVED + j] = 0.1 * part * depth
        if adds:
            for a in range(3):
                B[r + STRETCH + a] += depth * B[r + NORMAL + a]


def book_pads(B: Any, n: int) -> None:
    """What pads store less than springs of the same force and depth: to where what is stored changes its form."""
    for j in range(3):
        change = 0.0
        for i in range(n):
            r = ROWS + i * STRIDE
            change += B[r + CURVED + j] - B[r + BEFORE + j]
        book(B, RESHAPED, j, change)


def stretch_by_matrix(S: Any, B: Any) -> bool:
    """h = K^-1 fe with the K that stands in the block, to STRETCH; False, and nothing, where K has no inverse."""
    n, d = int(S[at.FINGERS]), int(S[at.DIMENSIONS])
    m = n * d
    K, H = at.stiffness_offset(S, 0), square(n)  # type: ignore[call-arg] # flat
    fe = H + m * m
    for k in range(m * m):
        B[H + k] = S[K + k]
    for i in range(n):
        for a in range(d):
            B[fe + i * d + a] = B[ROWS + i * STRIDE + NEXT + a]
    if not eliminate(B, H, m, B, fe, m):  # type: ignore[arg-type, call-arg] # flat
        return False
    for i in range(n):
        for a in range(d):
            B[ROWS + i * STRIDE + STRETCH + a] = B[fe + i * d + a]
    return True


def book_springs(B: Any, n: int) -> None:
    """The coupling's entries of the sample that has ended, mode by mode."""
    total = 0.0
    for j in range(3):
        work = damped = braked = slipped = reshaped = leaked = 0.0
        for i in range(n):
            r = ROWS + i * STRIDE
            for a in range(4):
                d, h, now = B[r + STEP + a], B[r + HELD + a], B[r + STRETCH + a]
                f, fe = B[r + PARTS + 4 * j + a], B[r + SPRINGS + 4 * j + a]
                fb, new = B[r + BRAKES + 4 * j + a], B[r + NEW + 4 * j + a]
                work += f * d
                damped += (f - fe - fb) * d
                braked += fb * d
                slipped += fe * (d - (now - h))
                reshaped += 0.5 * (fe * now - new * h)
                leaked += 0.5 * (new - fe) * (now - h)
        book(B, LEDGER, j, work)
        book(B, DAMPED, j, damped)
        book(B, BRAKED, j, braked)
        book(B, SLIPPED, j, slipped)
        book(B, RESHAPED, j, reshaped)
        book(B, LEAKED, j, leaked)
        total += work
    book(B, LEDGER, po.WHOLE, total)


def hold(S: Any, B: Any) -> None:
    """Keeps what this sample holds until the next: forces by mode, where they act, the object's state."""
    n, o = int(S[at.FINGERS]), at.BODY
    width = 4 if S[at.COORDINATES] > 3.0 else 3
    shifts = int(S[at.SHIFTS])
    x, R = at.BODY + body.POSITION, at.BODY + body.ROTATION
    if S[at.IMPLICIT] != 0.0:
        x, R = at.BODY + body.NEXT_POSITION, at.BODY + body.NEXT_ROTATION
    braked = False
    same = True
    for k in range(9):
        B[FRAME + k] = S[R + k]
    for i in range(n):
        r, s = ROWS + i * STRIDE, at.ROW + i * at.STRIDE
        for a in range(4):
            B[r + HELD + a] = B[r + STRETCH + a]
            braked = braked or B[r + BRAKE + a] != 0.0
            same = same and S[s + at.LOCAL + a] == S[s + at.ELASTIC + a]
            B[r + NEXT + a] = S[s + at.LOCAL + a]
        if S[at.PADDED] != 0.0:
            for j in range(3):
                B[r + BEFORE + j] = B[r + CURVED + j]
        for a in range(12):
            B[r + SPRINGS + a] = B[r + NEW + a]
            B[r + PARTS + a] = B[r + NEW + a]
            B[r + BRAKES + a] = 0.0
        where = at.CONTACT_WORLD if S[at.AT_CONTACT] != 0.0 else at.POSITION
        for a in range(3):
            B[r + PLACE + a] = S[s + at.POSITION + a]
            B[r + PUSH + a] = S[s + at.FORCE + a]
            B[r + ARM + a] = S[s + where + a] - S[x + a]
            k = R + 3 * a
            t = s + at.TWIST_AXIS
            B[r + TWIST + a] = S[s + at.PATCH] * (S[k] * S[t] + S[k + 1] * S[t + 1] + S[k + 2] * S[t + 2])
    if not same:
        split(B, n, width, shifts, NEXT, PARTS)
    if braked:
        split(B, n, width, shifts, BRAKE, BRAKES)
    keep(S, o, B, BODY)
    B[STARTED] = 1.0


def total_of(B: Any, group: int, lane: int) -> float:
    return float(B[group + lane] + B[group + 4 + lane])


def report(S: Any, B: Any) -> None:
    """What is recorded, to OUT: nine quantities by mode, and nine of the object."""
    moving = kinetic(S, at.BODY)
    fingers = total_of(B, DONE, 0)
    gap = fingers - (moving - B[FIRST]) + total_of(B, DONE, 2) + total_of(B, DONE, 3)
    gap += total_of(B, LOST, 1) - total_of(B, LOST, 0)
    for j in range(3):
        stored = B[LEDGER + po.STORED + j]
        damped, braked, slipped = total_of(B, DAMPED, j), total_of(B, BRAKED, j), total_of(B, SLIPPED, j)
        reshaped, leaked = total_of(B, RESHAPED, j), total_of(B, LEAKED, j)
        gap += leaked - (stored - B[LEDGER + po.OPENED + j]) - damped - braked - slipped - reshaped
        B[OUT + j] = total_of(B, LEDGER, j)
        B[OUT + 3 + j] = stored
        B[OUT + 6 + j] = damped
        B[OUT + 9 + j] = slipped
        B[OUT + 12 + j] = reshaped
        B[OUT + 15 + j] = leaked
        B[OUT + 18 + j] = balance(B, LEDGER, j)
        B[OUT + 21 + j] = braked
        B[SCALE] = max(B[SCALE], abs(B[OUT + j]), stored, leaked)
    B[OUT + 27] = fingers
    B[OUT + 28] = total_of(B, DONE, 1)
    B[OUT + 29] = moving
    B[OUT + 30] = total_of(B, DONE, 2)
    B[OUT + 31] = total_of(B, DONE, 3)
    B[OUT + 32] = total_of(B, LOST, 0)
    B[OUT + 33] = total_of(B, LOST, 1)
    B[OUT + 34] = gap
    B[SCALE] = max(B[SCALE], abs(fingers), moving, abs(B[OUT + 30]), B[OUT + 32])
