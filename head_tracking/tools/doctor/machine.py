"""doctor looks at this machine: Python, libraries, ROS, its middleware, discovery, processor.

Needs nothing but Python, so that it can say what is missing.
"""

from __future__ import annotations

import importlib
import os
import platform
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from head_tracking.tools.doctor.findings import Finding, Level

_PYTHONS: Final = ((3, 11), (3, 12), (3, 13))
_LIBRARIES: Final[Mapping[str, str]] = {
    "dynamixel_sdk": "ros-jazzy-dynamixel-sdk",
    "lxml": "python3-lxml",
    "numpy": "python3-numpy",
    "rich": "python3-rich",
    "serial": "python3-serial",
    "six": "python3-six",
    "trimesh": "",
    "xacro": "ros-jazzy-xacro",
    "yaml": "python3-yaml",
    "yourdfpy": "",
}
"""What has to be there, and what brings it on Ubuntu; nothing does for the empty ones."""

_MESSAGES: Final = (
    "rcl_interfaces", "std_msgs", "sensor_msgs", "geometry_msgs", "diagnostic_msgs", "std_srvs",
)  # fmt: skip
_OPTIONAL: Final[Mapping[str, str]] = {
    "cv2": "cameras",
    "viser": "the page in a browser",
    "tf2_msgs": "/tf",
    "visualization_msgs": "markers in RViz",
}
_RANGES: Final = ("SUBNET", "LOCALHOST", "OFF", "SYSTEM_DEFAULT")
_SAFE_DOMAINS: Final = (*range(102), *range(215, 233))
"""Others share their ports with Linux's ephemeral ones (ROS 2's documentation on the domain id)."""

_BUSY, _FULL = 0.7, 0.3  # cores that must be idle: a simulated run takes up to 0.4 of a fast one
_SLOW, _TOO_SLOW = 0.003, 0.010  # s late; a cycle of the bus is 0.020 s
_LOOKS: Final = 200
_PAUSE: Final = 0.005


@dataclass(frozen=True, slots=True)
class Processor:
    """What there is left of the processor.

    Attributes:
        cores: How many there are.
        idle: How many of them are idle.
        late: By how much 19 of 20 short sleeps at most overshoot, s.
    """

    cores: int
    idle: float
    late: float


def _problem(module: str) -> str:
    """Why a module cannot be loaded; empty if it can."""
    try:
        importlib.import_module(module)
    except Exception as error:
        return f"{type(error).__name__}: {error}".splitlines()[0]
    return ""


def measure_processor(proc: Path = Path("/proc")) -> Processor:
    """Look at the processor for a second."""
    cores = os.cpu_count() or 1
    idle, total = _idle_and_total(proc)
    late = []
    for _ in range(_LOOKS):
        wanted = time.monotonic() + _PAUSE
        time.sleep(_PAUSE)
        late.append(time.monotonic() - wanted)
    idle_after, total_after = _idle_and_total(proc)
    share = (idle_after - idle) / max(1, total_after - total)
    return Processor(cores, share * cores, sorted(late)[round(0.95 * _LOOKS)])


def _idle_and_total(proc: Path) -> tuple[int, int]:
    counts = [int(word) for word in (proc / "stat").read_text().splitlines()[0].split()[1:9]]
    return counts[3] + counts[4], sum(counts)  # idle, and waiting for a disk


@dataclass(frozen=True, slots=True)
class Machine:
    """What is looked at; tests put something else in its place.

    Attributes:
        python: Version of Python.
        system: Operating system and processor, such as "Linux x86_64".
        environment: The environment's variables.
        problem: Says why a module cannot be loaded.
        processor: Measures the processor.
        proc: Where the kernel shows its processes.
    """

    python: tuple[int, int] = (sys.version_info[0], sys.version_info[1])
    system: str = f"{platform.system()} {platform.machine()}"
    environment: Mapping[str, str] = field(default_factory=lambda: os.environ)
    problem: Callable[[str], str] = _problem
    processor: Callable[[], Processor] = measure_processor
    proc: Path = Path("/proc")

    @property
    def has_libraries(self) -> bool:
        """Whether everything can be loaded that the core needs."""
        return not any(self.problem(name) for name in _LIBRARIES)

    @property
    def has_ros(self) -> bool:
        """Whether nodes can run."""
        return not any(self.problem(name) for name in ("rclpy", *_MESSAGES))


def look_at_machine(machine: Machine) -> Iterator[Finding]:
    """All that needs no servo and no network."""
    yield _python(machine)
    yield _libraries(machine)
    yield _optional(machine)
    yield _ros(machine)
    yield _middleware(machine)
    yield _domain(machine)
    yield _discovery(machine)
    yield _processor(machine)


def _python(machine: Machine) -> Finding:
    text = f"{machine.python[0]}.{machine.python[1]} on {machine.system}"
    if machine.python in _PYTHONS:
        return Finding("Python", Level.GREEN, text)
    return Finding(
        "Python",
        Level.RED,
        text,
        "Python 3.11 to 3.13 is needed; Ubuntu 24.04 has 3.12 (/usr/bin/python3)",
    )


def _libraries(machine: Machine) -> Finding:
    problems = {name: why for name in _LIBRARIES if (why := machine.problem(name))}
    if not problems:
        return Finding("libraries", Level.GREEN, f"all {len(_LIBRARIES)} are there")
    packages = [package for name in problems if (package := _LIBRARIES[name])]
    cures = [f"sudo apt install {' '.join(packages)}"] if packages else []
    if any(not _LIBRARIES[name] for name in problems):
        cures.append("ros2 run head_tracking head_setup yourdfpy")
    return Finding(
        "libraries",
        Level.RED,
        "; ".join(f"{name}: {why}" for name, why in problems.items()),
        f"{' and '.join(cures)}; without ROS: ./scripts/run sets up all of it",
    )


def _optional(machine: Machine) -> Finding:
    missing = [f"{name} ({what})" for name, what in _OPTIONAL.items() if machine.problem(name)]
    text = f"not there: {', '.join(missing)}" if missing else "all there"
    why = machine.problem("cv2")
    if why and not why.startswith("ModuleNotFoundError"):  # it is there, and broken
        return Finding(
            "for some things",
            Level.RED,
            f"OpenCV does not load: {why}",
            "sudo apt install --reinstall python3-opencv, or in a virtual environment "
            "pip install --force-reinstall opencv-python-headless; with apt's OpenCV, numpy "
            "must be below 2",
        )
    return Finding("for some things", Level.GREEN, text)


def _ros(machine: Machine) -> Finding:
    distribution = machine.environment.get("ROS_DISTRO", "")
    if distribution not in ("", "jazzy"):
        return Finding(
            "ROS",
            Level.RED,
            f"ROS 2 {distribution.capitalize()} is sourced",
            "source /opt/ros/jazzy/setup.bash in a new terminal",
        )
    why = machine.problem("rclpy")
    if why and not distribution and why.startswith("ModuleNotFoundError"):
        cure = "source /opt/ros/jazzy/setup.bash, if it is installed"
        if machine.system == "Linux x86_64":
            cure += "; or ./scripts/run, which brings it as Python wheels"
        else:
            cure += "; ROS has no wheels for this machine: install ros-jazzy-ros-base with apt"
        return Finding(
            "ROS",
            Level.AMBER,
            "not there: servos can be looked at and set up (servo), but no node runs",
            cure,
        )
    problems = {name: text for name in ("rclpy", *_MESSAGES) if (text := machine.problem(name))}
    if problems:
        missing = " ".join(f"ros-jazzy-{name.replace('_', '-')}" for name in problems)
        return Finding(
            "ROS",
            Level.RED,
            "; ".join(f"{name}: {text}" for name, text in problems.items()),
            f"use ROS's own Python (/usr/bin/python3), and sudo apt install {missing}",
        )
    return Finding("ROS", Level.GREEN, f"rclpy loads ({distribution or 'not sourced: wheels'})")


def _middleware(machine: Machine) -> Finding:
    if machine.problem("rclpy"):
        return Finding("RMW", Level.SKIPPED, "not looked at without ROS")
    wanted = machine.environment.get("RMW_IMPLEMENTATION", "")
    found = sorted(
        {
            path.name
            for prefix in machine.environment.get("AMENT_PREFIX_PATH", "").split(":")
            if prefix
            for path in Path(prefix, "share/ament_index/resource_index/rmw_typesupport").glob(
                "rmw_*_cpp"
            )
        }
    )
    there = ", ".join(found) or "the one that rclpy brings"
    if wanted and found and wanted not in found:
        return Finding(
            "RMW",
            Level.RED,
            f"RMW_IMPLEMENTATION is {wanted}; installed: {there}",
            f"sudo apt install ros-jazzy-{wanted.replace('_', '-')}, or unset RMW_IMPLEMENTATION",
        )
    if wanted not in ("", "rmw_fastrtps_cpp"):
        return Finding(
            "RMW",
            Level.AMBER,
            f"{wanted}; head_tracking is tried with rmw_fastrtps_cpp only",
            "all machines must use the same one; unset RMW_IMPLEMENTATION if something is odd",
        )
    return Finding("RMW", Level.GREEN, wanted or there)


def _domain(machine: Machine) -> Finding:
    text = machine.environment.get("ROS_DOMAIN_ID", "") or "0"
    if not text.isdigit() or int(text) > 232:
        return Finding(
            "ROS_DOMAIN_ID", Level.RED, f"{text!r} is no domain", "use 0 to 101, the same on all"
        )
    if int(text) not in _SAFE_DOMAINS:
        return Finding(
            "ROS_DOMAIN_ID",
            Level.AMBER,
            f"{text}: other programs may have taken its ports",
            "use 0 to 101, the same on all machines",
        )
    return Finding("ROS_DOMAIN_ID", Level.GREEN, text)


def _discovery(machine: Machine) -> Finding:
    environment = machine.environment
    check = "discovery"
    wanted = environment.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "")
    server = environment.get("ROS_DISCOVERY_SERVER", "")
    if wanted and wanted not in _RANGES:
        return Finding(
            check,
            Level.RED,
            f"ROS_AUTOMATIC_DISCOVERY_RANGE is {wanted!r}, which nobody knows",
            f"use one of {', '.join(_RANGES)}",
        )
    if environment.get("ROS_LOCALHOST_ONLY", "") == "1":
        return Finding(
            check,
            Level.AMBER,
            "ROS_LOCALHOST_ONLY=1 overrides all else, and is going to disappear",
            "unset it, and set ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST",
        )
    if server:
        return Finding(check, Level.GREEN, f"by the discovery server at {server}")
    if wanted == "OFF":
        return Finding(
            check,
            Level.AMBER,
            "OFF: no other process hears this one",
            "set ROS_AUTOMATIC_DISCOVERY_RANGE to LOCALHOST, or to SUBNET for other machines",
        )
    if wanted == "LOCALHOST":
        peers = environment.get("ROS_STATIC_PEERS", "")
        also = f", and {peers}" if peers else ""
        return Finding(check, Level.GREEN, f"LOCALHOST: this machine only{also}")
    return Finding(
        check,
        Level.GREEN,
        "SUBNET: whoever is on this network and in this domain may command the head "
        "(docs/distributed.md)",
    )


def look_at_security(machine: Machine, refused: str | None) -> Finding:
    """What is set of SROS 2, and whether the middleware has it.

    Args:
        machine: This machine.
        refused: Why no node could be made; empty: one was made; None: nobody has tried.
    """
    environment = machine.environment
    if environment.get("ROS_SECURITY_ENABLE", "").lower() != "true":
        return Finding("security", Level.GREEN, "off (docs/distributed.md says how to have it)")
    store = environment.get("ROS_SECURITY_KEYSTORE", "")
    if not store or not (Path(store) / "enclaves").is_dir():
        return Finding(
            "security",
            Level.RED,
            f"it is on, but there is no keystore at {store or 'ROS_SECURITY_KEYSTORE'}",
            "ros2 security create_keystore, and set ROS_SECURITY_KEYSTORE to it",
        )
    if refused:
        return Finding(
            "security",
            Level.RED,
            f"it is on, and no node can be made: {refused}",
            "a key for the node's enclave and an RMW with security (docs/distributed.md), or unset "
            "ROS_SECURITY_ENABLE",
        )
    strict = environment.get("ROS_SECURITY_STRATEGY", "") == "Enforce"
    if not strict:
        return Finding(
            "security",
            Level.AMBER,
            "on, but nodes without keys are let in",
            "set ROS_SECURITY_STRATEGY=Enforce",
        )
    if refused is None:
        text = f"set to be enforced, by {store}; whether the RMW can was not looked at"
        return Finding("security", Level.SKIPPED, text)
    return Finding("security", Level.GREEN, f"enforced, by {store}")


def _processor(machine: Machine) -> Finding:
    seen = machine.processor()
    text = (
        f"{seen.idle:.1f} of {seen.cores} cores idle; sleeps of 5 ms are up to "
        f"{1e3 * seen.late:.1f} ms late"
    )
    level = Level.GREEN
    if seen.idle < _FULL or seen.late > _TOO_SLOW:
        level = Level.RED
    elif seen.idle < _BUSY or seen.late > _SLOW:
        level = Level.AMBER
    cure = "" if level is Level.GREEN else (
        "a head needs up to half a core, at once when a cycle is due: see with `top` who takes "
        "the rest; --bus-process and docs/hardware.md (systemd) give the bus precedence"
    )  # fmt: skip
    return Finding("processor", level, text, cure)
