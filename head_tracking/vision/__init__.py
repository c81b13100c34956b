"""Detect and locate objects in camera images. Needs OpenCV."""

from head_tracking.detectors import DETECTORS
from head_tracking.vision.annotation import annotated
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
from head_tracking.vision.opencv import OpenCVMissingError, require_opencv
from head_tracking.vision.pairing import Pairing
from head_tracking.vision.visual_tracker import DistanceParameters, Sighting, VisualTracker


def find_detector(what: str | Detector) -> Detector:
    """Return a detector, or the one of a name: with default parameters, using one thread.

    Args:
        what: a detector, or one of `DETECTORS` that needs no selection: face, colour, marker.

    Raises:
        OpenCVMissingError: OpenCV is not installed.
        ValueError: the name is not one of these.
        TypeError: it is neither a name nor a detector.
    """
    if isinstance(what, Detector):
        return what
    if not isinstance(what, str):
        raise TypeError(f"the detector is {what!r}; give a name or an object of a Detector class")
    allowed = [known for known, spec in DETECTORS.items() if not spec.needs_selection]
    if what not in allowed:
        raise ValueError(f"the detector is {what!r}; allowed are {', '.join(allowed)}")
    require_opencv()
    return DETECTORS[what].make()


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
    "find_detector",
    "pictures",
    "require_opencv",
]
