"""Convert detections of vision_msgs and hri_msgs."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from head_tracking.transforms import Vector3
from head_tracking.vision.camera import Box, Camera
from head_tracking.vision.candidate import Candidate
from head_tracking.vision.identity import Located, is_possible


def candidates(detections: Iterable[Any], wanted: str) -> list[Candidate]:
    """Convert the detections of a Detection2DArray; skip invalid ones.

    Args:
        detections: vision_msgs/Detection2D messages.
        wanted: class to return; empty: all.
    """
    found = []
    for detection in detections:
        score = _score(detection, wanted)
        middle, box = detection.bbox.center.position, detection.bbox
        numbers = (middle.x, middle.y, box.size_x, box.size_y, box.center.theta)
        if score is None or not all(map(math.isfinite, numbers)):
            continue
        cosine, sine = abs(math.cos(box.center.theta)), abs(math.sin(box.center.theta))
        width = box.size_x * cosine + box.size_y * sine
        height = box.size_x * sine + box.size_y * cosine
        if width <= 0 or height <= 0:
            continue
        around = Box(middle.x - width / 2, middle.y - height / 2, width, height)
        found.append(
            Candidate(around, around.centre, score, detection.id, unique=bool(detection.id))
        )
    return found


def located(detections: Iterable[Any], wanted: str) -> list[Located]:
    """Convert a Detection3DArray, in the frame of the message; skip invalid detections.

    Args:
        detections: vision_msgs/Detection3D messages.
        wanted: class to return; empty: all.
    """
    found = []
    for detection in detections:
        score = _score(detection, wanted)
        at, size = detection.bbox.center.position, detection.bbox.size
        point = (at.x, at.y, at.z)
        away = math.hypot(*point)
        if score is None or not is_possible(point):
            continue
        angle = max(0.0, size.x, size.y, size.z) / away
        if not math.isfinite(angle):
            angle = 0.0
        candidate = Candidate(
            Box(0.0, 0.0, angle, angle), (0.0, 0.0), score, detection.id, bool(detection.id)
        )
        found.append(Located(candidate, point, True, angle / 2))
    return found


def region_candidate(
    name: str,
    region: Any,
    camera: Camera,
    position: Vector3 | None,
) -> Candidate | None:
    """Convert a face or body of hri_msgs; None: its region is empty or invalid.

    Args:
        name: id of the person.
        region: a NormalizedRegionOfInterest2D.
        camera: camera of the image.
        position: position in the optical frame [m]; None: unknown.
    """
    edges = (region.xmin, region.ymin, region.xmax, region.ymax)
    if not all(map(math.isfinite, edges)):
        return None
    left, right = edges[0] * camera.width, edges[2] * camera.width
    top, bottom = edges[1] * camera.height, edges[3] * camera.height
    if right <= left or bottom <= top:
        return None
    box = Box(left, top, right - left, bottom - top)
    # 0: the confidence is not set
    score = region.c if 0.0 < region.c <= 1.0 else 1.0
    return Candidate(box, box.centre, score, name, unique=True, position=position)


def _score(detection: Any, wanted: str) -> float | None:
    """Return the score of a detection; None: another class, or invalid."""
    scores = [
        result.hypothesis.score
        for result in detection.results
        if not wanted or result.hypothesis.class_id == wanted
    ]
    if not scores:
        return None if wanted or detection.results else 1.0
    best = max(scores)
    return min(1.0, max(0.0, best)) if math.isfinite(best) else None
