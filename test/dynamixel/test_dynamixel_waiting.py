"""How long answers are waited for, and how late ones are told apart."""

from __future__ import annotations

import pytest

from head_tracking.dynamixel.waiting import ReplyTimeout


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


def test_the_timeout_follows_the_answers_and_has_an_end() -> None:
    timeout = ReplyTimeout()
    assert timeout.allowance == 0.025  # nothing is known of the adapter
    assert ReplyTimeout(adapter=0.001).allowance == pytest.approx(0.009)
    for _ in range(200):
        timeout.learn(0.0002)
    quick = timeout.allowance
    assert 0.001 < quick < 0.002
    timeout.learn(3.0)  # nobody would wait for that
    assert timeout.allowance == quick
    timeout.learn(0.010)
    assert timeout.allowance > 2 * quick
    for _ in range(50):
        timeout.learn(0.024)
    assert timeout.allowance == 0.025
