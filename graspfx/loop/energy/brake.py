"""A sample of the energy observer, and its passivity controller: minimal damping in the mode that generates energy."""

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
    """Add to this sample's forces the damping that repays each mode's debt if the next step equals the last one.

    The damping is a W Q_j d/T (`leak.add_damping`) with a at most m/(2 T), where m is the smallest mass that a step of
    any mode moves. Held for a sample, a = m/(2 T) removes half of a step's speed, and twice as much removes all of it.
    Each finger's force is then projected back into its cone and within the limits. Return whether any force may have
    changed.
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
    """Compute m/(2 T) [N s/m]; 1/m = max w_i/m_i + sum w_i/m_v + sum w_i |r_i|^2/I bounds every mode's mobility.

    m_i is the mass of finger i's device, and m_v and I are the object's mass and smallest moment of inertia; the terms
    of an object without free translations or rotations are zero. r_i points from the object's centre to finger i.
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
    """Add a finger's brake force to its force within the cone, and store the added part as the brake force."""
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
    """Book the previous sample, apply the passivity controller, store the next sample's forces, and report; return 0.

    The ledger must already contain the obstacles' wrench on the body in that sample (`Observer.met`).
    """
    book_sample(grasp, ledger, T)
    store_sample(grasp, ledger)
    return 0


@kernel
def book_sample(grasp: GraspState, ledger: LedgerState, T: float) -> None:
    """Book the previous sample and apply the passivity controller if enabled: the first half of `watch`."""
    observe(grasp, ledger, T)
    if ledger.control:
        control(grasp, ledger, T)


@kernel
def store_sample(grasp: GraspState, ledger: LedgerState) -> None:
    """Store the displayed forces for the next sample and report: the second half of `watch`."""
    hold(grasp, ledger)
    report(grasp, ledger)
