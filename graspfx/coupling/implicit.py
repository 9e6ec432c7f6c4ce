"""Sample with the implicit integrator: one linear system for the contact forces and the object's displacement."""

from __future__ import annotations

from graspfx.compile.kernel import inline, kernel
from graspfx.cones.complement import pivot, release
from graspfx.coupling.contact_frames import add_gains, in_frame, write_coordinates
from graspfx.coupling.depth import soften
from graspfx.coupling.grasp_state import FingerState, GraspState
from graspfx.coupling.recoil import inertia, lever


@kernel
def assemble_implicitly(grasp: GraspState, elastic: bool, damping: bool, condensed: bool) -> None:
    """Assemble the law at the end of the sample in contact frames, and eliminate the object's displacement u.

    The forces are f = f_K + f_D with f_K = K (e - G'u) and f_D = D (e' - H'u / T), and they displace the object by
    u = C (G f_K + H f_D), where C is the object's compliance. G contains the lever arms of the contacts, and H the
    lever arms of the points at which rates are computed. If `condensed` is true, K and D are those of the touching
    fingers only, so the position of a free finger has no effect. In this case, if some finger has a coefficient of
    friction, e is the displacement after slip.
    """
    m, size = grasp.count * grasp.coordinates, grasp.unknowns
    for p in range(size):
        for q in range(size):
            grasp.square[p, q] = 0.0
        grasp.vector[p] = 0.0
    if elastic:
        add_part(grasp, True, condensed)
    if damping:
        add_part(grasp, False, condensed)
    add_inertia(grasp)
    for p in range(m, size):
        pivot(grasp.square, grasp.vector, p)
    for p in range(m):
        grasp.diagonal[p] = grasp.square[p, p]


@kernel
def add_part(grasp: GraspState, elastic: bool, condensed: bool) -> None:
    """Add the springs (B = K, x = e) if `elastic` is true, else the dampers (B = D / T, x = T e').

    The blocks of the system are B, -B G', G B and -G B G', and the vectors are B x and G B x, where G contains lever
    arms.
    """
    m, free = grasp.count * grasp.coordinates, grasp.unknowns - grasp.count * grasp.coordinates
    A, q, B, x, G = grasp.square, grasp.vector, grasp.part, grasp.start, grasp.levers
    fill_part(grasp, elastic, condensed)
    for i, finger in enumerate(grasp.fingers):
        e = finger.retained if condensed and grasp.friction else finger.displacement
        write_coordinates(grasp, x, i, in_frame(grasp, finger, e if elastic else finger.rate))
    unit = 1.0 if elastic else grasp.period
    at_tip = not elastic and not grasp.at_contact
    for p in range(m):
        total = 0.0
        for k in range(m):
            total += B[p, k] * x[k]
            A[p, k] += B[p, k]
        q[p] += unit * total
    for u in range(free):
        for i, finger in enumerate(grasp.fingers):
            for a in range(grasp.coordinates):
                G[u, i * grasp.coordinates + a] = lever(grasp, finger, u, a, at_tip)
    for u in range(free):
        for p in range(m):
            along = across = 0.0
            for k in range(m):
                along += B[p, k] * G[u, k]
                across += G[u, k] * B[k, p]
            A[p, m + u] -= along
            A[m + u, p] += across
            q[m + u] += unit * across * x[p]
            for v in range(free):
                A[m + u, m + v] -= across * G[v, p]


@kernel
def fill_part(grasp: GraspState, elastic: bool, condensed: bool) -> None:
    """Compute K if `elastic` is true, else D / T, in contact frames.

    If `condensed` is true, the coordinates without force are released, and their entries are zero.
    """
    m = grasp.count * grasp.coordinates
    B = grasp.part
    per = 1.0 / grasp.period
    for p in range(m):
        for q in range(m):
            B[p, q] = 0.0
    if elastic:
        add_gains(grasp, B, grasp.external_stiffness, grasp.internal_stiffness, 1.0, 0.0)
    else:
        add_gains(grasp, B, per * grasp.external_damping, per * grasp.internal_damping, 0.0, per)
    if condensed:
        condense(grasp, elastic, per)


@kernel
def condense(grasp: GraspState, elastic: bool, per: float) -> None:
    """Release the coordinates without force from K or D / T, and set their entries to zero."""
    n, c = grasp.count, grasp.coordinates
    m, B = n * c, grasp.part
    if not elastic and grasp.gradual:
        for i, finger in enumerate(grasp.fingers):
            write_coordinates(grasp, grasp.start, i, in_frame(grasp, finger, finger.local))
        soften(grasp, B, None, per)
    for i, finger in enumerate(grasp.fingers):
        for a in range(c):
            p = i * c + a
            grasp.diagonal[p] = B[p, p]
            grasp.marks[p] = 0.0 if carries(grasp, finger, a) else 1.0
    release(B, grasp.rest, m, grasp.marks, grasp.diagonal)
    for i, finger in enumerate(grasp.fingers):
        for j, other in enumerate(grasp.fingers):
            for a in range(c):
                for b in range(c):
                    if not (carries(grasp, finger, a) and carries(grasp, other, b)):
                        B[i * c + a, j * c + b] = 0.0


@inline
def carries(grasp: GraspState, finger: FingerState, a: int) -> bool:
    """Return whether coordinate a of a finger carries force.

    This is true for the normal of a touching finger and, if the finger sticks or has friction, for its other
    coordinates.
    """
    return finger.touching and (a == 0 or grasp.stick or grasp.friction)


@kernel
def add_inertia(grasp: GraspState) -> None:
    """Subtract the inverse C^-1 = (M + T B) / T^2 of the object's compliance, with mass M and viscosity B."""
    m, free = grasp.count * grasp.coordinates, grasp.unknowns - grasp.count * grasp.coordinates
    for u in range(free):
        for v in range(free):
            grasp.square[m + u, m + v] -= inertia(grasp, u, v)
