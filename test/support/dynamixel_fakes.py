"""A port and clocks for tests of the bus: exact packets, no waiting."""

from __future__ import annotations

import math
from collections import defaultdict, deque
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from typing import TypeVar

from head_tracking.dynamixel import (
    Adapter,
    BusEvent,
    BusReading,
    BusSettings,
    CommunicationError,
    EventKind,
    Goal,
    JointConfiguration,
    PortLostError,
    ReplyTimeoutError,
    ServoBus,
    Torque,
    servo_model,
)
from head_tracking.dynamixel.exceptions import NotConnectedError, PortMissingError
from head_tracking.dynamixel.protocol import Status
from head_tracking.dynamixel.reading import ReadGroup
from head_tracking.dynamixel.requests import Steps

T = TypeVar("T")

AX_12 = servo_model("AX-12")
TABLE = AX_12.control_table
GOAL, SPEED, TORQUE = 30, 32, 24

PAN = JointConfiguration("head_pan_joint", 1, controller="head_pan_controller")
TILT = JointConfiguration("head_tilt_joint", 2, controller="head_tilt_controller", min=300, max=800)

Packet = tuple[object, ...]


class FakeServo:
    """Registers of an AX-12, and whether it answers. A goal switches its torque on, too.

    Args:
        servo_id: Its id.
    """

    def __init__(self, servo_id: int) -> None:
        self.bytes = bytearray(max(register.end for register in TABLE))
        for register in TABLE:
            self[register.name] = register.initial or 0
        self["ID"] = servo_id
        self["Firmware Version"] = 24
        self["Goal Position"] = 900  # an old goal that nobody wants any more
        self["Present Position"] = AX_12.center
        self["Present Voltage"] = 120
        self["Present Temperature"] = 30
        self["Torque Limit"] = 1023
        self.answers = True
        self.error = 0
        self.ignored: set[int] = set()  # addresses whose writes have no effect

    def __getitem__(self, name: str) -> int:
        block = TABLE.block(name)
        return block.layout.unpack_from(self.bytes, block.address)[0]

    def __setitem__(self, name: str, value: int) -> None:
        block = TABLE.block(name)
        block.layout.pack_into(self.bytes, block.address, value)

    def write(self, address: int, data: bytes) -> None:
        if address in self.ignored:
            return
        self.bytes[address : address + len(data)] = data
        if address in (GOAL, SPEED):
            self["Torque Enable"] = 1


class FakePort:
    """Takes the place of a `DynamixelPort` and keeps a log of all packets.

    Attributes:
        log: ("ping", id), ("read", id, address, length), ("write", id, address, bytes) and
            ("sync", address, {id: bytes}), in order.
        failures: Exceptions to raise for the next transactions with an id, None for none.
        gone: Whether the adapter has been unplugged.
        may_return: Whether it may be found again.
    """

    name = "/dev/fake"
    baud_rate = 1_000_000
    adapter = Adapter()

    def __init__(self, *ids: int) -> None:
        self.servos = {servo_id: FakeServo(servo_id) for servo_id in ids or (1, 2)}
        self.log: list[Packet] = []
        self.failures: dict[int, deque[Exception | None]] = defaultdict(deque)
        self.gone = self.opened = False
        self.may_return = True

    def back_off(self) -> None:
        """Nothing is late here."""

    def clock(self) -> float:
        return 0.0

    @property
    def is_open(self) -> bool:
        return self.opened

    def open(self) -> None:
        if self.gone:
            raise PortMissingError(self.name, [])
        self.opened = True

    def close(self) -> None:
        self.opened = False

    def ping(self, servo_id: int, protocol: int = 1) -> int:
        return self._servo(("ping", servo_id), servo_id).error

    def read(self, servo_id: int, address: int, length: int, protocol: int = 1) -> Status:
        servo = self._servo(("read", servo_id, address, length), servo_id)
        if servo["Status Return Level"] < 1:
            raise ReplyTimeoutError("silent")
        return Status(servo_id, servo.error, bytes(servo.bytes[address : address + length]))

    def read_group(self, group: ReadGroup) -> list[Status | CommunicationError]:
        replies: list[Status | CommunicationError] = []
        for servo_id in group.ids:
            try:
                replies.append(self.read(servo_id, group.address, group.length))
            except CommunicationError as failure:
                replies.append(failure)
        return replies

    def write(
        self,
        servo_id: int,
        address: int,
        data: bytes,
        *,
        acknowledged: bool = True,
        protocol: int = 1,
    ) -> int:
        packet = ("write", servo_id, address, data)
        if not acknowledged:
            self._note(packet)
            self.servos[servo_id].write(address, data)
            return 0
        servo = self._servo(packet, servo_id)
        servo.write(address, data)
        if servo["Status Return Level"] < 2:
            raise ReplyTimeoutError("silent")
        return servo.error

    def sync_write(
        self, address: int, data: Mapping[int, bytes], protocol: int = 1, *, patience: float = 0.0
    ) -> None:
        self._note(("sync", address, dict(data)))
        for servo_id, share in data.items():
            if servo_id in self.servos:
                self.servos[servo_id].write(address, share)

    def take_log(self) -> list[Packet]:
        log, self.log = self.log, []
        return log

    def _note(self, packet: Packet) -> None:
        if not self.opened:
            raise NotConnectedError(self.name)
        if self.gone:
            self.opened = False
            raise PortLostError(self.name, "unplugged")
        self.log.append(packet)

    def _servo(self, packet: Packet, servo_id: int) -> FakeServo:
        self._note(packet)
        if self.failures[servo_id]:
            failure = self.failures[servo_id].popleft()
            if failure is not None:
                raise failure
        servo = self.servos.get(servo_id)
        if servo is None or not servo.answers:
            raise ReplyTimeoutError(f"servo {servo_id} did not answer")
        return servo


class FakeClock:
    """Time that passes only when told to, plus `tick` per look, ns."""

    def __init__(self, tick: int = 0) -> None:
        self.now = 1_000_000_000
        self.tick = tick

    def __call__(self) -> int:
        self.now += self.tick
        return self.now

    def pass_time(self, seconds: float) -> None:
        self.now += round(seconds * 1e9)


class FakeRig:
    """A connected bus of joints on a fake port, in a time that passes when it is asked for.

    Args:
        joints: by default pan and tilt.
        settings: of the bus.
        tick: that passes with each look at the clock [ns].
        connect: whether the bus is connected.

    Attributes:
        at: when something happens while the bus waits [ns], and what.
    """

    def __init__(
        self,
        *joints: JointConfiguration,
        settings: BusSettings | None = None,
        tick: int = 0,
        connect: bool = True,
    ) -> None:
        self.port, self.clock = FakePort(), FakeClock(tick)
        self.at: tuple[float, Callable[[], object]] = (math.inf, lambda: None)
        self.bus = ServoBus(
            self.port,  # type: ignore[arg-type]
            joints or (PAN, TILT),
            self.clock,
            monotonic=self.clock,
            settings=settings,
            pause=self._pause,
        )
        if connect:
            self.connect()

    def connect(self) -> None:
        self.bus.connect()
        self.port.take_log()

    def _pause(self, seconds: float) -> None:
        self.clock.pass_time(seconds)
        if self.clock.now > self.at[0]:
            self.at[1]()

    def step(self, count: int = 1) -> BusReading:
        """Run cycles of 20 ms; return the last reading."""
        self.passed: list[BusEvent] = []
        for _ in range(count):
            self.clock.pass_time(0.02)
            reading = self.bus.step()
            self.passed += reading.events
        return reading

    def events(self, count: int = 1) -> list[EventKind]:
        """Return what cycles report; a fake servo never moves, which is no matter here."""
        self.step(count)
        return [event.kind for event in self.passed if event.kind is not EventKind.SYMPTOM]

    def switched_on(self, position: float = 0.2) -> FakeRig:
        self.bus.command({"head_pan_joint": Goal(position)})
        self.step()
        self.port.take_log()
        return self

    @property
    def pan(self) -> FakeServo:
        return self.port.servos[1]

    @property
    def tilt(self) -> FakeServo:
        return self.port.servos[2]

    @property
    def lost(self) -> list[str]:
        """The joints of which no servo answers."""
        return [each.joint_name for each in self.bus.joints if self.bus.joint(each.joint_name).lost]

    @property
    def torque(self) -> list[int]:
        return [servo["Torque Enable"] for servo in (self.pan, self.tilt)]

    @property
    def pan_torque(self) -> Torque:
        return self.bus.joint("head_pan_joint").torque


def speed_ticks(joint: JointConfiguration, speed: float) -> int:
    """The register value of a goal speed, rad/s."""
    unit = joint.model.speed_unit
    return max(1, min(round(speed / unit), int(joint.speed_limit / unit)))


def goal_bytes(ticks: int, speed: int) -> bytes:
    return ticks.to_bytes(2, "little") + speed.to_bytes(2, "little")


def writes(log: list[Packet]) -> list[Packet]:
    return [packet for packet in log if packet[0] in ("write", "sync")]


def submit(bus: ServoBus, steps: Steps[T]) -> Future[T]:
    """Ask a bus for what takes steps, as another thread does, and let it take the first one."""
    future: Future[T] = bus.requests.add(lambda: steps)
    bus.requests.begin_next()
    return future
