"""Sliders of the page for values that can change during a run, with feedback about each order."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from typing import TYPE_CHECKING, Any

from graspfx.live.sliders import Slider, value_in, values_of, widened
from graspfx.live.view.words_on_page import heading

if TYPE_CHECKING:
    import viser

    from graspfx.live.hardware_clamp import Order
    from graspfx.live.stability_verdict import Verdict

SHORT = {"external stiffness": "external", "internal stiffness": "internal",
         "external damping": "external", "internal damping": "internal"}  # fmt: skip


class GainSliders:
    """Sliders on the page.

    Args:
        server: Server of the page.
        sliders: Sliders of the scene.
        order: Function that sets values by live key; its future gives what was set, or an exception.
        remark: Function that shows a message; an empty message removes it.
    """

    def __init__(
        self, server: viser.ViserServer, sliders: list[Slider],
        order: Callable[[Mapping[str, Any]], Future[Order]], remark: Callable[[str], None],
    ) -> None:  # fmt: skip
        self._order, self._remark = order, remark
        self._lock = threading.Lock()
        self.values = {slider.key: slider.value for slider in sliders}
        self._asked = dict(self.values)  # also by orders that are pending: factors on one stiffness go together
        self._newest = dict.fromkeys(self.values, 0)
        self._handles: dict[str, Any] = {}
        if sliders:
            server.gui.add_html(heading("Gains and numbers, while it runs"))
        for slider in sliders:
            handle = server.gui.add_slider(
                label(slider), float(slider.least), float(slider.most), float(slider.step), float(slider.value),
                hint=f"{slider.label}: {slider.live}",
            )  # fmt: skip
            handle.on_update(self._mover(slider.key))
            self._handles[slider.key] = handle
        self._sliders = list(sliders)

    def _mover(self, key: str) -> Callable[[Any], Any]:
        async def move(event: Any) -> None:  # on the page's thread, which keeps the order of events
            if event.client_id is not None:
                self.set(key, float(event.target.value))

        return move

    def widen(self, verdict: Verdict) -> None:
        """Extend the ranges beyond the limits of a full result."""
        if verdict.is_provisional:
            return
        for i, slider in enumerate(self._sliders):
            wide = self._sliders[i] = widened(slider, verdict)
            if wide is not slider:
                self._handles[slider.key].max, self._handles[slider.key].step = wide.most, wide.step

    def set(self, key: str, value: float) -> None:
        """Order a value; if the order is clamped or refused, the slider moves to the actual value."""
        if self._handles[key].value != value:
            self._handles[key].value = value
        slider = next(each for each in self._sliders if each.key == key)
        with self._lock:
            self._newest[key] += 1
            number = self._newest[key]
            self._asked[key] = value
            order = values_of(slider, self._sliders, self._asked)
        self._order(order).add_done_callback(lambda future: self._settle(key, number, value, future))

    def _settle(self, key: str, number: int, order_value: float, future: Future[Order]) -> None:
        """Process the result of an order; a newer pending order takes precedence."""
        error = future.exception()
        order = None if error is not None else future.result()
        with self._lock:
            if order is not None:
                told = {each.key: value_in(each, order.values) for each in self._sliders}
                self.values.update({name: each for name, each in told.items() if each is not None})
            is_newest = number == self._newest[key]
            if is_newest:
                self._asked[key] = self.values[key]
        if error is not None:
            self._remark(f"{key} = {order_value:.5g} was not set: {error}")
        elif is_newest and order is not None:
            self._remark(order.text)
        if is_newest and self.values[key] != order_value:
            self._handles[key].value = self.values[key]


def label(slider: Slider) -> str:
    """Shorten a label to one line: name, symbol and unit."""
    words, _, letter = slider.label.rpartition(", ")
    text = f"{SHORT.get(words, words)} {letter}".strip()
    unit = slider.unit.replace("/", "\u2215").replace(" ", "\u00a0")  # prevents a line break
    return f"{text} [{unit}]" if unit else text
