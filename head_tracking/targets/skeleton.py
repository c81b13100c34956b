"""The joints of a person, as skeleton trackers name their frames on /tf."""

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
"""The fifteen joints of openni_tracker, which tutorial part 2 follows."""


def mirrored(joint: str) -> str:
    """The same joint of the other side; one in the middle stays itself."""
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
    """The frame that a person means by `name`.

    Trackers that follow several people put their number behind the joint: ``left_hand_1``.

    Args:
        name: any frame, or one of `SKELETON_JOINTS`.
        frames: all that are known.
        newest: the stamp of a frame's newest transform [ns].
        mirror: left and right are swapped, if `name` is a skeleton's joint.
        user: the number of the person; 0: whoever was seen last.

    Returns:
        A frame that is known, or else the one that was asked for.
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
