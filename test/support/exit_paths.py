"""A program that listens for transforms and ends in the way that its argument names."""

import os
import signal
import sys
import threading
import time

import rclpy
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.time import Time

from head_tracking.tf import Buffer, TransformListener


def main(way: str) -> None:
    rclpy.init()
    buffer = Buffer()
    if "own" in way:
        listener = TransformListener(buffer)
    else:
        listener = TransformListener(buffer, Node("program"), spin_thread=True)
    time.sleep(0.2)
    if "error" in way:
        raise RuntimeError("the program's own")
    if "shutdown" in way:
        rclpy.shutdown()
    if "destroy" in way:
        listener.node.destroy_node()
    if "drop" in way:
        del listener, buffer
    if "unregister" in way:
        listener.unregister()
        listener.unregister()
    if "busy" in way:
        listener.node.create_timer(0.01, lambda: time.sleep(60))
        time.sleep(0.2)
    if "wait" in way:
        ask = (lambda: buffer.lookup_transform("a", "b", Time(), Duration(seconds=60)),)
        threading.Thread(target=ask[0], daemon=True).start()
    if "interrupt" in way:
        threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()
        if "sleeping" in way:
            time.sleep(30)
        rclpy.spin(Node("other"))
    if "spin" in way:
        other = Node("other")
        threading.Timer(0.3, rclpy.shutdown).start()
        rclpy.spin(other)


if __name__ == "__main__":
    main(sys.argv[1])
