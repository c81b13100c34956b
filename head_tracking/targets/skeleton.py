"""Joints of a person, by the names that skeleton trackers give to their frames."""

from __future__ import annotations

from collections.abc import Callable, Iterable

_SIDES = ("left", "right")

SKELETON_JOINTS = (
    "head",
    "neck",
    "torso",
    *(
        f"{side}_{joint}"
        for side in _SIDES
        for joint in ("shoulder", "elbow", "hand", "hip", "knee", "foot")
    ),
)
"""The fifteen joints of openni_tracker, as in part 2 of the tutorial."""


def mirrored(joint: str) -> str:
    """Return the same joint of the other side; one in the middle is returned unchanged."""
    side, _, rest = joint.partition("_")
    if side not in _SIDES or not rest:
        return joint
    return f"{_SIDES[1 - _SIDES.index(side)]}_{rest}"


def skeleton_frame(
    name: str,
    frames: Iterable[str],
    newest: Callable[[str], int],
    *,
    mirror: bool = False,
    user: int = 0,
) -> str:
    """Return the frame of a skeleton's joint.

    Trackers of several people append the number of the person: ``left_hand_1``.

    Args:
        name: any frame, or one of `SKELETON_JOINTS`.
        frames: all known frames.
        newest: returns the stamp of a frame's latest transform [ns].
        mirror: left and right are swapped, if `name` is a skeleton's joint.
        user: number of the person; 0: the person seen last.

    Returns:
        A known frame, or else the joint's own name.
    """
    if name not in SKELETON_JOINTS:
        return name
    joint = mirrored(name) if mirror else name
    if user:
        return f"{joint}_{user}"
    candidates = [
        frame
        for frame in frames
        if frame == joint or (frame.startswith(f"{joint}_") and frame[len(joint) + 1 :].isdigit())
    ]
    return max(candidates, key=newest, default=joint)
