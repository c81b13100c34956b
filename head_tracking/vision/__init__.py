"""Detect and locate objects in camera images. Needs OpenCV."""

from head_tracking.detectors import DETECTORS
from head_tracking.vision.annotation import annotated, depth_picture
from head_tracking.vision.camera import Box, Camera, CameraError, camera_with_view
from head_tracking.vision.camera_follower import (
    CameraFollower,
    NoPictureError,
    checked_pictures,
    pictures,
)
from head_tracking.vision.candidate import Candidate, Detector, Frame
from head_tracking.vision.colour import ColourDetector, ColourParameters
from head_tracking.vision.faces import FaceDetector, FaceParameters
from head_tracking.vision.identity import IdentityParameters, Located
from head_tracking.vision.images import (
    DepthImage,
    ImageError,
    Picture,
    Pixels,
    decode_depth,
    decode_picture,
)
from head_tracking.vision.markers import MarkerParameters
from head_tracking.vision.nearest import NearestParameters
from head_tracking.vision.opencv import OpenCVMissingError, require_opencv
from head_tracking.vision.pairing import Pairing
from head_tracking.vision.visual_tracker import DistanceParameters, Sighting, VisualTracker


def find_detector(name: str) -> Detector:
    """Return a detector with default parameters that uses one thread.

    Args:
        name: one of `DETECTORS` that needs neither a selection nor depths: face, colour, marker.

    Raises:
        OpenCVMissingError: OpenCV is not installed.
        ValueError: the name is not one of these.
    """
    allowed = [
        known for known, spec in DETECTORS.items() if not (spec.depth_only or spec.needs_selection)
    ]
    if name not in allowed:
        raise ValueError(f"the detector is {name!r}; allowed are {', '.join(allowed)}")
    require_opencv()
    return DETECTORS[name].make()


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
    "Frame",
    "IdentityParameters",
    "ImageError",
    "Located",
    "MarkerParameters",
    "NearestParameters",
    "NoPictureError",
    "OpenCVMissingError",
    "Pairing",
    "Picture",
    "Pixels",
    "Sighting",
    "VisualTracker",
    "annotated",
    "camera_with_view",
    "checked_pictures",
    "decode_depth",
    "decode_picture",
    "depth_picture",
    "find_detector",
    "pictures",
    "require_opencv",
]
