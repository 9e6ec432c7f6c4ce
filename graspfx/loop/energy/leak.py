"""Energy of a grasp in a run, by internal motion, translation and rotation, and the least damping that repays leaks.

All fingers' vectors are in one frame; torsion is the fourth entry of soft fingers, in units of the patch length. w_i
is the weight of finger i in the metric W. Rigid modes are those of `graspfx.grasp.rigid_modes`: a fraction beta_k,
then the components of q_k on displacements scaled by sqrt(w).

    Q_k = W^-1/2 beta_k q_k q_k' W^1/2,   f'D = sum_k f'Q_k D + f'(I - sum_k Q_k) D

A force held over a sample does exactly the work f'D on a port that moves by D, so these sums are exact. The step D
selects the port. For the device port D is the fingers' step, and for the object port D is the object's motion at the
contacts. For the coupling D is their difference, the change of e = p - c.
"""

from __future__ import annotations

import math

from graspfx.compile.kernel import kernel
from graspfx.compile.records import Floats, Many, Record, Table, floats, many, table
from graspfx.grasp.rigid_modes import Contact
from graspfx.spatial import Vector, Vector4

INTERNAL, TRANSLATION, ROTATION = 0, 1, 2  # indices of the accounts, in the order of all vectors of three


class ModeSplit(Record):
    """Rigid modes that split the accounts."""

    fingers: int  # n
    width: int  # entries per finger: 3, or 4 with torsion
    count: int  # number of modes
    shifts: int  # number of translations, which are the first modes
    reach: Floats = floats("6")  # beta_k q_k'W^1/2 D
    modes: Table = table("6", "1 + width * fingers")


class Sum(Record):
    """A sum and its accumulated rounding error."""

    value: float
    carry: float


class Account(Record):
    """Energy that one kind of motion has received, dissipated and stored [J]."""

    work: Sum  # energy received so far
    spent: float  # lower bound of the energy dissipated by friction
    stored: float  # energy now in the springs, written by the caller
    opened: float  # energy in the springs when the ledger was opened


class Accounts(Record):
    """Accounts of internal motion, translation and rotation, and the total work."""

    parts: Many[Account] = many("3")
    whole: Sum


@kernel
def reach(split: ModeSplit, contacts: Many[Contact], steps: Many[Vector4]) -> None:
    """Compute beta_k q_k'W^1/2 D for each mode."""
    width, modes = split.width, split.modes
    for k in range(split.count):
        total = 0.0
        for i, contact in enumerate(contacts):
            w = math.sqrt(contact.weight)
            for a in range(width):
                total += w * modes[k, 1 + width * i + a] * steps[i][a]
        split.reach[k] = modes[k, 0] * total


@kernel
def squares(split: ModeSplit, contacts: Many[Contact], steps: Many[Vector4]) -> Vector:
    """Compute D'W Q D of the internal motion, translations and rotations [m^2], not negative.

    At a displacement e, a spring of gain k stores k/2 times these squares. On a step D, friction b w_i at each finger
    dissipates at least b/T times these squares.
    """
    reach(split, contacts, steps)
    width, modes = split.width, split.modes
    translation = rotation = whole = 0.0
    for k in range(split.count):
        share = modes[k, 0]
        if share > 0.0:
            if k < split.shifts:
                translation += split.reach[k] * split.reach[k] / share
            else:
                rotation += split.reach[k] * split.reach[k] / share
    for i, contact in enumerate(contacts):
        w = contact.weight
        for a in range(width):
            left = steps[i][a]
            for k in range(split.count):
                if w > 0.0:
                    left -= modes[k, 1 + width * i + a] * split.reach[k] / math.sqrt(w)
            whole += w * left * steps[i][a]  # D'W (I - Q) D, without a difference of large sums
    return Vector(max(whole, 0.0), translation, rotation)


@kernel
def spend(accounts: Accounts, drag: float, square: Vector) -> None:
    """Add the energy that friction dissipates on a step with these squares [m^2].

    `drag` [N/m] is the coefficient of friction [N s/m] divided by the duration of the step.
    """
    accounts.parts[INTERNAL].spent += drag * square.x
    accounts.parts[TRANSLATION].spent += drag * square.y
    accounts.parts[ROTATION].spent += drag * square.z


@kernel
def book(account: Sum, energy: float) -> None:
    """Add to a sum and its rounding error (Neumaier 1974), so that long runs stay as accurate as short ones."""
    old = account.value
    new = old + energy
    if abs(old) >= abs(energy):
        account.carry += (old - new) + energy
    else:
        account.carry += (energy - new) + old
    account.value = new


@kernel
def balance(account: Account) -> float:
    """Compute the work plus the friction losses minus the springs' gain [J]; negative if energy was generated."""
    work = account.work.value + account.work.carry
    gained = account.stored - account.opened
    return work + account.spent - gained


@kernel
def add_damping(
    accounts: Accounts, split: ModeSplit, contacts: Many[Contact], forces: Many[Vector4], steps: Many[Vector4],
    T: float, most: float,
) -> Vector:  # fmt: skip
    """Add a W Q_m D/T to the forces of each account m in debt, with the smallest a that repays it in one equal step.

    a = min(most, T debt/(D'W Q_m D)) [N s/m] (Hannaford and Ryu 2002, one controller per mode), so a debt of internal
    motion adds no damping to motion of the object. If `most` limits a, the rest of the debt is carried over to the next
    sample. `most` is required because the damping force is held over a sample; the passivity controller sets it to
    m/(2 T) (`brake.bound`).

    Returns:
        Damping coefficients a of the three accounts: internal motion, translation and rotation [N s/m].
    """
    square = squares(split, contacts, steps)
    squeezing = damping_for(-balance(accounts.parts[INTERNAL]), square.x, T, most)
    shifting = damping_for(-balance(accounts.parts[TRANSLATION]), square.y, T, most)
    turning = damping_for(-balance(accounts.parts[ROTATION]), square.z, T, most)
    width, modes = split.width, split.modes
    for i, contact in enumerate(contacts):
        w = contact.weight
        for a in range(width):
            pushed = squeezing * w * steps[i][a]
            for k in range(split.count):
                b = shifting if k < split.shifts else turning
                pushed += (b - squeezing) * math.sqrt(w) * modes[k, 1 + width * i + a] * split.reach[k]
            forces[i][a] += pushed / T
    return Vector(squeezing, shifting, turning)


def damping_for(debt: float, square: float, T: float, most: float) -> float:
    """Return the damping that dissipates `debt` [J] on a step with this square [m^2], at most `most` [N s/m]."""
    if debt <= 0.0 or square <= 0.0:
        return 0.0
    if debt * T >= most * square:
        return most
    return debt * T / square
