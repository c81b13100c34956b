"""One servo: what it is, its registers, how it is calibrated, its torque, what it last said.

What takes several transactions is written as steps, a generator: it yields wherever the bus may do
something else first, and says how many seconds it needs to wait. The bus spreads steps over its
cycles; `run` takes them at once.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from enum import Enum, IntFlag
from functools import cache
from itertools import pairwise
from typing import Final, TypeVar

from head_tracking.dynamixel.configuration import ServoCalibration
from head_tracking.dynamixel.control_table import Block, ControlTable, Register
from head_tracking.dynamixel.exceptions import (
    CommunicationError,
    ConfigurationError,
    CorruptReplyError,
    RegisterRefusedError,
    ReplyTimeoutError,
    ServoError,
    ServoSetupError,
)
from head_tracking.dynamixel.models import ServoModel, servo_model_by_number
from head_tracking.dynamixel.port import DynamixelPort
from head_tracking.dynamixel.protocol import (
    ALERT,
    NO_ERROR,
    REFUSALS,
    ErrorBits,
    describe_errors,
    describe_status,
)
from head_tracking.dynamixel.reading import Reply
from head_tracking.dynamixel.requests import Steps

_T = TypeVar("_T")

EEPROM_PAUSE: Final = 0.025
"""Seconds to leave a servo alone after a write to its EEPROM: it answers at once and is deaf for
some 6 ms per byte afterwards (fact sheet, section 9)."""

_TRIES: Final = 3  # where a failure would leave a servo in the wrong state
_REVERSE: Final = 1  # bit of Drive Mode
_WATCHDOG_UNIT: Final = 0.02  # s
_LONGEST_READ: Final = 64  # bytes
_LONGEST_SPAN: Final = 25  # bytes; about as long on the wire as a usual cycle


def run(steps: Steps[_T], pause: Callable[[float], object] = time.sleep) -> _T:
    """Take all steps at once and return their result."""
    while True:
        try:
            wait = next(steps)
        except StopIteration as end:
            return end.value  # type: ignore[no-any-return]
        if wait > 0.0:
            pause(wait)


class LinkState(Enum):
    """Whether a servo answers."""

    UNKNOWN = "has not been found yet"
    PRESENT = "answered when it was asked last"
    SILENT = "did not answer when it was asked last"
    INTERRUPTED = "answers again, but its torque has not been read since"
    LOST = "is left out of the cycle, and asked now and then"
    RETURNED = "has been found again, and not been read since"


class Changes:
    """Counts the changes of who is read together with whom; all servos of a bus share one.

    Attributes:
        count: Number of changes so far.
    """

    def __init__(self) -> None:
        self.count = 0


@dataclass(slots=True)
class Counters:
    """What became of the transactions with one servo."""

    replies: int = 0
    retries: int = 0
    timeouts: int = 0
    corrupt: int = 0


@dataclass(frozen=True, slots=True)
class ServoIdentity:
    """A servo that answered and fits its joint.

    Attributes:
        joint_name: The joint it drives.
        id: Servo id.
        model: Name of the model.
        firmware_version: Contents of its register.
        own_range: Lowest and highest tick by the servo's own angle limits.
        shutdown: Errors upon which the servo switches itself off.
        temperature_limit: Above it the servo counts as overheated, degrees Celsius.
        lowest_voltage: Below it the servo counts as short of supply, V.
        powered: Whether its torque was on when it was found.
        faulted: Whether it had shut itself down when it was found.
    """

    joint_name: str
    id: int
    model: str
    firmware_version: int
    own_range: tuple[int, int]
    shutdown: IntFlag
    temperature_limit: float
    lowest_voltage: float
    powered: bool
    faulted: bool


class Servo:
    """A servo on the port. Used by the thread that owns the port; any thread may look.

    Args:
        port: The port.
        servo_id: Its id.
        model: Its model.
        calibration: Of its joint; None: the whole range of the servo, zero in the middle.
        watchdog: Time without any packet after which it shall stop by itself, s; 0: never.
        changes: Of its bus; None: its own.

    Attributes:
        id: Its id.
        model: Its model.
        calibration: Where its joint has its zero and which way round it turns.
        acknowledges_writes: Whether it answers writes (Status Return Level 2).
        counters: What became of the transactions.
        identity: What it said about itself; None until it was found.
        link: Whether it answers.
        changes: Counts its changes, and those of the other servos of its bus.
        others: Ids of the servos of other joints.
        failed_cycles: Failed cycles in a row.
        ask_at: Not before this monotonic time, ns, is it asked again.
        damaged_cycles: Cycles in a row whose replies were damaged, and no reply since.
        confirmed: Whether it has confirmed that it is relaxed, and is so since.
        pins: Counts who has begun to switch its torque on.
        faulted: Whether it has shut itself down. Only the servo itself takes that back.
        errors: Its error state when it last told.
        stamp: When it last answered, ns; 0: never.
        range: Lowest and highest tick that configuration and servo allow.
        limits: The same as positions of the joint, rad.
        fastest: Highest goal speed, in counts.
        layout: What servos that are read together have in common.
        goal_key: Protocol, address and length of the block that goals are written to.
        ticks: Present position as the servo counts it.
        position: Present position of the joint, rad.
        velocity: rad/s.
        load: -1 to 1 of full torque, positive towards higher positions.
        voltage: V.
        temperature: Degrees Celsius.
        error: The error byte of the last reply.
    """

    def __init__(
        self,
        port: DynamixelPort,
        servo_id: int,
        model: ServoModel,
        calibration: ServoCalibration | None = None,
        watchdog: float = 0.0,
        changes: Changes | None = None,
    ) -> None:
        self.id = servo_id
        self.model = model
        self.acknowledges_writes = True
        self.counters = Counters()
        self.identity: ServoIdentity | None = None
        self.link = LinkState.UNKNOWN
        self.changes = changes or Changes()
        self.others: Collection[int] = ()
        self.failed_cycles = 0
        self.ask_at = 0
        self.damaged_cycles = 0
        self.faulted = self.confirmed = False
        self.pins = 0
        self.errors: IntFlag = NO_ERROR
        self.stamp = 0
        self.ticks = 0
        self.position = self.velocity = self.load = self.voltage = self.temperature = 0.0
        self.error = 0
        self.goal_key = (model.protocol, model.goal.address, model.goal.length)
        feedback = model.feedback
        self.layout = (
            *(model.protocol, feedback.address, feedback.length),
            *(model.ticks, model.endless, *model.signs, model.family),
        )
        self._port = port
        self._protocol = model.protocol
        self._speed_unit = model.speed_unit
        self._unpack = model.feedback.layout.unpack
        self.fastest = model.speed_maximum
        self._order = model.feedback_order
        self._signs = model.signs
        self._wanted_watchdog = watchdog
        self.calibrate(
            calibration
            or ServoCalibration(
                f"servo {servo_id}", servo_id, model.center, 0, model.ticks - 1, model
            )
        )

    # Transactions. All raise CommunicationError, and PortLostError when the port has gone.

    def ping(self, tries: int = 1) -> int:
        """Ask the servo whether it is there; return its error byte."""
        return self._try(tries, lambda: self._port.ping(self.id, self._protocol))

    def is_same(self) -> bool:
        """Return whether the servo that answers now has the model and the firmware known before."""
        known = self.identity
        return self.get("Model Number", 1) == self.model.model_number and (
            known is None or self.get("Firmware Version", 1) == known.firmware_version
        )

    def read(self, block: Block, tries: int = _TRIES) -> tuple[int, ...]:
        """Read registers and return one value for each."""
        address, length = block.address, block.length
        read = self._port.read
        reply = self._try(tries, lambda: read(self.id, address, length, self._protocol))
        return block.decode(reply.data)

    def get(self, name: str, tries: int = _TRIES) -> int:
        """Read one register."""
        return self.read(self.model.control_table.block(name), tries)[0]

    def registers(self) -> list[tuple[Register, int]]:
        """Read all registers."""
        return [
            (register, value)
            for block in self.model.control_table.spans(_LONGEST_READ, gaps=False)
            for register, value in zip(block.registers, self.read(block), strict=True)
        ]

    def read_feedback(self, tries: int = 1) -> None:
        """Read position, speed, load, voltage and temperature, and record them."""
        self.take(self.ask_feedback(tries), self.stamp)

    def ask_feedback(self, tries: int) -> Reply:
        """Return the reply with position, speed, load, voltage and temperature."""
        block = self.model.feedback

        def attempt() -> Reply:
            reply = self._port.read(self.id, block.address, block.length, self._protocol)
            if not self.plausible(reply.data):
                raise CorruptReplyError(f"servo {self.id}: impossible feedback {reply.data!r}")
            return reply

        return self._try(tries, attempt)

    def write(self, block: Block, *values: int) -> None:
        """Write registers.

        Raises:
            RegisterRefusedError: The servo answers that it will not.
        """
        data, address = block.encode(*values), block.address
        if not self.acknowledges_writes:
            self._port.write(self.id, address, data, acknowledged=False, protocol=self._protocol)
            return
        error = self._try(
            _TRIES, lambda: self._port.write(self.id, address, data, protocol=self._protocol)
        )
        if self._protocol == 2:
            refusal = error & ~ALERT
        else:  # Feetech's error byte tells of the servo, not of what was asked
            refusal = error & REFUSALS if self.model.errors is ErrorBits else 0
        if refusal:
            pairs = zip(block.registers, values, strict=True)
            names = ", ".join(f"{register.name} = {value}" for register, value in pairs)
            one = self._protocol == 1
            why = describe_errors(ErrorBits(refusal)) if one else describe_status(refusal)
            raise RegisterRefusedError(f"servo {self.id} refused {names}: {why}")

    def set(self, name: str, value: int) -> None:
        """Write one register and make sure of it; raises as `verify` does."""
        run(self.verify(self.model.control_table.block(name), value))

    def set_torque(self, on: bool) -> None:
        """Switch torque and make sure of it; raises as `verify` does."""
        self.set("Torque Enable", int(on))

    def _try(self, tries: int, transaction: Callable[[], _T]) -> _T:
        counters = self.counters
        for left in range(tries - 1, -1, -1):
            try:
                result = transaction()
            except CommunicationError as cause:
                self.count(cause)
                if not left:
                    raise
                self._port.back_off()
                counters.retries += 1
            else:
                counters.replies += 1
                return result
        raise ValueError(f"{tries} tries")

    def count(self, cause: CommunicationError) -> None:
        """Count a failed transaction."""
        if isinstance(cause, ReplyTimeoutError):
            self.counters.timeouts += 1
        else:
            self.counters.corrupt += 1

    def reboot(self) -> None:
        """Restart it; it does not answer for a while."""
        self._try(_TRIES, lambda: self._port.reboot(self.id, self._protocol))

    # Steps. All raise what their transactions raise.

    def verify(self, block: Block, *values: int) -> Steps[None]:
        """Write registers and read them back until the servo holds the values.

        Raises:
            RegisterRefusedError: The servo refuses, or answers but keeps other values.
        """
        kept: tuple[int, ...] = ()
        for _ in range(_TRIES):
            self.write(block, *values)
            yield 0.0
            kept = self.read(block)
            yield 0.0
            if kept == values:
                return
        names = ", ".join(register.name for register in block.registers)
        raise RegisterRefusedError(
            f"servo {self.id} keeps {kept} in {names} instead of {values}; it may have shut down: "
            "look at its error bits (overload, overheating), let it cool, or cycle its power"
        )

    def switch_torque(self, on: bool) -> Steps[None]:
        """Switch torque and make sure of it; raises as `verify` does."""
        return self.verify(self.model.control_table.block("Torque Enable"), int(on))

    def identify(self, keep_torque: bool = False) -> Steps[ServoIdentity]:
        """Check a servo that answers pings, leave it relaxed, and count it as present.

        Args:
            keep_torque: Leave its torque as it is.

        Raises:
            ServoSetupError: It is another model than configured, does not answer reads, or does
                not work in positions.
            RegisterRefusedError: It does not switch torque off.
            ConfigurationError: Its own angle limits leave the joint no range.
        """
        memory: dict[str, int] = {}
        joint_name, model = self.calibration.joint_name, self.model
        own = [] if model.offset is None else [model.offset.name]
        for span in _spans(model.control_table, (*model.position_limits, *model.modes, *own)):
            try:
                values = self.read(span, 2 * _TRIES)  # a busy machine may miss answers
            except ReplyTimeoutError as cause:
                level = model.control_table["Status Return Level"].address
                raise ServoSetupError(
                    f"servo {self.id} ({joint_name}) answers pings but no reads: its Status Return "
                    f"Level (register {level}) is probably 0; set it to 2, for example with "
                    f"`servo set {self.id} 'Status Return Level' 2`"
                ) from cause
            memory.update((r.name, value) for r, value in zip(span.registers, values, strict=True))
            number = memory.get("Model Number", model.model_number)
            if number != model.model_number:
                raise ServoSetupError(
                    f"servo {self.id} ({joint_name}) is {model_name(number)}, but the "
                    f"configuration says {model.name} ({model.model_number}); correct the "
                    "configuration's model or id"
                )
            yield 0.0
        self.acknowledges_writes = model.acknowledges_writes(memory["Status Return Level"])
        lower, upper = (memory[name] for name in model.position_limits)
        shutdown = model.errors(memory["Shutdown"] & sum(model.errors))
        identity = ServoIdentity(
            joint_name,
            self.id,
            model.name,
            memory["Firmware Version"],
            (lower, upper),
            shutdown,
            float(memory["Temperature Limit"]),
            memory["Min Voltage Limit"] * 0.1,
            memory["Torque Enable"] == 1,
            _has_shut_down(memory, shutdown),
        )
        problem: ServoError | ConfigurationError | None = None
        try:
            _check_mode(self, memory, lower, upper)
            _check_offset(self, memory)
            _check_direction(self, memory)
            _check_secondary_id(self, memory)
            self.calibrate(self.calibration, identity.own_range)
        except (ServoError, ConfigurationError) as cause:
            problem = cause
        else:  # it can be read from now on
            self.identity = identity
            self.faulted = identity.faulted
            self.failed_cycles = self.ask_at = 0
            self._enter(LinkState.RETURNED if self.lost else LinkState.PRESENT)
        if keep_torque:
            self.confirmed = not identity.powered
        else:
            yield from self.switch_torque(False)
            self.confirmed = True
        if problem is not None:
            raise problem
        return identity

    def write_eeprom(self, wanted: Mapping[str, int]) -> Steps[dict[str, tuple[int, int]]]:
        """Write settings that differ, with the pauses that servos need, and read them back.

        The memory wears out: what is there already is not written again. That of a Feetech servo
        keeps only what is written while its lock is off.

        Args:
            wanted: Register values by name.

        Returns:
            Old and new value of what was changed, by register name.

        Raises:
            ServoError: Its torque is on, its memory is locked, or it does not keep a value.
        """
        table = self.model.control_table
        if self.get("Torque Enable"):
            raise ServoError(
                f"servo {self.id} has its torque on; relax it before changing its memory"
            )
        yield 0.0
        if "Lock" in table and self.get("Lock"):
            raise ServoError(
                f"servo {self.id} has its memory locked (register {table['Lock'].address}); cycle "
                "its power"
            )
        changed: dict[str, tuple[int, int]] = {}
        for name, value in wanted.items():
            yield 0.0
            before = self.get(name)
            if before == value:
                continue
            yield 0.0
            block = table.block(name)
            yield from self.lock_eeprom(False)
            self.write(block, value)
            if name == "Status Return Level":
                self.acknowledges_writes = self.model.acknowledges_writes(value)
            yield EEPROM_PAUSE * block.length
            after = self.get(name)
            yield from self.lock_eeprom(True)
            if after != value:
                raise RegisterRefusedError(
                    f"servo {self.id} keeps {after} in {name} instead of {value}"
                )
            changed[name] = (before, value)
        return changed

    def lock_eeprom(self, locked: bool) -> Steps[None]:
        """Write the lock of a Feetech servo, which forgets at power-off what is written under it.

        Other servos have none. Raises as `verify` does.
        """
        table = self.model.control_table
        if "EEPROM Lock" in table:
            yield from self.verify(table.block("EEPROM Lock"), int(locked))

    def arm(self) -> Steps[None]:
        """Switch its watchdog on, if it has one."""
        if self.watched:
            units = round(self._wanted_watchdog / _WATCHDOG_UNIT)
            yield from self.set_watchdog(max(1, min(127, units)))

    def disarm(self) -> Steps[None]:
        """Switch its watchdog off, if it has one; one that has tripped takes goals again."""
        if self.watched:
            yield from self.set_watchdog(0)

    def set_watchdog(self, value: int) -> Steps[None]:
        """Write its Bus Watchdog; raises as `verify` does."""
        return self.verify(self.model.control_table.block("Bus Watchdog"), value)

    def read_errors(self) -> IntFlag:
        """Return the error state that goes with the last error byte.

        Protocol 2.0 tells only that there is one: its register is read.
        """
        if self._protocol == 1:
            return self.model.errors(self.error & sum(self.model.errors))
        if not self.error & ALERT:
            return self.model.errors(0)
        return self.model.errors(self.get("Hardware Error Status") & sum(self.model.errors))

    # What is known

    @property
    def watched(self) -> bool:
        """Whether it stops by itself when it hears nothing: its firmware has a Bus Watchdog."""
        first, known = self.model.watchdog, self.identity
        if first is None or self._wanted_watchdog <= 0.0:
            return False
        return known is None or known.firmware_version >= first

    def plausible(self, data: bytes) -> bool:
        """Return whether a servo can have said that of itself."""
        values = self._unpack(data)
        a, b, c = self._order[:3]
        _, speed_sign, load_sign = self._signs
        return not speed_sign or (
            values[b] < 2 * speed_sign
            and values[c] < 2 * load_sign
            and (values[a] < self.model.ticks or self.model.endless)
        )

    def take(self, reply: Reply, stamp: int) -> None:
        """Take note of a reading of the feedback block.

        Args:
            reply: It.
            stamp: When it was read, ns.
        """
        values = self._unpack(reply.data)
        a, b, c, d, e = self._order
        ticks, speed, load = values[a], values[b], values[c]
        position_sign, speed_sign, load_sign = self._signs
        if speed_sign:
            if speed >= speed_sign:
                speed = speed_sign - speed
            if load >= load_sign:
                load = load_sign - load
            if position_sign and ticks >= position_sign:
                ticks = position_sign - ticks
        self.ticks = ticks
        calibration, model = self.calibration, self.model
        if model.endless:
            lowest = calibration.lowest_turn
            ticks = (ticks - lowest) % model.ticks + lowest
        self.position = calibration.position(ticks)
        self.velocity = speed * calibration.direction * self._speed_unit
        self.load = load * calibration.direction / model.load_maximum
        self.voltage = values[d] * 0.1
        self.temperature = float(values[e])
        self.error = reply.error
        self.stamp = stamp

    def calibrate(
        self, calibration: ServoCalibration, own_range: tuple[int, int] | None = None
    ) -> None:
        """Use a calibration, within the servo's own angle limits.

        Args:
            calibration: Of its joint.
            own_range: Lowest and highest tick by the servo's own angle limits; None: as it was.

        Raises:
            ConfigurationError: They have nothing in common; nothing has changed.
        """
        self.range = calibration.within(own_range or self.own_range)
        self.calibration = calibration
        lower, upper = sorted(map(calibration.position, self.range))
        self.limits = (lower, upper)

    @property
    def own_range(self) -> tuple[int, int]:
        """Lowest and highest tick by its own angle limits, as far as they are known."""
        known = self.identity
        return (0, self.model.ticks - 1) if known is None else known.own_range

    def encode_goal(self, ticks: int, speed: float) -> bytes:
        """Return what to write for a goal.

        Args:
            ticks: Goal position, inside the range.
            speed: rad/s, above 0 and at most as fast as `fastest` allows; 0 for the slowest.
        """
        count = round(speed / self._speed_unit)
        if count > self.fastest:
            count = self.fastest
        elif count < self.model.speed_minimum:  # 0 would be full speed
            count = self.model.speed_minimum
        return self.model.goal.layout.pack(*self.model.goal_values(ticks, count))

    def limit_speed(self, limit: float) -> None:
        """Never encode a goal speed above a limit, rad/s."""
        fastest = int(limit / self._speed_unit)
        self.fastest = max(self.model.speed_minimum, min(self.model.speed_maximum, fastest))

    # Whether it answers

    @property
    def lost(self) -> bool:
        """Whether it does not answer and is left out of the cycle."""
        return self.link is LinkState.LOST

    @property
    def answers(self) -> bool:
        """Whether it answered, or was found again, when it was asked last."""
        return self.link not in (LinkState.UNKNOWN, LinkState.SILENT, LinkState.LOST)

    def lose(self, ask_at: int) -> None:
        """Leave it out of the cycle and ask it again at a time, ns."""
        self.ask_at = ask_at
        self._enter(LinkState.LOST)

    def note_failure(self, cause: CommunicationError, ask_at: int) -> None:
        """Note a cycle without a usable reply; ask it again alone, not before a time, ns."""
        self.ask_at = ask_at
        self.failed_cycles += 1
        self.damaged_cycles = 0 if isinstance(cause, ReplyTimeoutError) else self.damaged_cycles + 1
        self._enter(LinkState.SILENT)

    def note_answer(self) -> None:
        """Note a usable reply after something unusual."""
        self.damaged_cycles = 0
        interrupted = self.link in (LinkState.SILENT, LinkState.INTERRUPTED)
        self.failed_cycles = self.ask_at = 0
        self._enter(LinkState.INTERRUPTED if interrupted else LinkState.PRESENT)

    def interrupt(self) -> None:
        """Note that it may have been without power: its torque is read before the next goal."""
        if self.link is LinkState.PRESENT:
            self._enter(LinkState.INTERRUPTED)

    def note_torque(self) -> None:
        """Note that its torque is known again after it was silent."""
        if self.link is LinkState.INTERRUPTED:
            self._enter(LinkState.PRESENT)

    def _enter(self, link: LinkState) -> None:
        self.link = link
        self.changes.count += 1


def answering(servos: Iterator[Servo], tries: int = 3) -> tuple[int, ...]:
    """Ping servos one by one and return the ids that answer.

    A damaged answer counts: somebody is there.
    """
    found: list[int] = []
    for servo in servos:
        try:
            servo.ping(tries)
        except ReplyTimeoutError:
            continue
        except CorruptReplyError:
            pass
        found.append(servo.id)
    return tuple(found)


def model_name(number: int) -> str:
    """Return the name of the model with that Model Number, and the number."""
    try:
        return f"{servo_model_by_number(number).name} ({number})"
    except ConfigurationError:
        return f"an unknown model with number {number}"


# What a servo is asked about itself


@cache
def _spans(table: ControlTable, own: tuple[str, ...]) -> tuple[Block, ...]:
    """Return the reads that tell what a servo is; `own` are registers that only its model has."""
    wanted = (
        "Model Number", "Firmware Version", "Status Return Level", "Torque Enable",
        "Temperature Limit", "Min Voltage Limit", "Shutdown", "Max Torque", "Torque Limit",
        "Hardware Error Status", "EEPROM Lock", "Alarm LED", "Secondary ID", *own,
    )  # fmt: skip
    found = tuple(table.spans(_LONGEST_SPAN, wanted))
    # Of different lengths, so that no reply is taken for the next one.
    assert all(one.length != other.length for one, other in pairwise(found)), table.name
    return found


def _has_shut_down(memory: Mapping[str, int], shutdown: IntFlag) -> bool:
    """Return whether a servo has shut itself down, from its own registers."""
    if memory.get("Hardware Error Status", 0) & shutdown:
        return True
    return "Torque Limit" in memory and memory["Torque Limit"] == 0 < memory["Max Torque"]


def _check_mode(servo: Servo, memory: Mapping[str, int], lower: int, upper: int) -> None:
    """Refuse a servo that does not go to positions, or counts speeds in another way."""
    who = f"servo {servo.id} ({servo.calibration.joint_name})"
    for name, mode in servo.model.modes.items():
        value = memory[name]
        if not mode.fits(value):
            address = servo.model.control_table[name].address
            right = value & ~mode.mask | mode.value
            raise ServoSetupError(
                f"{who} {mode.otherwise}: {name} (register {address}) is {value}; set it to "
                f"{right}, for example with `servo set {servo.id} '{name}' {right}`"
            )
    if servo.model.protocol == 1 and lower == upper:
        name = "wheel mode" if lower == 0 else "multi-turn mode"
        low, high = servo.calibration.tick_range
        limits = " and ".join(servo.model.position_limits)
        raise ServoSetupError(
            f"{who} is in {name} (both angle limits are {lower}) and has no positions within one "
            f"turn; set its {limits}, for example to {low} and {high} with `servo set {servo.id} "
            "REGISTER VALUE`"
        )


def _check_offset(servo: Servo, memory: Mapping[str, int]) -> None:
    """Refuse a servo whose memory adds another offset to its position than when it was calibrated.

    Where the servo's ticks have moved, `init`, `min` and `max` are those of another joint.
    """
    register, wanted = servo.model.offset, servo.calibration.offset
    if register is None or wanted is None:
        return
    offset = register.counts(memory[register.name])
    if offset != wanted:
        raise ServoSetupError(
            f"servo {servo.id} ({servo.calibration.joint_name}) has {register.name} {offset} in "
            f"its memory, but the configuration was made with offset {wanted}: calibrate it "
            f"again, or `servo set {servo.id} '{register.name}' {wanted}`"
        )


def _check_secondary_id(servo: Servo, memory: Mapping[str, int]) -> None:
    """Refuse a servo that obeys packets for a servo of another joint, too."""
    other = memory.get("Secondary ID")
    if other in servo.others:
        raise ServoSetupError(
            f"servo {servo.id} ({servo.calibration.joint_name}) obeys packets for servo {other}, "
            "too, which turns another joint: take its Secondary ID away, for example with "
            f"`servo set {servo.id} 'Secondary ID' 255`"
        )


def _check_direction(servo: Servo, memory: Mapping[str, int]) -> None:
    """Refuse a servo that counts its ticks in the other direction than when it was calibrated.

    Drive Mode is kept in EEPROM: another vendor's driver may have reversed it. The joint would turn
    away from each target.
    """
    calibration = servo.calibration
    if calibration.reverse is None:
        return
    mode = memory["Drive Mode"]
    if bool(mode & _REVERSE) != calibration.reverse:
        wanted, (init, low, high) = mode ^ _REVERSE, calibration.mirrored()
        raise ServoSetupError(
            f"servo {servo.id} ({calibration.joint_name}) has Drive Mode {mode} in its memory, and "
            f"turns in the other direction than configured (reverse: {int(calibration.reverse)}). "
            f"`servo set {servo.id} 'Drive Mode' {wanted}`, or configure reverse: "
            f"{mode & _REVERSE}, init: {init}, min: {low}, max: {high}"
        )
