"""A simulated servo: its reaction to packets, its errors, its watchdog, its motion."""

from __future__ import annotations

from collections import deque
from random import Random
from typing import Final, NamedTuple

from head_tracking.simulation.feetech import FeetechRegisters
from head_tracking.simulation.models import (
    Named,
    Register,
    SimulatedModel,
    SimulationError,
    simulated_model,
    to_sign_magnitude,
)
from head_tracking.simulation.motion import Drive, Mechanics
from head_tracking.simulation.packets import (
    ALERT,
    BROADCAST,
    DamagedPacket,
    Instruction,
    Packet,
    Status,
)
from head_tracking.simulation.registers import (
    WATCHDOG_TRIPPED,
    Denial,
    JointRegisters,
    Registers,
    XRegisters,
)

OVERLOAD_TIME: Final = 1_000_000_000
"""Time for which a servo tolerates a load that it cannot move, ns (assumed)."""

_LOGGED: Final = {
    "Goal Position", "Torque Enable", "Moving Speed", "Profile Velocity", "Bus Watchdog"
}  # fmt: skip
"""Registers whose writes are kept."""

ServoRegisters = JointRegisters | XRegisters | FeetechRegisters

_FIRMWARE: Final = {1: 24, 2: 50}
_WATCHDOG_UNIT: Final = 20_000_000  # ns
_CHECK_PERIOD: Final = 20_000_000  # ns between checks for errors while the servo moves

_DAMAGED: Final = {1: 16, 2: 3}
"""Error byte of the answer to a packet with a wrong checksum, by protocol."""


class Write(NamedTuple):
    """A write to registers that affect the motion, which a servo accepted."""

    time: int  # ns
    id: int  # of the servo
    goal: int  # Goal Position after the write
    speed: int  # Moving Speed or Profile Velocity after the write
    torque: bool  # whether torque was enabled after the write
    names: tuple[str, ...]  # the written registers


class Alarms:
    """The error bits of a servo.

    Protocol 1.0: voltage and temperature errors last as long as their cause. An overload that shuts
    the servo down lasts until Torque Limit is written. Protocol 2.0: an error that shuts the servo
    down lasts until a reboot.

    Attributes:
        active: The present error bits.
        forced: Injected error bits, such as ENCODER.
    """

    def __init__(self, model: SimulatedModel) -> None:
        self._model = model
        self._lasting = model.overload_error if model.protocol == 1 else 0xFF
        self._latched = 0
        self.active = 0
        self.forced = 0

    def update(self, registers: Registers, volts: float, celsius: float, strain: int) -> int:
        """Update the error bits; return those that shut the servo down.

        Args:
            registers: Limits, and the Shutdown mask.
            volts: Supply voltage.
            celsius: Temperature.
            strain: See `Drive`, ns.
        """
        model, errors = self._model, self.forced
        supply = round(volts * 10.0)
        if not registers["Min Voltage Limit"] <= supply <= registers["Max Voltage Limit"]:
            errors |= model.voltage_error
        if celsius > registers["Temperature Limit"]:
            errors |= model.heat_error
        if strain > OVERLOAD_TIME:
            errors |= model.overload_error
        fatal = errors & registers["Shutdown"]
        self._latched |= fatal & self._lasting
        self.active = errors | self._latched
        return fatal | self._latched

    def clear(self) -> None:
        """Clear latched errors."""
        self._latched = self.active = 0


class SimulatedServo:
    """A servo of any model. Time is an argument: integer ns that never decrease.

    `true_position` is the exact angle of the link, behind all play: rad, counter-clockwise, 0 in
    the middle of the range. `true_ticks` is the same in fractional ticks, so that
    `JointConfiguration.position(servo.true_ticks)` is the true position of the joint.

    Args:
        servo_id: Its id.
        model: Name of the model, or an object that has this name.
        position: Initial position, ticks; None: the middle.
        supply_voltage: V; None: the nominal voltage.
        firmware: Firmware version; it selects the registers.
        start_delay: Time from a goal to the start of the motion, s; 17 to 50 ms were measured.
        position_noise: Standard deviation of the encoder, ticks.
        eeprom_time: Time without answers for each byte written to EEPROM, s; 6 ms were measured.
        boot_time: Time without answers after power-on and reboot, s.
        random: Source of the noise.

    Attributes:
        model: Its model.
        drive: Motor, gear and shaft, which may be pushed, impeded or given play.
        supply_voltage: V; may be changed at any time.
        temperature: Degrees Celsius; may be changed at any time, and does not change by itself.
        alarms: Its error bits.
        encoder_frozen: Whether the measured position no longer changes.
        writes: The latest accepted writes of goals, speeds, torque and watchdog.
    """

    def __init__(
        self,
        servo_id: int = 1,
        model: str | Named = "AX-12",
        *,
        position: float | None = None,
        supply_voltage: float | None = None,
        firmware: int | None = None,
        start_delay: float = 0.0,
        position_noise: float = 0.0,
        eeprom_time: float = 0.0,
        boot_time: float = 0.3,
        random: Random | None = None,
    ) -> None:
        self.model = own = simulated_model(model)
        ticks = float(own.center) if position is None else position
        self.supply_voltage = own.nominal_voltage if supply_voltage is None else supply_voltage
        self.temperature = 30.0
        self.alarms = Alarms(own)
        self.encoder_frozen = False
        self.writes: deque[Write] = deque(maxlen=1)
        self._position_noise = position_noise
        self._eeprom_time, self._boot_time = eeprom_time, boot_time
        self._random = random or Random(servo_id)
        self._registers: ServoRegisters
        if own.is_feetech:
            self._registers = FeetechRegisters(own, firmware or 3)
        else:
            kind = XRegisters if own.control == "profile" else JointRegisters
            self._registers = kind(own, firmware or _FIRMWARE[own.protocol])
        self._registers["ID"] = servo_id
        self._registers.start(ticks)
        self._measured = self._registers.first_measured
        self.drive = Drive(
            Mechanics.of(own),
            (ticks - own.center) * own.radians_per_tick,
            self._registers.settings(),
            round(start_delay * 1e9),
        )
        self._powered = True
        self._now = self._last_packet = self._silent_until = 0

    @property
    def id(self) -> int:
        """Id of the servo."""
        return self._registers["ID"]

    @property
    def true_position(self) -> float:
        """Exact angle of the link, rad, counter-clockwise, 0 in the middle of the range."""
        return self.drive.link

    @property
    def true_ticks(self) -> float:
        """Exact angle of the link in ticks of the servo, not quantised."""
        return self._registers.ticks(self.drive.link)

    @property
    def at_rest(self) -> bool:
        """Whether nothing moves until the next packet or disturbance."""
        return self.drive.at_rest and self._watchdog_trip is None

    @property
    def return_delay(self) -> int:
        """Time between instruction and status packet, ns."""
        return self._registers["Return Delay Time"] * 2_000

    @property
    def baud_rate(self) -> int:
        """Baud rate, bits per second."""
        code = self._registers["Baud Rate"]
        return self.model.baud_rates.get(code) or 2_000_000 // (code + 1)

    def register(self, name: str) -> int:
        """Return the value of a register; raise SimulationError if the model does not have it."""
        self._measure()
        return self._registers[self._find(name).name]

    def set_register(self, name: str, value: int) -> None:
        """Set a register without the checks and side effects of a packet.

        Raises:
            SimulationError: There is no such register.
            OverflowError: The value does not fit into its bytes.
        """
        self._registers[self._find(name).name] = value
        self._configure()

    def set_offset(self, ticks: int) -> None:
        """Set the position offset in the EEPROM; raises as `set_register` does."""
        if self.model.is_feetech:
            self.set_register("Position Offset", to_sign_magnitude(ticks, 11))
        else:
            homing = "Homing Offset" in self._registers
            self.set_register("Homing Offset" if homing else "Multi Turn Offset", ticks)

    def _find(self, name: str) -> Register:
        try:
            return self._registers.table[name]
        except KeyError:
            raise SimulationError(f"{self.model.name} has no register {name!r}") from None

    def lead(self, ticks: float, duration: float, strength: float = 0.5) -> None:
        """Move the shaft by hand to a tick and release it there.

        Args:
            ticks: Target.
            duration: Duration of the motion, s, from the last `advance` on.
            strength: Highest torque of the hand, N m.
        """
        self.drive.lead(self._registers.angle(ticks), duration, strength)

    def overload(self) -> None:
        """Cause an overload error."""
        self.drive.strain = 2 * OVERLOAD_TIME
        self._check_errors()

    def power_off(self) -> None:
        """Switch the supply off: no torque, no answers, RAM is lost."""
        self._powered = False
        self._registers["Torque Enable"] = 0
        self._configure()

    def power_on(self) -> None:
        """Switch the supply on."""
        self._powered = True
        self._start()

    def advance(self, now: int) -> None:
        """Simulate up to `now`, ns; time at rest needs no computation."""
        trip = self._watchdog_trip
        if trip is not None and now > trip:
            self._pass(trip)
            if self._watchdog_trip == trip and isinstance(self._registers, XRegisters):
                self._registers.hold(self.drive)
                self._configure()
        self._pass(now)

    def _pass(self, now: int) -> None:
        voltage = self.supply_voltage / self.model.nominal_voltage
        drive = self.drive
        while self._now + _CHECK_PERIOD < now and (
            not drive.at_rest or 0 < drive.strain <= OVERLOAD_TIME  # an error may occur
        ):
            self._now += _CHECK_PERIOD
            drive.advance(self._now, voltage)
            self._check_errors()
        self._now = max(self._now, now)
        drive.advance(now, voltage)
        self._check_errors()

    @property
    def _watchdog_trip(self) -> int | None:
        """Time at which the Bus Watchdog trips without a packet, ns; None: it is inactive."""
        armed = self._registers.get("Bus Watchdog")
        if not 0 < armed < WATCHDOG_TRIPPED or not self._registers["Torque Enable"]:
            return None
        return self._last_packet + armed * _WATCHDOG_UNIT

    def _check_errors(self) -> None:
        """Update the alarms; shut down if an error requires it."""
        if not self._powered:
            return
        registers, drive = self._registers, self.drive
        fatal = self.alarms.update(registers, self.supply_voltage, self.temperature, drive.strain)
        if fatal and registers.shut_down():
            self._configure()
        if "Hardware Error Status" in registers:
            registers["Hardware Error Status"] = self.alarms.active

    def _measure(self) -> None:
        registers, deviation = self._registers, self._position_noise
        position = registers["Present Position"]
        registers.measure(self.drive, self._random.gauss(0.0, deviation) if deviation else 0.0)
        if self.encoder_frozen:
            registers["Present Position"] = position
        volts = max(0, min(255, round(self.supply_voltage * 10.0)))
        wide = "Present Input Voltage" in registers
        registers["Present Input Voltage" if wide else "Present Voltage"] = volts
        registers["Present Temperature"] = max(0, min(255, round(self.temperature)))

    def _configure(self) -> None:
        self.drive.configure(self._registers.settings())

    def _start(self) -> None:
        registers = self._registers
        registers.load_initial_values(eeprom=False)
        registers.reset_turns(self.drive)
        registers.start(registers.ticks(self.drive.measured))
        self.drive.strain = 0
        self.alarms.clear()
        self._ignore_packets(self._boot_time)
        self._configure()

    def _ignore_packets(self, seconds: float) -> None:
        self._silent_until = max(self._silent_until, self._now + round(seconds * 1e9))

    def execute(self, packet: Packet, now: int) -> Status | None:
        """Execute a packet if it is addressed to this servo; return the status packet, if any."""
        servo_id = self.id  # the answer to a change of the id carries the former one
        if packet.id not in (servo_id, BROADCAST):
            return None
        silent = packet.id != servo_id
        if silent and packet.code in (Instruction.PING, Instruction.READ):
            return None  # see `SimulatedBus`: the order of the answers matters
        if not self._receives(now):
            return None
        answers = self._answers(packet.code)
        refusal, data = self._execute(packet)
        if self.model.is_feetech and packet.code == Instruction.REBOOT:
            return None
        if silent or not (answers and self._answers(packet.code)):
            return None
        return self._status(refusal, data, servo_id)

    def complain(self, packet: DamagedPacket, now: int) -> Status | None:
        """Return the status packet after a packet with a wrong checksum, if any."""
        if packet.id != self.id or not self._receives(now) or not self._answers(Instruction.WRITE):
            return None
        if self.model.is_feetech:
            return None  # the error byte has no bit for it
        return Status(self.id, _DAMAGED[self.model.protocol] | self._state)

    def answer_ping(self, now: int) -> Status | None:
        """Return the status packet after a broadcast ping (protocol 2.0)."""
        return self._status(None, self._ping()) if self._receives(now) else None

    def answer_read(self, address: int, length: int, now: int) -> Status | None:
        """Return the status packet for its share of a sync or bulk read, if any."""
        if not self._receives(now) or not self._answers(Instruction.READ):
            return None
        return self._status(*self._read(address, length))

    def _receives(self, now: int) -> bool:
        """Return whether a packet at this time is received; restart the watchdog."""
        self.advance(now)
        if not self._powered or now < self._silent_until:
            return False
        self._last_packet = max(self._last_packet, now)
        return True

    def _answers(self, code: int) -> bool:
        return code == Instruction.PING or self._registers.answers(code == Instruction.READ)

    @property
    def _state(self) -> int:
        """Error bits in every answer: all of them (protocol 1.0), or the alert bit (2.0)."""
        if self.model.protocol == 1:
            return self.alarms.active
        return ALERT if self.alarms.active else 0

    def _status(self, refusal: Denial | None, data: bytes, servo_id: int | None = None) -> Status:
        error = self._registers.error_byte(refusal)
        return Status(self.id if servo_id is None else servo_id, error | self._state, data)

    def _execute(self, packet: Packet) -> tuple[Denial | None, bytes]:
        parameters, width = packet.parameters, self.model.protocol  # bytes of an address
        broadcast = packet.id == BROADCAST
        address, data = int.from_bytes(parameters[:width], "little"), parameters[width:]
        refusal: Denial | None = None
        match packet.code:
            case Instruction.PING:
                return None, self._ping()
            case Instruction.READ:
                if len(data) != width:
                    return Denial.LENGTH, b""
                return self._read(address, int.from_bytes(data, "little"))
            case Instruction.WRITE:
                short = len(parameters) < width
                refusal = Denial.LENGTH if short else self._write(address, data)
            case Instruction.REBOOT if width == 2 or self.model.is_feetech:
                self._start()
            case Instruction.SYNC_WRITE if broadcast:
                share = _sync_share(data, width, self.id)
                refusal = None if share is None else self._write(address, share)
            case _:
                refusal = Denial.INSTRUCTION
        return refusal, b""

    def _ping(self) -> bytes:
        if self.model.protocol == 1:
            return b""
        number = self._registers["Model Number"].to_bytes(2, "little")
        return number + bytes((self._registers["Firmware Version"],))

    def _read(self, address: int, length: int) -> tuple[Denial | None, bytes]:
        if address + length > self._measured:
            self._measure()
        data = self._registers.read(address, length)
        return (Denial.ACCESS, b"") if data is None else (None, data)

    def _write(self, address: int, data: bytes) -> Denial | None:
        registers = self._registers
        changes = registers.changes(address, data)
        if isinstance(changes, Denial):
            return changes
        before = registers.apply(changes, self.drive)
        if before.get("Torque Limit") == 0 and registers["Torque Limit"]:
            self.alarms.clear()
            self.drive.strain = 0
        if any(registers[name] != value for name, value in before.items()):
            self._configure()
        if self._eeprom_time:
            written = (registers.table[name] for name in changes)
            slow = sum(register.size for register in written if register.eeprom)
            self._ignore_packets(slow * self._eeprom_time)
        if names := tuple(name for name in before if name in _LOGGED):
            goal, torque = registers["Goal Position"], bool(registers["Torque Enable"])
            speed = registers[registers.speed_register]
            self.writes.append(Write(self._now, self.id, goal, speed, torque, names))
        return None


def _sync_share(data: bytes, width: int, servo_id: int) -> bytes | None:
    """Return the data of a sync write for a servo, from the bytes after the address; or None."""
    length, shares = int.from_bytes(data[:width], "little"), data[width:]
    if length == 0 or len(shares) % (length + 1):
        return None
    for start in range(0, len(shares), length + 1):
        if shares[start] == servo_id:
            return shares[start + 1 : start + 1 + length]
    return None
