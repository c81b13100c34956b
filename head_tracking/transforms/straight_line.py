"""Writes straight-line Python functions: sums and products of floats, as few as possible.

Sums with known factors are kept as sums until somebody multiplies by them, so constants add up
and multiply out before anything is computed; equal sums are computed once.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

_DIGITS = 15  # what is smaller is what rounding leaves of a sine of pi


@dataclass(frozen=True, slots=True)
class Term:
    """A constant plus factors times expressions.

    Attributes:
        constant: the number that is known.
        parts: pairs of a variable or product of variables, and its factor; none is 0.
    """

    constant: float = 0.0
    parts: tuple[tuple[str, float], ...] = ()

    @staticmethod
    def variable(name: str) -> Term:
        """A variable of the function."""
        return Term(0.0, ((name, 1.0),))

    def __add__(self, other: Term) -> Term:
        factors = dict(self.parts)
        for expression, factor in other.parts:
            factors[expression] = _clean(factors.get(expression, 0.0) + factor)
        parts = tuple((expression, factor) for expression, factor in factors.items() if factor)
        return Term(_clean(self.constant + other.constant), parts)

    def __sub__(self, other: Term) -> Term:
        return self + other * -1.0

    def __mul__(self, factor: float) -> Term:
        factor = _clean(factor)
        if factor == 0.0:
            return Term()
        return Term(
            _clean(self.constant * factor),
            tuple((expression, _clean(own * factor)) for expression, own in self.parts),
        )

    def __truediv__(self, factor: float) -> Term:
        parts = tuple((expression, _clean(own / factor)) for expression, own in self.parts)
        return Term(_clean(self.constant / factor), parts)

    def __neg__(self) -> Term:
        return self * -1.0


@dataclass(slots=True)
class StraightLine:
    """A function under construction.

    Attributes:
        lines: what it does so far; indented lines are written as they are.
    """

    lines: list[str] = field(default_factory=list)
    _known: dict[str, str] = field(default_factory=dict)

    def compute(self, expression: str) -> Term:
        """A variable with the value of an expression."""
        name = self._known.get(expression)
        if name is None:
            name = self._known[expression] = f"v{len(self._known)}"
            self.lines.append(f"{name} = {expression}")
        return Term.variable(name)

    def value(self, term: Term) -> str:
        """The term as the argument of a function call."""
        return text(term) if len(term.parts) == 1 and not term.constant else self._whole(term)

    def product(self, a: Term, b: Term) -> Term:
        """The product of two terms."""
        if not a.parts:
            return b * a.constant
        if not b.parts:
            return a * b.constant
        (one, factor), (two, other) = self._single(a), self._single(b)
        return Term(0.0, ((f"{one} * {two}", _clean(factor * other)),))

    def _single(self, term: Term) -> tuple[str, float]:
        """The term as a factor times one variable."""
        expression, factor = term.parts[0]
        if term.constant or len(term.parts) > 1 or not expression.isidentifier():
            expression = self._whole(term / factor)
        return expression, factor

    def _whole(self, term: Term) -> str:
        return self.compute(text(term)).parts[0][0]

    def function(
        self, arguments: Sequence[str], result: str, scope: Mapping[str, object]
    ) -> Callable[..., Any]:
        """The finished function.

        Args:
            arguments: their names.
            result: the expression that it returns.
            scope: what it can use besides its arguments, sine and cosine.
        """
        body = "\n    ".join([*self.lines, f"return {result}"])
        names: dict[str, Any] = {"sin": math.sin, "cos": math.cos, **scope}
        # only numbers and the names given here get into the source, nothing from outside
        exec(f"def compiled({', '.join(arguments)}):\n    {body}", names)
        function: Callable[..., Any] = names["compiled"]
        return function


def text(term: Term) -> str:
    """The term as an expression."""
    written = ""
    for expression, factor in term.parts:
        sign = "-" if factor < 0 else "+"
        size = "" if abs(factor) == 1.0 else f"{abs(factor)!r} * "
        written += f" {sign} {size}{expression}"
    if term.constant or not written:
        sign = "-" if term.constant < 0 else "+"
        written += f" {sign} {abs(term.constant)!r}"
    return written.removeprefix(" + ").strip()


def tuple_of(terms: Iterable[Term]) -> str:
    """Terms as a tuple."""
    return f"({', '.join(map(text, terms))},)"


def _clean(number: float) -> float:
    return round(number, _DIGITS)
