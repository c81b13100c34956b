"""The cycle of a bus: read all servos, take steps of what takes longer, write all goals.

    read     one request for each kind of servo, or one for each servo
    steps    of what takes longer (torque on, a servo that returns, recovery, EEPROM), if there is
             any: as many as leave the cycle within twice its usual time
    write    goals and speeds, one sync write for each protocol
    steps    more of them, in the time that is left until the next cycle is due

What is known before a cycle is computed before it: the plan of the requests is made anew only when
something has changed (`servo.Changes`), and a cycle without trouble takes one branch past all that
deals with trouble.
"""

from __future__ import annotations

import sys
from contextlib import suppress
from typing import Final, NamedTuple

from head_tracking.dynamixel.context import BusContext
from head_tracking.dynamixel.diagnosis import Diagnosis
from head_tracking.dynamixel.exceptions import CommunicationError, PortError, PortLostError
from head_tracking.dynamixel.joint import Joint
from head_tracking.dynamixel.procedures import Procedures
from head_tracking.dynamixel.protection import Protection
from head_tracking.dynamixel.reading import ReadGroup, ReadMethod, Reply
from head_tracking.dynamixel.servo import LinkState, Servo
from head_tracking.dynamixel.state import BusEvent, BusReading, EventKind, ServoState

_SHARE: Final = 10
"""Silence may take a tenth of the bus's time: a servo that cost 2 ms rests for 18 ms."""
_LONGEST_WAIT: Final = 100_000_000  # ns that are believed; a clock may jump
_DIAGNOSIS_PERIOD: Final = 9_000_000  # ns; what is looked for lasts 60 ms and more
_RESTART: Final = 200_000_000
"""ns between two cycles in which a servo may have lost its power and started again."""
_MOST_STEPS: Final = 100  # in a cycle, should a clock stand still


class _Part(NamedTuple):
    """One request of a cycle and whom it reads."""

    group: ReadGroup
    members: list[tuple[Joint, Servo]]


class Cycle:
    """Reads and writes the servos of a port, and looks after those that are not as usual.

    Args:
        bus: What the parts of the bus share.
        procedures: Carries out what takes several transactions.

    Attributes:
        cycles: Cycles run.
        port_losses: How often the port has gone.
        diagnosis: What is wrong with each servo.
    """

    def __init__(self, bus: BusContext, procedures: Procedures) -> None:
        self.cycles = self.port_losses = 0
        self._bus, self._port, self._joints, self._changes = bus, bus.port, bus.joints, bus.changes
        self._requests, self._procedures, self._settings = bus.requests, procedures, bus.settings
        self._clock, self._monotonic, self._each_servo = bus.clock, bus.monotonic, bus.each_servo
        self._all, settings = tuple(bus.joints.values()), bus.settings
        self._protection = Protection(bus, procedures)
        self.diagnosis = Diagnosis(bus, procedures)
        self._rest = settings.rest
        self._watchdog = round(settings.watchdog * 1e9)
        self._look_again_at: int | None = None  # the port has gone; ns
        self._last = 0
        self._took = self._spent = 0  # ns of this cycle: reading; asking one that is lost
        self._diagnose_at = 0  # not before this time, ns
        self._longest = 0  # ns that a step of this cycle has taken
        self._there = self._troubled = False  # the port, in this cycle; anything not as usual
        self._plan: list[_Part] = []
        self._planned = -1  # the changes that the plan knows
        self._absent: tuple[tuple[str, ...], tuple[str, ...]] = (), ()
        self._absent_at = -1  # the changes that this knows
        self._incomplete: tuple[str, ...] = ()  # in this cycle

    @property
    def absent(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Joints of which no servo answers, and those of which some servo does not.

        Neither take commands.
        """
        count = self._changes.count
        if self._absent_at != count:
            lost = tuple([joint.name for joint in self._all if joint.lost])
            incomplete = tuple([joint.name for joint in self._all if not joint.complete])
            self._absent, self._absent_at = (lost, incomplete), count
        return self._absent

    def begin(self) -> None:
        """Begin, once the port has been opened and the servos have been found."""
        self._look_again_at = None
        self._last = self._monotonic()
        self._planned = -1
        self.diagnosis.report_swapped()

    def end(self) -> None:
        """End the cycles, before the port is closed."""
        self._there = False

    def read(self) -> BusReading:
        """Begin a cycle: read every servo, and look after those that are not as usual.

        Returns:
            What was read in this cycle; joints that did not answer are absent.

        Raises:
            PortLostError: The port has gone and cannot come back under its name.
        """
        self.cycles += 1
        start = self._monotonic()
        stamp = self._clock()
        states: dict[str, ServoState] = {}
        failed: tuple[str, ...] = ()
        self._there = self._troubled = False
        self._spent = 0
        if self._procedures.obeyed != self._requests.epoch.value:
            self._procedures.obey_stop()
        try:
            if (self._look_again_at is None and self._port.is_open) or self._find_port():
                if start - self._last > _RESTART:
                    self._stood_still(start - self._last)
                self._last = start
                if self._planned != self._changes.count:
                    self._troubled = True
                    self._make_plan()
                if self._read(stamp, states) or self._troubled:
                    self._troubled = True
                    failed = self._settle(states, start)
                if start >= self._diagnose_at:
                    self._diagnose_at = start + _DIAGNOSIS_PERIOD
                    self.diagnosis.examine(start)
                self._incomplete = self.absent[1]
                self._spent = self._poll_one_lost() if self._incomplete else 0
                self._there = True
        except PortLostError as cause:
            self._lose_port(cause)
        self._took = self._monotonic() - start - self._spent
        events = self._bus.take_events() if self._bus.events else ()
        return BusReading(self.cycles, stamp, states, failed, self.absent[0], events)

    def write(self) -> tuple[BusEvent, ...]:
        """End a cycle: write all goals, take steps of what is under way.

        Returns:
            What has happened meanwhile.

        Raises:
            PortLostError: The port has gone and cannot come back under its name.
        """
        if not self._there:
            return ()
        try:
            requests = self._requests
            if self._procedures.obeyed != requests.epoch.value:
                self._procedures.obey_stop()
            if requests.goals:
                self._take_goals()
            if requests.under_way:
                self._troubled = True
                self._take_steps()
                if requests.goals:
                    self._take_goals()  # of a joint whose torque has come on
            self.write_goals()
        except PortLostError as cause:
            self._lose_port(cause)
        return self._bus.take_events() if self._bus.events else ()

    # Reading

    def _read(self, stamp: int, states: dict[str, ServoState]) -> bool:
        """Read all servos into the states; return whether anything was not as usual."""
        port, rest = self._port, self._rest
        timeout = self._settings.command_timeout
        troubled = False
        begin = port.clock()
        for part in self._plan:
            asked_at = port.clock() if part.group.method is ReadMethod.EACH else begin
            replies = port.read_group(part.group)
            for (joint, servo), reply in zip(part.members, replies, strict=True):
                if type(reply) is Reply and servo.link is LinkState.PRESENT:
                    servo.counters.replies += 1
                    servo.take(reply, stamp + int((reply.stamp - begin) * 1e9))
                    states[joint.name] = state = joint.state()
                    if (
                        reply.error
                        or servo.errors
                        or state.temperature >= rest
                        or joint.resting
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
        outcome: Reply | CommunicationError,
        stamp: int,
        begin: float,
        asked_at: float,
    ) -> None:
        """Take note of a reply that did not come, and ask again; or of one that came at last."""
        try:
            if isinstance(outcome, CommunicationError):
                servo.count(outcome)
                if servo.failed_cycles or not self._settings.retries:
                    raise outcome
                servo.counters.retries += 1
                outcome = servo.ask_feedback(self._settings.retries)
            else:
                servo.counters.replies += 1
        except CommunicationError as cause:
            ask_at = 0
            if servo.failed_cycles:
                cost = min(max(0, round((self._port.clock() - asked_at) * 1e9)), _LONGEST_WAIT)
                ask_at = self._monotonic() + cost * (_SHARE - 1)
            servo.note_failure(cause, ask_at)
            return
        servo.take(outcome, stamp + int((outcome.stamp - begin) * 1e9))
        servo.note_answer()

    def _settle(self, states: dict[str, ServoState], now: int) -> tuple[str, ...]:
        """Deal with what was not as usual; return the joints that were asked in vain."""
        asked = {servo.id for part in self._plan for _, servo in part.members}
        failed: list[str] = []
        for joint in self._all:
            there = [s for s in joint.servos if s.id in asked and not (joint.stopped or s.lost)]
            answered = [servo for servo in there if not servo.failed_cycles]
            if answered:
                for servo in answered:
                    if servo.model.protocol == 1:
                        servo.errors = servo.read_errors()
                state = states[joint.name] = joint.state()
                self._protection.judge(joint, state, now)
                if self._settings.command_timeout and joint.on:
                    self._protection.judge_command(joint, state, now)
            else:
                states.pop(joint.name, None)
                if there:
                    failed.append(joint.name)
            for servo in there:
                if servo.failed_cycles >= self._settings.lost_after:
                    self._lose(joint, servo)
        return tuple(failed)

    def _make_plan(self) -> None:
        """Make the requests of a cycle: servos that can be read together, together.

        A servo that did not answer last time is asked alone, and last: others would wait for its
        turn to pass. While there is one, the plan is made anew in each cycle.
        """
        now, planned = self._monotonic(), self._changes.count
        together: dict[tuple[ReadMethod, object, object], list[tuple[Joint, Servo]]] = {}
        alone: list[_Part] = []
        for joint, servo in self._each_servo():
            if joint.stopped or servo.lost:
                continue
            if servo.link is not LinkState.PRESENT:
                planned = -1
            method = _method(servo)
            if not servo.failed_cycles:
                own = servo.id if method is ReadMethod.EACH else None
                together.setdefault((method, own, servo.layout), []).append((joint, servo))
            elif servo.ask_at <= now:
                alone.append(_part(ReadMethod.EACH, [(joint, servo)]))
        self._plan = [*[_part(key[0], members) for key, members in together.items()], *alone]
        self._planned = planned

    # Writing

    def _take_goals(self) -> None:
        for name, goal in self._requests.take_goals().items():
            joint = self._joints[name]
            if joint.on and not joint.busy:
                joint.aim(goal.position, goal.speed, self._last)
                continue
            if joint.torque.waits or not joint.complete:
                continue  # since the command was accepted
            self._requests.keep_goal(name, goal)  # until its torque is on
            if joint.writable and not joint.busy:  # torque needs to know where it stands
                self._procedures.begin(joint, self._procedures.switching_on_for_goal(joint))

    def write_goals(self, also_silent: bool = False) -> None:
        """Write the goals of all joints with torque on.

        Args:
            also_silent: Whether those count, too, whose servos do not answer or are being set up.
        """
        packets: dict[tuple[int, int, int], dict[int, bytes]] = {}
        usual = also_silent or not (self._troubled or self._incomplete)
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

    def _take_steps(self) -> None:
        """Take as many steps as leave the cycle within twice its usual time, but one at least.

        There need not be any after a lost servo was asked, which took of that time.
        """
        self._longest = self._spent
        if 2 * self._spent > self._took:
            return
        until = self._monotonic() - self._spent + self._took
        if self._advance(sys.maxsize):
            for _ in range(_MOST_STEPS):
                if not self._advance(until):
                    return

    def _advance(self, until: int) -> bool:
        """Take a step of what is under way, if one is due and should end before a time, ns."""
        before = self._monotonic()
        request = self._requests.next_due(before) if before + self._longest <= until else None
        if request is None:
            return False
        self._requests.advance(request)
        self._longest = max(self._longest, self._monotonic() - before)
        return True

    def fill(self, until: int) -> bool:
        """Take a step of what is under way between two cycles, if there is time for it.

        Args:
            until: When the next cycle is due, monotonic ns.

        Returns:
            Whether a step was taken.

        Raises:
            PortLostError: The port has gone and cannot come back under its name.
        """
        self._longest = max(self._longest, self._took)
        try:
            return self._there and self._advance(until)
        except PortLostError as cause:
            self._lose_port(cause)
            return False

    # Who goes and who comes

    def _stood_still(self, gap: int) -> None:
        """Look after the joints whose servos may not be as they were in the last cycle.

        They may have been without power, and answer again: their torque is read before they get a
        goal. Those with a Bus Watchdog may have stopped by themselves: they are held. A tripped
        watchdog answers reads and ignores goals, so that only the time tells.
        """
        for joint in self._all:
            for servo in joint.servos:
                servo.interrupt()
            watched = gap > self._watchdog and any(servo.watched for servo in joint.servos)
            if watched and joint.on and joint.complete:
                why = f"the bus stood still for {gap * 1e-9:.1f} s"
                self._procedures.clear_watchdog(joint, why)

    def _lose(self, joint: Joint, servo: Servo) -> None:
        now = self._monotonic()
        text = f"no answer in {servo.failed_cycles} cycles in a row; check its cable and power"
        if servo.damaged_cycles >= self._settings.lost_after:
            text = f"damaged replies in {servo.damaged_cycles} cycles in a row; {advice(servo)}"
        servo.lose(now + round(self._settings.poll_interval * 1e9))
        self._bus.note(EventKind.LOST, joint, text)
        if joint.lost:
            joint.lose()

    def _poll_one_lost(self) -> int:
        """Ask one lost servo whose time has come; return how long that took, ns.

        One per cycle, because each silent servo costs the others a timeout.
        """
        now = self._monotonic()
        for joint, servo in self._each_servo():
            if servo.lost and servo.ask_at <= now and not joint.stopped and not joint.busy:
                servo.ask_at = now + round(self._settings.poll_interval * 1e9)
                with suppress(CommunicationError):
                    if servo.damaged_cycles:  # two servos with one id may answer pings
                        servo.read_feedback()
                        servo.damaged_cycles = 0
                    else:
                        servo.ping()
                    self._procedures.begin(joint, self._procedures.returning(joint, servo))
                return self._monotonic() - now
        return 0

    def _find_port(self) -> bool:
        """Look for a port that has gone; return whether there is one."""
        if self._look_again_at is None:
            self._lose_port(PortLostError(self._port.name, "it went between two cycles"))
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
        self._last = now
        text = f"{self._port.name} is there again"
        self._bus.events.append(BusEvent(EventKind.PORT_RETURNED, "", text))
        stopped = [joint for joint in self._all if joint.stopped]
        if stopped:  # perhaps while nobody could tell them
            steps = self._procedures.relaxing(stopped, stop=True)
            self._requests.start(steps, despite_stop=True)
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

    def _lose_port(self, cause: PortLostError) -> None:
        if not self._port.comes_back:
            raise cause
        self._port.close()
        self.port_losses += 1
        self._look_again_at = self._monotonic()
        self._requests.end_all(cause)
        self._requests.drop_goals()
        for joint in self._all:
            if not joint.stopped:
                for servo in joint.servos:
                    servo.lose(0)
                joint.lose()
        self._bus.events.append(BusEvent(EventKind.PORT_LOST, "", str(cause)))


def advice(servo: Servo) -> str:
    """Return what damaged replies of a servo mean, and what to do."""
    return (
        f"two servos answer as id {servo.id} (connect one alone and give it another id with "
        "`servo set-id`), or something disturbs the line"
    )


def _part(method: ReadMethod, members: list[tuple[Joint, Servo]]) -> _Part:
    """Return the request that reads some servos, which are alike."""
    servo = members[0][1]
    block, model = servo.model.feedback, servo.model
    ids = tuple([servo.id for _, servo in members])
    plausible = servo.plausible if any(model.signs) else None
    return _Part(
        ReadGroup(method, model.protocol, block.address, block.length, ids, plausible), members
    )


def _method(servo: Servo) -> ReadMethod:
    model, identity = servo.model, servo.identity
    if model.bulk_read:
        return ReadMethod.BULK
    if not model.sync_read:
        return ReadMethod.EACH
    knows_fast = (
        model.fast_sync_read is not None
        and identity is not None
        and identity.firmware_version >= model.fast_sync_read
    )
    return ReadMethod.FAST_SYNC if knows_fast else ReadMethod.SYNC
