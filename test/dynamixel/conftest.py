from __future__ import annotations

import pytest
from dynamixel_fakes import PAN, TILT, FakeClock, FakePort

from head_tracking.dynamixel import ServoBus


@pytest.fixture
def port() -> FakePort:
    return FakePort()


@pytest.fixture
def clock() -> FakeClock:
    return FakeClock()


@pytest.fixture
def bus(port: FakePort, clock: FakeClock) -> ServoBus:
    """A connected bus with a fake port and passed-in time."""
    bus = ServoBus(port, (PAN, TILT), clock, monotonic=clock)  # type: ignore[arg-type]
    bus.connect()
    port.take_log()
    return bus
