"""A simulated servo: registers, instructions, motion."""

from __future__ import annotations

from typing import Final

from head_tracking.dynamixel.control_table import Memory
from head_tracking.dynamixel.conversions import encode_sign_magnitude, encode_unsigned
from head_tracking.dynamixel.models import AX_12, ServoModel
from head_tracking.dynamixel.protocol1 import BROADCAST_ID, NO_ERROR, ErrorBits, Instruction
from head_tracking.simulation.drive import Drive, DriveSettings
from head_tracking.simulation.exceptions import SimulationError
from head_tracking.simulation.memory import RegisterMemory
from head_tracking.simulation.protocol1 import DamagedPacket, InstructionPacket, StatusPacket

_FIRMWARE: Final = 24
_STIFFENING: Final = ("Goal Position", "Moving Speed")


class SimulatedServo:
    """An AX servo behind protocol 1.0. Time is passed in, as integer ns that never fall.

    The shaft's true angle is known exactly as `true_position`, in rad, counter-clockwise, 0 at
    tick 512; `true_ticks` gives it in fractions of a tick, so that
    `JointConfiguration.position(servo.true_ticks)` is the joint's true position.

    Args:
        servo_id: Its id.
        model: Its model.
        position: Where the shaft stands at first, in ticks.
        torque_on_write: Switch torque on when a goal or a moving speed is written, as AX servos
            are seen to do.
        supply_voltage: V.
        ambient_temperature: Degrees Celsius.

    Attributes:
        supply_voltage: V; may be changed at any time.
    """

    def __init__(
        self,
        servo_id: int = 1,
        model: ServoModel = AX_12,
        *,
        position: float = 512.0,
        torque_on_write: bool = True,
        supply_voltage: float = 12.0,
        ambient_temperature: float = 25.0,
    ) -> None:
        if not 0.0 <= position <= model.ticks - 1:
            raise SimulationError(
                f"servo {servo_id} cannot stand at tick {position}; allowed are 0 to "
                f"{model.ticks - 1}"
            )
        self.model = model
        self.supply_voltage = supply_voltage
        self._torque_on_write = torque_on_write
        self._memory = RegisterMemory(model.control_table)
        self._waiting: tuple[int, bytes] | None = None
        self._memory["Firmware Version"] = _FIRMWARE
        self._memory["ID"] = servo_id
        self._memory["Goal Position"] = round(position)
        self._memory["Torque Limit"] = self._memory["Max Torque"]
        settings = DriveSettings.of(self._memory, model)
        self._drive = Drive(model, self._angle(position), settings, ambient_temperature)

    # What a test or a simulation may look at and do

    @property
    def id(self) -> int:
        """The id it answers to."""
        return self._memory["ID"]

    @property
    def true_position(self) -> float:
        """Angle of the shaft, rad, counter-clockwise, 0 at tick 512; not quantised."""
        return self._drive.shaft.angle

    @property
    def true_ticks(self) -> float:
        """Angle of the shaft in ticks; not quantised."""
        return self.model.center + self._drive.shaft.angle / self.model.radians_per_tick

    @property
    def true_velocity(self) -> float:
        """Speed of the shaft, rad/s, counter-clockwise."""
        return self._drive.shaft.speed

    @property
    def temperature(self) -> float:
        """Degrees Celsius."""
        return self._drive.temperature.celsius

    @property
    def return_delay(self) -> int:
        """Time between an instruction and the answer, ns."""
        return self._memory["Return Delay Time"] * 2_000

    @property
    def at_rest(self) -> bool:
        """Whether nothing will move until somebody does something."""
        return self._drive.at_rest

    def register(self, name: str) -> int:
        """Return a register as a read would find it; raises UnknownRegisterError."""
        self._refresh()
        return self._memory[self.model.control_table[name].name]

    def set_register(self, name: str, value: int) -> None:
        """Set a register as the servo's former owner left it: no check, no torque.

        Raises:
            UnknownRegisterError: There is no such register.
            RangeError: The value does not fit into its bytes.
        """
        register = self.model.control_table[name]
        encode_unsigned(value, register.size)
        self._memory[name] = value
        self._configure()

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
        self._drive.lead(self._angle(ticks), duration, strength)

    def advance(self, now: int) -> None:
        """Let time pass up to `now`, ns; time at rest costs nothing."""
        self._drive.advance(now, self.supply_voltage / self.model.nominal_voltage)

    # Instructions

    def execute(self, packet: InstructionPacket, now: int) -> StatusPacket | None:
        """Carry out an instruction if it is for this servo; return its answer, if it gives one."""
        servo_id = self.id  # the answer to a change of the id still carries the old one
        broadcast = packet.id == BROADCAST_ID
        if packet.id != servo_id and not broadcast:
            return None
        self.advance(now)
        error, data = self._dispatch(packet, broadcast)
        if broadcast or not self._answers(packet.instruction):
            return None
        return StatusPacket(servo_id, error | self._alarms(), data)

    def complain(self, packet: DamagedPacket, now: int) -> StatusPacket | None:
        """Return the answer to a packet with a wrong checksum, if it is for this servo."""
        if packet.id != self.id or self._memory["Status Return Level"] < 2:
            return None
        self.advance(now)
        return StatusPacket(self.id, ErrorBits.CHECKSUM | self._alarms())

    def _answers(self, instruction: int) -> bool:
        level = self._memory["Status Return Level"]
        if instruction == Instruction.PING:
            return True
        return level >= (1 if instruction == Instruction.READ else 2)

    def _dispatch(self, packet: InstructionPacket, broadcast: bool) -> tuple[ErrorBits, bytes]:
        parameters = packet.parameters
        match packet.instruction:
            case Instruction.PING:
                return NO_ERROR, b""
            case Instruction.READ if len(parameters) == 2 and not broadcast:
                self._refresh()
                data = self._memory.read(*parameters)
                return (ErrorBits.RANGE, b"") if data is None else (NO_ERROR, data)
            case Instruction.WRITE if parameters:
                return self._write(parameters[0], parameters[1:]), b""
            case Instruction.REG_WRITE if parameters:
                return self._keep(parameters[0], parameters[1:]), b""
            case Instruction.ACTION:
                return self._act(), b""
            case Instruction.FACTORY_RESET:
                self._memory.load_initial_values(Memory.EEPROM)
                self._configure()
                return NO_ERROR, b""
            case Instruction.SYNC_WRITE if broadcast:
                share = packet.sync_write_share(self.id)
                return NO_ERROR if share is None else self._write(*share), b""
        return ErrorBits.INSTRUCTION, b""

    def _check(self, address: int, data: bytes) -> ErrorBits:
        memory = self._memory
        error = memory.check(address, data)
        if error:
            return error
        for register in memory.touched(address, len(data)):
            value = memory.value_after(register, address, data)
            if register.name == "Lock" and value < memory["Lock"]:
                return ErrorBits.RANGE  # only a power cycle unlocks
            if memory["CW Angle Limit"] == memory["CCW Angle Limit"] == 0:
                continue  # wheel mode
            if register.name == "Moving Speed" and value > self.model.speed_maximum:
                return ErrorBits.RANGE
            if register.name == "Goal Position" and not (
                memory["CW Angle Limit"] <= value <= memory["CCW Angle Limit"]
            ):
                return ErrorBits.ANGLE_LIMIT
        return NO_ERROR

    def _write(self, address: int, data: bytes) -> ErrorBits:
        error = self._check(address, data)
        if error:
            return error
        memory = self._memory
        changed = memory.write(address, data)
        names = [register.name for register in memory.touched(address, len(data))]
        if self._torque_on_write and any(name in _STIFFENING for name in names):
            changed |= not memory["Torque Enable"]
            memory["Torque Enable"] = 1
        if changed:
            self._configure()
        return NO_ERROR

    def _keep(self, address: int, data: bytes) -> ErrorBits:
        error = self._check(address, data)
        if not error:
            self._waiting = (address, data)
            self._memory["Registered"] = 1
        return error

    def _act(self) -> ErrorBits:
        if self._waiting is None:
            return ErrorBits.INSTRUCTION
        address, data = self._waiting
        self._waiting = None
        self._memory["Registered"] = 0
        return self._write(address, data)

    def _alarms(self) -> ErrorBits:
        """Return the state bits, and shut down if one of them is to do so."""
        memory = self._memory
        alarms = NO_ERROR
        voltage = round(self.supply_voltage * 10.0)
        if not memory["Min Voltage Limit"] <= voltage <= memory["Max Voltage Limit"]:
            alarms |= ErrorBits.INPUT_VOLTAGE
        if self._drive.temperature.celsius > memory["Temperature Limit"]:
            alarms |= ErrorBits.OVERHEATING
        if alarms & memory["Shutdown"] and memory["Torque Limit"]:
            memory["Torque Limit"] = 0
            self._configure()
        return alarms

    # Registers that the servo itself writes

    @property
    def _present_ticks(self) -> int:
        return max(0, min(self.model.ticks - 1, round(self.true_ticks)))

    def _refresh(self) -> None:
        memory, model = self._memory, self.model
        speed = round(self._drive.shaft.speed / model.speed_unit)
        load = round(self._drive.output * model.load_maximum)
        memory["Present Position"] = self._present_ticks
        memory["Present Speed"] = encode_sign_magnitude(max(-1023, min(1023, speed)))
        memory["Present Load"] = encode_sign_magnitude(load)
        memory["Present Voltage"] = max(0, min(255, round(self.supply_voltage * 10.0)))
        memory["Present Temperature"] = max(0, min(255, round(self._drive.temperature.celsius)))
        memory["Moving"] = int(self._drive.moving)

    def _angle(self, ticks: float) -> float:
        return (ticks - self.model.center) * self.model.radians_per_tick

    def _configure(self) -> None:
        self._drive.configure(DriveSettings.of(self._memory, self.model))
