"""The control of one head in the control loop: measured joints, targets, motions and ownership."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from logging import Logger, LoggerAdapter
from typing import Any

from head_tracking.control.loop import Controller, ControlLoop, JointBackend
from head_tracking.control.owners import OwnershipError
from head_tracking.control.throttle import Throttle
from head_tracking.dynamixel import Goal, StoppedError
from head_tracking.gaze import AT_GOAL, HeadCommand, PointingResult
from head_tracking.gaze.head_parameters import HeadParameters, Limits
from head_tracking.head.head_frames import HeadFrames
from head_tracking.head.motions import Motion, MotionEnd, MotionResult, TargetMotion
from head_tracking.head.obstacle import Blocked, Obstacle
from head_tracking.head.servo_memory import ServoMemory
from head_tracking.tracking import (
    CAUTIOUS_SPEED,
    ClockWatch,
    FollowingWatch,
    JointPoint,
    JointReading,
    JointReadings,
    PredictiveLaw,
    Refusal,
    SpeedLimits,
    Target,
    TargetState,
    TrajectoryCode,
    Verdict,
    stalled,
)
from head_tracking.transforms import RobotModel, RobotModelError

_LOG_PERIOD = 1.0  # s
_CAUTIOUS_TIME = 2.0  # s with a target after a STOP, until the speed limit rises
_FAST = 3.0  # rad/s; a speed limit above this ends the caution
_MOST_EARLY = 0.2  # s; a larger error of a stamp cannot be estimated
_MOST_LATE = 60.0  # s; an older stamp is of another clock
_FASTEST = 12.0  # rad/s of a motion; usually the model's limit is lower
_START_TIME = 0.3  # s that a joint may take to start after its command


class HeadControl(Controller):
    """Controls a head in a loop by one `Motion` at a time; for any thread.

    It is enabled while it owns both joints. After a STOP it is cautious until the head has arrived
    once: slow, and faster only while a target moves away.

    Args:
        loop: the control loop; its buffer has the robot's frames.
        name: its name as an owner of joints.
        targets: what the head does with its targets.
        is_simulated: returns whether the clock may run at any speed.
        period: minimum time between two updates [s].
        log: the logger; that of a ROS node has the same methods.
        observer: called after the goals of each cycle were written, with the present `error`;
            None: there is none, or it is not new.

    Attributes:
        joints: pan and tilt.
        frames: the head's model, and the transforms of its targets.
        motion: what controls the head now; `targets`, unless it is something else.
        trouble: why the head cannot be controlled now; None: it can.
        result: of the latest motion, which may have been rejected; None: there was none yet.
        refusal: why the latest target is not used; empty: it is used, or there is none.
        law: the control law for the joints of all motions but tracking, which shares its servo
            models; set with a model.
        held: commanded pan and tilt [rad] at which the head stands; None: not known.
        is_cautious: whether the head is slow after a STOP.
        epoch: the number of STOPs before the latest measurement.
        disabled: why this does not own the joints, while it does not and the head is not stopped.
        lock: held during every decision.
    """

    joints: tuple[str, str]

    def __init__(
        self,
        loop: ControlLoop,
        name: str,
        parameters: HeadParameters,
        targets: TargetMotion,
        clock: ClockWatch,
        *,
        is_simulated: Callable[[], bool] = lambda: False,
        period: float,
        log: Logger | LoggerAdapter[Any],
        observer: Callable[[float | None], object] = lambda _: None,
    ) -> None:
        assert loop.buffer is not None
        self.name = name
        self.joints = parameters.head_pan_joint, parameters.head_tilt_joint
        self.period = max(period, loop.period)
        self.frames = HeadFrames(loop.buffer, parameters)
        self.targets: TargetMotion = targets
        self.motion: Motion = targets
        self.readings = JointReadings()
        self.trouble: Obstacle | None = Obstacle(Blocked.NO_MODEL)
        self.result: MotionResult | None = None
        self.refusal = ""
        self.law: PredictiveLaw
        self.memory = ServoMemory({})
        self.held: tuple[float, float] | None = None
        self.is_cautious = False
        self.lock = threading.RLock()
        self._loop, self._buffer, self._owners = loop, loop.buffer, loop.owners
        self._timeout = parameters.joint_state_timeout
        self._clock, self._is_simulated = clock, is_simulated
        self._log, self._observer = log, observer
        self._throttle = Throttle(_LOG_PERIOD)
        self._model: RobotModel | None = None
        self._limits: Limits | None = None
        self._listening_since = 0  # ns; set by the first check
        self._updated, self._is_fresh = (0.0, 0.0), False
        self._resumed = -math.inf  # s; the end of a STOP
        self._troubled_since = math.inf
        self._cautious_for = 0.0  # s, with a target
        self._watches = {joint: FollowingWatch(_START_TIME) for joint in self.joints}
        self.disabled = Obstacle(Blocked.OWNED)  # nobody has disabled it
        self.epoch = self._owners.epoch.value
        self._noticed = False, self.epoch

    def begin(self) -> None:
        """Control the head from the next cycle on, unless the joints have another owner."""
        owners = self._owners
        try:
            owners.claim(self.name, self.joints)
        except (OwnershipError, StoppedError) as error:
            self._log.warning(f"{error}; until then {self.targets.title} is disabled")
        self.watch()
        self._loop.add(self)

    @property
    def now(self) -> float:
        """The time [s]."""
        return self._clock.now(simulated=self._is_simulated())

    @property
    def error(self) -> float | None:
        """Angle between the pointing axis and the target [rad]; None: there is no target."""
        return self.motion.miss if self.trouble is None else None

    @property
    def _backend(self) -> JointBackend:
        assert self._loop.backend is not None
        return self._loop.backend

    # Ownership

    @property
    def off(self) -> Obstacle | None:
        """Why the head is disabled; None: it is enabled, because this owns the joints."""
        if self._owners.owns(self.name, self.joints):
            return None
        if self._owners.stopped and self.disabled.reason is not Blocked.CLOSED:
            return Obstacle(Blocked.STOPPED)
        if self.disabled.reason is not Blocked.OWNED:
            return self.disabled
        others = self._others()
        if others:
            return Obstacle(Blocked.OWNED, others)
        return Obstacle(Blocked.DISABLED, self.targets.title)

    def _others(self) -> str:
        """Return the other owners of the joints; empty: there are none."""
        owners = set(self._owners.of(self.joints).values()) - {"", self.name}
        return " and ".join(sorted(owners))

    @property
    def obstacle(self) -> Obstacle | None:
        """Why a motion that begins now would not move the head; None: it would."""
        off, other = self.off, self._owners.elsewhere(self.joints)
        if off is None and other not in ("", self.name):
            return Obstacle(Blocked.OWNED, other)
        return off or self.trouble

    def enable(self, *, cautious: bool = True) -> None:
        """Take over the joints, whoever owns them.

        Args:
            cautious: whether a STOP before this makes the head slow at first.

        Raises:
            StoppedError: the head is stopped.
        """
        epoch = self._owners.permit()
        if self.off is not None:
            self.result = None
        self._owners.take_over(self.name, self.joints, epoch)
        self._backend.claim()
        self.watch()
        self.is_cautious = self.is_cautious and cautious

    def disable(self, reason: Blocked, detail: str = "") -> None:
        """Stop the head and release the joints, also after a STOP has ended."""
        with self.lock:
            if reason is Blocked.FAULT:
                self._log.error(f"the head is stopped: {detail}")
            self._stop()
            self.release(reason, detail)
        self.watch()

    def release(self, reason: Blocked, detail: str = "") -> None:
        """Release the joints at once; they go on to their last goal."""
        self.disabled = Obstacle(reason, detail)
        self._owners.release(self.name)

    def save(self) -> None:
        """Save what was learned of the servos for the next run."""
        with self.lock:
            if self.frames.head is not None:
                self.memory.save(self.law.to_save)

    def watch(self) -> None:
        """Check owners, clock, model and joint states, also while no joint states are received."""
        with self.lock:
            self._check_owners()
            self._measure()

    def _check_owners(self) -> bool:
        """Return whether this owns the joints; restart if that has changed, or after a STOP."""
        owners = self._owners
        noticed = owned, epoch = owners.owns(self.name, self.joints), owners.epoch.value
        if noticed == self._noticed:
            return owned
        (was_owner, old_epoch), self._noticed = self._noticed, noticed
        others = self._others()
        if was_owner and not owned and others:
            self.disabled = Obstacle(Blocked.LOST, others)
            owners.release(self.name)  # the other joint, too
        if epoch != old_epoch:
            self.is_cautious, self._cautious_for = True, 0.0
        if self.is_cautious:
            self._resumed = self.now
        self._end_motion(MotionEnd.DISABLED, str(self.off or Obstacle(Blocked.STOPPED)))
        self._restart_targets()
        return owned

    # The cycle

    def update(self) -> None:
        """Decide where the joints go now, and write it; see `ControlLoop`."""
        with self.lock:
            is_owner = self._check_owners()
            joints = self._measure()
            if joints is None:
                return
            if not is_owner:
                self.frames.forget()
            elif self._is_due(joints.stamp, self._clock.checked):
                self._advance(joints, self._clock.checked)
                self._is_fresh = True

    def publish(self) -> None:
        """Notify the observers, after the goals were written."""
        with self.lock:
            self.motion.notify(self.motion)
        error, self._is_fresh = self.error if self._is_fresh else None, False
        self._observer(error)

    def send(self, command: HeadCommand | None) -> None:
        """Write the goals of a command, unless the head was stopped or lost since the reading."""
        owners, (pan, tilt) = self._owners, self.joints
        if (
            command is None
            or self.epoch != owners.epoch.value
            or not owners.owns(self.name, self.joints)
        ):
            return
        goals = {
            pan: Goal(command.pan, command.pan_speed),
            tilt: Goal(command.tilt, command.tilt_speed),
        }
        self._backend.write(self.name, goals, self.epoch)

    def _is_due(self, stamp: float, now: float) -> bool:
        before, measured = self._updated
        passed, newer = now - before, stamp - measured
        if 0.0 <= passed < 0.5 * self.period:
            return False  # delayed joint states come all at once; or simulated time stands still
        if 0.0 <= newer < 0.75 * self.period and 0.0 <= passed < 1.5 * self.period:
            return False  # joints are measured more often than that
        self._updated = now, stamp
        return True

    def _advance(self, joints: JointReading, now: float) -> None:
        motion, targets, self.law.at_most = self.motion, self.targets, self.fastest
        if motion is not targets:
            self.frames.forget()
        command, base = motion.update(joints, now), self.frames.base
        if base is not None and (text := base.out_of_time(now)):
            self.warn("base", text)
        for joint, servo in self.law.servos.items():
            if servo.is_contradicted:
                servo.is_contradicted = False
                self.warn(joint, f"{joint}: the saved values of its servo do not fit any more")
        desired = None if motion.result is not None else motion.desired(now)
        if desired is not None:
            self.held = desired[0].position, desired[1].position
        if motion is targets:
            if motion.miss is not None and self.is_cautious:
                self._cautious_for += self.period
                if motion.miss < AT_GOAL or self.fastest > _FAST:
                    self.is_cautious = False
        elif desired is not None:
            stuck = self._stuck(desired, joints)
            if stuck:
                end = MotionEnd.ABORTED
                if motion.miss is not None:
                    end, stuck = MotionEnd.MISSED, f"{PointingResult(False, motion.miss)} ({stuck})"
                motion.end(end, stuck, TrajectoryCode.PATH_TOLERANCE_VIOLATED)
                command, self.held = self.law.stop(joints), None
        if motion.result is not None:
            self._close(motion)
        self.send(command)

    def _stuck(self, desired: tuple[JointPoint, JointPoint], joints: JointReading) -> str:
        """Return why a joint does not move as commanded, by the servo bus or by its position."""
        for watch, delay in zip(self._watches.values(), self.law.delays, strict=True):
            watch.patience = _START_TIME + delay
        goals = [point.position for point in desired]
        speeds = [abs(point.velocity or 0.0) for point in desired]
        standing = stalled(self._watches, goals, speeds, joints.positions, joints.stamp)
        return "; ".join(filter(None, map(self._loop.stuck.get, self.joints))) or standing

    # The measurement

    def _measure(self) -> JointReading | None:
        """Return the latest measurement; None without a model or a recent measurement.

        The clock and the model are checked first. What is missing is logged, and is the `trouble`,
        which ends the motion and forgets the target when it lasts.
        """
        self.epoch = self._owners.epoch.value
        jump = self._clock.check(simulated=self._is_simulated())
        if jump:
            self._restart_after(jump)
        self._listening_since = self._listening_since or round(self._clock.checked * 1e9)
        model, (pan, tilt) = self._buffer.model, map(self._backend.limits, self.joints)
        limits = pan, tilt
        if model is not None and (model is not self._model or limits != self._limits):
            self._use(model, limits)
        self.trouble = self._find_trouble()
        now = time.monotonic()
        self._troubled_since = math.inf if self.trouble is None else min(self._troubled_since, now)
        # At the first check, this program itself may have been delayed.
        if now - self._troubled_since > 0.5 * self.period:
            self._end_motion(MotionEnd.ABORTED, str(self.trouble))
            self.targets.restart()
        return self.readings.latest if self.trouble is None else None

    def _find_trouble(self) -> Obstacle | None:
        if self.frames.head is None:
            assert self.trouble is not None
            self.warn("model", str(self.trouble))
            return self.trouble
        clock, positions, oldest = self._clock, [], 0
        if clock.standing:
            return Obstacle(Blocked.CLOCK, clock.standing)
        for joint in self.joints:
            stamp, position = self._buffer.latest_joint_position(joint) or (0, None)
            age = clock.checked - (stamp if position is not None else self._listening_since) * 1e-9
            if position is None or abs(age) > self._timeout:
                is_early = age < -self._timeout
                trouble = Obstacle(Blocked.FUTURE if is_early else Blocked.NOT_MEASURED, joint)
                if abs(age) > self._timeout:
                    self.warn(joint, f"{trouble}; the difference is {abs(age):.1f} s")
                return trouble
            positions.append(position)
            oldest = stamp if not oldest else min(stamp, oldest)
        self.readings.append(oldest * 1e-9, (positions[0], positions[1]))
        return None

    def _restart_after(self, jump: str) -> None:
        """Discard everything measured before a jump of the clock."""
        self._log.warning(f"{jump}: all measurements are discarded, and the head holds")
        self._listening_since, self._resumed = round(self._clock.checked * 1e9), -math.inf
        if not self._clock.standing:
            self._buffer.clear()
        self.frames.forget()
        self._end_motion(MotionEnd.ABORTED, jump)
        self.send(self.targets.reset(jump))
        self.readings.clear()
        self._observer(None)

    def _use(self, model: RobotModel, limits: Limits) -> None:
        """Control the head of a model within its servos' limits from now on, if it has one."""
        self._limits = limits
        try:
            head = self.frames.use(model, limits)
        except RobotModelError as error:
            if self._model is not None and self.frames.head is not None:
                self._buffer.set_model(self._model)
                self._log.error(f"the new model or limits are not used: {error}")
            else:
                self._model = model
                self.trouble = Obstacle(Blocked.INVALID_MODEL, str(error))
            return
        self._end_motion(MotionEnd.ABORTED, "the model or its limits have changed")
        self._model = model
        fastest = min(_FASTEST, max(head.pan_limits.velocity, head.tilt_limits.velocity))
        self.law = PredictiveLaw(head, self.period, SpeedLimits(max_joint_speed=fastest))
        self.memory = ServoMemory({joint: self._backend.servo(joint) for joint in self.joints})
        self.law.expect(self.memory.load())
        self.targets.use(self)
        self._restart_targets()
        self._log.info(f"ready to point {head.pointing_frame} at target_point")

    @property
    def fastest(self) -> float:
        """The speed limit now [rad/s]: low after a STOP, rising while the target is missed."""
        if not self.is_cautious:
            return math.inf
        return CAUTIOUS_SPEED * math.pow(2.0, max(0.0, self._cautious_for - _CAUTIOUS_TIME))

    # Targets

    def accept(self, target: Target) -> None:
        """Accept a target for the next cycle; it is ignored if another motion is in progress.

        What a frame of the head has seen in the future is refused: waiting for the joints of that
        time would only hide that its stamp is wrong. What was measured before the end of a STOP,
        and delivered late, is refused as well.
        """
        with self.lock:
            is_late = 0.0 < self._resumed - target.stamp * 1e-9 < _MOST_LATE
            target = self.frames.corrected(target)
            is_early = target.stamp * 1e-9 > self.now + _MOST_EARLY
            if is_early and self.frames.moves_with_head(target.frame_id):
                self.frames.refuse(target, Verdict.FUTURE)
            elif is_late:
                self.frames.refuse(target, Verdict.STOPPED)
            else:
                self.frames.offer(target, self._clock.checked)

    def recenter(self) -> Obstacle | None:
        """Turn the head to its centre, or return why not."""
        with self.lock:
            joints = self._measure()
            if joints is None or self.off is not None:
                return self.off or self.trouble
            self.frames.forget()
            self._end_motion(MotionEnd.PREEMPTED, "the head is recentred")
            self.result = MotionResult(MotionEnd.SUCCEEDED, "sent to the centre")
            self.send(self.targets.recenter(joints))
        return None

    def refuse(self, refusal: Refusal) -> None:
        """Record and log why a target is not used."""
        target, self.refusal = refusal
        self.warn(f"target in {target.frame_id}", f"target {target} refused: {self.refusal}")

    def _restart_targets(self) -> None:
        self.refusal = ""
        self.frames.forget()
        self.targets.restart()

    # Motions

    def start(self, motion: Motion) -> None:
        """Begin a motion; the present one is preempted. It is aborted if there is a `trouble`."""
        with self.lock:
            if self._measure() is None:
                motion.end(MotionEnd.ABORTED, str(self.trouble))
                return
            before = self.motion
            if motion.is_streamed and before.is_streamed and before is not self.targets:
                self.motion = motion
            else:
                self._end_motion(MotionEnd.PREEMPTED, f"preempted by a newer goal: {motion.title}")
                self._log.info(motion.title)
                for joint, watch in self._watches.items():
                    self._loop.stuck.pop(joint, None)  # problems of earlier motions
                    watch.restart()
                self.motion = motion
                self.targets.restart()
            self.frames.forget()
            self.result = None

    def held_positions(self) -> tuple[float, float]:
        """Return the commanded positions of joints that stand at them, else the measured ones.

        A servo stands beside its goal by up to its dead band. A motion that began at the measured
        position would add that to each step.
        """
        measured = self.readings.latest
        positions = (0.0, 0.0) if measured is None else measured.positions
        pan, tilt = (
            held if abs(held - here) < AT_GOAL else here
            for here, held in zip(positions, self.held or positions, strict=True)
        )
        return pan, tilt

    def present(self) -> tuple[JointPoint, JointPoint]:
        """Return the desired states of the joints now, from which a new motion begins."""
        desired = self.motion.desired(self._clock.checked)
        if desired is not None:
            return desired
        pan, tilt = self.held_positions()
        return JointPoint(pan), JointPoint(tilt)

    def reject(self, reason: str) -> None:
        """Record why a motion was not begun."""
        self.result = MotionResult(MotionEnd.REJECTED, reason)

    def cancel(self, motion: Motion) -> None:
        """End a motion, if it is in progress, and hold the head."""
        with self.lock:
            if self.motion is motion:
                self.hold("the head holds", MotionEnd.CANCELED)

    def hold(self, reason: str, end: MotionEnd = MotionEnd.PREEMPTED) -> None:
        """Stop the head where it is, end its motion, and forget its target."""
        with self.lock:
            self._stop()
            self._end_motion(end, reason)
            self._restart_targets()

    def _stop(self) -> None:
        joints = self._measure()
        if joints is None:
            return
        self.held = None
        if self.motion is self.targets:
            self.send(self.targets.restart())
        else:
            self.send(self.law.stop(joints))

    def conclude(self, motion: Motion) -> None:
        """Record and log the result of a motion."""
        result = motion.result
        assert result is not None
        self.result = result
        if result.end is MotionEnd.SUCCEEDED:
            self.is_cautious = False
            self._log.info(f"{motion.title}: {result}")
        else:
            self._log.warning(f"{motion.title}: {result}")

    def _end_motion(self, end: MotionEnd, reason: str) -> None:
        motion = self.motion
        if motion is not self.targets:
            motion.end(end, reason)
            self._close(motion)

    def _close(self, motion: Motion) -> None:
        self.motion = self.targets
        self.conclude(motion)
        self._restart_targets()

    # State

    def state(self) -> tuple[str, str]:
        """Return the state of the head, as a code and as text."""
        if self.off is not None:
            return TargetState.DISABLED, f"disabled: {self.off}"
        if self.trouble is not None:
            return TargetState.IDLE, f"idle: {self.trouble}"
        if self.motion is not self.targets:
            title, rejected = self.motion.title, self.result
            return "turning", title if rejected is None else f"{title}; {rejected}"
        return self.targets.state()

    def warn(self, subject: str, text: str) -> None:
        """Log a warning, at most one a second for each subject."""
        if self._throttle.is_due(subject):
            self._log.warning(text)
