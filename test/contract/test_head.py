"""`Head`, for Python programs: what it does, what it refuses, and that it ends relaxed."""

import inspect
import logging
import math
import pickle
import random
import signal
import statistics
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import replace
from decimal import Decimal
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from rig import DEGREE, SOURCE, bearing, follow_a_swing, run_python, swing_until_learned
from waiting import PATIENCE, repeating, wait_for

from head_tracking import (
    FrameError,
    Head,
    HeadState,
    HeadTrackingError,
    JointConfiguration,
    RefusedCommandError,
    SupersededError,
    TargetState,
    UnreachableError,
)
from head_tracking.dynamixel import (
    ConfigurationError,
    DynamixelError,
    PortBusyError,
    PortMissingError,
    ServoNotFoundError,
    TorqueError,
)
from head_tracking.transforms import Rotation, Transform

ROS = ("rclpy", "rcl_interfaces", "builtin_interfaces", "std_msgs", "std_srvs", "sensor_msgs")
LEFT, RIGHT = (2.0, 2.0, 0.6), (2.0, -2.0, 0.6)
PROGRAM = """
import sys, time
from head_tracking import Head
from head_tracking.share import robot_file
from head_tracking.transforms import load_robot_model
head = Head(sys.argv[1], load_robot_model(robot_file("kinectbot")), reply_timeout=0.2)
"""


ANOTHER_SYSTEM = f"""
import select, signal, sys
import lxml, numpy, serial.tools.list_ports, subprocess, xacro, yaml  # they have what they need
import shutil
for name in ("fcntl", "grp", "pwd", "resource", "termios", "tty", *{ROS!r}):
    sys.modules[name] = None
for name in ("epoll", "poll"):
    delattr(select, name)
for name in ("SIGHUP", "SIGQUIT", "pthread_sigmask"):
    delattr(signal, name)
sys.platform = "win32"
"""


def turn_left(head, max_velocity):
    """Look to the left, and again if servos of a busy machine are silent for a moment."""
    while True:
        with suppress(DynamixelError):
            return head.look_at(LEFT, max_velocity=max_velocity)


def run_until_it_turns(servos, text):
    program = subprocess.Popen(
        ["env", "--default-signal", sys.executable, "-c", PROGRAM + text, servos.name], cwd=SOURCE
    )

    def turns():
        assert program.poll() is None
        return servos.torque == [1, 1] and abs(servos.true[0]) > 0.05

    wait_for(turns)
    return program


@contextmanager
def on_alarm(handler):
    """Handle SIGALRM so."""
    before = signal.signal(signal.SIGALRM, handler)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


# looking and following


def test_a_head_needs_no_ros_and_nothing_that_only_linux_has(servos):
    looking = f":\n    while not head.look_at({LEFT}).arrived: pass\n"
    everything = """\
    head.follow((1.0, 0.0, 2.0), frame='camera_optical_frame')
    head.pose('camera_link')
    head.stop(); head.resume(); head.relax()
try: Head.open('COM9')
except PortMissingError: pass
assert not [m for m in sys.modules if m.endswith('_msgs') and sys.modules[m]]
"""
    heads = f"with head{looking}with Head.simulated() as head{looking}"
    errors = "from head_tracking.dynamixel import PortMissingError\n"
    code = ANOTHER_SYSTEM + PROGRAM + errors + heads + everything
    assert run_python("-c", code, servos.name).returncode == 0
    assert servos.true[0] == pytest.approx(bearing(*LEFT[:2]), abs=DEGREE)
    assert servos.torque == [0, 0]


def test_a_head_that_turns_the_wrong_way_is_stopped_until_resume(kinectbot):
    """The camera sees what it would see if both servos were mounted the other way round."""
    with Head.simulated() as head:

        def follows_until_it_stops():
            joints = {joint: -position for joint, position in head.joints.items()}
            pose = kinectbot.transform("camera_optical_frame", "base_link", joints)
            head.follow(pose @ LEFT, "camera_optical_frame", stamp=time.time())
            time.sleep(0.02)
            return head.state is HeadState.STOPPED

        with suppress(RefusedCommandError):  # it stops between two points
            wait_for(follows_until_it_stops)
        with pytest.raises(RefusedCommandError) as refused:
            head.look_at(RIGHT)
        assert refused.value.state == HeadState.STOPPED
        head.resume()
        assert head.look_at(RIGHT).arrived


def test_the_joints_are_not_known_if_the_servos_are_silent_after_a_jump_of_the_clock(
    servos, kinectbot, monkeypatch
):
    """As on a laptop that was suspended: its USB adapter returns later."""
    clock, jump = time.time, [0.0]
    monkeypatch.setattr(time, "time", lambda: clock() + jump[0])
    head = Head(servos.name, kinectbot, reply_timeout=0.2)
    servos.port.close()
    jump[0] = 100.0

    def is_unknown():
        try:
            return not head.joints
        except DynamixelError:
            return True

    wait_for(is_unknown)
    with pytest.raises(DynamixelError):
        head.look_at(LEFT)
    with pytest.raises(DynamixelError):
        head.close()


def test_the_reason_says_why_a_target_is_not_followed(head):
    there = Transform((2.0, 0.0, 0.6), Rotation.identity())
    head.frames.set_transform(time.time_ns(), "another_tree", "thing", there)
    head.follow((0.0, 0.0, 0.0), "thing")
    assert "another_tree" in wait_for(lambda: head.reason)
    assert head.state is HeadState.HOLDING


def test_a_moving_target_is_followed(head, servos):
    errors, states = [], set()

    def follows():
        follow_a_swing(head)
        states.add(head.state)
        errors.append(math.pi if head.error is None else head.error)
        return len(errors) > 150 and statistics.median(errors[-100:]) < 4 * DEGREE

    wait_for(follows)  # (on a busy machine it takes longer)
    assert TargetState.TRACKING in states
    head.hold()
    assert head.state is HeadState.HOLDING
    assert head.error is None
    before = servos.at_rest()
    assert head.look_at((3.0, 0.0, 0.6)).arrived  # one after the other
    assert servos.true != before


def test_learned_values_are_reported_frozen_forgotten_and_set(head):
    pan = next(name for name in head.learned if "pan" in name)
    assert head.learned[pan].source == "not observable"
    swing_until_learned(head, pan)
    head.learn("freeze")
    assert head.learned[pan].source == "learned"
    head.learn(camera="forget")
    assert head.learned[pan].source == "learned"
    head.learn("forget")
    swing_until_learned(head, pan)  # anew
    head.learn("freeze", servos="forget")
    assert head.learned[pan].source == "not observable"
    head.learn(servo_delay=0.06)  # of a head that rests, too
    assert (head.learned[pan].source, head.learned[pan].value) == ("given", 0.06)
    head.learn(servo_dead_band=0.003, servo_acceleration=12.0, camera_delay=0.0)
    given = {name: each.value for name, each in head.learned.items() if each.source == "given"}
    assert sorted(given.values()) == [0.0, 0.003, 0.003, 12.0, 12.0]
    assert head.learned[pan].source == "not observable"
    for wrong in (
        {"how": "never"},
        {"how": "never", "servos": "learn", "camera": "learn"},
        {"camera": "never"},
        {"servo_delay": 9.0},
        {"servo_delay": "long"},
        {"servo_acceleration": -1.0},
        {"camera_delay": 1.5},
    ):
        with pytest.raises(ValueError):
            head.learn(**wrong)


def test_look_at_follows_a_moving_frame_and_fixes_a_point_on_the_head(head, servos):

    def move():
        now = time.time()
        place = Transform((2.0, math.sin(now), 0.6), Rotation.identity())
        head.frames.set_transform(round(now * 1e9), "base_link", "hand", place)

    with repeating(move, period=0.02):
        wait_for(lambda: "hand" in head.frames.frames())
        result = head.look_at((0.0, 0.0, 0.0), "hand", max_velocity=4.0)
        hand = head.pose("hand").translation
        assert result.arrived
        assert servos.true[0] == pytest.approx(bearing(*hand[:2]), abs=0.2)
    before = servos.at_rest()[0]
    assert head.look_at((2.0, 0.6, 0.0), "camera_link").arrived
    assert servos.true[0] == pytest.approx(before + math.atan2(0.6, 2.0), abs=3 * DEGREE)


# what it refuses


def test_invalid_targets_raise_errors_with_attributes_and_move_nothing(head, servos):
    with pytest.raises(UnreachableError) as unreachable:
        head.look_at((-2.0, 0.0, 0.6))
    assert 0.2 < unreachable.value.miss < math.pi
    assert unreachable.value.point == (-2.0, 0.0, 0.6)
    poses = (lambda _, frame: head.pose(frame)), (lambda _, frame: head.pose("camera_link", frame))
    for ask in (head.look_at, head.follow, *poses):
        with pytest.raises(FrameError) as unknown:
            ask((1, 0, 0), "nose")
        assert unknown.value.frame == "nose"
    with pytest.raises(FrameError):
        head.look_at((2, 0, 0.5), "camera_link", stamp=1.0)  # 1970
    for point in (
        (math.nan, 0, 0),
        (1, math.inf, 0),
        (1e308, 0, 0),
        (10**400, 0, 0),
        (1, 2),
        "abc",
        "123",
        b"123",
        None,
    ):
        with pytest.raises(ValueError):
            head.look_at(point)
        with pytest.raises(ValueError):
            head.follow(point)
    camera_pose = partial(head.pose, "camera_link")
    for stamp in (math.nan, math.inf, time.time_ns(), 1e3 * time.time(), "now", [1.0]):
        for ask in (partial(head.look_at, LEFT), partial(head.follow, LEFT), camera_pose):
            with pytest.raises(ValueError):
                ask(stamp=stamp)
    for number in (0.0, -1.0, math.nan, 10**400, "fast", None):
        with pytest.raises(ValueError, match="max_velocity"):
            head.look_at((1, 0, 0), max_velocity=number)
        with pytest.raises(ValueError, match="timeout"):
            head.look_at((1, 0, 0), timeout=number)
    for ask in (head.look_at, head.follow, *poses):
        for frame in (None, 3, b"base_link"):
            with pytest.raises(TypeError, match="frame name"):
                ask((1, 0, 0), frame)
    assert servos.torque == [0, 0]
    assert servos.true == (0.0, 0.0)


@pytest.mark.parametrize("servos", [(1, 2), (None, None), 5, "ab"])
def test_servos_that_are_no_pair_of_configurations_are_refused(servos):
    with pytest.raises(TypeError, match="JointConfiguration"):
        Head.simulated(servos=servos)


def test_a_closed_head_does_not_begin_a_block():
    head = Head.simulated()
    head.close()
    with pytest.raises(RefusedCommandError), head:
        pass


def test_numbers_of_any_type_are_accepted_and_reported_angles_are_true(head, servos):
    """Else the loop fails at the first step, and closes the head."""
    assert head.look_at(RIGHT, max_velocity=Decimal("2.5"), timeout=np.float32(10.0)).arrived
    assert head.look_at(LEFT, timeout=math.inf).arrived
    assert servos.true[0] == pytest.approx(bearing(*LEFT[:2]), abs=DEGREE)
    assert list(head.joints.values()) == pytest.approx(servos.true, abs=DEGREE)
    head.learn(servo_delay=np.float64(0.05), camera_delay=np.float32(0.125))
    assert head.state is HeadState.HOLDING


@pytest.mark.parametrize(
    "error",
    [
        UnreachableError((1.0, 2.0, 3.0), "base_link", 0.5, "it is behind"),
        RefusedCommandError("stopped"),
        TorqueError(True, {"pan": "no answer"}),
    ],
)
def test_errors_reach_another_process_whole(error):
    received = pickle.loads(pickle.dumps(error))
    assert type(received) is type(error)
    assert (str(received), vars(received)) == (str(error), vars(error))


def test_a_timeout_before_the_first_step_reports_the_angle_to_the_point(head):
    result = head.look_at(LEFT, timeout=1e-6)
    assert not result.arrived
    assert result.miss == pytest.approx(math.pi / 4, abs=0.1)


def test_a_blocked_head_reports_that_it_has_not_arrived(head, servos):
    servos.port.use(lambda bus: bus[1].drive.impede(1.5))  # more than the servo can turn
    result = head.look_at(RIGHT, timeout=5.0)
    assert not result.arrived
    assert result.miss > 0.1


def test_a_newer_command_of_another_thread_supersedes_the_older(head, servos):
    with ThreadPoolExecutor() as threads:
        older = threads.submit(turn_left, head, 0.3)
        wait_for(lambda: servos.true[0] > 0.05)
        assert head.state is HeadState.TURNING
        assert head.look_at(RIGHT).arrived
        with pytest.raises(SupersededError) as superseded:
            older.result(PATIENCE)
    assert superseded.value.miss > 0.5
    assert servos.true[0] < -0.7


def test_a_port_that_this_program_has_open_is_named_as_that(servos, kinectbot):
    """As in a notebook whose cell is run again."""
    with Head(servos.name, kinectbot) as head:
        with pytest.raises(PortBusyError, match="a Head of this program"):
            Head(servos.name, kinectbot)
        assert head.state is HeadState.HOLDING
    Head(servos.name, kinectbot).close()


def test_what_is_missing_raises_its_error_and_leaves_the_port_alone(servos, kinectbot):
    for port in ("/dev/ttyNOT0", Path("/dev/ttyNOT0")):
        with pytest.raises(PortMissingError) as missing:
            Head.open(port)
        assert missing.value.port_name == "/dev/ttyNOT0"
    with pytest.raises(ConfigurationError):
        Head.open("/dev/ttyNOT0", baud_rate=0)
    pair = (
        JointConfiguration("head_pan_joint", 1, controller="a"),
        JointConfiguration("head_tilt_joint", 9, controller="b"),
    )
    with pytest.raises(ServoNotFoundError) as no_servo:
        Head(servos.name, kinectbot, pair, reply_timeout=0.2)
    with pytest.raises(HeadTrackingError, match="nose") as no_frame:
        Head(servos.name, kinectbot, pointing_frame="nose", reply_timeout=0.2)
    servos.port.use(lambda bus: bus[2].set_register("CW Angle Limit", 990))  # above the model's
    wide = pair[0], replace(pair[1], id=2)
    with pytest.raises(HeadTrackingError, match="head_tilt_joint"):
        Head(servos.name, kinectbot, wide, reply_timeout=0.2)
    servos.port.use(lambda bus: bus[2].set_register("CW Angle Limit", 0))
    with Head(servos.name, kinectbot, reply_timeout=0.2) as head:
        assert head.state is HeadState.HOLDING
    assert no_servo and no_frame  # an interactive session keeps them


# STOP, relax, and the end


def test_stop_ends_everything_until_resume(head, servos):
    with ThreadPoolExecutor() as threads:
        looking = threads.submit(turn_left, head, 0.5)
        wait_for(lambda: servos.true[0] > 0.1)
        wait_for(lambda: set(head.stop().values()) == {""})
        assert servos.torque == [0, 0]
        with pytest.raises(RefusedCommandError) as refused:
            looking.result(PATIENCE)
    assert refused.value.state == head.state == HeadState.STOPPED
    before = servos.at_rest()
    for command in (head.look_at, head.follow):
        with pytest.raises(RefusedCommandError):
            command(RIGHT)
    assert servos.at_rest() == before
    seen = time.time()
    head.resume()
    assert servos.torque == [1, 1]
    head.follow(RIGHT, stamp=seen)
    assert servos.at_rest() == pytest.approx(before, abs=0.02)  # nothing of before counts
    began = time.monotonic()
    assert head.look_at(RIGHT, max_velocity=6.0).arrived
    way = abs(bearing(*RIGHT[:2]) - before[0])
    assert way / (time.monotonic() - began) < 0.4  # slowly at first


@pytest.mark.parametrize("before", [HeadState.STOPPED, HeadState.RELAXED])
def test_no_servo_holds_if_another_one_is_silent_at_resume(head, servos, before):
    head.stop() if before is HeadState.STOPPED else head.relax()
    wait_for(lambda: servos.torque == [0, 0])
    silent = servos.port.use(lambda bus: bus[1])
    servos.port.use(lambda bus: silent.set_register("ID", 9))
    with pytest.raises(DynamixelError):
        head.resume()
    assert head.state == before
    wait_for(lambda: not servos.port.use(lambda bus: any(s.register("Torque Enable") for s in bus)))
    with pytest.raises(RefusedCommandError):
        head.follow(LEFT)
    servos.port.use(lambda bus: silent.set_register("ID", 1))

    def resumed():
        with suppress(DynamixelError):
            head.resume()
        return head.state == HeadState.HOLDING

    wait_for(resumed)
    assert servos.torque == [1, 1]


def test_a_servo_that_has_shut_down_turns_again_after_recover(head, servos):
    assert head.look_at((2.0, 0.5, 0.6)).arrived
    servos.port.use(lambda bus: bus[1].overload())
    wait_for(lambda: follow_a_swing(head) or head.state == TargetState.STALLED)
    assert set(head.stop().values()) == {""}
    with pytest.raises(TorqueError):
        head.resume()
    head.recover()
    assert (head.state, servos.torque) == (HeadState.STOPPED, [0, 0])
    head.resume()
    assert head.look_at(LEFT).arrived


def test_a_relaxed_head_is_turned_by_hand_and_refuses_commands_until_resume(head, servos):
    assert head.look_at((2.0, 0.5, 0.6)).arrived
    head.relax()
    assert servos.torque == [0, 0]
    servos.turn_by_hand(1, -0.5)
    wait_for(lambda: abs(head.joints["head_pan_joint"] + 0.5) < 3 * DEGREE)
    with pytest.raises(RefusedCommandError) as refused:
        head.look_at(LEFT)
    assert refused.value.state == HeadState.RELAXED
    assert str(refused.value) == head.reason
    before = servos.at_rest()
    head.resume()
    assert servos.at_rest() == pytest.approx(before, abs=0.02)
    assert head.look_at((2.0, 0.0, 0.6)).arrived


def test_a_silent_servo_ends_a_turn_with_an_error_and_is_the_reason(head, servos):
    servo = servos.port.use(lambda bus: bus[1])
    with ThreadPoolExecutor() as threads:
        turning = threads.submit(head.look_at, LEFT, max_velocity=0.3, timeout=30.0)
        wait_for(lambda: abs(servos.true[0]) > 0.05)
        servos.port.use(lambda bus: servo.set_register("ID", 9))
        try:
            assert isinstance(turning.exception(PATIENCE), DynamixelError)
        finally:
            servos.port.use(lambda bus: servo.set_register("ID", 1))
    wait_for(lambda: head.state == HeadState.HOLDING and not head.reason)
    wait_for(lambda: head.follow(LEFT) or head.state is TargetState.TRACKING)
    servos.port.use(lambda bus: servo.set_register("ID", 9))
    try:
        wait_for(lambda: head.state is HeadState.HOLDING and "head_pan_joint" in head.reason)
    finally:
        servos.port.use(lambda bus: servo.set_register("ID", 1))
    wait_for(lambda: head.follow(LEFT) or head.state is TargetState.TRACKING)


def test_a_short_delay_of_the_program_does_not_end_a_turn(head, servos):
    """Its programs stand still between a measurement and what follows from it."""
    with ThreadPoolExecutor() as threads:
        turning = threads.submit(head.look_at, LEFT, max_velocity=0.3, timeout=30.0)
        for turned in (0.05, 0.2):
            wait_for(lambda turned=turned: abs(servos.true[0]) > turned)
            known = head.frames.latest_joint_position("head_pan_joint")
            head.frames.when(
                lambda known=known: head.frames.latest_joint_position("head_pan_joint") != known,
                lambda: time.sleep(0.8),
            )
        assert turning.result(PATIENCE).arrived


def test_an_exception_closes_the_head(servos, kinectbot):
    with pytest.raises(LookupError), Head(servos.name, kinectbot, reply_timeout=0.2) as head:
        head.look_at((2.0, 0.3, 0.6))
        raise LookupError
    assert servos.torque == [0, 0]
    for command in (head.resume, head.relax, lambda: head.look_at(LEFT)):
        with pytest.raises(RefusedCommandError) as refused:
            command()
        assert refused.value.state == HeadState.CLOSED
    head.close()  # twice


@pytest.mark.parametrize(
    ("block", "sent", "number"),
    [
        ("with head", "SIGINT", 9),
        ("if head", "SIGINT", 9),
        ("with head", "SIGTERM", 1),
        ("with head", "SIGHUP", 9),
    ],
)
def test_signals_that_end_the_program_relax_the_servos(servos, block, sent, number):
    turning = f"""
from contextlib import suppress
from head_tracking.dynamixel import DynamixelError
{block}:
    while True:
        with suppress(DynamixelError):  # servos of a busy test may be silent for a moment
            head.look_at({LEFT}, max_velocity=0.4)
"""
    program = run_until_it_turns(servos, turning)
    for _ in range(number):  # while the servos are relaxed, too
        program.send_signal(getattr(signal, sent))
        time.sleep(0.003)
    assert program.wait(PATIENCE) != 0
    wait_for(lambda: servos.torque == [0, 0])  # they answer when this process has time


# Ctrl-C in a callback of the garbage collector, such as hypothesis has one, ends nothing
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_ctrl_c_at_any_moment_leaves_the_head_usable(head):
    """As in an interactive session."""
    commands = (
        lambda: head.look_at(LEFT),
        lambda: [head.pose("camera_link", stamp=time.time()) for _ in range(20)],
        lambda: (head.relax(), head.resume()),
        lambda: (head.stop(), head.resume()),
    )
    with on_alarm(lambda *_: signal.raise_signal(signal.SIGINT)):
        for number in range(120):
            with suppress(KeyboardInterrupt, DynamixelError, RefusedCommandError):
                signal.setitimer(signal.ITIMER_REAL, random.uniform(1e-4, 0.05))
                try:
                    commands[number % len(commands)]()
                finally:  # nothing comes between here and the end of the block
                    signal.setitimer(signal.ITIMER_REAL, 0.0)

    def resumed():
        with suppress(DynamixelError, RefusedCommandError):  # a STOP may not have ended
            head.resume()
        return head.state == HeadState.HOLDING

    wait_for(resumed)
    assert head.look_at(RIGHT).arrived


def test_a_signal_handler_can_stop_the_head(head, servos):
    with on_alarm(lambda *_: head.stop()):
        for _ in range(100):
            signal.setitimer(signal.ITIMER_REAL, random.uniform(1e-4, 5e-3))
            with suppress(RefusedCommandError):
                while True:
                    head.follow(LEFT, stamp=time.time())
            wait_for(lambda: servos.torque == [0, 0])
            head.resume()


def test_stop_and_close_relax_the_servos_while_a_log_handler_hangs(servos, kinectbot):
    hangs, continues = threading.Event(), threading.Event()

    class Hanging(logging.Handler):
        def emit(self, record):
            if threading.current_thread().name == "servo bus":
                hangs.set()
                continues.wait(PATIENCE)

    handler, logger = Hanging(), logging.getLogger("head_tracking")
    logger.addHandler(handler)
    try:
        head = Head(servos.name, kinectbot, reply_timeout=0.2)
        assert head.look_at((2.0, 0.3, 0.6)).arrived
        head.follow((0.0, 0.0, 1.0), "camera_link", stamp=1.0)
        assert hangs.wait(PATIENCE)
        wait_for(lambda: set(head.stop().values()) == {""})
        assert servos.torque == [0, 0]
        with pytest.raises(DynamixelError):
            head.close()
        assert head.state == HeadState.CLOSED
    finally:
        continues.set()
        logger.removeHandler(handler)


def test_a_log_handler_that_fails_costs_its_messages_only(head):
    failed = threading.Event()

    class Failing(logging.Handler):
        def emit(self, record):
            failed.set()
            raise RuntimeError

    handler, logger = Failing(), logging.getLogger("head_tracking")
    logger.addHandler(handler)
    try:
        head.follow((0.0, 0.0, 1.0), "camera_link", stamp=1.0)
        assert failed.wait(PATIENCE)
        wait_for(lambda: head.look_at(LEFT).arrived)
    finally:
        logger.removeHandler(handler)


def test_a_timeout_error_of_a_signal_handler_ends_look_at(head):
    """It is no timeout of look_at."""

    def interrupt(*_):
        raise TimeoutError

    with on_alarm(interrupt), pytest.raises(TimeoutError):
        signal.setitimer(signal.ITIMER_REAL, 0.3)
        head.look_at(LEFT, max_velocity=0.2)
    assert head.state is HeadState.HOLDING


def test_a_program_keeps_its_own_signal_handlers(servos):
    """Before and after a block, and those that it sets inside."""
    program = f"""
import signal, os
def own(*_): print("own")
signal.signal(signal.SIGHUP, signal.SIG_IGN)
with head:
    assert head.look_at({LEFT}, max_velocity=0.4).arrived
    os.kill(os.getpid(), signal.SIGHUP)
    signal.signal(signal.SIGTERM, own)
    os.kill(os.getpid(), signal.SIGTERM)
assert signal.getsignal(signal.SIGTERM) is own
assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
"""
    assert run_until_it_turns(servos, program).wait(PATIENCE) == 0


def test_the_end_of_the_program_relaxes_the_servos(servos):
    program = run_until_it_turns(servos, f"head.look_at({LEFT}, max_velocity=0.2, timeout=3.0)\n")
    assert program.wait(PATIENCE) == 0
    wait_for(lambda: servos.torque == [0, 0])


def test_a_fork_of_the_program_ends_by_a_signal_as_usual():
    """As a pool ends its workers; one that raises an error instead may keep the pool's locks."""
    program = """
import multiprocessing, time
from head_tracking import Head
def work():
    runs.set()
    time.sleep(60)
context = multiprocessing.get_context("fork")
runs = context.Event()
with Head.simulated():
    fork = context.Process(target=work)
    fork.start()
    runs.wait()  # Python forgets signals that come while it forks
    fork.terminate()
    fork.join()
    print(fork.exitcode)
"""
    ended = run_python("-c", program)
    assert (ended.stdout, ended.stderr) == (f"{-signal.SIGTERM}\n", "")


def test_a_fork_of_the_program_has_a_closed_head_and_leaves_that_of_the_program_alone():
    """The thread that reads the servos is not in the fork: a command would never be carried out."""
    program = """
import os, sys
from head_tracking import Head, RefusedCommandError
with Head.simulated() as head:
    head.look_at((1.0, 0.3, 0.4))
    if (fork := os.fork()) == 0:
        for command in (head.look_at, head.follow):
            try:
                command((1.0, 0.0, 0.4))
            except RefusedCommandError as error:
                print(error)
        print(head.state, list(head.stop().values()), flush=True)
        sys.exit()
    print(os.waitpid(fork, 0)[1], head.state, head.look_at((1.0, 0.0, 0.4)).arrived)
"""
    ended = run_python("-c", program)
    belongs = "the head belongs to another process"
    assert ended.stdout.splitlines() == [
        *["the head is closed; open it again"] * 2,
        f"closed {[belongs] * 2}",
        "0 holding True",
    ]
    assert ended.stderr == ""


def test_every_argument_of_a_public_method_is_described():
    for name, method in inspect.getmembers(Head, callable):
        text = inspect.getdoc(method) or ""
        if not name.startswith("_") and "see `open`" not in text:
            for argument in list(inspect.signature(method).parameters):
                assert argument == "self" or f"\n    {argument}: " in text, f"{name}: {argument}"
