"""head_tracker: keeps the head on a moving target; its states, laws, switches and parameters."""

import math
import time
from functools import partial

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rig import DEGREE, JOINTS, LATCHED, bearing
from std_msgs.msg import Bool, Float64, String
from waiting import wait_for

RUN = ("--target", "none")
STATES = {
    "idle", "acquiring", "tracking", "coasting", "holding", "searching", "recentering",
    "at the limit", "stalled", "cautious", "disabled",
}  # fmt: skip
TUNED = ("max_joint_speed", "recenter_timeout", "enable_target_search", "law")


@pytest.fixture(scope="module")
def usual(running):
    return {name: running.person.get("head_tracker", name) for name in TUNED}


@pytest.fixture
def bench(running, usual):
    """The head looks ahead and waits for a target."""
    person = running.person
    running.servos.port.use(lambda bus: bus[1].drive.push(0.0))
    for name, value in usual.items():
        assert person.set("head_tracker", name, value).successful
    person.until_done("torque_enable", True)
    assert person.call("head_tracker/enable", True).success
    person.until_done("head_tracker/recenter")
    seen = lambda: (person.latched("head_tracker/state"), person.pan, person.tilt, person.log[-9:])  # noqa: E731
    wait_for(lambda: person.looks_at(0.0, 0.0), why=seen)
    person.log.clear()
    return running


def in_state(person, state):
    return lambda: person.state("head_tracker") == state


def has_been_in_state(person, state):
    """Also if that is over before anybody looks."""
    states = person.hear("head_tracker/state", String, LATCHED)
    count = len(states)
    return lambda: any(each.data.partition(":")[0] == state for each in states[count:])


def test_a_target_is_reached_tracked_and_the_error_published(bench, person):
    errors = person.hear("head_tracker/tracking_error", Float64)
    states = person.hear("head_tracker/state", String, LATCHED)
    person.keep_looking(1, 0.6, 0, lambda: errors and errors[-1].data < 1.5 * DEGREE, "torso_link")
    person.keep_looking(1, 0.6, 0, in_state(person, "tracking"), "torso_link")
    there = pytest.approx(bearing(1.0, 0.6), abs=1.5 * DEGREE)  # (later on a busy machine)
    person.keep_looking(1, 0.6, 0, lambda: bench.servos.true[0] == there, "torso_link")
    assert {state.data.partition(":")[0] for state in states} <= STATES
    wait_for(lambda: set(person.owners.values()) == {"/head_tracker"})


def test_a_target_that_goes_away_is_waited_for_and_followed_where_it_comes_back(bench, person):
    person.keep_looking(1, 0.6, 0, in_state(person, "tracking"), "torso_link")
    wait_for(in_state(person, "holding"))
    before = bench.servos.at_rest()
    time.sleep(0.3)
    assert bench.servos.at_rest() == pytest.approx(before, abs=0.5 * DEGREE)
    person.keep_looking(1, -0.6, 0, has_been_in_state(person, "acquiring"), "torso_link")
    person.keep_looking(1, -0.6, 0, in_state(person, "tracking"), "torso_link")
    assert not [line for line in person.log if "refused" in str(line)]


def test_a_target_out_of_reach_is_called_so(person):
    person.keep_looking(-2, 0.3, 0, in_state(person, "at the limit"), "torso_link")


def test_switched_off_it_stops_at_once_and_gives_the_joints_up(bench, person):
    assert person.set("head_tracker", "max_joint_speed", 1.5).successful
    person.keep_looking(1, 1.5, 0, lambda: person.pan > 0.2)
    assert person.call("head_tracker/enable", False).success
    pan = bench.servos.true[0]
    rest, tilt = bench.servos.at_rest()
    assert abs(rest - pan) < 0.3  # its target was 0.7 rad away
    wait_for(lambda: person.latched("head_tracker/enabled", Bool) is False)
    wait_for(in_state(person, "disabled"))
    wait_for(lambda: set(person.owners.values()) == {""})
    assert not person.call("head_tracker/recenter").success
    for _ in range(10):
        person.look_at(1, -1, 0)
        time.sleep(0.03)
    assert bench.servos.at_rest() == pytest.approx((rest, tilt), abs=0.01)
    assert person.call("head_tracker/enable", True).success
    person.keep_looking(1, -1, 0, lambda: person.pan < 0.0)


def test_after_a_timeout_it_recentres(person):
    assert person.set("head_tracker", "recenter_timeout", 1.0).successful
    person.keep_looking(1, 0.5, 0, in_state(person, "tracking"))
    wait_for(has_been_in_state(person, "recentering"))
    wait_for(in_state(person, "idle"))
    wait_for(lambda: person.looks_at(0.0, 0.0))


def test_the_search_is_ended_by_a_target(person):
    assert person.set("head_tracker", "search_target_timeout", 0.8).successful
    assert person.set("head_tracker", "default_joint_speed", 1.5).successful
    assert person.set("head_tracker", "enable_target_search", True).successful
    person.keep_looking(1, 0.3, 0, in_state(person, "tracking"))
    wait_for(in_state(person, "searching"))
    wait_for(lambda: abs(person.pan) > 1.0)
    person.keep_looking(1, 0.3, 0, in_state(person, "tracking"))


def test_laws_are_switched_while_the_head_moves(person):
    assert person.get("head_tracker", "law") == "predictive"
    side = 1.0
    for law in ("speed", "position", "predictive"):
        assert person.set("head_tracker", "law", law).successful
        side = -side
        person.keep_looking(1, side, 0, lambda: person.pan * side > 0.3)  # noqa: B023


def test_a_bad_value_is_refused_with_its_name_and_changes_nothing(person):
    for name, bad in (
        ("law", "magic"),
        ("max_joint_acceleration", 0.0),
        ("target_timeout", -1.0),
        ("dead_band", 5.0),
        ("max_joint_speed", "fast"),
        ("k_pan", -1.0),
    ):
        before = person.get("head_tracker", name)
        refused = person.set("head_tracker", name, bad)
        assert not refused.successful
        assert name in refused.reason
        assert person.get("head_tracker", name) == before


def test_what_is_no_target_is_named_and_moves_nothing(bench, person):
    before = bench.servos.at_rest()
    for *target, fact in (
        (1, -1, 0, "nowhere", "nowhere"),
        (math.nan, 0, 0, "base_link", "nan"),
        (1, 0, 0, "", "frame name"),
    ):
        person.log.clear()
        person.complaint("head_tracker", fact, of=partial(person.look_at, *target))
    assert bench.servos.at_rest() == pytest.approx(before, abs=0.5 * DEGREE)


@pytest.mark.parametrize(
    ("service", "data"), [("relax", None), ("head_pan_controller/torque_enable", False)]
)
def test_servos_that_were_relaxed_stall_the_head_until_their_torque_is_on(person, service, data):
    person.keep_looking(1, 0.7, 0, in_state(person, "tracking"), "torso_link")
    person.until_done(service, data)
    person.keep_looking(1, -0.7, 0, has_been_in_state(person, "stalled"), "torso_link")
    states = person.hear("head_tracker/state", String, LATCHED)
    assert any("stalled" in state.data and JOINTS[0] in state.data for state in states)
    person.until_done("torque_enable", True)
    person.keep_looking(1, -0.7, 0, in_state(person, "tracking"), "torso_link")


def test_diagnostics_have_numbers(person):
    messages = person.hear("/diagnostics", DiagnosticArray)

    def values():
        entries = {s.name: s.values for message in messages for s in message.status}
        return {v.key: v.value for v in entries.get("head_tracker: target", ())}

    person.keep_looking(1, 0.5, 0, in_state(person, "tracking"))
    messages.clear()
    person.keep_looking(1, 0.5, 0, values)
    assert values()["law"] == "predictive"
    assert sum(value.replace(".", "").isdigit() for value in values().values()) >= 3


def test_another_robots_description_is_refused_and_the_head_goes_on(bench, person):
    person.keep_looking(1, 1, 0, lambda: person.pan > 0.4)
    publisher = person.node.create_publisher(String, "robot_description", LATCHED)
    publisher.publish(String(data='<robot name="arm"><link name="shoulder"/></robot>'))
    person.complaint("head_tracker", JOINTS[0])
    person.keep_looking(1, -1, 0, lambda: person.pan < -0.4)
    person.node.destroy_publisher(publisher)


def test_track_report_makes_a_table_and_a_picture(bench, person):
    picture = bench.folder / "picture.svg"
    ascii_only = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    words = ("--duration", "1", "--output", str(picture))
    report = bench.start("track_report", *words, environment=ascii_only)
    person.keep_looking(1, 0.3, 0, lambda: report.process.poll() is not None)
    assert report.end() == 0, report.output
    assert "rms" in report.output
    assert "°" in picture.read_text(encoding="utf-8")
