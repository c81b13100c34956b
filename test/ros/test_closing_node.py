"""A node that could not be made completely can be destroyed, as ROS 2 Kilted does at the end."""

import pytest

from head_tracking.ros.bus.servo_bus import ServoBusNode
from head_tracking.ros.head.head_tracker import HeadTrackerNode


@pytest.mark.parametrize("kind", [ServoBusNode, HeadTrackerNode])
def test_a_node_that_could_not_be_made_ends_without_an_error(threads, kind, monkeypatch):
    made = []

    def parameters(node, *_, **__):
        made.append(node)
        raise ZeroDivisionError

    monkeypatch.setattr(f"{kind.__module__}.NodeParameters", parameters)
    with pytest.raises(ZeroDivisionError):
        kind()
    made[0].destroy_node()
