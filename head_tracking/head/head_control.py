"""The controller of one head: measured joints, targets, tasks, and who owns the joints."""

from __future__ import annotations

import math
import threading
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from typing import Protocol

from head_tracking.control.loop import ControlLoop
from head_tracking.control.owners import STOPPED, OwnershipError
from head_tracking.dynamixel import Goal, StoppedError
from head_tracking.gaze import AT_GOAL, HeadCommand, PanTiltHead, PointingParameters, PointingResult
from head_tracking.head.head_parameters import HeadParameters
from head_tracking.head.servo_memory import ServoMemory
from head_tracking.head.tasks import HeadReading, HeadTask, PointTask, TaskEnd
from head_tracking.tracking import (
    CAUTIOUS_SPEED,
    ClockWatch,
    FollowingWatch,
    HeadBase,
    JointPoint,
    PredictiveLaw,
    Refusal,
    SpeedLimits,
    Target,
    TargetPlacer,
    TrajectoryCode,
    Turn,
    stalled,
)
from head_tracking.transforms import (
    LATEST,
    RobotModel,
    RobotModelError,
    TransformException,
    Vector3,
)

_LOG_PERIOD = 1.0  # s
_MOST_WAITING = 1000  # targets, until the next cycle
_MOST_LOGGED = 100  # subjects at a time; anybody may send targets in frames of any name
_CAUTIOUS_TIME = 2.0  # s with a target after a stop, until the speed rises
_FAST = 3.0  # rad/s: a head as fast as that is not cautious any more
_FASTEST = 12.0  # rad/s of a task; usually the model's limit is lower
_START_TIME = 0.3  # s; so long after its command a joint may stand still


class Log(Protocol):
    """Where a head logs: Python's logger, or a node's."""

    def info(self, message: str, /) -> object:
        """Log what happens."""

    def warning(self, message: str, /) -> object:
        """Log what may need a mend."""

    def error(self, message: str, /) -> object:
        """Log what has failed."""


class TargetMode(ABC):
    """What a head does with the targets that are sent to it, while it has no task.

    Its methods are called with the lock of `HeadControl` held.

    Attributes:
        title: what it does, such as "tracking".
    """

    title: str

    @abstractmethod
    def use(self, control: HeadControl, head: PanTiltHead, base: HeadBase | None) -> None:
        """Use a head, whose model is known now or has changed.

        Args:
            control: of the head.
            head: of the model.
            base: where the head's base is; None: it is the frame that stands still.
        """

    @abstractmethod
    def reset(self, reason: str, now: float) -> HeadCommand | None:
        """Forget everything of before, for the clock has jumped; return what stops the head."""

    @abstractmethod
    def enable(self, off: str, now: float) -> HeadCommand | None:
        """Begin anew, or end, and return the command that stops the head.

        Args:
            off: why it is disabled; empty: it is enabled.
            now: the time [s].
        """

    @abstractmethod
    def measured(self, reading: HeadReading) -> None:
        """Accept the joints, also between two steps."""

    @abstractmethod
    def step(self, control: HeadControl, reading: HeadReading) -> HeadCommand | None:
        """Return what to do now."""

    @abstractmethod
    def recenter(self, control: HeadControl, reading: HeadReading) -> HeadCommand | None:
        """Begin to turn the head to its centre."""

    def save(self, memory: ServoMemory) -> None:  # noqa: B027 - some modes learn nothing
        """Keep what was learned of the servos for the next run."""

    @abstractmethod
    def state(self, control: HeadControl) -> tuple[str, str]:
        """Return the state, in a word, and in a sentence."""


class HeadControl:
    """Turns a head in a loop, as its tasks or else its targets have it; for any thread.

    It is enabled as long as it owns both joints. After a STOP it is cautious until it has arrived
    once: slow, and faster only if it has a target that runs away.

    Args:
        loop: of the process; its buffer has the robot's frames.
        name: the owner that it is.
        parameters: of the head.
        pointing_frame: the frame to point.
        mode: what it does with targets.
        clock: of the stamps.
        is_simulated: returns whether that clock may run at any speed.
        period: between two steps, at least [s].
        log: where it logs.
        observer: called after each cycle, when everything has been written, with the `error` of its
            step; None: there was none.

    Attributes:
        name: as given.
        joints: pan and tilt.
        mode: as given.
        head: the head that is turned; None: the robot's model is not known.
        task: what is carried out; None: nothing.
        trouble: why the head is left alone; empty: nothing keeps it from moving.
        outcome: of the latest task or target, for a person.
        law: leads the joints along paths, once the robot's model is known.
        memory: of what earlier runs have learned of the servos.
        error: by how much the head misses its target [rad]; None: it has none.
        target: the latest that could be placed, as it was sent.
        is_cautious: whether it is slow after a STOP.
        transform_timeout: how long a target waits for its transforms [s].
        lock: held while anything is decided.
        failure: what has ended it; None as long as it works.
    """

    def __init__(
        self,
        loop: ControlLoop,
        name: str,
        parameters: HeadParameters,
        pointing_frame: str,
        mode: TargetMode,
        clock: ClockWatch,
        *,
        is_simulated: Callable[[], bool] = lambda: False,
        period: float,
        log: Log,
        observer: Callable[[float | None], object] = lambda _: None,
    ) -> None:
        assert loop.buffer is not None
        self.name, self.mode = name, mode
        self.joints = parameters.head_pan_joint, parameters.head_tilt_joint
        self.transform_timeout = parameters.transform_timeout
        self.head: PanTiltHead | None = None
        self.task: HeadTask | None = None
        self.trouble = "waiting for robot_description"
        self.outcome = "no target has come yet"
        self.error: float | None = None
        self.target: Target | None = None
        self.is_cautious = False
        self.law: PredictiveLaw
        self.memory = ServoMemory({})
        self.lock = threading.RLock()
        self.failure: Exception | None = None
        self.period = max(period, loop.period)
        self._loop, self._buffer = loop, loop.buffer
        self._parameters, self._pointing_frame = parameters, pointing_frame
        self._clock, self._is_simulated = clock, is_simulated
        self._log, self._observer = log, observer
        self._logged: dict[str, float] = {}
        self._model: RobotModel | None = None
        self._refused_model: RobotModel | None = None
        self._base: HeadBase | None = None
        self._placer: TargetPlacer | None = None
        self._carried: dict[str, bool] = {}
        self._inbox: deque[tuple[Target, float]] = deque(maxlen=_MOST_WAITING)
        self._placed: deque[tuple[float, Vector3]] = deque(maxlen=_MOST_WAITING)
        self._listening_since = round(self.now * 1e9)
        self._stepped, self._fresh = (0.0, 0.0), False
        self._wrong_since, self._is_wrong = math.inf, False
        self._cautious_for = 0.0  # s, with a target
        self._rejected = ""
        self._before: HeadTask | None = None  # what the task replaces
        self._held: tuple[float, float] | None = None
        self._watches = [FollowingWatch(joint, _START_TIME) for joint in self.joints]
        self._disabled = "it has not begun"
        self._epoch = loop.owners.epoch.value
        self._seen = False, self._epoch

    def begin(self) -> None:
        """Turn the head from the next cycle on, unless something else owns the joints."""
        owners = self._loop.owners
        try:
            owners.claim(self.name, self.joints)
        except (OwnershipError, StoppedError) as error:
            self._disabled = str(error)
            if owners.stopped:
                owners.claim_at_resume(self.name, self.joints)
            self._log.warning(f"{error}; until then {self.mode.title} is disabled")
        self.watch()
        self._loop.add(self)

    # Who may turn the head

    @property
    def off(self) -> str:
        """Why the head is not turned; empty: it is enabled, for it owns the joints."""
        owners = self._loop.owners
        if owners.owns(self.name, self.joints):
            return ""
        return STOPPED if owners.stopped else self._disabled

    @property
    def is_stopped(self) -> bool:
        """Whether there was a STOP and no `resume`."""
        return self._loop.owners.stopped

    @property
    def obstacle(self) -> str:
        """Why nothing that is sent now would turn the head; empty: it would."""
        other = self._loop.owners.elsewhere(self.joints)
        if not self.off and other not in ("", self.name):
            return f"the joints belong to {other}"
        return self.off or self.trouble

    def enable(self) -> None:
        """Take the joints over, whoever owns them.

        Raises:
            StoppedError: the head is stopped.
        """
        epoch = self._loop.owners.permit()
        if self.off:
            self._loop.take_over(self.name, self.joints, epoch)
        self.watch()

    def disable(self, reason: str) -> None:
        """Stop the head and give the joints up, also after a STOP has ended."""
        with self.lock:
            self._halt(reason)
            self._disabled = reason
            self._loop.owners.release(self.name)
        self.watch()

    def save(self) -> None:
        """Keep what was learned of the servos for the next run; called at the end."""
        with self.lock:
            self.mode.save(self.memory)

    def fail(self, reason: str, command: HeadCommand | None) -> None:
        """Stop the head by a command and give the joints up, for something is wrong with it."""
        self._log.error(f"the head is stopped: {reason}")
        self.send(command)
        self.disable(reason)

    def watch(self) -> None:
        """Notice what has changed; called by `update` and, lest nothing is measured, by others."""
        with self.lock:
            self._notice_owners()
            self._look()
            if self._is_wrong:
                self.end_task(self.trouble)

    def _notice_owners(self) -> None:
        owners = self._loop.owners
        owned, epoch = seen = owners.owns(self.name, self.joints), owners.epoch.value
        if seen == self._seen:
            return
        others = set(owners.of(self.joints).values()) - {"", self.name}
        if self._seen[0] and not owned and others:
            self._disabled = f"{' and '.join(sorted(others))} has taken the head over"
            owners.release(self.name)  # the other joint, too
        if epoch != self._seen[1]:
            self.is_cautious, self._cautious_for = True, 0.0
        self._seen = seen
        self.error = None
        self.end_task(self.off or STOPPED, TaskEnd.DISABLED)
        self.forget_targets()
        self.mode.enable(self.off, self.now)

    # The cycle

    def update(self) -> None:
        """Decide where the joints go now, and send it; see `ControlLoop`."""
        with self.lock:
            self._notice_owners()
            reading = self._look()
            while self._placer is not None and self._inbox:
                self._placer.offer(*self._inbox.popleft())
            if reading is None:
                self.error = None
                return
            self.mode.measured(reading)
            if self._is_due(reading):
                self._fresh = True
                task, self.law.at_most = self.task, self.fastest
                self.send(self.mode.step(self, reading) if task is None else self._step(reading))

    def publish(self) -> None:
        """Let others know, after the write."""
        with self.lock:
            if self._is_wrong:
                self.end_task(self.trouble)
            if self.task is not None:
                self.task.report(self.now)
        error, self._fresh = self.error if self._fresh else None, False
        self._observer(error)

    def _look(self) -> HeadReading | None:
        """Return the reading. What is wrong in two looks, half a cycle apart, ends a task.

        At the first of them, this program itself may have been held up.
        """
        reading, now = self.reading(), time.monotonic()
        self._wrong_since = min(self._wrong_since, now) if self.trouble else math.inf
        self._is_wrong = now - self._wrong_since > 0.5 * self.period
        return reading

    def _is_due(self, reading: HeadReading) -> bool:
        before, measured = self._stepped
        passed, newer = reading.now - before, reading.stamp - measured
        if 0.0 <= passed < 0.5 * self.period:
            return False  # joint states that were held up come all at once; or time stands still
        if 0.0 <= newer < 0.75 * self.period and 0.0 <= passed < 1.5 * self.period:
            return False  # joints are measured more often
        self._stepped = reading.now, reading.stamp
        return True

    def send(self, command: HeadCommand | None) -> None:
        """Write the goals of a command, unless the head was stopped or given up meanwhile."""
        if command is None or self.off or self._epoch != self._loop.owners.epoch.value:
            return
        pan, tilt = self.joints
        goals = {
            pan: Goal(command.pan, command.pan_speed),
            tilt: Goal(command.tilt, command.tilt_speed),
        }
        self._loop.write(self.name, goals, self._epoch)

    @property
    def now(self) -> float:
        """The time [s]."""
        return self._clock.now(simulated=self._is_simulated())

    def reading(self) -> HeadReading | None:
        """Return the head as measured; None without a robot or a fresh measurement.

        The clock and the robot's model are checked first. What is missing is logged, and is the
        `trouble` from then on.
        """
        self._epoch = self._loop.owners.epoch.value
        self._check_clock()
        self._check_model()
        if self._placer is None:
            self.warn("model", self.trouble)
            return None
        now, found, stamps = self._clock.checked, [], []
        for joint in self.joints:
            stamp, position = self._buffer.latest_joint_position(joint) or (-1, None)
            age = now - (self._listening_since if stamp < 0 else stamp) * 1e-9
            if abs(age) > self._parameters.joint_state_timeout:
                self.trouble = self._clock.standing or (
                    f"no position of {joint} in joint_states: the head is left alone"
                    if age > 0.0
                    else f"the positions of {joint} in joint_states lie in the future (the clocks "
                    "of their sender and of this machine differ): the head is left alone"
                )
                self.warn(joint, f"{self.trouble} (by {abs(age):.1f} s)")
                return None
            if position is None:
                self.trouble = self._clock.standing or f"waiting for {joint} in joint_states"
                return None
            found.append(position)
            stamps.append(stamp)
        self.trouble = self._clock.standing
        return HeadReading(now, min(stamps) * 1e-9, (found[0], found[1]))

    def _check_clock(self) -> None:
        happened = self._clock.check(simulated=self._is_simulated())
        now = round(self._clock.checked * 1e9)
        self._listening_since = self._listening_since or now
        if happened:
            self._log.warning(f"{happened}: everything starts anew, and the head holds")
            self._listening_since = now
            if not self._clock.standing:
                self._buffer.clear()
            self.forget_targets()
            self.end_task(happened)
            self.send(self.mode.reset(happened, self.now))
            self._observer(None)

    def _check_model(self) -> None:
        model = self._buffer.model
        if model is None or model is self._model or model is self._refused_model:
            return
        try:
            self.use(model)
        except RobotModelError as error:
            self._refused_model = model
            if self._model is not None:
                self._buffer.set_model(self._model)
                self._log.error(f"another robot_description is not used: {error}")
            else:
                self.trouble = f"robot_description cannot be used: {error}"

    def use(self, model: RobotModel) -> None:
        """Turn the head of another model from now on.

        Raises:
            RobotModelError: the model has no such head.
        """
        p = self._parameters
        head = p.head(model, self._pointing_frame)
        fixed_frame = p.fixed_frame or head.base_frame
        if fixed_frame in model.links and any(
            joint.name in self.joints for joint in model.joints_above(fixed_frame)
        ):
            raise RobotModelError(
                f"fixed_frame is {fixed_frame!r}, which moves with the head; choose a frame that "
                f"stands still, such as {head.base_frame} or odom"
            )
        self.end_task("another robot_description has come")
        self.head, self._model = head, model
        self._carried.clear()
        self._placer = TargetPlacer(self._buffer, fixed_frame, p.transform_timeout)
        moves = fixed_frame != head.base_frame
        self._base = HeadBase(self._buffer, fixed_frame, head.base_frame) if moves else None
        fastest = min(_FASTEST, max(head.pan_limits.velocity, head.tilt_limits.velocity))
        self.law = PredictiveLaw(head, self.period, SpeedLimits(max_joint_speed=fastest))
        backend = self._loop.backend
        self.memory = ServoMemory({j: backend.servo(j) for j in self.joints} if backend else {})
        self.law.expect(self.memory.load())
        self.mode.use(self, head, self._base)
        self._log.info(f"ready to point {head.pointing_frame} at target_point")

    # After a STOP

    @property
    def fastest(self) -> float:
        """The highest speed now [rad/s]: low after a STOP, rising while no target is met."""
        if not self.is_cautious:
            return math.inf
        return CAUTIOUS_SPEED * math.pow(2.0, max(0.0, self._cautious_for - _CAUTIOUS_TIME))

    def approached(self, error: float) -> None:
        """End the caution where the head misses a target by little [rad], or has become fast."""
        self._cautious_for += self.period
        if error < AT_GOAL or self.fastest > _FAST:
            self.is_cautious = False

    # Targets

    def accept(self, target: Target) -> None:
        """Keep a target for the next cycle."""
        if self._placer is not None:
            self._inbox.append((self._dated(target), self.now))

    def forget_targets(self) -> None:
        """Drop targets that wait for their transforms."""
        self._inbox.clear()
        if self._placer is not None:
            self._placer.forget()

    def recenter(self) -> str:
        """Turn the head to its centre and return an empty string, or why not."""
        with self.lock:
            reading = self.reading()
            if reading is None or self.off:
                return self.off or self.trouble
            self.forget_targets()
            self.end_task("the head is recentred")
            self.outcome = "recentring"
            self.send(self.mode.recenter(self, reading))
        return ""

    def take_targets(self, reading: HeadReading) -> list[tuple[Target, Vector3]]:
        """Return new targets and their places in the fixed frame; see `TargetPlacer.place`."""
        assert self._placer is not None
        placed = self._placer.place(reading.now, self._named(reading.positions))
        for target, point in placed:
            self._keep(target, point, reading.now)
        return placed

    def take_latest_target(
        self, positions: tuple[float, float], now: float
    ) -> tuple[Target, Vector3] | None:
        """Return the latest target only, and its place in the head's base frame as it is now."""
        assert self._placer is not None
        placed = self._placer.place_newest(now, self._named(positions))
        if placed is None:
            return None
        self._keep(*placed, now)
        try:
            return placed[0], self.from_base(placed[1], now)
        except TransformException as error:
            self.refuse(Refusal(placed[0], str(error)))
            return None

    def take_refusal(self) -> str:
        """Return why a target has led to nothing since the last call; empty: none has."""
        assert self._placer is not None
        refusal = self._placer.take_refusal()
        return self.refuse(refusal) if refusal else ""

    def refuse(self, refusal: Refusal) -> str:
        """Log that a target leads to nothing, and return the reason."""
        target, reason = refusal
        self.warn(f"target in {target.frame_id}", f"target {target} refused: {reason}")
        return reason

    def take_placed(self) -> list[tuple[float, Vector3]]:
        """Return the targets since the last call: stamps [s], points in the head's base [m]."""
        placed = []
        while self._placed:
            stamp, point = self._placed.popleft()
            base = self._base
            placed.append((stamp, point if base is None else base.at(stamp).inverse() @ point))
        return placed

    def is_carried(self, frame_id: str) -> bool:
        """Return whether a frame moves when the head does."""
        if frame_id not in self._carried:
            assert self.head is not None
            frames = self.head.base_frame, frame_id
            look_up = self._buffer.lookup_transform
            here, there = self._named((0.0, 0.0)), self._named((0.1, 0.1))
            try:
                one = look_up(*frames, LATEST, joint_positions=here)
                other = look_up(*frames, one.stamp, joint_positions=there)
            except TransformException:
                return False
            self._carried[frame_id] = one.transform != other.transform
        return self._carried[frame_id]

    def place_at_stamp(self, target: Target, positions: tuple[float, float]) -> Vector3:
        """Return a target in the fixed frame, as it was at its stamp.

        Args:
            target: as sent.
            positions: pan and tilt [rad] for a target without a stamp that the head carries.

        Raises:
            TransformException: that is not known, or not yet.
        """
        assert self._placer is not None
        return self._placer.place_one(self._dated(target), self._named(positions))

    def from_base(self, point: Vector3, now: float) -> Vector3:
        """Return a point of the fixed frame, from the head's base as that is now.

        Raises:
            TransformException: it is not known where the base is.
        """
        if self._base is None:
            return point
        unknown = self._base.update()
        if unknown:
            raise TransformException(unknown)
        return self._base.pose(now).inverse() @ point

    def place_latest(self, target: Target) -> tuple[Vector3, float | None]:
        """Return a target from the head's base by the latest transforms, and when that was [s].

        None: it never moves there.

        Raises:
            TransformException: that is not known.
        """
        assert self.head is not None
        found = self._buffer.lookup_transform(self.head.base_frame, target.frame_id, LATEST)
        return found.transform @ target.point, found.stamp * 1e-9 if found.stamp else None

    def pointing(self, frame: str, axis: tuple[float, float, float]) -> PanTiltHead:
        """Return the head, as it points another frame.

        Args:
            frame: any that it carries; empty: its own.
            axis: the direction in it to point; all 0: the usual one of that frame.

        Raises:
            RobotModelError: that cannot be pointed.
        """
        assert self._model is not None
        assert self.head is not None
        frame = frame or self._pointing_frame
        if not any(axis) and frame == self._pointing_frame:
            return self.head
        return self._parameters.head(self._model, frame, axis)

    def _keep(self, target: Target, point: Vector3, now: float) -> None:
        self.target = target
        self._placed.append((target.stamp * 1e-9 if target.stamp else now, point))

    def _named(self, positions: tuple[float, float]) -> dict[str, float]:
        return dict(zip(self.joints, positions, strict=True))

    def _dated(self, target: Target) -> Target:
        latency = round(self._parameters.target_latency * 1e9)
        return replace(target, stamp=max(1, target.stamp - latency)) if target.stamp else target

    # Tasks

    def turn(
        self,
        p: PointingParameters,
        head: PanTiltHead | None = None,
        max_velocity: float = math.inf,
        min_duration: float = 0.0,
    ) -> Turn:
        """Return a turn to a point, not faster than is allowed now.

        Args:
            p: how to turn.
            head: what is pointed; None: the usual frame.
            max_velocity: of either joint [rad/s], if lower than that of `p`.
            min_duration: the turn takes so long at least [s].
        """
        head = head or self.head
        assert head is not None
        velocity = min(p.max_velocity, max_velocity, self.fastest)
        return Turn(head, velocity, min_duration, p.success_angle_threshold, p.settle_time)

    def carry_out(self, task: HeadTask) -> None:
        """Begin a task; what is under way is preempted."""
        with self.lock:
            self._before = self.task
            if not (task.is_streamed and self.task is not None and self.task.is_streamed):
                self.end_task(f"preempted by a newer goal: {task.title}", TaskEnd.PREEMPTED)
                self._log.info(task.title)
                for joint, watch in zip(self.joints, self._watches, strict=True):
                    self._loop.stuck.pop(joint, None)  # what was found out until now
                    watch.restart()
            self.mode.enable(task.title, self.now)
            self.forget_targets()
            self.task, self._rejected = task, ""

    def reject(self, reason: str) -> None:
        """Record why a task was not begun."""
        self.outcome = self._rejected = f"rejected: {reason}"

    @property
    def task_state(self) -> str:
        """The state of the task, for a person, and why another one was not begun since."""
        title = "" if self.task is None else self.task.title
        return "; ".join(filter(None, (title, self._rejected)))

    def cancel(self, task: HeadTask) -> None:
        """End a task, if it is under way, and hold the head."""
        with self.lock:
            if self.task is task:
                self.hold("the head holds", TaskEnd.CANCELED)

    def hold(self, reason: str, end: TaskEnd = TaskEnd.PREEMPTED) -> None:
        """Stop the head where it is, end its task, and forget its target.

        Args:
            reason: why.
            end: of the task.
        """
        with self.lock:
            self._halt(reason)
            self.end_task(reason, end)
            self.mode.enable(self.off, self.now)
            self.forget_targets()
            self.error = None

    def _halt(self, reason: str) -> None:
        reading = self.reading()
        if reading is not None:
            self.send(self._stop(reading) or self.mode.enable(reason, reading.now))

    def conclude(self, outcome: str, *, arrived: bool) -> None:
        """Record how a turn to a target has ended."""
        self.outcome = outcome
        if arrived:
            self.is_cautious = False
            self._log.info(outcome)
        else:
            self._log.warning(outcome)

    def end_task(self, reason: str, end: TaskEnd = TaskEnd.ABORTED) -> None:
        """End the task, if there is one, because of something else."""
        if self.task is not None:
            self.task.end(end, reason)
            self._close(self.task)

    def start_from(
        self, reading: HeadReading, before: HeadTask | None
    ) -> tuple[JointPoint, JointPoint]:
        """Return the desired states of the joints now, from which something new begins.

        Args:
            reading: of the joints.
            before: what it replaces.
        """
        desired = None if before is None else before.desired(reading.now)
        if desired is not None:
            return desired
        pan, tilt = (
            JointPoint(held if abs(held - here) < AT_GOAL else here)
            for here, held in zip(reading.positions, self._held or reading.positions, strict=True)
        )
        return pan, tilt

    def _step(self, reading: HeadReading) -> HeadCommand | None:
        task, law = self.task, self.law
        assert task is not None
        self.forget_targets()
        if task.reading is None:
            pan, tilt = self.start_from(reading, self._before)
            task.start, self._before = (pan.position, tilt.position), None
        task.reading = reading
        command = task.step(reading, law)
        if isinstance(task, PointTask) and task.miss is not None:
            self.target = task.target
        desired = task.desired(reading.now)
        if desired is not None:
            self._held = desired[0].position, desired[1].position
            stuck = "" if task.result else self._stuck(desired, reading, law)
            if stuck:
                end = TaskEnd.ABORTED
                if task.miss is not None:
                    end, stuck = TaskEnd.MISSED, f"{PointingResult(False, task.miss)} ({stuck})"
                task.end(end, stuck, TrajectoryCode.PATH_TOLERANCE_VIOLATED)
                command = self._stop(reading)
        self.error = task.miss
        if task.result:
            self._close(task)
        return command

    def _stuck(
        self, desired: tuple[JointPoint, JointPoint], reading: HeadReading, law: PredictiveLaw
    ) -> str:
        """Return why a joint does not move as commanded, by the bus or by its position."""
        for watch, delay in zip(self._watches, law.delays, strict=True):
            watch.patience = _START_TIME + delay
        goals = [point.position for point in desired]
        speeds = [abs(point.velocity or 0.0) for point in desired]
        standing = stalled(self._watches, goals, speeds, reading.positions, reading.stamp)
        return "; ".join(filter(None, map(self._loop.stuck.get, self.joints))) or standing

    def _stop(self, reading: HeadReading) -> HeadCommand | None:
        """Return the command that stops the task; None: there is none."""
        self._held = None
        if self.task is None:
            return None
        return self.law.stop(reading.joints)

    def _close(self, task: HeadTask) -> None:
        assert task.result is not None
        self.task, self.error = None, None
        arrived = task.result.end is TaskEnd.SUCCEEDED
        self.conclude(f"{task.title}: {task.result}", arrived=arrived)
        self.outcome = str(task.result)
        self.mode.enable(self.off, self.now)

    def warn(self, about: str, text: str) -> None:
        """Log a warning, but not the same again and again."""
        now = time.monotonic()
        if now - self._logged.get(about, -math.inf) >= _LOG_PERIOD:
            if len(self._logged) >= _MOST_LOGGED:
                self._logged.clear()
            self._logged[about] = now
            self._log.warning(text)
