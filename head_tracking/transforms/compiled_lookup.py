"""Lookups as one straight-line function each: from the histories to the answer.

The joints of one robot are measured together, so their histories have the same stamps nearly
always: the search for a past time is done once, and its outcome is used for all of them.
(Each history's list of stamps begins with an entry that never was.)
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Sequence
from math import remainder, tau
from typing import Any, TypeAlias

from head_tracking.transforms.chain import Step, write_point, write_pose
from head_tracking.transforms.edges import AnyHistory
from head_tracking.transforms.history import DROP_BATCH, NEVER, JointHistory
from head_tracking.transforms.straight_line import StraightLine, text, tuple_of
from head_tracking.transforms.transform import StampedTransform, Transform

Lookup: TypeAlias = Callable[..., StampedTransform | None]
PointLookup: TypeAlias = Callable[..., tuple[int, float, float, float] | None]


def compile_lookup(
    steps: Sequence[Step],
    histories: Sequence[AnyHistory],
    frames: tuple[str, str],
    *,
    latest: bool,
) -> Lookup:
    """A function that gives the transform, or None if there is no simple answer.

    Args:
        steps: the way from target (first) to source (last).
        histories: where the arguments of the steps come from.
        frames: target and source.
        latest: the function takes no argument; else the time [ns].
    """
    code, arguments, scope = _begin(histories, latest=latest)
    pose = tuple_of(write_pose(code, steps))
    scope |= {"new": tuple.__new__, "Stamped": StampedTransform, "Transform": Transform}
    scope |= {"target": frames[0], "source": frames[1]}
    result = f"new(Stamped, (t, target, source, new(Transform, {pose})))"
    return code.function(arguments, result, scope)


def compile_point_lookup(
    steps: Sequence[Step], histories: Sequence[AnyHistory], *, latest: bool
) -> PointLookup:
    """As `compile_lookup`, for where a point is: its x, y, z are further arguments."""
    code, arguments, scope = _begin(histories, latest=latest)
    x, y, z = map(text, write_point(code, steps))
    return code.function([*arguments, "px", "py", "pz"], f"(t, {x}, {y}, {z})", scope)


def _begin(
    histories: Sequence[AnyHistory], *, latest: bool
) -> tuple[StraightLine, list[str], dict[str, Any]]:
    """The part that finds the values a0, a1, ... and the time t [ns]."""
    code = StraightLine()
    scope: dict[str, Any] = {"bisect": bisect_left, "remainder": remainder, "tau": tau}
    for index, history in enumerate(histories):
        scope |= {f"h{index}": history, f"s{index}": history.stamps, f"r{index}": history.values}
    if latest:
        _write_newest(code, histories)
        return code, [], scope
    joints = [i for i, history in enumerate(histories) if isinstance(history, JointHistory)]
    for index, history in enumerate(histories):
        if index not in joints:
            code.lines += [_out_of_range(index, history), f"a{index} = h{index}.at(t)"]
    if joints:
        _write_search(code, histories, joints)
    return code, ["t"], scope


def _out_of_range(index: int, history: AnyHistory) -> str:
    newest = f"s{index}[-1]"
    return f"if t > {newest} or t < {newest} - {history.cache_time} or t < s{index}[1]: return None"


def _write_newest(code: StraightLine, histories: Sequence[AnyHistory]) -> None:
    code.lines.append("t = s0[-1]" if histories else "t = 0")
    different = [f"s{index}[-1] != t" for index in range(1, len(histories))]
    if histories:
        code.lines.append(f"if {' or '.join([f't == {NEVER}', *different])}: return None")
    code.lines.extend(f"a{index} = r{index}[-1]" for index in range(len(histories)))


def _write_search(
    code: StraightLine, histories: Sequence[AnyHistory], joints: Sequence[int]
) -> None:
    first, *others = joints
    exact, between = (
        [f"a{first} = r{first}[i]"],
        [
            f"before = s{first}[i - 1]",
            "ratio = (t - before) / (after - before)",
            *_interpolation(first, histories[first]),
        ],
    )
    for index in others:
        same = f"if s{index}[-1] == newest and len(s{index}) == count and s{index}[i] == after"
        own = [
            "else:",
            f"    {_out_of_range(index, histories[index])}",
            f"    a{index} = h{index}.at(t)",
        ]
        exact += [f"{same}: a{index} = r{index}[i]", *own]
        between += [
            f"{same} and s{index}[i - 1] == before:",
            *(f"    {line}" for line in _interpolation(index, histories[index])),
            *own,
        ]
    code.lines += [
        f"i = bisect(s{first}, t, 1)",
        f"count = len(s{first})",
        "if i == count: return None",
        f"after, newest = s{first}[i], s{first}[-1]",
        # only the first entries can be older than the cache
        f"if i < {DROP_BATCH + 2} and (t < newest - {histories[first].cache_time}"
        " or i == 1 and t != after): return None",
        "if after == t:",
        *(f"    {line}" for line in exact),
        "else:",
        *(f"    {line}" for line in between),
    ]


def _interpolation(index: int, history: AnyHistory) -> list[str]:
    difference = f"r{index}[i] - a{index}"
    if isinstance(history, JointHistory) and history.continuous:
        difference = f"remainder({difference}, tau)"
    return [f"a{index} = r{index}[i - 1]", f"a{index} += ratio * ({difference})"]
