"""Time per simulated second against error, over the choices of a scene."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

from graspfx.bench.measure import TIMED, Row
from graspfx.bench.own_scene.own_choices import Choice, Trial, attempt, choices, periods, refusal
from graspfx.bench.own_scene.reference import Reference, converge
from graspfx.bench.report.page import error_text, time_text
from graspfx.bench.report.pareto import front
from graspfx.build.run_header import source_name
from graspfx.errors import GraspFXError, InputError
from graspfx.progress import waiting
from graspfx.scene.model import Scene

UNSTABLE, REFUSED = "unstable", "refused"
LONGEST = 2.0  # [s] that are simulated of a scene, unless more are asked for
ROUNDS, QUICK_ROUNDS = 7, 3


@dataclass(frozen=True)
class Outcome:
    """A choice with what came of it.

    Attributes:
        choice: the choice.
        row: its line of the report: microseconds of a simulated second, the error [m], and its state: "timed",
            "unstable" or "refused".
    """

    choice: Choice
    row: Row


@dataclass(frozen=True)
class Tradeoff:
    """Run time against error of a scene.

    Attributes:
        scene: its name.
        duration: that was simulated [s].
        reference: the motion to which all are compared.
        outcomes: a choice each.
    """

    scene: str
    duration: float
    reference: Reference
    outcomes: tuple[Outcome, ...]

    @property
    def best(self) -> list[Row]:
        """The Pareto front: no other choice is both as quick and as exact."""
        return front([each.row for each in self.outcomes])

    def lines(self) -> Iterator[str]:
        """Write the tables' lines, the quickest first; an asterisk marks the Pareto front."""
        yield f"{self.scene}, {self.duration:g} s of it: error, the largest distance of an object or a finger [m]"
        yield f"reference: {self.reference.text()}"
        ordered = sorted(self.outcomes, key=lambda each: each.row.time_us or math.inf)
        width, best = max(len(each.choice.name) for each in ordered), self.best
        yield f"    {'':<{width}}   period [s]  time of 1 s     error"
        for each in ordered:
            row, mark = each.row, "*" if each.row in best else " "
            numbers = f"{each.choice.period:>11.4g}  {time_text(row.time_us):>11}  {error_text(row.error):>8}"
            yield f"  {mark} {each.choice.name:<{width}}  {numbers}  {row.note}".rstrip()

    def to_dict(self) -> dict[str, Any]:
        """Write everything as JSON takes it; times are in seconds for a simulated second."""
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
    """Measure how long each choice of a scene takes for a simulated second, and how far from the reference it ends up.

    Args:
        scene: the scene.
        duration: that is simulated [s]; the scene's own, two seconds at most, if None.
        quick: fewer periods, and fewer runs of each.

    Raises:
        InputError: less time than the longest period takes.
        GraspFXError: the scene does not take a smaller period, so that there is no reference.
    """
    instant = periods(scene, quick)[0]
    seconds = min(scene.duration, LONGEST) if duration is None else duration
    instants = math.floor(seconds / instant + 1e-9)
    if instants < 2:
        raise InputError("--duration", seconds, f"two of the longest periods or more, {2.0 * instant:g} s")
    seconds = instants * instant
    reference = converge(scene, seconds, instant)
    name = source_name(scene.source)
    outcomes, all_ = list[Outcome](), list(choices(scene, quick))
    with waiting(f"measuring choices of {name}", len(all_), "") as wait:
        for choice in all_:
            outcomes.append(
                _outcome(scene, choice, reference, seconds, instant, QUICK_ROUNDS if quick else ROUNDS, name)
            )
            wait.done += 1
    return Tradeoff(name, seconds, reference, tuple(_with_errors_of_the_compiled(outcomes)))


def _outcome(
    scene: Scene, choice: Choice, reference: Reference, duration: float, instant: float, rounds: int, name: str
) -> Outcome:
    empty = Row("scene", name, f"{choice.name} at {choice.period:g} s", None, None, "", "m", state=REFUSED)
    try:
        trial = attempt(scene, choice, duration, instant, rounds)
    except GraspFXError as why:
        return Outcome(choice, replace(empty, note=refusal(why)))
    if choice.engine == "interpreted":
        return Outcome(choice, replace(empty, time_us=1e6 * trial.seconds / choice.period, state=TIMED))
    trouble = trial.trouble or _astray(trial, reference)
    if trouble:
        return Outcome(choice, replace(empty, note=f"unstable: {trouble}", state=UNSTABLE))
    error = reference.distance(trial.places)
    note = f"no nearer than the reference's own error, {reference.error:.1e} m" if error < reference.error else ""
    time_us = 1e6 * trial.seconds / choice.period
    return Outcome(choice, replace(empty, time_us=time_us, error=error, note=note, state=TIMED))


def _astray(trial: Trial, reference: Reference) -> str:
    """Say of a motion that is farther off than anything moves that it is another motion."""
    away = reference.distance(trial.places)
    if away <= reference.extent:
        return ""
    return f"it is {away:.1e} m away from the reference, in which nothing moves farther than {reference.extent:.1e} m"


def _with_errors_of_the_compiled(outcomes: list[Outcome]) -> Iterator[Outcome]:
    """Give interpreted choices the error of the compiled ones, whose bits are theirs."""
    compiled = {
        (each.choice.body, each.choice.period): each.row for each in outcomes if each.choice.engine == "compiled"
    }
    for each in outcomes:
        twin = compiled[each.choice.body, each.choice.period]
        if each.choice.engine == "compiled" or twin.state != TIMED:
            yield each if each.choice.engine == "compiled" else replace(each, row=replace(twin, method=each.row.method))
        else:
            note = "the same bits as compiled"
            yield replace(each, row=replace(each.row, error=twin.error, note=note))
