"""Nobody loses control of a servo: black boxes, simulated servos on a simulated line."""

import sys
from collections import Counter
from contextlib import suppress
from types import FrameType
from typing import Any

import pytest
from dynamixel_fakes import submit
from simulated_device import PERIOD, Rig

from head_tracking.dynamixel import (
    BusSettings,
    ConfigurationError,
    CorruptReplyError,
    EepromSettings,
    EventKind,
    Goal,
    GoalError,
    Health,
    ServoError,
    Symptom,
    Torque,
    TorqueError,
    servo_model,
)
from head_tracking.dynamixel.servo import run
from head_tracking.simulation import SimulatedServo

MODELS = ["AX-12", "XM430-W350", "STS3215"]


# A fault is a fact, whatever else is asked of the joint


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("between", ["stop", "relax, stop", "torque on"])
def test_a_shut_down_servo_is_recovered_whatever_was_asked_of_it_before(name, between):
    rig = Rig(SimulatedServo(1, servo_model(name), boot_time=0.25))
    rig.go(0.3)
    rig.servos[0].overload()
    rig.step(5)
    assert (rig.bus.joint("j1").torque, rig.torque) == (Torque.OFF_BY_FAULT, [0])
    assert rig.bus.statistics().servos[0].health is Health.FAULTED
    assert rig.kinds.count(EventKind.FAULTED) == 1
    if "relax" in between:
        run(rig.bus.switching_torque(None, False))
        rig.step(3)
    if "stop" in between:
        run(rig.bus.stopping(None))
        rig.step(3)
        starting = submit(rig.bus, rig.bus.starting(None))
        rig.step(10)
        starting.result(0.0)
    if between == "torque on":
        with pytest.raises(ServoError, match="shut down"):
            run(rig.bus.switching_torque(None, True))
    with pytest.raises(GoalError, match="recover"):
        rig.bus.command({"j1": Goal(0.0)})
    assert run(rig.bus.recovering()) == ("j1",)
    rig.step(20)
    assert EventKind.SYMPTOM not in rig.kinds  # its line is not disturbed while it restarts
    if "relax" in between:
        assert rig.bus.joint("j1").torque is Torque.OFF_ON_REQUEST  # a fact of its own
        run(rig.bus.switching_torque(None, True))
    assert rig.go(-0.2).states["j1"].position == pytest.approx(-0.2, abs=0.05)


@pytest.mark.parametrize("name", MODELS)
def test_a_servo_that_shut_down_while_its_cable_was_out_is_relaxed_when_it_returns(name):
    servo = SimulatedServo(1, servo_model(name))
    rig = Rig(servo)
    rig.go(0.3)
    servo.set_register("ID", 91)
    servo.overload()
    rig.step(20)
    assert rig.bus.joint("j1").torque is Torque.OFF_UNTIL_COMMANDED
    servo.set_register("ID", 1)
    rig.step(20)
    assert rig.bus.joint("j1").torque is Torque.OFF_BY_FAULT
    assert rig.torque == [0]


def test_a_servo_found_shut_down_at_the_start_takes_no_commands_until_it_is_recovered():
    servo = SimulatedServo(1)
    servo.overload()
    servo.set_register("Torque Limit", 0)
    rig = Rig(servo)
    rig.step()
    assert EventKind.FAULTED in rig.kinds and EventKind.ALARM in rig.kinds  # why
    with pytest.raises(GoalError, match="recover"):
        rig.bus.command({"j1": Goal(0.1)})
    run(rig.bus.recovering())
    assert rig.go(0.2).states["j1"].position == pytest.approx(0.2, abs=0.03)


@pytest.mark.parametrize("name", MODELS)
def test_a_head_that_still_moves_when_it_is_resumed_does_not_return_to_where_it_was(name):
    rig = Rig(SimulatedServo(1, servo_model(name)))
    rig.go(-0.6)
    rig.go(0.6, 10)
    rig.bus.relax_at_once(1.0)
    on = submit(rig.bus, rig.bus.switching_torque(None, True))
    while not on.done():
        rig.step()
    before = rig.step(5).states["j1"].position
    assert rig.step(100).states["j1"].position == pytest.approx(before, abs=0.012)


@pytest.mark.parametrize(
    ("name", "register", "value"),
    [
        ("AX-12", "CCW Angle Limit", 0),
        ("XM430-W350", "Operating Mode", 1),
        ("XM430-W350", "Drive Mode", 1),
        ("XM430-W350", "Homing Offset", 1),
        ("XM430-W350", "Startup Configuration", 1),
        ("XM540-W270", "Drive Mode", 2),
        ("MX-106", "Drive Mode", 2),
        ("MX-64", "Torque Ctrl Mode Enable", 1),
        ("STS3215", "Operating Mode", 1),
        ("STS3215", "Position Offset", 1),
    ],
)
def test_torque_stays_off_in_a_servo_that_another_program_has_set_up_anew(name, register, value):
    servo = SimulatedServo(1, name)
    rig = Rig(servo)
    right = servo.register(register)
    servo.set_register(register, value)  # by another program, while it is relaxed
    before = servo.true_position
    rig.go(0.3)
    assert rig.torque == [0] and servo.true_position == pytest.approx(before, abs=0.01)
    with pytest.raises(TorqueError):
        run(rig.bus.switching_torque(None, True))
    run(rig.bus.stopping(None))
    with pytest.raises(ServoError):
        run(rig.bus.starting(None), rig.bench.pass_time)
    servo.set_register(register, right)
    rig.step(20)
    assert rig.go(0.3).states["j1"].position == pytest.approx(0.3, abs=0.03)


@pytest.mark.parametrize(
    "name", ["AX-12", "XM430-W350", "XL430-W250", "XL330-M288", "XL-320", "STS3215"]
)
def test_default_memory_settings_keep_the_protection_that_a_servo_has(name):
    rig = Rig(SimulatedServo(1, servo_model(name)))
    before = rig.servos[0].register("Shutdown")
    changed = run(rig.bus.writing_eeprom("j1", EepromSettings()), rig.bench.pass_time)
    assert "Return Delay Time" in changed[1]
    assert rig.servos[0].register("Shutdown") == before


# Relaxing waits for nobody


def test_relaxing_is_done_in_the_cycle_it_is_asked_for_whatever_is_under_way():
    xm = servo_model("XM430-W350")
    rig = Rig(*(SimulatedServo(i, xm, boot_time=1.0) for i in (1, 2, 3)))
    for _ in range(40):
        rig.bus.command({"j1": Goal(0.3), "j2": Goal(0.3)})
        rig.step()
    assert rig.torque == [1, 1, 0]
    rig.servos[0].overload()
    rig.step(5)
    recovering = submit(rig.bus, rig.bus.recovering(["j1"], 3.0))
    writing = submit(rig.bus, rig.bus.writing_eeprom("j3", EepromSettings()))
    on = submit(rig.bus, rig.bus.switching_torque(["j3"], True))
    rig.step(2)
    assert not (recovering.done() or writing.done() or on.done())
    relaxing = [submit(rig.bus, rig.bus.switching_torque(None, False)) for _ in range(3)]
    rig.step()
    assert rig.torque[1:] == [0, 0]
    rig.step(10)
    assert all(future.done() for future in relaxing)
    assert "j2" not in str(relaxing[1].exception())  # j1 restarts and cannot confirm
    assert not recovering.done()
    rig.step(100)
    assert recovering.result() == ("j1",)
    assert rig.torque == [0, 0, 0]
    assert rig.bus.joint("j1").torque is Torque.OFF_ON_REQUEST


@pytest.mark.parametrize("cycles", [1, 4, 7])
def test_an_adapter_that_goes_before_torque_comes_on_does_not_block_the_joint(cycles):
    rig = Rig(SimulatedServo(1), SimulatedServo(2))
    for _ in range(3):  # keep the steps of the goal waiting
        submit(rig.bus, rig.bus.writing_eeprom("j2", EepromSettings()))
    rig.step()
    rig.bus.command({"j1": Goal(0.2)})
    rig.step(cycles)
    rig.bench.line.plugged = False
    rig.step(3)
    rig.bench.line.plugged = True
    rig.step(60)
    assert rig.go(0.3).states["j1"].position == pytest.approx(0.3, abs=0.03)


# Stopping


@pytest.mark.parametrize("name", MODELS)
def test_closing_brakes_before_it_relaxes(name):
    model = servo_model(name)
    servo = SimulatedServo(1, model, position=model.ticks // 4)
    rig = Rig(servo)
    run(rig.bus.switching_torque(None, True))
    for _ in range(200):
        rig.bus.command({"j1": Goal(1.3, model.no_load_speed)})
        rig.step()
        if servo.drive.speed > 0.8 * model.no_load_speed:
            break
    before = servo.true_position
    assert rig.bus.close() == ()
    for _ in range(100):
        rig.bench.pass_time(PERIOD)
    assert rig.torque == [0]
    assert abs(servo.true_position - before) < 0.35  # 20 degrees; 141 without braking


def test_a_servo_whose_firmware_has_no_watchdog_works_without_and_that_is_told():
    rig = Rig(SimulatedServo(1, servo_model("XM430-W350"), firmware=37))
    assert rig.go(0.2).states["j1"].position == pytest.approx(0.2, abs=0.02)
    assert EventKind.ALARM in rig.kinds
    assert rig.bus.close() == ()


# Limits


def test_limits_that_would_turn_a_joint_round_are_refused_while_it_runs():
    rig = Rig(SimulatedServo(1))
    rig.go(0.2)
    with pytest.raises(ConfigurationError, match="direction"):
        rig.bus.joint("j1").reconfigure(lowest=768, highest=256)
    reading = rig.go(0.3)
    assert reading.states["j1"].position == pytest.approx(0.3, abs=0.03)


# What one cycle may take


@pytest.mark.parametrize(
    ("name", "baud_rate", "latency"),
    [
        ("AX-12", 1_000_000, 0.0),
        ("AX-12", 57_600, 0.016),
        ("XM430-W350", 1_000_000, 0.0),
        ("STS3215", 57_600, 0.016),
    ],
)
def test_no_cycle_takes_much_longer_while_a_servo_returns(name, baud_rate, latency):
    model = servo_model(name)
    servos = [SimulatedServo(i, model, boot_time=0.0) for i in (1, 2)]
    rig = Rig(*servos, baud_rate=baud_rate, latency=latency)

    def cycle():
        rig.bench.pass_time(0.0507)
        begin = rig.bench.now()
        rig.bus.command({"j2": Goal(0.2)})
        with suppress(GoalError):
            rig.bus.command({"j1": Goal(0.2)})
        rig.step()
        return (rig.bench.now() - begin) * 1e-9 - PERIOD

    requests = 2 if name == "AX-12" else 1  # each may take a period of the adapter
    usual = max(requests * latency, *[cycle() for _ in range(80)][40:])
    servos[0].power_off()
    for _ in range(20):
        cycle()
    servos[0].power_on()
    longest = 0.0
    before = servos[1].register("Goal Position")
    for _ in range(80):
        longest = max(longest, cycle())
    assert rig.bus.joint("j1").torque is Torque.ON
    assert servos[1].register("Goal Position") == before
    assert longest <= 1.7 * usual + latency / 16  # whole periods of the adapter


@pytest.mark.parametrize("count", [2, 3])
@pytest.mark.parametrize("name", MODELS)
def test_torque_comes_on_while_another_servo_is_lost_behind_a_slow_adapter(name, count):
    servos = [SimulatedServo(i, servo_model(name)) for i in range(1, count + 1)]
    rig = Rig(*servos, latency=0.016, baud_rate=57_600)
    servos[-1].power_off()
    rig.step(40)
    on = submit(rig.bus, rig.bus.switching_torque(["j1"], True))
    rig.step(60)
    assert on.exception(0.0) is None


def test_asking_lost_servos_takes_at_most_half_of_the_time_of_switching_torque_on():
    """Behind a slow adapter, where each question takes longer than a cycle."""
    rig = Rig(*[SimulatedServo(i, servo_model("XM430-W350")) for i in range(1, 8)], latency=0.016)
    for servo in rig.servos[4:]:
        servo.power_off()
    rig.step(40)
    before = rig.bench.now()
    on = submit(rig.bus, rig.bus.switching_torque(["j1", "j2", "j3", "j4"], True))
    while not on.done():
        rig.step()
    assert on.exception() is None
    assert rig.bench.now() - before < 2_000_000_000


def test_many_servos_behind_a_slow_adapter_move_though_a_cycle_takes_long():
    servos = [SimulatedServo(i, boot_time=0.1) for i in range(1, 15)]
    rig = Rig(*servos, latency=0.016, connect=False)
    rig.bus.connect()
    rig.bus.step()  # at once
    assert rig.go(0.3, 30).states["j1"].position == pytest.approx(0.3, abs=0.03)
    for happens in (servos[0].power_off, servos[0].power_on):  # while the bus stands still
        happens()
        rig.bench.pass_time(0.5)
    rig.step(3)
    assert rig.bus.joint("j1").torque is Torque.OFF_UNTIL_COMMANDED


@pytest.mark.parametrize("returning", [12, 14])
def test_each_of_several_lost_servos_is_asked_though_cycles_take_long(returning):
    rig = Rig(*[SimulatedServo(i, boot_time=0.0) for i in range(1, 15)], latency=0.016)
    for servo in rig.servos[11:]:
        servo.power_off()
    rig.step(20)
    rig.servos[returning - 1].power_on()
    rig.step(8)
    assert not rig.bus.joint(f"j{returning}").lost


def test_many_servos_behind_a_slow_adapter_confirm_at_the_end():
    model = servo_model("XM430-W350")
    rig = Rig(*[SimulatedServo(i, model) for i in range(1, 15)], latency=0.016)
    on = submit(rig.bus, rig.bus.switching_torque(None, True))
    while not on.done():
        rig.step()
    assert set(rig.torque) == {1}
    assert rig.bus.close() == ()


@pytest.mark.parametrize("where", ["read", "write"])
def test_a_pause_of_the_process_within_a_cycle_is_noticed_at_once(where):
    settings = BusSettings(watchdog=0.2)
    rig = Rig(SimulatedServo(1, servo_model("XM430-W350")), settings=settings)
    rig.go(0.2)
    line, pauses = rig.bench.line, [2.0]
    original = getattr(line, where)

    def late(*arguments):
        if pauses:
            rig.bench.pass_time(pauses.pop())
        return original(*arguments)

    setattr(line, where, late)
    rig.step(3)
    assert not pauses
    assert [event.text for event in rig.events if event.kind is EventKind.HELD] == [
        "j1 (id 1): the bus stood still for 2.0 s; it holds its present position"
    ]


def test_a_long_cycle_is_no_pause():
    rig = Rig(*[SimulatedServo(i) for i in range(1, 15)], latency=0.016)
    before = rig.bench.now()
    rig.step()
    usual = rig.bench.now() - before
    rig.bus.requests.add(lambda: rig.bus.switching_torque(None, True))
    rig.bus.requests.begin_next()
    for _ in range(10):
        before = rig.bench.now()
        rig.step()
        assert rig.bench.now() - before < 2.3 * usual


@pytest.mark.parametrize(("name", "pause"), [("AX-12", 0.9), ("XM430-W350", 3.0), ("STS3215", 0.9)])
def test_power_that_went_while_the_bus_stood_still_leaves_the_joint_relaxed(name, pause):
    servo = SimulatedServo(1, name, boot_time=0.1)
    rig = Rig(servo)
    rig.go(0.5)
    for happens in (
        servo.power_off,
        servo.power_on,
        lambda: servo.lead(servo.model.center - 150, 0.1, 50.0),
    ):
        happens()
        rig.bench.pass_time(pause / 3)
    left_at = servo.true_position
    rig.step(30)
    assert rig.torque == [0]
    assert rig.bus.joint("j1").torque is Torque.OFF_UNTIL_COMMANDED
    assert servo.true_position == pytest.approx(left_at, abs=0.02)


@pytest.mark.parametrize("name", MODELS)
def test_a_joint_that_kept_its_torque_goes_on_after_the_bus_stood_still(name):
    rig = Rig(SimulatedServo(1, name))
    rig.go(0.5)
    rig.bench.pass_time(0.6)
    rig.step(10)
    assert rig.torque == [1] and rig.bus.joint("j1").torque is Torque.ON
    rig.go(0.2)
    assert rig.reading.states["j1"].position == pytest.approx(0.2, abs=0.03)


@pytest.mark.parametrize("stop", [False, True])
@pytest.mark.parametrize("name", MODELS)
def test_torque_that_another_program_switches_on_is_switched_off_and_named(name, stop):
    rig = Rig(*(SimulatedServo(i, servo_model(name)) for i in (1, 2, 3)))
    rig.go(0.3)
    if stop:
        rig.bus.relax_at_once(1.0)
    rig.servos[1].set_register("Torque Enable", 1)
    rig.step(15)
    assert rig.torque == [not stop, 0, 0]
    assert [s.id for s in rig.bus.statistics().servos if Symptom.OVERRULED in s.symptoms] == [2]
    assert rig.bus.joint("j2").confirmed
    rig.step(60)
    assert not rig.bus.statistics().servos[1].symptoms


def test_torque_that_another_program_switches_off_is_reported_though_nothing_moves():
    rig = Rig(*(SimulatedServo(i, "XM430-W350") for i in (1, 2)))
    rig.go(0.3)
    rig.servos[0].set_register("Torque Enable", 0)
    rig.step(20)
    assert rig.bus.joint("j1").torque is Torque.OFF_UNTIL_COMMANDED
    assert EventKind.TORQUE_LOST in rig.kinds
    assert rig.go(0.1).states["j1"].position == pytest.approx(0.1, abs=0.03)


# Who is there


def test_two_servos_with_one_id_are_suspected_at_the_start():
    rig = Rig(SimulatedServo(1, position=300), SimulatedServo(1, position=700), connect=False)
    with pytest.raises(CorruptReplyError):
        rig.bus.connect()


def test_two_servos_with_one_id_are_reported_once():
    twins = SimulatedServo(1, position=512), SimulatedServo(1, position=512)
    rig = Rig(*twins, SimulatedServo(2))
    rig.step(20)
    twins[1].lead(600.0, 0.2)  # somebody turns one of them
    for _ in range(600):  # 12 s
        with suppress(GoalError):
            rig.bus.command({"j1": Goal(0.1), "j2": Goal(0.1)})
        rig.step()
    told = [event for event in rig.events if "two servos answer as id 1" in event.text]
    assert 1 <= len(told) <= 2, told  # the second says that it comes and goes
    assert rig.kinds.count(EventKind.TORQUE_ON) <= 3
    assert "j2" in rig.step().states


def test_an_event_that_repeats_is_logged_twice_and_again_after_a_while():
    rig = Rig(SimulatedServo(1), SimulatedServo(2))
    for _ in range(3):
        for switch in (rig.servos[0].power_off, rig.servos[0].power_on):
            switch()
            rig.step(50)  # 1 s
    assert rig.kinds.count(EventKind.LOST) == rig.kinds.count(EventKind.RETURNED) == 2
    rig.step(1550)  # 31 s
    rig.servos[0].power_off()
    rig.step(50)
    assert rig.kinds.count(EventKind.LOST) == 3


@pytest.mark.parametrize(("name", "between"), zip(MODELS, range(3), strict=True))
def test_torque_that_is_asked_for_while_relaxing_is_confirmed_stays_on(name, between):
    rig = Rig(*(SimulatedServo(i, servo_model(name)) for i in range(1, 9)))
    run(rig.bus.switching_torque(None, True))
    rig.step()
    relaxed = submit(rig.bus, rig.bus.switching_torque(None, False))
    rig.step(between)
    held = submit(rig.bus, rig.bus.switching_torque(["j8"], True))
    rig.step(40)
    assert relaxed.done() and held.exception(0) is None
    assert rig.torque == [0] * 7 + [1]
    assert rig.bus.joint("j8").torque is Torque.ON


# What a cycle without trouble costs, in calls of Python functions of the driver


def calls(name: str) -> Counter[str]:
    """By function: the calls of one cycle of two servos, from the command to the states.

    Several replies arrive in one chunk, as from an adapter with a latency timer.
    """
    rig = Rig(*(SimulatedServo(i, name) for i in (1, 2)), latency=0.004)
    for _ in range(60):
        rig.bus.command({"j1": Goal(0.1, 1.0), "j2": Goal(-0.1, 1.0)})
        rig.step()
    counted: Counter[str] = Counter()

    def cycle(number: int) -> Counter[str]:
        counted.clear()
        goals = {"j1": Goal(0.2, 1.0 + number), "j2": Goal(-0.2, 1.0)}
        sys.setprofile(count)
        try:
            rig.bus.command(goals)
            reading = rig.bus.step()
        finally:
            sys.setprofile(None)
        assert set(reading.states) == {"j1", "j2"}
        return Counter(counted)

    def count(frame: FrameType, event: str, argument: Any) -> None:
        code = frame.f_code
        if event == "call" and "/head_tracking/dynamixel/" in code.co_filename:
            counted[f"{code.co_filename.rsplit('/', 1)[-1]}:{code.co_name}"] += 1

    return min(map(cycle, range(3)), key=Counter.total)  # one may ask a servo for its torque


@pytest.mark.parametrize("name", ["AX-12", "MX-28", "XM430-W350", "XL-320", "STS3215", "SCS0009"])
def test_a_cycle_without_trouble_takes_few_calls(name):
    counted = calls(name)
    assert counted.total() <= 60, counted
    assert not counted["protocol.py:find_packet"]  # only for unusual bytes
