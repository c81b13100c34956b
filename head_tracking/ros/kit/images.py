"""Conversions between image messages and the values of `head_tracking.vision`."""

from __future__ import annotations

from array import array
from typing import Any

import numpy as np
import numpy.typing as npt
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_msgs.msg import Header

from head_tracking.transforms import LATEST, Transform, TransformBuffer, TransformException
from head_tracking.vision.camera import Camera
from head_tracking.vision.images import (
    DepthImage,
    ImageError,
    Picture,
    decode_compressed_depth,
    decode_compressed_picture,
    decode_depth,
    decode_picture,
)
from head_tracking.vision.opencv import cv2


def picture_of(message: Image | CompressedImage) -> Picture:
    """Return the picture of a message.

    Raises:
        ImageError: it cannot be decoded.
    """
    if isinstance(message, CompressedImage):
        return decode_compressed_picture(message.data, message.format)
    return decode_picture(message)


def depth_of(message: Image | CompressedImage) -> DepthImage:
    """Return the depth image of a message.

    Raises:
        ImageError: it cannot be decoded.
    """
    if isinstance(message, CompressedImage):
        return decode_compressed_depth(message.data, message.format)
    return decode_depth(message)


def frame_pose(
    buffer: TransformBuffer, fixed_frame: str, frame_id: str, stamp: int
) -> Transform | None:
    """Return `T_fixed_frame` at a time [ns], else the latest one.

    None if it is not known, or `fixed_frame` is empty.
    """
    for time in (stamp, LATEST) if fixed_frame else ():
        try:
            return buffer.lookup_transform(fixed_frame, frame_id, time).transform
        except TransformException:
            continue
    return None


def image_message(header: Header, encoding: str, pixels: npt.NDArray[Any]) -> Image:
    """Return an image message.

    Args:
        header: its stamp and frame.
        encoding: of the pixels.
        pixels: shape (height, width) or (height, width, channels), in this machine's byte order.
    """
    height, width = pixels.shape[:2]
    # the setter accepts an array.array at once; of other types it checks every byte
    data = array("B")
    data.frombytes(np.ascontiguousarray(pixels).data.cast("B"))
    return Image(
        header=header,
        height=height,
        width=width,
        encoding=encoding,
        step=pixels.nbytes // height,
        data=data,
    )


def compressed_message(message: Image, quality: int = 80) -> CompressedImage:
    """Return an image message as JPEG.

    Raises:
        ImageError: it cannot be decoded or compressed.
    """
    done, data = cv2.imencode(".jpg", picture_of(message).bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])
    if not done:
        raise ImageError("it can't be compressed")
    compressed = CompressedImage(
        header=message.header, format=f"{message.encoding}; jpeg compressed bgr8"
    )
    compressed.data.frombytes(data.tobytes())
    return compressed


def camera_of(message: CameraInfo, *, rectified: bool = False) -> Camera:
    """Return the camera of a CameraInfo message, whose images may be rectified.

    Raises:
        CameraError: the calibration is not valid.
    """
    roi = message.roi
    return Camera.from_calibration(
        (message.width, message.height),
        [float(number) for number in message.k],
        [float(number) for number in message.d],
        message.distortion_model,
        turn=[float(number) for number in message.r],
        projection=[float(number) for number in message.p],
        rectified=rectified,
        binning=(message.binning_x, message.binning_y),
        region=(roi.x_offset, roi.y_offset, roi.width, roi.height),
    )


def camera_info(header: Header, camera: Camera) -> CameraInfo:
    """Return the CameraInfo message of a camera without distortion."""
    c = camera
    k = [c.fx, 0.0, c.cx, 0.0, c.fy, c.cy, 0.0, 0.0, 1.0]
    return CameraInfo(
        header=header,
        width=c.width,
        height=c.height,
        distortion_model="plumb_bob",
        d=[0.0] * 5,
        k=k,
        r=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p=[*k[:3], 0.0, *k[3:6], 0.0, *k[6:], 0.0],
    )
