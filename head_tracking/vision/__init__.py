"""Detect and locate objects in camera images. Needs OpenCV."""

from collections.abc import Callable, Mapping
from typing import Any

from head_tracking.vision.annotation import annotated, depth_picture
from head_tracking.vision.camera import Box, Camera, CameraError, camera_with_view
from head_tracking.vision.camera_follower import CameraFollower, NoPictureError, pictures
from head_tracking.vision.candidate import Candidate, Detector, Frame, GivenDetector
from head_tracking.vision.colour import ColourDetector, ColourParameters
from head_tracking.vision.faces import FaceDetector, FaceParameters
from head_tracking.vision.features import FeatureDetector, FeatureParameters
from head_tracking.vision.identity import Identity, IdentityParameters, Located, Track
from head_tracking.vision.images import (
    DepthImage,
    ImageError,
    Picture,
    Pixels,
    RawImage,
    decode_compressed_depth,
    decode_compressed_picture,
    decode_depth,
    decode_picture,
)
from head_tracking.vision.markers import MarkerDetector, MarkerParameters
from head_tracking.vision.nearest import NearestDetector, NearestParameters
from head_tracking.vision.opencv import OpenCVMissingError, require_opencv
from head_tracking.vision.pairing import Pairing
from head_tracking.vision.visual_tracker import DistanceParameters, Sighting, VisualTracker

DETECTORS: Mapping[str, tuple[Callable[[Any], Detector], type[Any]]] = {
    "face": (FaceDetector, FaceParameters),
    "colour": (ColourDetector, ColourParameters),
    "features": (FeatureDetector, FeatureParameters),
    "marker": (MarkerDetector, MarkerParameters),
    "nearest": (NearestDetector, NearestParameters),
}
"""Detector and parameter class of each kind of target."""


def find_detector(name: str) -> Detector:
    """Return a detector with default parameters that uses one thread.

    Args:
        name: face, colour or marker; the other detectors need a selection or depths.

    Raises:
        OpenCVMissingError: OpenCV is not installed.
        ValueError: the name is not one of these.
    """
    if name not in ("face", "colour", "marker"):
        raise ValueError(f"the detector is {name!r}; allowed are face, colour and marker")
    require_opencv()
    make, parameters = DETECTORS[name]
    return make(parameters())


__all__ = [
    "DETECTORS",
    "Box",
    "Camera",
    "CameraError",
    "CameraFollower",
    "Candidate",
    "ColourDetector",
    "ColourParameters",
    "DepthImage",
    "Detector",
    "DistanceParameters",
    "FaceDetector",
    "FaceParameters",
    "FeatureDetector",
    "FeatureParameters",
    "Frame",
    "GivenDetector",
    "Identity",
    "IdentityParameters",
    "ImageError",
    "Located",
    "MarkerDetector",
    "MarkerParameters",
    "NearestDetector",
    "NearestParameters",
    "NoPictureError",
    "OpenCVMissingError",
    "Pairing",
    "Picture",
    "Pixels",
    "RawImage",
    "Sighting",
    "Track",
    "VisualTracker",
    "annotated",
    "camera_with_view",
    "decode_compressed_depth",
    "decode_compressed_picture",
    "decode_depth",
    "decode_picture",
    "depth_picture",
    "find_detector",
    "pictures",
    "require_opencv",
]
