"""Programs say often that they are there: whoever starts later must not wait for them."""

import os
import socket
import subprocess
import sys
import time

import rclpy
from ros_domain import own_domain
from waiting import PATIENCE

from head_tracking.ros.kit.spinning import start_ros

PROGRAM = """
import sys
from rclpy.node import Node
from head_tracking.ros.kit.spinning import start_ros
start_ros(["program"])
node = Node("announced")
sys.stdin.read()
"""
NUMBER = 31  # of a process in its domain; it is said to the first 32 on the machine
INITIAL = 6  # announcements that Fast DDS makes within half a second


def test_a_program_says_often_that_it_is_there():
    with own_domain() as domain, socket.socket(type=socket.SOCK_DGRAM) as hears:
        hears.bind(("127.0.0.1", 7400 + 250 * int(domain) + 10 + 2 * NUMBER))
        hears.settimeout(PATIENCE)
        settings = {
            "ROS_DOMAIN_ID": domain,
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
            "FASTRTPS_DEFAULT_PROFILES_FILE": "",
            "FASTDDS_DEFAULT_PROFILES_FILE": "",
        }
        command = [sys.executable, "-c", PROGRAM]
        with subprocess.Popen(command, env=os.environ | settings, stdin=subprocess.PIPE):
            heard = []
            while len(heard) < INITIAL + 4:
                assert hears.recv(1 << 16).startswith(b"RTPS")
                heard.append(time.monotonic())
    assert heard[-1] - heard[-4] < 6.0  # s; by default it is 9


def test_a_users_own_settings_of_fast_dds_are_left_alone(monkeypatch, tmp_path):
    mine = tmp_path / "mine.xml"
    mine.write_text("<?xml version='1.0'?><dds><profiles/></dds>")
    monkeypatch.setenv("FASTRTPS_DEFAULT_PROFILES_FILE", str(mine))
    monkeypatch.delenv("FASTDDS_DEFAULT_PROFILES_FILE", raising=False)
    start_ros(["program"])
    rclpy.try_shutdown()
    assert os.environ["FASTRTPS_DEFAULT_PROFILES_FILE"] == str(mine)
    assert "FASTDDS_DEFAULT_PROFILES_FILE" not in os.environ
