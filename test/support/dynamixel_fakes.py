"""Pan and tilt on servos whose registers a test sets: exact packets, no waiting."""

from __future__ import annotations

from collections import deque
from concurrent.futures import Future
from typing import TypeVar

from simulated_device import Bench, Rig

from head_tracking.dynamixel import (
    BusReading,
    BusSettings,
    EventKind,
    Goal,
    JointConfiguration,
    ServoBus,
    Torque,
    servo_model,
)
from head_tracking.dynamixel.requests import Steps
from head_tracking.simulation import SimulatedServo
from head_tracking.simulation.packets import Instruction, Packet, Status

T = TypeVar("T")

AX_12 = servo_model("AX-12")
GOAL, SPEED, TORQUE = 30, 32, 24

PAN = JointConfiguration("head_pan_joint", 1, controller="head_pan_controller")
TILT = JointConfiguration("head_tilt_joint", 2, controller="head_tilt_controller", min=300, max=800)

Request = tuple[object, ...]
_SECOND = 1_000_000_000  # ns


class FakeServo(SimulatedServo):
    """An AX-12 that stands still: its registers hold what a test or a packet has set."""

    def __init__(self, servo_id: int) -> None:
        super().__init__(servo_id, boot_time=0.0)
        self.answers = True  # whether it hears and answers what is sent to it alone
        # whether it misses each of the next packets that are sent to it alone
        self.mute: deque[bool] = deque()
        self.ignored: set[int] = set()  # addresses whose writes have no effect
        self["Goal Position"] = 900  # an old goal that nobody wants any more
        super()._measure()

    def __getitem__(self, name: str) -> int:
        return self.register(name)

    def __setitem__(self, name: str, value: int) -> None:
        self.set_register(name, value)

    @property
    def error(self) -> int:
        """Its error bits."""
        return self.alarms.forced

    @error.setter
    def error(self, bits: int) -> None:
        self.alarms.forced = int(bits)

    def _measure(self) -> None:
        """Measure nothing."""

    def execute(self, packet: Packet, now: int) -> Status | None:
        """See `SimulatedServo`."""
        is_own = packet.id == self.id
        if is_own and (not self.answers or (self.mute and self.mute.popleft())):
            return None
        is_write = packet.code in (Instruction.WRITE, Instruction.SYNC_WRITE)
        if is_write and packet.parameters[0] in self.ignored:
            return Status(self.id, self.error, b"") if is_own else None
        return super().execute(packet, now)


def fake_bench(*ids: int) -> Bench:
    """Return fake servos on a port, by default with the ids 1 and 2."""
    return Bench([FakeServo(servo_id) for servo_id in ids or (1, 2)])


def decoded(data: bytes) -> Request:
    """Return what a request of protocol 1.0 says.

    ("ping", id), ("read", id, address, length), ("write", id, address, bytes) or
    ("sync", address, {id: bytes}).
    """
    servo_id, code, parameters = data[2], data[4], data[5:-1]
    if code == Instruction.SYNC_WRITE:
        address, length, *_ = parameters
        shares = parameters[2:]
        starts = range(0, len(shares), length + 1)
        return "sync", address, {shares[i]: shares[i + 1 : i + 1 + length] for i in starts}
    if code == Instruction.READ:
        return "read", servo_id, *parameters
    if code == Instruction.WRITE:
        return "write", servo_id, parameters[0], parameters[1:]
    return "ping", servo_id


class FakeRig(Rig):
    """Joints on fake servos."""

    def __init__(
        self,
        *joints: JointConfiguration,  # by default pan and tilt
        settings: BusSettings | None = None,  # of the bus
        connect: bool = True,  # whether the bus is connected
    ) -> None:
        joints = joints or (PAN, TILT)
        servos = [FakeServo(joint.id) for joint in joints]
        super().__init__(*servos, joints=joints, settings=settings, connect=False)
        self.pan, self.tilt = servos[0], servos[-1]
        self.log: list[Request] = []  # what was sent
        write = self.bench.line.write

        def note(data: bytes) -> None:
            self.log.append(decoded(data))
            write(data)

        self.bench.line.write = note  # type: ignore[method-assign]
        if connect:
            self.connect()

    def connect(self) -> None:
        self.bus.connect()
        self.log.clear()

    def step(self, count: int = 1) -> BusReading:
        """Run cycles of 20 ms; what has begun is completed after each of them."""
        for _ in range(count):
            super().step()
            while self.bus.cycle.fill(self.bench.now() + _SECOND):
                pass
        return self.reading

    def passed(self, count: int = 1) -> list[EventKind]:
        """Return what cycles report; a servo that never moves is no matter here."""
        before = len(self.events)
        self.step(count)
        kinds = [event.kind for event in self.events[before:]]
        return [kind for kind in kinds if kind is not EventKind.SYMPTOM]

    def switched_on(self, position: float = 0.2) -> FakeRig:
        self.bus.command({"head_pan_joint": Goal(position)})
        self.step(2)
        self.log.clear()
        return self

    def take_log(self) -> list[Request]:
        log, self.log[:] = self.log[:], []
        return log

    @property
    def lost(self) -> list[str]:
        """The joints of which no servo answers."""
        return [each.joint_name for each in self.bus.joints if self.bus.joint(each.joint_name).lost]

    @property
    def pan_torque(self) -> Torque:
        return self.bus.joint("head_pan_joint").torque


def speed_ticks(joint: JointConfiguration, speed: float) -> int:
    """The register value of a goal speed, rad/s."""
    unit = joint.model.speed_unit
    return max(1, min(round(speed / unit), int(joint.speed_limit / unit)))


def goal_bytes(ticks: int, speed: int) -> bytes:
    return ticks.to_bytes(2, "little") + speed.to_bytes(2, "little")


def writes(log: list[Request]) -> list[Request]:
    return [request for request in log if request[0] in ("write", "sync")]


def submit(bus: ServoBus, steps: Steps[T]) -> Future[T]:
    """Ask a bus for what takes steps, as another thread does, and let it take the first one."""
    future: Future[T] = bus.requests.add(lambda: steps)
    bus.requests.begin_next()
    return future
