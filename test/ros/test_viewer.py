"""The page in a real browser, on a robot over real topics and the simulated bus."""

import io
import math
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from threading import Event
from typing import Any

import numpy as np
import pytest
from browser import (
    PATIENCE,
    choose,
    choose_mode,
    fill,
    open_page,
    open_tab,
    point_head,
    press,
    word,
)
from PIL import Image as PillowImage
from rclpy.parameter import Parameter
from rig import DEGREE, JOINTS, TICK, bearing
from robot_under_test import Robot
from sensor_msgs.msg import Image
from std_msgs.msg import Header
from waiting import wait_for

from head_tracking.recording.recording_file import read_recording
from head_tracking.ros.kit.images import image_message

PLACES = ("live", "joints", "tune", "health", "record")
MEAN_COLOUR = """() => {
  const image = document.getElementById("picture");
  if (!image.naturalWidth || !image.src) return null;
  const canvas = document.createElement("canvas").getContext("2d");
  canvas.drawImage(image, 0, 0, 1, 1);
  return [...canvas.getImageData(0, 0, 1, 1).data.slice(0, 3)];
}"""
RIGHT = """Math.max(...[...document.querySelectorAll(".card")].map(
  card => card.getBoundingClientRect().right
))"""
AXE = {
    "runOnly": ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa"],
    # axe's own values, but a text of one letter is a text too
    "checks": {
        "color-contrast": {
            "options": {
                "ignoreLength": True,
                "ignoreUnicode": True,
                "ignorePseudo": False,
                "boldValue": 700,
                "boldTextPt": 14,
                "largeTextPt": 18,
                "contrastRatio": {"normal": {"expected": 4.5}, "large": {"expected": 3}},
                "pseudoSizeThreshold": 0.25,
                "shadowOutlineEmMax": 0.2,
            }
        }
    },
}
MARKED = """() => {
  const { camera } = headPage;
  camera.mark([
    {
      frame: "follow 0", label: "follow", box: [0.2, 0.3, 0.1, 0.2], distance: 2,
      select: { frame_id: "lens", stamp: "0", point: [0, 0, 1] },
    },
    { frame: "", label: "face", box: [0.6, 0.3, 0.1, 0.2], distance: 4 },
  ]);
  camera.mark = () => {};
}"""
"""Two persons in the picture, until `mark` is deleted."""

RESUME_BESIDE_A_LONG_REASON = """() => {
  const [resume, why] = ["resume", "why"].map((id) => document.getElementById(id));
  resume.hidden = false;
  why.textContent = "a reason ".repeat(40);
  return resume.scrollWidth - resume.clientWidth;
}"""
HARD_TO_TOUCH = """() => [...document.querySelectorAll(
  "button, select, a, summary, input:not([type=file])"
)].filter((one) => {
  const touched = (one.type === "checkbox" && one.closest("label")) || one;
  const { left, right, width, height } = touched.getBoundingClientRect();
  if (!one.checkVisibility() || !width) return false;
  const isCutOff = !one.closest("#cards") && (left < -1 || right > innerWidth + 1);
  return isCutOff || width < 43.5 || height < 43.5;
}).map((one) => one.outerHTML)"""

LOADING = """() => {
  const { camera } = headPage;
  camera.image.removeAttribute("src");
  camera.image.src = URL.createObjectURL(new Blob());
  camera.mark([{frame: "follow 0", label: "follow", box: [0.2, 0.3, 0.1, 0.2], distance: 2}]);
  return [camera.image.naturalWidth, document.querySelectorAll("#overlay rect").length];
}"""
"""The width of a picture that loads, and how many boxes are shown meanwhile."""

LEAST = 1.5  # contrast at which a shape is told from what is behind it

SHOW_SERVOS = """isShown => {
  const { scene } = headPage;
  scene.root.traverse(({ isMesh, material }) => {
    const { r, g, b } = isMesh ? material.color : {};
    if (isMesh && Math.max(r, g, b) < 0.05) material.visible = isShown;
  });
  scene.cone.visible = false;
  scene.renderer.render(scene.scene, scene.camera);
}"""
"""Show the robot with its black parts or without them."""

SEEN = """() => {
  const { scene } = headPage, box = document.getElementById("scene");
  if (!scene?.framed || !scene.target.visible) return [];
  return [scene.cone.getWorldPosition(scene.target.position.clone()), scene.target.position]
    .map((place) => place.clone().project(scene.camera)).map(({ x, y }) => [x, y]);
}"""
"""Where the view has head and target: its edges are at -1 and 1."""

ICONS = """async () => {
  const { CARDS } = await import("/head/static/steer.js");
  headPage.steer.show({ ...headPage.about, modes: Object.keys(CARDS) });
  return [...document.querySelectorAll("#cards path")].map((path) => path.getAttribute("d"));
}"""


@pytest.fixture(scope="module")
def robot(browser, make_module_robot) -> Robot:
    return make_module_robot("--mode", "point", "--viewer")


@pytest.fixture(scope="module")
def viewer(robot, tmp_path_factory) -> Any:
    """The page in this process."""
    from head_tracking.page.viewer import ViewerNode

    given = [
        Parameter("record_directory", value=str(tmp_path_factory.mktemp("recordings"))),
        Parameter("port", value=0),
    ]
    node = ViewerNode(parameter_overrides=given)
    robot.threads.start(node)
    return node


@pytest.fixture(scope="module")
def opened(viewer, browser) -> Any:
    return open_page(browser, viewer.page.port, 600, 500)


@pytest.fixture
def visit(viewer, browser) -> Iterator[Callable[..., Any]]:
    """Open further pages, which end with the test."""
    with ExitStack() as pages:

        def visit(width: int = 600, height: int = 500, **context: Any) -> Any:
            page = open_page(browser, viewer.page.port, width, height, **context)
            pages.callback(page.close)
            return page

        yield visit


@pytest.fixture(scope="module")
def pictures(robot) -> Event:
    """While this is set, a camera publishes orange pictures."""
    orange, publishing = np.tile(np.array([250, 120, 10], np.uint8), (60, 80, 1)), Event()
    publisher = robot.node.create_publisher(Image, "camera/image", 1)

    def publish() -> None:
        if publishing.is_set():
            publisher.publish(image_message(Header(), "rgb8", orange))

    robot.node.create_timer(0.1, publish)
    return publishing


@pytest.fixture
def camera(pictures) -> Iterator[Event]:
    pictures.set()
    yield pictures
    pictures.clear()


FAILED = [0]
"""The number of tests that had failed when the page was loaded."""


@pytest.fixture
def page(request, robot, viewer, opened) -> Any:
    """The page of a robot with torque, whatever the test before has left."""
    if request.session.testsfailed != FAILED[0]:
        FAILED[0] = request.session.testsfailed
        opened.reload()
        opened.wait_for_function("window.headPage?.shownRobot && window.headPage.about")
    if viewer.robot.stop.can_resume or is_relaxed(robot):
        robot.until_done("resume")
        robot.until_done("torque_enable", True)
        wait_for(lambda: not viewer.robot.stop.can_resume and not is_relaxed(robot))
    opened.evaluate("headPage.replay.opened && headPage.replay.close()")
    wait_for(lambda: word(opened) not in ("stopped", "relaxed", "replay"))
    return opened


def is_relaxed(robot: Robot) -> bool:
    backend = robot.composition.nodes["servo_bus"].backend
    return not any(backend.joint(joint).on for joint in JOINTS)


def point_left(robot: Robot, page: Any) -> None:
    open_tab(page, "live")
    choose_mode(page, "point")
    point_head(page, "base_link", 1.0, 0.5, 0.5)
    turned(robot, bearing(1.0, 0.5))


def turned(robot: Robot, pan: float) -> None:
    wait_for(lambda: abs(robot.true("head_pan_joint") - pan) < 2 * DEGREE)


def joint_field(page: Any, joint: str) -> Any:
    return page.locator(".slider").filter(has_text=joint).locator("input[type=number]")


def parameter(page: Any, node: str, label: str) -> Any:
    group = page.locator(f'fieldset[data-node="/{node}"]')
    row = group.locator(".parameter").filter(has_text=label).first
    return row.locator("input, select").first


def test_the_page_shows_the_robot(page):
    def blue() -> int:
        png = page.locator("#scene").screenshot()
        shown = np.asarray(PillowImage.open(io.BytesIO(png)).convert("RGB"))
        r, g, b = (shown[..., channel].astype(int) for channel in range(3))
        return int(np.count_nonzero((b > r + 40) & (b > g + 20)))

    page.locator("#scene").scroll_into_view_if_needed()
    wait_for(lambda: blue() > 150)  # the torso
    assert page.title() == "kinectbot"


def test_a_recording_is_saved_loaded_played_and_left_again(robot, viewer, visit, page, tmp_path):
    open_tab(page, "record")
    press(page, "Record everything")
    page.get_by_role("button", name="End recording").wait_for()
    open_tab(page, "joints")
    for pan in (0.4, -0.4):  # what is recorded
        joint_field(page, "head_pan_joint").fill(str(round(pan / DEGREE)))
        joint_field(page, "head_pan_joint").press("Enter")
        turned(robot, pan)
        robot.at_rest()  # or the extreme of the recording would be one moment
    open_tab(page, "record")
    name = viewer.robot.recorder.file.name
    press(page, "End recording")
    with page.expect_download() as saved:
        page.get_by_text("Download").first.click()
    file = tmp_path / "head.mcap"
    saved.value.save_as(file)
    with file.open("rb") as stream:
        recording = read_recording(stream)
    other = visit()
    page.locator("#upload").set_input_files(file)
    page.locator("#replaying").wait_for()

    def pan_shown() -> float:
        return math.radians(float(page.locator("#pan").inner_text().rstrip("°")))

    pans = [one.joints["head_pan_joint"] for one in recording.seen]
    for wanted in (pans.index(max(pans)), pans.index(min(pans))):
        second = (recording.seen[wanted].stamp - recording.seen[0].stamp) * 1e-9
        page.evaluate(
            "value => { const input = document.getElementById('time'); input.value = value;"
            " input.dispatchEvent(new Event('input')); }",
            math.ceil(100 * second) / 100,
        )
        wait_for(lambda pan=pans[wanted]: abs(pan_shown() - pan) < 3 * DEGREE)
    assert word(page) == "replay"
    assert "Live" not in page.locator("#fps").inner_text()
    press(page, "Centre")
    page.get_by_text("press Back to the robot first").first.wait_for()
    assert word(other) != "replay"
    choose_mode(other, "point")  # another browser goes on with the robot
    point_head(other, "base_link", 1.0, 0.3, 0.5)
    turned(robot, bearing(1.0, 0.3))
    press(page, "Back to the robot")
    wait_for(lambda: abs(pan_shown() - robot.pan) < DEGREE)
    open_tab(other, "record")
    press(other, f"Replay {name}")
    wait_for(lambda: word(other) == "replay")
    press(other, "Play")
    wait_for(lambda: float(other.locator("#time").input_value()) > 0)
    other.locator("#stop").dispatch_event("click")  # STOP is the robot's, also during a replay
    wait_for(lambda: is_relaxed(robot))
    press(other, "Back to the robot")
    wait_for(lambda: word(other) in ("stopped", "relaxed"))


def test_a_drag_in_the_3d_view_turns_the_view_and_a_click_on_the_floor_looks_there(
    robot, viewer, page
):
    choose_mode(page, "point")
    point_head(page, "base_link", 1.0, 0.0, 0.6)
    turned(robot, 0.0)
    page.locator("#scene canvas").scroll_into_view_if_needed()
    box = page.locator("#scene canvas").bounding_box()
    x, y = box["x"] + 0.5 * box["width"], box["y"] + 0.9 * box["height"]
    view = page.evaluate("headPage.scene.camera.position.toArray()")
    before = viewer.robot.observe().target
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x - 60, y, steps=5)
    page.mouse.up()
    assert page.evaluate("headPage.scene.camera.position.toArray()") != pytest.approx(view)
    assert viewer.robot.observe().target == before
    page.mouse.click(x, y)
    wait_for(lambda: viewer.robot.observe().target not in (before, None))
    assert viewer.robot.observe().target[2] == pytest.approx(0.0, abs=1e-6)


def test_the_pad_turns_the_head_by_mouse_and_by_keys(robot, page):
    robot.at_rest()
    page.locator("#pad").focus()
    before = robot.true("head_pan_joint")
    page.keyboard.press("ArrowRight")
    wait_for(lambda: robot.true("head_pan_joint") < before - 2 * DEGREE)
    page.locator("#pad").scroll_into_view_if_needed()
    box = page.locator("#pad").bounding_box()
    x, y = box["x"] + 0.25 * box["width"], box["y"] + 0.5 * box["height"]
    page.evaluate("document.activeElement.blur()")
    page.mouse.click(x, y)
    # a browser draws a frame around a drawing that a mouse has focused
    assert page.locator("#pad").evaluate("pad => getComputedStyle(pad).outlineStyle") == "none"
    wait_for(lambda: robot.true("head_pan_joint") > 20 * DEGREE)


def test_numbers_and_presets_change_parameters_in_degrees_and_reset_brings_them_back(robot, page):
    node = robot.composition.nodes["point_head"]

    def velocity() -> float:
        return math.degrees(node.get_parameter("max_velocity").value)

    usual = velocity()
    open_tab(page, "tune")
    number = parameter(page, "point_head", "max velocity")
    number.fill("60")
    number.press("Enter")
    wait_for(lambda: velocity() == pytest.approx(60.0))
    page.evaluate("document.activeElement.blur()")
    node.set_parameters([Parameter("max_velocity", value=math.radians(40))])
    wait_for(lambda: number.input_value() == "40")
    page.locator("[data-preset=calm]").dispatch_event("click")
    wait_for(lambda: velocity() == pytest.approx(30.0))
    press(page, "Reset all")
    wait_for(lambda: velocity() == pytest.approx(usual))


def test_learned_values_are_frozen_given_and_learned_again_on_the_tab_health(robot, page):
    open_tab(page, "live")
    choose_mode(page, "track")
    node = wait_for(lambda: robot.composition.nodes.get("head_tracker"))
    open_tab(page, "health")
    page.get_by_text("servo_bus: head_tilt_joint").first.wait_for()
    page.get_by_text("update rate reached").first.wait_for(state="attached")
    values = page.locator("#learned-values")
    parameter(page, "head_tracker", "servo learning").select_option("freeze")
    wait_for(lambda: "frozen" in (values.text_content() or ""))
    delay = parameter(page, "head_tracker", "servo delay")
    delay.fill("0.05")
    delay.press("Enter")
    wait_for(lambda: "0.05 s, given" in (values.text_content() or ""))
    delay.fill("0")
    delay.press("Enter")
    parameter(page, "head_tracker", "servo learning").select_option("learn")
    wait_for(lambda: "frozen" not in (values.text_content() or ""))
    assert node.get_parameter("servo_learning").value == "learn"
    assert node.get_parameter("servo_delay").value == 0.0
    assert values.evaluate(
        "table => { table.rows[0].cells[1].textContent = 'v'.repeat(999);"
        " return table.offsetWidth < table.parentNode.clientWidth; }"
    ), "a long value of a stranger stays in its card"
    slider = page.get_by_role("slider", name="camera delay")
    for share, given in ((0.5, 0.35), (0.182, 0.0)):  # its step beside 0.2 of 1.1 s, which is 0
        slider.evaluate(
            "(one, share) => { one.value = share; one.dispatchEvent(new Event('change')); }", share
        )
        wait_for(lambda given=given: node.get_parameter("camera_delay").value == given)
    wait_for(lambda: "0 s, given" in (values.text_content() or ""))


def test_what_protects_the_servos_asks_and_no_browser_shows_a_value_that_is_not_set(
    robot, visit, page
):
    node, name, old = robot.composition.nodes["servo_bus"], "head_pan_controller.motor.max", 1023
    other = visit()
    for one in (page, other):
        open_tab(one, "tune")
        one.locator("#experts").wait_for()
        one.evaluate("document.getElementById('experts').open = true")
    field, seen = (parameter(one, "servo_bus", "head pan motor: max") for one in (page, other))
    for answer in ("Cancel", "Set it", "Escape"):  # it is refused, and Escape is no STOP
        field.fill("-5")
        field.press("Enter")
        page.locator("#sure").wait_for()
        assert (seen.input_value(), node.get_parameter(name).value) == (str(old), old)
        page.keyboard.press(answer) if answer == "Escape" else press(page, answer)
        page.locator("#sure").wait_for(state="hidden")
        wait_for(lambda: field.input_value() == str(old))
    assert (seen.input_value(), node.get_parameter(name).value) == (str(old), old)
    assert not is_relaxed(robot)


def test_joints_are_moved_one_by_one_and_all_together(robot, page):
    open_tab(page, "joints")
    field = joint_field(page, "head_pan_joint")
    field.fill("35")
    field.press("Enter")
    turned(robot, 35 * DEGREE)
    press(page, "Centre all joints")
    for joint in JOINTS:
        wait_for(lambda joint=joint: abs(robot.true(joint)) < 2 * DEGREE)
        shown = joint_field(page, joint)
        wait_for(lambda shown=shown: abs(float(shown.input_value())) < 2.0)


def test_what_a_camera_sees_is_shown_and_another_source_is_chosen_for_one_browser(camera, page):
    open_tab(page, "live")
    choose(page, "source", "/camera/image")
    wait_for(lambda: page.evaluate(MEAN_COLOUR) == pytest.approx([250, 120, 10], abs=6))
    page.wait_for_function("headPage.camera.size")
    assert page.evaluate(LOADING) == [0, 1]
    page.evaluate(MARKED)
    box = page.locator("#labels").bounding_box()
    for u, asked in ((0.25, "select"), (0.7, "look")):  # on a person, and beside
        with page.expect_request(f"**/head/do/{asked}"):
            page.mouse.click(box["x"] + u * box["width"], box["y"] + 0.4 * box["height"])
    page.evaluate("delete headPage.camera.mark")
    choose(page, "source", "none")
    wait_for(lambda: page.evaluate(MEAN_COLOUR) is None)
    choose(page, "source", "/camera/image")
    wait_for(lambda: "Live" in page.text_content("#fps"))
    camera.clear()
    wait_for(lambda: page.text_content("#fps") == "no new picture")
    choose(page, "source", "")


@pytest.mark.parametrize(
    ("width", "height", "scheme"),
    [
        (1280, 800, "light"),
        (390, 700, "dark"),
        (820, 1180, "dark"),
        (844, 390, "light"),
    ],
)
def test_every_place_is_usable_in_windows_of_all_sizes(camera, visit, width, height, scheme):
    """By sizes and places of what is touched, and by axe's rules for WCAG AA: names, contrast.

    Nothing may be left that axe cannot decide, such as the contrast of a text over a picture.
    """
    from axe_playwright_python.sync_playwright import Axe

    page = visit(width, height, color_scheme=scheme)
    assert page.evaluate("document.documentElement.dataset.theme") == scheme
    page.wait_for_function("document.getElementById('picture').naturalWidth > 0")
    page.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = true; })")
    page.evaluate(MARKED)
    assert page.locator("#camera").bounding_box()["height"] > 250
    assert page.evaluate(RESUME_BESIDE_A_LONG_REASON) <= 0  # the word is not cut off
    for place in PLACES:
        open_tab(page, place)
        if place == "tune":
            page.locator("#parameters input").first.wait_for()
        found = Axe().run(page, options=AXE).response
        wrong = [*found["violations"], *found["incomplete"]]
        assert not [(one["id"], [n["html"] for n in one["nodes"]]) for one in wrong], place
        assert "color-contrast" in {one["id"] for one in found["passes"]}
        page.mouse.wheel(0, 4000)
        box = page.locator("#stop").bounding_box()
        there = [box["x"] + box["width"] / 2, box["y"] + box["height"] / 2]
        hit = "([x, y]) => document.elementFromPoint(x, y)?.closest('button')?.id"
        assert page.evaluate(hit, there) == "stop", place
        assert page.evaluate(HARD_TO_TOUCH) == [], place
        assert page.evaluate(RIGHT) > 0.95 * width, place


def test_a_newcomer_is_welcomed_once_and_can_stop_meanwhile(robot, viewer, browser):
    with browser.new_context(viewport={"width": 900, "height": 700}) as context:
        page = context.new_page()
        page.set_default_timeout(1e3 * PATIENCE)
        page.goto(f"http://127.0.0.1:{viewer.page.port}/")
        page.locator("#welcome").wait_for()
        titles = []
        for _ in range(3):
            titles.append(page.locator("#welcome-title").inner_text())
            if len(titles) == 2:
                page.keyboard.press("Escape")  # the welcome says that it is STOP
                wait_for(lambda: is_relaxed(robot))
                page.locator("#toast").wait_for()
                toast, button = (
                    page.locator(f"#{n}").bounding_box() for n in ("toast", "welcome-next")
                )
                assert toast["y"] + toast["height"] < button["y"], "it covers what to press"
            press(page, "Next") if len(titles) < 3 else press(page, "Begin")
        assert len(set(titles)) == 3
        page.locator("#welcome").wait_for(state="hidden")
        page.reload()
        page.wait_for_function("window.headPage?.about")
        assert not page.locator("#welcome").is_visible()


def test_stop_relaxes_everything_and_the_page_says_so(robot, page):
    point_left(robot, page)
    wait_for(lambda: word(page) == "on target")
    page.locator("#stop").dispatch_event("click")
    wait_for(lambda: is_relaxed(robot))
    wait_for(lambda: "head_tilt_joint" in page.locator("#why").inner_text())
    assert word(page) in ("stopped", "relaxed")
    page.locator("#resume").wait_for()
    press(page, "Resume")
    assert page.locator("#toast").is_hidden()  # it says what has been relaxed
    wait_for(lambda: word(page) not in ("stopped", "relaxed"))


def test_escape_stops_wherever_the_cursor_is_but_closes_what_is_open_first(robot, page):
    point_left(robot, page)
    page.locator("#frame").focus()
    page.keyboard.press("Escape")  # leaves the menu
    page.wait_for_function("document.activeElement.id !== 'frame'")
    assert not is_relaxed(robot)
    page.locator("#x").click()
    page.keyboard.press("Escape")
    wait_for(lambda: is_relaxed(robot))


def test_a_browser_with_the_token_of_an_earlier_run_is_told_so(viewer, visit, monkeypatch):
    page = visit()
    monkeypatch.setattr(viewer.page._access, "token", "new")
    page.route("**/", lambda route: (time.sleep(1.5), route.continue_()))  # a busy computer
    page.evaluate("headPage.socket.close()")
    page.wait_for_function("document.getElementById('why').textContent.startsWith('Token needed')")
    monkeypatch.undo()
    wait_for(lambda: word(page) != "disconnected")


@pytest.mark.parametrize("place", ["#camera", "#pad", ".slider input"])
@pytest.mark.parametrize("has_heard", [True, False])
def test_a_drag_from_before_a_stop_ends(robot, camera, viewer, page, place, has_heard):
    open_tab(page, "joints" if place == ".slider input" else "live")
    page.wait_for_function("document.getElementById('picture').naturalWidth > 0")
    enabled = "document.querySelector('.slider input')?.disabled === false"
    page.wait_for_function(f"headPage.about && {enabled}")  # not so soon after the last STOP
    page.locator(place).first.scroll_into_view_if_needed()
    box, requests, responses = page.locator(place).first.bounding_box(), [], []
    x, y = box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"]
    page.on("request", lambda request: "/do/" in request.url and requests.append(request))
    page.on("response", lambda response: "/do/" in response.url and responses.append(response))

    def is_quiet() -> bool:
        """Whether all commands have been answered, and none is sent for longer than between two."""
        number = len(requests)
        page.evaluate("new Promise((go) => setTimeout(go, 200))")
        return number == len(requests) == len(responses)

    page.mouse.move(x, y)
    page.mouse.down()
    with page.expect_request("**/head/do/*"):
        page.mouse.move(x + 20, y, steps=5)
    stops = page.evaluate("headPage.about.stops")
    wait_for(is_quiet)
    before = [response.json()["text"] for response in responses]
    if not has_heard:
        page.evaluate("headPage.showAbout = () => {}")
    robot.until_done("stop")
    robot.until_done("resume")  # at once, so that the page seldom shows the STOP
    wait_for(lambda: viewer.robot.stop.count != stops)
    if has_heard:
        page.wait_for_function("(stops) => headPage.about.stops !== stops", arg=stops)
    page.mouse.move(x - 40, y, steps=5)
    page.mouse.up()
    wait_for(is_quiet)
    late = [response.json() for response in responses[len(before) :]]
    if has_heard:
        assert not late
    else:
        assert late
        assert not any(one["done"] or one["text"] in before for one in late)
        page.evaluate("delete headPage.showAbout")
        wait_for(lambda: page.evaluate("headPage.about.stops") == viewer.robot.stop.count)


def test_what_waits_to_be_sent_at_a_stop_is_not_sent_after_it(page):
    sent = """async () => {
      const { latestOnly } = await import("/head/static/dom.js"), sent = [];
      let answer;
      const send = latestOnly((place) => new Promise((go) => { sent.push(place); answer = go; }));
      for (const place of [1, 2]) send(place);
      send.giveUp();
      answer();
      await new Promise((go) => setTimeout(go, 200));
      return sent;
    }"""
    assert page.evaluate(sent) == [1]


def test_a_finger_that_scrolls_over_a_slider_does_not_move_it_and_sees_what_it_means(robot, visit):
    page = visit(390, 844, has_touch=True, is_mobile=True)
    open_tab(page, "joints")
    fingers = page.context.new_cdp_session(page)
    slider = page.locator(".slider input").first

    def swipe(x: float, y: float) -> None:
        """Put a finger on the right end of the slider, and move it [pixels]."""
        box = slider.bounding_box()
        start = box["x"] + 0.8 * box["width"], box["y"] + 0.5 * box["height"]
        for step in range(11):
            at = {"x": start[0] + 0.1 * step * x, "y": start[1] + 0.1 * step * y}
            kind = "touchMove" if step else "touchStart"
            fingers.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [at]})
            page.wait_for_timeout(20)
        fingers.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})

    scrolled = "document.querySelector('main').scrollTop"
    slider.evaluate("slider => slider.scrollIntoView({ block: 'center' })")
    before, top = robot.at_rest(), page.evaluate(scrolled)
    swipe(0, 200)
    page.wait_for_function(f"{scrolled} < {top} - 50")
    assert robot.at_rest() == pytest.approx(before, abs=DEGREE)
    swipe(20, 0)
    wait_for(lambda: robot.true("head_pan_joint") > 1.0)
    open_tab(page, "tune")
    page.locator("#parameters .parameter small").first.wait_for()  # what it means, without a mouse


def test_a_relaxed_joint_is_moved_by_hand_and_torque_is_switched_for_one_servo_and_for_all(
    robot, page
):
    backend = robot.composition.nodes["servo_bus"].backend

    def torque() -> list[bool]:
        return [backend.joint(joint).on for joint in JOINTS]

    robot.until_done("relax")
    wait_for(lambda: torque() == [False, False])
    open_tab(page, "joints")
    robot.simulated.use(lambda bus: bus[1].lead(512 - 0.7 / TICK, 0.5))
    field = joint_field(page, "head_pan_joint")
    wait_for(lambda: abs(float(field.input_value()) * DEGREE + 0.7) < 0.06)
    switch = page.locator("[data-controller=head_tilt_controller]")
    wait_for(lambda: not switch.is_checked())  # which is told once a second
    switch.click()
    wait_for(lambda: torque() == [False, True])
    switch.click()
    wait_for(lambda: torque() == [False, False])
    press(page, "Torque on, all")
    wait_for(lambda: torque() == [True, True])
    wait_for(switch.is_checked)


def test_browsers_see_what_the_robot_does_and_closing_one_changes_nothing(
    robot, viewer, visit, page
):
    wait_for(lambda: len(viewer.page.browsers) == 1)
    second = visit()
    wait_for(lambda: len(viewer.page.browsers) == 2)
    open_tab(page, "live")
    choose_mode(page, "point")
    fill(page, "x", 0.9)
    own = [page.locator(f"#{name}").input_value() for name in "xyz"]
    choose_mode(second, "point")
    point_head(second, "base_link", 1.0, -0.5, 0.5)
    for one in (page, second):
        wait_for(
            lambda one=one: (
                one.evaluate("headPage.state.target") == pytest.approx([1.0, -0.5, 0.5325])
            ),
        )
    turned(robot, bearing(1.0, -0.5))
    assert [page.locator(f"#{name}").input_value() for name in "xyz"] == own
    mode = viewer.robot.modes.mode()
    second.close()
    wait_for(lambda: len(viewer.page.browsers) == 1)
    robot.at_rest()
    turned(robot, bearing(1.0, -0.5))  # a busy machine may let the head stand before
    assert viewer.robot.modes.mode() is mode
    assert viewer.robot.observe().target == pytest.approx((1.0, -0.5, 0.5325))


# what the page draws: the robot in 3D against its background, with its target; icons


def brightness(page: Any, show: bool) -> Any:
    """Return the relative luminance of the 3D view's pixels, by WCAG."""
    page.evaluate(SHOW_SERVOS, show)
    picture = PillowImage.open(io.BytesIO(page.locator("#scene").screenshot()))
    shares = np.asarray(picture.convert("RGB"), float) / 255.0
    linear = np.where(shares < 0.04045, shares / 12.92, ((shares + 0.055) / 1.055) ** 2.4)
    return linear @ (0.2126, 0.7152, 0.0722)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_black_servos_are_told_from_the_background(visit, scheme):
    page = visit(1280, 800, color_scheme=scheme)
    wait_for(lambda: page.evaluate("headPage.scene?.framed"))
    page.wait_for_timeout(1000)
    shown, hidden = (brightness(page, show) for show in (True, False))
    ratios = (np.maximum(shown, hidden) + 0.05) / (np.minimum(shown, hidden) + 0.05)
    servos = ratios[shown != hidden]
    assert len(servos) > 100
    assert np.median(servos) > LEAST


@pytest.mark.parametrize("y", [0.9, -0.9])
def test_the_view_begins_with_head_and_target_in_it(visit, y):
    page = visit(1280, 800)
    choose_mode(page, "point")
    point_head(page, "base_link", 2.5, y, 1.2)
    page.wait_for_function("headPage.state.target")
    page.reload()
    seen = wait_for(lambda: page.evaluate(SEEN))
    assert np.abs(seen).max() < 0.95


def test_each_card_has_an_icon_of_its_own(visit):
    icons = visit().evaluate(ICONS)
    assert len(icons) == len(set(icons)) == 11
