"""The thread that owns a bus, and several buses as one backend of a loop."""

import math
import threading
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from dynamixel_fakes import PAN, TILT, fake_bench
from simulated_device import Bench
from waiting import PATIENCE, join, wait_for

from head_tracking.control import ControlLoop
from head_tracking.control.dynamixel_backend import DynamixelBackend
from head_tracking.dynamixel import (
    BusEvent,
    BusStoppedError,
    BusThread,
    ConfigurationError,
    EventKind,
    Goal,
    GoalError,
    JointConfiguration,
    PortLostError,
    ServoBus,
    Torque,
)
from head_tracking.dynamixel.exceptions import ServoNotFoundError
from head_tracking.dynamixel.servo import run


def made(bench: Bench, *callbacks: Callable[[Any], object], rate: float = 100.0) -> BusThread:
    """Return a thread of a connected bus; callbacks of readings and errors."""
    bus = ServoBus(bench.port, (PAN, TILT))
    bus.connect()
    return BusThread(bus, rate, *(callbacks or (lambda _: None,)))


def started(bench: Bench, *callbacks: Callable[[Any], object], rate: float = 100.0) -> BusThread:
    thread = made(bench, *callbacks, rate=rate)
    thread.start()
    return thread


def test_thread_hands_out_readings_and_measures_itself():
    readings = []
    errors = []
    thread = started(fake_bench(), readings.append, errors.append, rate=200.0)
    wait_for(lambda: thread.timing.reached_rate > 0.0)
    thread.stop()
    assert thread.bus.requests.closed
    assert len(readings) == thread.bus.statistics().cycles
    timing = thread.timing
    assert timing.update_rate == 200.0
    assert timing.longest_cycle > 0.0
    assert not errors


@pytest.mark.parametrize("started", [False, True])
def test_requests_fail_when_the_thread_has_ended(started):
    bench = fake_bench()
    thread = made(bench)
    waiting = thread.bus.requests.add(lambda: None)
    if started:
        thread.start()
        waiting.result(PATIENCE)
    thread.stop()
    assert not bench.port.is_open
    late = thread.bus.requests.add(lambda: None)
    for future in {late} if started else {late, waiting}:
        assert isinstance(future.exception(PATIENCE), BusStoppedError)


@pytest.mark.parametrize("failure", [RuntimeError("callback"), SystemExit(1)])
def test_exception_in_the_callback_relaxes_the_servos_and_is_reported(failure):
    bench = fake_bench()
    reported = []

    def explode(reading):
        if reading.states["head_pan_joint"].goal is not None:
            raise failure

    def report(error):
        reported.append((error, bench.torque[0]))

    thread = started(bench, explode, report)
    thread.bus.command({"head_pan_joint": Goal(0.5)})
    wait_for(lambda: bool(reported))
    error, torque = reported[0]
    assert torque == 0  # relaxed before the error is reported
    assert error is failure
    assert thread.bus.requests.closed
    thread.stop()


def test_port_that_cannot_come_back_ends_the_thread_and_is_reported():
    bench = fake_bench()
    bench.port.name = "/dev/pts/99"
    reported = []
    thread = started(bench, lambda _: None, reported.append)
    bench.line.plugged = False
    wait_for(lambda: bool(reported))
    assert isinstance(reported[0], PortLostError)
    assert thread.unconfirmed == ("head_pan_joint", "head_tilt_joint")
    thread.stop()


def test_a_bus_that_is_slow_to_close_is_not_called_hanging(monkeypatch):
    release, bench = threading.Event(), fake_bench()
    thread, close = started(bench), bench.port.close
    monkeypatch.setattr(bench.port, "close", lambda: (release.wait(PATIENCE), close()))
    threading.Timer(0.3, release.set).start()
    thread.stop(timeout=0.05)
    assert thread.unconfirmed == () and thread.bus.requests.closed


def test_a_bus_that_is_connected_again_serves_another_thread():
    bench = fake_bench()
    first = made(bench)
    first.stop()
    first.bus.connect()
    thread = BusThread(first.bus, 100.0, lambda _: None)
    thread.start()
    bus = thread.bus
    bus.requests.add(lambda: bus.switching_torque(None, True)).result(PATIENCE)
    thread.stop()
    assert bench.torque == [0, 0]
    assert not bench.port.is_open


# Several buses as one backend of a loop


def make(
    *groups: tuple[JointConfiguration, ...], loop: ControlLoop | None = None, **options: Any
) -> tuple[DynamixelBackend, list[Bench]]:
    """Return a backend with a bus for each group of joints, connected, and their benches."""
    benches = [fake_bench(*(joint.id for joint in joints)) for joints in groups]
    loop = loop or ControlLoop(None)
    buses = [
        ServoBus(bench.port, joints, epoch=loop.owners.epoch)
        for bench, joints in zip(benches, groups, strict=True)
    ]
    backend = DynamixelBackend(buses, loop, 50.0, **options)
    backend.connect()
    return backend, benches


def hold(backend: DynamixelBackend) -> None:
    for thread in backend.threads:
        run(thread.bus.switching_torque(None, True))


def write(backend: DynamixelBackend, **goals: float) -> None:
    backend.write("somebody", {name: Goal(goal) for name, goal in goals.items()}, 0)


def test_goals_that_one_bus_refuses_do_not_stop_the_other():
    reported = []
    buses, benches = make((PAN,), (TILT,), report=lambda subject, _: reported.append(subject))
    write(buses, head_pan_joint=0.1, elbow=0.1)
    buses.threads[0].bus.step()
    assert benches[0].bus[1].register("Torque Enable") == 0
    write(buses, head_pan_joint=0.1, head_tilt_joint=math.nan)
    for _ in range(10):
        buses.threads[0].bus.step()
    assert benches[0].bus[1].register("Goal Position") == PAN.ticks(0.1)
    assert reported == ["somebody", "somebody"]
    buses.close()


def test_request_runs_in_the_thread_of_each_bus_with_its_share():
    buses, benches = make((PAN,), (TILT,))
    buses.start()
    for future in buses.call(None, lambda bus, joints: run(bus.switching_torque(joints, True))):
        future.result(PATIENCE)
    assert all(buses.joint(each.joint_name).torque is Torque.ON for each in (PAN, TILT))
    (future,) = buses.call(["head_tilt_joint"], lambda bus, joints: joints)
    assert future.result(PATIENCE) == ("head_tilt_joint",)
    with pytest.raises(GoalError):
        buses.call(["elbow"], lambda bus, joints: joints)
    assert buses.close() == []
    assert [bench.port.is_open for bench in benches] == [False, False]


@pytest.mark.parametrize(
    ("other", "same_epoch"),
    [
        (replace(TILT, joint_name=PAN.joint_name), True),
        (replace(TILT, controller=PAN.controller), True),
        (TILT, False),  # a STOP of the loop would not overtake it
    ],
)
def test_buses_that_do_not_fit_together_are_refused(other, same_epoch):
    loop = ControlLoop(None)
    epochs = loop.owners.epoch, loop.owners.epoch if same_epoch else None
    buses = [
        ServoBus(fake_bench().port, [joint], epoch=epoch)
        for joint, epoch in zip((PAN, other), epochs, strict=True)
    ]
    with pytest.raises(ConfigurationError):
        DynamixelBackend(buses, loop, 50.0)


def test_of_several_buses_all_are_connected_or_none():
    backend, benches = make((PAN,), (TILT,))
    backend.close()
    benches[1].bus[2].set_register("ID", 9)
    with pytest.raises(ServoNotFoundError):
        backend.connect()
    assert [bench.port.is_open for bench in benches] == [False, False]


@pytest.mark.parametrize("lost", [False, True], ids=["relaxed", "lost"])
def test_a_joint_that_takes_no_goals_is_left_out_of_a_stream_and_that_is_reported(lost):
    reported = []
    backend, (bench,) = make((PAN, TILT), report=lambda subject, _: reported.append(subject))
    bus = backend.threads[0].bus
    if lost:
        bench.bus[2].set_register("ID", 9)
        for _ in range(5):
            bus.step()
    else:
        run(bus.switching_torque(["head_tilt_joint"], False))
    with pytest.raises(GoalError):  # all or none
        bus.command({"head_pan_joint": Goal(0.1), "head_tilt_joint": Goal(0.1)})
    bus.step()
    assert bench.torque == [0, 0]
    write(backend, head_pan_joint=0.1, head_tilt_joint=0.1)
    for _ in range(10):
        bus.step()
    assert bench.torque == [1, 0]
    assert bench.bus[1].register("Goal Position") == PAN.ticks(0.1)
    assert reported == ["head_tilt_joint"]
    write(backend, head_tilt_joint=0.1)
    write(backend, elbow=0.1)
    assert reported[1:] == ["somebody", "somebody"]
    backend.close()


def test_a_joint_that_cannot_hold_is_known_as_stuck_whatever_part_of_the_cycle_finds_out():
    loop = ControlLoop(None)
    backend, _ = make((PAN,), loop=loop)
    refused = BusEvent(EventKind.TORQUE_FAILED, "head_pan_joint", "it cannot hold", stuck=True)
    backend.threads[0].bus.cycle.write = lambda reading: reading._replace(events=(refused,))
    backend.start()
    try:
        wait_for(lambda: loop.stuck)
        assert loop.stuck == {"head_pan_joint": "it cannot hold"}
    finally:
        backend.close()


@pytest.mark.parametrize("failing", [0, 1])
def test_a_stop_that_an_unexpected_error_ends_is_not_called_confirmed(failing, monkeypatch):
    buses, benches = make((PAN,), (TILT,))
    hold(buses)

    def fail(*_, **__):
        raise RuntimeError

    with monkeypatch.context() as patch:
        patch.setattr(benches[failing].port, "sync_write", fail)
        problems = buses.relax_now()
    names = (PAN.joint_name, TILT.joint_name)
    assert problems[names[failing]]
    assert not problems[names[1 - failing]]
    assert benches[1 - failing].torque == [0]
    buses.close()


@pytest.mark.parametrize("other_stop", [False, True])
def test_a_stop_is_carried_out_where_the_port_is_not_free(other_stop):
    buses, benches = make((PAN,), (TILT,))
    hold(buses)
    begun, end = threading.Event(), threading.Event()

    def occupy(_):
        begun.set()
        end.wait(0.1 if other_stop else PATIENCE)  # a while; too long

    other = threading.Thread(target=buses.threads[1].at_once, args=(occupy, PATIENCE))
    other.start()
    assert begun.wait(PATIENCE)
    problems = buses.relax_now(PATIENCE if other_stop else 1.0)
    assert not problems[PAN.joint_name] and bool(problems[TILT.joint_name]) is not other_stop
    end.set()
    join(other)
    for thread in buses.threads:
        thread.bus.step()
    assert [bench.torque for bench in benches] == [[0], [0]]
    assert buses.joint(PAN.joint_name).torque is Torque.OFF_UNTIL_COMMANDED


def test_all_buses_are_stopped_and_relaxed_though_one_hangs():
    hanging, release = threading.Event(), threading.Event()

    def on_reading(bus, reading):
        pan = reading.states.get("head_pan_joint")
        if pan is not None and pan.goal is not None:
            hanging.set()
            release.wait(PATIENCE)

    buses, benches = make((PAN,), (TILT,), on_reading=on_reading)
    try:
        buses.start()

        def hangs():
            write(buses, head_pan_joint=0.2, head_tilt_joint=0.2)
            return hanging.is_set() and bool(benches[1].bus[2].register("Torque Enable"))

        wait_for(hangs)
        assert len(buses.close()) == 1
        assert [bench.torque for bench in benches] == [[0], [0]]
        assert not any(bench.port.is_open for bench in benches)
    finally:
        release.set()
