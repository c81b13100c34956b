"""The cycle of a bus: read all servos, take steps of procedures, write all goals.

    read     one instruction for each kind of servo, or one for each servo
    steps    of procedures (torque on, a servo that returns, recovery, EEPROM), at least one, for
             as long as the read took, less the time of other questions after it
    write    goals and speeds, one sync write for each protocol
    steps    of procedures, until the next cycle is due

The instructions are computed when the set of servos changes (`servo.Version`), not in each cycle. A
cycle without anything unusual skips all code for unusual cases.
"""

from __future__ import annotations

import math
from contextlib import suppress
from typing import Final

from head_tracking.dynamixel.diagnosis import Diagnosis
from head_tracking.dynamixel.exceptions import (
    CommunicationError,
    CorruptReplyError,
    PortError,
    PortLostError,
    ReplyTimeoutError,
    advice,
)
from head_tracking.dynamixel.joint import BusJoint
from head_tracking.dynamixel.procedures import POLL_INTERVAL, Procedures
from head_tracking.dynamixel.protocol import Status
from head_tracking.dynamixel.reading import ReadGroup
from head_tracking.dynamixel.servo import LinkState, Servo
from head_tracking.dynamixel.state import BusEvent, BusReading, EventKind, ServoState

_LOST_AFTER: Final = 5  # failed cycles in a row
_RECONNECT_INTERVAL: Final = 200_000_000  # ns between two attempts to open a lost port
_DIAGNOSIS_PERIOD: Final = 9_000_000  # ns; detectors need 60 ms and more
_KEPT: Final = 0.8  # share of the expected time of a step that the next cycle keeps
_RESTART: Final = 0.2  # s without an instruction in which a servo may have restarted

Members = list[tuple[BusJoint, Servo]]
"""Servos that one instruction reads, with their joints."""


class Cycle:
    """Reads and writes the servos of a port, and finds those that return.

    Attributes:
        port_losses: How often the port was lost.
        diagnosis: Symptoms of each servo.
    """

    def __init__(self, bus: Procedures) -> None:
        self.cycles = self.port_losses = 0
        self._incomplete = False  # whether some servo does not answer
        self._bus, self._port, self._joints, self._version = bus, bus.port, bus.joints, bus.version
        self._requests, self._settings = bus.requests, bus.settings
        self._clock, self._monotonic, self._each_servo = bus.clock, bus.monotonic, bus.each_servo
        self._all = tuple(bus.joints.values())
        self.diagnosis = Diagnosis(bus)
        self._rest = bus.settings.temperature.rest
        self._command_timeout = bus.settings.command_timeout
        self._search_at: int | None = None  # when to look for a lost port, ns
        self._last = 0  # start of the last cycle, ns
        self._time_for_steps = 0  # in this cycle, before goals are written, ns
        self._step_time = 0.0  # of the longest step of late, ns
        self._diagnose_at = 0  # ns
        self._connected = self._unusual = False  # in this cycle
        self._owed = 0  # time of steps before another lost servo is asked, ns
        self._plan: list[tuple[ReadGroup, Members]] = []
        self._planned = -1  # version of the plan

    def begin(self) -> None:
        """Begin, once the servos have been found."""
        self._search_at = None
        self._port.take_silence()
        self.diagnosis.report_swapped()

    def read(self) -> BusReading:
        """Begin a cycle: read every servo; the events are added by `write`.

        Raises:
            PortLostError: The port was lost and cannot return under its name.
        """
        self.cycles += 1
        start = self._monotonic()
        stamp = self._clock()
        states: dict[str, ServoState] = {}
        self._connected = self._unusual = False
        if self._requests.obeyed != self._requests.epoch.value:
            self._bus.obey_stop()
        try:
            if (self._search_at is None and self._port.is_open) or self.find_port():
                silence = self._port.take_silence()
                if silence > _RESTART:
                    self._after_silence(silence)
                self._last = start
                if self._planned != self._version.number:
                    self._make_plan()
                self._unusual = self._read(stamp, states)
                end = self._monotonic()
                if self._unusual:
                    self._settle(states, start)
                self._time_for_steps = max(0, 2 * end - start - self._monotonic())
                if self._incomplete and not (self._owed > 0 and self._requests.under_way):
                    self._owed = self._poll_one_lost()
                    self._time_for_steps -= self._owed
                if start >= self._diagnose_at:
                    self._diagnose_at = start + _DIAGNOSIS_PERIOD
                    self.diagnosis.examine(start)
                self._connected = True
        except PortLostError as cause:
            self._lose_port(cause)
        stamps = [state.stamp for state in states.values()]
        return BusReading(states, (), sum(stamps) // len(stamps) if stamps else 0)

    def write(self, reading: BusReading) -> BusReading:
        """End a cycle: take steps of procedures, write goals; return the reading with events.

        Raises:
            PortLostError: The port was lost and cannot return under its name.
        """
        try:
            if self._connected:
                self._write()
            else:
                self._advance()  # the procedures fail
        except PortLostError as cause:
            self._lose_port(cause)
        if self._bus.events:
            reading = reading._replace(events=tuple(self._bus.events))
            self._bus.events.clear()
        return reading

    # Reading

    def _read(self, stamp: int, states: dict[str, ServoState]) -> bool:
        """Read all servos into the states; return whether anything was unusual."""
        port, rest, unusual = self._port, self._rest, self._command_timeout > 0.0
        offset = stamp - int(port.clock() * 1e9)
        for group, members in self._plan:
            for (joint, servo), reply in zip(members, port.read_group(group), strict=True):
                if (
                    type(reply) is Status
                    and servo.link is LinkState.PRESENT
                    and servo.accept(reply, offset)
                ):
                    servo.counters.replies += 1
                    states[joint.name] = joint.state()
                    if reply.error or servo.errors or servo.temperature >= rest or joint.resting:
                        unusual = True
                else:
                    unusual = True
                    self._accept_unusual(servo, reply, offset)
        return unusual

    def _accept_unusual(
        self, servo: Servo, reply: Status | CommunicationError, offset: int
    ) -> None:
        """Ask a servo again that did not reply, or record the reply of one that was silent."""
        try:
            if isinstance(reply, Status) and servo.accept(reply, offset):
                servo.counters.replies += 1
            else:
                if isinstance(reply, Status):
                    reply = CorruptReplyError(f"servo {servo.id}: impossible data {reply.data!r}")
                servo.count(reply)
                if servo.failed_cycles == 1 and isinstance(reply, ReplyTimeoutError):
                    self._port.send_filler(servo.model.protocol)
                if servo.failed_cycles:
                    raise reply
                servo.counters.retries += 1
                servo.read_feedback(1, offset)
        except CommunicationError as cause:
            servo.note_failure(cause)
        else:
            servo.note_reply()

    def _settle(self, states: dict[str, ServoState], now: int) -> None:
        asked = {servo.id for _, members in self._plan for _, servo in members}
        for joint in self._all:
            there = [servo for servo in joint.servos if servo.id in asked]
            if all([servo.failed_cycles for servo in there]):
                states.pop(joint.name, None)
            else:
                state = states[joint.name] = joint.state()
                self.diagnosis.protect(joint, state, now)
            for servo in there:
                if servo.failed_cycles >= _LOST_AFTER:
                    self._lose(joint, servo)

    def _make_plan(self) -> None:
        """Compute the instructions of a cycle, and whether a joint is incomplete.

        A servo that did not answer the last time is asked alone, and last, because others would
        wait for it.
        """
        together: dict[tuple[object, ...], Members] = {}
        read = [each for each in self._each_servo() if not (each[0].stopped or each[1].lost)]
        for joint, servo in sorted(read, key=lambda each: each[1].failed_cycles):
            model, block = servo.model, servo.model.feedback
            alone = servo.failed_cycles or not (model.sync_read or model.bulk_read)
            key = (servo.id if alone else None, model.protocol, block.address, block.length)
            together.setdefault(key, []).append((joint, servo))
        self._plan = []
        for members in together.values():
            model, ids = members[0][1].model, tuple([servo.id for _, servo in members])
            block = model.feedback
            group = ReadGroup(model.protocol, block.address, block.length, ids, model.bulk_read)
            self._plan.append((group, members))
        self._planned = self._version.number
        self._incomplete = not all([joint.complete for joint in self._all])

    # Writing

    def _write(self) -> None:
        requests = self._requests
        if requests.obeyed != requests.epoch.value:
            self._bus.obey_stop()
        if requests.goals:
            self._accept_goals()
        if requests.under_way:
            self._unusual = True
            if self._time_for_steps >= 0:
                self._step_time *= _KEPT
                until = self._monotonic() + self._time_for_steps
                if self._advance():
                    while self._advance(until):
                        pass
            if requests.goals:
                self._accept_goals()  # of a joint whose torque is on now
        usual = not (self._unusual or self._incomplete)
        on = [joint for joint in self._all if joint.goal_ticks and not joint.busy]
        self._bus.write_goals(on if usual else [joint for joint in on if joint.writable])

    def _accept_goals(self) -> None:
        for name in tuple(self._requests.goals):
            joint = self._joints[name]
            if joint.goal_ticks and not joint.busy:
                if goal := self._requests.take_goal(name):
                    joint.aim(goal.position, goal.speed, self._last)
            elif joint.refusal or not joint.complete:
                self._requests.drop_goals(name)  # since the command was accepted
            elif joint.writable and not joint.busy:  # its position is known
                self._bus.begin(joint, self._bus.switching_on_for_goal(joint))

    # Steps of procedures

    def _advance(self, until: float = math.inf) -> bool:
        """Take a step that is due, if half of it fits before a time, ns; return whether one did.

        It is expected to take as long as the longest one of the last cycles.
        """
        begin = self._monotonic()
        if begin + self._step_time / 2 > until:
            return False
        request = self._requests.next_due(begin)
        if request is None:
            self._owed = 0
            return False
        self._requests.advance(request)
        taken = self._monotonic() - begin
        self._step_time = max(self._step_time, taken)
        self._owed -= taken
        return True

    def fill(self, until: int) -> bool:
        """Take a step between two cycles, if there is time; return whether one was taken.

        Args:
            until: When the next cycle is due, monotonic ns.

        Raises:
            PortLostError: The port was lost and cannot return under its name.
        """
        try:
            return self._connected and self._advance(until)
        except PortLostError as cause:
            self._lose_port(cause)
            return False

    # Servos and ports that are lost and return

    def _after_silence(self, silence: float) -> None:
        """Check joints after s without an instruction, in which servos may have lost their power.

        A servo whose Bus Watchdog has tripped answers reads and ignores goals: it is cleared.
        """
        for joint in self._all:
            for servo in joint.servos:
                servo.interrupt()
            watched = any(servo.has_watchdog for servo in joint.servos)
            tripped = watched and 0.0 < self._settings.watchdog < silence
            if tripped and joint.on and joint.complete:
                why = f"the bus stood still for {silence:.1f} s"
                self._bus.clear_watchdog(joint, why)

    def _lose(self, joint: BusJoint, servo: Servo) -> None:
        text = f"no answer in {servo.failed_cycles} cycles in a row; check its cable and power"
        if servo.damaged_cycles >= _LOST_AFTER:
            text = f"damaged replies in {servo.damaged_cycles} cycles in a row; {advice(servo.id)}"
        servo.lose(self._monotonic() + POLL_INTERVAL)
        self._bus.note(EventKind.LOST, joint, text, servo=servo)
        if joint.lost:
            joint.drop_goal(resumes=True)

    def _poll_one_lost(self) -> int:
        """Ask the lost servo that is due for the longest time; return how long that took, ns.

        One in each cycle, because a silent servo costs the others a timeout. Procedures then get at
        least as much time, before another one is asked.
        """
        now = self._monotonic()
        due = [
            (joint, servo)
            for joint, servo in self._each_servo()
            if servo.lost and servo.ask_at <= now and not joint.busy
        ]
        if not due:
            return 0
        joint, servo = min(due, key=lambda each: each[1].ask_at)
        servo.ask_at = now + POLL_INTERVAL
        with suppress(CommunicationError):
            if servo.damaged_cycles:  # two servos with one id may answer pings
                servo.read_feedback()
                servo.damaged_cycles = 0
            else:
                servo.ping()
            self._bus.begin(joint, self._bus.returning(joint, servo))
        return self._monotonic() - now

    def find_port(self) -> bool:
        """Look for a port that was lost; return whether it is open.

        Raises:
            PortLostError: It cannot return under its name.
        """
        if self._search_at is None:
            self._lose_port(PortLostError(self._port.name, "it was closed between two cycles"))
        now = self._monotonic()
        assert self._search_at is not None
        if now < self._search_at:
            return False
        self._search_at = now + _RECONNECT_INTERVAL
        try:
            self._port.open()
        except PortError:
            return False
        if not self._is_same_line():
            self._port.close()
            return False
        self._search_at = None
        text = f"{self._port.name} is there again"
        self._bus.events.append(BusEvent(EventKind.PORT_RETURNED, "", text))
        return True

    def _is_same_line(self) -> bool:
        """Return whether servos answer, and all that do are those that were there before.

        After a reset of the USB bus two adapters may have exchanged their names.
        """
        found = False
        for joint, servo in self._each_servo():
            with suppress(CommunicationError, PortLostError):
                if not servo.is_same():
                    text = f"another servo answers as servo {servo.id}; the adapter is not used"
                    self._bus.note(EventKind.UNUSABLE, joint, text)
                    return False
                found = True
        return found and self._port.is_open

    def _lose_port(self, cause: PortLostError) -> None:
        if self._port.name.startswith("/dev/pts/"):  # the next program gets its number
            raise cause
        self._port.close()
        self.port_losses += 1
        self._search_at = self._monotonic()
        self._requests.end_all(cause)
        self._requests.drop_goals()
        for joint in self._all:
            if not joint.stopped:
                for servo in joint.servos:
                    servo.lose(0)
                joint.drop_goal(resumes=True)
        self._bus.events.append(BusEvent(EventKind.PORT_LOST, "", str(cause)))
