"""All frames, over time: what tf2's buffer does, and the joints of the model at lookup."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from head_tracking.transforms.exceptions import (
    InvalidArgumentException,
    TimeoutException,
    TransformException,
)
from head_tracking.transforms.frame_store import FrameStore
from head_tracking.transforms.history import NEVER
from head_tracking.transforms.path import LATEST, seconds
from head_tracking.transforms.requests import Request
from head_tracking.transforms.rotation import Vector3
from head_tracking.transforms.transform import StampedTransform, Transform
from head_tracking.transforms.velocity import StampedVelocity, moved_to, velocity_between


class TransformBuffer(FrameStore):
    """A tree of frames over the last `cache_time` [ns]; safe to use from several threads.

    Frames come from a robot model and its joint positions, and from transforms set one by one.
    `lookup_transform(target, source)` gives the transform that takes points from source into
    target. Stamps are nanoseconds; the stamp 0 asks for the latest common time. Nothing is ever
    extrapolated.
    """

    def lookup_transform(
        self,
        target_frame: str,
        source_frame: str,
        stamp: int = LATEST,
        timeout: float = 0.0,
        *,
        joint_positions: Mapping[str, float] | None = None,
    ) -> StampedTransform:
        """`T_target_source` at `stamp` [ns].

        Args:
            target_frame: the frame to express points in.
            source_frame: the frame in which points are given.
            stamp: the time [ns]; 0 for the latest common time.
            timeout: how long to wait for what is not known yet [s]; it has to come from another
                thread.
            joint_positions: joints taken to stand at these positions [rad or m] instead of at
                the recorded ones.

        Raises:
            LookupException: an unknown frame, a joint of which nothing is known yet, or a loop.
            ConnectivityException: the frames are in different trees.
            ExtrapolationException: the time lies outside the recorded history.
            InvalidArgumentException: an impossible frame name.
        """
        if timeout > 0.0:
            self._wait(lambda: self._possible(target_frame, source_frame, stamp), timeout)
        with self._lock:
            path = self._tree.paths.get((target_frame, source_frame))
            if path is not None and joint_positions is None:
                found = path.at(stamp) if stamp else path.latest()
                if found is not None:
                    return found
            return self._lookup(target_frame, source_frame, stamp, joint_positions)

    def lookup_transform_full(
        self,
        target_frame: str,
        target_stamp: int,
        source_frame: str,
        source_stamp: int,
        fixed_frame: str,
        timeout: float = 0.0,
    ) -> StampedTransform:
        """From source at one time to target at another, through a frame that stands still.

        Args:
            target_frame: the frame to express points in.
            target_stamp: the time of the target frame [ns]; 0 for the latest common time.
            source_frame: the frame in which points are given.
            source_stamp: the time of the source frame [ns]; 0 for the latest common time.
            fixed_frame: the frame that is taken to stand still between the two times.
            timeout: how long to wait for what is not known yet [s].

        Raises:
            TransformException: as for `lookup_transform`.
        """
        if timeout > 0.0:
            full = target_frame, target_stamp, source_frame, source_stamp, fixed_frame
            self._wait(lambda: self._possible_full(*full), timeout)
        with self._lock:
            for frame in (target_frame, source_frame, fixed_frame):
                self._tree.check(frame)
        T_fixed_source = self.lookup_transform(fixed_frame, source_frame, source_stamp)
        T_target_fixed = self.lookup_transform(target_frame, fixed_frame, target_stamp)
        return StampedTransform(
            T_target_fixed.stamp,
            target_frame,
            source_frame,
            T_target_fixed.transform @ T_fixed_source.transform,
        )

    def transform_point(
        self, point: Sequence[float], target_frame: str, source_frame: str, stamp: int = LATEST
    ) -> Vector3:
        """The point, shape (3,) [m], given in `source_frame` at `stamp`, in `target_frame`.

        Raises:
            TransformException: as for `lookup_transform`.
        """
        return self.locate(point, target_frame, source_frame, stamp)[1:]

    def locate(
        self, point: Sequence[float], target_frame: str, source_frame: str, stamp: int = LATEST
    ) -> tuple[int, float, float, float]:
        """As `transform_point`, with the time [ns] for which the answer holds before x, y, z.

        Raises:
            TransformException: as for `lookup_transform`.
        """
        x, y, z = point
        with self._lock:
            path = self._tree.paths.get((target_frame, source_frame))
            if path is not None:
                found = path.point_at(stamp, x, y, z) if stamp else path.point_latest(x, y, z)
                if found is not None:
                    return found
            if target_frame == source_frame:
                return stamp or self._latest_of(source_frame), x, y, z
            path, stamp = self._tree.find(target_frame, source_frame, stamp)
            return path.locate(stamp, (x, y, z))

    def transform_points(
        self, points: npt.ArrayLike, target_frame: str, source_frame: str, stamp: int = LATEST
    ) -> npt.NDArray[np.float64]:
        """Many points at once, shape (N, 3) [m], in `target_frame`, shape (N, 3).

        Raises:
            TransformException: as for `lookup_transform`.
        """
        found = self.lookup_transform(target_frame, source_frame, stamp)
        return found.transform.apply_many(points)

    def lookup_velocity(
        self,
        tracking_frame: str,
        observation_frame: str,
        stamp: int,
        averaging_interval: int,
        reference_frame: str = "",
        reference_point: Vector3 = (0.0, 0.0, 0.0),
        reference_point_frame: str = "",
    ) -> StampedVelocity:
        """How `tracking_frame` moves as seen from `observation_frame`.

        The mean over an interval around `stamp`, which ends at the latest common time at the
        latest. tf2 turns and moves the vectors once too often if the frames are turned against
        each other; here they are what physics says.

        Args:
            tracking_frame: the frame that moves.
            observation_frame: the frame that is taken to stand still.
            stamp: the middle of the interval [ns]; 0: it ends at the latest common time.
            averaging_interval: its length [ns].
            reference_frame: the frame of the answer's vectors; default: the observation frame.
            reference_point: the point of the body whose velocity is asked for [m].
            reference_point_frame: the frame of that point; default: the tracking frame.

        Raises:
            InvalidArgumentException: the interval is not above 0.
            TransformException: as for `lookup_transform`.
        """
        if averaging_interval <= 0:
            raise InvalidArgumentException(
                f"the averaging interval is {averaging_interval} ns; it must be above 0"
            )
        reference_frame = reference_frame or observation_frame
        latest = self.get_latest_common_time(observation_frame, tracking_frame)
        end = min(stamp + averaging_interval // 2, latest) if stamp else latest
        start = end - averaging_interval
        if latest == LATEST:
            still = (0.0, 0.0, 0.0)
            return StampedVelocity(stamp, reference_frame, tracking_frame, still, still)
        linear, angular = velocity_between(
            self.lookup_transform(observation_frame, tracking_frame, start).transform,
            self.lookup_transform(observation_frame, tracking_frame, end).transform,
            averaging_interval * 1e-9,
        )
        middle = start + averaging_interval // 2
        turned = self.lookup_transform(
            reference_frame, observation_frame, middle
        ).transform.rotation
        linear, angular = turned @ linear, turned @ angular
        origin = self.transform_point((0.0, 0.0, 0.0), reference_frame, tracking_frame, middle)
        point = self.transform_point(
            reference_point, reference_frame, reference_point_frame or tracking_frame, middle
        )
        away = (point[0] - origin[0], point[1] - origin[1], point[2] - origin[2])
        linear = moved_to(away, linear, angular)
        return StampedVelocity(middle, reference_frame, tracking_frame, linear, angular)

    def can_transform(
        self, target_frame: str, source_frame: str, stamp: int = LATEST, timeout: float = 0.0
    ) -> bool:
        """Whether `lookup_transform` would answer, at the latest after `timeout` [s]."""
        return self.why_not(target_frame, source_frame, stamp, timeout) == ""

    def why_not(
        self, target_frame: str, source_frame: str, stamp: int = LATEST, timeout: float = 0.0
    ) -> str:
        """Why `lookup_transform` would not answer; empty if it would."""
        try:
            self.lookup_transform(target_frame, source_frame, stamp, timeout)
        except TransformException as error:
            return str(error)
        return ""

    def get_latest_common_time(self, target_frame: str, source_frame: str) -> int:
        """The newest time [ns] at which both frames are known; 0 if nothing ever changes.

        Raises:
            TransformException: there is none.
        """
        with self._lock:
            if target_frame == source_frame:
                self._tree.check(source_frame)
                return self._latest_of(source_frame)
            path, _ = self._tree.find(target_frame, source_frame, LATEST)
            return path.latest_common_time

    def when_transformable(
        self,
        target_frame: str,
        source_frame: str,
        stamp: int,
        callback: Callable[[], object],
    ) -> Request:
        """Calls back once, as soon as `lookup_transform` would answer; maybe at once.

        Args:
            target_frame: as for `lookup_transform`.
            source_frame: as for `lookup_transform`.
            stamp: as for `lookup_transform`.
            callback: called in the thread that brings what was missing; it may use the buffer.

        Returns:
            What `withdraw` takes.
        """
        return self._ask(lambda: self._possible(target_frame, source_frame, stamp), callback)

    def when_transformable_full(
        self,
        target_frame: str,
        target_stamp: int,
        source_frame: str,
        source_stamp: int,
        fixed_frame: str,
        callback: Callable[[], object],
    ) -> Request:
        """As `when_transformable`, for `lookup_transform_full`."""
        full = target_frame, target_stamp, source_frame, source_stamp, fixed_frame
        return self._ask(lambda: self._possible_full(*full), callback)

    def wait_for_transform(
        self, target_frame: str, source_frame: str, stamp: int, timeout: float
    ) -> None:
        """Waits until `lookup_transform` would answer.

        Raises:
            TimeoutException: it would not within `timeout` [s]; says why.
        """
        if not self._wait(lambda: self._possible(target_frame, source_frame, stamp), timeout):
            raise TimeoutException(
                f"waited {timeout:.3f} s for the transform from {source_frame!r} to "
                f"{target_frame!r} at {'the latest time' if not stamp else seconds(stamp)}: "
                + self.why_not(target_frame, source_frame, stamp)
            )

    # with the lock held

    def _lookup(
        self,
        target_frame: str,
        source_frame: str,
        stamp: int,
        joint_positions: Mapping[str, float] | None,
    ) -> StampedTransform:
        if target_frame == source_frame:
            stamp = stamp or self._latest_of(source_frame)
            return StampedTransform(stamp, target_frame, source_frame, Transform.identity())
        path, stamp = self._tree.find(target_frame, source_frame, stamp)
        if joint_positions is None:
            return path.lookup(stamp)
        return path.lookup_given(stamp, joint_positions)

    def _latest_of(self, frame: str) -> int:
        edge = self._tree.edges.get(frame)
        if edge is None or edge.history is None or edge.history.latest == NEVER:
            return LATEST
        return edge.history.latest

    def _possible(self, target_frame: str, source_frame: str, stamp: int) -> bool:
        if target_frame == source_frame:
            return True
        try:
            path, stamp = self._tree.find(target_frame, source_frame, stamp)
            path.lookup(stamp)
        except TransformException:
            return False
        return True

    def _possible_full(
        self,
        target_frame: str,
        target_stamp: int,
        source_frame: str,
        source_stamp: int,
        fixed_frame: str,
    ) -> bool:
        return self._possible(fixed_frame, source_frame, source_stamp) and self._possible(
            target_frame, fixed_frame, target_stamp
        )
