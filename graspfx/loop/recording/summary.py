"""A run in numbers: how far the fingers go in, how well the object follows, what shakes, and what it cost."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import pi, sin
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.loop.recording.growth.smoother import roughness

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

VIBRATION_FROM = 5.0  # [Hz]: an operator's own motion stays below
FINEST = 1e-3  # [s]: beyond it the smoother's equations are singular to rounding
MICROSECONDS = 1e6


def summarise(
    *,
    period: float,
    finger_position: FloatArray,
    contact_position: FloatArray,
    finger_force: FloatArray,
    touching: BoolArray,
    gap: FloatArray | None,
    device_energy: FloatArray,
    object_position: Sequence[FloatArray],
    finger_objects: Sequence[int],
    wall_time: float | None = None,
    engine: str = "",
    true_position: FloatArray | None = None,
    fade_shortfall: float = 0.0,
    blended: int = 0,
    faults: int = 0,
    law: Sequence[NDArray[np.int8]] = (),
    residual: Sequence[FloatArray] = (),
    energy: Sequence[Mapping[str, FloatArray]] = (),
    displayed_force: FloatArray | None = None,
    saturated: BoolArray | None = None,
    growth: Sequence[Mapping[str, Any]] = (),
    internal_force: FloatArray | None = None,
    external_force: FloatArray | None = None,
    internal_moment: float | None = None,
    changes: int = 0,
) -> dict[str, Any]:
    """Summarise a run in SI units; a value is None where this run does not have it.

    Keys:
        ticks, period, duration: N, T [s], N T [s].
        touching: per finger, the share of ticks in which it touches.
        internal_deformation_mean, internal_deformation_peak: see `internal_deformation` [m].
        invasion_mean, invasion_peak: depth of touching fingers in the object, along its normal [m]; None if attached.
        finger_distance_mean, finger_distance_least: between two fingers [m]; None for another number of them.
        tracking_error: RMS distance between an object's centre and the centre of its fingers [m].
        peak_force: per finger [N].
        peak_displayed_force: per finger, of the force on the operator [N]; None if not given.
        saturated: per finger, the share of ticks in which its force stands at its limit; None without limits.
        force_vibration: RMS over fingers and ticks of what is above 5 Hz in a finger's force [N].
        internal_force_peak, external_force_peak: per finger, the largest while it touches [N].
        internal_force_mean, external_force_mean: of the length, over fingers and ticks in which they touch [N].
        internal_force_vibration, external_force_vibration: as `force_vibration` [N]; all of these None for a recording
            of an earlier format, which does not say how its forces divide.
        internal_moment: moment sum e_i x f_i of the internal forces f at the fingertips, the largest over the largest
            |f| r (`two_parts.RowSplit.moment_share`); None where the reaction is at the contacts or nothing turns.
        finger_vibration: RMS over fingers and ticks of what is above 5 Hz in a fingertip's position, true if known [m].
        object_vibration: RMS over objects and ticks of what is above 5 Hz in an object's position [m].
        port_energy: per finger, work done on the fingertip through its device in all [J].
        fade_shortfall: by how much `coupling.fade` began too near for the forces, at most [m]; None if it did not.
        blended: share of samples in which a rotation of a grasp was in the band of `coupling.blend`, where forces are
            not those of eq. (4); None if none was.
        associated: share of samples in which an object's forces satisfy the associated law instead of Coulomb's; None
            without a coefficient of friction.
        friction_residual: the largest of either law [N]; None without a coefficient.
        leak: by mode, the most energy that was made beyond what frictions had taken, the largest of any object [J].
        braking: by mode, the largest damping that control added [N s/m]; None without control.
        braked: by mode, what that took in all [J]; None without control.
        ledger_gap: the largest gap of an object's ledger over its largest entry; these four None unless observed.
        growth: a table for each object whose grasp is seen to lose stability, empty without: `object`, `mode` as
            certificates name it, `rate` of log amplitude [1/s], `frequency` [Hz], `begin` and `end` of where it is seen
            [s], `first` and `last` amplitude of a fingertip against the object then [m], `sustained` if it goes on at
            that size, `certificate` (its `spectral_radius`, `gain` and `limit` [N/m] and `text`; None for a
            recording without its scene) and `text`, all in a sentence.
        wall_time, ticks_per_second, tick_cost: of the computation [s, 1/s, microseconds].
        engine: what ran the ticks, "generic", "compiled" or "interpreted", or since when; None if not known.
        faults: how many.
        changes: how many values of keys were replaced in mid-run; None if none was.

    Args:
        period: T [s].
        finger_position, contact_position: (N, n, d) [m].
        finger_force: (N, n, d) [N].
        touching: (N, n).
        gap: (N, n), negative inside [m].
        device_energy: (N, n), cumulative [J].
        object_position: (N, d) per object [m].
        finger_objects: per finger, the number of its object.
        wall_time: that the run took [s].
        engine: that ran the ticks; empty if not known.
        true_position: (N, n, d), of simulated fingertips [m].
        fade_shortfall, blended: as in the recording's outcome [m], [samples].
        faults: how many there were.
        changes: of values of keys in mid-run.
        law, residual: (N,) per object with a coefficient of friction, as recorded.
        energy: per observed object, the columns of its ledger.
        displayed_force: (N, n, d) [N].
        saturated: (N, n).
        growth: as in the result.
        internal_force, external_force: (N, n, d) [N].
        internal_moment: as in the result.
    """
    N, n, _ = finger_position.shape
    groups = [[i for i in range(n) if finger_objects[i] == k] for k in range(len(object_position))]
    deformation = np.concatenate(
        [internal_deformation(finger_position[:, g], contact_position[:, g], touching[:, g]) for g in groups]
    )
    errors = [
        np.linalg.norm(x - finger_position[:, g].mean(axis=1), axis=1)
        for x, g in zip(object_position, groups, strict=True)
        if g
    ]
    depth = None if gap is None else np.maximum(-gap, 0.0)[touching]
    apart = np.linalg.norm(finger_position[:, 1] - finger_position[:, 0], axis=1) if n == 2 else np.empty(0)
    timed = wall_time is not None and wall_time > 0.0 and N > 0
    return {
        "ticks": N,
        "period": float(period),
        "duration": float(N * period),
        "touching": [_mean(touching[:, i]) for i in range(n)],
        "internal_deformation_mean": _mean(deformation) or 0.0,
        "internal_deformation_peak": _peak(deformation) or 0.0,
        "invasion_mean": None if depth is None else _mean(depth) or 0.0,
        "invasion_peak": None if depth is None else _peak(depth) or 0.0,
        "finger_distance_mean": _mean(apart),
        "finger_distance_least": float(apart.min()) if apart.size else None,
        "tracking_error": _rms(np.concatenate(errors)) if errors else None,
        "peak_force": _peaks(finger_force),
        "peak_displayed_force": None if displayed_force is None else _peaks(displayed_force),
        "saturated": None if saturated is None else [_mean(saturated[:, i]) for i in range(n)],
        "force_vibration": vibration(finger_force, period),
        **_two_forces("internal_force", internal_force, touching, period),
        **_two_forces("external_force", external_force, touching, period),
        "internal_moment": internal_moment,
        "finger_vibration": vibration(finger_position if true_position is None else true_position, period),
        "object_vibration": vibration(np.stack(object_position, axis=1), period),
        "port_energy": [float(device_energy[-1, i]) if N else None for i in range(n)],
        "fade_shortfall": fade_shortfall or None,
        "blended": blended / N if blended and N else None,
        "associated": _mean(np.stack(law) == 1) if law else None,
        "friction_residual": _peak(np.stack(residual)) if residual else None,
        **_books(energy),
        "growth": [dict(each) for each in growth],
        "wall_time": wall_time,
        "engine": engine or None,
        "ticks_per_second": N / wall_time if timed and wall_time else None,
        "tick_cost": wall_time / N * MICROSECONDS if timed and wall_time else None,
        "faults": faults,
        "changes": changes or None,
    }


def _two_forces(name: str, force: FloatArray | None, touching: BoolArray, period: float) -> dict[str, Any]:
    if force is None:
        return dict.fromkeys((f"{name}_peak", f"{name}_mean", f"{name}_vibration"))
    size = np.linalg.norm(force, axis=2)
    return {
        f"{name}_peak": [_peak(size[touching[:, i], i]) for i in range(size.shape[1])],
        f"{name}_mean": _mean(size[touching]),
        f"{name}_vibration": vibration(force, period),
    }


def _books(ledgers: Sequence[Mapping[str, FloatArray]]) -> dict[str, Any]:
    summary: dict[str, Any] = dict.fromkeys(("leak", "braking", "braked", "ledger_gap"))
    if not ledgers or not len(ledgers[0]["gap"]):
        return summary
    summary["leak"] = np.max([np.maximum(-each["balance"], 0.0).max(axis=0) for each in ledgers], axis=0).tolist()
    summary["ledger_gap"] = max(_gap(each) for each in ledgers)
    if "damping" in ledgers[0]:
        summary["braking"] = np.max([each["damping"].max(axis=0) for each in ledgers], axis=0).tolist()
        summary["braked"] = np.sum([each["braked"][-1] for each in ledgers], axis=0).tolist()
    return summary


def _gap(ledger: Mapping[str, FloatArray]) -> float:
    largest = max(float(np.abs(values).max()) for name, values in ledger.items() if name not in ("gap", "damping"))
    return float(np.abs(ledger["gap"]).max()) / largest if largest > 0.0 else 0.0


def internal_deformation(
    finger_position: FloatArray, contact_position: FloatArray, touching: BoolArray | None = None
) -> FloatArray:
    """Compute sqrt(mean_i |e_i - mean e|^2), e = p - c: how far touching fingers squeeze in against each other [m].

    e less its mean is (I - P) e with the object's rotation locked, eq. (3), so that moving the whole hand against the
    object does not count; for two opposed fingers, each d deep, it is d.

    Args:
        finger_position, contact_position: (N, n, d) of the fingers of one object [m].
        touching: (N, n); all if not given.

    Returns:
        One number for each tick in which at least two fingers touch.
    """
    e = finger_position - contact_position
    w = np.ones(e.shape[:2]) if touching is None else touching.astype(float)  # (N, n)
    grasped = w.sum(axis=1) >= 2.0
    e, w = e[grasped], w[grasped, :, None]
    count = w.sum(axis=1, keepdims=True)
    spread = w * (e - (w * e).sum(axis=1, keepdims=True) / count)
    mean_square: FloatArray = (spread**2).sum(axis=(1, 2)) / count[:, 0, 0]
    return np.sqrt(mean_square)


def vibration(signal: FloatArray, period: float, above: float = VIBRATION_FROM) -> float | None:
    """Compute the RMS of |x - s| over ticks and rows of x, s minimising |x - s|^2 + q |D s|^2, D fourth differences.

    Whittaker's smoother: x - s is what a Butterworth high-pass of order 4 run forth and back leaves, x passed by
    1/(1 + (above/f)^8), but it takes polynomials up to the third degree away entirely and needs nothing beyond the ends
    (E. T. Whittaker, On a new method of graduation, Proc. Edinburgh Math. Soc. 41, 1923; P. H. C. Eilers, A perfect
    smoother, Analytical Chemistry 75(14), 2003). Ticks are first averaged over 1 ms if they are shorter.

    Args:
        signal: (N, k, d): k vectors of d components over time.
        period: T [s].
        above: [Hz].

    Returns:
        In the signal's unit; None for a signal shorter than two periods of `above`, or sampled too slowly to tell.
    """
    group = max(1, int(FINEST / period))
    if group > 1:
        signal = signal[: len(signal) // group * group].reshape(-1, group, *signal.shape[1:]).mean(axis=1)
        period *= group
    N = len(signal)
    if 2.0 * above * period >= 1.0 or N * period * above < 2.0:
        return None
    fast = roughness(signal.reshape(N, -1), (2.0 * sin(pi * above * period)) ** -8)
    return float(np.sqrt((fast**2).sum() / (N * signal.shape[1])))


def _mean(values: NDArray[Any]) -> float | None:
    return float(values.mean()) if values.size else None


def _peak(values: FloatArray) -> float | None:
    return float(values.max()) if values.size else None


def _peaks(force: FloatArray) -> list[float | None]:
    """Find the largest length of each finger's force [N]."""
    return [_peak(np.linalg.norm(force[:, i], axis=1)) for i in range(force.shape[1])]


def _rms(values: FloatArray) -> float | None:
    return float(np.sqrt(np.mean(values**2))) if values.size else None
