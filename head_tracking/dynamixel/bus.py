"""The servo bus: all servos of one port, read and written in one cycle.

    read     one request for each kind of servo, or one for each servo
    steps    of what takes longer (torque on, a servo that returns, recovery, EEPROM), if there is
             any: as many as leave the cycle within twice its usual time
    write    goals and speeds, one sync write for each protocol

What is known before a cycle is computed before it: the plan of the requests is made anew only when
a servo falls silent or returns, and a cycle without trouble takes one branch past all that deals
with trouble.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Future
from contextlib import suppress
from typing import Any, Final, NamedTuple, TypeVar

from head_tracking.dynamixel.adapter import Adapter
from head_tracking.dynamixel.configuration import (
    BusSettings,
    EepromSettings,
    JointConfiguration,
    check_configuration,
)
from head_tracking.dynamixel.diagnosis import Diagnosis
from head_tracking.dynamixel.exceptions import (
    BusStoppedError,
    CommunicationError,
    ConfigurationError,
    CorruptReplyError,
    DynamixelError,
    GoalError,
    NotConnectedError,
    PortError,
    PortLostError,
    ReplyTimeoutError,
    ServoError,
    ServoNotFoundError,
    TorqueError,
)
from head_tracking.dynamixel.joint import Joint
from head_tracking.dynamixel.port import DynamixelPort
from head_tracking.dynamixel.procedures import confirming, release
from head_tracking.dynamixel.protection import Protection
from head_tracking.dynamixel.protocol import ErrorBits
from head_tracking.dynamixel.reading import Failed, ReadGroup, ReadMethod, Reply, Retried
from head_tracking.dynamixel.requests import Epoch, Request, RequestQueue, Steps
from head_tracking.dynamixel.servo import Servo, ServoIdentity, answering, run, summary
from head_tracking.dynamixel.state import (
    BusEvent,
    BusReading,
    BusStatistics,
    CommandResult,
    EventKind,
    Goal,
    ServoState,
    Torque,
    check_speed,
)

_T = TypeVar("_T")

_SHARE: Final = 10
"""Silence may take a tenth of the bus's time: a servo that cost 2 ms rests for 18 ms."""
_LONGEST_WAIT: Final = 100_000_000  # ns that are believed; a clock may jump
_PATIENCE: Final = 0.3  # s after which silent servos are asked again, in case the machine was busy
_CONVINCED: Final = 3  # times that a servo must seem unusable
_STEADY: Final = 10_000_000_000
"""ns. A servo that is lost twice within this time is reported once, until it stays for so long."""
_BRAKING: Final = 0.6  # s that a joint may take to stop
_STANDS: Final = 0.1  # rad/s
_MOST_STEPS: Final = 100  # in a cycle, should a clock stand still
_GAIN: Final = 0.05


class _Part(NamedTuple):
    """One request of a cycle and whom it reads."""

    group: ReadGroup
    members: list[tuple[Joint, Servo]]
    retries: int


class ServoBus:
    """Reads and drives the servos of one port.

    One thread owns the bus: it calls `connect`, `step`, everything that talks to servos, and
    `close` (`BusThread` is that thread). Any thread may call `command`, `set_speed`, and what only
    looks.

    Servos start relaxed. The first command to a joint switches its torque on; after
    `switching_torque(..., False)` commands are refused until `switching_torque(..., True)`. Goals
    outside the limits never reach the wire, nor does a moving speed of 0, nor a goal for a relaxed
    servo.

    Servos that fall silent, and the adapter, may go and come back at any time: `step` goes on
    with what is there and looks for the rest.

    What takes several transactions, such as `recovering`, comes as steps: `submit` spreads them
    over the cycles, `run` takes them at once.

    Args:
        port: Where the servos are.
        joints: The joints to drive.
        clock: Time for the stamps of measurements, ns.
        monotonic: Time that never jumps, ns.
        settings: How to deal with silence, faults and heat.
        pause: Waits so many seconds, outside the cycle.
        epoch: Counts STOPs; shared with everything that is stopped together. None: its own.

    Attributes:
        requests: What is to be done, and the goals that have not been written.

    Raises:
        ConfigurationError: The joints contradict each other.
    """

    def __init__(
        self,
        port: DynamixelPort,
        joints: Iterable[JointConfiguration],
        clock: Callable[[], int] = time.time_ns,
        *,
        monotonic: Callable[[], int] = time.monotonic_ns,
        settings: BusSettings | None = None,
        pause: Callable[[float], object] = time.sleep,
        epoch: Epoch | None = None,
    ) -> None:
        self._settings = settings = settings or BusSettings()
        self._port = port
        self._clock = clock
        self._monotonic = monotonic
        self._pause = pause
        self._joints = {
            joint.joint_name: Joint(joint, port, settings.watchdog)
            for joint in check_configuration(joints)
        }
        self._all = tuple(self._joints.values())
        self._protection = Protection(self._note, self._cut, settings)
        self._told = self._protection.told
        self._diagnosis = Diagnosis(
            self._note, self._cut, self._enqueue, self._clear_watchdog, settings
        )
        self._rest = settings.rest
        self._watchdog = round(settings.watchdog * 1e9)
        self._connected = False
        self._look_again_at: int | None = None  # the port has gone; ns
        self._port_losses = 0
        self._cycles = 0
        self._last_cycle = 0
        self._usual = 0.0  # ns that a cycle without steps and without trouble takes
        self._took = self._spent = 0  # ns of this cycle: reading; asking one that is lost
        self._there = self._troubled = False  # the port, in this cycle; anything not as usual
        self._plan: list[_Part] | None = None
        self._lost: tuple[str, ...] = ()
        self._incomplete: tuple[str, ...] = ()  # joints with a servo that is lost
        self._missing = True  # some servo may be lost
        self._watched = False
        self.requests = RequestQueue(epoch or Epoch(), monotonic)
        self._obeyed = self.requests.epoch.value  # the last STOP that has been carried out
        self._events: list[BusEvent] = []
        self._refused = self._clamped = 0
        self._problems: dict[int, tuple[str, int]] = {}

    # Any thread

    def command(
        self,
        goals: Mapping[str, Goal],
        *,
        clamp: bool = False,
        claim: Callable[[Iterable[str]], object] | None = None,
        epoch: int | None = None,
    ) -> CommandResult:
        """Set the goals of some joints, all or none; the newest goal of a joint wins.

        The goals are written in the owner's next cycle. Speeds above a joint's `speed_limit` are
        reduced to it.

        Args:
            goals: Goal by joint name.
            clamp: Move positions outside the limits to the limit instead of refusing them. One
                tick of excess always counts as being on the limit.
            claim: Gets the joints that shall move before they do; it may refuse, by raising.
            epoch: When the command was made, see `Epoch`; None: now.

        Raises:
            GoalError: A joint is unknown or takes no commands now, a position is not finite or
                outside the limits, a speed is not finite or not above 0, or no joint of the
                command answers. Nothing has changed.
            StoppedError: STOP came after the command was made. Nothing has changed.
            NotConnectedError: `connect` has not been called.
        """
        if not self._connected:
            self._require_connection()
        if epoch is None:
            epoch = self.requests.epoch.value
        else:
            self.requests.check(epoch)
        positions: dict[str, float] = {}
        clamped: dict[str, float] = {}
        admitted: dict[str, Goal] = {}
        lost: tuple[str, ...] = ()
        try:
            for name, goal in goals.items():
                joint = self._joints.get(name) or self._joint(name)
                position = joint.admit(goal, clamp)
                if self._incomplete and name in self._incomplete:
                    lost += (name,)
                    continue
                positions[name] = position
                if position == goal.position:
                    admitted[name] = goal
                    continue
                admitted[name] = Goal(position, goal.speed)
                if abs(position - goal.position) > joint.configuration.resolution:
                    clamped[name] = position - goal.position
            if lost and not positions:
                raise GoalError(
                    f"command refused: the servo of {', '.join(lost)} does not answer; it is asked "
                    "again all the time and can be commanded once it answers"
                )
        except GoalError:
            self._refused += 1
            raise
        if claim is not None:
            claim(positions)
        self.requests.put_goals(admitted, epoch)
        if clamped:
            self._clamped += 1
        return CommandResult(positions, clamped, lost)

    def set_speed(self, joint: str, speed: float) -> None:
        """Set the speed, rad/s, for commands that give none, also for one under way.

        Raises:
            GoalError: The joint is unknown, or the speed not finite or not above 0.
        """
        check_speed(joint, speed)
        self._joint(joint).set_default_speed(speed)

    def speed(self, joint: str) -> float:
        """Return the speed for commands that give none, rad/s; raises GoalError if unknown."""
        found = self._joint(joint)
        return min(found.default_speed, found.configuration.speed_limit)

    def torque(self, joint: str) -> Torque:
        """Return the torque of a joint; raises GoalError if it is unknown."""
        return self._joint(joint).torque

    def limits(self, joint: str) -> tuple[float, float]:
        """Return lowest and highest position, rad, that configuration and servo allow.

        Raises:
            GoalError: The joint is unknown.
        """
        return self._joint(joint).limits

    def check_limits(self, joint: str, lowest: int, highest: int) -> None:
        """Refuse what `set_limits` would refuse; changes nothing."""
        self._joint(joint).check(lowest, highest)

    @property
    def epoch(self) -> Epoch:
        """Counts STOPs."""
        return self.requests.epoch

    @property
    def port_name(self) -> str:
        """Device that the servos are on."""
        return self._port.name

    @property
    def adapter(self) -> Adapter:
        """What is known about the device since it was opened."""
        return self._port.adapter

    @property
    def joints(self) -> tuple[JointConfiguration, ...]:
        """The configured joints."""
        return tuple(joint.configuration for joint in self._all)

    @property
    def servos(self) -> tuple[ServoIdentity, ...]:
        """What was found on the bus; empty before `connect`."""
        found = (servo.identity for _, servo in self._each_servo())
        return tuple(identity for identity in found if identity is not None)

    @property
    def summary(self) -> str:
        """A line that says what was found, such as "2 AX-12 servos: ids 1, 2"."""
        return summary(list(self.servos))

    def statistics(self) -> BusStatistics:
        """Return the counters."""
        return BusStatistics(
            self._cycles,
            self._refused,
            self._clamped,
            tuple(
                servo.statistics(joint.torque, joint.stopped, *self._diagnosis.of(servo.id))
                for joint, servo in self._each_servo()
            ),
            self._connected and self._look_again_at is None,
            self._port_losses,
            self._port.adapter,
        )

    # Owner's thread: connecting and closing

    def connect(self, *, allow_missing: bool = False) -> str:
        """Open the port, find all servos, relax them, and return a line that says what is there.

        Args:
            allow_missing: Go on without the servos that do not answer, and look for them.

        Returns:
            A summary such as "2 AX-12 servos: ids 1, 2".

        Raises:
            PortError: The port cannot be opened.
            ServoNotFoundError: A configured id does not answer.
            ServoError: A servo is another model, in wheel mode, silent, or does not relax.
            ConfigurationError: A servo's own angle limits leave a joint no range.
            CommunicationError: A servo answers pings, but then fails.
        """
        servos = [servo for _, servo in self._each_servo()]
        self._port.open()
        try:
            found = answering(iter(servos))
            if len(found) < len(servos):
                self._pause(_PATIENCE)
                found += answering(servo for servo in servos if servo.id not in found)
            if len(found) < len(servos) and not allow_missing:
                asked = [servo.id for servo in servos]
                raise ServoNotFoundError(asked, found, self._port.name, self._port.baud_rate)
            for servo in servos:
                if servo.id in found:
                    self._identify_at_once(servo)
                else:
                    servo.lose(0)
        except BaseException:
            self._port.close()
            raise
        self.requests.drop_goals()
        self._look_again_at = None
        self._obeyed = self.requests.epoch.value
        self._connected = True
        self._plan = None
        self._last_cycle = self._monotonic()
        for joint, servo in self._each_servo():
            self._note_shortcomings(joint, servo)
        for joint in self._all:
            joint.confirmed = joint.complete
        self._diagnosis.swapped(self._all)
        return self.summary

    def _identify_at_once(self, servo: Servo) -> None:
        try:
            run(servo.identify())
            servo.read_feedback(3)
        except CorruptReplyError as cause:
            raise CorruptReplyError(f"{cause}; {self._advice(servo)}") from cause

    def _note_shortcomings(self, joint: Joint, servo: Servo) -> None:
        identity, first = servo.identity, servo.model.watchdog
        if identity is None or servo.lost:
            return
        if identity.faulted:
            self._note(
                EventKind.FAULTED,
                joint,
                f"servo {servo.id} has shut itself down before; it takes no commands until "
                "somebody calls recover",
            )
        if first is not None and self._watchdog and not servo.watched:
            self._note(
                EventKind.ALARM,
                joint,
                f"servo {servo.id} has firmware {identity.firmware_version}, which has no Bus "
                f"Watchdog ({first} has): should this program die, it goes on to its goal",
            )

    def close(self) -> tuple[str, ...]:
        """Brake, relax every servo, close the port. Never raises for what happens on the wire.

        Returns:
            Joints that did not confirm that they are relaxed.
        """
        self.requests.end_all(BusStoppedError("the servo bus has stopped"))
        problems: Mapping[str, str] = {}
        try:
            if self._connected:
                with suppress(DynamixelError):
                    self._brake()
                problems = run(self._relax(self._all, disarm=True), self._pause)
        finally:
            self._connected = False
            self._port.close()
        return tuple(name for name, problem in problems.items() if problem)

    def _brake(self) -> None:
        """Hold every joint where it is, and wait until it stands."""
        self.hold()
        moving = [joint for joint in self._all if joint.on]
        deadline = self._monotonic() + round(_BRAKING * 1e9)
        for _ in range(round(_BRAKING / 0.002)):
            moving = [joint for joint in moving if not self._stands(joint)]
            if not moving or self._monotonic() > deadline:
                return
            self._pause(0.002)

    def _stands(self, joint: Joint) -> bool:
        for servo in joint.servos:
            if servo.lost:
                continue
            block = servo.model.feedback
            try:
                reply = self._port.read(servo.id, block.address, block.length, servo.model.protocol)
            except CommunicationError:
                return False
            servo.take(reply, servo.stamp)
            if abs(servo.velocity) > _STANDS:
                return False
        return True

    def hold(self) -> None:
        """Stop now: make the present position the goal of every joint with torque on.

        Raises:
            PortLostError: The port has gone.
            NotConnectedError: `connect` has not been called.
        """
        self._require_connection()
        self.requests.drop_goals()
        for joint in self._all:
            joint.hold(self._settings.retries)
        self._write_goals(also_silent=True)

    # Owner's thread: the cycle

    def step(self) -> BusReading:
        """Run one cycle: `read`, then `write`."""
        reading = self.read()
        events = self.write()
        return reading._replace(events=(*reading.events, *events)) if events else reading

    def read(self) -> BusReading:
        """Begin a cycle: read every servo, and look after those that are not as usual.

        Returns:
            What was read in this cycle; joints that did not answer are absent.

        Raises:
            NotConnectedError: `connect` has not been called.
            PortLostError: The port has gone and cannot come back under its name.
        """
        if not self._connected:
            self._require_connection()
        self._cycles += 1
        start = self._monotonic()
        stamp = self._clock()
        states: dict[str, ServoState] = {}
        failed: tuple[str, ...] = ()
        self._there = self._troubled = False
        self._spent = 0
        if self._obeyed != self.requests.epoch.value:
            self._obey_stop()
        try:
            if (self._look_again_at is None and self._port.is_open) or self._port_is_there():
                if self._watched and start - self._last_cycle > self._watchdog:
                    self._stood_still(start - self._last_cycle)
                self._last_cycle = start
                plan = self._plan
                self._troubled = plan is None
                if plan is None:
                    plan = self._make_plan()
                if self._read(plan, stamp, states) or self._troubled:
                    self._troubled = True
                    failed = self._settle(plan, states, start)
                self._diagnosis.look(self._all, start)
                self._spent = self._poll_one_lost() if self._missing else 0
                self._there = True
        except PortLostError as cause:
            self._forgive(cause)
        self._took = self._monotonic() - start
        events = self._take_events() if self._events else ()
        return BusReading(self._cycles, stamp, states, failed, self._lost, events)

    def write(self) -> tuple[BusEvent, ...]:
        """End a cycle: write all goals, take steps of what is under way.

        Returns:
            What has happened meanwhile.

        Raises:
            PortLostError: The port has gone and cannot come back under its name.
        """
        if not self._there or not self._connected:
            return ()
        start = self._monotonic()
        try:
            requests = self.requests
            if self._obeyed != requests.epoch.value:
                self._obey_stop()
            if requests.goals:
                self._take_goals()
            if requests.under_way:
                self._troubled = True
                self._take_steps(self._spent)
                if requests.goals:
                    self._take_goals()  # of a joint whose torque has come on
            self._write_goals()
            if not (self._troubled or self._spent):
                took = self._took + self._monotonic() - start
                self._usual += _GAIN * (took - self._usual) if self._usual else took
        except PortLostError as cause:
            self._forgive(cause)
        return self._take_events() if self._events else ()

    def _forgive(self, cause: PortLostError) -> None:
        if not self._port.comes_back:
            raise cause
        self._lose_port(str(cause))

    def _take_events(self) -> tuple[BusEvent, ...]:
        events, self._events = tuple(self._events), []
        return events

    def _read(self, plan: list[_Part], stamp: int, states: dict[str, ServoState]) -> bool:
        """Read all servos into the states; return whether anything was not as usual."""
        port, rest, told = self._port, self._rest, self._told
        timeout = self._settings.command_timeout
        troubled = False
        begin = port.clock()
        for part in plan:
            asked_at = port.clock() if part.group.method is ReadMethod.EACH else begin
            replies = port.read_group(part.group, part.retries)
            for (joint, servo), reply in zip(part.members, replies, strict=True):
                if type(reply) is Reply and not servo.failed_cycles and not servo.unseen:
                    servo.counters.replies += 1
                    servo.take(reply, stamp + int((reply.stamp - begin) * 1e9))
                    states[joint.name] = state = joint.state()
                    if (
                        reply.error
                        or servo.errors
                        or servo.interrupted
                        or state.temperature >= rest
                        or joint.resting
                        or (told and servo.id in told)
                        or timeout
                    ):
                        troubled = True
                else:
                    troubled = True
                    self._take_unusual(servo, reply, stamp, begin, asked_at)
        return troubled

    def _take_unusual(
        self,
        servo: Servo,
        outcome: Reply | Retried | Failed,
        stamp: int,
        begin: float,
        asked_at: float,
    ) -> None:
        """Take note of a reply that took several tries, or did not come, or came at last."""
        counters = servo.counters
        causes = () if isinstance(outcome, Reply) else outcome.causes
        for cause in causes:
            servo.count(cause)
        self._plan = None
        if isinstance(outcome, Failed):
            counters.retries += len(causes) - 1
            now = self._monotonic()
            if servo.failed_cycles:
                cost = min(max(0, round((self._port.clock() - asked_at) * 1e9)), _LONGEST_WAIT)
                servo.ask_at = now + cost * (_SHARE - 1)
            else:
                servo.ask_at = 0
            servo.failed_cycles += 1
            silent = isinstance(causes[-1], ReplyTimeoutError)
            servo.damaged_cycles = 0 if silent else servo.damaged_cycles + 1
            return
        counters.retries += len(causes)
        counters.replies += 1
        reply = outcome.reply if isinstance(outcome, Retried) else outcome
        servo.take(reply, stamp + int((reply.stamp - begin) * 1e9))
        servo.unseen = False
        servo.damaged_cycles = 0
        if servo.failed_cycles:
            servo.failed_cycles = servo.ask_at = 0
            servo.interrupted = True

    def _settle(
        self, plan: list[_Part], states: dict[str, ServoState], now: int
    ) -> tuple[str, ...]:
        """Deal with what was not as usual; return the joints that were asked in vain."""
        asked = {servo.id for part in plan for _, servo in part.members}
        failed: list[str] = []
        for joint in self._all:
            there = [s for s in joint.servos if s.id in asked and not (joint.stopped or s.lost)]
            answered = [servo for servo in there if not servo.failed_cycles]
            if answered:
                for servo in answered:
                    if servo.model.protocol == 1:
                        servo.errors = ErrorBits(servo.error & 0x7F)
                state = states[joint.name] = joint.state()
                self._protection.judge(joint, state, now)
                if self._settings.command_timeout and joint.on:
                    self._protection.judge_command(joint, state, now)
            else:
                states.pop(joint.name, None)
                if there:
                    failed.append(joint.name)
            for servo in there:
                if servo.unsteady and now - (servo.lost_at or 0) > _STEADY:
                    servo.unsteady = False
                if servo.failed_cycles >= self._settings.lost_after:
                    self._lose(joint, servo)
        return tuple(failed)

    def _make_plan(self) -> list[_Part]:
        """Return the requests of a cycle: servos that can be read together, together.

        A servo that did not answer last time is asked alone, and last: others would wait for its
        turn to pass.
        """
        now = self._monotonic()
        together: dict[tuple[Any, ...], list[tuple[Joint, Servo]]] = {}
        alone: list[_Part] = []
        settled = True
        for joint, servo in self._each_servo():
            if joint.stopped or servo.lost:
                continue
            block, model = servo.model.feedback, servo.model
            if servo.failed_cycles or servo.unseen:
                settled = False
            if servo.failed_cycles:
                if servo.ask_at <= now:
                    group = ReadGroup(
                        ReadMethod.EACH,
                        model.protocol,
                        block.address,
                        block.length,
                        (servo.id,),
                        servo.plausible,
                    )
                    alone.append(_Part(group, [(joint, servo)], 0))
                continue
            method, plausible = _method(servo), servo.plausible if model.sign_magnitude else None
            key = (method, model.protocol, block.address, block.length, model.ticks, model.endless)
            together.setdefault((*key, plausible is not None), []).append((joint, servo))
        parts = [
            _Part(
                ReadGroup(
                    key[0] if len(members) > 1 else ReadMethod.EACH,
                    key[1],
                    key[2],
                    key[3],
                    tuple(servo.id for _, servo in members),
                    members[0][1].plausible if key[-1] else None,
                ),
                members,
                self._settings.retries,
            )
            for key, members in together.items()
        ]
        self._note_lost()
        self._watched = any(servo.watched for _, servo in self._each_servo())
        plan = [*parts, *alone]
        if settled:
            self._plan = plan
        return plan

    def _note_lost(self) -> None:
        self._lost = tuple([joint.name for joint in self._all if joint.lost])
        self._incomplete = tuple([joint.name for joint in self._all if not joint.complete])
        self._missing = bool(self._incomplete)

    def _take_goals(self) -> None:
        for name, goal in self.requests.take_goals().items():
            joint = self._joints[name]
            if joint.on and not joint.busy:
                joint.aim(goal.position, goal.speed, self._last_cycle)
                continue
            if joint.torque.waits or not joint.complete:
                continue  # since the command was accepted
            self.requests.keep_goal(name, goal)  # until its torque is on
            unseen = [s for s in joint.servos if not s.lost and (s.failed_cycles or s.unseen)]
            if not (joint.busy or joint.awaited or unseen):  # torque needs to know where it stands
                joint.awaited = True
                self._enqueue(self._exclusively(joint, self._switching_on_for_goal(joint)))

    def _switching_on_for_goal(self, joint: Joint) -> Steps[None]:
        joint.awaited = False
        problem = yield from joint.switch_on()
        if problem:
            self._drop_goal(joint)
            if problem != joint.told_problem:  # commands keep coming
                self._note(EventKind.TORQUE_FAILED, joint, f"goal dropped: {problem}")
            joint.told_problem = problem
        else:
            joint.told_problem = ""
            self._note(EventKind.TORQUE_ON, joint, joint.torque.value)

    def _write_goals(self, also_silent: bool = False) -> None:
        packets: dict[tuple[int, int, int], dict[int, bytes]] = {}
        usual = also_silent or not (self._troubled or self._missing)
        for joint in self._all:
            if not joint.on or (joint.busy and not also_silent):
                continue
            if joint.stale:
                joint.encode()
            if not (usual or joint.writable):
                continue
            for servo, share in zip(joint.servos, joint.share, strict=True):
                key = servo.goal_key
                if key in packets:
                    packets[key][servo.id] = share
                else:
                    packets[key] = {servo.id: share}
        for (protocol, address, _), shares in packets.items():
            self._port.sync_write(address, shares, protocol)

    # Owner's thread: what takes longer than one transaction

    def submit(
        self,
        steps: Steps[_T],
        future: Future[_T] | None = None,
        *,
        despite_stop: bool = False,
    ) -> Future[_T]:
        """Take steps, the first one now and the others between the work of the next cycles.

        Args:
            steps: The steps.
            future: Gets what comes of them; if it is cancelled, no further step is taken.
            despite_stop: Whether they go on after a STOP; see `Request`.
        """
        request = self.requests.start(steps, future=future, despite_stop=despite_stop)
        self._advance(request)
        return request.future

    def _enqueue(self, steps: Steps[Any], *, despite_stop: bool = False) -> None:
        """Take steps between the work of the next cycles."""
        self.requests.start(steps, despite_stop=despite_stop)

    def _advance(self, request: Request) -> None:
        try:
            ended = self.requests.advance(request)
        except PortLostError:
            self._plan = None
            raise
        if ended:
            self._plan = None
            self._note_lost()

    def _take_steps(self, spent: int) -> None:
        """Take as many steps as leave the cycle within twice its usual time, but one at least.

        Args:
            spent: What has been taken of that time, ns; then there need not be any step.
        """
        now = self._monotonic()
        begin, longest = now - spent, spent
        if spent and 2 * spent > self._usual:
            return
        for _ in range(_MOST_STEPS):
            request = self.requests.next_due(now)
            if request is None:
                return
            before = now
            self._advance(request)
            now = self._monotonic()
            longest = max(longest, now - before)
            if now - begin + longest > self._usual:
                return

    def _exclusively(self, joint: Joint, steps: Steps[_T]) -> Steps[_T]:
        """Take steps while nobody else takes any for this joint."""
        while joint.busy:
            yield 0.002
        joint.busy = True
        try:
            return (yield from steps)
        finally:
            joint.busy = False

    def run(self, steps: Steps[_T], pause: Callable[[float], object] = time.sleep) -> _T:
        """Take steps at once, after those that are under way; raises what they raise."""
        under_way = self.requests.under_way
        while under_way:
            self._advance(under_way[0])
            under_way.rotate(-1)
        self._plan = None
        return run(steps, pause)

    # Owner's thread: requests

    def switching_torque(self, joints: Iterable[str] | None, on: bool) -> Steps[None]:
        """Return the steps that switch the torque of some joints, or of all (None).

        Torque on holds the present position. Torque off drops the goal; commands are refused until
        torque is switched on again. The first step switches torque off, the others confirm. Of the
        other facts, it changes none: a servo that has shut itself down needs `recovering`, a
        stopped joint `starting`, before and after.

        Raises:
            GoalError: A joint is unknown; nothing was switched.
            TorqueError: Some joints did not confirm; the others were switched.
            NotConnectedError: `connect` has not been called.
        """
        return self._switching_on(joints) if on else self._relaxing(joints, on_request=True)

    def _relax(self, joints: Iterable[Joint], *, disarm: bool = False) -> Steps[dict[str, str]]:
        """Relax joints: the first step switches torque off, the others make sure.

        Returns:
            By joint, why it has not confirmed; empty where it has.
        """
        joints = tuple(joints)
        sure = [joint for joint in joints if joint.stopped and joint.confirmed]
        for joint in joints:
            self._drop_goal(joint)
            joint.relax()
            joint.confirmed = False
        self._plan = None
        with suppress(PortLostError, NotConnectedError):  # what follows finds that out, too
            release(self._port, [servo for joint in joints for servo in joint.servos])
        yield 0.0
        problems: dict[str, str] = {}
        for joint in joints:
            found: list[str] = []
            for servo in joint.servos:
                found.append((yield from confirming(servo, disarm)))
            problem = "; ".join(filter(None, found))
            if joint in sure:
                problem = ""  # it was relaxed when it was stopped; it need not be there any more
            joint.confirmed = not problem
            problems[joint.name] = problem
        return problems

    def _relaxing(
        self, joints: Iterable[str] | None, *, stop: bool = False, on_request: bool = False
    ) -> Steps[None]:
        chosen = self._require_connection(joints)
        for joint in chosen:
            if stop:
                joint.confirmed = joint.confirmed and joint.stopped  # else it must be there
            joint.stopped |= stop
            joint.relaxed |= on_request
        found = yield from self._relax(chosen, disarm=stop)
        for joint in chosen:
            if not found[joint.name]:
                kind = EventKind.STOPPED if stop else EventKind.TORQUE_OFF
                self._note(kind, joint, joint.torque.value)
        problems = {name: problem for name, problem in found.items() if problem}
        if problems:
            raise TorqueError(False, problems)

    def relax_at_once(self, timeout: float, epoch: int | None = None) -> Mapping[str, str]:
        """STOP: relax all joints, whatever else is under way, and go on trying where that fails.

        Commands and requests of before are discarded. The next command switches torque on again,
        except where it was off on request; whoever stops a head refuses commands until it resumes.

        Args:
            timeout: How long servos may take to confirm, s.
            epoch: Begun by this STOP; None: it begins one.

        Returns:
            For each joint what went wrong; empty where its servos have confirmed.
        """
        deadline = self._monotonic() + round(timeout * 1e9)
        self._obeyed = self.requests.epoch.advance() if epoch is None else epoch
        self.requests.discard_older()
        steps = self._relax(self._all)
        try:
            while True:
                self._pause(next(steps))
                if self._monotonic() > deadline:
                    steps.close()
                    break
        except StopIteration as end:
            problems: dict[str, str] = end.value
        else:
            problems = {
                joint.name: "" if joint.confirmed else "it has not confirmed in time"
                for joint in self._all
            }
        if self._connected and any(problems.values()):
            troubled = [name for name, problem in problems.items() if problem]
            self._enqueue(self._relaxing(troubled), despite_stop=True)
        return problems

    def _obey_stop(self) -> None:
        """Carry a STOP out that could not wait until this thread had left the port."""
        self._obeyed = self.requests.epoch.value
        self.requests.discard_older()
        self._enqueue(self._relaxing(None), despite_stop=True)

    def _switching_on(self, joints: Iterable[str] | None) -> Steps[None]:
        chosen = self._require_connection(joints)
        problems: dict[str, object] = {}
        for joint in chosen:  # all in the first step: who relaxes one later is heard
            if not (joint.stopped or joint.faulted or joint.resting):
                joint.relaxed = False
        for joint in chosen:
            try:
                problem = yield from self._exclusively(joint, joint.switch_on())
            except (PortLostError, NotConnectedError) as cause:
                problem = str(cause)
            if problem:
                problems[joint.name] = problem
            else:
                self._note(EventKind.TORQUE_ON, joint, joint.torque.value)
        if problems:
            raise TorqueError(True, problems)

    def recovering(
        self, joints: Iterable[str] | None = None, patience: float = 0.0
    ) -> Steps[tuple[str, ...]]:
        """Return the steps that clear the faults of joints, and leave them relaxed.

        Protocol 1.0 servos are ready at once; others restart and are found again some cycles
        later, which `torque` tells.

        Args:
            joints: The joints; None for all.
            patience: How long to wait for servos that restart, s.

        Returns:
            The joints that had a fault.

        Raises:
            GoalError: A joint is unknown; nothing was done.
            ServoError: A servo does not recover.
            NotConnectedError: `connect` has not been called.
        """
        chosen = [joint for joint in self._require_connection(joints) if joint.faulted]
        problems: dict[str, object] = {}
        for joint in chosen:
            self._drop_goal(joint)
            try:
                problem = yield from self._exclusively(joint, joint.recover(self._monotonic()))
            except (PortLostError, NotConnectedError) as cause:
                problem = str(cause)
            self._plan = None
            if problem:
                problems[joint.name] = problem
            else:
                self._note(
                    EventKind.RECOVERED, joint, "it restarts" if joint.lost else joint.torque.value
                )
        if problems:
            raise ServoError(_told(problems))
        deadline = self._monotonic() + round(patience * 1e9)
        while patience and (waiting := [joint.name for joint in chosen if joint.faulted]):
            if self._monotonic() > deadline:
                raise ServoError(f"{', '.join(waiting)}: does not recover; see /diagnostics")
            yield 0.02
        return tuple(joint.name for joint in chosen)

    def stopping(self, joints: Iterable[str] | None) -> Steps[None]:
        """Return the steps that relax joints, or all (None), out of the cycle until `starting`.

        Raises:
            GoalError: A joint is unknown; nothing was done.
            TorqueError: Some did not confirm that they are relaxed; they are stopped all the same.
            NotConnectedError: `connect` has not been called.
        """
        return self._relaxing(joints, stop=True)

    def starting(self, joints: Iterable[str] | None) -> Steps[None]:
        """Return the steps that take stopped joints, or all (None), back, relaxed and found anew.

        Raises:
            GoalError: A joint is unknown; nothing was done.
            ServoError: A servo is missing, or cannot be used; it is looked for from now on.
            NotConnectedError: `connect` has not been called.
        """
        problems: dict[str, object] = {}
        for joint in self._require_connection(joints):
            if not joint.stopped:
                continue
            try:
                yield from self._exclusively(joint, joint.identify())
            except DynamixelError as cause:
                for servo in joint.servos:
                    servo.lose(0)
                problems[joint.name] = cause
            else:
                self._note(EventKind.STARTED, joint, joint.torque.value)
                for servo in joint.servos:
                    self._note_shortcomings(joint, servo)
            joint.stopped = False
            self._plan = None
        if problems:
            raise ServoError(_told(problems))

    def set_limits(
        self,
        joint: str,
        *,
        lowest: int | None = None,
        highest: int | None = None,
        max_speed: float | None = None,
    ) -> None:
        """Change the limits of a joint; a goal outside moves inside. None leaves one as it is.

        Args:
            joint: The joint.
            lowest: Its `min`, in ticks.
            highest: Its `max`, in ticks.
            max_speed: Highest speed, rad/s; 0 for the model's own.

        Raises:
            GoalError: The joint is unknown.
            ConfigurationError: Its servo cannot do that, or it would turn round; nothing has
                changed.
        """
        self._joint(joint).reconfigure(lowest, highest, max_speed)

    def writing_eeprom(
        self, joint: str, settings: EepromSettings
    ) -> Steps[dict[int, dict[str, tuple[int, int]]]]:
        """Return the steps that write settings into the memory of a relaxed joint's servos.

        They take some 0.1 s for each.

        Args:
            joint: The joint.
            settings: What they shall keep.

        Returns:
            Old and new values of what was changed, by servo id and register name.

        Raises:
            GoalError: The joint is unknown.
            ConfigurationError: A model has no such setting; nothing was written.
            ServoError: A servo has its torque on, or does not keep a value.
            CommunicationError: A servo does not answer.
            NotConnectedError: `connect` has not been called.
        """
        (chosen,) = self._require_connection((joint,))
        return self._exclusively(chosen, self._writing_eeprom(chosen, settings))

    def _writing_eeprom(
        self, joint: Joint, settings: EepromSettings
    ) -> Steps[dict[int, dict[str, tuple[int, int]]]]:
        wanted = {
            servo.id: settings.registers(servo.model, servo.calibration.tick_range)
            for servo in joint.servos
        }
        changed = {}
        self._drop_goal(joint)
        joint.writing = True
        try:
            for servo in joint.servos:
                changed[servo.id] = yield from servo.write_eeprom(wanted[servo.id])
            for servo in joint.servos:
                if not joint.stopped and not servo.lost:
                    yield from servo.identify()
        finally:
            joint.writing = False
        return changed

    # Owner's thread: who goes and who comes

    def _cut(self, joint: Joint) -> None:
        """Relax a joint at once, and make sure of it in the next cycles."""
        steps = self._relax([joint])
        next(steps)
        self._enqueue(self._confirming(joint, steps), despite_stop=True)

    def _confirming(self, joint: Joint, steps: Steps[dict[str, str]]) -> Steps[None]:
        problem = (yield from steps)[joint.name]
        if problem:
            self._note(EventKind.TORQUE_FAILED, joint, f"not confirmed relaxed: {problem}")

    def _stood_still(self, gap: int) -> None:
        """Hold the joints whose servos may have stopped by themselves since the last cycle.

        A tripped watchdog answers reads and ignores goals, so that only the time tells.
        """
        for joint in self._all:
            if joint.on and joint.complete and any(servo.watched for servo in joint.servos):
                self._clear_watchdog(joint, f"the bus stood still for {gap * 1e-9:.1f} s")

    def _clear_watchdog(self, joint: Joint, why: str = "its Bus Watchdog tripped") -> None:
        if not joint.busy:
            self._enqueue(self._exclusively(joint, self._holding(joint, why)))

    def _holding(self, joint: Joint, why: str) -> Steps[None]:
        problem = yield from joint.pin(powered=True)
        self._note(EventKind.HELD, joint, f"{why}; {problem or 'it holds where it is'}")

    def _lose(self, joint: Joint, servo: Servo) -> None:
        now = self._monotonic()
        servo.lose(now + round(self._settings.poll_interval * 1e9))
        self._plan = None
        text = f"no answer in {servo.failed_cycles} cycles in a row; check its cable and power"
        if servo.damaged_cycles >= self._settings.lost_after:
            text = (
                f"damaged replies in {servo.damaged_cycles} cycles in a row; {self._advice(servo)}"
            )
            servo.readable = False  # it is not counted as returned before it can be read
        before, servo.lost_at = servo.lost_at, now
        if before is not None and now - before < _STEADY and not servo.unsteady:
            servo.unsteady = True
            self._note(EventKind.LOST, joint, f"{text}. It comes and goes: told once")
        elif not servo.unsteady:
            self._note(EventKind.LOST, joint, text)
        if joint.lost:
            joint.lose()
        self._note_lost()

    def _advice(self, servo: Servo) -> str:
        """Say what damaged replies of a servo mean."""
        if self._port.surplus[servo.id]:
            return (
                f"two servos answer as id {servo.id}, or its replies are repeated on their way: "
                "connect one servo alone and give it another id (`servo set-id`)"
            )
        return (
            f"two servos answer as id {servo.id} (connect one alone and give it another id with "
            "`servo set-id`), or something disturbs the line"
        )

    def _poll_one_lost(self) -> int:
        """Ask one lost servo whose time has come; return how long that took, ns.

        One per cycle, because each silent servo costs the others a timeout.
        """
        now = self._monotonic()
        for joint, servo in self._each_servo():
            if servo.lost and servo.ask_at <= now and not joint.stopped and not joint.busy:
                servo.ask_at = now + round(self._settings.poll_interval * 1e9)
                with suppress(CommunicationError):
                    if servo.readable:
                        servo.ping()
                    else:
                        servo.read_feedback()
                        servo.readable = True
                    joint.busy = True
                    self._enqueue(self._returning(joint, servo))
                return self._monotonic() - now
        return 0

    def _returning(self, joint: Joint, servo: Servo) -> Steps[None]:
        try:
            yield from self._counting_in(joint, servo)
        finally:
            joint.busy = False

    def _counting_in(self, joint: Joint, servo: Servo) -> Steps[None]:
        try:
            torque = yield from joint.come_back(servo)
        except CommunicationError:
            servo.lose(self._monotonic() + round(self._settings.poll_interval * 1e9))
            return
        except (ServoError, ConfigurationError) as cause:
            servo.lose(self._monotonic() + round(self._settings.poll_interval * 1e9))
            text, times = self._problems.get(servo.id, ("", 0))
            times = times + 1 if text == str(cause) else 1
            self._problems[servo.id] = (str(cause), times)
            if times == _CONVINCED:
                self._note(EventKind.UNUSABLE, joint, str(cause))
            return
        self._problems.pop(servo.id, None)
        if servo.unsteady and self._monotonic() - (servo.lost_at or 0) < _STEADY:
            return
        servo.unsteady = False
        self._note(EventKind.RETURNED, joint, f"answers again; {torque}")
        self._note_shortcomings(joint, servo)

    def _port_is_there(self) -> bool:
        """Look for a port that has gone; return whether there is one."""
        if self._look_again_at is None:
            lost = PortLostError(self._port.name, "it went between two cycles")
            if not self._port.comes_back:
                raise lost
            self._lose_port(str(lost))
        now = self._monotonic()
        assert self._look_again_at is not None
        if now < self._look_again_at:
            return False
        self._look_again_at = now + round(self._settings.reconnect_interval * 1e9)
        try:
            self._port.open()
        except PortError:
            return False
        if not self._is_the_same_line():
            self._port.close()  # it may be somebody else's by now
            return False
        self._look_again_at = None
        self._last_cycle = now
        self._note_port(EventKind.PORT_RETURNED, f"{self._port.name} is there again")
        stopped = [joint.name for joint in self._all if joint.stopped]
        if stopped:  # perhaps while nobody could tell them
            self._enqueue(self._relaxing(stopped, stop=True), despite_stop=True)
        return True

    def _is_the_same_line(self) -> bool:
        """Return whether servos answer, and all that do are those that were there before.

        After a reset of the USB bus two adapters may have swapped their names.
        """
        found = False
        for _, servo in self._each_servo():
            with suppress(CommunicationError):
                if not servo.is_same():
                    return False
                found = True
        return found

    def _lose_port(self, why: str) -> None:
        self._port.close()
        self._port_losses += 1
        self._look_again_at = self._monotonic()
        self.requests.end_all(PortLostError(self._port.name, why))
        for joint in self._all:
            joint.busy = joint.awaited = False  # also of steps that had not begun
        self.requests.drop_goals()
        for joint in self._all:
            if not joint.stopped:
                for servo in joint.servos:
                    servo.lose(0)
                joint.lose()
        self._plan = None
        self._note_lost()
        self._note_port(EventKind.PORT_LOST, why)

    # Helpers

    def _each_servo(self) -> Iterator[tuple[Joint, Servo]]:
        return ((joint, servo) for joint in self._all for servo in joint.servos)

    def _drop_goal(self, joint: Joint) -> None:
        self.requests.drop_goals(joint.name)

    def _note(self, kind: EventKind, joint: Joint, text: str, stuck: bool = False) -> None:
        text = f"{joint.name} (id {joint.servos[0].id}): {text}"
        stuck = stuck or kind in (EventKind.TORQUE_FAILED, EventKind.FAULTED, EventKind.RESTING)
        self._events.append(BusEvent(kind, joint.name, text, stuck))

    def _note_port(self, kind: EventKind, text: str) -> None:
        self._events.append(BusEvent(kind, "", text))

    def _require_connection(self, joints: Iterable[str] | None = ()) -> list[Joint]:
        """Return some joints, or all (None), of a bus that is connected."""
        if not self._connected:
            raise NotConnectedError(f"the bus on {self._port.name} is not connected")
        if joints is None:
            return list(self._all)
        return [self._joint(name) for name in dict.fromkeys(joints)]

    def _joint(self, name: str) -> Joint:
        try:
            return self._joints[name]
        except KeyError:
            raise GoalError(
                f"no joint {name!r} on this bus; it has {', '.join(self._joints)}"
            ) from None


def _method(servo: Servo) -> ReadMethod:
    model, identity = servo.model, servo.identity
    if model.protocol == 1:
        return ReadMethod.BULK if model.bulk_read else ReadMethod.EACH
    knows_fast = (
        model.fast_sync_read is not None
        and identity is not None
        and identity.firmware_version >= model.fast_sync_read
    )
    return ReadMethod.FAST_SYNC if knows_fast else ReadMethod.SYNC


def _told(problems: Mapping[str, object]) -> str:
    return "; ".join(f"{joint}: {problem}" for joint, problem in problems.items())
