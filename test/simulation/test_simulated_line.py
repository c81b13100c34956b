"""Times on the wire, in simulated time."""

import pytest
from simulated_packets import InstructionPacket, InstructionPacket2, StatusPacket

from head_tracking.dynamixel.models import servo_model
from head_tracking.simulation import (
    Overlap,
    SerialLine,
    SimulatedBus,
    SimulatedClock,
    SimulatedLine,
    SimulatedServo,
)

READ_1 = InstructionPacket.read(1, 36, 8).encode()
READ_2 = InstructionPacket.read(2, 36, 8).encode()
US = 1_000


def servos(return_delay: int = 0, **options) -> list[SimulatedServo]:
    made = [SimulatedServo(i, **options) for i in (1, 2)]
    for servo in made:
        servo.set_register("Return Delay Time", return_delay // 2)
    return made


def transaction(line: SimulatedLine, clock: SimulatedClock, question: bytes) -> tuple[bytes, float]:
    start = clock()
    line.write(question)
    answer = line.read(100, start + 1.0)
    return answer, (clock() - start) * 1e6


@pytest.mark.parametrize(("delay", "wire"), [(0, 220), (500, 720)])
def test_duration_of_a_read(delay: int, wire: float) -> None:
    clock = SimulatedClock()
    line = SimulatedLine(SimulatedBus(servos(delay)), clock, 1_000_000)
    answer, time = transaction(line, clock, READ_1)
    assert len(answer) == 14
    assert time == pytest.approx(wire)


def test_answers_of_a_sync_read_follow_each_other() -> None:
    made = [SimulatedServo(i, servo_model("XL430-W250")) for i in (1, 2)]
    wire = SerialLine(SimulatedBus(made), paced=True)
    wire.send(InstructionPacket2.sync_read(132, 4, (1, 2)).encode(), 0, 1_000_000)
    first = 160 * US + 500 * US + 150 * US  # question, return delay, answer
    assert wire.due == first
    assert len(wire.receive(first)) == 15
    assert wire.due == first + 500 * US + 150 * US


def test_latency_of_the_adapter() -> None:
    clock = SimulatedClock()
    line = SimulatedLine(SimulatedBus(servos()), clock, latency=0.016)
    for number in (1, 2, 3):
        transaction(line, clock, READ_1)
        assert clock.now == number * 16_000 * US


def test_read_limit_and_discarded_input() -> None:
    clock = SimulatedClock()
    line = SimulatedLine(SimulatedBus(servos()), clock)
    line.write(READ_1)
    assert line.read(4, 1.0) == b"\xff\xff\x01\x0a"
    assert len(line.read(100, 1.0)) == 10
    line.write(READ_1)
    clock.now += 1000 * US
    line.discard_input()
    assert line.read(100, clock() + 0.01) == b""


# Two speakers


def line_of(*made: SimulatedServo, **options) -> tuple[SimulatedLine, SimulatedClock]:
    clock = SimulatedClock(1)
    return SimulatedLine(SimulatedBus(made), clock, **options), clock


def at(clock: SimulatedClock, line: SimulatedLine, microseconds: int, data: bytes) -> None:
    clock.now = 1 + microseconds * US
    line.write(data)


def everything(line: SimulatedLine, clock: SimulatedClock) -> bytes:
    heard = b""
    while more := line.read(1000, clock() + 0.1):
        heard += more
    return heard


def test_a_request_during_a_status_packet_collides() -> None:
    line, clock = line_of(*servos())
    line.write(READ_1)  # heard at 80 us, answered until 220 us
    at(clock, line, 150, READ_2)
    heard = everything(line, clock)
    assert line.overlaps == {Overlap.REQUEST: 1}
    assert len(heard) == 14 and StatusPacket.decode(heard) is None


def test_two_simultaneous_status_packets_collide() -> None:
    made = servos(500)
    made[1].set_register("Return Delay Time", 150)
    line, clock = line_of(*made)
    line.write(READ_1)  # answered from 580 to 720 us
    at(clock, line, 300, READ_2)  # answered from 680 to 820 us
    heard = everything(line, clock)
    assert line.overlaps == {Overlap.STATUS: 1}
    assert StatusPacket.decode(heard[:14]) is None and StatusPacket.decode(heard[-14:]) is None


@pytest.mark.parametrize("paced", [True, False])
def test_equal_answers_of_servos_with_one_id_are_received(paced: bool) -> None:
    line, clock = line_of(
        SimulatedServo(1, position=500), SimulatedServo(1, position=600), paced=paced
    )
    line.write(InstructionPacket.ping(1).encode())
    assert everything(line, clock) == StatusPacket(1).encode()
    assert not line.overlaps
    line.write(READ_1)
    garbled = everything(line, clock)
    assert len(garbled) == 14 and StatusPacket.decode(garbled) is None
    assert line.overlaps == {Overlap.TWINS: 1}


@pytest.mark.parametrize(("pause", "answered"), [(1_000, True), (10_100, False)])
def test_an_interrupted_packet_is_discarded(pause: int, answered: bool) -> None:
    line, clock = line_of(SimulatedServo(1, servo_model("XL430-W250")))
    ping = InstructionPacket2.ping(1).encode()
    line.write(ping[:6])
    clock.now += pause * US
    assert bool(transaction(line, clock, ping[6:])[0]) == answered
    assert transaction(line, clock, ping)[0]
