"""Energy tank that pays for increases of stiffness, which would otherwise generate energy under load.

At the displacement w = K^-1 f of a spring's force f (w = e + s, with the displacement e and the slip s of the contact),
a change dK costs dV = 1/2 w'dK w. The tank loses dV, or only the part of dK that it can pay for is applied. The tank
gains the energy that is released when gains decrease, and the energy that damping and the passivity controller
dissipate; a decrease of gamma adds nothing. The tank holds at most sum L_i^2/(2 k), the energy of springs of the
smallest stiffness k at the force limits. Friction of the devices is not counted.
"""

from __future__ import annotations

import math

from graspfx.compile.kernel import inline, kernel
from graspfx.coupling.grasp_state import GraspState
from graspfx.loop.energy.books import LedgerState
from graspfx.loop.energy.brake import book_sample, store_sample
from graspfx.loop.energy.ledger import total_of
from graspfx.loop.safety.safety_state import SafetyState, Tank

SLIP = 1.25  # factor for contacts that slide by Coulomb's law, for which dV was seen to exceed 1/2 w'dK w by a fifth


@kernel
def grow(grasp: GraspState, safety: SafetyState, target: float) -> None:
    """Change gamma of the stiffness gamma K towards its target, as far as the energy in the tank allows.

    f = gamma K w costs dV = 1/2 w'K w dgamma. The bound 1/2 f'e/gamma replaces 1/2 w'K w, because slipping only reduces
    the latter. The bound is at most the tank's capacity divided by gamma^2, because forces are limited.
    """
    gain, tank = safety.gain, safety.tank
    if target > gain:
        price = 0.0
        for finger in grasp.fingers:
            for a in range(4):
                price += 0.5 * finger.elastic[a] * finger.displacement[a]
        if price * gain * gain > tank.most:
            price = tank.most / (gain * gain)
        cost = (target - gain) * price
        if cost > 0.0:
            share = affordable(tank, cost)
            target = gain + share * (target - gain)
            tank.level -= share * cost
    safety.gain = target


@kernel
def adjust(grasp: GraspState, safety: SafetyState) -> None:
    """Apply the part of a change of the gains that the tank can pay for."""
    if not safety.changing:
        return
    tank, goal = safety.tank, safety.goal
    cost = price_of_change(grasp, safety)
    share = affordable(tank, cost)
    tank.level = min(tank.level - share * cost, tank.most)
    if share == 1.0:
        safety.changing = False
        write_gains(grasp, safety, goal.external_stiffness, goal.external_damping, goal.internal_stiffness,
                    goal.internal_damping)  # fmt: skip
    else:
        kep, ked = grasp.external_stiffness, grasp.external_damping
        kip, kid = grasp.internal_stiffness, grasp.internal_damping
        write_gains(
            grasp, safety, kep + share * (goal.external_stiffness - kep), ked + share * (goal.external_damping - ked),
            kip + share * (goal.internal_stiffness - kip), kid + share * (goal.internal_damping - kid),
        )  # fmt: skip
    write_choices(grasp, safety)


@inline
def affordable(tank: Tank, cost: float) -> float:
    """Return the fraction of a change that the tank can pay for: 1 for a change without cost, 0 for an empty tank."""
    return 1.0 if cost <= tank.level or cost <= 0.0 else max(tank.level, 0.0) / cost


@kernel
def price_of_change(grasp: GraspState, safety: SafetyState) -> float:
    """Compute dV = gamma/2 w'dK w of the whole change, at w of the last sample [J].

    In modes, w'dK w = dkip/kip^2 (f'W^-1 f - sum_k z_k^2) + sum_k dkappa_k/kappa_k^2 z_k^2 with z_k = q_k'W^-1/2 f and
    kappa_k = kip + (kep - kip) beta_k. W is the matrix of the fingers' weights, q_k and beta_k are the rigid modes and
    their fractions (`graspfx.grasp.rigid_modes`). Equal gains have no modes, and f does not determine w if a gain is
    zero. In both cases the bound max(dkep, dkip) w'W w is used; if a gain is zero, the displacement e replaces w in the
    bound.
    """
    if safety.gain <= 0.0:
        return 0.0
    kep, kip = grasp.external_stiffness, grasp.internal_stiffness
    dkep, dkip = safety.goal.external_stiffness - kep, safety.goal.internal_stiffness - kip
    total = 0.0
    if kep <= 0.0 or kip <= 0.0:
        for finger in grasp.fingers:
            for a in range(4):
                total += finger.weight * finger.displacement[a] * finger.displacement[a]
        cost = 0.5 * safety.gain * max(dkep, dkip) * total
    else:
        for finger in grasp.fingers:
            if finger.weight > 0.0:
                for a in range(4):
                    total += finger.elastic[a] * finger.elastic[a] / finger.weight
        if grasp.equal:
            cost = 0.5 * max(dkep, dkip) * total / (kip * kip * safety.gain)
        else:
            cost = 0.5 * price_by_modes(grasp, dkep, dkip, total) / safety.gain
    if grasp.friction:
        cost = cost * SLIP if cost > 0.0 else cost / SLIP
    return cost


@kernel
def price_by_modes(grasp: GraspState, dkep: float, dkip: float, total: float) -> float:
    """Compute w'dK w from `total` = f'W^-1 f and the modes of the last sample."""
    kep, kip, width = grasp.external_stiffness, grasp.internal_stiffness, grasp.width
    price = 0.0
    for k in range(grasp.mode_count):
        z = 0.0
        for i, finger in enumerate(grasp.fingers):
            if finger.weight > 0.0:
                w = 1.0 / math.sqrt(finger.weight)
                for a in range(width):
                    z += w * grasp.modes[k, 1 + width * i + a] * finger.elastic[a]
        share = grasp.modes[k, 0]
        kappa = kip + (kep - kip) * share
        price += (dkip + (dkep - dkip) * share) / (kappa * kappa) * z * z
        total -= z * z
    return price + dkip / (kip * kip) * max(total, 0.0)


@kernel
def write_gains(grasp: GraspState, safety: SafetyState, kep: float, ked: float, kip: float, kid: float) -> None:
    """Write the gains that may change."""
    if safety.kep_moves:
        grasp.external_stiffness = kep
    if safety.ked_moves:
        grasp.external_damping = ked
    if safety.kip_moves:
        grasp.internal_stiffness = kip
    if safety.kid_moves:
        grasp.internal_damping = kid


@kernel
def write_choices(grasp: GraspState, safety: SafetyState) -> None:
    """Write the switches that depend on the gains, by the rules of `graspfx.coupling.fill`."""
    kep, ked = grasp.external_stiffness, grasp.external_damping
    kip, kid = grasp.internal_stiffness, grasp.internal_damping
    grasp.pads_known = False
    grasp.equal = kep == kip and ked == kid
    if safety.posed:
        grasp.rays = safety.apart and (grasp.implicit or not (kep == kip and ked == kid))
    if safety.ked_moves or safety.kid_moves:
        damped = ked != 0.0 or kid != 0.0
        gradual = damped and grasp.damping_depth > 0.0 and not grasp.attached
        grasp.damped = damped
        grasp.singular = ked == 0.0 or kid == 0.0
        grasp.gradual = gradual
        if safety.posed:
            grasp.damping_problem.compliant = gradual


@kernel
def refill(safety: SafetyState, ledger: LedgerState) -> None:
    """Add the energy dissipated by damping and brake since the last sample, from the ledger."""
    spent = 0.0
    for losses in ledger.losses:
        spent += total_of(losses.damped) + total_of(losses.braked)
    tank = safety.tank
    tank.level = min(tank.level + (spent - tank.booked), tank.most)
    tank.booked = spent


@kernel
def open_books(grasp: GraspState, ledger: LedgerState, safety: SafetyState, T: float) -> None:
    """Book the previous sample, apply the passivity controller if enabled, and fill the tank."""
    ledger.gain, ledger.elapsed = safety.gain, safety.elapsed
    book_sample(grasp, ledger, T)
    refill(safety, ledger)


@kernel
def close_books(grasp: GraspState, ledger: LedgerState, safety: SafetyState) -> None:
    """Store the displayed forces and the part withheld after the brake, and write the report."""
    for i, finger in enumerate(ledger.fingers):
        finger.withheld = safety.fingers[i].withheld
    store_sample(grasp, ledger)
