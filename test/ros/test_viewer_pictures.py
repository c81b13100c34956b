"""Pictures of other nodes as the page gets them."""

import numpy as np
import pytest
from sensor_msgs.msg import Image
from std_msgs.msg import Header

from head_tracking.page.other_topics import pixels_of
from head_tracking.ros.kit.images import image_message

RED_AND_GREY = np.array([[[200, 10, 20], [90, 90, 90]]], np.uint8)


@pytest.mark.parametrize(
    ("encoding", "pixels"),
    [
        ("rgb8", RED_AND_GREY),
        ("bgr8", RED_AND_GREY[..., ::-1]),
        ("rgba8", np.dstack([RED_AND_GREY, np.full((1, 2), 7, np.uint8)])),
        ("bgra8", np.dstack([RED_AND_GREY[..., ::-1], np.full((1, 2), 7, np.uint8)])),
    ],
)
def test_colours_of_the_usual_encodings(encoding, pixels):
    seen = pixels_of(image_message(Header(), encoding, pixels))
    assert seen is not None
    assert seen.tolist() == RED_AND_GREY.tolist()


def test_grey():
    seen = pixels_of(image_message(Header(), "mono8", RED_AND_GREY[..., 0]))
    assert seen is not None
    assert seen.tolist() == [[[200] * 3, [90] * 3]]


def test_other_encodings_by_opencv():
    pytest.importorskip("cv2")
    seen = pixels_of(image_message(Header(), "rgb16", RED_AND_GREY.astype(np.uint16) << 8))
    assert seen is not None
    assert seen.tolist() == RED_AND_GREY.tolist()


@pytest.mark.parametrize(
    "message",
    [
        Image(),
        Image(encoding="rgb8", width=2, height=2, step=6, data=[0] * 11),
        Image(encoding="rgb8", width=2, height=1, step=5, data=[0] * 6),
        Image(encoding="32FC1", width=1, height=1, step=4, data=[0] * 4),
    ],
)
def test_what_is_no_picture(message):
    assert pixels_of(message) is None
