"""Times on the wire, in simulated time."""

from __future__ import annotations

import pytest

from head_tracking.dynamixel.models import servo_model
from head_tracking.simulation import (
    Answer,
    InstructionPacket,
    InstructionPacket2,
    SimulatedBus,
    SimulatedClock,
    SimulatedLine,
    SimulatedServo,
    StatusPacket,
    Wire,
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
def test_a_read_takes_its_time_on_the_wire(delay: int, wire: float) -> None:
    clock = SimulatedClock()
    line = SimulatedLine(SimulatedBus(servos(delay)), clock, 1_000_000)
    answer, time = transaction(line, clock, READ_1)
    assert len(answer) == 14
    assert time == pytest.approx(wire)


def test_a_slower_baud_rate_takes_longer() -> None:
    clock = SimulatedClock()
    line = SimulatedLine(SimulatedBus(servos()), clock, 57_600)
    assert transaction(line, clock, READ_1)[1] == pytest.approx(22 * 10e6 / 57_600, abs=1)


def test_two_axs_need_620_us_for_a_cycle() -> None:
    clock = SimulatedClock()
    line = SimulatedLine(SimulatedBus(servos()), clock)
    data = {1: b"\0\2\x64\0", 2: b"\0\2\x64\0"}
    goals = InstructionPacket.sync_write(30, data).encode()
    transaction(line, clock, goals + READ_1)
    transaction(line, clock, READ_2)
    assert clock.now == 620 * US


def test_answers_of_a_sync_read_follow_each_other() -> None:
    made = [SimulatedServo(i, servo_model("XL430-W250")) for i in (1, 2)]
    wire = Wire(SimulatedBus(made), paced=True)
    wire.send(InstructionPacket2.sync_read(132, 4, (1, 2)).encode(), 0, 1_000_000)
    first = 160 * US + 500 * US + 150 * US  # question, return delay, answer
    assert wire.due == first
    assert len(wire.take(first)) == 15
    assert wire.due == first + 500 * US + 150 * US


def test_an_adapter_with_latency_hands_on_only_so_often() -> None:
    clock = SimulatedClock()
    line = SimulatedLine(SimulatedBus(servos()), clock, latency=0.016)
    for number in (1, 2, 3):
        transaction(line, clock, READ_1)
        assert clock.now == number * 16_000 * US


def test_silence_lasts_until_the_deadline() -> None:
    clock = SimulatedClock()
    line = SimulatedLine(SimulatedBus(servos()), clock)
    line.write(InstructionPacket.ping(9).encode())
    assert line.read(100, 0.005) == b""
    assert clock() == 0.005


def test_late_answers_are_there_later_and_stop_nobody() -> None:
    slow = [True]

    def line_fault(answer: Answer) -> tuple[Answer, ...]:
        if slow.pop() if slow else False:
            return (Answer(answer.data, answer.delay, answer.follows, 30_000 * US),)
        return (answer,)

    clock = SimulatedClock()
    line = SimulatedLine(SimulatedBus(servos(), line_fault), clock)
    line.write(READ_1)
    assert line.read(100, 0.005) == b""
    answer, _ = transaction(line, clock, READ_2)
    assert answer[2] == 2
    late = line.read(100, 1.0)
    assert late[2] == 1
    assert clock.now == 220 * US + 30_000 * US


def test_reads_give_no_more_than_asked_and_input_can_be_discarded() -> None:
    clock = SimulatedClock()
    line = SimulatedLine(SimulatedBus(servos()), clock)
    line.write(READ_1)
    assert line.read(4, 1.0) == b"\xff\xff\x01\x0a"
    assert len(line.read(100, 1.0)) == 10
    line.write(READ_1)
    clock.now += 1000 * US
    line.discard_input()
    assert line.read(100, clock() + 0.01) == b""


def test_only_servos_of_the_same_baud_rate_hear() -> None:
    made = servos()
    made[1].set_register("Baud Rate", 34)
    clock = SimulatedClock()
    line = SimulatedLine(SimulatedBus(made), clock, 1_000_000, match_baud_rate=True)
    assert transaction(line, clock, READ_1)[0]
    assert not transaction(line, clock, READ_2)[0]
    slow = SimulatedLine(SimulatedBus(made), clock, 57_600, match_baud_rate=True)
    assert transaction(slow, clock, READ_2)[0]


def test_a_line_that_is_gone_raises() -> None:
    line = SimulatedLine(SimulatedBus(servos()), SimulatedClock())
    line.plugged = False
    for act in (line.discard_input, lambda: line.write(READ_1), lambda: line.read(1, 1.0)):
        with pytest.raises(OSError, match="gone"):
            act()


def test_echoing_adapter_sends_back_what_it_is_sent() -> None:
    clock = SimulatedClock()
    line = SimulatedLine(SimulatedBus(servos(), echo=True), clock)
    ping = InstructionPacket.ping(1).encode()
    line.write(ping)
    clock.now += 1000 * US
    assert line.read(100, 1.0) == ping + StatusPacket(1).encode()
