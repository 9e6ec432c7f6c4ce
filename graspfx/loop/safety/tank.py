"""Energy tank that supplies the energy for increases of stiffness.

An increase of stiffness generates energy if the spring is under load. If the stiffness K with the spring force f
changes by dK, the energy in the spring increases by dV = 1/2 w'dK w, with the displacement w = K^-1 f = e + s of the
spring, the displacement e of the finger and the slip s of the contact. dV is taken from the tank; if the tank does not
contain dV, only a fraction of dK is applied. The tank receives the energy that is released by decreases of gains, and
the energy that damping and the passivity controller dissipate, but not the energy that is released by decreases of
gamma or dissipated by friction of the devices. The capacity of the tank is sum L_i^2/(2 k), the energy of springs with
the smallest stiffness k at the force limits L_i.
"""

from __future__ import annotations

import math

from graspfx.compile.kernel import inline, kernel
from graspfx.coupling.grasp_state import GraspState
from graspfx.loop.energy.books import LedgerState
from graspfx.loop.energy.brake import book_sample, store_sample
from graspfx.loop.energy.ledger import total_of
from graspfx.loop.safety.safety_state import SafetyState, Tank

SLIP = 1.25  # factor for contacts that slide by Coulomb's law, where the energy exceeded 1/2 w'dK w by up to a fifth


@kernel
def grow(grasp: GraspState, safety: SafetyState, target: float) -> None:
    """Change the factor gamma of the stiffness towards a target value, as far as the energy in the tank allows.

    An increase dgamma needs dV = 1/2 w'K w dgamma. 1/2 f'e/gamma is used as an upper bound of 1/2 w'K w, because slip
    only reduces w'K w. Another upper bound is the capacity of the tank divided by gamma^2, because forces are limited.
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
    """Change the gains towards their target values, as far as the energy in the tank allows."""
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
    """Return the fraction of a change for which the tank contains the energy; `cost` is the energy needed [J]."""
    return 1.0 if cost <= tank.level or cost <= 0.0 else max(tank.level, 0.0) / cost


@kernel
def price_of_change(grasp: GraspState, safety: SafetyState) -> float:
    """Compute the energy dV = gamma/2 w'dK w [J] for the whole change of the gains, with w of the last sample.

    The gains kep and kip change by dkep and dkip. Then

        w'dK w = dkip/kip^2 (f'W^-1 f - sum_k z_k^2) + sum_k dkappa_k/kappa_k^2 z_k^2,   z_k = q_k'W^-1/2 f,
        kappa_k = kip + (kep - kip) beta_k

    where W is the matrix of the fingers' weights, q_k are the rigid modes and beta_k the fractions of the modes
    (`graspfx.grasp.rigid_modes`). If kep = kip, the modes are not computed, and the upper bound max(dkep, dkip) w'W w
    is used. If a gain is zero, f does not determine w, and this bound is used with the displacement e instead of w.
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
    """Compute w'dK w from the rigid modes of the last sample and from `total` = f'W^-1 f (`price_of_change`)."""
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
    """Set those gains that may change during a run."""
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
    """Set the switches that depend on the gains, as in `graspfx.coupling.fill`."""
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
    """Add to the tank the energy that damping and brake have dissipated since the last call, from the ledger."""
    spent = 0.0
    for losses in ledger.losses:
        spent += total_of(losses.damped) + total_of(losses.braked)
    tank = safety.tank
    tank.level = min(tank.level + (spent - tank.booked), tank.most)
    tank.booked = spent


@kernel
def open_books(grasp: GraspState, ledger: LedgerState, safety: SafetyState, T: float) -> None:
    """Add the previous sample to the ledger, apply the passivity controller if it is enabled, and fill the tank."""
    ledger.gain, ledger.elapsed = safety.gain, safety.elapsed
    book_sample(grasp, ledger, T)
    refill(safety, ledger)


@kernel
def close_books(grasp: GraspState, ledger: LedgerState, safety: SafetyState) -> None:
    """Store the displayed forces and the forces removed after the brake, and write the energies for the recording."""
    for i, finger in enumerate(ledger.fingers):
        finger.withheld = safety.fingers[i].withheld
    store_sample(grasp, ledger)
