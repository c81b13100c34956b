"""How long answers are waited for, and how late ones are told apart."""

from __future__ import annotations

import pytest

from head_tracking.dynamixel.port import LateReplies, ReplyTimeout


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


def test_first_timeout_knows_the_adapter() -> None:
    assert ReplyTimeout(adapter=0.001).allowance == pytest.approx(0.009)
    assert ReplyTimeout(adapter=0.016).allowance == pytest.approx(0.024)


def test_question_after_a_silence_asks_for_another_length() -> None:
    clock = Clock()
    late = LateReplies(clock)
    assert late.extra(1, (1, 2), 8) == 0 and not late.due
    late.add(1, 1, 8, clock.now)
    assert late.extra(1, (1,), 8) == 1
    assert late.extra(1, (2,), 8) == 0
    assert late.extra(2, (1,), 8) == 0
    late.add(1, 2, 9, clock.now)
    assert late.extra(1, (1, 2), 8) == 2


def test_late_reply_is_taken_once_and_old_ones_are_forgotten() -> None:
    clock = Clock()
    late = LateReplies(clock)
    late.add(1, 1, 8, clock.now)
    clock.now += 0.25
    assert late.take(1, 1, 9) is None
    assert late.take(1, 1, 8) == pytest.approx(0.25)
    assert late.take(1, 1, 8) is None
    assert not late.due
    late.add(1, 1, 8, clock.now)
    clock.now += 1.1
    assert late.extra(1, (1,), 8) == 0
    assert not late.due


def test_after_very_many_silences_nothing_is_asked_for_a_while() -> None:
    clock = Clock()
    late = LateReplies(clock)
    for length in range(8, 40):
        late.add(1, 1, length, clock.now)
    assert late.extra(1, (1,), 8) is None
