"""Chains of transforms with their constant parts multiplied in advance.

A path between frames is a sequence of constant and of moving transforms: joints and samples. Each
constant is multiplied into the moving transform after it, the last one into the one before it. So a
lookup needs one product for each moving transform.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from math import cos, sin, sqrt
from operator import itemgetter
from typing import Any, TypeAlias

from head_tracking.transforms.history import Sample
from head_tracking.transforms.transform import Transform, Vector3, product

Link: TypeAlias = Callable[[Any], tuple[float, ...]]
"""From a joint position [rad or m] or a `Sample` to the numbers of a transform."""

MovingStep: TypeAlias = Callable[[Transform, Transform], Link]
"""From the constants before and after a link to the link with both multiplied in."""

Step: TypeAlias = Transform | MovingStep
Reader: TypeAlias = Callable[[Any], Any]

_IDENTITY = Transform.identity()
_DIAGONAL = sqrt(0.5)


class Chain:
    """The transform from one frame to another as a function of the values of its links.

    Args:
        steps: the transforms, from target to source.
        readers: return the value of each link, from source to target.
    """

    __slots__ = ("_constant", "_links")

    def __init__(self, steps: Iterable[Step], readers: Iterable[Reader]) -> None:
        before = _IDENTITY
        moving: list[tuple[MovingStep, Transform]] = []
        for step in steps:
            if isinstance(step, Transform):
                before = step if before is _IDENTITY else _joined(before, step)
            else:
                moving.append((step, before))
                before = _IDENTITY
        self._constant = before
        self._links: list[tuple[Link, Reader]] = []
        for (step, constant), read in zip(reversed(moving), readers, strict=True):
            self._links.append((step(constant, before), read))
            before = _IDENTITY

    def transform(self, argument: Any) -> Transform:
        """Return `T_target_source` for an argument of the readers."""
        numbers: tuple[float, ...] | None = None
        for link, read in self._links:
            here = link(read(argument))
            numbers = here if numbers is None else product(here, numbers)
        return self._constant if numbers is None else tuple.__new__(Transform, numbers)


def _joined(a: Transform, b: Transform) -> Transform:
    return tuple.__new__(Transform, product(a, b))


def rotating(axis: Vector3, multiplier: float = 1.0, offset: float = 0.0) -> MovingStep:
    """Return a joint that rotates about a unit vector by ``multiplier * position + offset`` [rad].

    The quaternion is linear in sine and cosine of half the angle, the translation in those of the
    angle.
    """

    def step(before: Transform, after: Transform) -> Link:
        def at(sine: float, cosine: float) -> tuple[float, ...]:
            i, j, k = axis
            turn = (0.0, 0.0, 0.0, sine * i, sine * j, sine * k, cosine)
            return product(before, turn if after is _IDENTITY else product(turn, after))

        # at 0, at half a turn, and, if the arm is not 0, at a quarter
        x0, y0, z0, ci, cj, ck, cw = at(0.0, 1.0)
        x2, y2, z2, si, sj, sk, sw = at(1.0, 0.0)
        x, y, z = 0.5 * (x0 + x2), 0.5 * (y0 + y2), 0.5 * (z0 + z2)
        cx, cy, cz = x0 - x, y0 - y, z0 - z
        arm = any(after[:3])
        x1, y1, z1 = at(_DIAGONAL, _DIAGONAL)[:3] if arm else (x, y, z)
        sx, sy, sz = x1 - x, y1 - y, z1 - z
        half, start = 0.5 * multiplier, 0.5 * offset

        def on_axis(position: float) -> tuple[float, ...]:
            angle = half * position + start
            c, s = cos(angle), sin(angle)
            return x, y, z, c * ci + s * si, c * cj + s * sj, c * ck + s * sk, c * cw + s * sw

        def off_axis(position: float) -> tuple[float, ...]:
            angle = half * position + start
            c, s = cos(angle), sin(angle)
            sine, cosine = 2.0 * s * c, 1.0 - 2.0 * s * s
            return (
                x + cosine * cx + sine * sx,
                y + cosine * cy + sine * sy,
                z + cosine * cz + sine * sz,
                c * ci + s * si,
                c * cj + s * sj,
                c * ck + s * sk,
                c * cw + s * sw,
            )

        return off_axis if arm else on_axis

    return step


def sliding(axis: Vector3, multiplier: float = 1.0, offset: float = 0.0) -> MovingStep:
    """Return a joint that moves along a unit vector by ``multiplier * position + offset`` [m]."""

    def step(before: Transform, after: Transform) -> Link:
        x, y, z, *rotation = before @ after
        dx, dy, dz = before.rotation.apply(axis)

        def link(position: float) -> tuple[float, ...]:
            s = multiplier * position + offset
            return x + s * dx, y + s * dy, z + s * dz, *rotation

        return link

    return step


def sampled(before: Transform, after: Transform) -> Link:
    """Return a measured transform with constants multiplied in."""
    bx, by, bz = before.translation
    arm = after.translation

    def moved(sample: Sample) -> tuple[float, ...]:
        x, y, z, i, j, k, w = sample[1]
        return bx + x, by + y, bz + z, i, j, k, w

    def with_arm(sample: Sample) -> tuple[float, ...]:
        x, y, z = sample[1].apply(arm)
        return bx + x, by + y, bz + z, *sample[1][3:]

    if before.rotation != _IDENTITY.rotation:
        return lambda sample: product(product(before, sample[1]), after)
    if after.rotation != _IDENTITY.rotation:
        return lambda sample: product(moved(sample), after)
    if any(arm):
        return with_arm
    return moved if any(before.translation) else itemgetter(1)


def sampled_inverse(before: Transform, after: Transform) -> Link:
    """Return the inverse of a measured transform with constants multiplied in."""
    return lambda sample: product(product(before, sample[1].inverse()), after)
