"""A pan/tilt head for Python programs, without ROS.

with Head.open("/dev/ttyUSB0", robot="kinectbot") as head:
result = head.look_at((1.0, 0.3, 0.8), frame="base_link")
print(result.arrived, result.miss)
"""

from __future__ import annotations

import atexit
import logging
import math
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeoutError
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from head_tracking.compatibility import StrEnum
from head_tracking.configuration import ConfiguredHead, configured_head
from head_tracking.control import ControlLoop, JointOwners
from head_tracking.control.dynamixel_backend import DynamixelBackend
from head_tracking.dynamixel import (
    BusStatistics,
    BusStoppedError,
    DynamixelPort,
    JointConfiguration,
    ServoBus,
    StoppedError,
)
from head_tracking.exceptions import (
    FrameError,
    HeadTrackingError,
    RefusedCommandError,
    SupersededError,
    UnreachableError,
)
from head_tracking.gaze import PanTiltHead, PointingParameters, PointingResult
from head_tracking.head.head_control import HeadControl
from head_tracking.head.head_parameters import HeadParameters
from head_tracking.head.modes import Following, FollowingSettings
from head_tracking.head.tasks import HeadTask, PointTask, TaskEnd
from head_tracking.parameters import checked, parameter_info
from head_tracking.share import robot_file, robot_parameters
from head_tracking.tracking import (
    ClockWatch,
    LearnedValue,
    Learning,
    PredictiveLawParameters,
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
    load_robot_model,
)

if TYPE_CHECKING:
    from typing import Self

    from head_tracking.calibration import Calibration
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
_PATIENCE = 2.0  # s
_SIMULATED_REPLY = 0.1  # s: simulated servos share a process with the driver
_T = TypeVar("_T")


class HeadState(StrEnum):
    """What a head does when it follows no target; see `TargetState` for when it does."""

    HOLDING = "holding"
    TURNING = "turning"
    RELAXED = "relaxed"
    STOPPED = "stopped"
    CLOSED = "closed"


class Head:
    """A pan/tilt head on Dynamixel servos; `open` and `simulated` make one.

    The servos start relaxed, and nothing moves before the first `look_at` or `follow`. `close`, the
    end of a `with` block and the end of the program brake and relax them. All methods may be called
    by any thread.

    Args:
        port: serial port of the servos.
        model: of the robot.
        servos: of pan and tilt.
        pointing_frame: the link that is pointed: an optical frame along z, any other along x.
        baud_rate: of the port [bit/s].
        reply_timeout: how long to wait for a servo's answer [s]; None: as long as answers take.
        resources: closed after the port.
        calibration: that the model already has.

    Attributes:
        frames: the robot's frames; `frames.set_transform` adds those of objects.
        calibration: its estimates with their deviations, its age and file; None: there is none.

    Raises:
        DynamixelError: the port cannot be opened, a servo does not answer or is another model.
        HeadTrackingError: the model has no such head.
    """

    def __init__(
        self,
        port: str,
        model: RobotModel,
        servos: tuple[JointConfiguration, JointConfiguration] = AX_12_PAIR,
        *,
        pointing_frame: str = "camera_link",
        baud_rate: int = 1_000_000,
        reply_timeout: float | None = None,
        resources: ExitStack | None = None,
        calibration: Calibration | None = None,
    ) -> None:
        pan, tilt = servos
        self.calibration = calibration
        self.frames = TransformBuffer()
        self.frames.set_model(model)
        self._pan, self._tilt = pan.joint_name, tilt.joint_name
        self._owners = JointOwners()
        self._loop = ControlLoop(self.frames, self._owners)
        self._settings = FollowingSettings()
        self._following = Following(lambda: self._settings)
        self._bus = ServoBus(
            DynamixelPort(port, baud_rate, reply_timeout=reply_timeout),
            servos,
            epoch=self._owners.epoch,
        )
        self._servos = DynamixelBackend([self._bus], self._loop, _RATE, self._report)
        self._servos.connect()
        self._loop.attach(self._servos)
        self._control = HeadControl(
            self._loop,
            "head",
            HeadParameters(
                self._pan,
                self._tilt,
                min_pan=pan.lower,
                max_pan=pan.upper,
                min_tilt=tilt.lower,
                max_tilt=tilt.upper,
            ),
            pointing_frame,
            self._following,
            ClockWatch(time.time),
            period=1.0 / _RATE,
            log=logging.getLogger(__name__),
        )
        self._control.use(model)
        self._control.begin()
        self._relaxed = self._closed = False
        self._failure: BaseException | None = None
        self._leading = threading.Lock()
        self._follower: CameraFollower | None = None
        self._resources = resources or ExitStack()
        atexit.register(self._close)
        self._servos.start(self._check_control, self._fail)
        if not self._servos.measured.wait(_PATIENCE):
            self.close()
            raise BusStoppedError(f"the servos on {port} answer, but cannot be read")

    @classmethod
    def open(
        cls,
        port: str = "/dev/ttyUSB0",
        *,
        robot: str | Path = "kinectbot",
        servos: tuple[JointConfiguration, JointConfiguration] | None = None,
        pointing_frame: str | None = None,
        baud_rate: int | None = None,
        calibration: str | Path | None = None,
    ) -> Self:
        """Open the head on a serial port.

        Args:
            port: such as /dev/ttyUSB0, or COM3.
            robot: its name (see `robot_names`), or a URDF or xacro file.
            servos: of pan and tilt; None: as the robot's parameter file says.
            pointing_frame: see `Head`; None: as that file says.
            baud_rate: of the port [bit/s]; None: as that file says.
            calibration: a file that `calibrate` has made; None: the model is right.

        Raises:
            DynamixelError: the port cannot be opened, a servo does not answer or is another model.
            HeadTrackingError: there is no such robot, or it has no such head; or the calibration
                is of another one.
        """
        model, head, known = _known_robot(str(robot), calibration)
        return cls(
            port,
            model,
            servos or head.servos,
            calibration=known,
            pointing_frame=pointing_frame or head.pointing_frame,
            baud_rate=baud_rate or head.baud_rate,
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
        from head_tracking.simulation import SimulatedJoints  # needs pseudo-terminals

        model, configured, known = _known_robot(str(robot), calibration)
        servos = servos or configured.servos
        with ExitStack() as resources:
            port = resources.enter_context(SimulatedJoints(servos)).port_name
            head = cls(
                port,
                model,
                servos,
                pointing_frame=pointing_frame or configured.pointing_frame,
                reply_timeout=_SIMULATED_REPLY,
                resources=resources,
                calibration=known,
            )
            head._resources = resources.pop_all()
            return head

    # What it does

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

        A frame that moves is followed on the way, unless the head carries it.

        Args:
            point: shape (3,) [m].
            frame: the frame that it is given in.
            stamp: when the point was there [s, as time.time()]; None: it is meant for now.
            max_velocity: speed of the joint that has the longer way [rad/s].
            timeout: how long to wait [s]; after it the head holds.

        Returns:
            Whether the head has arrived, and by how much it misses the point [rad].

        Raises:
            FrameError: the frame is not known, or was not at that time.
            UnreachableError: the point cannot be looked at; nothing has moved.
            RefusedCommandError: the head is stopped, relaxed or closed, or was while it turned.
            SupersededError: another thread has given the head something else to do.
            DynamixelError: a servo cannot hold: it does not answer, or has shut itself down.
            ValueError: a number is not finite, or not allowed.
        """
        if not 0.0 < max_velocity <= 12.0:
            raise ValueError(f"max_velocity is {max_velocity}; allowed are 0 to 12 rad/s")
        target, epoch, control = _target(point, frame, stamp), self._permit(), self._control
        self._take_over()
        self._check(target)
        self._switch_torque(True, epoch)
        result: Future[PointingResult] = Future()
        turn = control.turn(PointingParameters(max_velocity=max_velocity))
        task = PointTask(
            lambda task: self._conclude(task, target, result),
            control,
            target,
            turn,
            clamp=True,
            follows=stamp is None,
        )
        with control.lock:
            self._permit(epoch)
            control.carry_out(task)
        try:
            return result.result(timeout)
        except FutureTimeoutError:
            return PointingResult(False, math.pi if task.miss is None else task.miss)
        finally:  # also on Ctrl-C
            control.cancel(task)

    def follow(
        self, point: Iterable[float], frame: str = "base_link", *, stamp: float | None = None
    ) -> None:
        """Keep the head on a target that moves; call this for each new measurement of it.

        Returns at once; the head begins as soon as the servos hold.

        Args:
            point: shape (3,) [m].
            frame: the frame that it is given in, such as `camera_optical_frame`.
            stamp: when it was seen [s, as time.time()]; None: now. A camera on the head needs the
                time of its picture.

        Raises:
            FrameError: the frame is not known.
            RefusedCommandError: the head is stopped, relaxed or closed.
            ValueError: a number is not finite.
        """
        target, epoch = _target(point, frame, stamp), self._permit()
        if frame not in self.frames.frames():
            known = ", ".join(self.frames.frames())
            raise FrameError(frame, f"the frame {frame!r} does not exist; there are {known}")
        self._take_over()
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
        """Keep the head on what a camera on it sees; returns at once. Needs OpenCV.

        It ends with the next command, `stop` and `relax` included: `resume` does not go on with it.

        Args:
            what: face, colour or marker, or a detector of `head_tracking.vision`.
            camera: number, device, file or URL; or pictures (blue, green, red; shape (height,
                width, 3)) with the times at which they were taken [s, as time.time()].
            frame: the camera's optical frame.
            model: of the camera; None: one that sees 60 degrees from left to right.
            distances: how wide or how far away it is; None: 2 m away.

        Returns:
            What is seen, and why it has ended.

        Raises:
            OpenCVMissingError: OpenCV is not installed.
            FrameError: the frame is not known.
            RefusedCommandError: the head is stopped, relaxed or closed.
            ValueError: there is no such detector.
        """
        from head_tracking.vision import CameraFollower, find_detector, pictures

        detector = find_detector(what) if isinstance(what, str) else what
        source = pictures(camera) if isinstance(camera, int | str) else camera
        base, epoch = self._pointed.base_frame, self._permit()
        self.pose(frame, base)
        follower = CameraFollower(
            detector,
            source,
            lambda point, stamp: self._follow_for(follower, _target(point, frame, stamp), epoch),
            lambda stamp: self.pose(frame, base, stamp=stamp),
            model,
            distances,
        )
        self._take_over(follower)
        follower.start()
        return follower

    def calibrate(
        self,
        camera: int | str | Iterable[tuple[float, Pixels]] = 0,
        *,
        marker: MarkerParameters,
        frame: str = "camera_optical_frame",
        model: Camera | None = None,
        focal_length: bool = False,
        report: Callable[[str], object] = lambda text: None,
    ) -> Calibration:
        """Measure where the camera sits; see `head_tracking.calibration.gathering`."""
        from head_tracking.calibration.gathering import calibrate_camera

        return calibrate_camera(
            self, camera, marker=marker, frame=frame, model=model, focal_length=focal_length,
            report=report,
        )  # fmt: skip

    @property
    def learned(self) -> Mapping[str, LearnedValue]:
        """What tracking has learned of the servos and of a camera on the head, by name."""
        with self._control.lock:
            return self._tracker.learned

    def learn(
        self,
        how: str = "learn",
        *,
        servos: str | None = None,
        camera: str | None = None,
        servo_delay: float = 0.0,
    ) -> None:
        """Choose what becomes of what tracking learns.

        Args:
            how: "learn": it is learned; "freeze": it stays as it is; "forget": it is forgotten.
            servos: `how`, for what is learned of the servos only.
            camera: `how`, for what is learned of a camera on the head only.
            servo_delay: from a command to the motion [s], given by hand; 0: learned.

        Raises:
            ValueError: there is no such way to learn, or the delay is not from 0 to 0.15 s.
        """
        chosen = [how if each is None else each for each in (servos, camera)]
        for each in (how, *chosen):
            if each not in tuple(Learning):
                raise ValueError(f"how to learn is {each!r}; allowed are {', '.join(Learning)}")
        (known,) = [each for each in fields(PredictiveLawParameters) if each.name == "servo_delay"]
        delay = checked(known.name, parameter_info(known), 0.0, servo_delay)
        law = PredictiveLawParameters(servo_delay=delay)
        self._settings = FollowingSettings(
            law_parameters=law, servo_learning=chosen[0], camera_learning=chosen[1]
        )
        with self._control.lock:
            self._following.tune()

    def hold(self) -> None:
        """End what is under way, also of another thread; the head stays where it is."""
        self._take_over()
        self._control.hold("superseded")

    def stop(self) -> Mapping[str, str]:
        """STOP: relax all servos at once, and refuse every command until `resume`.

        Returns:
            For each joint what went wrong; empty where its servo has confirmed.
        """
        problems = self._loop.stop()
        self._control.watch()
        return problems

    def relax(self) -> None:
        """Switch the torque off, and refuse commands until `resume`.

        Raises:
            DynamixelError: a servo has not confirmed it.
            RefusedCommandError: the head is closed.
        """
        self._require_open()
        self._relaxed = True
        self._take_over()
        self._control.disable(HeadState.RELAXED)
        self._switch_torque(False)

    def resume(self) -> None:
        """End a `stop` or a `relax`: the servos hold where they stand, and commands are accepted.

        After a `stop` the head moves slowly until it has arrived once.

        Raises:
            DynamixelError: a servo has not confirmed it, or there was another stop meanwhile.
            RefusedCommandError: the head is closed.
        """
        self._require_open()
        epoch = self._owners.epoch.value
        if self._owners.stopped:
            self._owners.resume(epoch)
        self._switch_torque(True, epoch)
        with _refused_if_stopped():
            self._control.enable()
        self._relaxed = False

    def close(self) -> None:
        """Brake and relax the servos and close the port; safe to call twice.

        An interrupt (Ctrl-C) meanwhile is raised after that.

        Raises:
            DynamixelError: a servo has not confirmed that it is relaxed.
        """
        result: Future[None] = Future()

        def close() -> None:
            try:
                self._close()
                result.set_result(None)
            except Exception as error:
                result.set_exception(error)

        threading.Thread(target=close, name="close head").start()  # Python's end waits for it
        interrupt: KeyboardInterrupt | None = None
        while not result.done():
            try:
                with suppress(FutureTimeoutError):
                    result.exception(_PATIENCE)
            except KeyboardInterrupt as error:
                interrupt = error
        if interrupt is not None:
            raise interrupt
        result.result()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # What is known

    @property
    def state(self) -> HeadState | TargetState:
        """What the head does now."""
        for state, is_so in (
            (HeadState.CLOSED, self._closed),
            (HeadState.STOPPED, self._owners.stopped),
            (HeadState.RELAXED, self._relaxed),
            (HeadState.TURNING, self._control.task is not None),
        ):
            if is_so:
                return state
        followed = self._tracker.state
        return HeadState.HOLDING if followed is TargetState.IDLE else followed

    @property
    def reason(self) -> str:
        """Why `follow` has the state that it has, for a person; empty: no target is followed."""
        machine = self._tracker.machine
        return "" if machine.state is TargetState.IDLE else machine.reason

    @property
    def error(self) -> float | None:
        """By how much the measured head misses its target [rad]; None: there is none."""
        return self._control.error

    @property
    def joints(self) -> Mapping[str, float]:
        """The measured positions of pan and tilt [rad]."""
        return dict(zip((self._pan, self._tilt), self._positions(), strict=True))

    @property
    def statistics(self) -> BusStatistics:
        """Counters of the bus, and the latest measurements of each servo."""
        return self._bus.statistics()

    def pose(self, link: str, frame: str = "base_link", *, stamp: float | None = None) -> Transform:
        """Return `T_frame_link`: where a link is.

        Args:
            link: of the robot, or another frame.
            frame: in which its pose is expressed.
            stamp: when [s, as time.time()]; waits for the joints of that time. None: the latest.

        Raises:
            FrameError: a frame is unknown, or was not known at that time.
        """
        at, patience = (LATEST, 0.0) if stamp is None else (round(stamp * 1e9), _PATIENCE)
        found = _known(lambda: self.frames.lookup_transform(frame, link, at, patience), link)
        return found.transform

    # Inside

    @property
    def _pointed(self) -> PanTiltHead:
        assert self._control.head is not None  # the constructor has set it
        return self._control.head

    @property
    def _tracker(self) -> Tracker:
        assert self._following.tracker is not None
        return self._following.tracker

    def _positions(self) -> tuple[float, float]:
        pan, tilt = (self.frames.latest_joint_position(name) for name in (self._pan, self._tilt))
        assert pan is not None  # the constructor waits for them
        assert tilt is not None
        return pan[1], tilt[1]

    def _check(self, target: Target) -> None:
        """Refuse what is not known, or cannot be looked at; may wait for the joints of its stamp.

        Raises:
            FrameError: it is not known where the point is.
            UnreachableError: the head cannot point there.
        """
        head, frame, at = self._pointed, target.frame_id, target.stamp
        patience = self._control.transform_timeout if at else 0.0
        found = _known(
            lambda: self.frames.lookup_transform(head.base_frame, frame, at, patience), frame
        )
        point = found.transform @ target.point
        gaze = head.gaze(point, *self._positions())
        if not gaze.reached:
            miss = head.miss(point, gaze.pan, gaze.tilt)
            raise UnreachableError(target.point, frame, miss, gaze.reason)

    def _conclude(self, task: HeadTask, target: Target, result: Future[PointingResult]) -> None:
        """Hand the result of a turn to the thread that waits for it."""
        if task.result is None or task.result.end is TaskEnd.CANCELED:  # by this thread
            return
        end, miss = task.result.end, task.miss
        if end in (TaskEnd.SUCCEEDED, TaskEnd.MISSED) and miss is not None:
            result.set_result(PointingResult(end is TaskEnd.SUCCEEDED, miss))
        elif end is TaskEnd.PREEMPTED:
            result.set_exception(SupersededError(target.point, miss))
        elif end is TaskEnd.UNREACHABLE:
            reason = task.result.reason
            error = UnreachableError(target.point, target.frame_id, miss or math.pi, reason)
            result.set_exception(error)
        elif end is TaskEnd.DISABLED:
            state = HeadState.RELAXED if self._relaxed else HeadState.STOPPED
            refusal = RefusedCommandError(HeadState.CLOSED if self._closed else state)
            refusal.__cause__ = self._failure
            result.set_exception(refusal)
        elif self._control.trouble:
            result.set_exception(BusStoppedError(task.result.reason))
        else:
            result.set_exception(FrameError(target.frame_id, task.result.reason))

    def _require_open(self) -> None:
        if self._closed:
            raise RefusedCommandError(HeadState.CLOSED)

    def _permit(self, epoch: int | None = None) -> int:
        """Return the epoch of a command that is given now; refuse one of an earlier epoch."""
        self._require_open()
        with _refused_if_stopped():
            now = self._owners.permit()
        if self._relaxed:
            raise RefusedCommandError(HeadState.RELAXED)
        if epoch not in (None, now):
            raise RefusedCommandError(HeadState.STOPPED)
        return now

    def _take_over(self, follower: CameraFollower | None = None) -> None:
        """Let a camera lead the head, or none: what the one before sees counts no more."""
        with self._leading:
            self._follower = follower

    def _follow_for(self, follower: CameraFollower, target: Target, epoch: int) -> None:
        with self._leading:
            if follower is not self._follower:
                raise SupersededError(target.point, self.error)
            self._permit(epoch)
            self._follow(target, epoch)

    def _follow(self, target: Target, epoch: int) -> None:
        with self._control.lock:
            self._permit(epoch)
            if self._control.task is not None:
                self._control.hold("superseded")
            self._control.accept(target)

    def _switch_torque(self, on: bool, epoch: int | None = None) -> None:
        (switched,) = self._servos.switch_torque(None, on, epoch)
        try:
            with _refused_if_stopped():
                switched.result(_PATIENCE)
        except FutureTimeoutError:
            raise BusStoppedError(f"no servo has confirmed it within {_PATIENCE} s") from None

    def _report(self, subject: str, text: str) -> None:
        self._control.warn(subject, f"{subject}: {text}")

    def _check_control(self, *_: object) -> None:
        if self._control.failure is not None:
            raise self._control.failure

    def _fail(self, error: BaseException) -> None:
        """End everything: the port has failed, and the servos were relaxed if that was possible."""
        self._closed, self._failure = True, error
        self._control.disable(HeadState.CLOSED)

    def _close(self) -> None:
        self._closed = True
        atexit.unregister(self._close)
        self._control.disable(HeadState.CLOSED)
        try:
            unconfirmed = self._servos.close()
        finally:
            self._resources.close()
            self._control.save()
        if unconfirmed:
            raise BusStoppedError(f"{', '.join(unconfirmed)} did not confirm that it is relaxed")


def _known_robot(
    robot: str, calibration: str | Path | None
) -> tuple[RobotModel, ConfiguredHead, Calibration | None]:
    """Return a robot's calibrated model, its head as its parameter file has it, the calibration."""
    model, known = load_robot_model(robot_file(robot)), None
    if calibration is not None:
        from head_tracking.calibration import Calibration

        known = Calibration.load(calibration)
        model = known.apply(model)
    return model, configured_head(robot_parameters(robot)), known


def _known(look_up: Callable[[], _T], frame: str) -> _T:
    """Return what is looked up; raise FrameError where a transform is not known."""
    try:
        return look_up()
    except TransformException as error:
        raise FrameError(frame, str(error)) from error


@contextmanager
def _refused_if_stopped() -> Iterator[None]:
    """Raise RefusedCommandError where a STOP keeps something from being done."""
    try:
        yield
    except StoppedError:
        raise RefusedCommandError(HeadState.STOPPED) from None


def _target(point: Iterable[float], frame: str, stamp: float | None) -> Target:
    """Return a target; raise ValueError if a number is not finite."""
    x, y, z = map(float, point)
    if not all(map(math.isfinite, (x, y, z, stamp or 0.0))):
        raise ValueError(f"the point {(x, y, z)} at {stamp} is not finite")
    return Target(LATEST if stamp is None else round(stamp * 1e9), frame, (x, y, z))
