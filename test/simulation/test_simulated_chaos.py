"""Masters that do anything at any time, on a line where anything happens: against simple truths."""

from __future__ import annotations

from random import Random

from hypothesis import given, settings
from hypothesis import strategies as st
from simulated_packets import InstructionPacket, InstructionPacket2, StatusPacket, StatusPacket2

from head_tracking.dynamixel.models import servo_model
from head_tracking.simulation import (
    Faults,
    SerialLine,
    SimulatedBus,
    SimulatedServo,
)

XM430 = servo_model("XM430-W350")
SECOND = 1_000_000_000
PING_1, PING_2 = InstructionPacket.ping(1).encode(), InstructionPacket2.ping(2).encode()
PACKETS = (
    PING_1,
    PING_2,
    InstructionPacket.read(1, 36, 8).encode(),
    InstructionPacket.sync_write(30, {1: b"\x00\x02\x64\x00"}).encode(),
    InstructionPacket.write(1, 24, b"\x01").encode(),
    InstructionPacket2.read(2, 126, 21).encode(),
    InstructionPacket2.sync_read(132, 4, (2, 3)).encode(),
    InstructionPacket2.sync_read(0, 600, (2, 3)).encode(),
    InstructionPacket2.write(2, 98, b"\x02").encode(),
    InstructionPacket2.write(2, 64, b"\x01").encode(),
    InstructionPacket2.reboot(3).encode(),
    InstructionPacket2.ping().encode(),
)
SENT = st.one_of(st.sampled_from(PACKETS), st.binary(max_size=30), st.just(PACKETS[0][:5]))
PAUSES = st.one_of(st.integers(0, 2_000_000), st.sampled_from((0, 20_000_000, SECOND)))
STEPS = st.lists(st.tuples(SENT, PAUSES), max_size=25)


def servos() -> list[SimulatedServo]:
    return [SimulatedServo(1), SimulatedServo(2, XM430), SimulatedServo(3, XM430)]


@settings(max_examples=40)
@given(
    STEPS,
    st.sampled_from((9_600, 57_600, 1_000_000, 4_500_000)),
    st.booleans(),
    st.sampled_from((0, 1_000_000, 16_000_000)),
    st.integers(0, 2**32),
    st.sampled_from((0.0, 0.3)),
)
def test_the_line_recovers_from_any_sequence_of_faults(
    steps: list[tuple[bytes, int]],
    baud_rate: int,
    paced: bool,
    latency: int,
    seed: int,
    rate: float,
) -> None:
    faults = Faults(Random(seed), rate, late=(0.001, 0.05), pause=(0.01, 0.1))
    bus = SimulatedBus(servos(), faults=faults)
    line = SerialLine(bus, paced=paced, latency=latency)
    now = 1
    for data, pause in steps:
        line.send(data, now, baud_rate)
        now += pause
        if line.due is not None and line.due <= now:
            line.receive(now)
            assert line.due is None or line.due > now
    faults.rate = 0.0
    for _ in range(2):  # the first ends troubles of servos, and of those that begin to boot
        now += 2 * SECOND
        line.receive(now)
        assert line.due is None
        line.send(b"\x00", now, baud_rate)
    for ping, kind in ((PING_1, StatusPacket), (PING_2, StatusPacket2)):
        now += 2 * SECOND
        line.send(ping, now, baud_rate)
        status = kind.decode(line.receive(now + SECOND))
        assert status is not None and status.id in (1, 2)
