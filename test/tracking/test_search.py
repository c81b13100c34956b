from itertools import pairwise

from head_tracking.tracking.search import Sweep


def walk(sweep, steps, start=(0.0, 0.0)):
    """A head that jumps to wherever it is sent."""
    position, corners = start, []
    for _ in range(steps):
        goal = sweep.goal(position)
        if not corners or corners[-1] != goal:
            corners.append(goal)
        position = goal
    return corners


def test_the_whole_field_is_swept_row_by_row(head):
    corners = walk(Sweep(head), 40)
    pans, tilts = {pan for pan, _ in corners}, {tilt for _, tilt in corners}
    assert pans == {head.pan_limits.lower, head.pan_limits.upper}
    rows = sorted(tilts)
    assert rows[0] - head.tilt_limits.lower <= 0.36
    assert head.tilt_limits.upper - rows[-1] <= 0.36
    assert all(b - a <= 0.71 for a, b in pairwise(rows))
