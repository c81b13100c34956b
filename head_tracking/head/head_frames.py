"""Targets of one head: transformed into its frames, at their stamps."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

from head_tracking.gaze import PanTiltHead
from head_tracking.gaze.head_parameters import HeadParameters, Limits
from head_tracking.tracking import HeadBase, Target, TargetPlacer
from head_tracking.transforms import (
    LATEST,
    RobotModel,
    RobotModelError,
    TransformBuffer,
    TransformException,
    Vector3,
)

_MOST_KEPT = 1000  # transformed targets, until `take_recent`


class HeadFrames(TargetPlacer):
    """The model of a head, and the transforms of its targets.

    Targets are transformed into the frame `fixed_frame`, which stands still, with the joints at
    the stamp of each target. A target waits up to `transform_timeout` for its transforms.

    Attributes:
        head: the head of the model; None: no model is known.
        base: where the head's base is in `fixed_frame`; None: they are the same frame.
        target: the latest target that was transformed.
    """

    def __init__(self, buffer: TransformBuffer, parameters: HeadParameters) -> None:
        super().__init__(buffer, "", parameters.transform_timeout)
        self.head: PanTiltHead | None = None
        self.base: HeadBase | None = None
        self.target: Target | None = None
        self._given = self._parameters = parameters
        self._joints = parameters.head_pan_joint, parameters.head_tilt_joint
        self._model: RobotModel | None = None
        self._latency = round(parameters.target_latency * 1e9)
        self._recent: deque[tuple[float, Vector3]] = deque(maxlen=_MOST_KEPT)

    def use(self, model: RobotModel, limits: Limits) -> PanTiltHead:
        """Use the head of a model from now on, within further limits of pan and tilt.

        Raises:
            RobotModelError: the model has no such head, or the limits leave nothing.
        """
        p = self._given.within(*limits)
        head = p.head(model)
        fixed_frame = p.fixed_frame or head.base_frame
        if fixed_frame in model.links and any(
            joint.name in self._joints for joint in model.joints_above(fixed_frame)
        ):
            raise RobotModelError(
                f"fixed_frame is {fixed_frame!r}, which moves with the head; choose a frame that "
                f"stands still, such as {head.base_frame} or odom"
            )
        self.head, self._model, self._parameters = head, model, p
        self._fixed_frame = fixed_frame
        self.forget()
        moves = fixed_frame != head.base_frame
        self.base = HeadBase(self._buffer, fixed_frame, head.base_frame) if moves else None
        return head

    def pointing(self, frame: str, axis: tuple[float, float, float]) -> PanTiltHead:
        """Return the head, pointing another frame.

        Args:
            frame: any frame that the head carries; empty: the usual one.
            axis: the direction in that frame; all 0: its usual one.

        Raises:
            RobotModelError: the head cannot point it.
        """
        assert self._model is not None
        assert self.head is not None
        if not any(axis) and frame in ("", self._parameters.pointed):
            return self.head
        return self._parameters.head(self._model, frame, axis)

    # A stream of targets

    def take(
        self, now: float, positions: tuple[float, float], *, latest_only: bool = False
    ) -> list[tuple[Target, Vector3]]:
        """Return the targets that can be transformed now, and their points in `fixed_frame` [m].

        Args:
            now: the time [s].
            positions: pan and tilt [rad] for a target without a stamp that the head carries.
            latest_only: see `TargetPlacer.place`.
        """
        joints = dict(zip(self._joints, positions, strict=True))
        placed = self.place(now, joints, latest_only=latest_only)
        for target, point in placed:
            self.target = target
            self._recent.append((target.stamp * 1e-9 if target.stamp else now, point))
        return placed

    def take_recent(self) -> list[tuple[float, Vector3]]:
        """Return the targets since the last call: stamps [s], points in the head's base [m]."""
        recent = []
        while self._recent:
            stamp, point = self._recent.popleft()
            base = self.base
            recent.append((stamp, point if base is None else base.at(stamp).inverse() @ point))
        return recent

    # One target

    def moves_with_head(self, frame_id: str) -> bool:
        """Return whether a frame moves when pan and tilt do."""
        return self._buffer.is_moved_by(frame_id, self._joints)

    def in_fixed_frame(self, target: Target, positions: tuple[float, float]) -> Vector3:
        """Return a target in `fixed_frame` [m], at its stamp; for `positions` see `take`.

        Raises:
            TransformException: its transform is not known, or not yet.
        """
        joints = dict(zip(self._joints, positions, strict=True))
        return self.place_one(self.corrected(target), joints)

    def in_base(self, point: Vector3, now: float) -> Vector3:
        """Return a point of `fixed_frame` in the head's base frame as that is now [m].

        Raises:
            TransformException: the pose of the base is not known.
        """
        if self.base is None:
            return point
        unknown = self.base.update()
        if unknown:
            raise TransformException(unknown)
        return self.base.pose(now).inverse() @ point

    def latest_in_base(self, target: Target) -> tuple[Vector3, float | None]:
        """Return a target in the head's base frame by the latest transforms, and their time [s].

        The time is None if all of them are fixed.

        Raises:
            TransformException: a transform is not known.
        """
        assert self.head is not None
        found = self._buffer.lookup_transform(self.head.base_frame, target.frame_id, LATEST)
        return found.transform @ target.point, found.stamp * 1e-9 if found.stamp else None

    def corrected(self, target: Target) -> Target:
        """Return the target with `target_latency` taken off its stamp."""
        if not (self._latency and target.stamp):
            return target
        return replace(target, stamp=max(1, target.stamp - self._latency))
