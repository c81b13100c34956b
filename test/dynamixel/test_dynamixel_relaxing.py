"""What is called relaxed is relaxed: at the end of a run, and without a running bus."""

import pytest
from dynamixel_fakes import PAN, TILT, FakeRig, submit, writes
from simulated_device import Bench, Rig

from head_tracking.dynamixel import (
    BusThread,
    ConfigurationError,
    EventKind,
    ServoError,
    Torque,
    TorqueError,
    relax_servos,
    servo_model,
)
from head_tracking.dynamixel.exceptions import PortMissingError
from head_tracking.dynamixel.servo import run
from head_tracking.simulation import SimulatedServo

PLUG = {24}
"""What a servo with a loose plug ignores: it hears nothing, and does not answer."""


def loosen(rig: FakeRig) -> None:
    rig.pan.answers, rig.pan.ignored = False, PLUG


def plug_in(rig: FakeRig) -> None:
    rig.pan.answers, rig.pan.ignored = True, set()


@pytest.fixture
def rig():
    """Pan and tilt hold."""
    rig = FakeRig()
    run(rig.bus.switching_torque(None, True))
    return rig


# The start and the end of a run


@pytest.mark.parametrize("register", [None, "Model Number", "CCW Angle Limit"])
def test_a_start_that_fails_relaxes_the_servos_that_can_be_used(register):
    rig = FakeRig(connect=False)
    for servo in (rig.pan, rig.tilt):
        servo["Torque Enable"] = 1  # left so by a program that was killed
    if register is None:
        rig.pan.answers = False
    else:
        rig.pan[register] = 0
    with pytest.raises(ServoError):
        rig.connect()
    assert rig.tilt["Torque Enable"] == 0
    assert not rig.bench.port.is_open


def test_a_joint_whose_stop_failed_is_not_called_relaxed_at_the_end(rig):
    loosen(rig)
    with pytest.raises(TorqueError):
        run(rig.bus.stopping([PAN.joint_name]))
    assert EventKind.TORQUE_FAILED in [event.kind for event in rig.bus.step().events]
    assert rig.bus.close() == (PAN.joint_name,)
    assert rig.torque == [1, 0]


def test_a_joint_that_was_relaxed_when_it_was_stopped_need_not_answer_at_the_end(rig):
    run(rig.bus.stopping([PAN.joint_name]))
    rig.pan.answers = False
    assert rig.bus.joint(PAN.joint_name).torque is Torque.OFF_STOPPED
    run(rig.bus.switching_torque(None, False))
    rig.tilt.answers = False  # relaxed, too, but not taken out of the cycle
    problems = rig.bus.relax_at_once(1.0)
    assert problems[TILT.joint_name] and not problems[PAN.joint_name]
    rig.tilt.answers = True
    assert rig.bus.close() == ()


def test_a_stopped_joint_whose_torque_another_program_switched_on_is_not_called_relaxed(rig):
    run(rig.bus.stopping([PAN.joint_name]))
    rig.pan["Torque Enable"] = 1
    rig.pan.ignored = {24}
    with pytest.raises(TorqueError):
        run(rig.bus.switching_torque(None, False))
    assert rig.bus.relax_at_once(1.0)[PAN.joint_name]
    assert rig.bus.close() == (PAN.joint_name,)


def test_no_joint_is_called_relaxed_when_the_adapter_has_gone(rig):
    run(rig.bus.stopping([TILT.joint_name]))
    rig.bench.line.plugged = False
    assert rig.bus.close() == (PAN.joint_name,)


@pytest.mark.parametrize("name", ["AX-12", "XM430-W350", "STS3215"])
def test_a_stopped_joint_that_was_recovered_is_called_relaxed_at_the_end(name):
    servo = SimulatedServo(1, name, boot_time=0.1)
    rig = Rig(servo)
    run(rig.bus.switching_torque(None, True), rig.bench.pass_time)
    servo.overload()
    rig.step(5)
    run(rig.bus.stopping(None), rig.bench.pass_time)
    assert run(rig.bus.recovering(), rig.bench.pass_time) == ("j1",)
    rig.step(25)
    assert rig.bus.close() == ()
    assert rig.torque == [0]


@pytest.mark.parametrize("close", [False, True])
def test_the_watchdog_is_switched_off_with_the_joint(close):
    servo = SimulatedServo(1, "XM430-W350")
    rig = Rig(servo)
    run(rig.bus.switching_torque(None, True))
    assert servo.register("Bus Watchdog") > 0
    if close:
        assert rig.bus.close() == ()
    else:
        run(rig.bus.stopping(None))
    assert servo.register("Bus Watchdog") == 0


@pytest.mark.parametrize("silent", [0, 1, 4, 11])
def test_stop_is_tried_again_where_it_failed(rig, silent):
    loosen(rig)
    assert rig.bus.relax_at_once(1.0)[PAN.joint_name]
    if silent:  # else its cycles miss nothing
        rig.step(silent)
    plug_in(rig)
    rig.step(30 - silent)
    assert rig.torque == [0, 0]


@pytest.mark.parametrize("other", [False, True])
def test_stop_asks_also_a_servo_that_was_lost(rig, other):
    loosen(rig)
    rig.step(10)
    plug_in(rig)
    rig.pan["Firmware Version"] += other  # of another servo
    assert bool(rig.bus.relax_at_once(1.0)[PAN.joint_name]) is other
    assert rig.torque == [0, 0]


@pytest.mark.parametrize("silent", [0, 20])
@pytest.mark.parametrize("lost", [False, True])
@pytest.mark.parametrize("overtaken", [False, True])
def test_a_joint_that_did_not_confirm_when_it_was_stopped_is_relaxed_once_it_answers(
    rig, silent, lost, overtaken
):
    loosen(rig)
    for _ in range(10 * lost):
        rig.bus.step()
    stopping = submit(rig.bus, rig.bus.stopping([PAN.joint_name]))
    if overtaken:
        rig.bus.relax_at_once(0.0)
    while not stopping.done():
        rig.bus.step()
    assert stopping.exception()
    if silent:
        rig.step(silent)
    plug_in(rig)
    reading = rig.step(10)
    assert rig.torque == [0, not overtaken]
    assert rig.bus.joint(PAN.joint_name).torque is Torque.OFF_STOPPED
    assert set(reading.states) == {TILT.joint_name}
    rig.take_log()
    rig.bus.step()
    assert all(packet[1] != 1 for packet in rig.take_log())  # it is left alone
    assert rig.bus.close() == ()


@pytest.mark.parametrize("close", [False, True])
def test_a_servo_that_is_silent_for_a_moment_is_relaxed_by_stop_and_at_the_end(rig, close):
    loosen(rig)
    write, end = rig.bench.line.write, rig.bench.now() + (0.8e9 if close else 0.2e9)

    def plug_in_and_write(data):
        if rig.bench.now() > end:
            plug_in(rig)
        write(data)

    rig.bench.line.write = plug_in_and_write
    if close:
        assert rig.bus.close() == ()
    else:
        assert not any(rig.bus.relax_at_once(0.4).values())
    assert rig.torque == [0, 0]


def test_a_stop_without_time_relaxes_all_the_same(rig):
    rig.pan.mute += [True] * 3
    assert rig.bus.relax_at_once(0.0)[PAN.joint_name]  # not confirmed yet
    assert rig.torque == [0, 0]
    rig.step(6)
    assert rig.bus.joint(PAN.joint_name).confirmed


# An adapter that comes back


@pytest.mark.parametrize("other", [{"Firmware Version": 25}, {"Model Number": 18}])
def test_an_adapter_with_other_servos_is_not_taken_for_the_one_that_went(rig, other):
    rig.bench.line.plugged = False
    rig.bus.step()
    ((name, value),) = other.items()
    before = rig.tilt[name]
    rig.tilt[name] = value  # of another servo with the same id, on another adapter
    rig.bench.line.plugged = True
    rig.take_log()
    assert EventKind.UNUSABLE in rig.passed(100)
    assert not rig.bus.statistics().connected
    assert not writes(rig.take_log())
    rig.tilt[name] = before
    rig.step(100)
    assert rig.bus.statistics().connected


def test_an_adapter_that_comes_back_is_used_to_relax_at_the_end(rig):
    rig.switched_on()
    rig.bench.line.plugged = False
    rig.step(2)
    rig.bench.line.plugged = True  # the bus looks for it five times a second
    assert (rig.bus.close(), rig.torque) == ((), [0, 0])


@pytest.mark.parametrize("on", [False, True])
def test_what_is_asked_while_the_adapter_is_out_fails_and_is_not_done_later(rig, on):
    rig.bench.line.plugged = False
    rig.bus.step()
    rig.bus.relax_at_once(0.1)
    asked = submit(rig.bus, rig.bus.switching_torque(None, on))
    rig.step(20)
    assert isinstance(asked.exception(0.0), TorqueError)
    rig.bench.line.plugged = True
    rig.step(100)
    assert rig.torque == [0, 0]


# Without a running bus

SERVOS = {1: "AX-12", 2: "XM430-W350", 3: "XL-320", 4: "MX-28"}


@pytest.fixture
def left():
    """Servos that a dead program has left with torque on."""
    bench = Bench([SimulatedServo(i, servo_model(name)) for i, name in SERVOS.items()])
    for servo in bench.bus:
        servo.set_register("Goal Position", servo.model.center + servo.model.ticks // 5)
        servo.set_register("Torque Enable", 1)
    return bench


def relaxed(bench: Bench, servos: dict[int, str], *, hold: bool = False) -> dict[int, str]:
    """Relax servos on a bench, or let them hold; return the problems."""
    return relax_servos("x", servos, hold=hold, make_port=lambda *_: bench.port)


def test_servos_are_relaxed_without_a_bus_and_a_missing_one_is_named(left):
    before = left.bus[2].register("Moving Threshold")
    left.bus[2].set_register("Bus Watchdog", 50)  # it would trip, and refuse goals of others
    problems = relaxed(left, {7: "AX-12"} | SERVOS)  # one of them is not there
    assert problems.pop(7) and problems == dict.fromkeys(SERVOS, "")
    assert left.torque == [0, 0, 0, 0]
    assert left.bus[2].register("Moving Threshold") == before
    assert left.bus[2].register("Bus Watchdog") == 0


def test_servos_hold_where_they_stand_without_a_bus(left):
    left.bus[2].set_register("Bus Watchdog", 255)  # it tripped when the program died
    left.bus[4].set_register("Torque Enable", 0)
    left.pass_time(0.15)
    assert not any(relaxed(left, SERVOS, hold=True).values())
    assert left.torque == [1, 1, 1, 0]
    stood = {servo.id: servo.true_ticks for servo in left.bus}
    left.pass_time(3.0)
    for servo in left.bus:
        assert servo.true_ticks == pytest.approx(stood[servo.id], abs=servo.model.ticks / 100)


def test_what_cannot_be_relaxed_raises():
    with pytest.raises(ConfigurationError):
        relax_servos("/dev/none", {1: "AX-13"})
    with pytest.raises(PortMissingError):
        relax_servos("/dev/none", {1: "AX-12"})


def test_an_interrupt_while_joints_brake_does_not_keep_them_from_being_relaxed(rig, monkeypatch):
    def interrupt(_):
        raise KeyboardInterrupt

    monkeypatch.setattr(rig.bus._procedures, "write_goals", interrupt)
    with pytest.raises(KeyboardInterrupt):
        rig.bus.close()
    assert rig.torque == [0, 0]


def test_no_joint_is_called_relaxed_when_closing_fails(rig, monkeypatch):
    errors = []
    thread = BusThread(rig.bus, 100.0, lambda _: None, errors.append)

    def fail(*_, **__):
        raise RuntimeError

    monkeypatch.setattr(thread.bus, "close", fail)
    thread.start()
    thread.stop()
    assert thread.unconfirmed == (PAN.joint_name, TILT.joint_name)
    assert isinstance(errors[0], RuntimeError)
