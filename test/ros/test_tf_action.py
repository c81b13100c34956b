"""Lookups in another process's buffer, by tf2_ros's action."""

import threading
from contextlib import ExitStack

import pytest
import rclpy
from geometry_msgs.msg import PointStamped
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.time import Time
from robot_under_test import wait_for
from transform_messages import shifted

from head_tracking.tf import (
    Buffer,
    BufferClient,
    BufferServer,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TimeoutException,
)

pytest.importorskip("tf2_msgs.action")
PATIENCE = Duration(seconds=20)


@pytest.fixture
def asked():
    """A client, and the buffer of the server that it asks."""
    with ExitStack() as resources:
        rclpy.init()
        resources.callback(rclpy.shutdown)
        nodes = [rclpy.create_node(name) for name in ("has", "asks")]
        for node in nodes:
            executor = SingleThreadedExecutor()
            executor.add_node(node)
            thread = threading.Thread(target=executor.spin)
            thread.start()
            resources.callback(node.destroy_node)
            resources.callback(thread.join)
            resources.callback(executor.shutdown)
        buffer = Buffer()
        BufferServer(nodes[0], buffer, "tf2_buffer_server")
        client = BufferClient(nodes[1], "tf2_buffer_server")
        wait_for(client.action_client.server_is_ready)
        yield client, buffer


def test_a_transform_and_a_message_come_from_there(asked):
    client, buffer = asked
    buffer.set_transform(shifted(1.0, 1))
    buffer.set_transform(shifted(3.0, 3))
    found = client.lookup_transform("map", "ball", Time(seconds=2))
    assert found.transform.translation.x == 2.0
    full = client.lookup_transform_full("ball", Time(seconds=3), "ball", Time(seconds=1), "map")
    assert full.transform.translation.x == -2.0
    point = PointStamped()
    point.header.frame_id = "ball"
    assert client.transform(point, "map").point.x == 3.0
    assert client.can_transform("map", "ball", Time())


def test_errors_are_those_of_the_buffer_there(asked):
    client, buffer = asked
    buffer.set_transform(shifted(1.0, 1))
    with pytest.raises(LookupException, match="nose"):
        client.lookup_transform("map", "nose", Time())
    with pytest.raises(ExtrapolationException):
        client.lookup_transform("map", "ball", Time(seconds=9), Duration(seconds=0.05))
    with pytest.raises(InvalidArgumentException):
        client.lookup_transform("/map", "ball", Time())
    assert not client.can_transform_full("map", Time(), "ball", Time(seconds=9), "map")


def test_it_waits_there_while_the_server_goes_on(asked):
    client, buffer = asked
    bring = threading.Timer(0.1, buffer.set_transform, [shifted(4.0, 4)])
    bring.start()
    found = client.lookup_transform("map", "ball", Time(seconds=4), PATIENCE)
    assert found.transform.translation.x == 4.0
    bring.join()


def test_no_server_is_a_timeout(asked):
    client, _ = asked
    with pytest.raises(TimeoutException, match="not ready"):
        BufferClient(client.node, "nobody").lookup_transform("map", "ball", Time())
