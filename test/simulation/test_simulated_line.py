"""Times on the wire, in simulated time, and what goes wrong on it."""

from random import Random

import pytest

from head_tracking.dynamixel.models import servo_model
from head_tracking.dynamixel.protocol import Instruction, encode_packet, read_packet
from head_tracking.simulation import (
    Answer,
    Fault,
    Faults,
    Overlap,
    SimulatedBus,
    SimulatedClock,
    SimulatedLine,
    SimulatedServo,
)
from head_tracking.simulation.packets import Status, decode_status, encode_status

READ_1, READ_2 = (read_packet(1, servo_id, 36, 8) for servo_id in (1, 2))
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
def test_duration_of_a_read(delay, wire):
    clock = SimulatedClock()
    line = SimulatedLine(SimulatedBus(servos(delay)), clock, 1_000_000)
    answer, time = transaction(line, clock, READ_1)
    assert len(answer) == 14
    assert time == pytest.approx(wire)


def test_latency_of_the_adapter():
    clock = SimulatedClock()
    line = SimulatedLine(SimulatedBus(servos()), clock, latency=0.016)
    for number in (1, 2, 3):
        transaction(line, clock, READ_1)
        assert clock.now == number * 16_000 * US


def test_read_limit_and_discarded_input():
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


def test_a_request_during_a_status_packet_collides():
    line, clock = line_of(*servos())
    line.write(READ_1)  # heard at 80 us, answered until 220 us
    at(clock, line, 150, READ_2)
    heard = everything(line, clock)
    assert line.overlaps == {Overlap.REQUEST: 1}
    assert len(heard) == 14 and decode_status(1, heard) is None


def test_two_simultaneous_status_packets_collide():
    made = servos(500)
    made[1].set_register("Return Delay Time", 150)
    line, clock = line_of(*made)
    line.write(READ_1)  # answered from 580 to 720 us
    at(clock, line, 300, READ_2)  # answered from 680 to 820 us
    heard = everything(line, clock)
    assert line.overlaps == {Overlap.STATUS: 1}
    assert decode_status(1, heard[:14]) is None and decode_status(1, heard[-14:]) is None


@pytest.mark.parametrize("paced", [True, False])
def test_equal_answers_of_servos_with_one_id_are_received(paced):
    line, clock = line_of(
        SimulatedServo(1, position=500), SimulatedServo(1, position=600), paced=paced
    )
    line.write(encode_packet(1, 1, Instruction.PING))
    assert everything(line, clock) == encode_status(1, Status(1, 0))
    assert not line.overlaps
    line.write(READ_1)
    garbled = everything(line, clock)
    assert len(garbled) == 14 and decode_status(1, garbled) is None
    assert line.overlaps == {Overlap.TWINS: 1}


@pytest.mark.parametrize(("pause", "answered"), [(1_000, True), (10_100, False)])
def test_an_interrupted_packet_is_discarded(pause, answered):
    line, clock = line_of(SimulatedServo(1, servo_model("XL430-W250")))
    ping = encode_packet(2, 1, Instruction.PING)
    line.write(ping[:6])
    clock.now += pause * US
    assert bool(transaction(line, clock, ping[6:])[0]) == answered
    assert transaction(line, clock, ping)[0]


# What goes wrong on purpose

MS = 1_000 * US
ANSWER = Answer(encode_status(1, Status(1, 0, b"\x00\x02")), 500_000)
READ = read_packet(1, 1, 36, 2)


def one(kind: Fault, **options) -> Faults:
    return Faults(Random(1), 1.0, [kind], **options)


def spoilt(kind: Fault) -> list[Answer]:
    return list(one(kind).answer(ANSWER))


def test_faults_of_answers():
    assert spoilt(Fault.DROP) == []
    (corrupt,) = spoilt(Fault.CORRUPT)
    assert sum(a != b for a, b in zip(corrupt.data, ANSWER.data, strict=True)) == 1
    (cut,) = spoilt(Fault.TRUNCATE)
    assert ANSWER.data.startswith(cut.data) and len(cut.data) < len(ANSWER.data)
    (late,) = spoilt(Fault.DELAY)
    assert late.data == ANSWER.data and 10 * MS <= late.late <= 100 * MS
    (stalled,) = spoilt(Fault.STALL)
    assert stalled.delay == ANSWER.delay and 10 * MS <= stalled.stalled <= 100 * MS
    (twice,) = spoilt(Fault.DUPLICATE)
    assert twice.data == 2 * ANSWER.data
    (foreign,) = spoilt(Fault.FOREIGN)
    assert foreign.data.endswith(ANSWER.data)
    stranger = decode_status(1, foreign.data[: -len(ANSWER.data)])
    assert stranger is not None and stranger.id != 1
    (noisy,) = spoilt(Fault.GARBAGE)
    assert noisy.data.endswith(ANSWER.data) and len(noisy.data) > len(ANSWER.data)


def test_faults_of_requests():
    def answers(kind):
        faults = one(kind)
        bus = SimulatedBus([SimulatedServo(1)], faults=faults)
        return [answer.data for answer in bus.receive(READ, 0)]

    assert answers(Fault.ECHO) == [READ, ANSWER.data]
    assert answers(Fault.DEAFNESS) == []
    assert answers(Fault.MISHEARING) != [ANSWER.data]


def test_power_loss_ends():
    faults = one(Fault.POWER_LOSS, pause=(0.5, 0.5))
    bus = SimulatedBus([SimulatedServo(1, boot_time=0.1)], faults=faults)
    assert bus.receive(READ, 0) == []
    faults.rate = 0.0
    assert faults.trouble
    assert bus.receive(READ, 400 * MS) == []
    assert bus.receive(READ, 500 * MS) == []  # it boots
    assert not faults.trouble
    assert len(bus.receive(READ, 700 * MS)) == 1


@pytest.mark.parametrize("model", ["AX-12", "XM430-W350"])
@pytest.mark.parametrize("kind", [Fault.LOW_VOLTAGE, Fault.OVERLOAD, Fault.OVERHEATING])
def test_faults_of_servos(kind, model):
    faults = one(kind, pause=(0.5, 0.5))
    servo = SimulatedServo(1, servo_model(model))
    bus = SimulatedBus([servo], faults=faults)
    ping = encode_packet(servo.model.protocol, 1, Instruction.PING)
    bus.receive(ping, 0)
    assert servo.alarms.active
    faults.rate = 0.0
    bus.receive(ping, 1000 * MS)
    if kind is Fault.LOW_VOLTAGE:
        assert not servo.alarms.active
    elif servo.model.protocol == 2 or kind is Fault.OVERLOAD:
        assert servo.alarms.active


def test_same_seed_same_faults_and_all_kinds_occur():
    def run(seed):
        faults = Faults(Random(seed), 0.3)
        bus = SimulatedBus([SimulatedServo(1), SimulatedServo(2)], faults=faults)
        seen = []
        for number in range(1000):
            seen += [answer.data for answer in bus.receive(READ, number * 10 * MS)]
        return faults, seen

    first, seen = run(1)
    assert run(1)[1] == seen
    assert run(2)[1] != seen
    assert set(first.counts) == set(Fault)
