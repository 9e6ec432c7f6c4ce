"""The certificate beside the sliders: after orders that fail, its verdict is on the values that the run has."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Future
from typing import Any

import pytest

import graspfx as gx
from graspfx.errors import InputError
from graspfx.live.view.certificate_panel import CertificatePanel

KEP = "coupling.external.stiffness"


class Run:
    """A run whose orders end when a test says so."""

    has_hardware = False

    def __init__(self) -> None:
        self.scene = gx.load("paper-waving")
        self.orders: list[tuple[Mapping[str, Any], Future[None]]] = []

    def set(self, values: Mapping[str, Any]) -> Future[None]:
        self.orders.append((values, Future()))
        return self.orders[-1][1]

    def finish(self, number: int, error: Exception | None = None) -> None:
        values, future = self.orders[number]
        if error is None:
            self.scene = self.scene.replace(values)
            future.set_result(None)
        else:
            future.set_exception(error)


class Margins:
    """Requests for verdicts."""

    def __init__(self) -> None:
        self.requests: list[Mapping[str, Any]] = []

    def ask(self, values: Mapping[str, Any]) -> int:
        self.requests.append(dict(values))
        return len(self.requests)


@pytest.mark.parametrize("bad", [0, 1])
def test_the_last_request_is_on_the_values_of_the_run(bad: int) -> None:
    """Two orders of a key wait, and one fails: whichever it is, the page's verdict is on the run's value."""
    run, margins = Run(), Margins()
    panel: Any = CertificatePanel(run, lambda: None)  # type: ignore[arg-type]
    panel._margins = margins
    orders = [panel.order({KEP: value}) for value in (40.0, 50.0)]
    for number in (0, 1):
        run.finish(number, InputError(KEP, 1.0, "another") if number == bad else None)
    own = run.scene.coupling.external.stiffness
    assert own == (50.0, 40.0)[bad]
    assert margins.requests[-1] == {KEP: own}
    assert len(margins.requests) == 2 + bad
    with pytest.raises(InputError):
        orders[bad].result(0.0)
    assert orders[1 - bad].result(0.0).values == {KEP: own}
