"""What goes wrong on purpose."""

from random import Random

import pytest
from simulated_packets import InstructionPacket, InstructionPacket2, StatusPacket

from head_tracking.dynamixel.models import servo_model
from head_tracking.simulation import (
    Answer,
    Fault,
    Faults,
    SimulatedBus,
    SimulatedServo,
)

MS = 1_000_000
SECOND = 1000 * MS
ANSWER = Answer(StatusPacket(1, data=b"\x00\x02").encode(), 500_000)
READ = InstructionPacket.read(1, 36, 2).encode()


def one(kind: Fault, **options) -> Faults:
    return Faults(Random(1), 1.0, [kind], **options)


def spoilt(kind: Fault) -> list[Answer]:
    return list(one(kind).answer(ANSWER))


def test_faults_of_answers() -> None:
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
    stranger = StatusPacket.decode(foreign.data[: -len(ANSWER.data)])
    assert stranger is not None and stranger.id != 1
    (noisy,) = spoilt(Fault.GARBAGE)
    assert noisy.data.endswith(ANSWER.data) and len(noisy.data) > len(ANSWER.data)


def test_faults_of_requests() -> None:
    def answers(kind: Fault) -> list[bytes]:
        faults = one(kind)
        bus = SimulatedBus([SimulatedServo(1)], faults=faults)
        return [answer.data for answer in bus.receive(READ, 0)]

    assert answers(Fault.ECHO) == [READ, ANSWER.data]
    assert answers(Fault.DEAFNESS) == []
    assert answers(Fault.MISHEARING) != [ANSWER.data]


def test_power_loss_ends() -> None:
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
def test_faults_of_servos(kind: Fault, model: str) -> None:
    faults = one(kind, pause=(0.5, 0.5))
    servo = SimulatedServo(1, servo_model(model))
    bus = SimulatedBus([servo], faults=faults)
    packet = InstructionPacket if servo.model.protocol == 1 else InstructionPacket2
    bus.receive(packet.ping(1).encode(), 0)
    assert servo.alarms.active
    faults.rate = 0.0
    bus.receive(packet.ping(1).encode(), SECOND)
    if kind is Fault.LOW_VOLTAGE:
        assert not servo.alarms.active
    elif servo.model.protocol == 2 or kind is Fault.OVERLOAD:
        assert servo.alarms.active


def test_same_seed_same_faults_and_all_kinds_occur() -> None:
    def run(seed: int) -> tuple[Faults, list[bytes]]:
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
