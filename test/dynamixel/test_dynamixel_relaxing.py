"""What is called relaxed is relaxed: at the end of a run, and without a running bus."""

from __future__ import annotations

import pytest
from dynamixel_fakes import PAN, TILT, FakeClock, FakePort, submit, writes
from simulated_device import Bench, joint_of

from head_tracking.dynamixel import (
    BusThread,
    ConfigurationError,
    DynamixelPort,
    EventKind,
    ServoBus,
    ServoError,
    Torque,
    TorqueError,
    relax_servos,
    servo_model,
)
from head_tracking.dynamixel.exceptions import PortMissingError
from head_tracking.dynamixel.servo import run
from head_tracking.simulation import SimulatedServo


def connected(port: FakePort) -> ServoBus:
    bus = ServoBus(port, [PAN, TILT])  # type: ignore[arg-type]
    bus.connect()
    run(bus.switching_torque(None, True))
    return bus


# The start and the end of a run


@pytest.mark.parametrize("register", [None, "Model Number", "CCW Angle Limit"])
def test_a_start_that_fails_relaxes_the_servos_that_can_be_used(register: str | None) -> None:
    port = FakePort()
    for servo in port.servos.values():
        servo["Torque Enable"] = 1  # left so by a program that was killed
    if register is None:
        port.servos[1].answers = False
    else:
        port.servos[1][register] = 0
    with pytest.raises(ServoError):
        ServoBus(port, [PAN, TILT], pause=lambda _: None).connect()  # type: ignore[arg-type]
    assert port.servos[2]["Torque Enable"] == 0
    assert not port.opened


def test_a_joint_whose_stop_failed_is_not_called_relaxed_at_the_end() -> None:
    port = FakePort()
    bus = connected(port)
    port.servos[1].answers = False
    port.servos[1].ignored = {24}  # its cable is out
    with pytest.raises(TorqueError):
        run(bus.stopping([PAN.joint_name]))
    assert EventKind.TORQUE_FAILED in [event.kind for event in bus.step().events]
    assert bus.close() == (PAN.joint_name,)
    assert [servo["Torque Enable"] for servo in port.servos.values()] == [1, 0]


def test_a_joint_that_was_relaxed_when_it_was_stopped_need_not_answer_at_the_end() -> None:
    port = FakePort()
    bus = connected(port)
    run(bus.stopping([PAN.joint_name]))
    port.servos[1].answers = False
    assert bus.joint(PAN.joint_name).torque is Torque.OFF_STOPPED
    run(bus.switching_torque(None, False))
    port.servos[2].answers = False  # relaxed, too, but not taken out of the cycle
    problems = bus.relax_at_once(1.0)
    assert problems[TILT.joint_name] and not problems[PAN.joint_name]
    port.servos[2].answers = True
    assert bus.close() == ()


def test_a_stopped_joint_whose_torque_another_program_switched_on_is_not_called_relaxed() -> None:
    port = FakePort()
    bus = connected(port)
    run(bus.stopping([PAN.joint_name]))
    port.servos[1]["Torque Enable"] = 1
    port.servos[1].ignored = {24}
    with pytest.raises(TorqueError):
        run(bus.switching_torque(None, False))
    assert bus.relax_at_once(1.0)[PAN.joint_name]
    assert bus.close() == (PAN.joint_name,)


def test_a_stop_that_failed_and_succeeds_later_is_confirmed() -> None:
    port = FakePort()
    bus = connected(port)
    port.servos[1].answers = False
    with pytest.raises(TorqueError):
        run(bus.stopping([PAN.joint_name]))
    port.servos[1].answers = True
    assert bus.close() == ()
    assert [servo["Torque Enable"] for servo in port.servos.values()] == [0, 0]


def test_no_joint_is_called_relaxed_when_the_adapter_has_gone() -> None:
    port = FakePort()
    bus = connected(port)
    run(bus.stopping([TILT.joint_name]))
    port.gone = True
    assert bus.close() == (PAN.joint_name,)


@pytest.mark.parametrize("name", ["AX-12", "XM430-W350", "STS3215"])
def test_a_stopped_joint_that_was_recovered_is_called_relaxed_at_the_end(name: str) -> None:
    servo = SimulatedServo(1, name, boot_time=0.1)
    bench = Bench([servo])
    bus = bench.servo_bus([joint_of(1, servo_model(name))])
    bus.connect()
    run(bus.switching_torque(None, True), bench.pass_time)
    servo.overload()
    for _ in range(5):
        bench.pass_time(0.02)
        bus.step()
    run(bus.stopping(None), bench.pass_time)
    assert run(bus.recovering(), bench.pass_time) == ("j1",)
    bench.pass_time(0.5)
    bus.step()
    assert bus.close() == ()
    assert servo.register("Torque Enable") == 0


@pytest.mark.parametrize("close", [False, True])
def test_the_watchdog_is_switched_off_with_the_joint(close: bool) -> None:
    model = servo_model("XM430-W350")
    servo = SimulatedServo(1, model)
    bench = Bench([servo])
    bus = bench.servo_bus([joint_of(1, model)])
    bus.connect()
    run(bus.switching_torque(None, True))
    assert servo.register("Bus Watchdog") > 0
    if close:
        assert bus.close() == ()
    else:
        run(bus.stopping(None))
    assert servo.register("Bus Watchdog") == 0


@pytest.mark.parametrize("silent", range(12))
def test_stop_is_tried_again_where_it_failed(silent: int) -> None:
    port = FakePort()
    clock = FakeClock(tick=1000)
    bus = ServoBus(port, [PAN, TILT], monotonic=clock)  # type: ignore[arg-type]
    bus.connect()
    run(bus.switching_torque(None, True))
    port.servos[1].answers, port.servos[1].ignored = False, {24}  # its plug is loose
    assert bus.relax_at_once(1.0)[PAN.joint_name]
    for cycle in range(30):
        if cycle == silent:  # 0: its cycles miss nothing
            port.servos[1].answers, port.servos[1].ignored = True, set()
        clock.pass_time(0.02)
        bus.step()
    assert [servo["Torque Enable"] for servo in port.servos.values()] == [0, 0]


@pytest.mark.parametrize("silent", [0, 2, 20])
@pytest.mark.parametrize("lost", [False, True])
@pytest.mark.parametrize("overtaken", [False, True])
def test_a_joint_that_did_not_confirm_when_it_was_stopped_is_relaxed_once_it_answers(
    silent: int, lost: bool, overtaken: bool
) -> None:
    port, clock = FakePort(), FakeClock(tick=1000)
    bus = ServoBus(port, [PAN, TILT], monotonic=clock)  # type: ignore[arg-type]
    bus.connect()
    run(bus.switching_torque(None, True))
    port.servos[1].answers, port.servos[1].ignored = False, {24}  # its plug is loose
    for _ in range(10 * lost):
        bus.step()
    stopping = submit(bus, bus.stopping([PAN.joint_name]))
    if overtaken:
        bus.relax_at_once(0.0)
    while not stopping.done():
        bus.step()
    assert stopping.exception()
    for cycle in range(silent + 10):
        if cycle == silent:
            port.servos[1].answers, port.servos[1].ignored = True, set()
        clock.pass_time(0.02)
        reading = bus.step()
    assert [servo["Torque Enable"] for servo in port.servos.values()] == [0, not overtaken]
    assert bus.joint(PAN.joint_name).torque is Torque.OFF_STOPPED
    assert set(reading.states) == {TILT.joint_name}
    port.take_log()
    bus.step()
    assert all(packet[1] != 1 for packet in port.take_log())  # it is left alone
    assert bus.close() == ()


def test_a_servo_that_is_silent_for_a_moment_at_the_end_is_relaxed() -> None:
    port, clock = FakePort(), FakeClock(tick=1000)

    def pause(seconds: float) -> None:
        clock.pass_time(seconds)
        if clock() > silent_until:
            port.servos[1].answers, port.servos[1].ignored = True, set()

    bus = ServoBus(port, [PAN, TILT], monotonic=clock, pause=pause)  # type: ignore[arg-type]
    bus.connect()
    run(bus.switching_torque(None, True))
    silent_until = clock() + 0.8e9
    port.servos[1].answers, port.servos[1].ignored = False, {24}
    assert bus.close() == ()
    assert [servo["Torque Enable"] for servo in port.servos.values()] == [0, 0]


def test_a_stop_without_time_relaxes_all_the_same() -> None:
    port = FakePort(1)
    bus = ServoBus(port, [PAN], monotonic=FakeClock(tick=1000))  # type: ignore[arg-type]
    bus.connect()
    run(bus.switching_torque(None, True))
    assert bus.relax_at_once(0.0)[PAN.joint_name]  # not confirmed yet
    assert port.servos[1]["Torque Enable"] == 0
    for _ in range(3):
        bus.step()
    assert bus.joint(PAN.joint_name).confirmed


# An adapter that comes back


@pytest.mark.parametrize("other", [{"Firmware Version": 25}, {"Model Number": 18}])
def test_an_adapter_with_other_servos_is_not_taken_for_the_one_that_went(
    other: dict[str, int],
) -> None:
    port, clock = FakePort(), FakeClock(tick=1000)
    bus = ServoBus(port, [PAN, TILT], monotonic=clock)  # type: ignore[arg-type]
    bus.connect()
    port.gone = True
    bus.step()
    ((name, value),) = other.items()
    before = port.servos[2][name]
    port.servos[2][name] = value  # of another servo with the same id, on another adapter
    port.gone = False
    port.take_log()
    for _ in range(20):
        clock.pass_time(0.1)
        bus.step()
    assert not bus.statistics().connected
    assert not writes(port.take_log())
    port.servos[2][name] = before
    for _ in range(20):
        clock.pass_time(0.1)
        assert bus.step() is not None
    assert bus.statistics().connected


# Without a running bus

SERVOS = {1: "AX-12", 2: "XM430-W350", 3: "XL-320", 4: "MX-28"}


class Left:
    """Servos that a dead program has left with torque on."""

    def __init__(self) -> None:
        self.servos = {i: SimulatedServo(i, servo_model(name)) for i, name in SERVOS.items()}
        self.bench = Bench(self.servos.values())
        self.bench.port.open()
        self.bench.pass_time(0.1)
        for servo in self.servos.values():
            servo.set_register("Goal Position", servo.model.center + servo.model.ticks // 5)
            servo.set_register("Torque Enable", 1)
        self.bench.port.close()

    def make_port(self, port_name: str, baud_rate: int) -> DynamixelPort:
        del port_name, baud_rate
        return self.bench.port

    @property
    def torque(self) -> list[int]:
        return [servo.register("Torque Enable") for servo in self.servos.values()]


def test_servos_are_relaxed_without_a_bus() -> None:
    left = Left()
    before = left.servos[2].register("Moving Threshold")
    assert relax_servos("x", SERVOS, make_port=left.make_port) == dict.fromkeys(SERVOS, "")
    assert left.torque == [0, 0, 0, 0]
    assert left.servos[2].register("Moving Threshold") == before


def test_a_servo_that_is_not_there_is_named_and_the_others_are_relaxed() -> None:
    left = Left()
    problems = relax_servos("x", {7: "AX-12"} | SERVOS, make_port=left.make_port)
    assert problems[7] and not any(problems[each] for each in SERVOS)
    assert left.torque == [0, 0, 0, 0]


def test_servos_hold_where_they_stand_without_a_bus() -> None:
    left = Left()
    left.servos[2].set_register("Bus Watchdog", 255)  # it tripped when the program died
    left.servos[4].set_register("Torque Enable", 0)
    left.bench.pass_time(0.15)
    assert not any(relax_servos("x", SERVOS, hold=True, make_port=left.make_port).values())
    assert left.torque == [1, 1, 1, 0]
    stood = {i: servo.true_ticks for i, servo in left.servos.items()}
    left.bench.pass_time(3.0)
    left.bench.bus.advance(left.bench.now())
    for i, servo in left.servos.items():
        assert servo.true_ticks == pytest.approx(stood[i], abs=servo.model.ticks / 100)


def test_what_cannot_be_relaxed_raises() -> None:
    with pytest.raises(ConfigurationError):
        relax_servos("/dev/none", {1: "AX-13"})
    with pytest.raises(PortMissingError):
        relax_servos("/dev/none", {1: "AX-12"})


# Interrupts, and errors of other kinds


def test_an_interrupt_while_joints_brake_does_not_keep_them_from_being_relaxed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    port = FakePort()
    bus = connected(port)

    def interrupt(_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(bus._procedures, "write_goals", interrupt)
    with pytest.raises(KeyboardInterrupt):
        bus.close()
    assert [servo["Torque Enable"] for servo in port.servos.values()] == [0, 0]


def test_no_joint_is_called_relaxed_when_closing_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    port = FakePort()
    errors: list[BaseException] = []
    thread = BusThread(connected(port), 100.0, lambda _: None, errors.append)

    def fail(*_: object, **__: object) -> None:
        raise RuntimeError

    monkeypatch.setattr(thread.bus, "close", fail)
    thread.start()
    thread.stop()
    assert thread.unconfirmed == (PAN.joint_name, TILT.joint_name)
    assert thread.error is errors[0]
    assert isinstance(thread.error, RuntimeError)
