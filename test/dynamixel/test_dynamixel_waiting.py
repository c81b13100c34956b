"""How long answers are waited for, and how late ones are told apart."""

from __future__ import annotations

import pytest

from head_tracking.dynamixel.answer import Failure, Window
from head_tracking.dynamixel.debts import Debts
from head_tracking.dynamixel.patience import Patience
from head_tracking.dynamixel.protocol import Status


class Clock:
    now = 100.0

    def __call__(self) -> float:
        return self.now


def test_patience_follows_the_answers() -> None:
    patience = Patience()
    assert patience.allowance == 0.025  # nothing is known of the adapter
    for _ in range(200):
        patience.learn(0.0002)
    quick = patience.allowance
    assert 0.001 < quick < 0.002
    patience.learn(0.010)
    assert patience.allowance > 2 * quick
    for _ in range(200):
        patience.learn(0.0002)
    assert patience.allowance == pytest.approx(quick, rel=0.01)


def test_patience_has_an_end() -> None:
    patience = Patience()
    for _ in range(50):
        patience.learn(0.024)
    assert patience.allowance == 0.025
    for _ in range(50):
        patience.learn(0.0002)
    before = patience.allowance
    patience.learn(3.0)  # nobody would wait for that
    assert patience.allowance == before


def test_patience_that_was_given_is_kept() -> None:
    patience = Patience(0.1)
    patience.learn(0.0002)
    assert patience.allowance == 0.1


def test_first_patience_knows_the_adapter() -> None:
    assert Patience(adapter=0.001).allowance == pytest.approx(0.009)
    assert Patience(adapter=0.016).allowance == pytest.approx(0.024)


def test_question_after_a_silence_asks_for_another_length() -> None:
    clock = Clock()
    debts = Debts(clock)
    assert debts.extra(1, (1, 2), 8) == 0 and not debts
    debts.add(1, 1, 8, clock.now)
    assert debts.extra(1, (1,), 8) == 1
    assert debts.extra(1, (2,), 8) == 0
    assert debts.extra(2, (1,), 8) == 0
    debts.add(1, 2, 9, clock.now)
    assert debts.extra(1, (1, 2), 8) == 2


def test_late_answer_is_paid_once_and_old_ones_are_forgotten() -> None:
    clock = Clock()
    debts = Debts(clock)
    debts.add(1, 1, 8, clock.now)
    clock.now += 0.25
    assert debts.pay(1, 1, 9) is None
    assert debts.pay(1, 1, 8) == pytest.approx(0.25)
    assert debts.pay(1, 1, 8) is None
    assert not debts
    debts.add(1, 1, 8, clock.now)
    clock.now += 1.1
    assert debts.extra(1, (1,), 8) == 0
    assert not debts


def test_after_very_many_silences_nothing_is_asked_for_a_while() -> None:
    clock = Clock()
    debts = Debts(clock)
    for length in range(8, 40):
        debts.add(1, 1, length, clock.now)
    assert debts.extra(1, (1,), 8) is None


@pytest.mark.parametrize(("address", "start"), [(36, 33), (0, 0), (2, 2), (3, 0)])
def test_window_gives_back_what_was_asked_for(address: int, start: int) -> None:
    memory = bytes(range(50))
    window = Window(address, 2, 3)
    assert (window.start, window.size) == (start, 5)
    read = Status(1, 0, memory[window.start : window.start + window.size])
    part = window.part(read)
    assert isinstance(part, Status)
    assert part.data == memory[address : address + 2]
    assert window.part(Failure.SILENT) is Failure.SILENT
    refusal = Status(1, 8, b"")
    assert window.part(refusal) is refusal
