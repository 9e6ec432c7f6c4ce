"""Sliders of a live page: their values and ranges, and the result of each order."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from typing import TYPE_CHECKING, Any

from graspfx.live.sliders import Slider, value_in, values_of, widened

if TYPE_CHECKING:
    from graspfx.live.hardware_clamp import Order
    from graspfx.live.stability_verdict import Verdict


class SliderOrders:
    """Values that sliders ask for, and those that the run has.

    Args:
        sliders: Sliders of the scene.
        order: Function that sets values by live key; its future gives what was set, or an exception.
        remark: Function that shows a message; an empty message removes it.

    Attributes:
        sliders: Sliders with their present ranges.
        values: Values of the run, by the key of the slider.
        shown: Values that the page shows: pending orders, then what was set.
    """

    def __init__(
        self, sliders: Sequence[Slider], order: Callable[[Mapping[str, Any]], Future[Order]],
        remark: Callable[[str], None],
    ) -> None:  # fmt: skip
        self._order, self._remark = order, remark
        self._lock = threading.Lock()
        self.sliders = list(sliders)
        self.values = {slider.key: slider.value for slider in sliders}
        self.shown = dict(self.values)  # also by orders that are pending: factors on one stiffness go together
        self._newest = dict.fromkeys(self.values, 0)

    def told(self) -> list[tuple[float, float, float, float]]:
        """Return value, least, most and step of each slider."""
        return [(self.shown[each.key], each.least, each.most, each.step) for each in self.sliders]

    def widen(self, verdict: Verdict) -> None:
        """Extend the ranges beyond the limits of a full result."""
        if not verdict.is_provisional:
            self.sliders = [widened(each, verdict) for each in self.sliders]

    def accepts(self, number: int, value: float) -> bool:
        """Tell whether there is a slider of this number, and the value is within its range."""
        return number < len(self.sliders) and self.sliders[number].least <= value <= self.sliders[number].most

    def set(self, key: str, value: float) -> None:
        """Order a value; if the order is clamped or refused, the slider shows the actual value."""
        slider = next(each for each in self.sliders if each.key == key)
        with self._lock:
            self._newest[key] += 1
            number = self._newest[key]
            self.shown[key] = value
            order = values_of(slider, self.sliders, self.shown)
        self._order(order).add_done_callback(lambda future: self._settle(key, number, value, future))

    def _settle(self, key: str, number: int, order_value: float, future: Future[Order]) -> None:
        """Process the result of an order; a newer pending order takes precedence."""
        error = future.exception()
        order = None if error is not None else future.result()
        with self._lock:
            if order is not None:
                told = {each.key: value_in(each, order.values) for each in self.sliders}
                self.values.update({name: each for name, each in told.items() if each is not None})
            is_newest = number == self._newest[key]
            if is_newest:
                self.shown[key] = self.values[key]
        if error is not None:
            self._remark(f"{key} = {order_value:.5g} was not set: {error}")
        elif is_newest and order is not None:
            self._remark(order.text)
