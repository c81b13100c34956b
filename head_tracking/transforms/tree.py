"""Edges between frames, and the path between two frames by the rules of tf2."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

from head_tracking.transforms.chain import Chain, Step, sampled, sampled_inverse
from head_tracking.transforms.exceptions import (
    ConnectivityException,
    ExtrapolationException,
    LookupException,
    TransformException,
)
from head_tracking.transforms.history import LATEST, JointHistory, TransformHistory, seconds
from head_tracking.transforms.robot_model import Joint, Mimic
from head_tracking.transforms.transform import Transform, product

MAX_DEPTH = 1000
"""tf2: a path of more frames than this is a loop."""


@dataclass(slots=True)
class StaticEdge:
    """A frame that does not move in its parent.

    Attributes:
        steps: `T_parent_child` as steps of a chain; steps_back: `T_child_parent`.
    """

    parent: str
    child: str
    transform: Transform
    steps: tuple[Step, ...] = field(init=False)
    steps_back: tuple[Step, ...] = field(init=False)
    history: None = None

    def __post_init__(self) -> None:
        self.steps, self.steps_back = (self.transform,), (self.transform.inverse(),)

    def at(self, _: int) -> Transform:
        """Return `T_parent_child`."""
        return self.transform


@dataclass(slots=True)
class SampledEdge:
    """A frame with measured transforms.

    Attributes:
        received: when the latest one came, by the monotonic clock [ns].
    """

    child: str
    history: TransformHistory
    received: int = 0
    steps: tuple[Step, ...] = (sampled,)
    steps_back: tuple[Step, ...] = (sampled_inverse,)

    @property
    def parent(self) -> str | None:
        """The parent of all samples; None if there are several, or no samples."""
        return self.history.parent

    def at(self, stamp: int) -> Transform:
        """Return `T_parent_child` at a time [ns], or raise an ExtrapolationException."""
        return self.history.at(stamp)[1]


@dataclass(slots=True)
class JointEdge:
    """A link that a joint moves.

    Positions are interpolated, not transforms: between two samples the link moves on the arc.

    Attributes:
        joint: the joint.
        leader: the joint that is measured: this one, or the one that it mimics.
        history: the measured positions of the leader.
        parent, child: the links.
    """

    joint: Joint
    leader: Mimic
    history: JointHistory
    parent: str = field(init=False)
    child: str = field(init=False)
    steps: tuple[Step, ...] = field(init=False)
    steps_back: tuple[Step, ...] = field(init=False)

    def __post_init__(self) -> None:
        self.parent, self.child = self.joint.parent, self.joint.child
        self.steps = self.joint.steps(self.leader)
        self.steps_back = self.joint.steps(self.leader, back=True)

    def at(self, stamp: int) -> Transform:
        """Return `T_parent_child` at a time [ns], or raise an ExtrapolationException."""
        leader = self.leader
        return self.joint.transform(leader.multiplier * self.history.at(stamp) + leader.offset)


Edge: TypeAlias = StaticEdge | SampledEdge | JointEdge
Edges: TypeAlias = Mapping[str, Edge]
"""The edge above each frame, by its child."""


class Path:
    """The path between two frames: the first lookup multiplies its edges, the next use a chain.

    Args:
        above_target: the edges from the target up to a common ancestor.
        above_source: the edges from the source up to it.
    """

    __slots__ = ("_above_source", "_above_target", "_chain", "_histories", "_used")

    def __init__(self, above_target: list[Edge], above_source: list[Edge]) -> None:
        while above_target and above_source and above_target[-1] is above_source[-1]:
            above_target.pop()
            above_source.pop()
        self._above_target, self._above_source = above_target, above_source
        histories = [edge.history for edge in (*above_source, *reversed(above_target))]
        self._histories = [history for history in histories if history is not None]
        self._used = False
        self._chain: Chain | None = None

    def latest(self) -> int:
        """Return the latest common time [ns]; as in tf2 a stamp of 0 does not count.

        Raises:
            ExtrapolationException: there is none.
        """
        latest = LATEST
        for history in self._histories:
            if not history.stamps:
                raise ExtrapolationException("there are no samples")
            stamp = history.stamps[-1]
            if stamp and (stamp < latest or not latest):
                latest = stamp
        return latest

    def covers(self, stamp: int) -> bool:
        """Return whether all edges are known at this time [ns]."""
        return all(history.covers(stamp) for history in self._histories)

    def transform(self, stamp: int) -> Transform:
        """Return `T_target_source` at a time [ns], or raise an ExtrapolationException."""
        if self._chain is None:
            if not self._used:
                self._used = True
                return self._product(stamp)
            target, source = self._above_target, self._above_source
            steps = [step for edge in target for step in edge.steps_back]
            steps += [step for edge in reversed(source) for step in edge.steps]
            self._chain = Chain(steps, [history.at for history in self._histories])
        return self._chain.transform(stamp)

    def _product(self, stamp: int) -> Transform:
        T_top_source = _product([edge.at(stamp) for edge in self._above_source])
        if not self._above_target:
            return T_top_source
        T_target_top = _product([edge.at(stamp) for edge in self._above_target]).inverse()
        return T_target_top @ T_top_source if self._above_source else T_target_top


def find_path(edges: Edges, target: str, source: str, stamp: int) -> tuple[int, Path]:
    """Climb as tf2 does: from the source as far as is known at that time, then from the target.

    Args:
        edges: above each frame.
        target: the target frame.
        source: the source frame.
        stamp: the time [ns]; 0 for the latest common time.

    Returns:
        The time and the path.

    Raises:
        LookupException: there is a loop, or a joint has no position yet.
        ConnectivityException: the frames are in different trees.
        ExtrapolationException: an edge was not known at that time.
    """
    if stamp == LATEST:
        stamp = latest_common_time(edges, target, source)
    above_source, top, gap = _climb(edges, source, (target,), stamp)
    above_target, end, problem = _climb(edges, target, (source, top), stamp)
    if end == source:
        above_source = []
    elif end != top:
        edge = problem or gap
        if edge is None:
            raise _unconnected(target, source, end, top)
        raise _unknown(edge, target, source, stamp)
    return stamp, Path(above_target, above_source)


def latest_common_time(edges: Edges, target: str, source: str) -> int:
    """Return the latest time [ns] at which both frames are known; 0 if they never move.

    Raises:
        LookupException: there is a loop, or a joint has no position yet.
        ConnectivityException: the frames are in different trees.
    """
    above_source, top, gap = _climb(edges, source, (target,), LATEST)
    if top == target:
        return _common(above_source)
    tops = {edge.child: index for index, edge in enumerate(above_source)} | {top: len(above_source)}
    above_target, end, problem = _climb(edges, target, tops, LATEST)
    if end not in tops:
        for edge in (gap, problem):
            if isinstance(edge, JointEdge):
                raise _unknown(edge, target, source, LATEST)
        raise _unconnected(target, source, end, top)
    return _common(above_source[: tops[end]] + above_target)


def permanent_path(edges: Edges, target: str, source: str) -> tuple[Path, set[str]] | None:
    """Return the path that is valid at all times, if no frame above has several parents.

    Returns:
        The path, and the frames from its ends up to the root. It is valid until their edges change.
    """
    sides = []
    for start in (target, source):
        above: list[Edge] = []
        end = start
        while (edge := edges.get(end)) is not None:
            if edge.parent is None or len(above) > len(edges):
                return None
            above.append(edge)
            end = edge.parent
        sides.append((above, end))
    (above_target, root), (above_source, other) = sides
    if root != other:
        return None
    frames = {edge.child for edge in above_target}
    frames.update([edge.child for edge in above_source])
    frames.add(root)
    return Path(above_target, above_source), frames


def latest_parent(edge: Edge) -> str:
    """Return the parent by the latest sample; empty if there is none."""
    if isinstance(edge, SampledEdge):
        return edge.history.values[-1][0] if edge.history else ""
    return edge.parent


def _product(climbed: list[Transform]) -> Transform:
    """Return the product of transforms, the last one first."""
    if not climbed:
        return Transform.identity()
    numbers: tuple[float, ...] = climbed[0]
    for transform in climbed[1:]:
        numbers = product(transform, numbers)
    return tuple.__new__(Transform, numbers)


def _climb(
    edges: Edges, frame: str, ends: Collection[str], stamp: int
) -> tuple[list[Edge], str, Edge | None]:
    """Return the edges above a frame, the last frame, and the edge above it that is unknown."""
    above: list[Edge] = []
    while frame not in ends:
        edge = edges.get(frame)
        if edge is None:
            break
        parent = _parent(edge, stamp)
        if parent is None:
            return above, frame, edge
        above.append(edge)
        frame = parent
        if len(above) > MAX_DEPTH:
            loop = ", ".join(dict.fromkeys(edge.child for edge in above))
            raise LookupException(f"the tf tree is invalid because it contains a loop: {loop}")
    return above, frame, None


def _parent(edge: Edge, stamp: int) -> str | None:
    """Return the parent at this time; None if it is not known."""
    if isinstance(edge, SampledEdge):
        return edge.history.parent_at(stamp)
    if isinstance(edge, StaticEdge) or edge.history.covers(stamp):
        return edge.parent
    return None


def _common(path: list[Edge]) -> int:
    """Return the earliest of the latest stamps [ns]; as in tf2 a stamp of 0 does not count."""
    stamps = [edge.history.stamps[-1] for edge in path if edge.history is not None]
    return min(filter(None, stamps), default=LATEST)


def _unconnected(target: str, source: str, end: str, top: str) -> TransformException:
    return ConnectivityException(
        f"{target!r} and {source!r} are in different trees, with the roots {end!r} and {top!r}"
    )


def _unknown(edge: Edge, target: str, source: str, stamp: int) -> TransformException:
    """Return the error for an edge that is not known at that time."""
    path = f"on the path from {source!r} to {target!r}"
    history = edge.history
    assert history is not None
    if isinstance(edge, JointEdge) and not history.stamps:
        return LookupException(
            f"the joint {edge.leader.joint!r} {path} has no position yet; is it in joint_states?"
        )
    if not history.stamps:
        return ExtrapolationException(f"{edge.child!r} {path} has no samples")
    oldest, latest = history.oldest, history.stamps[-1]
    return ExtrapolationException(
        f"Lookup would require extrapolation into the {'future' if stamp > latest else 'past'}: "
        f"{path}, {edge.child!r} is known from {seconds(oldest)} to {seconds(latest)}, and time "
        f"{seconds(stamp)} was asked for"
    )
