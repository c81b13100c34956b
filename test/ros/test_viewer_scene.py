"""What the page draws: the robot in 3D against its background, with its target; icons."""

import io
from typing import Any

import numpy as np
import pytest
from browser import choose_mode, open_page, point_head
from PIL import Image
from robot_under_test import Robot
from viewing import view
from waiting import wait_for

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
def port(robot) -> int:
    return view(robot.threads, alone=False).page.port


def brightness(page: Any, show: bool) -> Any:
    """Return the relative luminance of the 3D view's pixels, by WCAG."""
    page.evaluate(SHOW_SERVOS, show)
    picture = Image.open(io.BytesIO(page.locator("#scene").screenshot()))
    shares = np.asarray(picture.convert("RGB"), float) / 255.0
    linear = np.where(shares < 0.04045, shares / 12.92, ((shares + 0.055) / 1.055) ** 2.4)
    return linear @ (0.2126, 0.7152, 0.0722)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_black_servos_are_told_from_the_background(browser, port, scheme):
    page = open_page(browser, port, 1280, 800, color_scheme=scheme)
    wait_for(lambda: page.evaluate("headPage.scene?.framed"))
    page.wait_for_timeout(1000)
    shown, hidden = (brightness(page, show) for show in (True, False))
    page.close()
    ratios = (np.maximum(shown, hidden) + 0.05) / (np.minimum(shown, hidden) + 0.05)
    servos = ratios[shown != hidden]
    assert len(servos) > 100
    assert np.median(servos) > LEAST


@pytest.mark.parametrize("y", [0.9, -0.9])
def test_the_view_begins_with_head_and_target_in_it(browser, port, y):
    page = open_page(browser, port, 1280, 800)
    choose_mode(page, "point")
    point_head(page, "base_link", 2.5, y, 1.2)
    page.wait_for_function("headPage.state.target")
    page.reload()
    seen = wait_for(lambda: page.evaluate(SEEN))
    page.close()
    assert np.abs(seen).max() < 0.95


def test_each_card_has_an_icon_of_its_own(browser, port):
    page = open_page(browser, port)
    icons = page.evaluate(ICONS)
    page.close()
    assert len(icons) == len(set(icons)) == 11
