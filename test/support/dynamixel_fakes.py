"""A port and clocks for tests of the bus: exact packets, no waiting."""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Mapping

from head_tracking.dynamixel import (
    ErrorBits,
    JointConfiguration,
    PortLostError,
    Reply,
    ReplyTimeoutError,
    servo_model,
)

TABLE = servo_model("AX-12").control_table
GOAL, SPEED, TORQUE, POSITION = 30, 32, 24, 36

PAN = JointConfiguration("head_pan_joint", "head_pan_controller", 1)
TILT = JointConfiguration("head_tilt_joint", "head_tilt_controller", 2, min=300, max=800)

Packet = tuple[object, ...]


class FakeServo:
    """Registers, and whether anybody answers. A goal switches torque on, as on a real AX."""

    def __init__(self, servo_id: int) -> None:
        self.bytes = bytearray(TABLE.size)
        for register in TABLE:
            self[register.name] = register.initial or 0
        self["ID"] = servo_id
        self["Firmware Version"] = 24
        self["Goal Position"] = 900  # an old goal that nobody wants any more
        self["Present Position"] = 512
        self["Present Voltage"] = 120
        self["Present Temperature"] = 30
        self["Torque Limit"] = 1023
        self.answers = True
        self.error = ErrorBits(0)
        self.ignored: set[int] = set()  # addresses whose writes have no effect

    def __getitem__(self, name: str) -> int:
        register = TABLE[name]
        return int.from_bytes(self.bytes[register.address : register.end], "little")

    def __setitem__(self, name: str, value: int) -> None:
        register = TABLE[name]
        self.bytes[register.address : register.end] = value.to_bytes(register.size, "little")

    def write(self, address: int, data: bytes) -> None:
        if address in self.ignored:
            return
        self.bytes[address : address + len(data)] = data
        if address in (GOAL, SPEED):
            self["Torque Enable"] = 1


class FakePort:
    """A `ServoPort` that keeps a log of all packets.

    Attributes:
        log: ("ping", id), ("read", id, address, length), ("write", id, address, bytes) and
            ("sync", address, {id: bytes}), in order.
        failures: Exceptions to raise for the next transactions with an id, None for none.
        gone: Whether the adapter has been unplugged.
    """

    name = "/dev/fake"
    baud_rate = 1_000_000

    def __init__(self, *ids: int) -> None:
        self.servos = {servo_id: FakeServo(servo_id) for servo_id in ids or (1, 2)}
        self.log: list[Packet] = []
        self.failures: dict[int, deque[Exception | None]] = defaultdict(deque)
        self.gone = False
        self.opened = False
        self.times_closed = 0

    def open(self) -> None:
        self.opened = True

    def close(self) -> None:
        self.opened = False
        self.times_closed += 1

    def ping(self, servo_id: int) -> ErrorBits:
        return self._servo(("ping", servo_id), servo_id).error

    def read(self, servo_id: int, address: int, length: int) -> Reply:
        servo = self._servo(("read", servo_id, address, length), servo_id)
        if servo["Status Return Level"] < 1:
            raise ReplyTimeoutError("silent")
        return Reply(bytes(servo.bytes[address : address + length]), servo.error)

    def write(
        self, servo_id: int, address: int, data: bytes, *, acknowledged: bool = True
    ) -> ErrorBits:
        packet = ("write", servo_id, address, data)
        if not acknowledged:
            self._note(packet)
            servo = self.servos.get(servo_id)
            if servo is not None:
                servo.write(address, data)
            return ErrorBits(0)
        servo = self._servo(packet, servo_id)
        servo.write(address, data)
        if servo["Status Return Level"] < 2:
            raise ReplyTimeoutError("silent")
        return servo.error

    def sync_write(self, address: int, data: Mapping[int, bytes]) -> None:
        self._note(("sync", address, dict(data)))
        for servo_id, share in data.items():
            if servo_id in self.servos:
                self.servos[servo_id].write(address, share)

    def take_log(self) -> list[Packet]:
        log, self.log = self.log, []
        return log

    def _note(self, packet: Packet) -> None:
        if self.gone or not self.opened:
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


def goal_bytes(ticks: int, speed: int) -> bytes:
    return ticks.to_bytes(2, "little") + speed.to_bytes(2, "little")


def writes(log: list[Packet]) -> list[Packet]:
    return [packet for packet in log if packet[0] in ("write", "sync")]
