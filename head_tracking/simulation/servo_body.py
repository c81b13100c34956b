"""The body of a simulated servo: registers, motion and errors, whatever the protocol."""

from __future__ import annotations

from dataclasses import dataclass
from random import Random
from typing import Final

from head_tracking.dynamixel.control_table import Memory
from head_tracking.dynamixel.models import ServoModel
from head_tracking.simulation.alarms import OVERLOAD_TIME, Alarms
from head_tracking.simulation.controls import Controls, JointControls
from head_tracking.simulation.drive import Drive
from head_tracking.simulation.memory import Change, Refusal, RegisterMemory
from head_tracking.simulation.oracle import Oracle
from head_tracking.simulation.x_controls import WATCHDOG_TRIPPED, XControls

_FIRMWARE: Final = {1: 24, 2: 50}
_WATCHDOG_UNIT: Final = 20_000_000  # ns
_LOOK: Final = 20_000_000  # ns between looks for errors while something moves


@dataclass(frozen=True, slots=True)
class Nature:
    """What differs between servos of one model; see `SimulatedServo`.

    Attributes:
        torque_on_write: Switch torque on when a goal or a moving speed is written.
        ambient_temperature: Degrees Celsius.
        firmware: Version of the firmware; None: a recent one.
        start_delay: Time from a goal to the begin of the motion, s.
        position_noise: Standard deviation of the encoder, ticks.
        eeprom_time: Time the servo is deaf for each byte written to EEPROM, s.
        boot_time: Time it is deaf after power-on and reboot, s.
    """

    torque_on_write: bool = True
    ambient_temperature: float = 25.0
    firmware: int | None = None
    start_delay: float = 0.0
    position_noise: float = 0.0
    eeprom_time: float = 0.0
    boot_time: float = 0.3


class ServoBody:
    """Registers, motion and errors. Time is passed in, as integer ns that never fall.

    Args:
        servo_id: Its id.
        model: Its model.
        ticks: Where the shaft stands at first.
        supply_voltage: V.
        nature: What is special about it.
        random: Draws the noise.

    Attributes:
        model: Its model.
        supply_voltage: V; may be changed at any time.
        alarms: Its error bits; to some, `alarms.forced`, others may add.
        oracle: What is told of every goal and speed that it takes.
    """

    def __init__(
        self,
        servo_id: int,
        model: ServoModel,
        ticks: float,
        supply_voltage: float,
        nature: Nature,
        random: Random,
    ) -> None:
        self.model = model
        self.supply_voltage = supply_voltage
        self.alarms = Alarms(model)
        self.oracle: Oracle | None = None
        self._nature = nature
        self._random = random
        self._memory = RegisterMemory(model.control_table, whole=model.protocol == 2)
        self._controls: Controls = (
            JointControls(model) if model.sign_magnitude else XControls(model)
        )
        self._waiting: tuple[int, bytes] | None = None
        self._powered = True
        self._now = self._heard = self._deaf_until = 0
        self._memory["Firmware Version"] = nature.firmware or _FIRMWARE[model.protocol]
        self._memory["ID"] = servo_id
        self._controls.start(self._memory, ticks)
        self._drive = Drive(
            model,
            (ticks - model.center) * model.radians_per_tick,
            self._controls.settings(self._memory),
            nature.ambient_temperature,
            round(nature.start_delay * 1e9),
        )

    @property
    def id(self) -> int:
        """The id it answers to."""
        return self._memory["ID"]

    @property
    def true_ticks(self) -> float:
        """Angle of the shaft in ticks as the servo counts them; not quantised."""
        return self._controls.ticks(self._memory, self._drive.shaft.angle)

    @property
    def return_delay(self) -> int:
        """Time between an instruction and the answer, ns."""
        return self._memory["Return Delay Time"] * 2_000

    @property
    def baud_rate(self) -> int:
        """Bits per second at which it listens and talks."""
        code = self._memory["Baud Rate"]
        return self.model.baud_rates.get(code) or 2_000_000 // (code + 1)

    @property
    def status_return_level(self) -> int:
        """What it answers: 0 pings, 1 reads too, 2 everything."""
        return self._memory["Status Return Level"]

    @property
    def at_rest(self) -> bool:
        """Whether nothing will move until somebody does something."""
        return self._drive.at_rest and not self._is_watched

    @property
    def command(self) -> tuple[int, int, bool]:
        """Goal Position, speed for it (Goal Velocity in velocity mode), and torque."""
        memory = self._memory
        if "Moving Speed" in memory:
            speed = memory["Moving Speed"]
        else:
            velocity_mode = memory["Operating Mode"] == 1
            speed = memory["Goal Velocity" if velocity_mode else "Profile Velocity"]
        return memory["Goal Position"], speed, bool(memory["Torque Enable"])

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
        self.model.control_table[name].bytes_of(value)
        self._memory[name] = value
        self._configure()

    @property
    def true_position(self) -> float:
        """Angle of the shaft, rad, counter-clockwise, 0 in the middle; not quantised."""
        return self._drive.shaft.angle

    def advance(self, now: int) -> None:
        """Let time pass up to `now`, ns; time at rest costs nothing."""
        voltage = self.supply_voltage / self.model.nominal_voltage
        while self._now + _LOOK < now and self._needs_looks:
            self._now += _LOOK
            self._drive.advance(self._now, voltage)
            self._look()
        self._now = max(self._now, now)
        self._drive.advance(now, voltage)
        self._look()
        if isinstance(self._controls, XControls) and self._watchdog_trips:
            self._controls.hold(self._memory, self._drive)
            self._configure()

    # What instructions do

    def read(self, address: int, length: int) -> bytes | None:
        """Return registers, or None when some of the bytes are behind the table."""
        self._refresh()
        return self._memory.read(address, length)

    def write(self, address: int, data: bytes) -> Refusal | None:
        """Write registers, or return why not."""
        changes = self._permitted(address, data)
        if isinstance(changes, Refusal):
            return changes
        memory = self._memory
        before = {register.name: memory[register.name] for register, _ in changes}
        for register, value in changes:
            memory[register.name] = value
        if self._nature.torque_on_write and self._controls.stiffens(memory, before):
            before.setdefault("Torque Enable", memory["Torque Enable"])
            memory["Torque Enable"] = 1
        if before.get("Torque Limit") == 0 and memory["Torque Limit"]:
            self.alarms.clear()
            self._drive.strain = 0
        if any(memory[name] != value for name, value in before.items()):
            self._controls.written(memory, before, self._drive)
            self._configure()
        slow = sum(register.size for register, _ in changes if register.memory is Memory.EEPROM)
        if slow:
            self._be_deaf(slow * self._nature.eeprom_time)
        if self.oracle is not None:
            self.oracle.note(self._now, self, before)
        return None

    def keep(self, address: int, data: bytes) -> Refusal | None:
        """Keep a write for `act`, or return why not."""
        changes = self._permitted(address, data)
        if isinstance(changes, Refusal):
            return changes
        self._waiting = (address, data)
        self._set_registered(1)
        return None

    def act(self) -> bool:
        """Carry out the write that was kept; return whether there is one."""
        if self._waiting is None:
            return False
        waiting, self._waiting = self._waiting, None
        self._set_registered(0)
        self.write(*waiting)
        return True

    def reset(self, *but: str) -> None:
        """Set the EEPROM to the factory's values, but for some registers."""
        self._memory.load_initial_values(Memory.EEPROM, but=but)
        if self.model.protocol == 2:
            self.reboot()
        self._configure()

    def reboot(self) -> None:
        """Start anew: RAM as at power-on, torque off, errors forgotten."""
        self._start()

    def clear_turns(self) -> bool:
        """Count the position within one turn; return False while the shaft turns."""
        if self._drive.shaft.speed != 0.0 or not isinstance(self._controls, XControls):
            return False
        self._controls.fold(self._memory, self._drive)
        return True

    def _permitted(self, address: int, data: bytes) -> list[Change] | Refusal:
        memory = self._memory
        changes = memory.changes(address, data)
        if isinstance(changes, Refusal):
            return changes
        for register, value in changes:
            refusal = self._controls.refusal(memory, register, value)
            if refusal:
                return refusal
        return changes

    def _set_registered(self, value: int) -> None:
        for name in ("Registered", "Registered Instruction"):
            if name in self._memory:
                self._memory[name] = value

    @property
    def _second_id(self) -> int | None:
        return self._memory.get("Secondary ID")

    @property
    def _is_watched(self) -> bool:
        armed = 0 < self._memory.get("Bus Watchdog", 0) < WATCHDOG_TRIPPED
        return armed and bool(self._memory["Torque Enable"])

    @property
    def _needs_looks(self) -> bool:
        """Whether an error may come up by itself before long."""
        return not self._drive.at_rest or 0 < self._drive.strain <= OVERLOAD_TIME

    @property
    def _watchdog_trips(self) -> bool:
        patience = self._memory.get("Bus Watchdog", 0) * _WATCHDOG_UNIT
        return self._is_watched and self._now - self._heard > patience

    def _start(self) -> None:
        memory = self._memory
        memory.load_initial_values(Memory.RAM)
        if isinstance(self._controls, XControls):
            self._controls.fold(memory, self._drive)
        self._controls.start(memory, self.true_ticks)
        self._waiting = None
        self._drive.strain = 0
        self.alarms.clear()
        self._be_deaf(self._nature.boot_time)
        self._configure()

    def _look(self) -> None:
        """Look for errors, and shut down if one of them is to do so."""
        if not self._powered:
            return
        memory = self._memory
        celsius = self._drive.temperature.celsius
        fatal = self.alarms.look(memory, self.supply_voltage, celsius, self._drive.strain)
        if fatal and self._controls.shut_down(memory):
            self._configure()
        if "Hardware Error Status" in memory:
            memory["Hardware Error Status"] = self.alarms.active

    def _refresh(self) -> None:
        """Write what the servo measures into its registers."""
        memory, deviation = self._memory, self._nature.position_noise
        noise = self._random.gauss(0.0, deviation) if deviation else 0.0
        self._controls.refresh(memory, self._drive, noise)
        volts = max(0, min(255, round(self.supply_voltage * 10.0)))
        wide = "Present Input Voltage" in memory
        memory["Present Input Voltage" if wide else "Present Voltage"] = volts
        memory["Present Temperature"] = max(0, min(255, round(self._drive.temperature.celsius)))
        if "Realtime Tick" in memory:
            memory["Realtime Tick"] = self._now // 1_000_000 % 32_768

    def _configure(self) -> None:
        self._drive.configure(self._controls.settings(self._memory))

    def _be_deaf(self, seconds: float) -> None:
        self._deaf_until = max(self._deaf_until, self._now + round(seconds * 1e9))
