"""The page beside stand-ins for the robot: STOP whatever else fails, modes, and what it misses."""

import threading
import time
from concurrent.futures import ThreadPoolExecutor

import httpx
import pytest
from contract_nodes import BusStandIn, ControllerStandIn
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import PointStamped
from rclpy.node import Node
from rig import JOINTS, LATCHED
from std_msgs.msg import Header
from std_srvs.srv import SetBool, Trigger
from viewing import view
from waiting import PATIENCE, wait_for

from head_tracking.exceptions import HeadTrackingError
from head_tracking.page.head_modes import Mode
from head_tracking.page.path import ClosedPath


@pytest.fixture
def page(threads):
    """Starts a page, and returns the robot as it sees it."""
    return lambda **options: view(threads, **options).robot


@pytest.fixture
def tracked(start, page):
    """A bus, a tracker, and the robot as its page sees it."""
    bus, tracker, robot = start(BusStandIn()), start(ControllerStandIn("head_tracker")), page()
    wait_for(lambda: robot.modes.mode() is Mode.TRACK)
    return bus, tracker, robot


def test_stop_says_by_servo_what_was_confirmed_and_goes_on_until_it_is(start, page):
    bus = start(BusStandIn())
    bus.confirms = {"head_pan_joint"}
    robot = page()
    robot.stop.begin()
    text = "head_pan_joint relaxed, head_tilt_joint NOT confirmed"
    wait_for(lambda: robot.stop.outcome == (False, text))
    wait_for(lambda: bus.calls.count("stop") > 2 and robot.stop.stopped)
    bus.say_stopped(False)  # resumed by somebody else
    wait_for(lambda: robot.stop.outcome is None)
    robot.stop.begin()
    bus.confirms.add("head_tilt_joint")
    wait_for(lambda: robot.stop.outcome.done)
    assert robot.stop.outcome.text == "head_pan_joint relaxed, head_tilt_joint relaxed"
    wait_for(lambda: robot.stop.stopped and robot.stop.can_resume)
    robot.stop.resume()
    wait_for(lambda: not robot.stop.stopped)
    assert robot.stop.outcome is None


def test_a_bus_that_is_restarted_does_not_end_a_stop_that_was_not_confirmed(start, page):
    bus, robot = start(BusStandIn()), page()
    bus.confirms = set()
    robot.stop.begin()
    wait_for(lambda: robot.stop.stopped)
    bus.say_stopped = lambda _: None
    bus.own("", False, 0)
    wait_for(lambda: not robot.stop.stopped)
    before = len(bus.calls)
    wait_for(lambda: len(bus.calls) > before + 1)


def test_a_bus_without_short_names_is_stopped_and_resumed(start, page):
    base = Node("mobile_base")  # with a service `stop` of its own, which confirms
    for name in ("stop", "resume", "recover"):
        base.create_service(Trigger, name, lambda _, __: Trigger.Response(success=True))
    control = base.create_publisher(DiagnosticStatus, "joint_control", LATCHED)
    control.publish(DiagnosticStatus(values=[KeyValue(key="epoch", value="1")]))  # of no node
    start(base)
    bus = start(BusStandIn(offers=("~/stop", "~/recover", "~/resume")))
    robot = page()
    assert robot.stop.begin().wait(PATIENCE).done
    wait_for(lambda: robot.stop.can_resume)
    robot.stop.resume()
    wait_for(lambda: robot.joints.can_recover)
    robot.joints.recover()
    with pytest.raises(HeadTrackingError):
        robot.joints.set_torque("", True)
    bus.create_service(SetBool, "~/torque_enable", bus._on_torque)
    wait_for(lambda: robot.services.offered("servo_bus/torque_enable"))
    robot.joints.set_torque("", True)
    assert {*bus.calls} == {"~/stop", "~/resume", "~/recover"}
    assert robot.stop.buses == {"servo_bus"}


def test_without_a_bus_stop_disables_the_tracker_and_is_done_when_one_comes(start, page):
    tracker, robot = start(ControllerStandIn("head_tracker")), page()
    wait_for(lambda: robot.modes.mode() is Mode.TRACK)
    outcome = robot.stop_everything().wait()
    assert not outcome.done
    assert "NOT confirmed" in outcome.text
    wait_for(lambda: not tracker.on)
    bus = start(BusStandIn())
    wait_for(lambda: "stop" in bus.calls)


@pytest.mark.parametrize("by_page", [True, False])
def test_a_stop_ends_what_the_page_sends_for_good(tracked, by_page):
    bus, tracker, robot = tracked
    robot.modes.follow_path(ClosedPath([(1.0, 0.0, 1.0), (1.0, 1.0, 1.0)]), 0.1)
    assert robot.modes.mode() is Mode.PATH
    assert robot.stop.begin().wait(PATIENCE).done if by_page else bus.say_stopped(True) is None
    wait_for(lambda: robot.stop.stopped)
    with pytest.raises(HeadTrackingError, match="Resume first"):
        robot.modes.look_at("base_link", (1.0, 0.0, 1.0))  # a drag
    bus.say_stopped(False)
    wait_for(lambda: not robot.stop.stopped)
    assert tracker.on
    wait_for(lambda: robot.modes.mode() is Mode.TRACK)


def test_many_requests_of_stop_are_one_attempt_and_no_thread_waits_for_each(
    start, threads, monkeypatch
):
    bus = start(BusStandIn())
    bus.confirms = set()
    bus.say_stopped = lambda _: None
    node, go_on = view(threads), threading.Event()
    monkeypatch.setattr(node.robot.modes, "set_mode", lambda _: go_on.wait(60.0))

    def press(_):
        """Without a body that could be parsed."""
        asked = {"content": b"[", "headers": {"X-Head-Tracking": "page"}, "timeout": 60.0}
        return httpx.post(f"http://127.0.0.1:{node.page.port}/head/stop", **asked).json()

    before = node.robot.stop.count
    with ThreadPoolExecutor(12, "press") as browsers:
        assert not any(answer["done"] for answer in browsers.map(press, range(12)))
        assert node.robot.stop.count == before + 12
        names = [one.name for one in threading.enumerate()]
    assert sum("stop" in name or "_disable_modes" in name for name in names) <= 3
    bus.confirms = set(JOINTS)
    wait_for(lambda: node.robot.stop.outcome.done)
    wait_for(lambda: press(0)["done"])
    go_on.set()


def test_a_mode_is_chosen_after_resume_only(start, tracked):
    bus, tracker, robot = tracked
    pointer = start(ControllerStandIn("point_head", on=False))
    wait_for(lambda: Mode.POINT in robot.modes.possible())
    bus.confirms = set()
    assert not robot.stop.begin().wait().done  # it is tried on; a choice does not end that
    for mode in (Mode.POINT, Mode.TRACK):
        with pytest.raises(HeadTrackingError, match="Resume first"):
            robot.modes.set_mode(mode)
    assert (tracker.asked, pointer.asked) == ([], [])
    with pytest.raises(HeadTrackingError):
        robot.joints.move({"head_pan_joint": 0.2})
    assert not bus.commands
    count = len(bus.calls)
    wait_for(lambda: len(bus.calls) > count)
    assert robot.stop.can_resume
    robot.stop.resume()
    wait_for(lambda: not robot.stop.can_resume)
    robot.modes.set_mode(Mode.POINT)
    assert pointer.asked == [True]


def test_a_stop_ends_a_change_of_modes_that_is_under_way(start, tracked):
    bus, tracker, robot = tracked
    pointer = start(ControllerStandIn("point_head", on=False))
    wait_for(lambda: Mode.POINT in robot.modes.possible())
    switch = tracker.switch

    def stopped_meanwhile(on):
        bus.say_stopped(True)
        wait_for(lambda: robot.stop.stopped)
        switch(on)

    tracker.switch = stopped_meanwhile
    with pytest.raises(HeadTrackingError, match="stopped"):
        robot.modes.set_mode(Mode.POINT)
    assert pointer.asked == []


def test_a_node_that_starts_turns_the_head_in_no_other_mode(start, tracked):
    """It is enabled when it starts, and sends what it finds."""
    _, tracker, robot = tracked
    starter, enabled = Node("starter"), []

    def on_start(_, response):
        enabled.append(tracker.on)
        start(ControllerStandIn("fictitious_target"))
        response.success = True
        return response

    starter.create_service(Trigger, "node_starter/fictitious_target", on_start)
    start(starter)
    wait_for(lambda: Mode.FICTITIOUS in robot.modes.possible())
    robot.modes.set_mode(Mode.FICTITIOUS)
    assert enabled == [False]
    assert tracker.on
    assert robot.modes.mode() is Mode.FICTITIOUS


def test_what_has_waited_over_a_stop_and_resume_does_not_move_the_head(tracked):
    bus, tracker, robot = tracked
    wait_for(lambda: len(robot.joints.servos()) == 2 and robot.model())
    switch = tracker.switch

    def stop_and_resume():
        for stopped in (True, False):
            bus.say_stopped(stopped)
            wait_for(lambda stopped=stopped: robot.stop.stopped is stopped)

    with ThreadPoolExecutor() as browsers, robot.modes._changing:
        asked = browsers.submit(robot.modes.centre)
        time.sleep(0.3)  # in which it begins to wait
        stop_and_resume()
    assert "stopped" in str(asked.exception())
    tracker.switch = lambda on: (stop_and_resume(), switch(on))
    with pytest.raises(HeadTrackingError, match="stopped"):
        robot.joints.move({"head_pan_joint": 0.2})
    assert not bus.commands


def test_two_choices_of_a_mode_leave_one_controller_enabled(start, tracked):
    """The second one comes while the first one waits for an answer."""
    _, tracker, robot = tracked
    pointer, go_on = start(ControllerStandIn("point_head", on=False)), threading.Event()
    switch = pointer.switch
    pointer.switch = lambda on: go_on.wait(PATIENCE) and switch(on)
    wait_for(lambda: Mode.POINT in robot.modes.possible())
    with ThreadPoolExecutor(2) as browsers:
        browsers.submit(robot.modes.set_mode, Mode.POINT)
        wait_for(lambda: pointer.asked == [True])
        second = browsers.submit(robot.modes.set_mode, Mode.TRACK)
        time.sleep(0.3)  # in which it may overtake the first one
        go_on.set()
        second.result(PATIENCE)
    wait_for(lambda: (tracker.on, pointer.on) == (True, False))


def test_stop_does_not_wait_for_other_requests(start, page):
    """All else that the page asks for goes through one thread; that may hang."""
    bus = start(BusStandIn())
    robot = page()
    robot._requests.node.create_timer(0.01, lambda: time.sleep(60.0))
    assert robot.stop.begin().wait(50.0).done
    assert "stop" in bus.calls


def test_robots_in_one_graph_have_a_page_each(start, page):
    buses, pages = {}, {}
    for side in ("", "left", "right"):
        buses[side] = start(BusStandIn(side))
        buses[side].message = f"it is the {side} one"
        start(ControllerStandIn("head_tracker", namespace=side))
        pages[side] = page(namespace=side)

    def told(side):
        health = [(one.name, one.message) for one in pages[side].topics.health()]
        return health == [(f"servo_bus: {joint}", buses[side].message) for joint in JOINTS]

    for side, robot in pages.items():
        wait_for(lambda robot=robot: robot.modes.mode() is Mode.TRACK)
        wait_for(lambda robot=robot: len(robot.joints.servos()) == 2)
        nodes = {one.node for one in robot.parameters.settings()}
        assert all(node.rpartition("/")[0] == f"/{side}".rstrip("/") for node in nodes)
    wait_for(lambda: all(map(told, pages)))
    for stopped in ("left", ""):
        assert pages[stopped].stop_everything().wait(PATIENCE).done
        wait_for(lambda robot=pages[stopped]: robot.stop.stopped)
        running = [side for side in pages if not pages[side].stop.stopped]
        assert running == (["", "right"] if stopped else ["right"])
        assert all(pages[side].modes.mode() is Mode.TRACK for side in running)
        assert all(buses[side].calls == [] for side in running)


def test_joints_moved_by_hand_are_commanded_in_the_pages_name_when_they_are_let_go(tracked):
    bus, tracker, robot = tracked
    wait_for(lambda: len(robot.joints.servos()) == 2)
    wait_for(robot.model)
    with pytest.raises(HeadTrackingError):
        robot.joints.move({"head_pan_joint": 0.2, "nose": 0.1})
    assert tracker.on is True
    robot.joints.move({"head_pan_joint": 0.2})
    assert tracker.on is False
    wait_for(lambda: bus.commands)
    assert bus.commands[-1].header.frame_id == "/viewer"
    bus.own("/somebody")
    wait_for(lambda: "somebody" in robot.stop.owners.values())
    with pytest.raises(HeadTrackingError, match="somebody"):
        robot.joints.move({"head_pan_joint": 0.3})


def test_two_senders_are_named_and_the_page_takes_over_from_one(start, page):
    start(ControllerStandIn("head_tracker"))
    names = ("visual", "frame", "detection")
    camera, *others = (start(ControllerStandIn(f"{name}_target")) for name in names)
    robot = page()
    wait_for(lambda: all(f"{name}_target" in "".join(robot.notices()) for name in names))
    for other in others:
        other.switch(False)
    wait_for(lambda: robot.modes.mode() is Mode.VISUAL and not robot.notices())
    wait_for(lambda: "base_link" in robot.buffer.frames())
    seen = PointStamped(header=Header(frame_id="base_link"))
    targets = camera.create_publisher(PointStamped, "target_point", 10)
    wait_for(lambda: targets.publish(seen) or robot.observe().target is not None)
    robot.modes.look_at("base_link", (1.0, 0.0, 0.5))
    assert camera.on is False, "one sender only"
    assert robot.observe()
    assert robot.notices() == ()


def test_joints_that_were_moved_before_the_model_came_are_published_when_it_has(page, monkeypatch):
    robot = page()
    wait_for(lambda: robot.joints.free)
    asked = []
    with monkeypatch.context() as patch:
        patch.setattr(type(robot.buffer), "model", property(lambda buffer: asked.append(None)))
        robot.joints.move({"head_pan_joint": 0.25})
        wait_for(lambda: len(asked) > 3)  # by the timer, and by others
        time.sleep(0.2)
    wait_for(lambda: robot.observe().joints.get("head_pan_joint") == 0.25)


# servos and hardware, joints that fall silent and nodes that have gone


@pytest.fixture
def seen(page, monkeypatch):
    monkeypatch.setattr("head_tracking.page.robot._PATIENCE", 0.5)
    return page()


def test_with_servos_the_page_never_publishes_the_joints_itself(seen, monkeypatch):
    """Not even until it looks for publishers of joint states again, a second later."""
    wait_for(lambda: seen.joints.free)
    monkeypatch.setattr(seen.joints, "discover", lambda: None)
    bus = BusStandIn()
    wait_for(lambda: bus.diagnose() or seen.joints.servos())
    assert not seen.joints.free
    assert all(one.torque for one in seen.joints.servos())
    wait_for(lambda: all(one.torque is None for one in seen.joints.servos()))  # it is silent
    assert all("torque" not in one.values for one in seen.joints.servos())
    bus.destroy_node()
    wait_for(lambda: not seen.joints.servos())
    wait_for(lambda: seen.silent_joints() == JOINTS)
    assert not seen.joints.free


def test_a_tracker_that_goes_away_is_missed_until_it_comes_again(seen):
    assert seen.modes.missing() == (), "there was none"
    node = ControllerStandIn("head_tracker")
    wait_for(lambda: seen.modes.mode() is Mode.TRACK)
    assert seen.modes.missing() == ()
    node.destroy_node()
    wait_for(lambda: seen.modes.missing() == ("head_tracker",))
    node = ControllerStandIn("head_tracker")
    wait_for(lambda: seen.modes.missing() == ())


def test_without_hardware_one_page_says_where_the_joints_are_and_stop_is_not_confirmed(page):
    seen, other = page(), page()
    for robot in (seen, other):
        wait_for(lambda robot=robot: robot.joints.free)
    assert "head_pan_joint" not in seen.observe().joints
    seen.joints.move({"head_pan_joint": 0.25})
    for robot in (seen, other):
        wait_for(lambda robot=robot: robot.observe().joints.get("head_pan_joint") == 0.25)
        assert robot.observe().joints["head_tilt_joint"] == 0.0
    wait_for(lambda: not other.joints.free)
    assert seen.joints.free
    assert not seen.stop_everything().wait().done
    with pytest.raises(HeadTrackingError, match="Resume first"):
        seen.modes.set_mode(Mode.TRACK)
    with pytest.raises(HeadTrackingError):
        seen.stop.resume()
    assert seen.stop.outcome is None
    with pytest.raises(HeadTrackingError):
        seen.modes.centre()
    with pytest.raises(HeadTrackingError, match="not running"):
        seen.modes.set_mode(Mode.TRACK)
