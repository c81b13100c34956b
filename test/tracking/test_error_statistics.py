import pytest

from head_tracking.tracking import ErrorStatistics


def test_rms_and_maximum():
    statistics = ErrorStatistics()
    for error in (3.0, -4.0):
        statistics.add(error)
    assert statistics.rms == pytest.approx((25 / 2) ** 0.5)
    assert statistics.maximum == 4.0
    assert statistics.count == 2


def test_nothing_measured():
    assert ErrorStatistics().rms == 0.0
