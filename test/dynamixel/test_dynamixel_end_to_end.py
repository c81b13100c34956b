"""Driver and simulator over a real pty, as the head uses them."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterable, Iterator
from dataclasses import replace

import pytest
from answer_hook import OnAnswers
from waiting import PATIENCE, eventually

from head_tracking.dynamixel import (
    Block,
    BusReading,
    BusThread,
    DynamixelPort,
    Goal,
    GoalError,
    JointConfiguration,
    PortBusyError,
    PortLostError,
    PortMissingError,
    Register,
    ServoBus,
    ServoModeError,
    ServoNotFoundError,
    ServoState,
    servo_model,
)
from head_tracking.simulation import Answer, SimulatedBus, SimulatedPort, SimulatedServo

TABLE = servo_model("AX-12").control_table
PAN = JointConfiguration("head_pan_joint", 1, controller="head_pan_controller")
TILT = JointConfiguration("head_tilt_joint", 2, 512, 300, 800, controller="head_tilt_controller")
TICK = PAN.resolution


class Head:
    """A simulated head with its bus running in a thread."""

    def __init__(self, simulated: SimulatedPort, *joints: JointConfiguration) -> None:
        self.simulated = simulated
        self.joints = {joint.joint_name: joint for joint in joints or (PAN, TILT)}
        port = DynamixelPort(simulated.port_name, reply_timeout=0.2)  # a busy machine is no fault
        self.bus = ServoBus(port, self.joints.values(), time.monotonic_ns)
        self.summary = self.bus.connect()
        self.reading: BusReading | None = None
        self.errors: list[BaseException] = []
        self.thread = BusThread(self.bus, 100.0, self._keep, self.errors.append)
        self.thread.start()

    def _keep(self, reading: BusReading) -> None:
        self.reading = reading

    def state(self, joint: str) -> ServoState | None:
        return None if self.reading is None else self.reading.states.get(joint)

    def measured(self, joint: str) -> float:
        state = self.state(joint)
        return float("nan") if state is None else state.position

    def true(self, joint: str) -> float:
        configuration = self.joints[joint]
        return configuration.position(self.simulated.true_ticks(configuration.id))

    def set_torque(self, joint: str, on: bool) -> None:
        self.thread.call(lambda bus: bus.run(bus.switching_torque([joint], on))).result(PATIENCE)


def near(one: float, other: float, ticks: float = 3.0) -> bool:
    return abs(one - other) <= ticks * TICK


@pytest.fixture
def simulated() -> Iterator[SimulatedPort]:
    with SimulatedPort([SimulatedServo(1), SimulatedServo(2)]) as port:
        yield port


@pytest.fixture
def head(simulated: SimulatedPort) -> Iterator[Head]:
    h = Head(simulated)
    yield h
    h.thread.stop(PATIENCE)


def test_connect_says_what_is_there(head: Head) -> None:
    assert head.summary == "2 AX-12 servos: ids 1, 2"
    assert eventually(lambda: head.state("head_tilt_joint") is not None)
    state = head.state("head_pan_joint")
    assert state is not None
    assert (state.position, state.velocity, state.torque) == (0.0, 0.0, False)
    assert state.voltage == pytest.approx(12.0)
    assert state.temperature == 30.0


@pytest.mark.parametrize("register", TABLE, ids=lambda register: register.name)
def test_every_register_is_readable(simulated: SimulatedPort, register: Register) -> None:
    port = DynamixelPort(simulated.port_name, reply_timeout=5.0)
    port.open()
    reply = port.read(1, register.address, register.size)
    (value,) = Block((register,)).decode(reply.data)
    assert value == simulated.use(lambda bus: bus[1].register(register.name))
    port.close()


def test_command_moves_the_joint_and_the_readings_follow(head: Head) -> None:
    head.bus.command({"head_pan_joint": Goal(0.5), "head_tilt_joint": Goal(-0.3, 1.0)})
    for joint, goal in (("head_pan_joint", 0.5), ("head_tilt_joint", -0.3)):
        assert eventually(lambda joint=joint, goal=goal: near(head.measured(joint), goal))  # type: ignore[misc]
        assert near(head.true(joint), goal)


def test_joint_keeps_its_speed(head: Head) -> None:
    speeds: list[float] = []

    def watch() -> bool:
        state = head.state("head_pan_joint")
        if state is not None:
            speeds.append(state.velocity)
        return near(head.measured("head_pan_joint"), 1.0)

    head.bus.command({"head_pan_joint": Goal(1.0, 1.5)})
    assert eventually(watch)
    assert max(speeds) == pytest.approx(1.5, rel=0.05)


def test_nothing_moves_before_a_command(head: Head) -> None:
    assert eventually(lambda: head.reading is not None and head.reading.cycle > 20)
    assert head.true("head_pan_joint") == 0.0
    assert head.simulated.use(lambda bus: bus[1].register("Torque Enable")) == 0


def test_relaxed_joint_is_moved_by_hand_and_the_readings_follow(head: Head) -> None:
    head.bus.command({"head_pan_joint": Goal(0.3)})
    assert eventually(lambda: near(head.measured("head_pan_joint"), 0.3))
    head.set_torque("head_pan_joint", False)
    head.simulated.lead(1, PAN.ticks(-0.6), 0.3)
    assert eventually(lambda: near(head.measured("head_pan_joint"), -0.6))
    with pytest.raises(GoalError, match="relaxed on request"):
        head.bus.command({"head_pan_joint": Goal(0.3)})


def test_torque_on_after_moving_by_hand_does_not_jump(head: Head) -> None:
    head.bus.command({"head_pan_joint": Goal(0.3)})
    assert eventually(lambda: near(head.measured("head_pan_joint"), 0.3))
    head.set_torque("head_pan_joint", False)
    head.simulated.lead(1, PAN.ticks(-0.6), 0.3)
    assert eventually(lambda: head.simulated.use(lambda bus: bus[1].at_rest))
    before = head.true("head_pan_joint")
    head.set_torque("head_pan_joint", True)
    assert head.reading is not None
    cycle = head.reading.cycle
    assert eventually(lambda: head.reading is not None and head.reading.cycle > cycle + 20)
    assert near(head.true("head_pan_joint"), before, ticks=1.5)


def test_joint_with_torque_on_resists_a_hand(head: Head) -> None:
    head.set_torque("head_pan_joint", True)
    head.simulated.lead(1, PAN.ticks(-0.6), 0.1)
    assert eventually(lambda: head.simulated.use(lambda bus: bus[1].register("Present Load")) > 100)
    assert eventually(lambda: near(head.true("head_pan_joint"), 0.0))
    assert eventually(lambda: head.simulated.use(lambda bus: bus[1].at_rest))


def test_reversed_servo_turns_position_and_velocity(simulated: SimulatedPort) -> None:
    head = Head(simulated, replace(PAN, min=1023, max=0))
    head.bus.command({"head_pan_joint": Goal(0.5, 0.5)})
    assert eventually(lambda: (head.state("head_pan_joint") or _still()).velocity > 0.3)
    assert eventually(lambda: near(head.measured("head_pan_joint"), 0.5))
    assert simulated.true_ticks(1) < 512
    head.thread.stop(PATIENCE)


def test_stop_relaxes_the_servos_and_frees_the_port(head: Head) -> None:
    head.bus.command({"head_pan_joint": Goal(2.0)})
    assert eventually(lambda: head.true("head_pan_joint") > 0.1)
    head.thread.stop(PATIENCE)
    assert head.thread.unconfirmed == ()
    assert head.simulated.use(lambda bus: [servo.register("Torque Enable") for servo in bus]) == [
        0,
        0,
    ]
    stopped = head.true("head_pan_joint")
    assert stopped < 1.5
    again = DynamixelPort(head.simulated.port_name)
    again.open()
    again.close()


def test_callback_that_raises_leaves_no_torque(simulated: SimulatedPort) -> None:
    bus = ServoBus(DynamixelPort(simulated.port_name, reply_timeout=0.2), (PAN, TILT))
    bus.connect()

    def explode(reading: BusReading) -> None:
        state = reading.states.get("head_pan_joint")
        if state is not None and state.torque:
            raise RuntimeError("callback")

    thread = BusThread(bus, 100.0, explode)
    thread.start()
    bus.command({"head_pan_joint": Goal(1.0)})
    assert eventually(lambda: not thread.running)
    assert str(thread.error) == "callback"
    assert simulated.use(lambda b: b[1].register("Torque Enable")) == 0


# Bad input


def test_missing_id_is_named(simulated: SimulatedPort) -> None:
    bus = ServoBus(DynamixelPort(simulated.port_name), (PAN, replace(TILT, id=5)))
    with pytest.raises(ServoNotFoundError, match=r"servo id 5 .*answered: 1"):
        bus.connect()


def test_wheel_mode_is_refused(simulated: SimulatedPort) -> None:
    simulated.use(lambda bus: bus[1].set_register("CCW Angle Limit", 0))
    bus = ServoBus(DynamixelPort(simulated.port_name, reply_timeout=5.0), (PAN, TILT))
    with pytest.raises(ServoModeError, match="wheel mode"):
        bus.connect()


@pytest.mark.parametrize("level", [1, 2])
def test_head_moves_whatever_writes_are_answered(simulated: SimulatedPort, level: int) -> None:
    simulated.use(lambda bus: bus[1].set_register("Status Return Level", level))
    head = Head(simulated)
    head.bus.command({"head_pan_joint": Goal(0.3)})
    assert eventually(lambda: near(head.measured("head_pan_joint"), 0.3))
    head.thread.stop(PATIENCE)
    assert simulated.use(lambda bus: bus[1].register("Torque Enable")) == 0


def test_status_return_level_0_is_refused(simulated: SimulatedPort) -> None:
    simulated.use(lambda bus: bus[1].set_register("Status Return Level", 0))
    bus = ServoBus(DynamixelPort(simulated.port_name), (PAN, TILT))
    with pytest.raises(ServoModeError, match="Status Return Level"):
        bus.connect()


def test_busy_port_is_named(head: Head) -> None:
    second = ServoBus(DynamixelPort(head.simulated.port_name), (PAN, TILT))
    with pytest.raises(PortBusyError, match="another program"):
        second.connect()
    assert eventually(lambda: near(head.measured("head_pan_joint"), 0.0))  # the first goes on


def test_missing_port_is_named() -> None:
    with pytest.raises(PortMissingError, match="/dev/ttyNone"):
        ServoBus(DynamixelPort("/dev/ttyNone"), (PAN, TILT)).connect()


def test_refused_command_moves_nothing(head: Head) -> None:
    for goal in (Goal(float("nan")), Goal(9.0), Goal(0.1, 0.0)):
        with pytest.raises(GoalError):
            head.bus.command({"head_pan_joint": goal})
    assert eventually(lambda: head.reading is not None and head.reading.cycle > 20)
    assert head.true("head_pan_joint") == 0.0


def test_vanished_port_ends_the_thread_with_its_error() -> None:
    simulated = SimulatedPort([SimulatedServo(1), SimulatedServo(2)])
    simulated.open()
    head = Head(simulated)
    assert eventually(lambda: head.reading is not None)
    simulated.close()
    assert eventually(lambda: bool(head.errors))
    assert isinstance(head.errors[0], PortLostError)
    head.thread.stop(PATIENCE)
    head.bus.close()


def test_silent_servo_is_lost_and_comes_back() -> None:
    silent = threading.Event()

    def line(answer: Answer) -> Iterable[Answer]:
        return () if silent.is_set() and answer.data[2] == 1 else (answer,)

    with SimulatedPort(
        SimulatedBus([SimulatedServo(1), SimulatedServo(2)], faults=OnAnswers(line))
    ) as simulated:
        head = Head(simulated)
        head.bus.command({"head_pan_joint": Goal(0.2), "head_tilt_joint": Goal(0.2)})
        assert eventually(lambda: near(head.measured("head_pan_joint"), 0.2))
        silent.set()
        assert eventually(lambda: head.reading is not None and bool(head.reading.lost))
        assert head.state("head_pan_joint") is None
        assert eventually(lambda: near(head.measured("head_tilt_joint"), 0.2))
        silent.clear()
        assert eventually(lambda: head.state("head_pan_joint") is not None)
        assert simulated.use(lambda bus: bus[1].register("Torque Enable")) == 1  # it was on
        assert near(head.true("head_pan_joint"), 0.2)
        head.bus.command({"head_pan_joint": Goal(-0.2)})
        assert eventually(lambda: near(head.measured("head_pan_joint"), -0.2))
        head.thread.stop(PATIENCE)


def test_corrupt_answers_are_repeated_and_counted() -> None:
    count = [0]

    def line(answer: Answer) -> Iterable[Answer]:
        count[0] += 1
        if count[0] % 7:
            return (answer,)
        return (Answer(answer.data[:-1] + bytes((answer.data[-1] ^ 0x55,)), answer.delay),)

    with SimulatedPort(
        SimulatedBus([SimulatedServo(1), SimulatedServo(2)], faults=OnAnswers(line))
    ) as simulated:
        head = Head(simulated)
        head.bus.command({"head_pan_joint": Goal(0.2)})
        assert eventually(lambda: near(head.measured("head_pan_joint"), 0.2))
        assert eventually(lambda: sum(s.corrupt for s in head.bus.statistics().servos) > 3)
        assert sum(servo.retries for servo in head.bus.statistics().servos) > 3
        assert not head.errors
        head.thread.stop(PATIENCE)


def test_nothing_is_left_behind() -> None:
    def resources() -> tuple[int, int]:
        return len(os.listdir("/proc/self/fd")), threading.active_count()

    before = resources()
    for _ in range(3):
        with SimulatedPort([SimulatedServo(1), SimulatedServo(2)]) as simulated:
            Head(simulated).thread.stop(PATIENCE)
    assert resources() == before


def _still() -> ServoState:
    from head_tracking.dynamixel import ErrorBits

    return ServoState("", 0, 0, 0.0, 0.0, 0.0, 0.0, 0.0, ErrorBits(0), False, None)
