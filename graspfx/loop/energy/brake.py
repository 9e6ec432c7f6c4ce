"""Sample of the energy observer, and passivity controller, which damps the kinds of motion that generate energy."""

from __future__ import annotations

import math

from graspfx.compile.kernel import kernel
from graspfx.coupling.grasp_state import FingerState, GraspState
from graspfx.coupling.law import react
from graspfx.coupling.limit import limit_again
from graspfx.loop.energy.books import FingerBooks, LedgerState
from graspfx.loop.energy.leak import add_damping, balance
from graspfx.loop.energy.ledger import hold, observe, report
from graspfx.spatial import NOTHING, ZERO, dot, with_torsion

ROUNDING = 1e-12  # fraction of the largest energy so far below which a debt counts as zero


@kernel
def control(grasp: GraspState, ledger: LedgerState, T: float) -> bool:
    """Add damping to this sample's forces, so that generated energy is dissipated if the next step equals the last.

    The damping force is a W Q d/T for the step d of the fingers (`leak.add_damping`). The coefficient a is at most
    m/(2 T), where m is the smallest mass that a step of any kind of motion moves: a damping force with a = m/(2 T),
    held for a sample, halves the speed, and a force with a = m/T stops the motion. The force of each finger is then
    projected into the cone and within the limits of the finger. The result is whether any force may have changed.
    """
    ledger.report.damping = ZERO
    least = ROUNDING * ledger.scale
    owes = False
    for account in ledger.accounts.parts:
        owes = owes or balance(account) < -least
    if not owes or not ledger.started:
        return False
    fingers = ledger.fingers
    brakes, steps = fingers.part(FingerBooks.brake), fingers.part(FingerBooks.step)
    most = bound(grasp, T, ledger.mobility)
    ledger.report.damping = add_damping(ledger.accounts, ledger.split, fingers, brakes, steps, T, most)
    for i, finger in enumerate(fingers):
        push(grasp, grasp.fingers[i], finger)
    if grasp.limited:
        limit_again(grasp)
    react(grasp)
    return True


@kernel
def bound(grasp: GraspState, T: float, mobility: float) -> float:
    """Compute the largest damping coefficient m/(2 T) [N s/m] of the passivity controller.

    1/m = max w_i/m_i + sum w_i/m_v + sum w_i |r_i|^2/I is an upper bound of the mobility of every kind of motion. For
    finger i, w_i is the weight, m_i the mass of the device, and r_i the vector from the object's centre to the finger.
    m_v is the mass and I the smallest moment of inertia of the object; if the object cannot translate or rotate, the
    corresponding term is zero.

    Args:
        grasp: State of the grasp.
        T: Sampling period [s].
        mobility: max w_i/m_i [1/kg].
    """
    body = grasp.body
    total = squares = 0.0
    for finger in grasp.fingers:
        w = finger.weight
        total += w
        for a in range(3):
            arm = finger.position[a] - body.motion.position[a]
            squares += w * arm * arm
    if grasp.freedom.shifts > 0:
        mobility += total / body.mass
    if grasp.freedom.turns > 0:
        J = body.inertia
        mobility += squares / (J.z if grasp.dimensions == 2 else min(J.x, J.y, J.z))
    return 0.5 / (T * mobility) if mobility > 0.0 else 0.0


@kernel
def push(grasp: GraspState, finger: FingerState, books: FingerBooks) -> None:
    """Add the brake force of a finger to the force of the finger, within the friction cone.

    The brake force is then replaced by the change of the finger's force.
    """
    if grasp.attached:
        finger.local = finger.local + books.brake
        return
    if not finger.touching:
        books.brake = NOTHING
        return
    n, force, brake = finger.normal, finger.local, books.brake
    added, pushed = dot(n, brake.vector), dot(n, force.vector)
    normal = max(pushed + added, 0.0)
    tangent, t = force.vector - pushed * n, force.t
    if grasp.stick or finger.coefficient > 0.0:
        tangent += brake.vector - added * n
        t += brake.t
        limit = finger.coefficient * normal
        size = math.sqrt(dot(tangent, tangent) + t * t)
        scale = 1.0
        if normal == 0.0:
            scale = 0.0
        elif not grasp.stick and size > limit:
            scale = limit / size
        tangent, t = scale * tangent, scale * t
    new = with_torsion(tangent + normal * n, t)
    books.brake = new - force
    finger.local = new


# The observer's work in a sample --------------------------------------------------------------------------------------


@kernel
def watch(grasp: GraspState, ledger: LedgerState, T: float) -> int:
    """Add the previous sample to the ledger, apply the passivity controller, and store forces and energies; return 0.

    The ledger must already contain the wrench of obstacles on the body in the previous sample (`Observer.met`).
    """
    book_sample(grasp, ledger, T)
    store_sample(grasp, ledger)
    return 0


@kernel
def book_sample(grasp: GraspState, ledger: LedgerState, T: float) -> None:
    """Add the previous sample to the ledger and apply the passivity controller if it is enabled."""
    observe(grasp, ledger, T)
    if ledger.control:
        control(grasp, ledger, T)


@kernel
def store_sample(grasp: GraspState, ledger: LedgerState) -> None:
    """Store the displayed forces, which the next sample needs, and write the energies for the recording."""
    hold(grasp, ledger)
    report(grasp, ledger)
