"""Chains of transforms: what is constant is multiplied out once, the rest in one loop.

A way from one frame to another is a row of constant transforms and of links that move: joints, and
transforms that somebody measured. Each constant is multiplied into the link after it, and the last
one into the link before it, so that nothing is left but one product between two links.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from math import cos, sin
from operator import itemgetter
from typing import Any, TypeAlias

from head_tracking.transforms.history import Sample
from head_tracking.transforms.transform import Transform, Vector3, product

Link: TypeAlias = Callable[[Any], tuple[float, ...]]
"""From what is recorded, a joint's position [rad or m] or a `Sample`, to a transform's numbers."""

MovingStep: TypeAlias = Callable[[Transform, Transform], Link]
"""From the constants before and after a link to all three in one."""

Step: TypeAlias = Transform | MovingStep
Reader: TypeAlias = Callable[[Any], Any]

_IDENTITY = Transform.identity()


class Chain:
    """The way from one frame to another, as a function of what decides where its links stand.

    Args:
        steps: the transforms to be multiplied, from target (first) to source (last).
        readers: what gives each link its value, from source to target.
    """

    __slots__ = ("_constant", "_links")

    def __init__(self, steps: Iterable[Step], readers: Iterable[Reader]) -> None:
        before = _IDENTITY
        moving: list[tuple[MovingStep, Transform]] = []
        for step in steps:
            if isinstance(step, Transform):
                before = step if before is _IDENTITY else before @ step
            else:
                moving.append((step, before))
                before = _IDENTITY
        self._constant = before
        self._links: list[tuple[Link, Reader]] = []
        for (step, constant), read in zip(reversed(moving), readers, strict=True):
            self._links.append((step(constant, before), read))
            before = _IDENTITY

    def transform(self, argument: Any) -> Transform:
        """`T_target_source`, for what the readers take."""
        numbers: tuple[float, ...] | None = None
        for link, read in self._links:
            here = link(read(argument))
            numbers = here if numbers is None else product(here, numbers)
        return self._constant if numbers is None else tuple.__new__(Transform, numbers)


def turning(axis: Vector3, multiplier: float = 1.0, offset: float = 0.0) -> MovingStep:
    """A joint that turns about a unit vector, by ``multiplier * position + offset`` [rad].

    Everything is linear in sine and cosine: the quaternion in those of half the angle; where it
    takes a point in those of the angle (Rodrigues' formula).
    """

    def step(before: Transform, after: Transform) -> Link:
        spin: Sequence[float] = (0.0, 0.0, 0.0, *axis, 0.0)
        still: Sequence[float] = before
        if after is not _IDENTITY:
            still, spin = product(before, after), product(spin, after)
        x, y, z, ci, cj, ck, cw = still
        *_, si, sj, sk, sw = product(before, spin)
        cx = cy = cz = sx = sy = sz = 0.0
        arm = after.translation
        if any(arm):
            # the arm turns about the point of the axis that is nearest to its end
            along = sum(a * p for a, p in zip(axis, arm, strict=True))
            foot = (along * axis[0], along * axis[1], along * axis[2])
            x, y, z = before.apply(foot)
            turn = before.rotation
            cx, cy, cz = turn.apply([p - f for p, f in zip(arm, foot, strict=True)])
            sx, sy, sz = turn.apply(_cross(axis, arm))
        half, start = 0.5 * multiplier, 0.5 * offset

        def on_axis(position: float) -> tuple[float, ...]:
            angle = half * position + start
            c, s = cos(angle), sin(angle)
            return x, y, z, c * ci + s * si, c * cj + s * sj, c * ck + s * sk, c * cw + s * sw

        def beside(position: float) -> tuple[float, ...]:
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

        return beside if any(arm) else on_axis

    return step


def sliding(axis: Vector3, multiplier: float = 1.0, offset: float = 0.0) -> MovingStep:
    """A joint that slides along a unit vector, by ``multiplier * position + offset`` [m]."""

    def step(before: Transform, after: Transform) -> Link:
        x, y, z, *rotation = before @ after
        dx, dy, dz = before.rotation.apply(axis)

        def link(position: float) -> tuple[float, ...]:
            way = multiplier * position + offset
            return x + way * dx, y + way * dy, z + way * dz, *rotation

        return link

    return step


def sampled(before: Transform, after: Transform) -> Link:
    """A transform that was measured."""
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
    """A transform that was measured, the other way."""
    return lambda sample: product(product(before, sample[1].inverse()), after)


def _cross(a: Vector3, b: Vector3) -> Vector3:
    (ax, ay, az), (bx, by, bz) = a, b
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
