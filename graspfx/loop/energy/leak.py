"""Energy of a grasp told apart while it runs: squeezing, shifting and turning, and the least brake where it leaks.

Every function takes the buffer `S` (float64) and integer offsets, allocates nothing and uses scalars only, so that
the same source runs interpreted and compiled. Fingers stand in rows of `stride` entries that start at `rows`: `force`
and `step` of `width` entries (3, or 4 with torsion in units of the patch length), and the `weight` w_i of the metric
W. `modes` are those of `graspfx.grasp.rigid_modes.rigid_modes`: `count`, of which `shifts` translations come first,
each its share beta and then its components q_k on displacements scaled by sqrt(w). Forces, steps and modes
are in one frame.

    Q_k = W^-1/2 beta_k q_k q_k' W^1/2,   f'D = sum_k f'Q_k D + f'(I - sum_k Q_k) D

The force held over a sample takes exactly f'D of the port that moves by D, so these sums are the energy and no
estimate of it. What a port is follows from the step: the fingers' own for the device port, the object's motion at the
contacts for the object port, and the difference, D of e = p - c, for the coupling between them.
"""

from __future__ import annotations

import math
from typing import Any

# The accounts, in this order wherever three or four numbers stand for them.
INTERNAL, TRANSLATION, ROTATION, WHOLE = 0, 1, 2, 3

# A ledger's entries, offsets from its start [J].
WORK = 0  # taken by each account so far, four
CARRY = 4  # what rounding left out of them, four
SPENT = 8  # taken by the friction beside it, at least: three
STORED = 11  # now in the springs, three, written by the caller
OPENED = 14  # in the springs when the ledger was opened, three
SIZE = 17


def reach(
    S: Any, rows: int, stride: int, n: int, width: int, step: int, weight: int, modes: int, count: int, row: int
) -> None:
    """beta_k q_k'W^1/2 D for each mode, written to `row` (`count` entries)."""
    size = 1 + width * n
    for k in range(count):
        m = modes + k * size
        total = 0.0
        for i in range(n):
            r = rows + i * stride
            w = math.sqrt(S[r + weight])
            for a in range(width):
                total += w * S[m + 1 + width * i + a] * S[r + step + a]
        S[row + k] = S[m] * total


def works(
    S: Any, rows: int, stride: int, n: int, width: int, force: int, step: int, weight: int,
    modes: int, shifts: int, count: int, row: int,
) -> tuple[float, float, float, float]:  # fmt: skip
    """f'(I - Q) D, sum over translations of f'Q_k D, the same over rotations, and f'D [J].

    Each is summed by itself: that the first three make the fourth is a check, not a definition. A finger of weight zero
    is internal. `row` is scratch of `count` entries.
    """
    reach(S, rows, stride, n, width, step, weight, modes, count, row)
    size = 1 + width * n
    translation = rotation = internal = whole = 0.0
    for k in range(count):
        m = modes + k * size
        push = 0.0
        for i in range(n):
            r = rows + i * stride
            w = S[r + weight]
            if w > 0.0:
                w = 1.0 / math.sqrt(w)
                for a in range(width):
                    push += w * S[m + 1 + width * i + a] * S[r + force + a]
        if k < shifts:
            translation += push * S[row + k]
        else:
            rotation += push * S[row + k]
    for i in range(n):
        r = rows + i * stride
        w = S[r + weight]
        if w > 0.0:
            w = 1.0 / math.sqrt(w)
        for a in range(width):
            left = S[r + step + a]
            whole += S[r + force + a] * left
            for k in range(count):
                left -= w * S[modes + k * size + 1 + width * i + a] * S[row + k]
            internal += S[r + force + a] * left
    return internal, translation, rotation, whole


def squares(
    S: Any, rows: int, stride: int, n: int, width: int, step: int, weight: int,
    modes: int, shifts: int, count: int, row: int,
) -> tuple[float, float, float]:  # fmt: skip
    """D'W Q D of the internal part, of translations and of rotations [m^2], not negative.

    Half the gain times these is what a spring of that gain stores at the displacement e; b/T times these what a
    friction b w_i at each finger takes on the step D, at least.
    """
    reach(S, rows, stride, n, width, step, weight, modes, count, row)
    size = 1 + width * n
    translation = rotation = whole = 0.0
    for k in range(count):
        share = S[modes + k * size]
        if share > 0.0:
            if k < shifts:
                translation += S[row + k] * S[row + k] / share
            else:
                rotation += S[row + k] * S[row + k] / share
    for i in range(n):
        r = rows + i * stride
        for a in range(width):
            left = S[r + step + a]
            for k in range(count):
                w = S[r + weight]
                if w > 0.0:
                    left -= S[modes + k * size + 1 + width * i + a] * S[row + k] / math.sqrt(w)
            whole += S[r + weight] * left * S[r + step + a]  # D'W (I - Q) D, without a difference of large sums
    return max(whole, 0.0), translation, rotation


def store(
    S: Any, ledger: int, rows: int, stride: int, n: int, width: int, displacement: int, weight: int,
    modes: int, shifts: int, count: int, row: int, external: float, internal: float,
) -> None:  # fmt: skip
    """Writes 1/2 k e'W Q e of each part to the ledger: what springs of eq. (4) with these gains hold at e [J]."""
    squeezed, shifted, turned = squares(
        S, rows, stride, n, width, displacement, weight, modes, shifts, count, row
    )  # fmt: skip
    S[ledger + STORED + INTERNAL] = 0.5 * internal * squeezed
    S[ledger + STORED + TRANSLATION] = 0.5 * external * shifted
    S[ledger + STORED + ROTATION] = 0.5 * external * turned


def open_ledger(S: Any, ledger: int) -> None:
    """Begins anew: nothing taken, and what the springs hold now counts as there from the start."""
    for j in range(STORED):
        S[ledger + j] = 0.0
    for j in range(3):
        S[ledger + OPENED + j] = S[ledger + STORED + j]


def observe(
    S: Any, ledger: int, rows: int, stride: int, n: int, width: int, force: int, step: int, weight: int,
    modes: int, shifts: int, count: int, row: int, drag: float,
) -> None:  # fmt: skip
    """Books one sample: the held force's work on the step, and `drag` = b/T [N/m] times the step's squares.

    b is friction of the devices, b w_i at finger i [N s/m], and nothing else takes it; 0 books none.
    """
    taken = works(S, rows, stride, n, width, force, step, weight, modes, shifts, count, row)
    book(S, ledger, INTERNAL, taken[0])
    book(S, ledger, TRANSLATION, taken[1])
    book(S, ledger, ROTATION, taken[2])
    book(S, ledger, WHOLE, taken[3])
    if drag > 0.0:
        moved = squares(S, rows, stride, n, width, step, weight, modes, shifts, count, row)
        S[ledger + SPENT + INTERNAL] += drag * moved[0]
        S[ledger + SPENT + TRANSLATION] += drag * moved[1]
        S[ledger + SPENT + ROTATION] += drag * moved[2]


def book(S: Any, ledger: int, account: int, energy: float) -> None:
    """Adds to an account and keeps what rounding drops (Neumaier 1974), so that long runs close as short ones do."""
    old = S[ledger + WORK + account]
    new = old + energy
    if abs(old) >= abs(energy):
        S[ledger + CARRY + account] += (old - new) + energy
    else:
        S[ledger + CARRY + account] += (energy - new) + old
    S[ledger + WORK + account] = new


def balance(S: Any, ledger: int, account: int) -> float:
    """Taken, and spent by friction, less what the springs gained [J]: below zero the held coupling has made energy."""
    taken = S[ledger + WORK + account] + S[ledger + CARRY + account]
    gained = S[ledger + STORED + account] - S[ledger + OPENED + account]
    return float(taken + S[ledger + SPENT + account] - gained)


def gap(S: Any, ledger: int) -> float:
    """By how much the three accounts miss the whole [J]: rounding, or the ledger was kept wrong."""
    total = -(S[ledger + WORK + WHOLE] + S[ledger + CARRY + WHOLE])
    for j in range(3):
        total += S[ledger + WORK + j] + S[ledger + CARRY + j]
    return float(total)


def brake(
    S: Any, ledger: int, rows: int, stride: int, n: int, width: int, force: int, step: int, weight: int,
    modes: int, shifts: int, count: int, row: int, T: float, most: float,
) -> tuple[float, float, float]:  # fmt: skip
    """Adds a W Q_m D/T to the forces of each account m in debt, with the least a that pays in one more such step.

    a = min(most, T debt/(D'W Q_m D)) [N s/m] (Hannaford and Ryu 2002, one controller per mode): a leak of squeezing
    puts no damping on moving the object. What is owed beyond `most` stays in the books. The brake is held over a sample
    as any damping is, so `most` is what the devices' friction leaves free: b - k T/2 at the largest gain k.

    Returns:
        a of internal, translation, rotation [N s/m].
    """
    moved = squares(S, rows, stride, n, width, step, weight, modes, shifts, count, row)
    squeezing = rate(-balance(S, ledger, INTERNAL), moved[0], T, most)
    shifting = rate(-balance(S, ledger, TRANSLATION), moved[1], T, most)
    turning = rate(-balance(S, ledger, ROTATION), moved[2], T, most)
    size = 1 + width * n
    for i in range(n):
        r = rows + i * stride
        w = S[r + weight]
        for a in range(width):
            pushed = squeezing * w * S[r + step + a]
            for k in range(count):
                b = shifting if k < shifts else turning
                pushed += (b - squeezing) * math.sqrt(w) * S[modes + k * size + 1 + width * i + a] * S[row + k]
            S[r + force + a] += pushed / T
    return squeezing, shifting, turning


def rate(debt: float, square: float, T: float, most: float) -> float:
    """The damping that takes `debt` [J] on a step of this square [m^2], at most `most` [N s/m]."""
    if debt <= 0.0 or square <= 0.0:
        return 0.0
    if debt * T >= most * square:
        return most
    return debt * T / square
