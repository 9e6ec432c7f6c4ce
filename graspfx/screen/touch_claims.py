"""Which screen has which finger: the first that touches it, until it lifts, leaves or falls silent."""

from __future__ import annotations

from collections.abc import Iterator, Sequence


class Claims:
    """Fingers and the clients that have them; a client has a number of its own.

    Args:
        fingers: how many there are.
    """

    def __init__(self, fingers: int) -> None:
        self._owners: list[int | None] = [None] * fingers

    @property
    def owners(self) -> Sequence[int | None]:
        """The client of each finger; None where nobody has it."""
        return tuple(self._owners)

    def claim(self, finger: int, client: int) -> bool:
        """Take a finger for a client; tell whether it is the client's now."""
        if self._owners[finger] is None:
            self._owners[finger] = client
        return self._owners[finger] == client

    def is_of(self, finger: int, client: int) -> bool:
        """Tell whether a client has a finger."""
        return self._owners[finger] == client

    def release(self, finger: int, client: int) -> bool:
        """Free a finger; tell whether the client had it."""
        if self._owners[finger] != client:
            return False
        self._owners[finger] = None
        return True

    def fingers_of(self, client: int) -> Iterator[int]:
        """List the fingers that a client has."""
        return (finger for finger, owner in enumerate(self.owners) if owner == client)

    def bits(self, client: int) -> tuple[int, int]:
        """Give the fingers of a client, and those of anybody, a bit for each."""
        own = sum(1 << i for i, owner in enumerate(self._owners) if owner == client)
        return own, sum(1 << i for i, owner in enumerate(self._owners) if owner is not None)
