"""The events of a session as markers of an LSL stream."""

from __future__ import annotations

from graspfx.experiment.markers import Event
from graspfx.live.lsl_outlet import MarkerStream


class LslMarkers(MarkerStream):
    """A stream of a session's events, as texts such as "3 stimulus 1": trial, event, interval, value."""

    def mark(self, event: Event) -> None:
        """Send an event with its time."""
        words = [event.trial or "", event.name, event.interval or "", event.value]
        self.send(" ".join(str(word) for word in words if word != ""), event.clock)
