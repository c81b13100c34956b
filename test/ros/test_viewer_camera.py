"""The simulated camera on the page: started on request, drawn while somebody looks."""

from typing import Any

import numpy as np
import pytest
from robot_under_test import Robot
from viewing import PATIENCE, view
from waiting import wait_for

from head_tracking.page.other_topics import image_of
from head_tracking.vision.opencv import OpenCVMissingError

NAME = "simulated_camera"


@pytest.fixture
def robot(make_robot) -> Robot:
    return make_robot("--target", "1,0,0.5@base_link", "--viewer")


@pytest.fixture
def seen(robot) -> Any:
    """The robot as the page sees it, once it knows that there could be a camera."""
    seen = view(robot.threads, robot.composition.buffer).robot
    wait_for(lambda: seen.modes.can_start(NAME), PATIENCE)
    return seen


def magenta(picture: Any) -> int:
    r, g, b = (picture[..., channel].astype(int) for channel in range(3))
    return int(np.count_nonzero((r > g + 60) & (b > g + 60)))


def test_the_page_shows_the_target_as_the_camera_sees_it(robot, seen, monkeypatch):
    pytest.importorskip("cv2", reason="needs OpenCV: pip install -r requirements/vision.txt")
    assert NAME not in robot.composition.nodes
    assert seen.modes.start(NAME).done
    wait_for(lambda: "/image" in seen.topics.images() and not seen.modes.can_start(NAME), PATIENCE)
    assert seen.modes.start(NAME).done, "it runs already"
    renderer = robot.composition.nodes[NAME].renderer
    drawn = []
    render = renderer.render
    monkeypatch.setattr(renderer, "render", lambda *a, **k: (drawn.append(a), render(*a, **k))[1])
    robot.at_rest(1.0)
    assert not drawn, "nobody looks at it"

    def ball() -> bool:
        picture = seen.topics.picture("/image")
        # a ball of 6 cm at 1 m, in a picture with 293 pixels per rad: a head that looks at it
        return (
            picture is not None
            and magenta(np.asarray(image_of(picture.message))[70:170, 110:210]) > 300
        )

    wait_for(ball, PATIENCE)
    assert drawn
    # who does not ask any more is not sent any more
    wait_for(lambda: robot.node.count_subscribers("/image/compressed") == 0, PATIENCE)
    before = len(drawn)
    robot.at_rest(1.0)
    assert len(drawn) <= before + 1


def test_without_opencv_the_page_says_how_to_get_it(robot, seen, monkeypatch):
    def missing() -> None:
        raise OpenCVMissingError

    monkeypatch.setattr("head_tracking.ros.targets.simulated_camera.require_opencv", missing)
    outcome = seen.modes.start(NAME)
    assert not outcome.done
    assert "pip install" in outcome.text
    assert NAME not in robot.composition.nodes
    assert NAME not in robot.node.get_node_names()
