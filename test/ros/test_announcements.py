"""Programs say often that they are there: whoever starts later must not wait for them."""

import os
import socket
import subprocess
import sys
import time

import pytest

from test.support.ros_domain import own_domain

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


@pytest.fixture
def announced():
    """Makes a program; yields the time between its last announcements [s], and its output."""
    with own_domain() as domain, socket.socket(type=socket.SOCK_DGRAM) as hears:
        hears.bind(("127.0.0.1", 7400 + 250 * int(domain) + 10 + 2 * NUMBER))
        hears.settimeout(30.0)

        def start(announcements: int, **environment: str) -> tuple[float, str]:
            program = subprocess.Popen(
                [sys.executable, "-c", PROGRAM],
                env={
                    **os.environ,
                    "ROS_DOMAIN_ID": domain,
                    "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
                    "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
                    "FASTRTPS_DEFAULT_PROFILES_FILE": "",
                    "FASTDDS_DEFAULT_PROFILES_FILE": "",
                    **environment,
                },
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
            )
            try:
                heard = []
                while len(heard) < INITIAL + announcements:
                    assert hears.recv(1 << 16).startswith(b"RTPS")
                    heard.append(time.monotonic())
            finally:
                said = program.communicate("", timeout=30)[0]
            return heard[-1] - heard[-announcements], said

        yield start


def test_a_program_says_often_that_it_is_there(announced):
    seconds, said = announced(4)
    assert seconds < 3.0  # otherwise that is three times as long
    assert not said


def test_a_user_s_own_settings_of_fast_dds_are_left_alone(announced, tmp_path):
    mine = tmp_path / "mine.xml"
    mine.write_text("<?xml version='1.0'?><dds><profiles/></dds>")
    seconds, _ = announced(2, FASTRTPS_DEFAULT_PROFILES_FILE=str(mine))
    assert seconds > 1.0
