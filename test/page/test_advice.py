import pytest

from head_tracking.page.advice import advice, troubles
from head_tracking.recording.recording import Observation
from head_tracking.ros.kit.diagnostics import Health, Level


def entry(level: Level, message: str, name: str = "servo_bus: head_pan_joint") -> Health:
    return Health(name, level, message, {})


@pytest.mark.parametrize("level", [Level.OK, Level.WARN])
def test_a_warning_needs_no_banner(level):
    assert troubles([entry(level, "45 of 50 cycles per second")], Observation(0)) == []


@pytest.mark.parametrize(
    ("level", "message", "words"),
    [
        (Level.ERROR, "lost: it does not answer", "plug"),
        (Level.ERROR, "faulted: it has shut itself down: overload; call recover", "free the head"),
        (Level.ERROR, "faulted: it has shut itself down: overheating", "cool down"),
        (Level.ERROR, "input voltage", "supply"),
        (Level.ERROR, "72 degrees Celsius; torque on", "cool down"),
        (Level.STALE, "nothing heard for 7 s; last: lost: it does not answer", "servo_bus still"),
        (Level.ERROR, "something that nobody has thought of", "STOP"),
    ],
)
def test_trouble_is_named_with_what_to_do(level, message, words):
    (trouble,) = troubles([entry(level, message)], Observation(0))
    assert trouble.what == f"head_pan_joint: {message}"
    assert words in trouble.advice


def test_silence_is_the_fault_of_the_node_that_should_speak():
    silent = entry(Level.STALE, "nothing heard for 7 s; last: tracking", "head_tracker: target")
    (trouble,) = troubles([silent], Observation(0))
    assert "head_tracker still running" in trouble.advice


def test_a_node_that_has_gone_is_named_once():
    silent = entry(Level.STALE, "nothing heard for 7 s; last: tracking", "head_tracker: target")
    (trouble,) = troubles([silent], Observation(0, missing_nodes=("head_tracker",)))
    assert "head_tracker has gone" in trouble.what
    assert "Start head_tracker again" in trouble.advice


def test_joints_that_nobody_tells_of_are_named():
    (trouble,) = troubles([], Observation(0, silent_joints=("head_pan_joint",)))
    assert "no joint states of head_pan_joint" in trouble.what
    assert "servo_bus" in trouble.advice


def test_what_is_not_known_has_advice_too():
    assert "STOP" in advice("something that nobody has thought of", "servo_bus")[0]
