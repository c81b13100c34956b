"""Pictures of other nodes as the page shows them."""

import numpy as np
import pytest
from sensor_msgs.msg import Image
from std_msgs.msg import Header

from head_tracking.page.other_topics import image_of
from head_tracking.ros.kit.images import image_message

RED_AND_GREY = np.array([[[200, 10, 20], [90, 90, 90]]], np.uint8)
ALPHA = np.full((1, 2), 7, np.uint8)


@pytest.mark.parametrize(
    ("encoding", "pixels"),
    [
        ("rgb8", RED_AND_GREY),
        ("bgr8", RED_AND_GREY[..., ::-1]),
        ("rgba8", np.dstack([RED_AND_GREY, ALPHA])),
        ("bgra8", np.dstack([RED_AND_GREY[..., ::-1], ALPHA])),
        ("rgb16", RED_AND_GREY.astype(np.uint16) << 8),
    ],
)
def test_the_colours_of_encodings(encoding, pixels):
    if encoding == "rgb16":
        pytest.importorskip("cv2")
    image = image_of(image_message(Header(), encoding, pixels))
    assert image is not None
    assert np.asarray(image).tolist() == RED_AND_GREY.tolist()


def test_grey_and_rows_with_a_gap():
    message = Image(encoding="mono8", width=2, height=2, step=3, data=[1, 2, 0, 3, 4, 0])
    image = image_of(message)
    assert image is not None
    assert np.asarray(image).tolist() == [[1, 2], [3, 4]]


@pytest.mark.parametrize(
    "message",
    [
        Image(),
        Image(encoding="rgb8"),
        Image(encoding="rgb8", width=2, height=2, step=6, data=[0] * 11),
        Image(encoding="rgb8", width=2, height=1, step=5, data=[0] * 6),
        Image(encoding="32FC1", width=1, height=1, step=4, data=[0] * 4),
    ],
)
def test_a_damaged_or_unsupported_image_is_none(message):
    assert image_of(message) is None
