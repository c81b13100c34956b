"""How long answers are waited for, and how late ones are told apart."""

from __future__ import annotations

import pytest

from head_tracking.dynamixel import ReadGroup, ReadMethod, ReplyTimeoutError
from head_tracking.dynamixel.protocol import Status
from head_tracking.dynamixel.waiting import LateReplies, ReplyTimeout


class Clock:
    now = 100.0

    def __call__(self) -> float:
        return self.now


def test_timeout_follows_the_answers() -> None:
    timeout = ReplyTimeout()
    assert timeout.allowance == 0.025  # nothing is known of the adapter
    for _ in range(200):
        timeout.learn(0.0002)
    quick = timeout.allowance
    assert 0.001 < quick < 0.002
    timeout.learn(0.010)
    assert timeout.allowance > 2 * quick
    for _ in range(200):
        timeout.learn(0.0002)
    assert timeout.allowance == pytest.approx(quick, rel=0.01)


def test_timeout_has_an_end() -> None:
    timeout = ReplyTimeout()
    for _ in range(50):
        timeout.learn(0.024)
    assert timeout.allowance == 0.025
    for _ in range(50):
        timeout.learn(0.0002)
    before = timeout.allowance
    timeout.learn(3.0)  # nobody would wait for that
    assert timeout.allowance == before


def test_timeout_that_was_given_is_kept() -> None:
    timeout = ReplyTimeout(0.1)
    timeout.learn(0.0002)
    assert timeout.allowance == 0.1


def test_after_a_timeout_a_repeated_question_waits_longer() -> None:
    timeout = ReplyTimeout()
    for _ in range(200):
        timeout.learn(0.0002)
    quick = timeout.allowance
    for _ in range(2):
        timeout.back_off()
    assert timeout.allowance == pytest.approx(4 * quick)
    for _ in range(10):
        timeout.back_off()
    assert timeout.allowance == 0.025
    timeout.learn(0.0002)
    assert timeout.allowance == pytest.approx(quick, rel=0.01)


def test_first_timeout_knows_the_adapter() -> None:
    assert ReplyTimeout(adapter=0.001).allowance == pytest.approx(0.009)
    assert ReplyTimeout(adapter=0.016).allowance == pytest.approx(0.024)


def group(servo_id: int, length: int, protocol: int = 1) -> ReadGroup:
    return ReadGroup(ReadMethod.EACH, protocol, 36, length, (servo_id,))


def test_read_after_a_silence_asks_for_another_length() -> None:
    clock = Clock()
    late = LateReplies(clock)
    assert not late.due
    late.add(group(1, 8).replies[0], clock.now)
    assert late.unambiguous(group(1, 8)).length == 9
    assert late.unambiguous(group(2, 8)).length == 8
    assert late.unambiguous(group(1, 8, 2)).length == 8
    late.add(group(2, 9).replies[0], clock.now)
    both = ReadGroup(ReadMethod.BULK, 1, 36, 8, (1, 2))
    assert (late.unambiguous(both).length, late.unambiguous(both).address) == (10, 34)


def test_late_reply_is_taken_once_and_old_ones_are_forgotten() -> None:
    clock = Clock()
    late = LateReplies(clock)
    late.add(group(1, 8).replies[0], clock.now)
    clock.now += 0.25
    assert late.remove(1, Status(1, 0, bytes(9))) is None
    assert late.remove(1, Status(1, 0, bytes(8))) == pytest.approx(0.25)
    assert late.remove(1, Status(1, 0, bytes(8))) is None
    assert not late.due
    late.add(group(1, 8).replies[0], clock.now)
    clock.now += 1.1
    assert late.unambiguous(group(1, 8)).length == 8
    assert not late.due


def test_after_very_many_silences_nothing_is_asked_for_a_while() -> None:
    clock = Clock()
    late = LateReplies(clock)
    for length in range(8, 40):
        late.add(group(1, length).replies[0], clock.now)
    with pytest.raises(ReplyTimeoutError):
        late.unambiguous(group(1, 8))
