"""Random sequences of goals, cancels, STOP, switches and other owners, in simulated time."""

import itertools
import math
import os

import pytest
import rclpy
from hypothesis import example, given, settings
from hypothesis import strategies as st
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import SetBool

from head_tracking.dynamixel import StoppedError
from head_tracking.tracking import Target

goals = pytest.importorskip("goals")
EXAMPLES = int(os.environ.get("HEAD_TRACKING_EXAMPLES", "15"))

POINTS = st.tuples(st.floats(-2.4, 2.4), st.floats(-0.9, 0.9), st.sampled_from([0.0, 0.3, 9.0]))
TRAJECTORIES = st.tuples(
    st.lists(st.tuples(st.floats(-2.0, 2.0), st.floats(-0.9, 0.9)), max_size=3),
    st.sampled_from([0.05, 0.4, 1.0]),
    st.sampled_from([0.0, 0.05, -1.0]),
)
STEPS = st.one_of(
    st.tuples(st.just("point"), POINTS),
    st.tuples(st.just("follow"), TRAJECTORIES),
    st.tuples(st.just("stream"), TRAJECTORIES),
    st.tuples(
        st.sampled_from(
            ["cancel", "stop", "resume", "off", "on", "other", "release", "recenter", "target"]
        ),
        st.none(),
    ),
    st.tuples(st.just("wait"), st.sampled_from([0.01, 0.1, 0.5, 3.0])),
)


@pytest.fixture(scope="module", autouse=True)
def ros():
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    rclpy.logging.set_logger_level("point_head", rclpy.logging.LoggingSeverity.FATAL)
    yield
    rclpy.logging.set_logger_level("point_head", rclpy.logging.LoggingSeverity.UNSET)
    rclpy.shutdown()


class Driven:
    """A head, what is asked of it, and what must be true of that."""

    def __init__(self, model):
        self.head = goals.PointedHead(model)
        self.world, self.node = self.head.world, self.head.node
        self.control, self.actions = self.node.control, self.node.actions
        self.sent = []
        self.owners = self.world.loop.owners
        self.stopped = self.off = False
        self.before = ""  # who goes on after resume
        self.written = 0
        write = self.world.write

        def record(sender, told, epoch):
            assert not self.stopped, "told something although stopped"
            assert not self.off, "told something although off"
            for goal, limits in zip(
                told.values(), (self.head.head.pan_limits, self.head.head.tilt_limits), strict=True
            ):
                assert limits.contains(goal.position, 1e-9)
                assert 0.0 < goal.speed <= limits.velocity
            self.written += 1
            assert epoch == self.owners.epoch.value
            write(sender, told, epoch)

        self.world.write = record

    @property
    def mine(self):
        return not (self.stopped or self.off)

    @property
    def turning(self):
        state, _ = self.control.state()
        return state == "turning"

    @property
    def busy(self):
        return self.control.motion is not self.control.targets

    def under_way(self):
        return [goal for goal in self.sent if not goal.status]

    def send(self, request, begin):
        goal = goals.HeldGoal(request)
        before = self.under_way()
        self.sent.append(goal)
        begin(goal)
        return goal, before

    def point(self, wish):
        bearing, elevation, velocity = wish
        x, y = 2.0 * math.cos(bearing), 2.0 * math.sin(bearing)
        request = goals.point_goal(
            x, y, 2.0 * math.tan(elevation), self.head.head.base_frame, velocity=velocity
        )
        refusal = self.actions.point_refusal(request)
        assert bool(refusal) is not self.mine, refusal
        if not refusal:
            goal, before = self.send(request, self.actions.point)
            assert all(older.status == "aborted" for older in before)
            assert not goal.status

    def message(self, wish):
        points, period, path = wish
        timed = [((number + 1) * period, point) for number, point in enumerate(points)]
        return timed, {"path": dict.fromkeys(goals.JOINTS, path)} if points else {}

    def follow(self, wish):
        timed, options = self.message(wish)
        request = goals.following(*timed, **options)
        goal, before = self.send(request, self.actions.follow)
        if self.mine:
            assert all(older.status == "aborted" for older in before)
        else:
            assert goal.status == "aborted"
            assert goal.answer.error_code == -1
            assert goal.answer.error_string

    def stream(self, wish):
        self.world.publish("/point_head/joint_trajectory", goals.trajectory(*self.message(wish)[0]))

    def cancel(self, _):
        for goal in self.under_way():
            goal.on_cancel()
            assert goal.status == "canceled"

    def stop(self, _):
        if not self.stopped:
            self.before = self.owners.of(goals.JOINTS)[goals.JOINTS[0]]
        self.owners.stop(dict)
        self.stopped = True
        self.world.run(0.03)
        assert not self.under_way()

    def resume(self, _):
        resumed = self.owners.resume(self.owners.epoch.value)
        if self.stopped:
            assert resumed == tuple(filter(None, [self.before]))
            self.off = self.before != "/point_head"
        self.stopped = False

    def switched(self, on):
        request, response = SetBool.Request(data=on), SetBool.Response()
        self.node._on_enable(request, response)
        return response.success

    def turn_on(self, _):
        assert self.switched(True) is not self.stopped
        self.off = self.off and self.stopped

    def turn_off(self, _):
        assert self.switched(False)
        if self.before == "/point_head":
            self.before = ""
        self.off = True
        assert not self.under_way()

    def take_over(self, _):
        if self.stopped:
            with pytest.raises(StoppedError):
                self.owners.take_over("/somebody", goals.JOINTS)
        else:
            self.owners.take_over("/somebody", goals.JOINTS)
            self.off = True
            self.world.run(0.03)
            assert not self.under_way()

    def release(self, _):
        self.owners.release("/somebody")
        if self.before == "/somebody":
            self.before = ""

    def recenter(self, _):
        request, response = None, type("Response", (), {"success": False, "message": ""})()
        self.node._on_recenter(request, response)
        if response.success:
            assert not self.under_way()

    def target(self, _):
        self.control.accept(Target(0, self.head.head.base_frame, (2.0, 0.5, 0.2)))

    def wait(self, seconds):
        self.world.run(seconds)


NAMES = {"on": "turn_on", "off": "turn_off", "other": "take_over"}


@settings(max_examples=EXAMPLES)
@given(st.lists(STEPS, min_size=3, max_size=12))
@example([("point", (1.0, 0.0, 0.3)), ("wait", 0.5), ("stop", None), ("resume", None)])
@example([("point", (1.0, 0.0, 0.3)), ("cancel", None), ("target", None)])
@example([("wait", 0.1), ("stop", None), ("on", None)])
@example([("follow", ([(1.0, 0.0)], 1.0, 0.05)), ("wait", 0.1), ("cancel", None), ("wait", 0.5)])
def test_random_requests_end_each_goal_once_and_move_nothing_forbidden(kinectbot, steps):
    driven = Driven(kinectbot)
    try:
        for name, wish in itertools.chain(steps, [("wait", 0.1)]):
            getattr(driven, NAMES.get(name, name))(wish)
            assert len(driven.under_way()) <= 1
            assert driven.busy >= bool(driven.under_way())
        waited = 0.0
        while driven.under_way() or driven.busy or driven.turning:
            driven.wait(0.5)
            waited += 0.5
            assert waited < 30.0
        if driven.mine:
            driven.wait(0.1)
            count = driven.written
            driven.wait(1.0)
            assert driven.written == count, "at rest, and still told something"
    finally:
        driven.node.destroy_node()


def begun(head, kind):
    """A goal that turns pan for some seconds, and has just done so for a while."""
    if kind == "point":
        goal = goals.HeldGoal(goals.point_goal(0.0, 2.0, 0.1, head.head.base_frame, velocity=0.5))
        head.node.actions.point(goal)
    else:
        goal = goals.HeldGoal(
            goals.following((4.0, (1.2, 0.0)), path=dict.fromkeys(goals.JOINTS, -1.0))
        )
        head.node.actions.follow(goal)
    head.world.run(1.0)
    assert not goal.status
    return goal


@pytest.mark.parametrize("kind", ["point", "follow"])
def test_a_blocked_joint_aborts_the_goal(kinectbot, kind):
    head = goals.PointedHead(kinectbot)
    goal = begun(head, kind)
    _, servo = head.world._servos["head_pan_joint"]
    servo.impede(1.5)
    head.world.run(0.6)
    assert goal.status == "aborted"
    assert "head_pan_joint not following" in head.said
    assert ("misses the target by" in head.said) is (kind == "point")
    if kind == "follow":
        assert goal.answer.error_code == -4
        assert "head_pan_joint" in goal.answer.error_string
    servo.impede(0.0)
    stood = head.true
    head.world.run(1.0)
    assert head.true == pytest.approx(stood, abs=0.05)  # nobody takes it on
    assert head.look_at((2.0, 0.5, 0.1)).status == "succeeded"


@pytest.mark.parametrize("kind", ["point", "follow"])
def test_a_diagnosis_of_the_servo_bus_aborts_the_goal(kinectbot, kind):
    head = goals.PointedHead(kinectbot)
    head.world.loop.stuck["head_pan_joint"] = "an old story"
    goal = begun(head, kind)
    head.world.loop.stuck["head_pan_joint"] = "head_pan_joint (id 1): servo 1: torque lost"
    head.world.run(0.05)
    assert goal.status == "aborted"
    assert head.said.startswith("aborted: ")
    assert "servo 1: torque lost" in head.said
