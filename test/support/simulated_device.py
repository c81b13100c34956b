"""A driver's port on a simulated bus in simulated time: no pty, no thread, no waiting."""

import io
from collections.abc import Callable, Iterable
from typing import Any

from head_tracking.dynamixel import (
    Adapter,
    BusEvent,
    BusReading,
    BusSettings,
    DynamixelPort,
    Epoch,
    EventKind,
    Goal,
    JointConfiguration,
    ServoBus,
    ServoModel,
    servo_model,
)
from head_tracking.dynamixel.exceptions import PortMissingError, ServoError
from head_tracking.simulation import (
    Answer,
    SimulatedBus,
    SimulatedClock,
    SimulatedLine,
    SimulatedServo,
)

PERIOD = 0.02  # s, of a cycle


def as_device(line: Any) -> Any:
    """Return a line that takes the place of an open serial device."""
    line.adapter = Adapter()
    return line


class OnAnswers:
    """Fault injection that passes every answer through a function; requests arrive as sent."""

    def __init__(self, answer: Callable[[Answer], Iterable[Answer]]) -> None:
        self.answer = answer

    def request(self, bus: SimulatedBus, data: bytes, now: int) -> tuple[bytes, list[Answer]]:
        return data, []


class Keyboard(io.StringIO):
    """A terminal with prepared answers."""

    def isatty(self) -> bool:
        return True


def joint_of(
    servo_id: int, model: ServoModel, low: int = 0, high: int | None = None
) -> JointConfiguration:
    """Return a joint with this servo and these limits, in ticks; by default its whole range."""
    high = model.ticks - 1 if high is None else high
    return JointConfiguration(
        f"j{servo_id}", servo_id, model.center, low, high, controller=f"c{servo_id}", model=model
    )


class Bench:
    """Servos and the port that they are on."""

    def __init__(
        self,
        servos: SimulatedBus | Iterable[SimulatedServo],  # the servos, or a bus
        baud_rate: int = 1_000_000,  # of line and port [bit/s]
        latency: float = 0.0,  # of the adapter [s]
        # of the port [s]; None: it learns how long replies take
        reply_timeout: float | None = None,
        tick: int = 1,  # of the clock of stamps [ns], such as the period of /clock
    ) -> None:
        self.bus = servos if isinstance(servos, SimulatedBus) else SimulatedBus(servos)
        self.clock = SimulatedClock(1_000_000_000)
        self.line = SimulatedLine(self.bus, self.clock, baud_rate, latency=latency)
        self.device: Any = self.line  # what the port opens
        self._reply_timeout, self._tick = reply_timeout, tick
        self.port = self.make_port("simulated", baud_rate)

    def __getitem__(self, servo_id: int) -> SimulatedServo:
        return self.bus[servo_id]

    def make_port(self, name: str, baud_rate: int) -> DynamixelPort:
        """Return a closed port on the line."""
        return DynamixelPort(
            name,
            baud_rate,
            reply_timeout=self._reply_timeout,
            open_device=self.open_device,
            clock=self.clock,
        )

    def open_device(self, name: str, baud_rate: int) -> Any:
        if not self.line.plugged:
            raise PortMissingError(name, ())
        return as_device(self.device)

    def servo_bus(
        self,
        joints: Iterable[JointConfiguration],
        epoch: Epoch | None = None,
        settings: BusSettings | None = None,
    ) -> ServoBus:
        return ServoBus(
            self.port,
            joints,
            lambda: self.now() // self._tick * self._tick,
            monotonic=self.now,
            pause=self.pass_time,
            epoch=epoch,
            settings=settings,
        )

    def accepts(self, joints: Iterable[JointConfiguration]) -> bool:
        """Connect to joints, and close; return whether their servos are set up as they need."""
        bus = self.servo_bus(joints)
        try:
            bus.connect()
        except ServoError:
            return False
        bus.close()
        return True

    def now(self) -> int:
        return self.clock.now

    def pass_time(self, seconds: float) -> None:
        self.clock.now += round(seconds * 1e9)
        self.bus.advance(self.clock.now)

    @property
    def torque(self) -> list[int]:
        return [servo.register("Torque Enable") for servo in self.bus]

    def turn_by_hand(self, servo_id: int, tick: float) -> None:
        """Lead a servo to a tick, and let it come to rest there."""
        self.bus.advance(self.clock.now)
        self.bus[servo_id].lead(tick, 0.5, 2.0)
        self.pass_time(2.0)


class Rig:
    """Servos, their bus, and simulated time.

    Attributes:
        reading: the last one.
        events: of all readings, without those that are repeated.
    """

    def __init__(
        self,
        *servos: SimulatedServo | SimulatedBus,  # the servos, or one simulated bus
        # of the bus; by default one for each id, with half the range of its servo
        joints: Iterable[JointConfiguration] = (),
        connect: bool = True,  # whether the bus is connected
        settings: BusSettings | None = None,  # of the bus
        **options: Any,  # of the `Bench`
    ) -> None:
        self.bench = Bench(servos[0] if isinstance(servos[0], SimulatedBus) else servos, **options)
        self.servos = tuple(self.bench.bus)
        models = {servo.id: servo_model(servo.model.name) for servo in self.servos}
        self.joints = tuple(joints) or tuple(
            joint_of(i, model, model.ticks // 4, 3 * model.ticks // 4)
            for i, model in models.items()
        )
        self.bus = self.bench.servo_bus(self.joints, settings=settings)
        self.events: list[BusEvent] = []
        if connect:
            self.bus.connect()
            self.step()

    def step(self, count: int = 1) -> BusReading:
        """Run cycles of 20 ms; return the last reading."""
        for _ in range(count):
            due = self.bench.now() + round(PERIOD * 1e9)
            while self.bus.cycle.fill(due):
                pass
            self.bench.clock.now = max(due, self.bench.now())
            self.reading = self.bus.step()
            self.events += [event for event in self.reading.events if not event.repeated]
        return self.reading

    def go(self, position: float, count: int = 60, speed: float = 3.0) -> BusReading:
        """Command the first joint in each of some cycles; return the last reading."""
        for _ in range(count):
            self.bus.command({self.joints[0].joint_name: Goal(position, speed)})
            self.step()
        return self.reading

    @property
    def kinds(self) -> list[EventKind]:
        return [event.kind for event in self.events]

    @property
    def torque(self) -> list[int]:
        return self.bench.torque
