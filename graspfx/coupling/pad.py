"""Compliant fingertips (pads): normal force f_n = k delta^1.5 at the depth delta, in series with the coupling.

The depth of a pad reduces the displacement in eq. (4) from e to e - delta n. The elastic force is then

    f = argmin over the cones of 1/2 f'K^-1 f + sum_i (3/5) k_i^(-2/3) f_n,i^(5/3) - e'f,

which has a nonlinear compliance in addition to K^-1 (Hertz 1882; Johnson, Contact Mechanics, 1985, 4.22). The depths
solve k_i delta_i^1.5 - f_n,i(e - delta n) = 0. The left side is the gradient of a convex function, because 0 <= d f_n/d
e_n <= K_nn, where K_nn is the part of K for the normals. Each pass of the iteration computes the elastic force at the
present depths, with the solver of the contact rule. It then computes the next depths from the pads' power law and the
linear model f_n + B (change of e_n - delta). The matrix B estimates the slopes d f_n/d e_n. B is updated by secants
(Broyden 1965) and kept in the block for the next sample. If a step does not reduce the residual enough, B is set to
K_nn, which bounds every slope. The next step, called proximal, then always decreases the convex function.
"""

from __future__ import annotations

import math

from graspfx.compile.kernel import kernel
from graspfx.cones.cone import shorten
from graspfx.cones.factors import eliminate
from graspfx.coupling.contact_frames import assemble
from graspfx.coupling.contacts import UNRESOLVED
from graspfx.coupling.coulomb import elastic_in_cones
from graspfx.coupling.frictionless import elastic_without_friction
from graspfx.coupling.grasp_state import GraspState
from graspfx.coupling.law import normal_force
from graspfx.coupling.unilateral import project, separate
from graspfx.spatial import inner, with_torsion

PASSES = 100  # largest number of passes per sample
EXACT = 1e-13  # tolerance of f_n - k delta^1.5, relative to the largest force
ROUNDING = 1e-15  # error of the law's force, relative to stiffness times the largest displacement
SHRINKS = 0.7  # bound of a residual over the last accepted one; for a larger residual the next step is proximal
INNER = 30  # Newton steps for the model, which need no evaluation of the force
STILL = 1e-16  # relative step length at convergence


@kernel
def press(grasp: GraspState) -> int:
    """Find the pads' depths and subtract them from the displacements; return 0 or a fault of the forces."""
    for i, finger in enumerate(grasp.fingers):
        grasp.pads[i].whole = finger.displacement
    if not same_touch(grasp):
        fill_slope(grasp)
    predict(grasp, False)
    left = math.inf
    proximal = False
    for k in range(PASSES):
        take_depths(grasp)
        fault = elastic(grasp)
        if fault != 0:
            return fault
        miss, allowed = measure(grasp)
        if k > 0:
            learn(grasp)
        store_pass(grasp)
        if miss <= allowed:
            accept(grasp)
            grasp.pad_passes = k + 1
            return 0
        if proximal or miss < SHRINKS * left:
            accept(grasp)
            left = miss
            proximal = False
        else:
            fill_slope(grasp)
            proximal = True
        predict(grasp, proximal)
    grasp.pad_passes = PASSES
    return UNRESOLVED


@kernel
def relax(grasp: GraspState) -> None:
    """Restore the displacements of fingers with pressed pads; those of released fingers may have been recomputed."""
    for i, finger in enumerate(grasp.fingers):
        if grasp.pads[i].depth > 0.0:
            finger.displacement = grasp.pads[i].whole


@kernel
def elastic(grasp: GraspState) -> int:
    """Compute the elastic force of the law with the solver of the contact rule; return 0 or a fault."""
    if grasp.friction:
        return elastic_in_cones(grasp)
    if grasp.rays:
        return elastic_without_friction(grasp)
    if grasp.alone:
        separate(grasp)
        if grasp.limited:
            for finger in grasp.fingers:
                finger.local, _ = shorten(finger.local, 3, finger.cut)
        return 0
    return project(grasp)


@kernel
def take_depths(grasp: GraspState) -> None:
    """Subtract the pads' depths from the displacements, along the normals."""
    for i, finger in enumerate(grasp.fingers):
        pad = grasp.pads[i]
        finger.displacement = with_torsion(pad.whole.vector - pad.depth * finger.normal, pad.whole.t)


@kernel
def measure(grasp: GraspState) -> tuple[float, float]:
    """Compute max |f_n - k delta^1.5| and its tolerance; store f_n and e_n - delta of this pass."""
    miss = force = 0.0
    longest = stiffest = 0.0
    for i, finger in enumerate(grasp.fingers):
        pad = grasp.pads[i]
        pad.push = max(normal_force(finger), 0.0)
        pad.stretch = inner(finger.normal, finger.displacement.vector)
        if finger.pad > 0.0:
            miss = max(miss, abs(pad.push - finger.pad * pad.depth * math.sqrt(pad.depth)))
        stiffest = max(stiffest, pad.bound)
        for a in range(4):
            force = max(force, abs(finger.local[a]))
            longest = max(longest, abs(pad.whole[a]))
    return miss, max(EXACT * force, ROUNDING * stiffest * longest)


@kernel
def store_pass(grasp: GraspState) -> None:
    """Store f_n and e_n - delta of this pass as the values of the previous pass."""
    for i in range(grasp.count):
        pad = grasp.pads[i]
        pad.before_push = pad.push
        pad.before_stretch = pad.stretch


@kernel
def accept(grasp: GraspState) -> None:
    """Store this pass as the starting point of the next step or the next sample."""
    for i in range(grasp.count):
        pad = grasp.pads[i]
        pad.from_push = pad.push
        pad.from_stretch = pad.stretch
        pad.from_depth = pad.depth


@kernel
def learn(grasp: GraspState) -> None:
    """Update B by Broyden's method, so that it maps the last change of e_n - delta to the last change of f_n.

    Rows of fingers without force are unchanged.
    """
    square = 0.0
    for i in range(grasp.count):
        s = grasp.pads[i].stretch - grasp.pads[i].before_stretch
        square += s * s
    if not square > 0.0:
        return
    for i in range(grasp.count):
        pad = grasp.pads[i]
        if pad.push > 0.0 or pad.before_push > 0.0:
            off = pad.push - pad.before_push
            for j in range(grasp.count):
                off -= grasp.pad_slope[i, j] * (grasp.pads[j].stretch - grasp.pads[j].before_stretch)
            off /= square
            for j in range(grasp.count):
                grasp.pad_slope[i, j] += off * (grasp.pads[j].stretch - grasp.pads[j].before_stretch)


@kernel
def same_touch(grasp: GraspState) -> bool:
    """Return whether the pushing fingers are those for which B was filled, and store which fingers push now."""
    same = grasp.pads_known
    grasp.pads_known = True
    for i in range(grasp.count):
        pad = grasp.pads[i]
        pushes = pad.from_push > 0.0
        same = same and pushes == pad.pushes
        pad.pushes = pushes
    return same


@kernel
def fill_slope(grasp: GraspState) -> None:
    """Set B to the part of K for the normals, and compute the absolute sum of each row."""
    assemble(grasp, True)
    c = grasp.coordinates
    for i in range(grasp.count):
        total = 0.0
        for j in range(grasp.count):
            entry = 0.5 * (grasp.square[i * c, j * c] + grasp.square[j * c, i * c])
            total += abs(entry)
            grasp.pad_slope[i, j] = entry
        grasp.pads[i].bound = total


@kernel
def predict(grasp: GraspState, proximal: bool) -> None:
    """Solve k delta^1.5 = f_n + B (change of e_n - delta) for the depths of pressed pads by Newton's method.

    The depth of a finger without force is zero. In a proximal step, the depth of such a finger may instead remain
    positive, but not increase.
    """
    n = grasp.count
    for i, finger in enumerate(grasp.fingers):
        pad = grasp.pads[i]
        pad.depth = pad.from_depth
        pad.presses = finger.pad > 0.0 and (pad.from_push > 0.0 or (proximal and pad.depth > 0.0))
        if not pad.presses:
            pad.depth = 0.0
    for _ in range(INNER):
        for i, finger in enumerate(grasp.fingers):
            pad = grasp.pads[i]
            left = pad.from_push - finger.pad * pad.depth * math.sqrt(pad.depth)
            for j, other in enumerate(grasp.fingers):
                also = grasp.pads[j]
                if also.presses or also.from_push > 0.0:
                    change = inner(other.normal, also.whole.vector) - also.depth - also.from_stretch
                    left += grasp.pad_slope[i, j] * change
            pad.moves = pad.presses and (pad.depth > 0.0 or left > 0.0)
            grasp.pad_vector[i] = left if pad.moves else 0.0
        for i, finger in enumerate(grasp.fingers):
            pad = grasp.pads[i]
            for j in range(n):
                both = pad.moves and grasp.pads[j].moves
                grasp.pad_square[i, j] = grasp.pad_slope[i, j] if both else 0.0
            grasp.pad_square[i, i] += 1.5 * finger.pad * math.sqrt(pad.depth) if pad.moves else 1.0
        if not eliminate(grasp.pad_square, grasp.pad_vector, n):
            break
        step = deepest = 0.0
        for i in range(n):
            pad = grasp.pads[i]
            depth = max(pad.depth + grasp.pad_vector[i], 0.0)
            step = max(step, abs(depth - pad.depth))
            deepest = max(deepest, depth)
            pad.depth = depth
        if step <= STILL * deepest:
            break
