"""Ledger of a grasp's energy: work of the fingers, energy of the coupling by cause, and work on the object.

Between two samples, the forces f = fe + fd + fb of springs, damping and brake are held while the fingers move by d
relative to the object, in the object's axes. h is the displacement of the springs, fe = K h. The index j denotes the
component for internal motion, translation or rotation, and a_j is this component of fe. A plus denotes a value of the
next sample. fw is the negative of the force that a safety chain removes after the brake. The energies are

    stored      V_j = 1/2 a_j'h
    damped      fd_j'd - fw_j'd
    braked      fb_j'd
    slipped     a_j'(d - h+ + h)           dissipated by contacts that slide, slip, separate or exceed a limit
    reshaped    1/2 (a_j'h+ - a_j+'h)      due to changes of the split or of weights, or a skew-symmetric part of K
    leaked      1/2 (a_j+ - a_j)'(h+ - h) - fw_j'd

With constant gains, the first term of `leaked` is 1/2 (h+ - h)'K (h+ - h), which the held force generates.
These energies satisfy f_j'd = V_j+ - V_j + damped + braked + slipped + reshaped - leaked for any law. The work of the
fingers is f'd plus the work of the wrench on the object (`graspfx.objects.energy`). All terms are summed independently;
a difference between the work of the fingers and the other terms is therefore a rounding error or an error of the
ledger.

A compliant fingertip with the stiffness k adds its depth (fe_n/k)^(2/3) along the normal to h. It stores 2/5, not 1/2,
of its force times its depth. The difference, a tenth of this product, is subtracted from V_j. The change of this
difference, of third order in a step, is part of `reshaped`.
"""

from __future__ import annotations

import math

from graspfx import elementary
from graspfx.compile.kernel import kernel
from graspfx.compile.records import Many
from graspfx.cones.factors import eliminate
from graspfx.coupling.grasp_state import GraspState
from graspfx.grasp.rigid_modes import Contact, rigid_modes
from graspfx.loop.energy.books import FingerBooks, ForceByMode, LedgerState
from graspfx.loop.energy.leak import ROTATION, TRANSLATION, ModeSplit, Sum, balance, book, spend, squares
from graspfx.objects.energy import keep, kinetic, settle
from graspfx.spatial import NOTHING, ZERO, Vector4, cross, dot, inner, with_torsion


@kernel
def observe(grasp: GraspState, ledger: LedgerState, T: float) -> None:
    """Add the previous sample to the ledger, and compute the energy in the springs from this sample's forces."""
    started = ledger.started
    if started:
        move(grasp, ledger, T)
    load(grasp, ledger)
    if started:
        book_springs(ledger)
        if grasp.padded:
            book_pads(ledger)
    for j in range(3):
        total = 0.0
        for finger in ledger.fingers:
            for a in range(4):
                total += finger.elastic.parts[j].force[a] * finger.stretch[a]
        account = ledger.accounts.parts[j]
        if grasp.padded:
            total -= 2.0 * ledger.curved[j]
        account.stored = 0.5 * total
        if not started:
            account.opened = 0.5 * total
    if not started:
        ledger.first_energy = kinetic(grasp.body)
    for finger in ledger.fingers:
        finger.brake = NOTHING


@kernel
def move(grasp: GraspState, ledger: LedgerState, T: float) -> None:
    """Compute the steps of the fingers in the previous sample, and add all work on them except that of the coupling."""
    start, accounts = ledger.start, ledger.accounts
    sample = settle(grasp.body, start, T)
    met = sample.met
    if ledger.foreign:
        gained = kinetic(grasp.body) - start.energy
        met = gained - sample.work - sample.fallen + sample.loss + sample.turning_loss
        met = met - sample.defect - sample.turning_defect
    book(ledger.wrench_work, sample.work)
    book(ledger.gravity_work, sample.fallen)
    book(ledger.contact_work, met)
    book(ledger.viscous_loss, sample.loss + sample.turning_loss)
    book(ledger.defect, sample.defect + sample.turning_defect)
    turn, to_object = start.turn, ledger.frame.transpose
    for i, finger in enumerate(ledger.fingers):
        step = grasp.fingers[i].position - finger.place
        book(ledger.finger_work, inner(finger.push, step))
        against = step - start.shift - cross(turn, finger.arm)
        finger.step = with_torsion(to_object @ against, -dot(finger.twist, turn))
        finger.tip = with_torsion(to_object @ step, 0.0)
    if ledger.drag > 0.0:
        tips = ledger.fingers.part(FingerBooks.tip)
        spend(accounts, ledger.drag / (T * ledger.elapsed), squares(ledger.split, ledger.fingers, tips))
    accounts.parts[TRANSLATION].spent += sample.loss - sample.defect
    accounts.parts[ROTATION].spent += sample.turning_loss - sample.turning_defect


@kernel
def load(grasp: GraspState, ledger: LedgerState) -> None:
    """Compute the rigid modes of this sample, the elastic forces by kind of motion, and the displacements h."""
    split = ledger.split
    for i, finger in enumerate(ledger.fingers):
        now = grasp.fingers[i]
        finger.contact, finger.normal, finger.patch, finger.weight = now.contact, now.normal, now.patch, now.weight
        finger.force = now.elastic
    if grasp.equal:  # the law needs no modes
        low, high = grasp.arm_low, grasp.arm_high
        split.count, _ = rigid_modes(
            ledger.fingers, grasp.freedom, grasp.dimensions, low, high, split.width, False, split.modes
        )
    else:
        split.count = grasp.mode_count
        for k in range(grasp.mode_count):
            for c in range(split.modes.columns):
                split.modes[k, c] = grasp.modes[k, c]
    forces = ledger.fingers.part(FingerBooks.force)
    split_force(split, ledger.fingers, forces, ledger.fingers.part(FingerBooks.elastic))
    kep, kip = grasp.external_stiffness, grasp.internal_stiffness
    open_ended = ledger.guarded and not ledger.gain > 0.0  # gamma K is zero and has no inverse
    if not open_ended:
        if ledger.components > 0:
            if stretch_by_matrix(grasp, ledger):
                soften_stretch(ledger)
                if grasp.padded:
                    add_pads(grasp, ledger, True)
                return
        elif kep > 0.0 and kip > 0.0:
            stretch(split, ledger.fingers, kep, kip)
            soften_stretch(ledger)
            if grasp.padded:
                add_pads(grasp, ledger, True)
            return
    for i, finger in enumerate(ledger.fingers):  # without cones, or if K is singular and does not determine h
        finger.stretch = grasp.fingers[i].displacement
    if grasp.padded:
        add_pads(grasp, ledger, False)


@kernel
def soften_stretch(ledger: LedgerState) -> None:
    """If a safety chain scales the stiffness by gamma, replace K^-1 fe by h = (gamma K)^-1 fe."""
    if ledger.guarded and ledger.gain != 1.0:
        for finger in ledger.fingers:
            finger.stretch = (1.0 / ledger.gain) * finger.stretch


@kernel
def add_pads(grasp: GraspState, ledger: LedgerState, adds: bool) -> None:
    """Compute a tenth of the forces of pads times their depths (fe_n/k)^(2/3); if `adds`, also add the depths to h."""
    ledger.curved = ZERO
    for i, finger in enumerate(ledger.fingers):
        k, push = grasp.fingers[i].pad, dot(finger.normal, finger.force.vector)
        if ledger.guarded:
            k *= ledger.gain
        if k > 0.0 and push > 0.0:
            root = elementary.cube_root(push / k)
            depth = root * root
            for j in range(3):
                ledger.curved[j] += 0.1 * depth * dot(finger.elastic.parts[j].force.vector, finger.normal)
            if adds:
                finger.stretch = with_torsion(finger.stretch.vector + depth * finger.normal, finger.stretch.t)


@kernel
def book_pads(ledger: LedgerState) -> None:
    """Add to `reshaped` the change of the difference between 1/2 force x depth of pads and the energy in the pads."""
    for j in range(3):
        book(ledger.losses[j].reshaped, ledger.curved[j] - ledger.held_curved[j])


@kernel
def split_force(split: ModeSplit, contacts: Many[Contact], forces: Many[Vector4], out: Many[ForceByMode]) -> None:
    """Split forces f into the components Q_j'f for internal motion, translation and rotation."""
    width, modes = split.width, split.modes
    for i, by_mode in enumerate(out):
        by_mode.parts[0].force = forces[i]
        by_mode.parts[1].force = by_mode.parts[2].force = NOTHING
    for k in range(split.count):
        z = modes[k, 0] * along(split, contacts, forces, k)
        for i, contact in enumerate(contacts):
            w = math.sqrt(contact.weight)
            rest, part = out[i].parts[0], out[i].parts[1 if k < split.shifts else 2]
            for a in range(width):
                share = w * modes[k, 1 + width * i + a] * z
                part.force[a] += share
                rest.force[a] -= share


@kernel
def along(split: ModeSplit, contacts: Many[Contact], forces: Many[Vector4], k: int) -> float:
    """Compute q_k'W^-1/2 f of forces f for the rigid mode k, without fingers of zero weight."""
    width = split.width
    total = 0.0
    for i, contact in enumerate(contacts):
        if contact.weight > 0.0:
            w = 1.0 / math.sqrt(contact.weight)
            for a in range(width):
                total += w * split.modes[k, 1 + width * i + a] * forces[i][a]
    return total


@kernel
def stretch(split: ModeSplit, fingers: Many[FingerBooks], kep: float, kip: float) -> None:
    """Compute h = K^-1 fe of eq. (4) with scalar gains; h is zero for fingers of zero weight."""
    width, modes = split.width, split.modes
    for finger in fingers:
        for a in range(4):
            finger.stretch[a] = finger.force[a] / (kip * finger.weight) if finger.weight > 0.0 else 0.0
    for k in range(split.count):
        z = (1.0 / (kip + (kep - kip) * modes[k, 0]) - 1.0 / kip) * along(
            split, fingers, fingers.part(FingerBooks.force), k
        )
        for i, finger in enumerate(fingers):
            if finger.weight > 0.0:
                for a in range(width):
                    finger.stretch[a] += z * modes[k, 1 + width * i + a] / math.sqrt(finger.weight)


@kernel
def stretch_by_matrix(grasp: GraspState, ledger: LedgerState) -> bool:
    """Compute h = K^-1 fe with the stiffness matrix K of the grasp; if K is singular, return False and keep h."""
    c, m = grasp.coordinates, ledger.components
    square, vector = ledger.square, ledger.vector
    for p in range(m):
        for q in range(m):
            square[p, q] = grasp.stiffness[p, q]
    for i, finger in enumerate(ledger.fingers):
        for a in range(c):
            vector[i * c + a] = finger.force[a]
    if not eliminate(square, vector, m):
        return False
    for i, finger in enumerate(ledger.fingers):
        for a in range(c):
            finger.stretch[a] = vector[i * c + a]
    return True


@kernel
def book_springs(ledger: LedgerState) -> None:
    """Add the energies of the coupling in the previous sample to the ledger, by kind of motion."""
    total = 0.0
    for j in range(3):
        work = damped = braked = slipped = reshaped = leaked = 0.0
        for finger in ledger.fingers:
            for a in range(4):
                d, h, now = finger.step[a], finger.held_stretch[a], finger.stretch[a]
                f, fe = finger.held_force.parts[j].force[a], finger.held_elastic.parts[j].force[a]
                fb, new = finger.held_brake.parts[j].force[a], finger.elastic.parts[j].force[a]
                work += f * d
                if ledger.guarded:
                    fw = finger.held_withheld.parts[j].force[a]
                    damped -= fw * d
                    leaked -= fw * d
                damped += (f - fe - fb) * d
                braked += fb * d
                slipped += fe * (d - (now - h))
                reshaped += 0.5 * (fe * now - new * h)
                leaked += 0.5 * (new - fe) * (now - h)
        losses = ledger.losses[j]
        book(ledger.accounts.parts[j].work, work)
        book(losses.damped, damped)
        book(losses.braked, braked)
        book(losses.slipped, slipped)
        book(losses.reshaped, reshaped)
        book(losses.leaked, leaked)
        total += work
    book(ledger.accounts.whole, total)


@kernel
def hold(grasp: GraspState, ledger: LedgerState) -> None:
    """Store, for the next sample, the forces by kind of motion, their points of application and the object's state."""
    motion, split = grasp.motion, ledger.split
    x, R = motion.position, motion.rotation
    braked = False
    same = True
    ledger.frame = R
    for i, finger in enumerate(ledger.fingers):
        now = grasp.fingers[i]
        finger.held_stretch = finger.stretch
        for a in range(4):
            braked = braked or finger.brake[a] != 0.0
            same = same and now.local[a] == now.elastic[a]
        finger.force = now.local
        for j in range(3):
            elastic = finger.elastic.parts[j].force
            finger.held_elastic.parts[j].force = elastic
            finger.held_force.parts[j].force = elastic
            finger.held_brake.parts[j].force = NOTHING
            if ledger.guarded:
                finger.held_withheld.parts[j].force = NOTHING
        where = now.contact_world if grasp.at_contact else now.position
        finger.place, finger.push, finger.arm = now.position, now.force, where - x
        finger.twist = now.patch * (R @ now.twist_axis)
    fingers = ledger.fingers
    if not same:
        split_force(split, fingers, fingers.part(FingerBooks.force), fingers.part(FingerBooks.held_force))
    if braked:
        split_force(split, fingers, fingers.part(FingerBooks.brake), fingers.part(FingerBooks.held_brake))
    if ledger.guarded:
        split_force(split, fingers, fingers.part(FingerBooks.withheld), fingers.part(FingerBooks.held_withheld))
    if grasp.padded:
        ledger.held_curved = ledger.curved
    keep(grasp.body, ledger.start)
    ledger.started = True


@kernel
def total_of(account: Sum) -> float:
    """Return a sum corrected by its accumulated rounding error."""
    return account.value + account.carry


@kernel
def report(grasp: GraspState, ledger: LedgerState) -> None:
    """Write all energies for the recording; the damping is written by the passivity controller."""
    out = ledger.report
    moving = kinetic(grasp.body)
    fingers = total_of(ledger.finger_work)
    gap = fingers - (moving - ledger.first_energy) + total_of(ledger.gravity_work) + total_of(ledger.contact_work)
    gap += total_of(ledger.defect) - total_of(ledger.viscous_loss)
    for j in range(3):
        account, losses = ledger.accounts.parts[j], ledger.losses[j]
        stored = account.stored
        damped, braked, slipped = total_of(losses.damped), total_of(losses.braked), total_of(losses.slipped)
        reshaped, leaked = total_of(losses.reshaped), total_of(losses.leaked)
        gap += leaked - (stored - account.opened) - damped - braked - slipped - reshaped
        out.work[j] = total_of(account.work)
        out.stored[j] = stored
        out.damped[j] = damped
        out.slipped[j] = slipped
        out.reshaped[j] = reshaped
        out.leaked[j] = leaked
        out.balance[j] = balance(account)
        out.braked[j] = braked
        ledger.scale = max(ledger.scale, abs(out.work[j]), stored, leaked)
    out.fingers, out.kinetic, out.gap = fingers, moving, gap
    out.wrench = total_of(ledger.wrench_work)
    out.gravity = total_of(ledger.gravity_work)
    out.contact = total_of(ledger.contact_work)
    out.viscous = total_of(ledger.viscous_loss)
    out.defect = total_of(ledger.defect)
    ledger.scale = max(ledger.scale, abs(fingers), moving, abs(out.gravity), out.viscous)
