"""Work of the fingers by internal motion, translation and rotation, and damping that dissipates generated energy.

The vectors of all fingers are in one frame. For soft fingers, the fourth entry of a vector is torsion, in units of the
patch length. W is the diagonal matrix of the fingers' weights w_i. The rigid modes (`graspfx.grasp.rigid_modes`) are
vectors q_k of displacements scaled by sqrt(w), with fractions beta_k. The matrix Q_k of mode k, and the work of forces
f on steps D, are

    Q_k = W^-1/2 beta_k q_k q_k' W^1/2,   f'D = sum_k f'Q_k D + f'(I - sum_k Q_k) D

where the last term is the work on internal motion. The work is exact, because the forces are held over a sample. D is
the step of the fingers for the work at the devices, the step of the object at the contacts for the work on the object,
and the difference of both, which is the change of e = p - c, for the work on the coupling.
"""

from __future__ import annotations

import math

from graspfx.compile.kernel import kernel
from graspfx.compile.records import Floats, Many, Record, Table, floats, many, table
from graspfx.grasp.rigid_modes import Contact
from graspfx.spatial import Vector, Vector4

INTERNAL, TRANSLATION, ROTATION = 0, 1, 2  # indices of the accounts, in the order of all vectors of three


class ModeSplit(Record):
    """Rigid modes by which work is split into internal motion, translation and rotation."""

    fingers: int  # n
    width: int  # entries per finger: 3, or 4 with torsion
    count: int  # number of modes
    shifts: int  # number of translations, which are the first modes
    reach: Floats = floats("6")  # beta_k q_k'W^1/2 D
    modes: Table = table("6", "1 + width * fingers")


class Sum(Record):
    """Sum, and its accumulated rounding error."""

    value: float
    carry: float


class Account(Record):
    """Energy that one kind of motion has received, dissipated by friction, and stored in springs [J]."""

    work: Sum  # energy received so far
    spent: float  # lower bound of the energy dissipated by friction
    stored: float  # energy now in the springs, written by the caller
    opened: float  # energy in the springs when the ledger was opened


class Accounts(Record):
    """Accounts of internal motion, translation and rotation, and the work on all of them."""

    parts: Many[Account] = many("3")
    whole: Sum


@kernel
def reach(split: ModeSplit, contacts: Many[Contact], steps: Many[Vector4]) -> None:
    """Compute beta_k q_k'W^1/2 D of steps D for each mode k and store it in `split.reach`."""
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
    """Compute D'W Q D of steps D for internal motion, translation and rotation [m^2]; the values are not negative.

    Q is the sum of Q_k over the modes of the kind of motion, and the rest I - sum_k Q_k for internal motion. A spring
    with the gain k and the displacement D stores k/2 times these values. Friction with the coefficient b w_i at each
    finger dissipates at least b/T times these values on the step D.
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
    """Add the energy that friction dissipates on a step to the accounts.

    Args:
        accounts: Accounts of energy.
        drag: Coefficient of friction divided by the duration of the step [N/m].
        square: Result of `squares` for the step [m^2].
    """
    accounts.parts[INTERNAL].spent += drag * square.x
    accounts.parts[TRANSLATION].spent += drag * square.y
    accounts.parts[ROTATION].spent += drag * square.z


@kernel
def book(account: Sum, energy: float) -> None:
    """Add an energy to a sum, and the rounding error of this addition to the accumulated error (Neumaier 1974)."""
    old = account.value
    new = old + energy
    if abs(old) >= abs(energy):
        account.carry += (old - new) + energy
    else:
        account.carry += (energy - new) + old
    account.value = new


@kernel
def balance(account: Account) -> float:
    """Compute the dissipated energy: work plus friction losses minus the increase of the energy in springs [J].

    A negative result is generated energy.
    """
    work = account.work.value + account.work.carry
    gained = account.stored - account.opened
    return work + account.spent - gained


@kernel
def add_damping(
    accounts: Accounts, split: ModeSplit, contacts: Many[Contact], forces: Many[Vector4], steps: Many[Vector4],
    T: float, most: float,
) -> Vector:  # fmt: skip
    """Add a damping force a W Q D/T to the forces for each kind of motion that has generated energy.

    Q is the matrix of the kind of motion (`squares`) and D the last step. The coefficient a = min(most, T E/(D'W Q D))
    [N s/m] dissipates the generated energy E if the next step equals D and a < `most` (Hannaford and Ryu 2002, with one
    controller for each kind of motion). Energy that is not dissipated remains in the account for the next sample.

    Args:
        accounts: Energy of each kind of motion.
        split: Rigid modes.
        contacts: Contacts of the fingers.
        forces: Forces to which damping is added [N].
        steps: Last steps D of the fingers [m].
        T: Sampling period [s].
        most: Largest coefficient [N s/m], required because the damping force is held over a sample (`brake.bound`).

    Returns:
        Coefficients a for internal motion, translation and rotation [N s/m].
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
    """Return the damping coefficient that dissipates an energy on a step, at most `most` [N s/m].

    Args:
        debt: Energy to be dissipated [J].
        square: D'W Q D of the step [m^2].
        T: Sampling period [s].
        most: Largest coefficient [N s/m].
    """
    if debt <= 0.0 or square <= 0.0:
        return 0.0
    if debt * T >= most * square:
        return most
    return debt * T / square
