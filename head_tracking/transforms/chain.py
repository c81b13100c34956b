"""Chains of transforms, compiled to straight-line float arithmetic.

A chain is walked thousands of times a second and changes hardly ever, so each one becomes a
Python function of its own, with its constants multiplied out. For two joints that is some forty
operations: no loop, no call but sine and cosine, no array.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

from head_tracking.transforms.joint import Joint, JointType, Mimic
from head_tracking.transforms.rotation import Rotation
from head_tracking.transforms.straight_line import StraightLine, Term, tuple_of
from head_tracking.transforms.transform import Transform


@dataclass(frozen=True, slots=True)
class ConstantStep:
    """A transform that never changes."""

    transform: Transform


@dataclass(frozen=True, slots=True)
class JointStep:
    """A joint, without its origin, at ``multiplier * argument + offset``.

    Attributes:
        argument: which argument of the compiled function is its position.
        joint: type and axis.
        multiplier: of the argument.
        offset: added to it [rad or m].
        inverse: from parent to child instead of from child to parent.
    """

    argument: int
    joint: Joint
    multiplier: float = 1.0
    offset: float = 0.0
    inverse: bool = False


@dataclass(frozen=True, slots=True)
class PoseStep:
    """A whole transform that comes as an argument, paired with the name of its parent.

    Attributes:
        argument: which argument of the compiled function is the pair.
        inverse: the transform the other way.
    """

    argument: int
    inverse: bool = False


Step: TypeAlias = ConstantStep | JointStep | PoseStep

Terms: TypeAlias = tuple[Term, ...]


def joint_steps(joint: Joint, leader: Mimic, argument: int) -> tuple[Step, ...]:
    """A joint from its parent to its child.

    Args:
        joint: the joint.
        leader: the joint whose position is the argument, and what becomes of it here.
        argument: which argument that position is.
    """
    origin = ConstantStep(joint.origin)
    if not joint.moves:
        return (origin,)
    return origin, JointStep(argument, joint, leader.multiplier, leader.offset)


def inverted(steps: Iterable[Step]) -> list[Step]:
    """The same way back."""
    back: list[Step] = []
    for step in reversed(tuple(steps)):
        if isinstance(step, ConstantStep):
            back.append(ConstantStep(step.transform.inverse()))
        else:
            back.append(replace(step, inverse=not step.inverse))
    return back


def compile_chain(steps: Iterable[Step], arguments: int) -> Callable[..., tuple[float, ...]]:
    """A function of the arguments that gives the seven numbers of `T_target_source`.

    Args:
        steps: the transforms to be multiplied, from target (first) to source (last).
        arguments: how many arguments the steps use.
    """
    code = StraightLine()
    pose = write_pose(code, tuple(steps))
    return code.function([f"a{index}" for index in range(arguments)], tuple_of(pose), {})


def write_pose(code: StraightLine, steps: Sequence[Step]) -> Terms:
    """Writes the seven numbers of a chain; the arguments are variables a0, a1, ..."""
    origin = (Term(), Term(), Term())
    position, quaternion = _walk(code, steps, origin, (*origin, Term(1.0)))
    return (*position, *quaternion)


def write_point(code: StraightLine, steps: Sequence[Step]) -> Terms:
    """Writes where a chain takes the point px, py, pz; else as `write_pose`."""
    point = tuple(map(Term.variable, ("px", "py", "pz")))
    return _walk(code, steps, point, None)[0]


def _merged(steps: Iterable[Step]) -> list[Step]:
    """The steps with neighbouring constants multiplied out."""
    merged: list[Step] = []
    for step in steps:
        if isinstance(step, ConstantStep) and merged and isinstance(merged[-1], ConstantStep):
            merged[-1] = ConstantStep(merged[-1].transform @ step.transform)
        else:
            merged.append(step)
    return merged


def _walk(
    code: StraightLine, steps: Sequence[Step], position: Terms, quaternion: Terms | None
) -> tuple[Terms, Terms]:
    """Takes a position, and an orientation if wanted, from source to target."""
    for step in reversed(_merged(steps)):
        if isinstance(step, ConstantStep):
            rotation = tuple(map(Term, step.transform.rotation))
            position = _turned_by_constant(step.transform.rotation, position)
            position = _sum(position, tuple(map(Term, step.transform.translation)))
        elif isinstance(step, PoseStep):
            offset, rotation = _argument(code, step.argument)
            if step.inverse:
                rotation = (*(-term for term in rotation[:3]), rotation[3])
                offset = tuple(-term for term in offset)
                position = _turned(code, rotation, _sum(position, offset))
            else:
                position = _sum(_turned(code, rotation, position), offset)
        else:
            axis = tuple(-a for a in step.joint.axis) if step.inverse else step.joint.axis
            value = Term.variable(f"a{step.argument}") * step.multiplier + Term(step.offset)
            if step.joint.type is JointType.PRISMATIC:
                position = _sum(position, tuple(value * component for component in axis))
                continue
            rotation, position = _turned_by_joint(code, axis, value, position)
        if quaternion is not None:
            quaternion = _quaternion_product(code, rotation, quaternion)
    return position, quaternion or ()


def _argument(code: StraightLine, argument: int) -> tuple[Terms, Terms]:
    """The translation and rotation of a transform that is an argument."""
    names = [f"{letter}{argument}" for letter in ("x", "y", "z", "i", "j", "k", "w")]
    x, y, z, i, j, k, w = names
    code.lines.append(f"_, ({x}, {y}, {z}, {i}, {j}, {k}, {w}) = a{argument}")
    terms = tuple(map(Term.variable, names))
    return terms[:3], terms[3:]


def _sum(a: Terms, b: Terms) -> Terms:
    return tuple(i + j for i, j in zip(a, b, strict=True))


def _turned_by_constant(rotation: Rotation, v: Terms) -> Terms:
    return tuple(
        sum((i * m for m, i in zip(row, v, strict=True)), Term())
        for row in rotation.as_matrix().tolist()
    )


def _turned_by_joint(
    code: StraightLine, axis: Sequence[float], angle: Term, v: Terms
) -> tuple[Terms, Terms]:
    """The rotation about a unit vector, and a vector turned by it."""
    half = code.product(angle, Term(0.5))
    argument = code.value(half)
    s, c = code.compute(f"sin({argument})"), code.compute(f"cos({argument})")
    rotation = (*(s * component for component in axis), c)
    main = max(range(3), key=lambda i: abs(axis[i]))
    if abs(axis[main]) < 1.0:
        return rotation, _turned(code, rotation, v)
    # about x, y or z only the other two coordinates change
    one, two = v[main - 2], v[main - 1]
    double = code.product(s, Term(2.0))
    sine = code.product(double, c) * axis[main]
    cosine = Term(1.0) - code.product(double, s)
    result = list(v)
    result[main - 2] = code.product(cosine, one) - code.product(sine, two)
    result[main - 1] = code.product(sine, one) + code.product(cosine, two)
    return rotation, tuple(result)


def _turned(code: StraightLine, q: Terms, v: Terms) -> Terms:
    """The vector turned by a unit quaternion: t = 2 q x v; v' = v + w t + q x t."""
    t = tuple(term * 2.0 for term in _cross(code, q[:3], v))
    across = _cross(code, q[:3], t)
    return tuple(
        own + code.product(q[3], turn) + more for own, turn, more in zip(v, t, across, strict=True)
    )


def _cross(code: StraightLine, a: Terms, b: Terms) -> Terms:
    (ax, ay, az), (bx, by, bz) = a, b
    return (
        code.product(ay, bz) - code.product(az, by),
        code.product(az, bx) - code.product(ax, bz),
        code.product(ax, by) - code.product(ay, bx),
    )


def _quaternion_product(code: StraightLine, a: Terms, b: Terms) -> Terms:
    aw, bw = a[3], b[3]
    vector = tuple(
        code.product(aw, i) + code.product(j, bw) + k
        for i, j, k in zip(b[:3], a[:3], _cross(code, a[:3], b[:3]), strict=True)
    )
    dot = sum((code.product(i, j) for i, j in zip(a[:3], b[:3], strict=True)), Term())
    return (*vector, code.product(aw, bw) - dot)
