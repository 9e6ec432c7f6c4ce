"""Damage of answers on a wire that fails."""

from __future__ import annotations

import random
from collections.abc import Iterator

from graspfx.testing.wire.wire import Failure


class Damage:
    """A failure of a line, answer by answer; the same seed does the same to the same answers.

    Attributes:
        kind: of the failure, None for a line that is whole.
        number: of the failure, as in `Wire.fail`.
    """

    def __init__(self, seed: int = 0) -> None:
        self.kind: Failure | None = None
        self.number = 0.0
        self._random, self._answers = random.Random(seed), 0

    def apply(self, answer: bytes) -> Iterator[tuple[float, bytes]]:
        """Give what comes out of the line for an answer, each part with its delay [s]."""
        self._answers += 1
        match self.kind:
            case "late":
                yield self.number, answer
            case "drop":
                if self._answers % max(1, round(self.number)):
                    yield 0.0, answer
            case "flip":
                yield 0.0, self._flipped(answer)
            case "cut":
                count = self._answers % len(answer) if self.number < 0.0 else round(self.number)
                yield 0.0, answer[:count]
            case "garbage":
                yield 0.0, self._random.randbytes(round(self.number)) + answer
            case "wrong-id":
                yield 0.0, bytes([answer[0] ^ 0x55]) + answer[1:]
            case "unplugged" | "blocked":
                return
            case _:
                yield 0.0, answer

    def _flipped(self, answer: bytes) -> bytes:
        if self._random.random() >= self.number:
            return answer
        out = bytearray(answer)
        out[self._random.randrange(len(out))] ^= 1 << self._random.randrange(8)
        return bytes(out)
