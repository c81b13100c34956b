"""A port and clocks for tests of the bus: exact packets, no waiting."""

from __future__ import annotations

from collections import Counter, defaultdict, deque
from collections.abc import Mapping
from concurrent.futures import Future
from typing import TypeVar

from head_tracking.dynamixel import (
    Adapter,
    CommunicationError,
    JointConfiguration,
    PortLostError,
    ReplyTimeoutError,
    ServoBus,
    ServoModel,
    servo_model,
)
from head_tracking.dynamixel.exceptions import NotConnectedError, PortMissingError
from head_tracking.dynamixel.protocol import Status
from head_tracking.dynamixel.reading import ReadGroup
from head_tracking.dynamixel.requests import Steps

T = TypeVar("T")

AX_12 = servo_model("AX-12")
TABLE = AX_12.control_table
GOAL, SPEED, TORQUE, POSITION = 30, 32, 24, 36

PAN = JointConfiguration("head_pan_joint", 1, controller="head_pan_controller")
TILT = JointConfiguration("head_tilt_joint", 2, controller="head_tilt_controller", min=300, max=800)

Packet = tuple[object, ...]


class FakeServo:
    """Registers, and whether anybody answers. A goal switches torque on, as on a real AX.

    Args:
        servo_id: Its id.
        model: Its model.
    """

    def __init__(self, servo_id: int, model: ServoModel = AX_12) -> None:
        self.model = model
        self.bytes = bytearray(model.control_table.size)
        for register in model.control_table:
            self[register.name] = register.initial or 0
        self["ID"] = servo_id
        self["Firmware Version"] = 24 if model.protocol == 1 else 44
        self["Goal Position"] = model.center + 388  # an old goal that nobody wants any more
        self["Present Position"] = model.center
        for name in ("Present Voltage", "Present Input Voltage"):
            if name in model.control_table:
                self[name] = 120
        self["Present Temperature"] = 30
        if "Torque Limit" in model.control_table:
            self["Torque Limit"] = 1023
        self.answers = True
        self.error = 0
        self.ignored: set[int] = set()  # addresses whose writes have no effect
        self.reboots = 0

    def __getitem__(self, name: str) -> int:
        block = self.model.control_table.block(name)
        return block.layout.unpack_from(self.bytes, block.address)[0]

    def __setitem__(self, name: str, value: int) -> None:
        block = self.model.control_table.block(name)
        block.layout.pack_into(self.bytes, block.address, value)

    def write(self, address: int, data: bytes) -> None:
        if address in self.ignored:
            return
        self.bytes[address : address + len(data)] = data
        if self.model is AX_12 and address in (GOAL, SPEED):
            self["Torque Enable"] = 1

    def reboot(self) -> None:
        self.reboots += 1
        self.error = 0
        self["Torque Enable"] = 0
        self["Hardware Error Status"] = 0


class FakePort:
    """Takes the place of a `DynamixelPort` and keeps a log of all packets.

    Attributes:
        log: ("ping", id), ("read", id, address, length), ("write", id, address, bytes) and
            ("sync", address, {id: bytes}), in order.
        failures: Exceptions to raise for the next transactions with an id, None for none.
        gone: Whether the adapter has been unplugged.
        methods: How groups were read.
    """

    name = "/dev/fake"
    baud_rate = 1_000_000
    adapter = Adapter()

    def __init__(self, *ids: int, model: ServoModel = AX_12) -> None:
        self.surplus: Counter[int] = Counter()
        self.servos = {servo_id: FakeServo(servo_id, model) for servo_id in ids or (1, 2)}
        self.log: list[Packet] = []
        self.failures: dict[int, deque[Exception | None]] = defaultdict(deque)
        self.gone = False
        self.opened = False
        self.times_closed = 0
        self.times_tried = 0
        self.methods: list[tuple[object, ...]] = []
        self.may_return = True

    def back_off(self) -> None:
        """Nothing is late here."""

    def clock(self) -> float:
        return 0.0

    @property
    def is_open(self) -> bool:
        return self.opened

    def open(self) -> None:
        self.times_tried += 1
        if self.gone:
            raise PortMissingError(self.name, [])
        self.opened = True

    def close(self) -> None:
        self.opened = False
        self.times_closed += 1

    def ping(self, servo_id: int, protocol: int = 1) -> int:
        return self._servo(("ping", servo_id), servo_id, protocol).error

    def read(self, servo_id: int, address: int, length: int, protocol: int = 1) -> Status:
        servo = self._servo(("read", servo_id, address, length), servo_id, protocol)
        if servo["Status Return Level"] < 1:
            raise ReplyTimeoutError("silent")
        return Status(servo_id, servo.error, bytes(servo.bytes[address : address + length]))

    def read_group(self, group: ReadGroup) -> list[Status | CommunicationError]:
        self.methods.append((group.method, group.ids))
        return [self._ask(group, each) for each in group.ids]

    def _ask(self, group: ReadGroup, servo_id: int) -> Status | CommunicationError:
        try:
            reply = self.read(servo_id, group.address, group.length, group.protocol)
        except CommunicationError as failure:
            return failure
        return reply

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
            unheard = self.servos.get(servo_id)
            if unheard is not None:
                unheard.write(address, data)
            return 0
        servo = self._servo(packet, servo_id, protocol)
        servo.write(address, data)
        if servo["Status Return Level"] < 2:
            raise ReplyTimeoutError("silent")
        return servo.error

    def sync_write(
        self, address: int, data: Mapping[int, bytes], protocol: int = 1, *, patience: float = 0.0
    ) -> None:
        self._note(("sync", address, dict(data)))
        for servo_id, share in data.items():
            if servo_id in self.servos and self.servos[servo_id].model.protocol == protocol:
                self.servos[servo_id].write(address, share)

    def reboot(self, servo_id: int, protocol: int = 2) -> None:
        self._servo(("reboot", servo_id), servo_id, protocol).reboot()

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

    def _servo(self, packet: Packet, servo_id: int, protocol: int) -> FakeServo:
        self._note(packet)
        if self.failures[servo_id]:
            failure = self.failures[servo_id].popleft()
            if failure is not None:
                raise failure
        servo = self.servos.get(servo_id)
        if servo is None or not servo.answers or servo.model.protocol != protocol:
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


def connected(port: FakePort, *joints: JointConfiguration) -> ServoBus:
    """Return a bus of these joints, by default pan and tilt, that has found its servos."""
    clock = FakeClock()
    bus = ServoBus(port, joints or (PAN, TILT), clock, monotonic=clock)  # type: ignore[arg-type]
    bus.connect()
    port.take_log()
    return bus


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
