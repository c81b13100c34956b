"""OpenCV, where it is installed; the only file that imports it."""

from __future__ import annotations

from typing import Any


class OpenCVMissingError(ImportError):
    """OpenCV is needed and not there; the message says how to get it."""

    def __init__(self) -> None:
        super().__init__(
            "OpenCV is not installed. In a checkout: pip install -r requirements/vision.txt; "
            "elsewhere: pip install 'head_tracking[vision]', or opencv-python-headless 4.8 or newer"
        )


class _Missing:
    def __getattr__(self, name: str) -> Any:
        raise OpenCVMissingError


cv2: Any
"""The module cv2; without it every attribute raises `OpenCVMissingError`."""

try:
    import cv2
except ImportError:
    cv2 = _Missing()


def require_opencv() -> None:
    """Makes OpenCV ready for a node: it works in the node's own thread only.

    Its worker threads would take all cores, and the servo bus beside them would come too late.

    Raises:
        OpenCVMissingError: it is not, or is too old for what is used here.
    """
    if isinstance(cv2, _Missing) or not hasattr(cv2.aruco, "ArucoDetector"):
        raise OpenCVMissingError
    cv2.setNumThreads(1)
