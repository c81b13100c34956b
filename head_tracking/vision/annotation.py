"""Draw detections into images."""

from __future__ import annotations

from collections.abc import Sequence

from head_tracking.vision.candidate import Candidate
from head_tracking.vision.identity import Track
from head_tracking.vision.images import Pixels
from head_tracking.vision.opencv import cv2
from head_tracking.vision.visual_tracker import Sighting

_GREEN, _GREY, _WHITE, _SHADOW = (60, 220, 60), (170, 170, 170), (255, 255, 255), (30, 30, 30)


def annotated(picture: Pixels, tracks: Sequence[Track], target: Sighting | None) -> Pixels:
    """Return a copy of an image with boxes, features, distances and a cross in the middle.

    Args:
        picture: blue, green, red, shape (height, width, 3).
        tracks: the tracks to draw in grey.
        target: the followed object, drawn in green; None: none.
    """
    drawn = picture.copy()
    height, width = drawn.shape[:2]
    for track in tracks:
        if track.located is None or (target is not None and track.number == target.number):
            continue
        _draw(drawn, track.located.candidate, f"{track.number}", _GREY)
    if target is not None:
        x, y, z = target.point
        away = (x * x + y * y + z * z) ** 0.5
        text = f"{target.number}: {away:.2f} m {100 * target.confidence:.0f}%"
        _draw(drawn, target.candidate, text, _GREEN)
        u, v = map(round, target.candidate.centre)
        cv2.drawMarker(drawn, (u, v), _GREEN, cv2.MARKER_CROSS, 14, 2)
    cv2.drawMarker(drawn, (width // 2, height // 2), _WHITE, cv2.MARKER_CROSS, 20, 1)
    return drawn


def _draw(picture: Pixels, candidate: Candidate, text: str, colour: tuple[int, int, int]) -> None:
    x, y, w, h = (round(number) for number in candidate.box)
    cv2.rectangle(picture, (x, y), (x + w, y + h), colour, 2)
    for u, v in candidate.points:
        cv2.circle(picture, (round(float(u)), round(float(v))), 2, colour, -1)
    if candidate.label:
        text = f"#{candidate.label} {text}"
    for shade, thickness in ((_SHADOW, 3), (colour, 1)):
        cv2.putText(
            picture, text, (x, max(12, y - 6)), cv2.FONT_HERSHEY_SIMPLEX, 0.5, shade, thickness,
            cv2.LINE_AA,
        )  # fmt: skip
