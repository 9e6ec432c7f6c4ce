"""Run time and error of a scene with different integrators, dynamics engines, periods, and engines of the ticks."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly.provenance import source_name
from graspfx.assembly.run_scene import open as open_session
from graspfx.bench.benchmarks import error_text, front, time_text
from graspfx.bench.timing import TIMED, Row
from graspfx.errors import GraspFXError, InputError
from graspfx.objects.dynamics_table import DYNAMICS, dynamics_of
from graspfx.progress import waiting
from graspfx.recording.growth import growths
from graspfx.recording.record import Recording
from graspfx.scene.model import Scene
from graspfx.show import style
from graspfx.show.sheet import Sheet
from graspfx.show.style import FINGERS, INK, MARKERS, NEUTRAL, NOTE, PALE, panel

FloatArray = NDArray[np.float64]

CARRIERS = {each.label: each.name for each in DYNAMICS.values() if each.integrator}  # PyBullet and MuJoCo
BODIES = ("exact", "implicit", "semi-implicit", "explicit", *CARRIERS)
PERIODS, QUICK_PERIODS = (4.0, 2.0, 1.0, 0.5, 0.25), (2.0, 1.0, 0.5)  # as multiples of the scene's own
ROUNDS, QUICK_ROUNDS = 7, 3
FEW = 200  # ticks of an interpreted run; their durations are similar
LONGEST = 2.0  # [s] of simulated time, by default
UNSTABLE, REFUSED = "unstable", "refused"

SMALL = 1e-4  # error relative to the extent of the motion that is sufficient for a reference
MOST_TICKS, MOST_HALVINGS = 400_000, 10
ALIKE, LEAST_ORDER = 0.3, 0.7  # tolerance on the orders of two halvings, and smallest usable order


@dataclass(frozen=True)
class Choice:
    """Numerical options with which a scene is run.

    Attributes:
        body: Integrator of native bodies, or the dynamics engine "PyBullet" or "MuJoCo".
        period: Sampling period [s].
        engine: Engine of the ticks, "compiled" or "interpreted".
    """

    body: str
    period: float
    engine: str = "compiled"

    @property
    def name(self) -> str:
        """Name of the choice in tables."""
        return f"{self.body}, {self.engine}" if self.engine != "compiled" else self.body

    @property
    def overrides(self) -> dict[str, Any]:
        """Values of a scene's keys, by dotted key, that select this choice."""
        values: dict[str, Any] = {"period": self.period, "engine": self.engine}
        if self.body in CARRIERS:
            return values | {"object.*.dynamics": CARRIERS[self.body]}
        return values | {"object.*.dynamics": "native", "object.*.integrator": self.body}


@dataclass(frozen=True)
class Trial:
    """Result of running the scene with one choice.

    Attributes:
        places: Positions of all objects and fingers at the instants at which choices are compared,
            (instants, objects + fingers, d) [m].
        seconds: Mean run time per tick [s], including recording to memory but not compilation.
        trouble: Reason why the run cannot be compared, such as instability; empty if there is none.
    """

    places: FloatArray
    seconds: float
    trouble: str


@dataclass(frozen=True)
class Reference:
    """Motion of the scene, computed with a small period, from which the errors of choices are measured.

    Attributes:
        body: Integrator or dynamics engine, as in `Choice`.
        period: Sampling period [s].
        places: Positions, as in `Trial` [m].
        error: Estimated error of the positions [m].
        order: Order of convergence in the period; None if it could not be estimated (`estimate`).
        changes: Largest change of a position by each halving of the period [m].
    """

    body: str
    period: float
    places: FloatArray
    error: float
    order: float | None
    changes: tuple[float, ...]

    @property
    def extent(self) -> float:
        """Largest range over which a coordinate of an object or finger moves [m]."""
        return float(np.ptp(self.places, axis=0).max())

    def text(self) -> str:
        """Description of the reference and of its error estimate."""
        halved = f"{self.body}, period halved {len(self.changes)} times to {self.period:.3g} s"
        if self.order is None:
            how = "the last change, because the order of convergence is not constant"
        else:
            how = f"Richardson: the last change, {self.changes[-1]:.1e} m, over 2^{self.order:.2f} - 1"
        return f"{halved}; its own error is about {self.error:.1e} m ({how})"


@dataclass(frozen=True)
class Outcome:
    """A choice and its measurements.

    Attributes:
        choice: Numerical options of the run.
        row: Run time per simulated second [us], error [m], and state: "timed", "unstable" or "refused".
    """

    choice: Choice
    row: Row


@dataclass(frozen=True)
class Tradeoff:
    """Run times and errors of a scene with different choices of its numerical options.

    Attributes:
        scene: Name of the scene.
        duration: Simulated duration [s].
        reference: Motion from which errors are measured.
        outcomes: Measurements, one outcome per choice.
    """

    scene: str
    duration: float
    reference: Reference
    outcomes: tuple[Outcome, ...]

    @property
    def best(self) -> list[Row]:
        """Rows of the choices on the Pareto front, fastest first: every faster choice is less accurate."""
        return front([each.row for each in self.outcomes])

    def lines(self) -> Iterator[str]:
        """Yield a table of the choices as lines of text, with the fastest choice first.

        An asterisk marks the choices on the Pareto front.
        """
        yield f"{self.scene}, {self.duration:g} s; the error is the largest distance of an object or a finger [m]"
        yield f"reference: {self.reference.text()}"
        ordered = sorted(self.outcomes, key=lambda each: each.row.time_us or math.inf)
        width, best = max(len(each.choice.name) for each in ordered), self.best
        yield f"    {'':<{width}}   period [s]  time of 1 s     error"
        for each in ordered:
            row, mark = each.row, "*" if each.row in best else " "
            numbers = f"{each.choice.period:>11.4g}  {time_text(row.time_us):>11}  {error_text(row.error):>8}"
            yield f"  {mark} {each.choice.name:<{width}}  {numbers}  {row.note}".rstrip()

    def to_dict(self) -> dict[str, Any]:
        """Return the measurements as data for JSON, with run times in seconds per simulated second."""
        reference, best = self.reference, self.best
        return {
            "scene": self.scene,
            "duration_s": self.duration,
            "reference": {
                "body": reference.body,
                "period_s": reference.period,
                "error_m": reference.error if math.isfinite(reference.error) else None,
                "order": reference.order,
                "changes_m": list(reference.changes),
                "extent_m": reference.extent,
            },
            "rows": [
                {
                    "body": each.choice.body,
                    "period_s": each.choice.period,
                    "engine": each.choice.engine,
                    "time_s_per_s": None if each.row.time_us is None else 1e-6 * each.row.time_us,
                    "error_m": each.row.error,
                    "state": each.row.state,
                    "note": each.row.note,
                    "front": each.row in best,
                }
                for each in self.outcomes
            ],
        }


def trade_off(scene: Scene, *, duration: float | None = None, quick: bool = False) -> Tradeoff:
    """Measure the run time per simulated second, and the error, of a scene with different numerical options.

    The error is the largest distance of an object or a finger from its position in a reference motion (`converge`).
    The periods are 4, 2, 1, 1/2 and 1/4 times the scene's period; if `quick`, only 2, 1 and 1/2 times.

    Args:
        scene: Scene to measure.
        duration: Simulated duration [s]. If None, the duration of the scene is used, but at most two seconds.
        quick: Whether to use fewer periods, and to time each choice three times instead of seven.

    Raises:
        InputError: If the duration is less than twice the longest period.
        GraspFXError: If the scene rejects a period that the reference needs.
    """
    periods = [share * scene.period for share in (QUICK_PERIODS if quick else PERIODS)]
    instant = periods[0]
    seconds = min(scene.duration, LONGEST) if duration is None else duration
    instants = math.floor(seconds / instant + 1e-9)
    if instants < 2:
        raise InputError("--duration", seconds, f"at least twice the longest period, {2.0 * instant:g} s")
    seconds = instants * instant
    reference = converge(scene, seconds, instant)
    name = source_name(scene.source)
    choices = [Choice(body, period) for body in BODIES for period in periods]
    choices.append(Choice(own_body(scene), scene.period, "interpreted"))
    outcomes = dict[Choice, Outcome]()
    with waiting(f"measuring choices of {name}", len(choices), "") as wait:
        for choice in choices:
            row = _measured(scene, choice, reference, seconds, instant, QUICK_ROUNDS if quick else ROUNDS)
            twin = outcomes.get(replace(choice, engine="compiled"))
            if choice.engine == "interpreted" and twin is not None and row.state == TIMED:
                compiled = twin.row  # results of both engines are bit-identical
                row = replace(row, error=compiled.error, note="the same bits as compiled")
                if compiled.state != TIMED:
                    row = replace(compiled, method=row.method)
            outcomes[choice] = Outcome(choice, row)
            wait.done += 1
    return Tradeoff(name, seconds, reference, tuple(outcomes.values()))


def own_body(scene: Scene) -> str:
    """Return the integrator, or the dynamics engine, of the scene's first object."""
    first = scene.object[0]
    label = dynamics_of(first.dynamics).label
    return label if label in CARRIERS else first.integrator


def attempt(scene: Scene, choice: Choice, duration: float, instant: float, rounds: int = 1) -> Trial:
    """Run a scene with a choice of its numerical options.

    An interpreted run is ended after 200 ticks, because only its run time is used.

    Args:
        scene: Scene to run.
        choice: Numerical options.
        duration: Simulated duration, an integer multiple of `instant` [s].
        instant: Time between compared positions, an integer multiple of the choice's period [s].
        rounds: Number of runs; the run time is that of the fastest run.

    Raises:
        GraspFXError: If the scene rejects the choice.
    """
    variant = scene.replace(choice.overrides)
    ticks, step = round(duration / choice.period), round(instant / choice.period)
    ticks = min(ticks, FEW) if choice.engine == "interpreted" else ticks
    least = math.inf
    for _ in range(rounds):
        with open_session(variant) as session:
            session.step(1)  # compiles the program
            began = perf_counter()
            session.step(ticks - 1)
            least = min(least, (perf_counter() - began) / (ticks - 1))
            recording = session.recording
    return Trial(_places(recording)[::step], least, _trouble(recording))


def converge(scene: Scene, duration: float, instant: float, *, small: float = SMALL) -> Reference:
    """Compute a reference motion of a scene by halving the period until the estimated error of the motion is small.

    The period is halved three to ten times, unless a run would exceed 400 000 ticks. Native objects use the exact
    integrator. If the scene's first object uses PyBullet or MuJoCo, all objects do.

    Args:
        scene: Scene to run.
        duration: Simulated duration, an integer multiple of `instant` [s].
        instant: Time between compared positions, an integer multiple of the scene's period [s].
        small: Error relative to the extent of the motion at which halving ends.

    Raises:
        GraspFXError: If the scene rejects a smaller period.
    """
    body = own_body(scene)
    body = body if body in CARRIERS else "exact"
    period, changes = scene.period, list[float]()
    with waiting("finding a reference", MOST_HALVINGS, "") as wait:
        trial = attempt(scene, Choice(body, period), duration, instant)
        while duration / (0.5 * period) <= MOST_TICKS and len(changes) < MOST_HALVINGS:
            finer = attempt(scene, Choice(body, 0.5 * period), duration, instant)
            changes.append(distance(finer.places, trial.places))
            period, trial, wait.done = 0.5 * period, finer, wait.done + 1
            if len(changes) >= 3 and estimate(changes)[0] <= small * float(np.ptp(trial.places, axis=0).max()):
                break
    error, order = estimate(changes) if changes else (math.inf, None)
    return Reference(body, period, trial.places, error, order, tuple(changes))


def estimate(changes: Sequence[float]) -> tuple[float, float | None]:
    """Return the estimated error of a motion, and its order of convergence, from its changes as the period is halved.

    If the error at period h is C h^q, where q is the order, the last halving changed the motion by
    d = C h^q (2^q - 1), and the remaining error is d / (2^q - 1). The ratio of two successive changes gives an order.
    If the last two orders differ by more than 0.3, or the last is below 0.7, the estimate is d, and the order is None.

    Args:
        changes: Change of the motion by each halving, in the order of the halvings.
    """
    last = changes[-1]
    if last == 0.0:
        return 0.0, None
    orders = [math.log2(a / b) if a > 0.0 and b > 0.0 else -math.inf for a, b in pairwise(changes)]
    if len(orders) < 2 or abs(orders[-1] - orders[-2]) > ALIKE or orders[-1] < LEAST_ORDER:
        return last, None
    return last / (2.0 ** orders[-1] - 1.0), orders[-1]


def distance(places: FloatArray, others: FloatArray) -> float:
    """Return the largest distance between corresponding points of two motions, (instants, points, d) each."""
    return float(np.linalg.norm(places - others, axis=2).max())


def _measured(
    scene: Scene, choice: Choice, reference: Reference, duration: float, instant: float, rounds: int
) -> Row:  # fmt: skip
    row = Row(
        "scene", source_name(scene.source), f"{choice.name} at {choice.period:g} s", None, None, "", "m", state=REFUSED
    )
    try:
        trial = attempt(scene, choice, duration, instant, rounds)
    except GraspFXError as why:
        return replace(row, note=" ".join(str(why).split()))
    row = replace(row, time_us=1e6 * trial.seconds / choice.period, state=TIMED)
    if choice.engine == "interpreted":
        return row
    away, extent = distance(trial.places, reference.places), reference.extent
    trouble = trial.trouble
    if not trouble and not away <= extent:  # a different motion
        trouble = f"its distance from the reference, {away:.1e} m, exceeds the extent of the motion, {extent:.1e} m"
    if trouble:
        return replace(row, time_us=None, note=f"unstable: {trouble}", state=UNSTABLE)
    note = f"below the reference's own error, {reference.error:.1e} m" if away < reference.error else ""
    return replace(row, error=away, note=note)


def _places(recording: Recording) -> FloatArray:
    objects = [motion.position for motion in recording.objects.values()]
    return np.concatenate([np.stack(objects, axis=1), recording.finger_position], axis=1)


def _trouble(recording: Recording) -> str:
    if recording.faults:
        return recording.faults[0].message
    if not np.isfinite(_places(recording)).all():
        return "positions are not finite"
    grown = growths(recording)
    return f"{grown[0].mode} motion of {grown[0].object} is not stable" if grown else ""


TALL = 2.9  # [inches]
LEAST = 1e-17  # plotted value of an error of zero
COLOURS = (INK, *FINGERS, NEUTRAL)
BEFORE, BEYOND = 2.5, 1.6  # factors of space for labels before the smallest time and beyond the largest time


def tradeoff_sheet(tradeoff: Tradeoff, *, width: str = "screen") -> Sheet:
    """Plot error against run time, with a line for each integrator or engine and a marker for each period."""
    sound = [each for each in tradeoff.outcomes if each.row.time_us is not None and each.row.error is not None]
    names = list(dict.fromkeys(each.choice.name for each in sound))
    with style.look(width):
        drawing = style.figure([TALL], width=width)
        [axes] = drawing.panels[0]
        weight = drawing.width.weight
        axes.set_xscale("log")
        axes.set_yscale("log")
        for k, name in enumerate(names):
            own = sorted((each for each in sound if each.choice.name == name), key=lambda each: each.choice.period)
            axes.plot(
                *_points(each.row for each in own),
                color=COLOURS[k % len(COLOURS)], marker=MARKERS[k % len(MARKERS)], lw=1.2 * weight,
                markersize=(6.5 - 0.5 * k) * weight, label=name,
            )  # fmt: skip
        best = tradeoff.best
        axes.plot(
            *_points(best), "o", color=INK, markerfacecolor="none", markersize=11.0 * weight,
            label="Pareto front: no other choice is as fast and as accurate",
        )  # fmt: skip
        for each in sound:
            if each.row in best:  # no other choice is both faster and more accurate
                axes.annotate(
                    f"{1e3 * each.choice.period:.3g} ms", _point(each.row), (-7.0, -4.0),
                    textcoords="offset points", ha="right", va="top", color=NOTE, fontsize="small",
                )  # fmt: skip
        if 0.0 < tradeoff.reference.error < float("inf"):
            axes.axhline(
                tradeoff.reference.error, color=PALE, lw=1.2 * weight, ls="--", zorder=1.0,
                label="error of the reference",
            )  # fmt: skip
        low, high = axes.get_xlim()
        axes.set_xlim(low / BEFORE, high * BEYOND)
        panel(axes, x="run time per simulated second [s]", y="error [m]")
        drawing.legend(0)
        drawing.title(f"{style.plain(tradeoff.scene)}: speed and accuracy of its choices")
    return drawing


def _point(row: Row) -> tuple[float, float]:
    """Return the position of a choice in the figure: run time per simulated second [s], and error [m]."""
    return 1e-6 * (row.time_us or 0.0), max(row.error or 0.0, LEAST)


def _points(rows: Iterable[Row]) -> tuple[list[float], list[float]]:
    points = [_point(row) for row in rows]
    return [x for x, _ in points], [y for _, y in points]
