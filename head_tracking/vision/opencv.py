"""OpenCV, where it is installed; the only file that imports it, and only when it is used."""

from __future__ import annotations

from typing import Any

from head_tracking.exceptions import HeadTrackingError


class OpenCVMissingError(HeadTrackingError, ImportError):
    """OpenCV is needed and not there; the message says how to get it."""

    def __init__(self) -> None:
        super().__init__(
            "OpenCV is not installed. In a checkout: pip install -r requirements/vision.txt; "
            "elsewhere: pip install 'head_tracking[vision]', or OpenCV 4.6 or newer by other ways "
            "(4.8 for the net that finds faces)"
        )


class _OpenCV:
    """The module cv2, loaded at its first use: most runs have no camera."""

    def __getattr__(self, name: str) -> Any:
        try:
            import cv2
        except ImportError:
            raise OpenCVMissingError from None
        return getattr(cv2, name)


cv2: Any = _OpenCV()
"""The module cv2; without it every attribute raises `OpenCVMissingError`."""


def require_opencv() -> None:
    """Makes OpenCV ready for a node: it works in the node's own thread only.

    Its worker threads would take all cores, and the servo bus beside them would come too late.

    Raises:
        OpenCVMissingError: it is not there.
    """
    cv2.setNumThreads(1)
