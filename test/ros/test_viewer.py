"""The viewer's page in a real browser, on a robot over real topics and the simulated bus."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from browser import (
    PATIENCE,
    NoBrowser,
    choose,
    chromium,
    drag,
    node_position,
    node_wxyz,
    open_browser,
    open_page,
    open_tab,
    pixels,
    press,
    row,
    type_number,
)
from rclpy.parameter import Parameter
from robot_under_test import Robot
from sensor_msgs.msg import Image, JointState
from std_msgs.msg import Header
from waiting import eventually, wait_for

from head_tracking.recording.recording_file import read_recording
from head_tracking.ros.kit.images import image_message
from head_tracking.transforms import Rotation, Transform

DEGREE = math.radians(1)
HIGH = 0.5 + 0.0325
"""0.5 m in base_link, in the world that the page draws."""
MEAN_COLOUR = """() => {
  const image = document.querySelector("img[src^='blob:']");
  if (!image || !image.naturalWidth) return null;
  const canvas = document.createElement("canvas").getContext("2d");
  canvas.drawImage(image, 0, 0, 1, 1);
  return [...canvas.getImageData(0, 0, 1, 1).data.slice(0, 3)];
}"""
CUT_OFF = """() => [...document.querySelectorAll("button, input, [role=tab]")].filter((one) => {
  const {left, right, width} = one.getBoundingClientRect();
  return width && one.checkVisibility() && (left < -1 || right > innerWidth + 1);
}).map((one) => one.id || one.textContent || one.placeholder)"""
BUSY = "() => { const end = performance.now() + 6000; while (performance.now() < end); }"
HEAD = ("head_pan_joint", "head_tilt_joint")


@pytest.fixture(scope="module")
def robot(make_module_robot) -> Iterator[Robot]:
    try:
        chromium()
    except NoBrowser as missing:
        pytest.skip(str(missing))
    yield make_module_robot("--mode", "point", "--viewer")


@pytest.fixture(scope="module")
def viewer(robot, tmp_path_factory) -> Any:
    """The viewer in this process."""
    from head_tracking.nodes.viewer import ViewerNode

    folder = Parameter("record_directory", value=str(tmp_path_factory.mktemp("recordings")))
    node = ViewerNode(robot.composition.buffer, parameter_overrides=[folder])
    robot.threads.start(node)
    return node


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with open_browser() as browser:
        yield browser


@pytest.fixture(scope="module")
def page(viewer, browser) -> Any:
    return open_page(browser, viewer.page.port)


def joint_field(page: Any, joint: str) -> Any:
    """The number beside a joint's slider."""
    return row(page, joint).locator("input:visible").last


def test_the_page_shows_the_robot(page):
    def blue() -> int:
        r, g, b = (pixels(page)[:, :550, channel].astype(int) for channel in range(3))
        return int(np.count_nonzero((b > r + 40) & (b > g + 20)))

    wait_for(lambda: blue() > 500, PATIENCE)  # the torso


def test_point_head_moves_the_simulated_servo(robot, page):
    open_tab(page, "Steer")
    type_number(page, "x y z (m)", 1.0, 1.0, 0.5)
    press(page, "Point head")
    wait_for(
        lambda: abs(robot.true("head_pan_joint") - math.atan2(1, 1 - 0.0115)) < 2 * DEGREE, PATIENCE
    )


def test_a_refused_target_says_why_and_moves_nothing(robot, page):
    open_tab(page, "Steer")
    type_number(page, "x y z (m)", -1.0, 0.0, 0.5)
    before = robot.at_rest()
    robot.forget_log()
    press(page, "Point head")
    robot.logged("out of reach")
    page.get_by_text("out of reach").first.wait_for()
    assert robot.at_rest() == pytest.approx(before, abs=DEGREE)


def test_an_emptied_field_shows_the_value_that_counts_again(page):
    open_tab(page, "Steer")
    type_number(page, "x y z (m)", 0.75, 0.0, 0.5)
    field = row(page, "x y z (m)").locator("input:visible").first
    field.fill("")
    field.blur()
    wait_for(lambda: field.input_value() == "0.75", PATIENCE)


def test_the_menu_lists_a_frame_that_appears_later(robot, viewer, page):
    open_tab(page, "Steer")
    core = robot.composition.buffer.core
    core.set_transform(
        0, "base_link", "late_gripper", Transform((0.4, 0.2, 0.6), Rotation.identity()), static=True
    )
    wait_for(lambda: "late_gripper" in viewer.robot.buffer.frames())
    choose(page, "Frame", "late_gripper")
    type_number(page, "x y z (m)", 0.0, 0.0, 0.0)
    press(page, "Point head")
    wait_for(
        lambda: abs(robot.true("head_pan_joint") - math.atan2(0.2, 0.4 - 0.0115)) < 3 * DEGREE,
        PATIENCE,
    )


def test_the_target_is_dragged_with_the_mouse(robot, viewer, page):
    open_tab(page, "Steer")
    type_number(page, "x y z (m)", 0.5, 0.0, 0.5)
    choose(page, "Frame", "base_link")
    press(page, "Point head")
    wait_for(lambda: node_position(page, "/gizmo") == pytest.approx((0.5, 0.0, HIGH)), PATIENCE)
    for _ in range(3):  # a busy page may not have found out what lies under the mouse
        drag(page, "/gizmo", (0.0, 0.1, 0.0), (0.0, 0.35, 0.0))
        if eventually(lambda: node_position(page, "/gizmo")[1] != 0.0):
            break
    x, y, z = node_position(page, "/gizmo")
    assert (x, z) == pytest.approx((0.5, HIGH))  # it moves along its arrow
    assert y == pytest.approx(0.25, abs=0.05)
    wait_for(lambda: viewer.robot.observe().target == pytest.approx((x, y, z), abs=1e-6), PATIENCE)
    wait_for(
        lambda: abs(robot.true("head_pan_joint") - math.atan2(y, x - 0.0115)) < 2 * DEGREE, PATIENCE
    )


def test_centre_turns_the_head_to_the_middle(robot, page):
    open_tab(page, "Steer")
    press(page, "Centre")
    wait_for(lambda: abs(robot.true("head_pan_joint")) < 2 * DEGREE, PATIENCE)


def test_a_slider_changes_the_parameter_in_degrees(robot, page):
    open_tab(page, "Tune")
    node = robot.composition.nodes["point_head"]
    number = row(page, "max velocity (°/s)").locator("input:visible").last
    number.wait_for()
    number.fill("60")
    number.press("Enter")
    wait_for(
        lambda: node.get_parameter("max_velocity").value == pytest.approx(math.radians(60)),
        PATIENCE,
    )


def test_a_parameter_changed_elsewhere_shows_on_the_page(robot, page):
    open_tab(page, "Tune")
    robot.composition.nodes["point_head"].set_parameters(
        [Parameter("max_velocity", value=math.radians(40))]
    )
    number = row(page, "max velocity (°/s)").locator("input:visible").last
    wait_for(lambda: number.input_value() == "40", PATIENCE)


def test_what_can_hurt_asks_first_and_a_refused_value_is_shown_and_the_old_one_stays(robot, page):
    open_tab(page, "Tune")
    node = robot.composition.nodes["servo_bus"]
    page.get_by_text("For experts").first.click(force=True)
    page.get_by_text("servo_bus").first.click(force=True)
    name, old = "head_pan_controller.motor.max", 1023
    field = row(page, "head pan motor: max (ticks)").locator("input:visible").last
    for answer in ("Leave it as it is", "Set it"):
        field.fill("-5")
        field.press("Enter")
        page.locator("#sure").wait_for()
        assert node.get_parameter(name).value == old
        press(page, answer)
        wait_for(lambda: field.input_value() == str(old), PATIENCE)
    page.get_by_text("refused:").first.wait_for()
    assert node.get_parameter(name).value == old


def test_health_shows_the_bus_the_servos_and_the_error_over_time(robot, page):
    open_tab(page, "Health")
    page.get_by_text("update rate reached (Hz)").first.wait_for()
    servo = page.get_by_role("columnheader", name="head_tilt_joint")
    servo.wait_for()
    fits = "one => one.closest('div').scrollWidth <= one.closest('div').clientWidth"
    assert servo.evaluate(fits), "the table scrolls sideways"
    robot.look_at(1.0, 0.2, 0.5, "base_link")
    plot = (
        "Object.values(window.__viserTestpoints.uplots).map(one => one.chart)"
        ".find(chart => chart?.series[1].label === 'error (degrees)')"
    )
    wait_for(lambda: page.evaluate(f"!!{plot}"), PATIENCE)
    wait_for(lambda: page.evaluate(f"{plot}.data[1].filter(Number.isFinite).length") > 3, PATIENCE)
    assert page.evaluate(f"[{plot}.scales.x.min, {plot}.scales.x.max]") == [-30, 0]


def test_a_slider_moves_its_joint(robot, page):
    open_tab(page, "Joints")
    field = joint_field(page, "head_pan_joint")
    field.fill("35")
    field.press("Enter")
    wait_for(lambda: abs(robot.true("head_pan_joint") - 35 * DEGREE) < 2 * DEGREE, PATIENCE)


def test_all_joints_are_centred(robot, page):
    open_tab(page, "Joints")
    press(page, "Centre all joints")
    for joint in HEAD:
        wait_for(lambda joint=joint: abs(robot.true(joint)) < 2 * DEGREE, PATIENCE)
        wait_for(lambda joint=joint: abs(float(joint_field(page, joint).input_value())) < 2.0)


def test_joints_go_anywhere_within_their_limits(robot, viewer, page):
    open_tab(page, "Joints")
    limits = {name: viewer.robot.model().joints[name].limits for name in HEAD}
    before = robot.at_rest()
    commands = robot.listen("joint_commands", JointState)
    press(page, "Randomise")
    wait_for(lambda: commands, PATIENCE)
    sent = dict(zip(commands[0].name, commands[0].position, strict=True))
    assert all(limits[name].lower <= sent[name] <= limits[name].upper for name in HEAD)
    assert [sent[name] for name in HEAD] != pytest.approx(before, abs=1e-3)
    head = viewer.robot.head()
    for joint, servo in zip(HEAD, (head.pan_limits, head.tilt_limits), strict=True):
        there = min(max(sent[joint], servo.lower), servo.upper)  # the servo goes no farther
        wait_for(
            lambda joint=joint, there=there: abs(robot.true(joint) - there) < 2 * DEGREE, PATIENCE
        )


def test_what_a_camera_sees_is_shown(robot, page):
    orange = np.tile(np.array([250, 120, 10], np.uint8), (60, 80, 1))
    camera = robot.node.create_publisher(Image, "camera/image", 1)
    timer = robot.node.create_timer(
        0.1, lambda: camera.publish(image_message(Header(), "rgb8", orange))
    )

    open_tab(page, "Steer")  # it is shown by itself
    wait_for(lambda: page.evaluate(MEAN_COLOUR) == pytest.approx([250, 120, 10], abs=6), PATIENCE)
    choose(page, "Camera picture", "no picture")
    wait_for(lambda: page.evaluate(MEAN_COLOUR) is None, PATIENCE)
    robot.node.destroy_timer(timer)
    robot.node.destroy_publisher(camera)


def is_relaxed(robot: Robot) -> bool:
    states = robot.composition.nodes["servo_bus"].status().states
    return [bool(state.torque) for state in states.values()] == [False, False]


def point_left(robot: Robot, page: Any) -> None:
    open_tab(page, "Steer")
    choose(page, "Look at", "point")
    type_number(page, "x y z (m)", 1.0, 0.5, 0.5)
    choose(page, "Frame", "base_link")
    press(page, "Point head")
    wait_for(
        lambda: abs(robot.true("head_pan_joint") - math.atan2(0.5, 1 - 0.0115)) < 2 * DEGREE,
        PATIENCE,
    )


def word(page: Any) -> str:
    """What the badge says."""
    return str(page.locator("#head-badge").get_attribute("data-word"))


def test_stop_is_in_view_on_every_tab_and_when_the_panel_is_folded_away(viewer, browser):
    for width, height in ((1280, 800), (390, 700)):
        page = open_page(browser, viewer.page.port, width, height, 0.25)
        light = page.evaluate("getComputedStyle(document.body).backgroundColor")
        page.emulate_media(color_scheme="dark")  # the page follows its browser
        page.wait_for_function(
            "before => getComputedStyle(document.body).backgroundColor !== before", arg=light
        )
        page.get_by_role("tab", name="Joints").wait_for()

        def in_view(page: Any = page) -> bool:
            box = page.locator("#head-stop").bounding_box()
            return bool(
                page.evaluate(
                    "([x, y]) => document.elementFromPoint(x, y)?.id === 'head-stop'",
                    [box["x"] + box["width"] / 2, box["y"] + box["height"] / 2],
                )
                and box["height"] >= 48
                and box["x"] >= 0
                and box["y"] >= 0
            )

        for tab in ("Steer", "Joints", "Tune", "Health", "View", "Record"):
            open_tab(page, tab)
            page.mouse.wheel(0, 4000)
            assert in_view(), tab
            assert page.evaluate(CUT_OFF) == [], tab
        page.get_by_text("kinectbot", exact=True).or_(
            page.get_by_text("head_tracking", exact=True)
        ).first.click(force=True)
        assert in_view()
        page.close()


def test_stop_relaxes_everything_and_the_badge_says_so(robot, page):
    point_left(robot, page)
    wait_for(lambda: word(page) == "on target", PATIENCE)
    press(page, "STOP")
    wait_for(lambda: is_relaxed(robot), PATIENCE)
    wait_for(lambda: word(page) in ("stopped", "relaxed"), PATIENCE)
    wait_for(lambda: "head_tilt_joint" in page.locator("#head-text").inner_text(), PATIENCE)


def test_escape_stops_wherever_the_cursor_is(robot, page):
    press(page, "Resume")
    wait_for(lambda: not is_relaxed(robot), PATIENCE)
    point_left(robot, page)
    field = row(page, "x y z (m)").locator("input:visible").first
    field.click(force=True)
    field.press("Escape")
    wait_for(lambda: is_relaxed(robot), PATIENCE)


def test_a_viewer_that_has_gone_is_disconnected_and_takes_no_input(viewer, page):
    page.evaluate(BUSY)  # that is this browser's own silence
    page.wait_for_timeout(100)
    assert word(page) != "disconnected"
    page.route("**/head/status*", lambda route: route.abort())
    wait_for(lambda: word(page) == "disconnected", PATIENCE)
    assert page.locator("#head-veil").is_visible()
    page.unroute("**/head/status*")
    wait_for(lambda: word(page) != "disconnected", PATIENCE)
    assert not page.locator("#head-veil").is_visible()


def test_a_relaxed_joint_is_moved_by_hand_and_its_slider_follows(robot, page):
    open_tab(page, "Joints")
    robot.lead_pan(-0.7)
    field = joint_field(page, "head_pan_joint")
    wait_for(lambda: abs(float(field.input_value()) * DEGREE + 0.7) < 0.06, PATIENCE)
    assert robot.true("head_pan_joint") == pytest.approx(-0.7, abs=0.06)


def test_torque_is_switched_for_one_servo_and_for_all(robot, page):
    bus = robot.composition.nodes["servo_bus"]

    def torque() -> list[bool]:
        states = bus.status().states  # not of a servo that is silent just now
        return [bool(states[joint].torque) for joint in HEAD if joint in states]

    assert robot.call("resume").success
    assert robot.call("relax").success
    open_tab(page, "Joints")
    switch = row(page, "head_tilt").locator("input[type=checkbox]")
    wait_for(lambda: torque() == [False, False], PATIENCE)
    wait_for(lambda: not switch.is_checked(), PATIENCE)  # which is told once a second
    switch.click(force=True)
    wait_for(lambda: torque() == [False, True], PATIENCE)
    switch.click(force=True)
    wait_for(lambda: torque() == [False, False], PATIENCE)
    press(page, "Torque on, all")
    wait_for(lambda: torque() == [True, True], PATIENCE)
    wait_for(switch.is_checked, PATIENCE)


def test_the_last_minute_is_saved_loaded_scrubbed_and_left_again(robot, viewer, page, tmp_path):
    open_tab(page, "Record")
    with page.expect_download() as saved:
        press(page, "Save the last minute")
    file = tmp_path / "head.mcap"
    saved.value.save_as(file)
    with file.open("rb") as stream:
        recording = read_recording(stream)
    assert recording.duration > 5.0
    before = robot.at_rest()
    with page.expect_file_chooser() as chooser:
        press(page, "Load a recording")
    chooser.value.set_files(file)

    def pan_shown() -> float:
        """The pan joint's position in the page's scene [rad]."""
        joint = viewer.robot.model().joints["head_pan_joint"]
        w, x, y, z = node_wxyz(page, viewer.page._scene.path(joint.child))
        turned = joint.origin.rotation.inverse() @ Rotation(x, y, z, w)
        return 2.0 * math.atan2(np.dot(joint.axis, turned[:3]), turned[3])

    pans = [one.joints["head_pan_joint"] for one in recording.seen]
    assert max(pans) - min(pans) > 0.3
    for wanted in (pans.index(max(pans)), pans.index(min(pans))):
        second = (recording.seen[wanted].stamp - recording.seen[0].stamp) * 1e-9
        field = row(page, "Time (s)").locator("input:visible").last
        field.fill(f"{math.ceil(100 * second) / 100:.2f}")  # not before it
        field.press("Enter")
        wait_for(lambda pan=pans[wanted]: abs(pan_shown() - pan) < 3 * DEGREE, PATIENCE)
    wait_for(lambda: word(page) == "replay", PATIENCE)
    open_tab(page, "Steer")
    press(page, "Centre")
    page.get_by_text("press Back to the robot first").first.wait_for()
    open_tab(page, "Record")
    press(page, "Back to the robot")
    wait_for(lambda: abs(pan_shown() - robot.pan) < DEGREE, PATIENCE)
    assert robot.at_rest() == pytest.approx(before, abs=DEGREE)


def test_everything_is_recorded_and_replayed_from_the_robots_side(robot, viewer, page):
    open_tab(page, "Record")
    press(page, "Record everything")
    page.get_by_role("button", name="End recording").wait_for()
    robot.look_at(1.0, 0.2, 0.5, "base_link")
    press(page, "End recording")
    page.get_by_role("button", name="Record everything").wait_for()
    (file,) = viewer.robot.recorder.files()
    row(page, "Recordings").locator(f"input[value='{file.name}']").first.wait_for()
    press(page, "Replay")
    wait_for(lambda: word(page) == "replay", PATIENCE)
    press(page, "Play / pause")
    wait_for(lambda: float(row(page, "Time (s)").locator("input").last.input_value()) > 0, PATIENCE)
    press(page, "STOP")  # whoever stops the robot sees it
    wait_for(lambda: word(page) in ("stopped", "relaxed"), PATIENCE)
    assert robot.call("resume").success


def test_browsers_see_what_the_robot_does_and_closing_one_changes_nothing(
    robot, viewer, browser, page
):
    second = open_page(browser, viewer.page.port, 600, 500, 0.25)
    wait_for(lambda: viewer.page.browsers == 2, PATIENCE)
    open_tab(page, "Steer")
    fields = row(page, "x y z (m)").locator("input:visible")
    own = [field.input_value() for field in fields.all()]
    type_number(second, "x y z (m)", 1.0, -0.5, 0.5)
    choose(second, "Frame", "base_link")
    choose(second, "Look at", "point")
    press(second, "Point head")
    for one in (page, second):
        wait_for(
            lambda one=one: node_position(one, "/target") == pytest.approx((1.0, -0.5, HIGH)),
            PATIENCE,
        )
    wait_for(
        lambda: abs(robot.true("head_pan_joint") - math.atan2(-0.5, 1 - 0.0115)) < 2 * DEGREE,
        PATIENCE,
    )
    assert [field.input_value() for field in fields.all()] == own
    before, mode = robot.at_rest(), viewer.robot.modes.mode()
    second.close()
    wait_for(lambda: viewer.page.browsers == 1, PATIENCE)
    assert robot.at_rest() == pytest.approx(before, abs=DEGREE)
    bus = robot.composition.nodes["servo_bus"]
    wait_for(lambda: [bool(s.torque) for s in bus.status().states.values()] == [True, True])
    assert viewer.robot.modes.mode() is mode
    assert viewer.robot.observe().target == pytest.approx((1.0, -0.5, HIGH))
