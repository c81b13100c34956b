"""A simulated servo: what it does about packets, its alarms, its watchdog, its motion."""

from __future__ import annotations

import math
from dataclasses import replace
from random import Random
from typing import Final

from head_tracking.simulation.exceptions import SimulationError
from head_tracking.simulation.feetech import RESTART, FeetechRegisters, to_sign_magnitude
from head_tracking.simulation.models import Named, Register, SimulatedModel, simulated_model
from head_tracking.simulation.motion import Coupling, Drive, Mechanics
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
    JointRegisters,
    Refusal,
    Registers,
    XRegisters,
)
from head_tracking.simulation.write_log import WriteLog

OVERLOAD_TIME: Final = 1_000_000_000
"""Time for which a servo bears a load that it cannot move, ns (ours)."""

ServoRegisters = JointRegisters | XRegisters | FeetechRegisters

_FIRMWARE: Final = {1: 24, 2: 50}
_WATCHDOG_UNIT: Final = 20_000_000  # ns
_LOOK: Final = 20_000_000  # ns between looks for errors while something moves

_DAMAGED: Final = {1: 16, 2: 3}
"""Error bytes of who has heard a packet with a wrong checksum, by protocol."""


class Alarms:
    """The error bits of a servo.

    Protocol 1.0: voltage and temperature errors are there as long as their cause is. An overload
    that shuts the servo down stays until Torque Limit is written. Protocol 2.0: whatever shuts the
    servo down stays until it is rebooted.

    Attributes:
        active: The bits  that every answer tells of.
        forced: Bits that somebody else wants to be there, such as ENCODER.
    """

    def __init__(self, model: SimulatedModel) -> None:
        self._voltage = model.voltage_error
        self._heat = model.heat_error
        self._overload = model.overload_error
        self._lasting = self._overload if model.protocol == 1 else 0xFF
        self._latched = 0
        self.active = 0
        self.forced = 0

    def look(self, registers: Registers, volts: float, celsius: float, strain: int) -> int:
        """Return the bits that shut the servo down now; `strain` is in ns, see `Drive`."""
        errors = self.forced
        supply = round(volts * 10.0)
        if not registers["Min Voltage Limit"] <= supply <= registers["Max Voltage Limit"]:
            errors |= self._voltage
        if celsius > registers["Temperature Limit"]:
            errors |= self._heat
        if strain > OVERLOAD_TIME:
            errors |= self._overload
        fatal = errors & registers["Shutdown"]
        self._latched |= fatal & self._lasting
        self.active = errors | self._latched
        return fatal | self._latched

    def clear(self) -> None:
        """Forget what has been and is no more."""
        self._latched = self.active = 0


class SimulatedServo:
    """A servo of any model behind its protocol. Time is passed in, as integer ns that never fall.

    The true angle of what the shaft carries is known exactly as `true_position`, in rad,
    counter-clockwise, 0 at the middle of the range; `true_ticks` gives it in fractions of a tick,
    so that `JointConfiguration.position(servo.true_ticks)` is the joint's true position.

    Args:
        servo_id: Its id.
        model: Its model's name, or anything that has such a name.
        position: Where the shaft stands at first, in ticks; None: in the middle.
        supply_voltage: V; None: what the model is made for.
        firmware: Version of the firmware; its registers are those of that version.
        start_delay: Time from a goal to the begin of the motion, s; 17 to 50 ms were measured.
        position_noise: Standard deviation of the encoder, ticks.
        eeprom_time: Time the servo is deaf for each byte written to EEPROM, s; 6 ms were measured.
        boot_time: Time it is deaf after power-on and reboot, s.
        gear_play: Play before the encoder, rad from side to side: the motor turns and the encoder
            stands.
        link_play: Play behind the encoder, rad from side to side: the encoder turns and what the
            shaft carries stands.
        stiction: Share of the stall torque up to which a standing shaft does not move; None: as
            built. One above the friction of the moving gear (0.023) makes slow motion stick and
            slip.
        random: Draws the noise.

    Attributes:
        model: Its model.
        supply_voltage: V; may be changed at any time.
        alarms: Its error bits; to some, `alarms.forced`, others may add.
        encoder_frozen: Whether its position is no longer measured, and reads as it last did.
        write_log: What is told of every goal, speed and switch that it takes.
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
        gear_play: float = 0.0,
        link_play: float = 0.0,
        stiction: float | None = None,
        random: Random | None = None,
    ) -> None:
        self.model = own = simulated_model(model)
        ticks = float(own.center) if position is None else position
        if not 0.0 <= ticks <= own.ticks - 1:
            raise SimulationError(
                f"servo {servo_id} cannot stand at tick {position}; allowed are 0 to "
                f"{own.ticks - 1}"
            )
        for name, value in (
            ("gear_play", gear_play), ("link_play", link_play), ("stiction", stiction or 0.0),
        ):  # fmt: skip
            if not 0.0 <= value < math.inf:
                raise SimulationError(f"servo {servo_id}: {name} is {value}; it cannot be below 0")
        mechanics = replace(Mechanics.of(own), gear_play=gear_play, link_play=link_play)
        if stiction is not None:
            mechanics.stiction = stiction * own.stall_torque
        self.supply_voltage = own.nominal_voltage if supply_voltage is None else supply_voltage
        self.alarms = Alarms(own)
        self.encoder_frozen = False
        self.write_log: WriteLog | None = None
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
        self._drive = Drive(
            own,
            (ticks - own.center) * own.radians_per_tick,
            self._registers.settings(),
            round(start_delay * 1e9),
            mechanics,
        )
        self._powered = True
        self._now = self._heard = self._deaf_until = 0

    # What a test or a simulation may look at and do

    @property
    def id(self) -> int:
        """The id it answers to."""
        return self._registers["ID"]

    @property
    def true_position(self) -> float:
        """Angle of what the shaft carries, rad, counter-clockwise, 0 in the middle; exact."""
        return self._drive.link

    @property
    def encoder_position(self) -> float:
        """Angle of the shaft at the encoder, rad, as `true_position`; they differ by the play."""
        return self._drive.angle

    @property
    def true_ticks(self) -> float:
        """Angle of what the shaft carries, in ticks as the servo counts them; not quantised."""
        return self._registers.ticks(self._drive.link)

    @property
    def true_velocity(self) -> float:
        """Speed of the shaft, rad/s, counter-clockwise."""
        return self._drive.speed

    @property
    def at_rest(self) -> bool:
        """Whether nothing will move until somebody does something."""
        return self._drive.at_rest and self._watchdog_trip is None

    @property
    def return_delay(self) -> int:
        """Time between an instruction and the answer, ns."""
        return self._registers["Return Delay Time"] * 2_000

    @property
    def baud_rate(self) -> int:
        """Bits per second at which it listens and talks."""
        code = self._registers["Baud Rate"]
        return self.model.baud_rates.get(code) or 2_000_000 // (code + 1)

    @property
    def temperature(self) -> float:
        """Degrees Celsius."""
        return self._drive.temperature.celsius

    @temperature.setter
    def temperature(self, celsius: float) -> None:
        self._drive.temperature.celsius = celsius

    @property
    def inertia(self) -> float:
        """Of the rotor with its gear and all that they turn, at the output shaft, kg m^2."""
        return self._drive.mechanics.inertia

    @inertia.setter
    def inertia(self, inertia: float) -> None:
        self._drive.mechanics.inertia = inertia

    def register(self, name: str) -> int:
        """Return a register as a read would find it; raises SimulationError if it has none."""
        self._measure()
        return self._registers[self._find(name).name]

    def set_register(self, name: str, value: int) -> None:
        """Set a register as the servo's former owner left it: no check, no torque.

        Raises:
            SimulationError: There is no such register, or the value does not fit into its bytes.
        """
        register = self._find(name)
        try:
            value.to_bytes(register.size, register.order, signed=register.signed)
        except OverflowError as cause:
            raise SimulationError(f"{name} cannot hold {value}") from cause
        self._registers[name] = value
        self._configure()

    def set_offset(self, ticks: int) -> None:
        """Set what its memory adds to its position; raises as `set_register` does."""
        if self.model.is_feetech:
            self.set_register("Position Offset", to_sign_magnitude(ticks, 11))
        else:
            homing = "Homing Offset" in self._registers
            self.set_register("Homing Offset" if homing else "Multi Turn Offset", ticks)

    def _find(self, name: str) -> Register:
        try:
            return self._registers.table[name]
        except KeyError:
            raise SimulationError(f"a simulated {self.model.name} has no {name!r}") from None

    def push(self, torque: float) -> None:
        """Load the shaft from outside until the next call, N m, counter-clockwise."""
        self._drive.push(torque)

    def lead(self, ticks: float, duration: float, strength: float = 0.5) -> None:
        """Let a hand lead the shaft to a tick and let go there; torque resists it.

        Args:
            ticks: Where to.
            duration: Time for the way, s, from the last `advance` on.
            strength: Highest torque of the hand, N m.
        """
        way = self._registers.ticks(1.0) - self._registers.ticks(0.0)
        angle = self.true_position + (ticks - self.true_ticks) / way
        self._drive.lead(angle, duration, strength)

    def couple(self, other: SimulatedServo, direction: int) -> Coupling:
        """Return a bracket that joins the shafts of two servos; see `SimulatedBus.couple`."""
        return Coupling(self._drive, other._drive, direction)

    def impede(self, share: float) -> None:
        """Give the gear a friction of so much of the stall torque; 1 jams it, 0 is as built."""
        self._drive.impede(share)

    def overload(self) -> None:
        """Let the servo find that it has not been able to move its load for too long."""
        self._drive.strain = 2 * OVERLOAD_TIME
        self._look()

    def power_off(self) -> None:
        """Take the supply away: torque goes, nothing is answered, RAM is lost."""
        self._powered = False
        self._registers["Torque Enable"] = 0
        self._configure()

    def power_on(self) -> None:
        """Bring the supply back."""
        self._powered = True
        self._start()

    # Time

    def advance(self, now: int) -> None:
        """Let time pass up to `now`, ns; time at rest costs nothing."""
        trip = self._watchdog_trip
        if trip is not None and now > trip:
            self._pass(trip)
            if self._watchdog_trip == trip and isinstance(self._registers, XRegisters):
                self._registers.hold(self._drive)
                self._configure()
        self._pass(now)

    def _pass(self, now: int) -> None:
        voltage = self.supply_voltage / self.model.nominal_voltage
        drive = self._drive
        while self._now + _LOOK < now and (
            not drive.at_rest or 0 < drive.strain <= OVERLOAD_TIME  # an error may come up
        ):
            self._now += _LOOK
            drive.advance(self._now, voltage)
            self._look()
        self._now = max(self._now, now)
        drive.advance(now, voltage)
        self._look()

    @property
    def _watchdog_trip(self) -> int | None:
        """When the Bus Watchdog stops the servo if nothing comes, ns; None: it is not watching."""
        armed = self._registers.get("Bus Watchdog")
        if not 0 < armed < WATCHDOG_TRIPPED or not self._registers["Torque Enable"]:
            return None
        return self._heard + armed * _WATCHDOG_UNIT

    def _look(self) -> None:
        """Look for errors, and shut down if one of them is to do so."""
        if not self._powered:
            return
        registers, drive = self._registers, self._drive
        celsius = drive.temperature.celsius
        fatal = self.alarms.look(registers, self.supply_voltage, celsius, drive.strain)
        if fatal and registers.shut_down():
            self._configure()
        if "Hardware Error Status" in registers:
            registers["Hardware Error Status"] = self.alarms.active

    def _measure(self) -> None:
        """Write what the servo measures into its registers."""
        registers, deviation = self._registers, self._position_noise
        position = registers["Present Position"]
        registers.measure(self._drive, self._random.gauss(0.0, deviation) if deviation else 0.0)
        if self.encoder_frozen:
            registers["Present Position"] = position
        volts = max(0, min(255, round(self.supply_voltage * 10.0)))
        wide = "Present Input Voltage" in registers
        registers["Present Input Voltage" if wide else "Present Voltage"] = volts
        registers["Present Temperature"] = max(0, min(255, round(self.temperature)))
        if "Realtime Tick" in registers:
            registers["Realtime Tick"] = self._now // 1_000_000 % 32_768

    def _configure(self) -> None:
        self._drive.configure(self._registers.settings())

    def _start(self) -> None:
        registers = self._registers
        registers.load_initial_values(eeprom=False)
        registers.fold(self._drive)
        registers.start(registers.ticks(self._drive.measured))
        self._drive.strain = 0
        self.alarms.clear()
        self._be_deaf(self._boot_time)
        self._configure()

    def _be_deaf(self, seconds: float) -> None:
        self._deaf_until = max(self._deaf_until, self._now + round(seconds * 1e9))

    # Packets

    def execute(self, packet: Packet, now: int) -> Status | None:
        """Carry out a packet of its protocol if it is for this servo; return its answer, if any."""
        servo_id = self.id  # the answer to a change of the id still carries the old one
        if packet.id not in (servo_id, BROADCAST):
            return None
        silent = packet.id != servo_id
        if silent and packet.code in (Instruction.PING, Instruction.READ):
            return None  # a ping of all is the bus's business: their order matters
        if not self._hears(now):
            return None
        answers = self._answers(packet.code)
        refusal, data = self._carry_out(packet)
        if self.model.is_feetech and packet.code == RESTART:
            return None
        if silent or not (answers and self._answers(packet.code)):
            return None
        return self._status(refusal, data, servo_id)

    def complain(self, packet: DamagedPacket, now: int) -> Status | None:
        """Return the answer to a packet with a wrong checksum, if it is for this servo."""
        if packet.id != self.id or not self._hears(now) or not self._answers(Instruction.WRITE):
            return None
        if self.model.is_feetech:
            return None  # its error byte has no bit for that
        return Status(self.id, _DAMAGED[self.model.protocol] | self._state)

    def answer_ping(self, now: int) -> Status | None:
        """Return the answer to a ping of all (protocol 2.0)."""
        return self._status(None, self._ping()) if self._hears(now) else None

    def answer_read(self, address: int, length: int, now: int) -> Status | None:
        """Return the answer to a share of a sync or bulk read, if it gives one."""
        if not self._hears(now) or not self._answers(Instruction.READ):
            return None
        return self._status(*self._read(address, length))

    def _hears(self, now: int) -> bool:
        """Return whether a packet that comes now reaches it, and take note that one came."""
        self.advance(now)
        if not self._powered or now < self._deaf_until:
            return False
        self._heard = max(self._heard, now)
        return True

    def _answers(self, code: int) -> bool:
        """Return whether it answers an instruction, by its Status Return Level."""
        return code == Instruction.PING or self._registers.answers(code == Instruction.READ)

    @property
    def _state(self) -> int:
        """What every answer tells: the errors (protocol 1.0), or that there are some (2.0)."""
        if self.model.protocol == 1:
            return self.alarms.active
        return ALERT if self.alarms.active else 0

    def _status(self, refusal: Refusal | None, data: bytes, servo_id: int | None = None) -> Status:
        error = self._registers.error_byte(refusal)
        return Status(self.id if servo_id is None else servo_id, error | self._state, data)

    def _carry_out(self, packet: Packet) -> tuple[Refusal | None, bytes]:
        parameters, width = packet.parameters, self.model.protocol  # bytes of an address
        broadcast, two = packet.id == BROADCAST, width == 2
        address, data = int.from_bytes(parameters[:width], "little"), parameters[width:]
        refusal: Refusal | None = None
        match packet.code:
            case Instruction.PING:
                return None, self._ping()
            case Instruction.READ:
                if len(data) != width:
                    return Refusal.LENGTH, b""
                return self._read(address, int.from_bytes(data, "little"))
            case Instruction.WRITE:
                short = len(parameters) < width
                refusal = Refusal.LENGTH if short else self._write(address, data)
            case Instruction.REBOOT if two or self.model.is_feetech:
                self._start()
            case Instruction.SYNC_WRITE if broadcast:
                share = _sync_share(data, width, self.id)
                refusal = None if share is None else self._write(address, share)
            case Instruction.BULK_WRITE if broadcast and two:
                bulk_share = _bulk_share(parameters, self.id)
                refusal = None if bulk_share is None else self._write(*bulk_share)
            case _ if self._registers.carry_out(packet.code, parameters, self._drive):
                self._configure()
            case _:
                refusal = Refusal.INSTRUCTION
        return refusal, b""

    def _ping(self) -> bytes:
        if self.model.protocol == 1:
            return b""
        number = self._registers["Model Number"].to_bytes(2, "little")
        return number + bytes((self._registers["Firmware Version"],))

    def _read(self, address: int, length: int) -> tuple[Refusal | None, bytes]:
        if address + length > self._measured:
            self._measure()
        data = self._registers.read(address, length)
        return (Refusal.ACCESS, b"") if data is None else (None, data)

    def _write(self, address: int, data: bytes) -> Refusal | None:
        registers = self._registers
        changes = registers.changes(address, data)
        if isinstance(changes, Refusal):
            return changes
        before = {name: registers[name] for name in changes}
        for name, value in changes.items():
            registers[name] = value
        if registers.stiffens(changes):
            before.setdefault("Torque Enable", registers["Torque Enable"])
            registers["Torque Enable"] = 1
        if before.get("Torque Limit") == 0 and registers["Torque Limit"]:
            self.alarms.clear()
            self._drive.strain = 0
        if any(registers[name] != value for name, value in before.items()):
            registers.written(before, self._drive)
            self._configure()
        if self._eeprom_time:
            written = (registers.table[name] for name in changes)
            slow = sum(register.size for register in written if register.eeprom)
            self._be_deaf(slow * self._eeprom_time)
        if self.write_log is not None:
            self.write_log.note(self._now, self.id, registers, before)
        return None


def _sync_share(data: bytes, width: int, servo_id: int) -> bytes | None:
    """Return what a sync write holds for a servo, of what follows its address; None: nothing."""
    length, shares = int.from_bytes(data[:width], "little"), data[width:]
    if length == 0 or len(shares) % (length + 1):
        return None
    for start in range(0, len(shares), length + 1):
        if shares[start] == servo_id:
            return shares[start + 1 : start + 1 + length]
    return None


def _bulk_share(parameters: bytes, servo_id: int) -> tuple[int, bytes] | None:
    """Return address and data that a bulk write holds for a servo; None if there are none."""
    start = 0
    while start + 5 < len(parameters):
        address = int.from_bytes(parameters[start + 1 : start + 3], "little")
        end = start + 5 + int.from_bytes(parameters[start + 3 : start + 5], "little")
        if end > len(parameters):
            return None
        if parameters[start] == servo_id:
            return address, parameters[start + 5 : end]
        start = end
    return None
