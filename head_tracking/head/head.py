"""A pan/tilt head for Python programs, without ROS."""

from __future__ import annotations

import atexit
import logging
import math
import os
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any

from head_tracking.compatibility import StrEnum
from head_tracking.configuration import ConfiguredHead, configured_head
from head_tracking.control import ControlLoop
from head_tracking.control.dynamixel_backend import DynamixelBackend
from head_tracking.dynamixel import (
    BusStatistics,
    BusStoppedError,
    DynamixelPort,
    JointConfiguration,
    ServoBus,
    ServoError,
    StoppedError,
    TorqueError,
)
from head_tracking.dynamixel.bus import RESTART_TIME
from head_tracking.dynamixel.requests import Steps
from head_tracking.dynamixel.serial_port import open_serial
from head_tracking.exceptions import (
    FrameError,
    HeadTrackingError,
    RefusedCommandError,
    RefusedError,
    SupersededError,
    UnreachableError,
)
from head_tracking.gaze import PanTiltHead, PointingParameters, PointingResult
from head_tracking.gaze.head_parameters import HeadParameters
from head_tracking.head.head_control import HeadControl
from head_tracking.head.motions import (
    MotionEnd,
    MotionResult,
    PointMotion,
    Tracking,
    TrackingSettings,
)
from head_tracking.head.obstacle import Blocked
from head_tracking.parameters import changed
from head_tracking.share import robot_file, robot_parameters
from head_tracking.signals import ending_signals, postponed_signals
from head_tracking.tracking import (
    ClockWatch,
    LearnedValue,
    LearningParameters,
    Target,
    TargetState,
    Tracker,
)
from head_tracking.transforms import (
    LATEST,
    RobotModel,
    Transform,
    TransformBuffer,
    TransformException,
    Vector3,
    load_robot_model,
)

if TYPE_CHECKING:
    from typing import Self

    from head_tracking.calibration import Calibration
    from head_tracking.configuration.simulated import SimulatedJoints
    from head_tracking.vision import (
        Camera,
        CameraFollower,
        Detector,
        DistanceParameters,
        MarkerParameters,
        Pixels,
    )

__all__ = [
    "AX_12_PAIR",
    "FrameError",
    "Head",
    "HeadState",
    "HeadTrackingError",
    "JointConfiguration",
    "PointingResult",
    "RefusedCommandError",
    "SupersededError",
    "TargetState",
    "UnreachableError",
]

AX_12_PAIR = configured_head(()).servos
"""Pan and tilt of the robots that come with the package: AX-12 with the ids 1 and 2."""

_RATE = 50.0  # cycles per second
_TIMEOUT = 2.0  # s
_EXECUTION = 10.0  # s; the steps wait for cycles, which a busy machine delays
_FASTEST = 12.0  # rad/s
_LATEST = 1e11  # s since 1970; larger numbers are milliseconds or nanoseconds


class HeadState(StrEnum):
    """The states of a head that follows no target; `TargetState` has the others."""

    HOLDING = "holding"
    TURNING = "turning"
    RELAXED = "relaxed"
    STOPPED = "stopped"
    CLOSED = "closed"


class Head:
    """A pan/tilt head on Dynamixel servos; `open` and `simulated` create one.

    The servos are relaxed at first, and nothing moves before the first `look_at` or `follow`.
    `close`, the end of a `with` block and the end of the program brake and relax them. In a `with`
    block of the main thread, SIGTERM and a closed terminal raise KeyboardInterrupt, unless the
    program handles or ignores them. All methods may be called by any thread. In a fork of the
    process the head is closed.

    Args:
        port: serial port of the servos.
        model: of the robot.
        servos: pan and tilt.
        pointing_frame: the link to point: an optical frame along z, any other along x.
        baud_rate: of the port [bit/s].
        reply_timeout: how long to wait for the reply of a servo [s]; None: from the baud rate.
        open_device: see `DynamixelPort`.
        calibration: the calibration that `model` includes.

    Attributes:
        frames: the robot's frames; `frames.set_transform` adds frames of objects.
        calibration: its estimates with their deviations, its age and file; None: there is none.
        simulation: the simulated servos, which may be given play; None: real ones.

    Raises:
        DynamixelError: the port cannot be opened, a servo does not answer or is another model.
        HeadTrackingError: the model has no such head.
        TypeError: `servos` is not a pair of `JointConfiguration`.
    """

    simulation: SimulatedJoints | None = None

    def __init__(
        self,
        port: str,
        model: RobotModel,
        servos: tuple[JointConfiguration, JointConfiguration] = AX_12_PAIR,
        *,
        pointing_frame: str = "camera_link",
        baud_rate: int = 1_000_000,
        reply_timeout: float | None = None,
        open_device: Callable[[str, int], Any] = open_serial,
        calibration: Calibration | None = None,
    ) -> None:
        pan, tilt = _checked(servos)
        parameters = HeadParameters(
            pan.joint_name,
            tilt.joint_name,
            pointing_frame,
        )
        parameters.head(model)  # if there is none, the port is not opened
        self.calibration = calibration
        self.frames = TransformBuffer()
        self.frames.set_model(model)
        self._joints = pan.joint_name, tilt.joint_name
        self._loop = ControlLoop(self.frames)
        self._owners = self._loop.owners
        self._tracking = Tracking(TrackingSettings())
        self._bus = ServoBus(
            DynamixelPort(port, baud_rate, reply_timeout=reply_timeout, open_device=open_device),
            servos,
            epoch=self._owners.epoch,
        )
        self._servos = DynamixelBackend(
            [self._bus],
            self._loop,
            _RATE,
            lambda subject, text: self._control.warn(subject, f"{subject}: {text}"),
            self._check_control,
            self._fail,
        )
        self._loop.attach(self._servos)
        self._control = HeadControl(
            self._loop,
            "head",
            parameters,
            self._tracking,
            ClockWatch(time.time),
            period=1.0 / _RATE,
            log=_Log(logging.getLogger(__name__), {}),
        )
        self._process = os.getpid()
        self._failure: BaseException | None = None
        self._stopped_as = HeadState.STOPPED
        self._follower: CameraFollower | None = None
        self._signals = ExitStack()
        self._servos.connect()
        try:
            atexit.register(self.close)
            parameters.within(*map(self._servos.limits, self._joints)).head(model)
            self._control.begin()
            self._servos.start()
            self.frames.lookup_transform(self._head.base_frame, pointing_frame, timeout=_TIMEOUT)
        except TransformException:
            self.close()
            raise BusStoppedError(f"the servos on {port} answer, but cannot be read") from None
        except BaseException:  # Ctrl-C, too
            self.close()
            raise

    @classmethod
    def open(
        cls,
        port: str | Path = "/dev/ttyUSB0",
        *,
        robot: str | Path = "kinectbot",
        servos: tuple[JointConfiguration, JointConfiguration] | None = None,
        pointing_frame: str | None = None,
        baud_rate: int | None = None,
        calibration: str | Path | None = None,
    ) -> Self:
        """Open the head on a serial port.

        Args:
            port: such as /dev/ttyUSB0 or COM3.
            robot: its name in docs/start/robots.md, or a URDF or xacro file.
            servos: pan and tilt; None: as in the robot's parameter file.
            pointing_frame: see `Head`; None: as in that file.
            baud_rate: of the port [bit/s]; None: as in that file.
            calibration: a file that `calibrate` has written; None: the model is used as it is.

        Raises:
            DynamixelError: the port cannot be opened, a servo does not answer or is another model.
            HeadTrackingError: there is no such robot, it has no such head, or the calibration is
                of another robot.
        """
        model, head, known = _load_robot(robot, calibration)
        return cls(
            str(port),
            model,
            servos or head.servos,
            pointing_frame=pointing_frame or head.pointing_frame,
            baud_rate=head.baud_rate if baud_rate is None else baud_rate,
            calibration=known,
        )

    @classmethod
    def simulated(
        cls,
        *,
        robot: str | Path = "kinectbot",
        servos: tuple[JointConfiguration, JointConfiguration] | None = None,
        pointing_frame: str | None = None,
        calibration: str | Path | None = None,
    ) -> Self:
        """Open a head whose servos are simulated down to the bytes on the wire; see `open`."""
        from head_tracking.configuration.simulated import SimulatedJoints  # a robot needs none

        model, head, known = _load_robot(robot, calibration)
        joints = _checked(servos or head.servos)
        simulation = SimulatedJoints(joints)
        made = cls(
            "simulated port",
            model,
            joints,
            pointing_frame=pointing_frame or head.pointing_frame,
            open_device=simulation.open,
            calibration=known,
        )
        made.simulation = simulation
        return made

    # Commands

    def look_at(
        self,
        point: Iterable[float],
        frame: str = "base_link",
        *,
        stamp: float | None = None,
        max_velocity: float = 2.0,
        timeout: float = 10.0,
    ) -> PointingResult:
        """Turn the head to a point, and wait until the measured joints have come to rest.

        A frame that moves is followed until the head arrives, unless the head carries it.

        Args:
            point: shape (3,) [m].
            frame: the frame of `point`.
            stamp: time at which the point was there [s, as time.time()]; None: now.
            max_velocity: speed of the joint with the longer way [rad/s].
            timeout: maximum time [s], after which the head holds.

        Returns:
            Whether the head has arrived, and by how much it misses the point [rad].

        Raises:
            FrameError: the frame is not known, or was not at that time.
            UnreachableError: the point is out of reach; nothing has moved.
            RefusedCommandError: the head is or was stopped, relaxed or closed.
            SupersededError: another thread has given a newer command.
            DynamixelError: a servo does not answer, or has shut down.
            ValueError: a number is not finite, or not allowed.
        """
        max_velocity = _number("max_velocity", max_velocity)
        timeout = _number("timeout", timeout)
        if not 0.0 < max_velocity <= _FASTEST:
            raise ValueError(f"max_velocity is {max_velocity}; allowed are 0 to {_FASTEST:g} rad/s")
        if not timeout > 0.0:
            raise ValueError(f"timeout is {timeout}; allowed are times above 0 s")
        target, epoch, control = _target(point, frame, stamp), self._permit(), self._control
        self._end_following()
        place, miss = self._check(target)
        self._switch_on(epoch)
        ended: SimpleQueue[MotionResult] = SimpleQueue()
        with control.lock:
            self._permit(epoch)
            control.watch()  # the motion begins where the head is now
            motion = PointMotion(
                control,
                target,
                PointingParameters(max_velocity=max_velocity, clamp_to_limits=True),
                lambda motion: None if motion.result is None else ended.put(motion.result),
                fixed=None if stamp is None else place,
            )
            control.start(motion)
        try:
            result = ended.get(timeout=min(timeout, threading.TIMEOUT_MAX))
        except Empty:
            return PointingResult(False, miss if motion.miss is None else motion.miss)
        finally:  # also on Ctrl-C
            control.cancel(motion)
        return self._judged(motion, result)

    def follow(
        self, point: Iterable[float], frame: str = "base_link", *, stamp: float | None = None
    ) -> None:
        """Keep the head on a moving target; call this for each new measurement of the target.

        Returns at once; the head starts as soon as the servos hold.

        Args:
            point: shape (3,) [m].
            frame: the frame of `point`, such as `camera_optical_frame`.
            stamp: time of the measurement [s, as time.time()]; None: now. A camera on the head
                needs the time of its picture.

        Raises:
            FrameError: the frame is not known.
            RefusedCommandError: the head is stopped, relaxed or closed.
            ValueError: a number is not finite.
        """
        target, epoch = _target(point, frame, stamp), self._permit()
        known = self.frames.frames()
        if frame not in known:
            raise FrameError(
                frame, f"the frame {frame!r} does not exist; there are {', '.join(known)}"
            )
        self._end_following()
        self._follow(target, epoch)

    def follow_camera(
        self,
        what: str | Detector = "face",
        camera: int | str | Iterable[tuple[float, Pixels]] = 0,
        *,
        frame: str = "camera_optical_frame",
        model: Camera | None = None,
        distances: DistanceParameters | None = None,
    ) -> CameraFollower:
        """Keep the head on what a camera on it detects; returns at once. Needs OpenCV.

        It ends with the next command, including `stop` and `relax`.

        Args:
            what: face, colour or marker, or a detector of `head_tracking.vision`.
            camera: number, device, file or URL; or pictures (blue, green, red; shape (height,
                width, 3)) with the times at which they were taken [s, as time.time()].
            frame: the camera's optical frame.
            model: of the camera; None: a horizontal field of view of 60 degrees.
            distances: size or distance of the target; None: 2 m away.

        Returns:
            What is detected, and why following has ended.

        Raises:
            OpenCVMissingError: OpenCV is not installed.
            FrameError: the frame is not known.
            RefusedCommandError: the head is stopped, relaxed or closed.
            TypeError: an argument is no camera, no detector, no `Camera` or no
                `DistanceParameters`.
            ValueError: there is no such detector, or a distance is not allowed.
        """
        from head_tracking.vision import CameraFollower, checked_pictures, find_detector

        base, epoch = self._head.base_frame, self._permit()
        self.pose(frame, base)

        def check() -> None:
            with self._control.lock:
                if follower is not self._follower:
                    seen = follower.sighting
                    raise SupersededError(seen.point if seen else (math.nan,) * 3, self.error)
                self._permit(epoch)

        def follow(point: Iterable[float], stamp: float) -> None:
            with self._control.lock:
                check()
                self._follow(_target(point, frame, stamp), epoch)

        follower = CameraFollower(
            find_detector(what),
            checked_pictures(camera),
            check,
            follow,
            lambda stamp: self.pose(frame, base, stamp=stamp),
            model,
            distances,
        )
        before = self._end_following(follower)
        if before is not None:
            before.wait(_TIMEOUT)  # it may use the same camera
        follower.start()
        return follower

    def calibrate(
        self,
        camera: int | str | Iterable[tuple[float, Pixels]] = 0,
        *,
        target: str = "marker",
        marker: MarkerParameters | None = None,
        frame: str = "camera_optical_frame",
        model: Camera | None = None,
        focal_length: bool = False,
        report: Callable[[str], object] = lambda text: None,
    ) -> Calibration:
        """Measure the pose of the camera: the head looks around at most 25 times and for 90 s.

        What the camera sees must not move. `stop` in any thread ends it.

        Args:
            camera: as for `follow_camera`.
            target: what to look at: "marker", "face" (of a person who stands still) or "room" (any
                surroundings with texture).
            marker: family, number and size of the marker; not used for the other targets.
            frame: optical frame of the camera.
            model: the camera; None: a horizontal field of view of 60 degrees.
            focal_length: whether to estimate the focal length.
            report: receives progress messages.

        Returns:
            The calibration; neither files nor the model of the head are changed.

        Raises:
            CalibrationError: SciPy is not installed, no image is received, the target is not
                visible, the views contradict each other or the model, or another command turns
                the head.
            RefusedCommandError: the head is stopped, relaxed or closed.
            RefusedError: the head uses a calibration; open it without.
            FrameError: the frame is unknown, or the joints are not measured until the end.
            ValueError: there is no such target or marker, the marker has no size, the model is for
                other images, or the times of the images are of another clock.
            TypeError: an argument is no camera, no `MarkerParameters` or no `Camera`.
        """
        from head_tracking.calibration.gathering import calibrate_camera

        if self.calibration is not None:
            raise RefusedError(
                "this head uses a calibration: open it without, to calibrate the camera anew"
            )
        epoch = self._permit()
        calibration = calibrate_camera(
            self, camera, target=target, marker=marker, frame=frame, model=model,
            focal_length=focal_length, report=report,
        )  # fmt: skip
        self._permit(epoch)  # else it was stopped or relaxed before the end
        return calibration

    def learn(
        self,
        how: str = "learn",
        *,
        servos: str | None = None,
        camera: str | None = None,
        servo_delay: float = 0.0,
        servo_dead_band: float = 0.0,
        servo_acceleration: float = 0.0,
        camera_delay: float | None = None,
    ) -> None:
        """Choose what tracking learns: "learn", "freeze" (use and keep) or "forget" (learn anew).

        Args:
            how: for both.
            servos: for the servo models only; None: `how`.
            camera: for the timing of a camera on the head only; None: `how`.
            servo_delay: from a command to the motion [s], given by hand; 0: learned.
            servo_dead_band: how far a servo stays behind its goal [rad], likewise.
            servo_acceleration: how hard a servo accelerates its joint [rad/s^2], likewise.
            camera_delay: by how much the stamps of a camera on the head are too late [s], given by
                hand; 0: they are right; None: learned.

        Raises:
            ValueError: there is no such mode, or a value is out of its range.
        """
        both = {"servo_learning": str(how), "camera_learning": str(how)}
        given = {
            "servo_learning": str(how if servos is None else servos),
            "camera_learning": str(how if camera is None else camera),
            "servo_delay": servo_delay,
            "servo_dead_band": servo_dead_band,
            "servo_acceleration": servo_acceleration,
        }
        if camera_delay is not None:
            given["camera_delay"] = camera_delay
        learning = changed(changed(LearningParameters(), both), given)
        with self._control.lock:
            self._tracking.tune(TrackingSettings(learning=learning))

    def hold(self) -> None:
        """End the present motion, also that of another thread; the head stays where it is."""
        self._end_following()
        self._control.hold("superseded")

    def stop(self) -> Mapping[str, str]:
        """STOP: relax all servos at once, and refuse every command until `resume`.

        Returns:
            The problem of each joint; empty if its servo has confirmed.
        """
        if self._is_in_fork:
            return dict.fromkeys(self._joints, "the head belongs to another process")
        self._stopped_as = HeadState.STOPPED
        with postponed_signals():
            return self._loop.stop()

    def relax(self) -> None:
        """Switch off the torque, and refuse commands until `resume`.

        Raises:
            DynamixelError: a servo has not confirmed.
            RefusedCommandError: the head is closed.
        """
        self._require_open()
        self._end_following()
        if not self._owners.stopped:
            self._stopped_as = HeadState.RELAXED
        with postponed_signals():
            problems = self._owners.stop(lambda: self._servos.relax_now(_TIMEOUT))
        if any(problems.values()):
            raise TorqueError(False, {joint: each for joint, each in problems.items() if each})

    def resume(self) -> None:
        """End a `stop` or a `relax`: the servos hold where they are, and commands are accepted.

        After a `stop` the head moves slowly until it has arrived once.

        Raises:
            DynamixelError: a servo has not confirmed; a head that was stopped or relaxed stays so.
            RefusedCommandError: the head is closed, or was stopped or relaxed meanwhile.
        """
        self._require_open()
        owners = self._owners
        epoch, stopped = owners.epoch.value, owners.stopped
        try:
            self._switch_on(epoch)
        except RefusedCommandError:
            raise
        except BaseException:
            if stopped and epoch == owners.epoch.value:
                self._loop.stop()
            raise
        try:
            with self._control.lock:
                owners.resume(epoch)
                self._control.enable(cautious=self._stopped_as is HeadState.STOPPED)
                self._stopped_as = HeadState.STOPPED
        except StoppedError:
            raise RefusedCommandError(self._stopped_as) from None

    def recover(self) -> None:
        """Clear the faults of servos that have shut down; the next target turns them again.

        Raises:
            DynamixelError: a servo does not recover.
            RefusedCommandError: the head is closed, or was stopped or relaxed meanwhile.
        """
        self._require_open()
        request = partial(ServoBus.recovering, patience=RESTART_TIME)
        self._execute(request, self._owners.epoch.value)

    def close(self) -> None:
        """Brake and relax the servos and close the port; may be called twice.

        Ctrl-C meanwhile is raised after that.

        Raises:
            DynamixelError: a servo has not confirmed that it is relaxed.
        """
        if self._is_in_fork:
            return
        with postponed_signals():
            atexit.unregister(self.close)
            self._control.release(Blocked.CLOSED)
            problems = self._servos.close()
            if self._control.lock.acquire(timeout=_TIMEOUT):  # else a callback that hangs has it
                self._control.disable(Blocked.CLOSED)
                self._control.save()
                self._control.lock.release()
        if problems:
            raise BusStoppedError("; ".join(problems))

    def __enter__(self) -> Self:
        self._require_open()
        self._signals.enter_context(ending_signals())
        return self

    def __exit__(self, *_: object) -> None:
        with self._signals:
            self.close()

    # State

    @property
    def state(self) -> HeadState | TargetState:
        """What the head does now."""
        if (refusing := self._refusing) is not None:
            return refusing
        if self._control.motion is not self._tracking:
            return HeadState.TURNING
        state = TargetState.IDLE if self._control.trouble else self._tracker.state
        return HeadState.HOLDING if state is TargetState.IDLE else state

    @property
    def reason(self) -> str:
        """Why the head cannot move now, has its state, or refuses targets; empty: none of these."""
        machine, obstacle = self._tracker.machine, self._control.obstacle
        if self._refusing is HeadState.RELAXED:
            return str(RefusedCommandError(HeadState.RELAXED))
        if obstacle is not None:
            return str(obstacle)
        return machine.refusal if machine.state is TargetState.IDLE else machine.reason

    @property
    def error(self) -> float | None:
        """Angle between the pointing axis and the target [rad]; None: there is no target."""
        return self._control.error

    @property
    def joints(self) -> Mapping[str, float]:
        """The measured positions of pan and tilt [rad].

        Raises:
            DynamixelError: the servos have not answered since the clock jumped.
        """
        return dict(zip(self._joints, self._positions(), strict=True))

    @property
    def learned(self) -> Mapping[str, LearnedValue]:
        """What tracking has learned of the servos and of a camera on the head, by name."""
        with self._control.lock:
            return self._tracker.learned

    @property
    def statistics(self) -> BusStatistics:
        """Counters of the bus, and the latest measurements of each servo."""
        return self._bus.statistics()

    def pose(self, link: str, frame: str = "base_link", *, stamp: float | None = None) -> Transform:
        """Return `T_frame_link`, the pose of a link.

        Args:
            link: of the robot, or another frame.
            frame: in which its pose is expressed.
            stamp: time [s, as time.time()]; waits for the joints of that time. None: the latest.

        Raises:
            FrameError: a frame is unknown, or was not known at that time.
            ValueError: the time is not finite.
        """
        at = _nanoseconds(stamp)
        can_come = at and all(at >= self.frames.oldest_joint_stamp(name) for name in self._joints)
        try:
            found = self.frames.lookup_transform(frame, link, at, _TIMEOUT if can_come else 0.0)
        except TransformException as error:
            unknown = link if frame in self.frames.frames() else frame
            raise FrameError(unknown, str(error)) from error
        return found.transform

    # Private

    @property
    def _head(self) -> PanTiltHead:
        assert self._control.frames.head is not None  # the constructor has set it
        return self._control.frames.head

    @property
    def _tracker(self) -> Tracker:
        assert self._tracking.tracker is not None
        return self._tracking.tracker

    def _positions(self) -> tuple[float, float]:
        pan, tilt = (self.frames.latest_joint_position(name) for name in self._joints)
        if pan is None or tilt is None:  # the constructor has waited for them
            raise BusStoppedError("the servos have not answered since the clock jumped")
        return pan[1], tilt[1]

    def _check(self, target: Target) -> tuple[Vector3, float]:
        """Return a target in the head's base frame [m], and by how much the head misses it [rad].

        It may wait for the joints of the target's stamp.

        Raises:
            FrameError: the frame is not known, or was not at that time.
            UnreachableError: the target is out of reach.
        """
        head, frame = self._head, target.frame_id
        stamp = target.stamp * 1e-9 if target.stamp else None
        point = self.pose(frame, head.base_frame, stamp=stamp) @ target.point
        joints = self._positions()
        gaze = head.gaze(point, *joints)
        if not gaze.reached:
            miss = head.miss(point, gaze.pan, gaze.tilt)
            raise UnreachableError(target.point, frame, miss, gaze.reason)
        return point, head.miss(point, *joints)

    def _judged(self, motion: PointMotion, result: MotionResult) -> PointingResult:
        """Return the result of a motion for the program, or raise it as an error."""
        target, miss, end = motion.target, motion.miss, result.end
        if end in (MotionEnd.SUCCEEDED, MotionEnd.MISSED) and miss is not None:
            return PointingResult(end is MotionEnd.SUCCEEDED, miss)
        if end is MotionEnd.PREEMPTED:
            raise SupersededError(target.point, miss)
        if end is MotionEnd.UNREACHABLE:
            raise UnreachableError(target.point, target.frame_id, miss or math.pi, result.reason)
        if end is MotionEnd.NO_TRANSFORM:
            raise FrameError(target.frame_id, result.reason)
        if end is MotionEnd.DISABLED:
            raise RefusedCommandError(self._refusing or self._stopped_as) from self._failure
        raise BusStoppedError(result.reason)

    @property
    def _is_in_fork(self) -> bool:
        """Whether this is a copy of the head, without the threads that drive the servos."""
        return os.getpid() != self._process

    @property
    def _refusing(self) -> HeadState | None:
        """The state in which commands are refused; None: they are accepted."""
        if self._is_in_fork:
            return HeadState.CLOSED
        off = self._control.off
        if off is None:
            return None
        return HeadState.CLOSED if off.reason is Blocked.CLOSED else self._stopped_as

    def _require_open(self) -> None:
        if self._refusing is HeadState.CLOSED:
            raise RefusedCommandError(HeadState.CLOSED)

    def _permit(self, epoch: int | None = None) -> int:
        """Return the epoch of a command that is given now; refuse one of an earlier epoch."""
        if (refusing := self._refusing) is not None:
            raise RefusedCommandError(refusing) from self._failure
        try:
            return self._owners.permit(epoch)
        except StoppedError:
            raise RefusedCommandError(self._stopped_as) from None

    def _switch_on(self, epoch: int) -> None:
        self._execute(partial(ServoBus.switching_torque, on=True), epoch)

    def _execute(
        self, request: Callable[[ServoBus, tuple[str, ...]], Steps[Any]], epoch: int
    ) -> None:
        """Let each bus execute a request, and wait until all have; not after a STOP."""
        requests: list[Future[Any]] = []
        done = SimpleQueue[Future[Any]]()
        try:
            # Ctrl-C in a method of a future could leave a lock locked, which the bus needs
            with postponed_signals():
                requests += self._servos.call(None, request, epoch)
                for future in requests:
                    future.add_done_callback(done.put)
            for _ in requests:
                done.get(timeout=_EXECUTION).result()
        except Empty:
            raise BusStoppedError(f"no servo has confirmed within {_EXECUTION} s") from None
        except (StoppedError, ServoError, BusStoppedError) as error:
            self._require_open()
            if isinstance(error, StoppedError) or epoch != self._owners.epoch.value:
                raise RefusedCommandError(self._stopped_as) from None
            raise
        finally:
            with postponed_signals():
                for future in requests:  # one that is late switches nothing on later
                    future.cancel()

    def _end_following(self, follower: CameraFollower | None = None) -> CameraFollower | None:
        """End and return the camera that controls the head; another one replaces it, or none."""
        with self._control.lock:
            before, self._follower = self._follower, follower
        return before

    def _follow(self, target: Target, epoch: int) -> None:
        with self._control.lock:
            self._permit(epoch)
            if self._control.motion is not self._tracking:
                self._control.hold("superseded")
            self._control.accept(target)

    def _check_control(self, *_: object) -> None:
        if self._control.failure is not None:
            raise self._control.failure

    def _fail(self, error: BaseException) -> None:
        """Close the head after a failure of the port, which has relaxed the servos if possible."""
        self._failure = error
        self._control.disable(Blocked.CLOSED)


class _Log(logging.LoggerAdapter):  # type: ignore[type-arg]  # Python 3.10
    """Logs; a handler of the program that fails costs its message, not the control thread."""

    def log(self, *message: Any, **options: Any) -> None:
        try:
            super().log(*message, **options)
        except Exception:
            if threading.current_thread() is threading.main_thread():
                raise  # it may be from a handler of a signal


def _load_robot(
    robot: str | Path, calibration: str | Path | None
) -> tuple[RobotModel, ConfiguredHead, Calibration | None]:
    """Return the calibrated model, the configured head and the calibration of a robot."""
    name, known = str(robot), None
    model = load_robot_model(robot_file(name))
    if calibration is not None:
        from head_tracking.calibration import Calibration

        known = Calibration.load(calibration)
        model = known.apply(model)
    return model, configured_head(robot_parameters(name)), known


def _checked(servos: object) -> tuple[JointConfiguration, JointConfiguration]:
    match servos:
        case (JointConfiguration() as pan, JointConfiguration() as tilt):
            return pan, tilt
    raise TypeError(f"servos is {servos!r}; give a JointConfiguration for pan and one for tilt")


def _target(point: Iterable[float], frame: str, stamp: float | None) -> Target:
    try:
        x, y, z = map(float, () if isinstance(point, str | bytes) else point)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"the point is {point!r}; give x, y and z in metres") from None
    if not isinstance(frame, str):
        raise TypeError(f"a frame name is a str; {frame!r} is a {type(frame).__name__}")
    target = Target(_nanoseconds(stamp), frame, (x, y, z))
    try:
        target.check()
    except ValueError as error:
        raise ValueError(f"the point {target} is refused: {error}") from None
    return target


def _nanoseconds(stamp: float | None) -> int:
    """Convert a time [s] to a stamp [ns]; None: the latest."""
    if stamp is None:
        return LATEST
    seconds = _number("stamp", stamp)
    if not abs(seconds) < _LATEST:
        raise ValueError(f"stamp is {stamp}; give seconds since 1970, as time.time() does")
    return round(seconds * 1e9)


def _number(name: str, value: float) -> float:
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name} is {value!r}; it must be a number") from None
