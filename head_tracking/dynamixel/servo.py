"""One servo: its registers, its identity, its calibration, and what it measured last."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass
from enum import Enum, IntFlag
from typing import Final, TypeVar

from head_tracking.dynamixel.configuration import ServoCalibration
from head_tracking.dynamixel.control_table import Block, Register
from head_tracking.dynamixel.exceptions import (
    CommunicationError,
    ConfigurationError,
    CorruptReplyError,
    ReplyTimeoutError,
    ServoError,
)
from head_tracking.dynamixel.models import ServoModel, servo_model_by_number
from head_tracking.dynamixel.port import DynamixelPort
from head_tracking.dynamixel.protocol import (
    ALERT,
    NO_ERROR,
    REFUSALS,
    ErrorBits,
    Status,
    describe_errors,
    describe_status,
)
from head_tracking.dynamixel.requests import Steps
from head_tracking.dynamixel.state import Counters

_T = TypeVar("_T")

EEPROM_PAUSE: Final = 0.025
"""Pause after a write to EEPROM, s: a servo replies, and then is deaf for about 6 ms per byte."""

MOST_TRIES: Final = 6  # where a servo is identified or shown: a busy machine may miss replies
_TRIES: Final = 3  # where a failure would leave a servo in the wrong state
_REVERSE: Final = 1  # bit of Drive Mode
_WATCHDOG_UNIT: Final = 0.02  # s
_LONGEST_SPAN: Final = 25  # bytes; takes about as long as a usual cycle
_IDENTIFYING: Final = {
    "Firmware Version", "Status Return Level", "Torque Enable", "Temperature Limit",
    "Min Voltage Limit", "Shutdown", "Max Torque", "Torque Limit", "Hardware Error Status",
    "EEPROM Lock",
}  # fmt: skip
"""Registers that are read when a servo is found, besides its model and its settings."""


def run(steps: Steps[_T], pause: Callable[[float], object] = time.sleep) -> _T:
    """Take all steps at once and return their result; an interrupt ends them at once."""
    with closing(steps):
        while True:
            try:
                wait = next(steps)
            except StopIteration as end:
                return end.value  # type: ignore[no-any-return]
            if wait > 0.0:
                pause(wait)


class LinkState(Enum):
    """Whether a servo answers."""

    UNKNOWN = "not found yet"
    PRESENT = "answered the last time"
    SILENT = "did not answer the last time"
    INTERRUPTED = "answers again; its torque has not been read since"
    LOST = "left out of the cycle, and asked now and then"


class Version:
    """A number that changes with the set of servos that are read; one for each bus."""

    def __init__(self) -> None:
        self.number = 0


@dataclass(frozen=True, slots=True)
class ServoIdentity:
    """Facts read from a servo that fits its joint."""

    firmware_version: int
    own_range: tuple[int, int]  # lowest and highest tick by the servo's own angle limits
    shutdown: IntFlag  # errors that make the servo switch itself off
    temperature_limit: float  # it shuts down above this temperature, degrees Celsius
    lowest_voltage: float  # lower limit of its supply, V
    reverse: bool | None = None  # whether Drive Mode reverses its ticks; None: it has none
    offset: int | None = None  # register value that is added to its position; None: it has none


class Servo:
    """A servo on a port. Only the thread that owns the port changes it; any thread may read it.

    Args:
        calibration: Of its joint; None: the whole range of the servo, zero in the middle.
        watchdog: Time without any packet after which it shall stop by itself, s; 0: never.
        version: Of its bus; None: its own.
    """

    def __init__(
        self,
        port: DynamixelPort,
        servo_id: int,
        model: ServoModel,
        calibration: ServoCalibration | None = None,
        watchdog: float = 0.0,
        version: Version | None = None,
    ) -> None:
        self._port, self._protocol = port, model.protocol
        self._version, self._watchdog = version or Version(), watchdog
        self._unpack, self._measured = model.feedback.layout.unpack, model.measured
        self.id = servo_id
        self.model = model
        self.others: Collection[int] = ()  # ids of servos with other goals
        self.goal_key = (model.protocol, model.goal.address, model.goal.length)
        self.fastest = model.speed_maximum  # highest goal speed, counts

        self.identity: ServoIdentity | None = None  # None until it was found
        self.link = LinkState.UNKNOWN
        self.acknowledges_writes = True  # Status Return Level 2
        self.counters = Counters()
        self.failed_cycles = 0  # in a row
        self.damaged_cycles = 0  # the last ones of them in which a damaged reply was received
        self.ask_at = 0  # while it is lost: monotonic time of the next ping, ns
        self.confirmed = False  # it has confirmed torque off, and torque was not switched on since
        self.held_by: object | None = None  # the last request to switch torque on; None: to relax
        self.faulted = False  # it has shut itself down
        self.errors: IntFlag = NO_ERROR  # as read last

        self.stamp = 0  # of the last measurement, ns; 0: none
        self.read_at = 0.0  # its time by the port's clock, which nobody sets, s
        self.ticks = 0
        self.position = 0.0  # of the joint, rad
        self.velocity = 0.0  # rad/s
        self.load = 0.0  # -1 to 1 of full torque, positive towards higher positions
        self.voltage = 0.0
        self.temperature = 0.0  # degrees Celsius
        self.error = 0  # error byte
        whole = ServoCalibration(
            f"servo {servo_id}", servo_id, model.center, 0, model.ticks - 1, model
        )
        self.calibrate(calibration or whole)

    # Transactions. All raise CommunicationError, and PortLostError when the port has gone.

    def ping(self, tries: int = 1) -> int:
        """Ping the servo; return its error byte."""
        return self._try(tries, lambda: self._port.ping(self.id, self._protocol))

    def is_same(self) -> bool:
        """Return whether the servo that answers has the model and the firmware known before."""
        known = self.identity
        return self.get("Model Number", 1) == self.model.model_number and (
            known is None or self.get("Firmware Version", 1) == known.firmware_version
        )

    def read(self, block: Block, tries: int = _TRIES) -> tuple[int, ...]:
        """Read registers and return one value for each."""
        address, length = block.address, block.length
        read = self._port.read
        reply = self._try(tries, lambda: read(self.id, address, length, self._protocol))
        return block.layout.unpack(reply.data)

    def get(self, name: str, tries: int = _TRIES) -> int:
        """Read one register."""
        return self.read(self.model.control_table.block(name), tries)[0]

    def read_named(self, spans: Iterator[Block], tries: int = _TRIES) -> Steps[dict[str, int]]:
        """Read blocks, one in each step; return the values by register name."""
        values: dict[str, int] = {}
        for block in spans:
            names = [register.name for register in block.registers]
            values.update(zip(names, self.read(block, tries), strict=True))
            yield 0.0
        return values

    def registers(self) -> list[tuple[Register, int]]:
        """Read all registers."""
        table = self.model.control_table
        values = run(self.read_named(table.spans(_LONGEST_SPAN), MOST_TRIES))
        return [(register, values[register.name]) for register in table]

    def read_feedback(self, tries: int = 1, clock_offset: int | None = None) -> None:
        """Read and record position, speed, load, voltage and temperature; see `accept`."""
        block = self.model.feedback

        def attempt() -> None:
            reply = self._port.read(self.id, block.address, block.length, self._protocol)
            if not self.accept(reply, clock_offset):
                raise CorruptReplyError(f"servo {self.id}: impossible feedback {reply.data!r}")

        self._try(tries, attempt)

    def write(self, block: Block, *values: int) -> None:
        """Write registers.

        Raises:
            ServoError: The servo refuses the values.
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
        else:  # Feetech's error byte is the state of the servo only
            refusal = error & REFUSALS if self.model.errors is ErrorBits else 0
        if refusal:
            pairs = zip(block.registers, values, strict=True)
            names = ", ".join(f"{register.name} = {value}" for register, value in pairs)
            one = self._protocol == 1
            why = describe_errors(ErrorBits(refusal)) if one else describe_status(refusal)
            raise ServoError(f"servo {self.id} refused {names}: {why}")

    def set(self, name: str, value: int) -> None:
        """Write one register and read it back; raises as `verify` does."""
        run(self.verify(self.model.control_table.block(name), value))

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
        """Restart it; it does not answer for a while. Feetech servos never acknowledge that."""
        acknowledged = self.acknowledges_writes and self._protocol == 2
        self._try(_TRIES, lambda: self._port.reboot(self.id, acknowledged, self._protocol))

    # Steps. All raise what their transactions raise.

    def verify(self, block: Block, *values: int) -> Steps[None]:
        """Write registers and read them back, up to three times.

        Raises:
            ServoError: The servo refuses the values, or keeps others.
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
        raise ServoError(
            f"servo {self.id} keeps {kept} in {names} instead of {values}; it may have shut down: "
            "look at its error bits (overload, overheating), let it cool, or cycle its power"
        )

    def switch_torque(self, on: bool) -> Steps[None]:
        """Switch torque and read it back; raises as `verify` does."""
        return self.verify(self.model.control_table.block("Torque Enable"), int(on))

    def identify(self, keep_torque: bool = False) -> Steps[ServoIdentity]:
        """Check a servo that answers pings, leave it relaxed and locked, and count it as present.

        Args:
            keep_torque: Leave its torque, and its EEPROM lock, as they are.

        Raises:
            ServoError: It is another model, does not answer reads or switch torque off, or is set
                up in a way that its joint cannot use.
            ConfigurationError: Its own angle limits leave the joint no range.
        """
        who, model = f"servo {self.id} ({self.calibration.joint_name})", self.model
        try:
            number = self.get("Model Number", MOST_TRIES)
        except ReplyTimeoutError as cause:
            level = model.control_table["Status Return Level"].address
            words = f"--model '{model.name}' set {self.id} 'Status Return Level' 2"
            raise ServoError(
                f"{who} answers pings but no reads: its Status Return Level (register {level}) is "
                f"probably 0; set it to 2, for example with `{self._port.servo_command(words)}`"
            ) from cause
        if number != model.model_number:
            raise ServoError(
                f"{who} is {model_name(number)}, but the configuration says {model.name} "
                f"({model.model_number}); correct the configuration's model or id"
            )
        yield 0.0
        spans = model.control_table.spans(_LONGEST_SPAN, _IDENTIFYING | model.settings)
        memory = yield from self.read_named(spans, MOST_TRIES)
        self.acknowledges_writes = model.acknowledges_writes(memory["Status Return Level"])
        lower, upper = (memory[name] for name in model.position_limits)
        shutdown = model.errors(memory["Shutdown"] & sum(model.errors))
        identity = ServoIdentity(
            memory["Firmware Version"],
            (lower, upper),
            shutdown,
            float(memory["Temperature Limit"]),
            memory["Min Voltage Limit"] * 0.1,
            bool(memory["Drive Mode"] & _REVERSE) if "Drive Mode" in memory else None,
            None if model.offset is None else memory[model.offset.name],
        )
        problem: ServoError | ConfigurationError | None = None
        try:
            self._check_settings(memory)
            self.calibrate(self.calibration, identity.own_range)
        except (ServoError, ConfigurationError) as cause:
            problem = cause
        else:  # it can be read from now on
            self.identity = identity
            self.faulted = _has_shut_down(memory, shutdown)
            self.failed_cycles = 0
            self._enter(LinkState.INTERRUPTED if self.lost else LinkState.PRESENT)
        if keep_torque:
            self.confirmed = memory["Torque Enable"] != 1
        else:
            yield from self.switch_torque(False)
            self.confirmed = True
            if memory.get("EEPROM Lock") == 0:  # a program has ended while it wrote
                yield from self.lock_eeprom(True)
        if problem is not None:
            raise problem
        return identity

    def set_command(self, name: str, value: int) -> str:
        """Return the command that sets a register of this servo, as a user types it."""
        counts = self.model.control_table[name].counts(value)
        return self._port.servo_command(f"set {self.id} '{name}' {counts}")

    def check_settings(self) -> Steps[None]:
        """Read the settings that its joint needs; raise ServoError if one is wrong."""
        spans = self.model.control_table.spans(_LONGEST_SPAN, self.model.settings)
        self._check_settings((yield from self.read_named(spans)))

    def _check_settings(self, memory: Mapping[str, int]) -> None:
        who = f"servo {self.id} ({self.calibration.joint_name})"
        for name, right, why in self._wrong_settings(memory):
            raise ServoError(
                f"{who} {why}: {name} (register {self.model.control_table[name].address}) is "
                f"{memory[name]}; set it with `{self.set_command(name, right)}`"
            )

    def _wrong_settings(self, memory: Mapping[str, int]) -> Iterator[tuple[str, int, str]]:
        """Yield register name, right value, and what is wrong.

        Drive Mode and offset are kept in EEPROM: another driver may have changed them. What the
        configuration leaves open must stay as it was when the servo was found.
        """
        model, calibration, known = self.model, self.calibration, self.identity
        yield from wrong_mode(self, memory)
        if model.offset is not None:
            register, offset = model.offset, known.offset if known else None
            why = "has another offset than when it was found"
            if calibration.offset is not None:
                offset = register.from_counts(calibration.offset)
                why = "was calibrated with another offset"
            if offset is not None and memory[register.name] != offset:
                yield register.name, offset, why
        reverse, why = known.reverse if known else None, "when it was found"
        if calibration.reverse is not None:
            reverse, why = calibration.reverse, "configured"
        if reverse is not None and bool(memory["Drive Mode"] & _REVERSE) != reverse:
            right = memory["Drive Mode"] ^ _REVERSE
            yield "Drive Mode", right, f"turns in the other direction than {why}"
        if memory.get("Secondary ID") in self.others:
            yield "Secondary ID", 255, "also obeys packets for a servo with other goals"

    def write_eeprom(self, wanted: Mapping[str, int]) -> Steps[dict[str, tuple[int, int]]]:
        """Write settings that differ, and read them back.

        A Feetech servo keeps only what is written while its lock is off.

        Args:
            wanted: Register values by name.

        Returns:
            Old and new value of what was changed, by register name.

        Raises:
            ServoError: Its torque is on, its memory is locked, or it does not keep a value.
        """
        table = self.model.control_table
        self.require_writable_memory()
        changed: dict[str, tuple[int, int]] = {}
        for name, value in wanted.items():
            yield 0.0
            before = self.get(name)
            if before == value:
                continue
            yield 0.0
            block = table.block(name)
            changes_level = name == "Status Return Level"
            try:
                yield from self.lock_eeprom(False)
                self.acknowledges_writes &= not changes_level  # it may reply by the new level
                self.write(block, value)
                if changes_level:
                    self.acknowledges_writes = self.model.acknowledges_writes(value)
                yield EEPROM_PAUSE * block.length
                after = self.get(name)
            finally:  # also if the bus is closed meanwhile
                run(self.lock_eeprom(True))
            if after != value:
                raise ServoError(f"servo {self.id} keeps {after} in {name} instead of {value}")
            changed[name] = (before, value)
        return changed

    def require_writable_memory(self) -> None:
        """Raise ServoError if its torque is on, or its memory is locked."""
        if self.get("Torque Enable"):
            raise ServoError(
                f"the torque of servo {self.id} is on, and its memory cannot be changed then; hold "
                "its load and relax it first"
            )
        table = self.model.control_table
        if "Lock" in table and self.get("Lock"):
            raise ServoError(
                f"the memory of servo {self.id} is locked (register {table['Lock'].address}); "
                "cycle its power"
            )

    def lock_eeprom(self, locked: bool) -> Steps[None]:
        """Write the EEPROM lock of a Feetech servo; other servos have none."""
        table = self.model.control_table
        if "EEPROM Lock" in table:
            yield from self.verify(table.block("EEPROM Lock"), int(locked))

    def switch_watchdog(self, on: bool) -> Steps[None]:
        """Switch its Bus Watchdog, if it has one; off also clears one that has tripped."""
        if self.has_watchdog:
            units = math.ceil(on * self._watchdog / _WATCHDOG_UNIT)
            yield from self.verify(self.model.control_table.block("Bus Watchdog"), min(127, units))

    def read_errors(self) -> IntFlag:
        """Return the errors behind the last error byte; protocol 2.0 needs a read for that."""
        if self._protocol == 1:
            return self.model.errors(self.error & sum(self.model.errors))
        if not self.error & ALERT:
            return self.model.errors(0)
        return self.model.errors(self.get("Hardware Error Status") & sum(self.model.errors))

    # Measurements, calibration and goals

    @property
    def has_watchdog(self) -> bool:
        """Whether it can stop by itself without packets: its firmware has a Bus Watchdog."""
        first, known = self.model.watchdog, self.identity
        return first is not None and known is not None and known.firmware_version >= first

    def accept(self, reply: Status, clock_offset: int | None = None) -> bool:
        """Record a reading of the feedback block; return False for impossible values.

        The checksum of protocol 1.0 is weak: two damaged bits can cancel each other out.

        Args:
            reply: The reading.
            clock_offset: Clock of the stamps minus the port's clock, ns; None: keep the stamp.
        """
        ticks, speed, load, volts, celsius = self._measured(self._unpack(reply.data))
        model, calibration = self.model, self.calibration
        position_sign, speed_sign, load_sign = model.signs
        if speed_sign:
            if speed >= speed_sign:
                if speed >= 2 * speed_sign:
                    return False
                speed = speed_sign - speed
            if load >= load_sign:
                if load >= 2 * load_sign:
                    return False
                load = load_sign - load
            if ticks >= model.ticks and not model.endless:
                return False
            if position_sign and ticks >= position_sign:
                ticks = position_sign - ticks
        self.ticks = ticks
        if model.endless:
            lowest = calibration.lowest_turn
            ticks = (ticks - lowest) % model.ticks + lowest
        self.position = calibration.position(ticks)
        self.velocity = speed * self._velocity_scale
        self.load = load * self._load_scale
        self.voltage = volts * 0.1
        self.temperature = float(celsius)
        self.error = reply.error
        if clock_offset is not None:
            self.read_at = reply.stamp
            self.stamp = clock_offset + int(reply.stamp * 1e9)
        return True

    def calibrate(
        self, calibration: ServoCalibration, own_range: tuple[int, int] | None = None
    ) -> None:
        """Use a calibration, within the servo's own angle limits (ticks; None: those known).

        Raises:
            ConfigurationError: They have nothing in common; nothing has changed.
        """
        self.range = calibration.within(own_range or self.own_range)  # ticks
        self.calibration = calibration
        lower, upper = sorted(map(calibration.position, self.range))
        self.limits = (lower, upper)  # rad
        self._velocity_scale = calibration.direction * self.model.speed_unit
        self._load_scale = calibration.direction / self.model.load_maximum

    @property
    def own_range(self) -> tuple[int, int]:
        """Lowest and highest tick by its own angle limits, as far as they are known."""
        known = self.identity
        return (0, self.model.ticks - 1) if known is None else known.own_range

    def encode_goal(self, ticks: int, speed: float) -> bytes:
        """Return the bytes of a goal.

        Args:
            ticks: Goal position, inside the range.
            speed: rad/s, reduced to `fastest`; 0 for the slowest.
        """
        model = self.model
        count = round(min(speed / model.speed_unit, self.fastest))  # the ratio may be inf
        if count < model.speed_minimum:  # 0 would be full speed
            count = model.speed_minimum
        return model.goal.layout.pack(*model.goal_values((ticks, count, 0)))

    def limit_speed(self, limit: float) -> None:
        """Set the highest goal speed, rad/s."""
        fastest = int(limit / self.model.speed_unit)
        self.fastest = max(self.model.speed_minimum, min(self.model.speed_maximum, fastest))

    # Whether it answers

    @property
    def lost(self) -> bool:
        """Whether it does not answer and is left out of the cycle."""
        return self.link is LinkState.LOST

    @property
    def answers(self) -> bool:
        """Whether it answered, or was found again, the last time."""
        return self.link not in (LinkState.UNKNOWN, LinkState.SILENT, LinkState.LOST)

    def lose(self, ask_at: int) -> None:
        """Leave it out of the cycle, and do not ask it before a monotonic time, ns."""
        self.ask_at = ask_at
        self._enter(LinkState.LOST)

    def note_failure(self, cause: CommunicationError) -> None:
        """Record a cycle without a usable reply."""
        self.failed_cycles += 1
        self.damaged_cycles = 0 if isinstance(cause, ReplyTimeoutError) else self.damaged_cycles + 1
        self._enter(LinkState.SILENT)

    def note_reply(self) -> None:
        """Record a usable reply after another link state than PRESENT."""
        interrupted = self.link in (LinkState.SILENT, LinkState.INTERRUPTED)
        self.failed_cycles = self.damaged_cycles = 0
        self._enter(LinkState.INTERRUPTED if interrupted else LinkState.PRESENT)

    def interrupt(self) -> None:
        """Record that it may have lost its power: its torque is read before the next goal."""
        if self.link is LinkState.PRESENT:
            self._enter(LinkState.INTERRUPTED)

    def note_torque(self) -> None:
        """Record that its torque has been read after an interruption."""
        if self.link is LinkState.INTERRUPTED:
            self._enter(LinkState.PRESENT)

    def _enter(self, link: LinkState) -> None:
        self.link = link
        self._version.number += 1


def answering(servos: Iterable[Servo], tries: int = 3) -> tuple[int, ...]:
    """Ping servos one by one and return the ids that answer, also with a damaged reply."""
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
    """Return name and number of the model with that Model Number."""
    try:
        return f"{servo_model_by_number(number).name} ({number})"
    except ConfigurationError:
        return f"an unknown model with number {number}"


def wrong_mode(servo: Servo, memory: Mapping[str, int]) -> Iterator[tuple[str, int, str]]:
    """Yield name, right value and what is wrong of registers that prevent position control.

    `memory` has the values of its registers by name, with those of its modes and position limits.
    """
    for name, mode in servo.model.modes.items():
        if not mode.fits(memory[name]):
            yield name, memory[name] & ~mode.mask | mode.value, mode.otherwise
    first, last = servo.model.position_limits
    if servo.model.protocol == 1 and memory[first] == memory[last]:
        low, high = servo.calibration.tick_range
        if memory[last] == 0:
            yield last, high, "is in wheel mode"
        else:
            yield first, low, "is in multi-turn mode"


def _has_shut_down(memory: Mapping[str, int], shutdown: IntFlag) -> bool:
    if memory.get("Hardware Error Status", 0) & shutdown:
        return True
    return "Torque Limit" in memory and memory["Torque Limit"] == 0 < memory["Max Torque"]
