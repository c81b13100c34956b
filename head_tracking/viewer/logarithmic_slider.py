"""A number that may lie anywhere in several decades: a field to type it, a slider to find it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import viser

from head_tracking.viewer.notify import by_person

_END = 100.0
_STEP = 0.5
_DECADES_ABOVE_ZERO = 4.0
_DECADE = 10.0
_DIGITS = 3


class LogarithmicScale:
    """Between a number in a range and a place on a slider from 0 to 100.

    Args:
        low: the smallest number. 0 has the place at the left end; the four decades below `high`
            follow.
        high: the largest number.
        whole: numbers are whole.
    """

    def __init__(self, low: float, high: float, *, whole: bool = False) -> None:
        self._low, self._high, self._whole = low, high, whole
        self._start = _STEP if low == 0.0 else 0.0
        self._least = low or high / _DECADE**_DECADES_ABOVE_ZERO
        self._decades = math.log10(high / self._least)

    def place(self, number: float) -> float:
        """Where a number is, on the slider's steps."""
        if number <= 0.0:
            return 0.0
        part = math.log10(min(max(number, self._least), self._high) / self._least) / self._decades
        return round((self._start + part * (_END - self._start)) / _STEP) * _STEP

    def number(self, place: float) -> float:
        """The number at a place, in three digits; the ends are exact."""
        if place < self._start:
            return 0.0
        if place >= _END:
            return self._high
        if place <= self._start:
            return self._least
        part = (place - self._start) / (_END - self._start)
        number = float(f"{self._least * _DECADE ** (part * self._decades):.{_DIGITS}g}")
        return float(round(number)) if self._whole else min(max(number, self._least), self._high)

    def marks(self) -> tuple[tuple[float, str], ...]:
        """Places and names of the decades, and of zero."""
        first, last = math.ceil(math.log10(self._least) - 1e-9), math.floor(math.log10(self._high))
        decades = [_DECADE**power for power in range(first, last + 1)]
        return tuple(
            (self.place(number), _short(number)) for number in ([0.0] * (not self._low) + decades)
        )

    @property
    def step(self) -> float:
        """How fine numbers are typed."""
        return 1.0 if self._whole else _DECADE ** (math.floor(math.log10(self._least)) - 1)


class LogarithmicSlider:
    """Stands for one input of viser's: it has a value, tells of changes, and can be removed.

    Args:
        gui: viser's, with the container open that gets it.
        name: beside the field.
        low, high: as for `LogarithmicScale`.
        value: at the start.
        hint: what it is.
    """

    def __init__(
        self, gui: Any, name: str, low: float, high: float, value: float, hint: str
    ) -> None:
        kind = type(value)
        self._scale = scale = LogarithmicScale(low, high, whole=kind is int)
        self._field = gui.add_number(
            name, value, min=kind(low), max=kind(high), step=kind(scale.step), hint=hint
        )
        self._slider = gui.add_slider(
            " ", 0.0, _END, _STEP, scale.place(value), marks=scale.marks(), hint=hint
        )

    @property
    def style(self) -> str:
        """CSS that hides the slider's own field, which would show the place."""
        slider = f'[id="{self._slider._impl.uuid}"]'  # viser's way to name inputs in the page
        return f"{slider} {{margin: -0.5em 0 0.5em}} {slider} + * {{display: none}}"

    @property
    def value(self) -> Any:
        """The number."""
        return self._field.value

    @value.setter
    def value(self, number: float) -> None:
        self._field.value = number
        self._slider.value = self._scale.place(number)

    def on_update(self, callback: Callable[[viser.GuiEvent[Any]], object]) -> None:
        """Calls back when the number has changed, by a person or not."""

        def on_slide(event: viser.GuiEvent[Any]) -> None:
            if by_person(event):
                self._field.value = type(self._field.value)(self._scale.number(event.target.value))
                callback(event)

        def on_field(event: viser.GuiEvent[Any]) -> None:
            if by_person(event):
                self._slider.value = self._scale.place(event.target.value)
            callback(event)

        self._slider.on_update(on_slide)
        self._field.on_update(on_field)

    def remove(self) -> None:
        """Takes it off the page."""
        self._field.remove()
        self._slider.remove()


def _short(number: float) -> str:
    """A decade's name: 100, 1k, 1M."""
    for size, letter in ((1e6, "M"), (1e3, "k")):
        if number >= size:
            return f"{number / size:g}{letter}"
    return f"{number:g}"
