"""A node that could not be made completely can be destroyed, as ROS 2 Kilted does at the end."""

import pytest

from head_tracking.ros.bus.servo_bus import ServoBusNode
from head_tracking.ros.head.head_tracker import HeadTrackerNode
from head_tracking.ros.kit.closing_node import ClosingNode


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


def test_what_ends_with_a_node_ends_once_and_in_order(threads):
    node, ended = ClosingNode("node"), []
    for number in (1, 2):
        node.closing.callback(ended.append, number)
    node.destroy_node()
    node.destroy_node()
    assert ended == [2, 1]
