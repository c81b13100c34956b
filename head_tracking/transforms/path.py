"""The way from one frame to another: the histories that it depends on, and compiled lookups."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

from head_tracking.transforms.chain import Step, compile_chain, inverted
from head_tracking.transforms.compiled_lookup import (
    Lookup,
    PointLookup,
    compile_lookup,
    compile_point_lookup,
)
from head_tracking.transforms.edges import AnyHistory, Edge, SampledEdge
from head_tracking.transforms.exceptions import (
    ConnectivityException,
    ExtrapolationException,
    LookupException,
    TransformException,
)
from head_tracking.transforms.history import NEVER, JointHistory
from head_tracking.transforms.rotation import Vector3
from head_tracking.transforms.transform import StampedTransform, Transform

LATEST = 0
"""tf2: the time zero asks for the latest common time."""


class Path:
    """The way from `source_frame` to `target_frame`.

    Args:
        target_frame: where points are taken to.
        source_frame: where they come from.
        above_target: the edges from the target up to the common ancestor.
        above_source: the edges from the source up to the common ancestor.
    """

    def __init__(
        self,
        target_frame: str,
        source_frame: str,
        above_target: Sequence[Edge],
        above_source: Sequence[Edge],
    ) -> None:
        self._frames = (target_frame, source_frame)
        self._edges = (*above_target, *above_source)
        histories: dict[int, AnyHistory] = {}
        for edge in self._edges:
            if edge.history is not None:
                histories.setdefault(id(edge.history), edge.history)
        self._histories = tuple(histories.values())
        order = {key: index for index, key in enumerate(histories)}
        steps: list[Step] = []
        for edge in above_target:
            steps += inverted(edge.steps(order.get(id(edge.history), 0)))
        for edge in reversed(above_source):
            steps += edge.steps(order.get(id(edge.history), 0))
        self._steps = steps

    @cached_property
    def latest(self) -> Lookup:
        """Compiled: the answer if all histories end at the same time, else None."""
        return compile_lookup(self._steps, self._histories, self._frames, latest=True)

    @cached_property
    def at(self) -> Lookup:
        """Compiled: the answer at a time [ns], None if it is not known."""
        return compile_lookup(self._steps, self._histories, self._frames, latest=False)

    @cached_property
    def point_latest(self) -> PointLookup:
        """Compiled: as `latest`, for a point."""
        return compile_point_lookup(self._steps, self._histories, latest=True)

    @cached_property
    def point_at(self) -> PointLookup:
        """Compiled: as `at`, for a point."""
        return compile_point_lookup(self._steps, self._histories, latest=False)

    @property
    def latest_common_time(self) -> int:
        """The newest time [ns] at which everything on the way is known; 0 if it never changes.

        Raises:
            TransformException: something on the way is not known at all.
        """
        if not self._histories:
            return LATEST
        latest = min(history.latest for history in self._histories)
        if latest == NEVER:
            raise self._unknown(LATEST)
        return latest

    def lookup(self, stamp: int) -> StampedTransform:
        """The answer at `stamp` [ns], or at the latest common time.

        Raises:
            TransformException: it is not known at that time.
        """
        found = self.at(stamp or self.latest_common_time)
        if found is None:
            raise self._unknown(stamp)
        return found

    def locate(self, stamp: int, point: Vector3) -> tuple[int, float, float, float]:
        """The time [ns] of the answer, and where the point [m] is in the target frame.

        Raises:
            TransformException: it is not known at that time.
        """
        found = self.point_at(stamp or self.latest_common_time, *point)
        if found is None:
            raise self._unknown(stamp)
        return found

    def lookup_given(self, stamp: int, positions: Mapping[str, float]) -> StampedTransform:
        """As `lookup`, with some joints at given positions [rad or m] at any time.

        Raises:
            TransformException: the rest is not known at that time.
        """
        measured = [h for h in self._histories if _joint(h) not in positions]
        if stamp == LATEST and measured:
            stamp = min(history.latest for history in measured)
        for history in measured:
            if not history.oldest <= stamp <= history.latest or history.latest == NEVER:
                raise self._unknown(stamp)
        values = [
            history.at(stamp) if history in measured else positions[_joint(history)]
            for history in self._histories
        ]
        numbers = compile_chain(self._steps, len(values))(*values)
        return StampedTransform(stamp, *self._frames, tuple.__new__(Transform, numbers))

    def _unknown(self, stamp: int) -> TransformException:
        """Why there is no answer at this time."""
        target_frame, source_frame = self._frames
        way = f"from {source_frame!r} to {target_frame!r}"
        for edge in self._edges:
            if edge.history is None or edge.history.latest != NEVER:
                continue
            if not isinstance(edge, SampledEdge):
                return LookupException(
                    f"the joint {edge.history.joint!r} on the way {way} has no position yet; is "
                    "it in joint_states?"
                )
            problem = f"nothing is known of {edge.child!r} any more on the way {way}"
            if stamp in (LATEST, NEVER):
                return ConnectivityException(problem)
            return ExtrapolationException(f"{problem} at time {seconds(stamp)}")
        oldest = max(history.oldest for history in self._histories)
        latest = min(history.latest for history in self._histories)
        stamp = stamp or latest
        where = "future" if stamp > latest else "past"
        return ExtrapolationException(
            f"Lookup would require extrapolation into the {where}: {way}, time {seconds(stamp)} "
            f"was asked for, {seconds(oldest)} to {seconds(latest)} is known"
        )


def seconds(stamp: int) -> str:
    """A stamp [ns] for a person to read."""
    return f"{stamp * 1e-9:.6f} s"


def _joint(history: AnyHistory) -> str:
    return history.joint if isinstance(history, JointHistory) else ""
