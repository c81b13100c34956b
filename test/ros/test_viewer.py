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
    open_browser,
    open_page,
    open_tab,
    pixels,
    press,
    row,
    type_number,
)
from robot_under_test import Robot, wait_for

from head_tracking.transforms import Rotation, Transform
from head_tracking.viewer.recording import Recording

DEGREE = math.radians(1)


@pytest.fixture(scope="module")
def robot(make_module_robot) -> Iterator[Robot]:
    try:
        chromium()
    except NoBrowser as missing:
        pytest.skip(str(missing))
    yield make_module_robot("--mode", "point", "--viewer")


@pytest.fixture(scope="module")
def viewer(robot) -> Any:
    """The viewer in this process."""
    from head_tracking.nodes.viewer import ViewerNode

    node = ViewerNode(robot.composition.buffer)
    robot.threads.start(node)
    return node


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with open_browser() as browser:
        yield browser


@pytest.fixture(scope="module")
def page(viewer, browser) -> Any:
    return open_page(browser, viewer.page.port)


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


def test_the_menu_lists_a_frame_that_appears_later(robot, viewer, page):
    open_tab(page, "Steer")
    core = robot.composition.buffer.core
    core.set_transform(
        0, "base_link", "late_gripper", Transform((0.4, 0.2, 0.6), Rotation.identity()), static=True
    )
    wait_for(lambda: "late_gripper" in viewer.robot.frames())
    choose(page, "Frame", "late_gripper")
    type_number(page, "x y z (m)", 0.0, 0.0, 0.0)
    press(page, "Point head")
    wait_for(
        lambda: abs(robot.true("head_pan_joint") - math.atan2(0.2, 0.4 - 0.0115)) < 3 * DEGREE,
        PATIENCE,
    )


def test_centre_turns_the_head_to_the_middle(robot, page):
    open_tab(page, "Steer")
    press(page, "Centre")
    wait_for(lambda: abs(robot.true("head_pan_joint")) < 2 * DEGREE, PATIENCE)


def test_a_slider_changes_the_parameter(robot, page):
    open_tab(page, "Tune")
    node = robot.composition.nodes["point_head"]
    number = row(page, "max_velocity").locator("input:visible").last
    number.wait_for()
    number.fill("1.25")
    number.press("Enter")
    wait_for(lambda: node.get_parameter("max_velocity").value == pytest.approx(1.25), PATIENCE)


def test_a_parameter_changed_elsewhere_shows_on_the_page(robot, page):
    from rclpy.parameter import Parameter

    open_tab(page, "Tune")
    robot.composition.nodes["point_head"].set_parameters([Parameter("max_velocity", value=0.75)])
    number = row(page, "max_velocity").locator("input:visible").last
    wait_for(lambda: number.input_value() == "0.75", PATIENCE)


def test_a_refused_value_is_shown_and_the_old_one_stays(robot, page):
    open_tab(page, "Tune")
    page.get_by_text("robot_state_publisher").first.click(force=True)
    field = row(page, "robot_description").locator("input:visible").last
    field.fill("no model")
    field.press("Enter")
    page.get_by_text("not well-formed").first.wait_for()
    node = robot.composition.nodes["robot_state_publisher"]
    assert node.get_parameter("robot_description").value == ""
    wait_for(lambda: field.input_value() == "", PATIENCE)


def test_health_shows_the_bus_the_servos_and_the_error_over_time(robot, page):
    open_tab(page, "Health")
    page.get_by_text("update rate reached (Hz)").first.wait_for()
    page.get_by_role("cell", name="head_tilt_joint").wait_for()
    robot.look_at(1.0, 0.2, 0.5, "base_link")
    plot = "Object.values(window.__viserTestpoints.uplots)[0].chart"
    wait_for(lambda: page.evaluate(f"{plot}.data[1].filter(Number.isFinite).length") > 3, PATIENCE)
    assert page.evaluate(f"[{plot}.scales.x.min, {plot}.scales.x.max]") == [-30, 0]


def test_stop_relaxes_everything(robot, page):
    open_tab(page, "Steer")
    type_number(page, "x y z (m)", 1.0, 0.5, 0.5)
    press(page, "Point head")
    wait_for(lambda: robot.true("head_pan_joint") > 0.2, PATIENCE)
    press(page, "STOP: relax everything")
    bus = robot.composition.nodes["servo_bus"]
    wait_for(lambda: not any(s.torque for s in bus.status().states.values()), PATIENCE)


def test_a_relaxed_joint_is_moved_by_hand_and_its_slider_follows(robot, page):
    open_tab(page, "Joints")
    robot.simulated.lead("head_pan_joint", -0.7, 0.5)
    number = row(page, "head_pan_joint").locator("input:visible").last
    wait_for(lambda: abs(float(number.input_value()) + 0.7) < 0.06, PATIENCE)


def test_the_last_minute_is_saved_loaded_and_left_again(robot, viewer, page, tmp_path):
    open_tab(page, "Record")
    with page.expect_download() as saved:
        press(page, "Save the last minute")
    file = tmp_path / "head.json.gz"
    saved.value.save_as(file)
    assert Recording.from_bytes(file.read_bytes()).duration > 5.0
    with page.expect_file_chooser() as chooser:
        press(page, "Load a recording")
    chooser.value.set_files(file)
    wait_for(lambda: viewer.page._recording.replayed() is not None, PATIENCE)
    press(page, "Back to the robot")
    wait_for(lambda: viewer.page._recording.replayed() is None, PATIENCE)


def test_closing_the_page_changes_nothing_and_others_stay(robot, viewer, browser, page):
    second = open_page(browser, viewer.page.port)
    wait_for(lambda: viewer.page.browsers == 2, PATIENCE)
    before = robot.at_rest()
    second.close()
    wait_for(lambda: viewer.page.browsers == 1, PATIENCE)
    assert robot.at_rest() == pytest.approx(before, abs=DEGREE)
