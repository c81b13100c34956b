"""Programs say often that they are there: whoever starts later must not wait for them."""

import os
import socket
import subprocess
import sys
import time

import pytest

from test.support.ros_domain import own_domain

PROGRAM = """
import os, sys
from rclpy.node import Node
from head_tracking.ros.kit.spinning import start_ros
start_ros(["program"])
node = Node("announced")
sys.stdin.read()
print(os.environ["FASTRTPS_DEFAULT_PROFILES_FILE"])
"""
NUMBER = 31  # of a process in its domain; it is said to the first 32 on the machine
INITIAL = 6  # announcements that Fast DDS makes within half a second


@pytest.fixture
def program():
    """Makes a program; yields it, and what it says to others on the machine."""
    with own_domain() as domain, socket.socket(type=socket.SOCK_DGRAM) as hears:
        hears.bind(("127.0.0.1", 7400 + 250 * int(domain) + 10 + 2 * NUMBER))
        hears.settimeout(30.0)

        def start(profiles: str = "") -> tuple[subprocess.Popen[str], socket.socket]:
            environment = {
                **os.environ,
                "ROS_DOMAIN_ID": domain,
                "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
                "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
                "FASTRTPS_DEFAULT_PROFILES_FILE": profiles,
                "FASTDDS_DEFAULT_PROFILES_FILE": "",
            }
            return subprocess.Popen(
                [sys.executable, "-c", PROGRAM],
                env=environment,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
            ), hears

        yield start


def test_a_program_says_often_that_it_is_there(program):
    announced, hears = program()
    heard = []
    try:
        while len(heard) < INITIAL + 4:
            assert hears.recv(1 << 16).startswith(b"RTPS")
            heard.append(time.monotonic())
    finally:
        (settings,) = announced.communicate("", timeout=30)[0].splitlines()
    assert heard[-1] - heard[-4] < 3.0  # otherwise that is three times as long
    assert settings.endswith("config/fastdds.xml")


def test_a_user_s_own_settings_of_fast_dds_are_left_alone(program, tmp_path):
    mine = tmp_path / "mine.xml"
    mine.write_text("<?xml version='1.0'?><dds><profiles/></dds>")
    announced, _ = program(str(mine))
    assert announced.communicate("", timeout=30)[0].splitlines()[-1] == str(mine)
