"""A run on the wall's clock that is looked at, not recorded: it pauses, and its guided hands take goals at once."""

from __future__ import annotations

import time
from collections.abc import Iterable
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly.process.goals import GoalSender, GuideKeys
from graspfx.assembly.real_time_session import RealTimeSession
from graspfx.assembly.resolve import resolve
from graspfx.errors import InputError
from graspfx.loop.realtime.ring import SLOTS, Phase, Ring, Word

if TYPE_CHECKING:
    from graspfx.recording.header import Header
    from graspfx.recording.split import Split
    from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]

BEGINNING = 0.005  # between two looks whether a servo runs [s]


class LiveSession(RealTimeSession):
    """A run in real time whose rows are in the ring alone unless a folder is given.

    Args:
        scene: what is run.
        live, out, overwrite: as of `open`.
        paused: whether it waits before the first tick.
    """

    keeps_rows = False

    def __init__(
        self,
        scene: Scene,
        *,
        live: Iterable[str] = (),
        out: str | PathLike[str] | None = None,
        overwrite: bool = False,
        paused: bool = False,
    ) -> None:
        self._is_recorded, self._begins_paused = out is not None, paused
        super().__init__(scene, live=live, out=out, overwrite=overwrite)

    def _go(self) -> None:
        if self._begins_paused:
            self.pause()
        self._begin()
        words = self.ring.words
        while not words[Word.HEAD] and not (self._begins_paused and words[Word.PHASE] == Phase.RUNNING):
            if self._remote.await_rest(BEGINNING):
                break
        if self._remote.error is not None:
            raise self._remote.error

    def _look(self, first: int, count: int) -> None:
        super()._look(first, count)
        if not self._is_recorded:
            self._recorder.changes.clear()  # nobody asks for them, and a day has many
            oldest = first + count - SLOTS  # tick of the oldest row that is still there
            while len(self._splits) > 1 and self._splits[1][0] <= oldest:
                del self._splits[0]

    @property
    def ring(self) -> Ring:
        """The rows, and the words of the servo."""
        return self._remote.ring

    @property
    def goals(self) -> GoalSender:
        """The goals of guided hands."""
        return self._goals

    @property
    def guided(self) -> list[GuideKeys]:
        """The guided hands."""
        return self._guided

    @property
    def header(self) -> Header:
        """Header that its recording has."""
        return self._recorder.header

    @property
    def splits(self) -> list[tuple[int, Split]]:
        """Rules by which forces divide, each from a tick on."""
        return list(self._splits)

    @property
    def start(self) -> FloatArray:
        """Positions where fingers start, (n, d) [m]."""
        return resolve(self.scene).start

    @property
    def outcome(self) -> dict[str, Any]:
        """How it ended, as entries of an `Outcome`."""
        return self._remote.outcome

    @property
    def error(self) -> BaseException | None:
        """Error that the run ended in; None without."""
        return self._remote.guard.failure or self._remote.error

    def look(self) -> bool:
        """Take over what the servo says; return whether it goes on."""
        return not self._remote.await_rest(0.0)

    def _require_going(self) -> None:
        self._require_open()
        if not self.look():
            cause = self._remote.outcome["cause"] or "it was closed"
            raise InputError("run", "one without a servo", "a run that goes on", f"it has ended: {cause}")
        while not self.tick and not self._waits_to_begin and self.look():
            time.sleep(0.001)

    @property
    def _waits_to_begin(self) -> bool:
        return int(self.ring.words[Word.HALT]) == 1 and not self.ring.words[Word.HEAD]

    # Pauses -------------------------------------------------------------------------------------------------------

    @property
    def is_paused(self) -> bool:
        """Whether the coming tick waits."""
        words = self.ring.words
        halt = int(words[Word.HALT])
        return bool(halt) and int(words[Word.HEAD]) >= halt - 1

    def pause(self) -> None:
        """Let the coming tick wait; values and goals are taken all the same.

        Raises:
            InputError: a scene with hardware.
        """
        self.require_no_hardware("pause")
        self.ring.words[Word.HALT] = 1

    def resume(self) -> None:
        """Go on, without ticks for the time of the pause.

        Raises:
            InputError: a scene with hardware.
        """
        self.require_no_hardware("resume")
        self.ring.words[Word.HALT] = 0

    def advance(self, ticks: int = 1) -> None:
        """Run that many ticks of a pause, at their pace.

        Raises:
            InputError: a scene with hardware, or no whole number above zero.
        """
        self.require_no_hardware("step")
        if type(ticks) is not int or ticks < 1:
            raise InputError("ticks", ticks, "a whole number of ticks, one or more")
        words = self.ring.words
        if not self.is_paused:
            words[Word.HALT] = 1
            time.sleep(2.0 * self.scene.period)  # for a tick that has begun
        words[Word.HALT] = max(int(words[Word.HALT]) - 1, int(words[Word.HEAD])) + ticks + 1

    def require_no_hardware(self, action: str) -> None:
        """Require that no device of the scene shows forces to anybody.

        Raises:
            InputError: one does.
        """
        if self.servo.hardware:
            raise InputError(
                action, ", ".join(self.servo.hardware), "a scene of simulations alone",
                "hardware shows the force of every tick: let it rest instead",
            )  # fmt: skip
