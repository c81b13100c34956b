"""The thread that owns the bus."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import pytest
from dynamixel_fakes import PAN, TILT, fake_bench
from simulated_device import Bench
from waiting import PATIENCE, wait_for

from head_tracking.dynamixel import (
    BusReading,
    BusStoppedError,
    BusThread,
    Goal,
    PortLostError,
    ServoBus,
)


def made(bench: Bench, *callbacks: Callable[[Any], object], rate: float = 100.0) -> BusThread:
    """Return a thread of a connected bus; callbacks of readings and errors."""
    bus = ServoBus(bench.port, (PAN, TILT))
    bus.connect()
    return BusThread(bus, rate, *(callbacks or (lambda _: None,)))


def started(bench: Bench, *callbacks: Callable[[Any], object], rate: float = 100.0) -> BusThread:
    thread = made(bench, *callbacks, rate=rate)
    thread.start()
    return thread


def test_thread_hands_out_readings_and_measures_itself() -> None:
    readings: list[BusReading] = []
    errors: list[BaseException] = []
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
def test_requests_fail_when_the_thread_has_ended(started: bool) -> None:
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
def test_exception_in_the_callback_relaxes_the_servos_and_is_reported(
    failure: BaseException,
) -> None:
    bench = fake_bench()
    reported: list[tuple[BaseException, int]] = []

    def explode(reading: BusReading) -> None:
        if reading.states["head_pan_joint"].goal is not None:
            raise failure

    def report(error: BaseException) -> None:
        reported.append((error, bench.torque[0]))

    thread = started(bench, explode, report)
    thread.bus.command({"head_pan_joint": Goal(0.5)})
    wait_for(lambda: bool(reported))
    error, torque = reported[0]
    assert torque == 0  # relaxed before the error is reported
    assert error is failure
    assert thread.bus.requests.closed
    thread.stop()


def test_port_that_cannot_come_back_ends_the_thread_and_is_reported() -> None:
    bench = fake_bench()
    bench.port.name = "/dev/pts/99"
    reported: list[BaseException] = []
    thread = started(bench, lambda _: None, reported.append)
    bench.line.plugged = False
    wait_for(lambda: bool(reported))
    assert isinstance(reported[0], PortLostError)
    assert thread.unconfirmed == ("head_pan_joint", "head_tilt_joint")
    thread.stop()


def test_stop_from_the_callback_does_not_wait_for_itself() -> None:
    threads: list[BusThread] = []
    errors: list[BaseException] = []
    thread = made(fake_bench(), lambda reading: threads[0].stop(), errors.append)
    threads.append(thread)
    thread.start()
    wait_for(lambda: thread.bus.requests.closed)
    assert not errors


def test_a_bus_that_is_slow_to_close_is_not_called_hanging(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    release, bench = threading.Event(), fake_bench()
    thread, close = started(bench), bench.port.close
    monkeypatch.setattr(bench.port, "close", lambda: (release.wait(PATIENCE), close()))
    threading.Timer(0.3, release.set).start()
    thread.stop(timeout=0.05)
    assert thread.unconfirmed == () and thread.bus.requests.closed


def test_a_bus_that_is_connected_again_serves_another_thread() -> None:
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
