"""Lazy import of OpenCV; no other module imports it."""

from __future__ import annotations

from typing import Any

from head_tracking.exceptions import HeadTrackingError


class OpenCVMissingError(HeadTrackingError, ImportError):
    """OpenCV is not installed, or its version is not supported."""

    def __init__(self, problem: str = "OpenCV is not installed") -> None:
        super().__init__(
            f"{problem}. In a checkout: pip install -r requirements/vision.txt; elsewhere: "
            "pip install 'head_tracking[vision]', or another OpenCV 4, at least 4.6 (4.8 for the "
            "neural network that detects faces)"
        )


class _OpenCV:
    """The module cv2, imported at the first access."""

    def __getattr__(self, name: str) -> Any:
        try:
            import cv2
        except ImportError:
            raise OpenCVMissingError from None
        return getattr(cv2, name)


cv2: Any = _OpenCV()
"""The module cv2; every access raises `OpenCVMissingError` if it is not installed."""


def require_opencv() -> None:
    """Import OpenCV and disable its worker threads, which would delay the servo bus.

    Raises:
        OpenCVMissingError: OpenCV is not installed.
    """
    cv2.setNumThreads(1)
