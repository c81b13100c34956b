"""The tree of frames: who is in whom, and the way between two of them."""

from __future__ import annotations

from head_tracking.transforms.edges import Edge, SampledEdge
from head_tracking.transforms.exceptions import (
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
)
from head_tracking.transforms.path import LATEST, Path, seconds


class FrameTree:
    """Edges by the frame that they carry. Not thread-safe.

    Attributes:
        edges: the newest edge above each frame.
        names: all frames ever heard of.
        paths: the ways found so far, by target and source; empty while a frame changes parents.
    """

    def __init__(self) -> None:
        self.edges: dict[str, Edge] = {}
        self.names: set[str] = set()
        self._wandering: set[str] = set()
        self.paths: dict[tuple[str, str], Path] = {}

    def add(self, edge: Edge) -> None:
        """Puts a frame under its parent, whatever was above it before."""
        self.edges[edge.child] = edge
        self.names.update((edge.parent, edge.child))
        self._wandering.discard(edge.child)
        self.paths.clear()

    def remove(self, frames: set[str]) -> None:
        """Forgets frames, and their names if nothing else is in them."""
        for frame in frames:
            self.edges.pop(frame, None)
        self._wandering -= frames
        self.names -= frames
        self.names.update(edge.parent for edge in self.edges.values() if edge.parent)
        self.paths.clear()

    def sampled(self, edge: SampledEdge, parent: str, one_parent: bool) -> None:
        """A sample of this edge came in.

        Args:
            edge: the edge.
            parent: the parent of the sample.
            one_parent: it is that of the sample before.
        """
        wandering = edge.child in self._wandering
        if one_parent and not wandering:
            return
        self.names.add(parent)
        if len(edge.history.parents()) > 1:
            self._wandering.add(edge.child)
        elif wandering:
            self._wandering.remove(edge.child)
        self.paths.clear()

    def forget_paths(self) -> None:
        """After everything was forgotten: frames that wandered do so no more."""
        self._wandering.clear()
        self.paths.clear()

    def find(self, target_frame: str, source_frame: str, stamp: int) -> tuple[Path, int]:
        """The way between two frames as it was at `stamp` [ns], and the time to use it at.

        Raises:
            LookupException: an unknown frame, or a loop.
            ConnectivityException: nothing connects them.
            ExtrapolationException: what connects them was not known then.
            InvalidArgumentException: an impossible frame name.
        """
        path = self.paths.get((target_frame, source_frame))
        if path is not None:
            return path, stamp
        self.check(target_frame)
        self.check(source_frame)
        try:
            path = self._find(target_frame, source_frame, LATEST)
        except ConnectivityException:
            if stamp == LATEST:
                raise
            return self._find(target_frame, source_frame, stamp), stamp
        if not self._wandering:
            self.paths[target_frame, source_frame] = path
            return path, stamp
        # a frame that changes its parent makes the way depend on the time
        stamp = stamp or path.latest_common_time
        return self._find(target_frame, source_frame, stamp), stamp

    def check(self, frame: str) -> None:
        """Refuses a frame that can't be asked for.

        Raises:
            InvalidArgumentException: an impossible name.
            LookupException: an unknown frame.
        """
        if not frame or frame.startswith("/"):
            raise InvalidArgumentException(
                f"{frame!r} is no frame name; tf2 names are not empty and start without a slash"
            )
        if frame not in self.names:
            known = ", ".join(sorted(self.names)) or "none yet"
            raise LookupException(f"the frame {frame!r} does not exist; known frames: {known}")

    def _find(self, target_frame: str, source_frame: str, stamp: int) -> Path:
        target, end_of_target = self._above(target_frame, stamp)
        source, end_of_source = self._above(source_frame, stamp)
        while target and source and target[-1] is source[-1]:
            end_of_target = end_of_source = target.pop().child
            source.pop()
        if end_of_target == end_of_source:
            return Path(target_frame, source_frame, target, source)
        for end in (end_of_target, end_of_source):
            if end in self.edges and stamp != LATEST:
                raise ExtrapolationException(
                    f"Lookup would require extrapolation: from {source_frame!r} to "
                    f"{target_frame!r}, where {end!r} was at {seconds(stamp)} is not known"
                )
        raise ConnectivityException(
            f"{target_frame!r} and {source_frame!r} are in two trees that nothing connects: the "
            f"one below {end_of_target!r} and the one below {end_of_source!r}"
        )

    def _above(self, frame: str, stamp: int) -> tuple[list[Edge], str]:
        """The edges above a frame, nearest first, and the frame at their end."""
        edges: list[Edge] = []
        edge = self.edges.get(frame)
        while edge is not None:
            parent = edge.parent
            if not parent:
                break
            if isinstance(edge, SampledEdge) and stamp != LATEST:
                history = edge.history
                if not history.oldest <= stamp <= history.latest:
                    break
                parent = history.at(stamp)[0]
            edges.append(edge)
            if len(edges) > len(self.edges):
                raise LookupException(
                    f"the frames above {frame!r} form a loop: "
                    + ", ".join(dict.fromkeys(edge.child for edge in edges))
                )
            frame = parent
            edge = self.edges.get(frame)
        return edges, frame
