"""Pictures of other nodes as the page shows them."""

import io

import numpy as np
import pytest
from PIL import Image as PillowImage
from sensor_msgs.msg import CompressedImage, Image
from std_msgs.msg import Header

from head_tracking.page.other_topics import Snapshot, image_of, size_of
from head_tracking.ros.kit.images import image_message
from head_tracking.vision.images import ImageError

RED_AND_GREY = np.array([[[200, 10, 20], [90, 90, 90]]], np.uint8)
ALPHA = np.full((1, 2), 7, np.uint8)


@pytest.mark.parametrize(
    ("encoding", "pixels"),
    [
        ("rgb8", RED_AND_GREY),
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


@pytest.mark.parametrize(("encoding", "unit"), [("16UC1", 1000), ("32FC1", 1.0)])
def test_what_is_near_is_bright_in_a_depth_image(encoding, unit):
    depths = unit * np.array([[0.5, 1.0, 4.0, 0.0]])
    kind = np.uint16 if encoding == "16UC1" else np.float32
    near, middle, far, unknown = np.asarray(
        image_of(image_message(Header(), encoding, depths.astype(kind)))
    )[0]
    assert near > middle + 20 > far + 40 > unknown + 60 == 60


@pytest.mark.parametrize(
    "message",
    [
        Image(),
        Image(encoding="rgb8", width=2, height=2, step=6, data=[0] * 11),
        Image(encoding="rgb8", width=2, height=1, step=5, data=[0] * 6),
        Image(encoding="32FC2", width=1, height=1, step=8, data=[0] * 8),
        Image(encoding="mono8", width=2**32 - 1, height=2**32 - 1, step=2**32 - 1),
    ],
)
def test_a_damaged_or_unsupported_image_is_refused(message):
    with pytest.raises(ImageError):
        image_of(message)


def compressed(kind: str, size: tuple[int, int] = (64, 48), **options: object) -> CompressedImage:
    file = io.BytesIO()
    PillowImage.new("RGB", size, (200, 10, 20)).save(file, kind, **options)
    return CompressedImage(data=file.getvalue())


def test_a_jpeg_of_a_camera_is_passed_on_unless_it_is_too_wide():
    message = compressed("JPEG", progressive=True, comment=b"a camera")
    picture = Snapshot("/image", 1, message, *size_of(message))
    assert (picture.width, picture.height) == (64, 48)
    assert picture.jpeg(64) == bytes(message.data)
    smaller = PillowImage.open(io.BytesIO(picture.jpeg(32)))
    assert (smaller.format, smaller.size) == ("JPEG", (32, 24))


@pytest.mark.parametrize(
    "message",
    [
        *(
            CompressedImage(data=data)
            for data in (b"", b"\xff\xd8\xff", b"\xff\xd8\xff\xe0\x00\x00" * 9, b"GIF")
        ),
        compressed("PNG", (6000, 6000)),  # few bytes
        compressed("EPS"),  # Pillow would start an interpreter for it
    ],
)
def test_a_compressed_image_that_is_damaged_or_dangerous_has_no_size(message):
    with pytest.raises(ImageError):
        size_of(message)
