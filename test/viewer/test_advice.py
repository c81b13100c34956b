import pytest

from head_tracking.viewer.advice import troubles
from head_tracking.viewer.robot import Health, Level, Observation


def entry(level: Level, message: str) -> Health:
    return Health("servo_bus: head_pan_joint", level, message, {})


@pytest.mark.parametrize("level", [Level.OK, Level.WARN])
def test_a_warning_needs_no_banner(level):
    assert troubles([entry(level, "45 of 50 cycles per second")], Observation(0)) == []


@pytest.mark.parametrize(
    ("level", "message", "words"),
    [
        (Level.ERROR, "lost: it does not answer", "plug"),
        (Level.ERROR, "overload", "free the head"),
        (Level.ERROR, "overheating", "cool down"),
        (Level.ERROR, "input voltage out of range", "supply"),
        (Level.STALE, "nothing heard for 7 s; last: torque on", "still running"),
        (Level.ERROR, "something that nobody has thought of", "STOP"),
    ],
)
def test_trouble_is_named_with_what_to_do(level, message, words):
    (trouble,) = troubles([entry(level, message)], Observation(0))
    assert trouble.what == f"head_pan_joint: {message}"
    assert words in trouble.advice
