"""All frames, over time: what tf2's buffer does, and the joints of the model at lookup."""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping, Sequence
from types import MappingProxyType

from head_tracking.transforms.edges import Edge, JointEdge, SampledEdge, StaticEdge, product
from head_tracking.transforms.exceptions import (
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TransformException,
)
from head_tracking.transforms.history import DEFAULT_CACHE_TIME, JointHistory, TransformHistory
from head_tracking.transforms.joint import Joint, JointType
from head_tracking.transforms.robot_model import RobotModel
from head_tracking.transforms.rotation import Vector3
from head_tracking.transforms.transform import StampedTransform, Transform

LATEST = 0  # tf2: the time zero asks for the newest common time

_MEASURED: Mapping[str, float] = MappingProxyType({})


class TransformBuffer:
    """A tree of frames over the last `cache_time` [ns]; safe to use from several threads.

    Frames come from a robot model and its joint positions, and from transforms set one by one.
    `lookup_transform(target, source)` gives the transform that takes points from source into
    target. Stamps are nanoseconds; the stamp 0 asks for the latest common time.
    """

    def __init__(self, cache_time: int = DEFAULT_CACHE_TIME) -> None:
        self._cache_time = cache_time
        self._lock = threading.Lock()
        self._edges: dict[str, Edge] = {}
        self._joints: dict[str, JointHistory] = {}
        self._model: RobotModel | None = None
        self._model_frames: set[str] = set()
        self._paths: dict[tuple[str, str], tuple[tuple[Edge, ...], tuple[Edge, ...]]] = {}

    @property
    def model(self) -> RobotModel | None:
        """The robot model in use, if one was set."""
        return self._model

    def set_model(self, model: RobotModel) -> None:
        """Takes the frames of a robot model; the links of the model before it go.

        Joints that both models have keep their history.
        """
        with self._lock:
            for frame in self._model_frames:
                del self._edges[frame]
            self._model = model
            for joint in model.joints.values():
                self._edges[joint.child] = (
                    self._joint_edge(model, joint)
                    if joint.moves
                    else StaticEdge(joint.parent, joint.child, joint.origin)
                )
            self._model_frames = {joint.child for joint in model.joints.values()}
            self._paths.clear()

    def set_joint_positions(self, stamp: int, positions: Mapping[str, float]) -> None:
        """Takes measured joint positions [rad or m]; joints not in the model wait for one.

        Raises:
            InvalidArgumentException: a position is not finite; nothing is taken.
        """
        for name, position in positions.items():
            if not math.isfinite(position):
                raise InvalidArgumentException(
                    f"the position of joint {name!r} is {position}; it must be finite"
                )
        with self._lock:
            for name, position in positions.items():
                self._joint_history(name).insert(stamp, position)

    def set_transform(
        self, stamp: int, parent: str, child: str, transform: Transform, *, static: bool = False
    ) -> None:
        """Takes one transform, `T_parent_child`, at `stamp` [ns]; static: at any time.

        Frames of the robot model are left to the model: its joints tell more than samples.

        Raises:
            InvalidArgumentException: a frame without a name, a frame that is its own parent, or
                numbers that are not finite; nothing is taken.
        """
        parent, child = parent.removeprefix("/"), child.removeprefix("/")
        if not parent or not child:
            raise InvalidArgumentException(
                f"a transform needs two frame names; got {parent!r} and {child!r}"
            )
        if parent == child:
            raise InvalidArgumentException(f"the frame {child!r} cannot be its own parent")
        if not all(
            map(math.isfinite, (*transform.translation, *transform.rotation.quaternion_xyzw))
        ):
            raise InvalidArgumentException(
                f"the transform of {child!r} in {parent!r} holds numbers that are not finite"
            )
        with self._lock:
            if child in self._model_frames:
                return
            edge = self._edges.get(child)
            if isinstance(edge, SampledEdge) and edge.parent == parent and not static:
                edge.history.insert(stamp, transform)
                return
            if static:
                self._edges[child] = StaticEdge(parent, child, transform)
            else:
                history = TransformHistory(cache_time=self._cache_time)
                history.insert(stamp, transform)
                self._edges[child] = SampledEdge(parent, child, history)
            self._paths.clear()

    def clear(self) -> None:
        """Forgets everything recorded; the model and static transforms stay."""
        with self._lock:
            for history in self._joints.values():
                history.clear()
            self._edges = {
                child: edge
                for child, edge in self._edges.items()
                if not isinstance(edge, SampledEdge)
            }
            self._paths.clear()

    def lookup_transform(
        self,
        target_frame: str,
        source_frame: str,
        stamp: int = LATEST,
        joint_positions: Mapping[str, float] = _MEASURED,
    ) -> StampedTransform:
        """`T_target_source` at `stamp` [ns].

        Args:
            target_frame: the frame to express points in.
            source_frame: the frame in which points are given.
            stamp: the time [ns]; 0 for the latest common time.
            joint_positions: joints taken to stand at these positions [rad or m] instead of at
                the recorded ones.

        Raises:
            LookupException: an unknown frame, or a joint of which nothing is known yet.
            ConnectivityException: the frames are in different trees.
            ExtrapolationException: the time lies outside the recorded history.
            InvalidArgumentException: an impossible frame name.
        """
        with self._lock:
            down, up = self._path(target_frame, source_frame)
            stamp = self._resolve_stamp(
                stamp, down + up, joint_positions, target_frame, source_frame
            )
            transform = product(down, stamp, joint_positions).inverse() @ product(
                up, stamp, joint_positions
            )
        return StampedTransform(stamp, target_frame, source_frame, transform)

    def can_transform(self, target_frame: str, source_frame: str, stamp: int = LATEST) -> bool:
        """Whether `lookup_transform` would answer."""
        try:
            self.lookup_transform(target_frame, source_frame, stamp)
        except TransformException:
            return False
        return True

    def transform_point(
        self, point: Sequence[float], target_frame: str, source_frame: str, stamp: int = LATEST
    ) -> Vector3:
        """The point, shape (3,) [m], given in `source_frame` at `stamp`, in `target_frame`.

        Raises:
            TransformException: as for `lookup_transform`.
        """
        return self.lookup_transform(target_frame, source_frame, stamp).transform @ point

    def frames(self) -> tuple[str, ...]:
        """The names of all frames, sorted."""
        with self._lock:
            return tuple(sorted(self._frames()))

    def tree_as_string(self) -> str:
        """All frames, each on a line of its own, indented below its parent."""
        with self._lock:
            children: dict[str, list[str]] = {frame: [] for frame in sorted(self._frames())}
            for child, edge in self._edges.items():
                children[edge.parent].append(child)
            lines: list[str] = []
            stack = [(frame, 0) for frame in reversed(children) if frame not in self._edges]
            while stack:
                frame, depth = stack.pop()
                lines.append("  " * depth + frame)
                stack.extend((child, depth + 1) for child in reversed(children[frame]))
            return "\n".join(lines)

    def latest_joint_position(self, name: str) -> tuple[int, float] | None:
        """Stamp [ns] and position [rad or m] of the joint's newest sample, if it has one."""
        with self._lock:
            history = self._joints.get(name)
            return (history.latest, history.newest_value) if history else None

    def _joint_history(self, name: str) -> JointHistory:
        history = self._joints.get(name)
        if history is None:
            history = self._joints[name] = JointHistory(cache_time=self._cache_time)
        return history

    def _joint_edge(self, model: RobotModel, joint: Joint) -> JointEdge:
        leader = model.leader(joint.name)
        history = self._joint_history(leader.joint)
        history.continuous = model.joints[leader.joint].type is JointType.CONTINUOUS
        return JointEdge(joint, leader, history)

    def _frames(self) -> set[str]:
        return {frame for edge in self._edges.values() for frame in (edge.parent, edge.child)}

    def _path(
        self, target_frame: str, source_frame: str
    ) -> tuple[tuple[Edge, ...], tuple[Edge, ...]]:
        """Edges from the common ancestor down to the target, and down to the source."""
        key = (target_frame, source_frame)
        path = self._paths.get(key)
        if path is None:
            target, source = self._edges_above(target_frame), self._edges_above(source_frame)
            while target and source and target[-1] is source[-1]:
                target.pop()
                source.pop()
            tops = [
                edges[-1].parent if edges else frame
                for edges, frame in ((target, target_frame), (source, source_frame))
            ]
            if tops[0] != tops[1]:
                raise ConnectivityException(
                    f"{target_frame!r} and {source_frame!r} are in two trees that nothing "
                    f"connects: the one below {tops[0]!r} and the one below {tops[1]!r}"
                )
            path = self._paths[key] = tuple(reversed(target)), tuple(reversed(source))
        return path

    def _edges_above(self, frame: str) -> list[Edge]:
        if not frame or frame.startswith("/"):
            raise InvalidArgumentException(
                f"{frame!r} is no frame name; tf2 names are not empty and start without a slash"
            )
        edges: list[Edge] = []
        edge = self._edges.get(frame)
        if edge is None and frame not in self._frames():
            known = ", ".join(sorted(self._frames())) or "none yet"
            raise LookupException(f"the frame {frame!r} does not exist; known frames: {known}")
        while edge is not None:
            edges.append(edge)
            if len(edges) > len(self._edges):
                raise LookupException(f"the frames above {frame!r} form a loop")
            edge = self._edges.get(edge.parent)
        return edges

    def _resolve_stamp(
        self,
        stamp: int,
        edges: tuple[Edge, ...],
        joint_positions: Mapping[str, float],
        target_frame: str,
        source_frame: str,
    ) -> int:
        spans = [span for edge in edges if (span := edge.span(joint_positions)) is not None]
        if not spans:
            return stamp
        oldest = max(span[0] for span in spans)
        latest = min(span[1] for span in spans)
        if stamp == LATEST:
            stamp = latest
        if oldest <= stamp <= latest:
            return stamp
        where = "future" if stamp > latest else "past"
        raise ExtrapolationException(
            f"Lookup would require extrapolation into the {where}: from {source_frame!r} to "
            f"{target_frame!r} time {stamp * 1e-9:.6f} s was asked for, "
            f"{oldest * 1e-9:.6f} to {latest * 1e-9:.6f} s is known"
        )
