"""A buffer of frames over time, as tf2's, which computes the links of a robot from its joints."""

from __future__ import annotations

import math
import threading
from bisect import bisect_right
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from operator import index
from queue import Empty, SimpleQueue
from time import monotonic_ns
from typing import TypeVar

from head_tracking.transforms import frame_report
from head_tracking.transforms.exceptions import (
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TransformException,
)
from head_tracking.transforms.history import (
    DEFAULT_CACHE_TIME,
    LATEST,
    JointHistory,
    TransformHistory,
)
from head_tracking.transforms.robot_model import Joint, JointType, RobotModel
from head_tracking.transforms.transform import (
    UNIT_TOLERANCE,
    Rotation,
    StampedTransform,
    Transform,
    Vector3,
    signed_as_tf2,
)
from head_tracking.transforms.tree import (
    Edge,
    JointEdge,
    Path,
    SampledEdge,
    StaticEdge,
    find_path,
    latest_common_time,
    latest_parent,
    permanent_path,
)

LARGEST_COORDINATE = 1e300
"""Larger coordinates [m] would overflow in sums."""
LARGEST_POSITION = 1e9
"""The largest joint position [rad or m]; larger ones would overflow in mimic joints."""
SILENT_CACHE_TIMES = 10
"""A frame without samples for this number of cache times is removed."""
MOST_ROUTES = 1000
"""The most routes that are kept, of about 1.3 kB each; one more discards all."""


Result = TypeVar("Result")


@dataclass(eq=False, slots=True)
class Waiter:
    """A callback that waits for a condition.

    Attributes:
        possible: returns whether the condition holds.
        callback: called once, when it does.
    """

    possible: Callable[[], bool]
    callback: Callable[[], object]


class TransformBuffer:
    """A tree of frames over the last `cache_time` [ns]; safe to use from several threads.

    Frames come from a robot model and its joint positions, and from single transforms. Stamps are
    nanoseconds; the stamp 0 is the latest common time. Nothing is extrapolated.

    Args:
        cache_time: how much of the past is kept [ns].
    """

    def __init__(self, cache_time: int = DEFAULT_CACHE_TIME) -> None:
        self._cache_time = _nanoseconds(cache_time)
        if self._cache_time < 0:
            raise ValueError(f"cache_time is {cache_time}; allowed are 0 ns and more")
        self._lock = threading.Lock()
        self._edges: dict[str, Edge] = {}
        self._names: set[str] = set()
        self._joints: dict[str, JointHistory] = {}
        self._measured: set[str] = set()
        self._model: RobotModel | None = None
        self._authorities: dict[str, str] = {}
        # by target and source; only those that samples cannot change
        self._routes: dict[tuple[str, str], Path] = {}
        # the keys of the routes that depend on a frame
        self._routes_through: dict[str, set[tuple[str, str]]] = {}
        self._requests: list[Waiter] = []
        self._swept = 0

    # Input

    @property
    def model(self) -> RobotModel | None:
        """The robot model, if one was set."""
        return self._model

    def set_model(self, model: RobotModel) -> None:
        """Replace the robot model and its frames; joints of both models keep their history."""
        if not isinstance(model, RobotModel):
            raise TypeError(f"the model is {model!r}; give the result of load_robot_model(file)")
        with self._lock:
            if self._model is not None:
                for link in self._model.children_of_joints:
                    self._edges.pop(link, None)
            self._model = model
            for joint in model.joints.values():
                self._edges[joint.child] = self._edge(model, joint)
            if self._loop_above_model():
                del self._edges[model.root]
            self._collect_names()
            self._routes.clear()
            self._routes_through.clear()
        self._serve(*self._requests)

    def set_joint_positions(
        self, stamp: int, positions: Mapping[str, float], *, measured: Collection[str] = ()
    ) -> None:
        """Record joint positions [rad or m], also of joints that no model has yet.

        Args:
            stamp: when they were measured [ns].
            positions: by joint name.
            measured: the joints among them that this program itself has measured: what others
                report of these joints is ignored from now on.

        Raises:
            InvalidArgumentException: a position is not finite or too large; the others are kept.
        """
        stamp, joints = _nanoseconds(stamp), self._joints
        refused: str | None = None
        with self._lock:
            self._measured.update(measured)
            for name, position in positions.items():
                if name in self._measured and name not in measured:
                    continue
                if not -LARGEST_POSITION <= position <= LARGEST_POSITION:
                    refused = name
                    continue
                history = joints.get(name) or self._first_position(name)
                history.insert(stamp, float(position))
        if self._requests:
            self._serve(*self._requests)
        if refused is not None:
            raise InvalidArgumentException(
                f"the position of joint {refused!r} is {positions[refused]}; it must be finite "
                f"and within {LARGEST_POSITION:g}"
            )

    def set_transform(
        self,
        stamp: int,
        parent: str,
        child: str,
        transform: Transform,
        *,
        static: bool = False,
        authority: str = "default_authority",
    ) -> bool:
        """Record a transform `T_parent_child`.

        A link of the robot model is computed from its joint. Samples are used until the joint has a
        position.

        Args:
            stamp: when it was measured [ns].
            parent: the parent frame; a leading slash is removed.
            child: the child frame; a leading slash is removed.
            transform: takes points from child into parent.
            static: it never changes.
            authority: the sender, for `all_frames_as_yaml`.

        Returns:
            False if it is older than the cache, or of a link of the model.

        Raises:
            InvalidArgumentException: a name is empty, both names are equal, a number is not finite,
                the quaternion is not of unit length, the model has the frame in another parent, or
                the root of the model would be in or below a loop. Lookups report other loops, as
                in tf2.
        """
        stamp = _nanoseconds(stamp)
        parent, child = parent.removeprefix("/"), child.removeprefix("/")
        transform = _checked(parent, child, transform)
        with self._lock:
            edge = self._edges.get(child)
            if edge is not None and self._is_known_by_model(edge):
                if edge.parent != parent:
                    raise InvalidArgumentException(
                        f"{child!r} in {parent!r} is ignored: the robot model has it in "
                        f"{edge.parent!r}; use one of them (world_frame is a part of the model)"
                    )
                return False
            if (edge is None or edge.parent != parent) and self._loop_above_model(parent, child):
                raise InvalidArgumentException(
                    f"{child!r} in {parent!r} is refused: the robot model would be in a loop of "
                    "frames; exchange them if the transform is meant the other way round"
                )
            recorded = True
            if static:
                new = StaticEdge(parent, child, transform)
                if edge != new:
                    self._put(new)
            else:
                if not isinstance(edge, SampledEdge):
                    self._forget_silent()
                    edge = SampledEdge(child, TransformHistory(self._cache_time))
                    self._put(edge)
                edge.received = monotonic_ns()
                history = edge.history
                before = history.parent
                recorded = history.insert(stamp, (parent, transform))
                if history.parent != before:
                    self._forget_routes(child)
            if parent not in self._names:
                self._names.add(parent)
            if recorded:
                self._authorities[child] = authority
        if self._requests:
            self._serve(*self._requests)
        return recorded

    def clear(self) -> None:
        """Discard all samples; the model, static transforms and frame names stay."""
        with self._lock:
            for joint in self._joints.values():
                joint.clear()
            for edge in self._edges.values():
                if isinstance(edge, SampledEdge):
                    edge.history.clear()
            self._routes.clear()
            self._routes_through.clear()

    def latest_joint_position(self, name: str) -> tuple[int, float] | None:
        """Return stamp [ns] and position [rad or m] of the latest sample of a joint, or None."""
        with self._lock:
            history = self._joints.get(name)
            if history is None or not history.stamps:
                return None
            return history.stamps[-1], history.values[-1]

    def joint_positions(self, name: str, after: int) -> list[float]:
        """Return the positions of a joint [rad or m] after a time [ns], in order."""
        with self._lock:
            history = self._joints.get(name)
            if history is None:
                return []
            return history.values[bisect_right(history.stamps, after, history.first) :]

    def oldest_joint_stamp(self, name: str) -> int:
        """Return the stamp of the oldest sample of a joint [ns]; 0 if there is none."""
        with self._lock:
            history = self._joints.get(name)
            return history.oldest if history else LATEST

    # Lookups

    def lookup_transform(
        self,
        target_frame: str,
        source_frame: str,
        stamp: int = LATEST,
        timeout: float = 0.0,
        *,
        joint_positions: Mapping[str, float] | None = None,
    ) -> StampedTransform:
        """Return the transform that takes points from the source into the target frame.

        Args:
            target_frame: the target frame.
            source_frame: the source frame.
            stamp: the time [ns]; 0 for the latest common time.
            timeout: how long to wait for missing data [s], which must come from another thread.
            joint_positions: use these positions [rad or m] instead of the recorded ones.

        Raises:
            LookupException: a frame is unknown, a joint has no position yet, or there is a loop.
            ConnectivityException: the frames are in different trees.
            ExtrapolationException: the time is outside of the recorded history.
            InvalidArgumentException: a frame name is empty or begins with a slash.
        """
        if timeout > 0.0:
            self._wait(lambda: self.can_transform(target_frame, source_frame, stamp), timeout)
        with self._lock:
            if joint_positions:
                stamp, transform = self._given(target_frame, source_frame, stamp, joint_positions)
            else:
                stamp, transform = self._query(target_frame, source_frame, stamp, Path.transform)
        if transform[6] < 0.5:
            transform = signed_as_tf2(transform)
        return tuple.__new__(StampedTransform, (stamp, target_frame, source_frame, transform))

    def lookup_transform_full(
        self,
        target_frame: str,
        target_stamp: int,
        source_frame: str,
        source_stamp: int,
        fixed_frame: str,
        timeout: float = 0.0,
    ) -> StampedTransform:
        """Return the transform from source at one time to target at another time.

        Args:
            target_frame: the target frame.
            target_stamp: its time [ns]; 0 for the latest common time.
            source_frame: the source frame.
            source_stamp: its time [ns]; 0 for the latest common time.
            fixed_frame: the frame that does not move between the two times.
            timeout: how long to wait for missing data [s].

        Raises:
            TransformException: see `lookup_transform`.
        """
        if timeout > 0.0:
            self._wait(
                lambda: (
                    self.can_transform(fixed_frame, source_frame, source_stamp)
                    and self.can_transform(target_frame, fixed_frame, target_stamp)
                ),
                timeout,
            )
        with self._lock:
            self._check(target_frame, source_frame, fixed_frame)
        T_fixed_source = self.lookup_transform(fixed_frame, source_frame, source_stamp)
        T_target_fixed = self.lookup_transform(target_frame, fixed_frame, target_stamp)
        return StampedTransform(
            T_target_fixed.stamp,
            target_frame,
            source_frame,
            signed_as_tf2(T_target_fixed.transform @ T_fixed_source.transform),
        )

    def transform_point(
        self, point: Sequence[float], target_frame: str, source_frame: str, stamp: int = LATEST
    ) -> Vector3:
        """Transform a point, shape (3,) [m], from source to target; see `lookup_transform`."""
        x, y, z = map(float, point)
        return self.lookup_transform(target_frame, source_frame, stamp).transform.apply((x, y, z))

    def can_transform(
        self, target_frame: str, source_frame: str, stamp: int = LATEST, timeout: float = 0.0
    ) -> bool:
        """Return whether `lookup_transform` succeeds, after at most `timeout` [s]."""
        if timeout > 0.0:
            return self._wait(
                lambda: self.can_transform(target_frame, source_frame, stamp), timeout
            )
        try:
            with self._lock:
                return self._query(target_frame, source_frame, stamp, Path.covers)[1]
        except TransformException:
            return False

    def why_not(
        self, target_frame: str, source_frame: str, stamp: int = LATEST, timeout: float = 0.0
    ) -> str:
        """Return why `lookup_transform` fails; empty if it succeeds."""
        try:
            self.lookup_transform(target_frame, source_frame, stamp, timeout)
        except TransformException as error:
            return str(error)
        return ""

    def get_latest_common_time(self, target_frame: str, source_frame: str) -> int:
        """Return the latest time [ns] at which both frames are known; 0 if they never move.

        Raises:
            TransformException: there is none.
        """
        with self._lock:
            self._check(target_frame, source_frame)
            if target_frame == source_frame:
                return self._latest_of(source_frame)
            return latest_common_time(self._edges, target_frame, source_frame)

    def is_moved_by(self, frame: str, joints: Collection[str]) -> bool:
        """Return whether a frame is below one of these joints, or below one that mimics them."""
        seen: set[str] = set()
        with self._lock:
            while frame and frame not in seen:
                seen.add(frame)
                edge = self._edges.get(frame)
                if isinstance(edge, JointEdge) and edge.leader.joint in joints:
                    return True
                frame = self._parent(frame)
        return False

    # Waiting

    def when(self, possible: Callable[[], bool], callback: Callable[[], object]) -> Waiter:
        """Call back once when a condition holds, which may be at once.

        Args:
            possible: the condition; called now, and again after each input.
            callback: called in the thread of the input; it may use the buffer.

        Returns:
            The argument of `withdraw`.

        Raises:
            Exception: of the first call of `possible`.
        """
        request = Waiter(possible, callback)
        if possible():
            callback()
            return request
        with self._lock:
            self._requests.append(request)
        self._serve(request)
        return request

    def withdraw(self, request: Waiter) -> bool:
        """Remove a request; return False if it was removed or called back before."""
        with self._lock:
            if request not in self._requests:
                return False
            self._requests.remove(request)
            return True

    # Descriptions

    def frames(self) -> tuple[str, ...]:
        """Return the names of all frames, sorted."""
        with self._lock:
            return tuple(sorted(self._names))

    def all_frames_as_string(self) -> str:
        """Return a sentence for each frame, as tf2 does."""
        with self._lock:
            return frame_report.frames_as_string(self._edges.values())

    def all_frames_as_yaml(self, now: int = 0) -> str:
        """Return the frames as tf2 does; with delays if `now` [ns] is given."""
        with self._lock:
            return frame_report.frames_as_yaml(self._edges.values(), self._authorities, now)

    def tree_as_string(self, now: int = 0) -> str:
        """Return the tree as text with rates; with ages if `now` [ns] is given."""
        with self._lock:
            return frame_report.tree_as_string(self._edges.values(), self._names, now)

    # With the lock held

    def _query(
        self, target: str, source: str, stamp: int, method: Callable[[Path, int], Result]
    ) -> tuple[int, Result]:
        """Return the time [ns], and the result of a method of the route at this time."""
        if type(stamp) is not int:
            stamp = _nanoseconds(stamp)
        route = self._routes.get((target, source))
        if route is None:
            if target == source and isinstance(source, str):
                return stamp or self._latest_of(source), method(_NO_PATH, LATEST)
            self._check(target, source)
            route = self._permanent(target, source)
        if route is not None:
            try:
                at = stamp or route.latest()
                return at, method(route, at)
            except ExtrapolationException:
                pass  # find_path raises it with the reason
        at, path = find_path(self._edges, target, source, stamp)
        return at, method(path, at)

    def _permanent(self, target: str, source: str) -> Path | None:
        """Make and keep the route between two frames, if samples cannot change it."""
        found = permanent_path(self._edges, target, source)
        if found is None:
            return None
        if len(self._routes) >= MOST_ROUTES:
            self._routes.clear()
            self._routes_through.clear()
        route, frames = found
        self._routes[target, source] = route
        through, ends = self._routes_through, (target, source)
        for frame in frames:
            if frame in through:
                through[frame].add(ends)
            else:
                through[frame] = {ends}
        return route

    def _forget_routes(self, through: str) -> None:
        """Discard the routes that depend on a frame, because its edge has changed."""
        for ends in self._routes_through.pop(through, ()):
            self._routes.pop(ends, None)

    def _given(
        self, target: str, source: str, stamp: int, positions: Mapping[str, float]
    ) -> tuple[int, Transform]:
        """Return time and transform, with some joints at these positions."""
        for name, position in positions.items():
            if not -LARGEST_POSITION <= position <= LARGEST_POSITION:
                raise InvalidArgumentException(
                    f"the position given for joint {name!r} is {position}; it must be finite"
                )
        edges = self._edges.copy()
        for edge in self._edges.values():
            if isinstance(edge, JointEdge) and edge.leader.joint in positions:
                leader = edge.leader
                position = leader.multiplier * positions[leader.joint] + leader.offset
                edges[edge.child] = StaticEdge(
                    edge.parent, edge.child, edge.joint.transform(position)
                )
        if target == source:
            return stamp or self._latest_of(source), Transform.identity()
        self._check(target, source)
        at, path = find_path(edges, target, source, stamp)
        return at, path.transform(at)

    def _check(self, *frames: str) -> None:
        """Raise for names that cannot be looked up, in the order of tf2."""
        for frame in frames:
            if not isinstance(frame, str):
                raise TypeError(f"a frame name is a str; {frame!r} is a {type(frame).__name__}")
        for frame in frames:
            if not frame or frame.startswith("/"):
                raise InvalidArgumentException(
                    f"{frame!r} is not a frame name; names are not empty and begin without a slash"
                )
            if frame not in self._names:
                known = ", ".join(sorted(self._names)) or "none yet"
                raise LookupException(f"the frame {frame!r} does not exist; known frames: {known}")

    def _latest_of(self, frame: str) -> int:
        edge = self._edges.get(frame)
        return edge.history.stamps[-1] if edge is not None and edge.history else LATEST

    def _is_known_by_model(self, edge: Edge | None) -> bool:
        if self._model is None or edge is None or edge.child not in self._model.children_of_joints:
            return False
        return isinstance(edge, StaticEdge) or (isinstance(edge, JointEdge) and bool(edge.history))

    def _parent(self, frame: str) -> str:
        """Return the latest parent of a frame; empty if there is none."""
        edge = self._edges.get(frame)
        return "" if edge is None else latest_parent(edge)

    def _loop_above_model(self, parent: str = "", child: str = "") -> bool:
        """Return whether the model's root is in or below a loop, if `child` were in `parent`."""
        if self._model is None:
            return False
        seen, frame = set(self._model.links), self._model.root
        while frame := parent if frame == child else self._parent(frame):
            if frame in seen:
                return True
            seen.add(frame)
        return False

    def _first_position(self, name: str) -> JointHistory:
        """Create the history of a joint, and compute its links from it."""
        history, model = self._joint_history(name), self._model
        for joint in () if model is None else model.joints.values():
            if joint.moves and not isinstance(self._edges[joint.child], JointEdge):
                assert model is not None
                if model.leader(joint.name).joint == name:
                    self._put(self._edge(model, joint))
        return history

    def _forget_silent(self) -> None:
        """Remove frames that nobody sends any more; checked once in each cache time."""
        now = monotonic_ns()  # stamps of other machines may be far off
        if now < self._swept + self._cache_time:
            return
        self._swept = now
        model_links = set() if self._model is None else set(self._model.links)
        silent = [
            edge
            for edge in self._edges.values()
            if isinstance(edge, SampledEdge)
            and edge.child not in model_links
            and edge.received < now - SILENT_CACHE_TIMES * self._cache_time
        ]
        for edge in silent:
            del self._edges[edge.child]
            self._authorities.pop(edge.child, None)
            self._forget_routes(edge.child)
        if silent:
            self._collect_names()

    def _collect_names(self) -> None:
        self._names = set(self._edges).union(() if self._model is None else self._model.links)
        for edge in self._edges.values():
            if isinstance(edge, SampledEdge):
                self._names.update(parent for parent, _ in edge.history.values)
            else:
                self._names.add(edge.parent)

    def _put(self, edge: Edge) -> None:
        self._edges[edge.child] = edge
        self._names.update((edge.child, edge.parent or edge.child))
        self._forget_routes(edge.child)

    def _joint_history(self, name: str) -> JointHistory:
        history = self._joints.get(name)
        if history is None:
            history = self._joints[name] = JointHistory(self._cache_time)
        return history

    def _edge(self, model: RobotModel, joint: Joint) -> Edge:
        self._authorities.pop(joint.child, None)
        if not joint.moves:
            return StaticEdge(joint.parent, joint.child, joint.origin)
        leader = model.leader(joint.name)
        history = self._joint_history(leader.joint)
        history.continuous = model.joints[leader.joint].type is JointType.CONTINUOUS
        return JointEdge(joint, leader, history)

    # Without the lock

    def _wait(self, possible: Callable[[], bool], timeout: float) -> bool:
        done: SimpleQueue[None] = SimpleQueue()  # Ctrl-C could leave the lock of an Event locked
        request = self.when(possible, lambda: done.put(None))
        try:
            with suppress(Empty):
                done.get(timeout=min(float(timeout), threading.TIMEOUT_MAX))
        finally:
            is_waiting = self.withdraw(request)
        return not is_waiting

    def _serve(self, *requests: Waiter) -> None:
        """Call back the requests whose conditions hold."""
        for request in requests:
            if request.possible() and self.withdraw(request):
                request.callback()


def _nanoseconds(time: int) -> int:
    """Return a time as int, also of numpy.

    Raises:
        TypeError: it is no integer.
    """
    try:
        return index(time)
    except TypeError:
        raise TypeError(
            f"the time is {time!r}; give integer nanoseconds, such as time.time_ns()"
        ) from None


def _checked(parent: str, child: str, transform: Transform) -> Transform:
    """Return the transform with floats and a normalised quaternion."""
    if not parent or not child:
        raise InvalidArgumentException(
            f"a transform needs two frame names; got {parent!r} and {child!r}"
        )
    if parent == child:
        raise InvalidArgumentException(f"the frame {child!r} cannot be its own parent")
    # messages cannot hold numbers of other types, such as numpy's
    try:
        numbers = x, y, z, qx, qy, qz, qw = tuple(map(float, transform))
    except (TypeError, ValueError):
        raise TypeError(
            f"the transform of {child!r} in {parent!r} is {transform!r}; give a Transform, such as "
            "Transform.from_matrix(matrix)"
        ) from None
    if not max(abs(x), abs(y), abs(z)) < LARGEST_COORDINATE or not all(map(math.isfinite, numbers)):
        raise InvalidArgumentException(
            f"the transform of {child!r} in {parent!r} has numbers that are not finite"
        )
    square = qx * qx + qy * qy + qz * qz + qw * qw
    if abs(square - 1.0) < _ROUNDING:
        return tuple.__new__(Transform, numbers)
    norm = math.hypot(qx, qy, qz, qw)
    if abs(square - 1.0) > UNIT_TOLERANCE:
        raise InvalidArgumentException(
            f"the quaternion of {child!r} in {parent!r} has the norm {norm:.6g}; normalise it to 1"
        )
    return Transform((x, y, z), Rotation(qx / norm, qy / norm, qz / norm, qw / norm))


_ROUNDING = 4e-16
_NO_PATH = Path([], [])
"""From a frame to itself."""
