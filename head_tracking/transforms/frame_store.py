"""What is known of all frames: the robot's model, its joints over time, and set transforms."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Mapping
from math import isfinite

from head_tracking.transforms.edges import Edge, JointEdge, SampledEdge, StaticEdge
from head_tracking.transforms.exceptions import InvalidArgumentException
from head_tracking.transforms.frame_tree import FrameTree
from head_tracking.transforms.history import (
    DEFAULT_CACHE_TIME,
    NEVER,
    JointHistory,
    TransformHistory,
)
from head_tracking.transforms.joint import Joint, JointType
from head_tracking.transforms.report import (
    frames_as_string,
    frames_as_yaml,
    problems,
    tree_as_string,
)
from head_tracking.transforms.requests import Request, Requests
from head_tracking.transforms.robot_model import RobotModel
from head_tracking.transforms.rotation import UNIT_TOLERANCE, Rotation
from head_tracking.transforms.transform import Transform


class FrameStore:
    """The writing half of a transform buffer; safe to use from several threads.

    Args:
        cache_time: how much of the past is kept [ns].
    """

    def __init__(self, cache_time: int = DEFAULT_CACHE_TIME) -> None:
        self._cache_time = cache_time
        self._lock = threading.Lock()
        self._tree = FrameTree()
        self._joints: dict[str, JointHistory] = {}
        self._model: RobotModel | None = None
        self._authorities: dict[str, str] = {}
        self._requests = Requests()

    @property
    def model(self) -> RobotModel | None:
        """The robot model in use, if one was set."""
        return self._model

    def set_model(self, model: RobotModel) -> None:
        """Takes the frames of a robot model; the links of the model before it go.

        Joints that both models have keep their history.
        """
        with self._lock:
            if self._model is not None:
                self._tree.remove(set(self._model.links))
            self._model = model
            self._tree.names.update(model.links)
            for joint in model.joints.values():
                self._tree.add(self._edge(model, joint))
        self._serve_requests()

    def set_joint_positions(self, stamp: int, positions: Mapping[str, float]) -> None:
        """Takes measured joint positions [rad or m]; joints not in the model wait for one.

        Args:
            stamp: when they were measured [ns].
            positions: by joint name.

        Raises:
            InvalidArgumentException: a position is not finite; the other joints are taken.
        """
        joints, refused = self._joints, ""
        with self._lock:
            for name, position in positions.items():
                if position - position:  # not zero for what is not finite
                    refused = name
                    continue
                try:
                    history = joints[name]
                except KeyError:
                    history = self._joint_history(name)
                stamps = history.stamps
                # History.insert, without the call: joints come in hundreds a second
                if stamp > stamps[-1]:
                    stamps.append(stamp)
                    history.values.append(position)
                    if len(stamps) > history.drop_at:
                        history.drop_old()
                else:
                    history.insert(stamp, position)
        if self._requests.open:
            self._serve_requests()
        if refused:
            raise InvalidArgumentException(
                f"the position of joint {refused!r} is {positions[refused]}; it must be finite"
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
    ) -> None:
        """Takes one transform, `T_parent_child`, at `stamp` [ns]; static: at any time.

        A sample older than the cache is dropped. Frames of the robot model are left to the model:
        its joints tell more than samples.

        Args:
            stamp: when it was measured [ns].
            parent: the frame that carries the other; a leading slash is dropped.
            child: the frame that is carried; a leading slash is dropped.
            transform: takes points from child into parent.
            static: it never changes.
            authority: who says so, for `all_frames_as_yaml`.

        Raises:
            InvalidArgumentException: a frame without a name, a frame that is its own parent,
                numbers that are not finite or a quaternion that is not of unit length; nothing is
                taken.
        """
        parent, child = parent.removeprefix("/"), child.removeprefix("/")
        transform = _checked(parent, child, transform)
        with self._lock:
            if self._model is not None and child in self._model.children_of_joints:
                return
            self._authorities[child] = authority
            if static:
                self._tree.add(StaticEdge(parent, child, transform))
            else:
                self._record(stamp, parent, child, transform)
        if self._requests.open:
            self._serve_requests()

    def clear(self) -> None:
        """Forgets everything recorded; the model, static transforms and frame names stay."""
        with self._lock:
            for history in self._joints.values():
                history.clear()
            for edge in self._tree.edges.values():
                if isinstance(edge, SampledEdge):
                    edge.history.clear()
            self._tree.forget_paths()

    def frames(self) -> tuple[str, ...]:
        """The names of all frames, sorted."""
        with self._lock:
            return tuple(sorted(self._tree.names))

    def all_frames_as_string(self) -> str:
        """A sentence a frame, as tf2 writes it."""
        with self._lock:
            return frames_as_string(self._tree.edges.values())

    def all_frames_as_yaml(self, now: int = 0) -> str:
        """What is known of each frame, as tf2 writes it; with delays if `now` [ns] is given."""
        with self._lock:
            return frames_as_yaml(self._tree.edges.values(), self._authorities, now)

    def tree_as_string(self, now: int = 0) -> str:
        """The tree drawn, with rates; with ages if `now` [ns] is given."""
        with self._lock:
            return tree_as_string(self._tree.edges.values(), self._tree.names, now)

    def problems(self, now: int, max_age: int) -> list[str]:
        """What keeps frames from being looked up at `now` [ns]; see `report.problems`."""
        with self._lock:
            return problems(self._tree.edges.values(), self._tree.names, now, max_age)

    def latest_joint_position(self, name: str) -> tuple[int, float] | None:
        """Stamp [ns] and position [rad or m] of the joint's newest sample, if it has one."""
        with self._lock:
            history = self._joints.get(name)
            return (history.latest, history.newest) if history else None

    def withdraw(self, request: Request) -> None:
        """Forgets a request; its callback will not be called any more."""
        with self._lock:
            self._requests.withdraw(request)

    # with the lock held

    def _joint_history(self, name: str) -> JointHistory:
        history = self._joints.get(name)
        if history is None:
            history = self._joints[name] = JointHistory(name, cache_time=self._cache_time)
        return history

    def _edge(self, model: RobotModel, joint: Joint) -> Edge:
        self._authorities.pop(joint.child, None)
        if not joint.moves:
            return StaticEdge(joint.parent, joint.child, joint.origin)
        leader = model.leader(joint.name)
        history = self._joint_history(leader.joint)
        history.continuous = model.joints[leader.joint].type is JointType.CONTINUOUS
        return JointEdge(joint, leader, history)

    def _record(self, stamp: int, parent: str, child: str, transform: Transform) -> None:
        edge = self._tree.edges.get(child)
        if not isinstance(edge, SampledEdge):
            history = TransformHistory(self._cache_time)
            history.insert(stamp, (parent, transform))
            self._tree.add(SampledEdge(child, history))
            return
        one_parent = edge.history.latest != NEVER and edge.parent == parent
        edge.history.insert(stamp, (parent, transform))
        self._tree.sampled(edge, parent, one_parent)

    # without the lock

    def _ask(self, possible: Callable[[], bool], callback: Callable[[], object]) -> Request:
        request = Request(possible, callback)
        with self._lock:
            at_once = possible()
            if not at_once:
                self._requests.add(request)
        if at_once:
            callback()
        return request

    def _wait(self, possible: Callable[[], bool], timeout: float) -> bool:
        came = threading.Event()
        request = self._ask(possible, came.set)
        if came.wait(timeout):
            return True
        self.withdraw(request)
        return came.is_set()

    def _serve_requests(self) -> None:
        with self._lock:
            fulfilled = self._requests.take_fulfilled()
        for request in fulfilled:
            request.callback()


def _checked(parent: str, child: str, transform: Transform) -> Transform:
    """The transform with its quaternion normalised."""
    if not parent or not child:
        raise InvalidArgumentException(
            f"a transform needs two frame names; got {parent!r} and {child!r}"
        )
    if parent == child:
        raise InvalidArgumentException(f"the frame {child!r} cannot be its own parent")
    if not all(map(isfinite, transform)):
        raise InvalidArgumentException(
            f"the transform of {child!r} in {parent!r} holds numbers that are not finite"
        )
    norm = math.hypot(*transform[3:])
    if abs(norm * norm - 1.0) > UNIT_TOLERANCE:
        raise InvalidArgumentException(
            f"the quaternion of {child!r} in {parent!r} has the norm {norm:.6g}; normalise it to 1"
        )
    x, y, z, w = transform[3:]
    return Transform(transform[:3], Rotation(x / norm, y / norm, z / norm, w / norm))
