"""A simulated servo: registers, instructions, motion."""

from __future__ import annotations

from dataclasses import replace
from random import Random

from head_tracking.dynamixel.models import AX_12, ServoModel
from head_tracking.dynamixel.protocol import BROADCAST_ID
from head_tracking.simulation.alarms import OVERLOAD_TIME
from head_tracking.simulation.exceptions import SimulationError
from head_tracking.simulation.instructions1 import Protocol1
from head_tracking.simulation.instructions2 import Protocol2
from head_tracking.simulation.protocol1 import DamagedPacket, InstructionPacket, StatusPacket
from head_tracking.simulation.protocol2 import DamagedPacket2, InstructionPacket2, StatusPacket2
from head_tracking.simulation.servo_body import Nature, ServoBody

Packet = InstructionPacket | InstructionPacket2
Damaged = DamagedPacket | DamagedPacket2
Status = StatusPacket | StatusPacket2


class SimulatedServo(ServoBody):
    """A servo of any model behind its protocol. Time is passed in, as integer ns that never fall.

    The shaft's true angle is known exactly as `true_position`, in rad, counter-clockwise, 0 at the
    middle of the range; `true_ticks` gives it in fractions of a tick, so that
    `JointConfiguration.position(servo.true_ticks)` is the joint's true position.

    Args:
        servo_id: Its id.
        model: Its model.
        position: Where the shaft stands at first, in ticks; None: in the middle.
        torque_on_write: Switch torque on when a goal or a moving speed is written, as servos with
            a Moving Speed are seen to do.
        supply_voltage: V; None: what the model is made for.
        ambient_temperature: Degrees Celsius.
        firmware: Version of the firmware.
        start_delay: Time from a goal to the begin of the motion, s; 17 to 50 ms were measured.
        position_noise: Standard deviation of the encoder, ticks.
        eeprom_time: Time the servo is deaf for each byte written to EEPROM, s; 6 ms were measured.
        boot_time: Time it is deaf after power-on and reboot, s.
        random: Draws the noise.

    Attributes:
        supply_voltage: V; may be changed at any time.
        alarms: Its error bits; to some, `alarms.forced`, others may add.
        oracle: What is told of every goal and speed that it takes.
    """

    def __init__(
        self,
        servo_id: int = 1,
        model: ServoModel = AX_12,
        *,
        position: float | None = None,
        torque_on_write: bool = True,
        supply_voltage: float | None = None,
        ambient_temperature: float = 25.0,
        firmware: int | None = None,
        start_delay: float = 0.0,
        position_noise: float = 0.0,
        eeprom_time: float = 0.0,
        boot_time: float = 0.3,
        random: Random | None = None,
    ) -> None:
        ticks = float(model.center) if position is None else position
        if not 0.0 <= ticks <= model.ticks - 1:
            raise SimulationError(
                f"servo {servo_id} cannot stand at tick {position}; allowed are 0 to "
                f"{model.ticks - 1}"
            )
        nature = Nature(
            torque_on_write=torque_on_write,
            ambient_temperature=ambient_temperature,
            firmware=firmware,
            start_delay=start_delay,
            position_noise=position_noise,
            eeprom_time=eeprom_time,
            boot_time=boot_time,
        )
        volts = model.nominal_voltage if supply_voltage is None else supply_voltage
        super().__init__(servo_id, model, ticks, volts, nature, random or Random(servo_id))
        self._dialect = Protocol1() if model.protocol == 1 else Protocol2()

    # What a test or a simulation may look at and do

    @property
    def true_velocity(self) -> float:
        """Speed of the shaft, rad/s, counter-clockwise."""
        return self._drive.shaft.speed

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
        return self._drive.shaft.mechanics.inertia

    @inertia.setter
    def inertia(self, inertia: float) -> None:
        shaft = self._drive.shaft
        shaft.mechanics = replace(shaft.mechanics, inertia=inertia)

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
        way = self._controls.ticks(self._memory, 1.0) - self._controls.ticks(self._memory, 0.0)
        angle = self.true_position + (ticks - self.true_ticks) / way
        self._drive.lead(angle, duration, strength)

    def overload(self) -> None:
        """Let the servo find that it has not been able to move its load for too long."""
        self._drive.strain = 2 * OVERLOAD_TIME
        self._look()

    def power_off(self) -> None:
        """Take the supply away: torque goes, nothing is answered, RAM is lost."""
        self._powered = False
        self._memory["Torque Enable"] = 0
        self._configure()

    def power_on(self) -> None:
        """Bring the supply back."""
        self._powered = True
        self._start()

    # Packets

    def hears(self, now: int) -> bool:
        """Return whether a packet that comes now reaches it, and take note that one came."""
        if not self._powered or now < self._deaf_until:
            return False
        self._heard = now
        return True

    def execute(self, packet: Packet, now: int) -> Status | None:
        """Carry out an instruction if it is for this servo; return its answer, if it gives one."""
        if packet.id not in (self.id, BROADCAST_ID, self._second_id) or not self.hears(now):
            return None
        self.advance(now)
        if isinstance(packet, InstructionPacket):
            if isinstance(self._dialect, Protocol1):
                return self._dialect.execute(self, packet)
        elif isinstance(self._dialect, Protocol2):
            return self._dialect.execute(self, packet)
        return None

    def complain(self, packet: Damaged, now: int) -> Status | None:
        """Return the answer to a packet with a wrong checksum, if it is for this servo."""
        if packet.id != self.id or not self.hears(now):
            return None
        self.advance(now)
        if isinstance(packet, DamagedPacket):
            if isinstance(self._dialect, Protocol1):
                return self._dialect.complain(self, packet)
        elif isinstance(self._dialect, Protocol2):
            return self._dialect.complain(self, packet)
        return None

    def answer_ping(self, now: int) -> StatusPacket2 | None:
        """Return the answer to a ping of all (protocol 2.0)."""
        if not isinstance(self._dialect, Protocol2) or not self.hears(now):
            return None
        self.advance(now)
        return self._dialect.ping(self)

    def answer_read(self, address: int, length: int, now: int) -> Status | None:
        """Return the answer to a share of a sync or bulk read, if it gives one."""
        if not self.hears(now) or self.status_return_level < 1:
            return None
        self.advance(now)
        return self._dialect.read(self, address, length)
