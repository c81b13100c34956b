"""Images, detections in them, and the interface of detectors."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, TypeAlias

import numpy as np
import numpy.typing as npt

from head_tracking.parameters import verified
from head_tracking.transforms import Vector3
from head_tracking.vision.camera import Box, Camera
from head_tracking.vision.images import DepthImage, ImageError, Picture

Mask: TypeAlias = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Frame:
    """One image with its camera and depths.

    Attributes:
        stamp: time of the image [ns].
        camera: the camera.
        picture: the colours; None: depths only.
        depth: depths aligned with the image; None: none.

    Raises:
        ImageError: the sizes of picture, depth and camera differ.
    """

    stamp: int
    camera: Camera
    picture: Picture | None = None
    depth: DepthImage | None = None

    def __post_init__(self) -> None:
        camera = (self.camera.width, self.camera.height)
        for what, image in (("picture", self.picture), ("depth image", self.depth)):
            if image is not None and image.size != camera:
                raise ImageError(
                    f"the {what} has {image.size[0]}x{image.size[1]} pixels and the camera model "
                    f"(camera_info) {camera[0]}x{camera[1]}; picture, aligned depth and camera "
                    "model must agree"
                )


@dataclass(frozen=True, slots=True)
class Candidate:
    """One detected object.

    Attributes:
        box: bounding box.
        centre: column and row of the middle.
        confidence: 0 to 1.
        label: class or name, such as the number of a marker.
        unique: whether the label identifies one object.
        mask: pixels of the box that belong to the object; None: an ellipse in the box.
        position: position in the optical frame [m], if the detector measures it.
        points: columns and rows to draw, such as corners and features, shape (N, 2).
    """

    box: Box
    centre: tuple[float, float]
    confidence: float
    label: str = ""
    unique: bool = False
    mask: Mask | None = None
    position: Vector3 | None = None
    points: npt.NDArray[np.float32] = field(
        default_factory=lambda: np.zeros((0, 2), np.float32), compare=False
    )

    def pixels(self, shape: tuple[int, ...], fill: float) -> Mask:
        """Return the mask, or an ellipse if that has not this shape; see `ellipse_mask`."""
        if self.mask is not None and self.mask.shape == shape:
            return self.mask
        return ellipse_mask(shape[0], shape[1], fill)


class Detector(ABC):
    """Detects objects of one kind; may keep a state between images.

    Args:
        parameters: an object of the class `Parameters`; without such a class anything.

    Raises:
        ParameterError: a value is not allowed.
        TypeError: they are of another class.

    Attributes:
        parameters: may be changed at any time.
    """

    Parameters: ClassVar[Any] = None

    def __init__(self, parameters: Any) -> None:
        kind = self.Parameters
        if kind is not None and not isinstance(parameters, kind):
            raise TypeError(f"the parameters are {parameters!r}; give {kind.__name__}")
        self.parameters = parameters if kind is None else verified(parameters)

    @property
    def has_selection(self) -> bool:
        """Whether it can detect something; False: not before `select`."""
        return True

    @abstractmethod
    def detect(self, frame: Frame, hints: Sequence[Box]) -> list[Candidate]:
        """Return all detected objects.

        Args:
            frame: the image.
            hints: predicted boxes of tracked objects.
        """

    def select(self, frame: Frame, box: Box) -> None:  # noqa: B027
        """Learn the object in a box that a user has drawn."""

    def reset(self) -> None:  # noqa: B027
        """Discard the selected object."""


def ellipse_mask(height: int, width: int, fill: float) -> Mask:
    """Return the pixels of an ellipse in the middle of a box, shape (height, width).

    Args:
        height: height of the box [pixels].
        width: width of the box [pixels].
        fill: axes of the ellipse, relative to the box.
    """
    v = (np.arange(height) + 0.5) / height * 2 - 1
    u = (np.arange(width) + 0.5) / width * 2 - 1
    return np.asarray(u * u + (v * v)[:, None] <= fill * fill)
