"""point_head: a target is looked at once, exactly, or refused; what the head says of it."""

import math
import signal
from functools import partial

import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PointStamped
from rig import DEGREE, JOINTS, bearing
from std_msgs.msg import Float64
from waiting import wait_for

RUN = ("--mode", "point")
ROUGH = 2 * DEGREE


@pytest.fixture
def bench(running):
    """The head looks ahead."""
    person = running.person
    person.wait_for_node("point_head")
    running.servos.port.use(lambda bus: bus[1].drive.push(0.0))
    person.until_done("torque_enable", True)
    assert person.set("point_head", "max_velocity", 5.0).successful
    assert person.call("point_head/enable", True).success
    person.until_done("point_head/recenter")
    wait_for(lambda: person.looks_at(0.0, 0.0))
    running.servos.at_rest()
    person.log.clear()
    return running


def test_a_target_is_looked_at_and_the_miss_is_published(bench, person):
    misses = person.hear("point_head/pointing_error", Float64)
    person.look_at(1, 1, 0)
    wait_for(lambda: abs(person.pan - bearing(1, 1)) < DEGREE)
    wait_for(lambda: person.state("point_head") == "arrived")
    pan, tilt = bench.servos.at_rest()
    assert pan == pytest.approx(bearing(1, 1), abs=DEGREE)
    assert 0.2 < tilt < 0.5
    wait_for(lambda: misses and misses[-1].data < 1.2 * DEGREE)
    person.look_at(1, 1, 0, "torso_link")
    wait_for(lambda: person.tilt < tilt - 5 * DEGREE)
    assert 0.0 < bench.servos.at_rest()[1] < tilt


def test_a_repeated_target_above_the_axis_raises_the_head(bench, person):
    """Each step is less than half a tick of the servo, as the tutorial has it.

    Twice the servo stops beside its goal, by a tick of margin and half a tick of rounding.
    """
    _, before = bench.servos.at_rest()
    for _ in range(15):
        unstamped = person.point(5, 0, 0.01, "head_link")  # as by `ros2 topic pub`
        unstamped.header.stamp = Time()
        person.publish("target_point", unstamped)
        _, tilt = bench.servos.at_rest()
    assert tilt - before == pytest.approx(-15 * math.atan2(0.01, 4.91), abs=0.9 * DEGREE)


def test_an_unreachable_target_is_refused_and_nothing_moves(bench, person):
    before = bench.servos.true
    for *target, fact in (
        (0.0115, 0, 3, "head_pan_link", "pan"),
        (1, 0, 0, "nose_link", "nose_link"),
        (1, 0, 0, "", "frame name"),
        (math.nan, 0, 0, "base_link", "nan"),
        (1, math.inf, 0, "base_link", "inf"),
        (-2, 0, 0.1, "head_pan_link", JOINTS[0]),
        (0.0, 0, 0, "camera_link", "camera_link"),
    ):
        person.log.clear()
        person.complaint("point_head", fact, of=partial(person.look_at, *target))
    assert bench.servos.at_rest() == pytest.approx(before, abs=0.2 * DEGREE)


def test_a_blocked_head_does_not_report_arrival(bench, person):
    # a hand holds it, stronger than the servo
    bench.servos.port.use(lambda bus: bus[1].lead(512, 60.0))
    person.look_at(1, -0.3, 0, "head_pan_link")
    person.complaint("point_head")
    assert person.state("point_head") != "arrived"
    bench.servos.port.use(lambda bus: bus[1].lead(512, 0.1))


def test_the_speed_can_be_lowered_while_it_runs(person):
    assert person.set("point_head", "max_velocity", 0.4).successful
    person.look_at(1, 1, 0)
    assert person.mean_speed(lambda: abs(person.pan - bearing(1, 1)) < DEGREE) < 0.5


def test_a_disabled_head_ignores_targets_and_permits_other_commands(bench, person):
    wait_for(lambda: set(person.owners.values()) == {"/point_head"})
    person.complaint(
        "servo_bus", "/point_head", of=lambda: person.command("head_pan_controller", 0.5)
    )
    assert person.call("point_head/enable", False).success
    wait_for(lambda: person.state("point_head") == "disabled")
    assert not person.call("point_head/recenter").success
    person.look_at(1, -1, 0)
    person.command("head_pan_controller", 0.5)
    wait_for(lambda: abs(person.pan - 0.5) < DEGREE)
    assert bench.servos.at_rest()[0] == pytest.approx(0.5, abs=DEGREE)


def test_a_relaxed_head_does_not_move(bench, person):
    person.until_done("relax")
    before = bench.servos.at_rest()
    person.complaint("", of=lambda: person.look_at(1, -1, 0))
    assert bench.servos.at_rest() == pytest.approx(before, abs=0.01)


def test_look_turns_the_head_and_fails_if_it_does_not_arrive(bench, person):
    look = bench.start("look", "1,1,0.4@base_link")
    assert look.end() == 0, look.output
    wait_for(lambda: abs(person.pan - bearing(1, 1)) < ROUGH)

    def names_the_other_publisher_of_targets():  # once it has discovered that
        person.look_at(1, -1, 0.4)
        late = bench.start("look", "--centre", "--timeout", "0.1")
        return late.end() == 1 and "publishers of target_point" in late.output

    wait_for(names_the_other_publisher_of_targets)
    look = bench.start("look", "--centre")
    assert look.end() == 0, look.output
    wait_for(lambda: person.looks_at(0.0, 0.0))
    failing = [
        bench.start("look", place, "--wait", "2") for place in ("-1,0,0.45@base_link", "@nose")
    ]
    assert [look.end() for look in failing] == [1, 1]
    person.until_done("stop")
    wait_for(lambda: person.state("point_head") == "disabled")
    look = bench.start("look", "1,1,0@base_link", "--timeout", "1")
    assert look.end() == 1, look.output
    assert person.latched("point_head/state") in look.output
    look = bench.start("look", "1,1,0@base_link", "--timeout", "60")  # it publishes all the time
    targets = person.hear("target_point", PointStamped)
    wait_for(lambda: targets)
    assert look.end(signal.SIGINT) == 130, look.output
    assert person.looks_at(0.0, 0.0)
    person.until_done("resume")


def test_transforms_of_the_running_head(bench, person):
    frames = person.call("robot_state_publisher/frames").message.split()
    assert frames[0] == "world"
    assert {"base_link", "torso_link", "camera_optical_frame"} <= set(frames)
    echo = bench.start(
        "transforms", "echo", "base_link", "torso_link", "--rate", "20", "--count", "2"
    )
    unknown = bench.start("transforms", "echo", "base_link", "nose", "--wait", "5")
    tree = bench.start("transforms", "tree", "--listen", "6")
    assert echo.end() == 0, echo.output
    assert echo.output.count("Translation: [") == 2
    assert unknown.end() == 1
    assert "nose" in unknown.last_line
    assert tree.end() == 0, tree.output
    assert tree.output.startswith("world")
    assert any("Hz" in line and JOINTS[0] in line for line in tree.output.splitlines())


def test_relax_and_doctor_and_servo_beside_a_running_head(bench, person):
    person.look_at(1, 1, 0)
    wait_for(lambda: bench.servos.torque == [1, 1])
    relax = bench.start("relax")
    assert relax.end() == 0, relax.output
    assert bench.servos.torque == [0, 0]
    servo = bench.start("servo", "--port", bench.servos.name, "info", "1")
    assert servo.end() == 1, servo.output  # the port is in use
    doctor = bench.start("doctor", "--port", bench.servos.name, "--listen", "3")
    code = doctor.end()
    reds = [line.split()[1] for line in doctor.output.splitlines() if line.startswith("red")]
    assert set(reds) <= {"processor"}, doctor.output  # other tests may keep that busy
    assert code in ((2,) if reds else (0, 1))
    assert "after it was sent" in doctor.output  # it has received messages
    assert "servo_bus: " in doctor.output  # and diagnostics
    assert bench.servos.torque == [0, 0]
