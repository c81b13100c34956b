"""The viewer's page in a real browser, on a robot over real topics and the simulated bus."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from browser import PATIENCE, chromium, open_browser, open_page, pixels, press, row, type_number
from robot_under_test import Robot, wait_for

from head_tracking.transforms import Rotation, Transform

DEGREE = math.radians(1)


@pytest.fixture(scope="module")
def robot(make_module_robot) -> Iterator[Robot]:
    chromium()  # skips
    yield make_module_robot("--mode", "point", "--viewer", "--params", "config/head.yaml")


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with open_browser() as browser:
        yield browser


@pytest.fixture(scope="module")
def page(robot, browser) -> Any:
    return open_page(browser, robot.composition.nodes["viewer"].page.port)


def test_the_page_shows_the_robot(page):
    def blue() -> int:
        r, g, b = (pixels(page)[:, :550, channel].astype(int) for channel in range(3))
        return int(np.count_nonzero((b > r + 40) & (b > g + 20)))

    wait_for(lambda: blue() > 500, PATIENCE)  # the torso


def test_point_head_moves_the_simulated_servo(robot, page):
    press(page, "Steer")
    type_number(page, "x y z (m)", 1.0, 1.0, 0.5)
    press(page, "Point head")
    wait_for(lambda: abs(robot.true("head_pan_joint") - math.atan2(1, 1 - 0.0115)) < 2 * DEGREE, PATIENCE)
