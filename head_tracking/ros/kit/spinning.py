"""Starts ROS, and runs nodes in one executor until a signal, the end of a time, or an error."""

from __future__ import annotations

import argparse
import atexit
import inspect
import math
import os
import re
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import Any

import rclpy
from ament_index_python.packages import get_package_prefix
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import ParameterException
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.logging import get_logging_directory
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.timer import Timer

from head_tracking.command_line import without_ros_arguments
from head_tracking.exceptions import HeadTrackingError, RefusedError
from head_tracking.ros.kit.node_parameters import check_parameters, merged
from head_tracking.ros.kit.stop_signal import StopSignal
from head_tracking.share import share_directory

try:
    from rclpy.experimental import EventsExecutor
except ImportError:  # an older rclpy
    EventsExecutor = None

_POLL = 0.1  # s
_PATIENCE = 3.0  # s that a node's callbacks may take to return at the end

_PROFILES = {
    "fastrtps": "FASTRTPS_DEFAULT_PROFILES_FILE",
    "fastdds": "FASTDDS_DEFAULT_PROFILES_FILE",
}
"""The variables of Fast DDS 2 and 3 for their settings; 3 warns of that of 2."""

EXPLAINED = (HeadTrackingError, ParameterException)
"""Errors that are printed without a traceback."""


class ClosingNode(Node):
    """A node that calls `closing` when it is destroyed, also if its constructor has failed.

    Since ROS 2 Kilted a context that shuts down destroys its nodes, also incomplete ones.

    Attributes:
        closing: callbacks, the last one first.
    """

    def __init__(self, name: str, **options: Any) -> None:
        self.closing = ExitStack()
        super().__init__(name, **options)

    def destroy_node(self) -> None:
        """Call `closing`, then destroy the node."""
        self.closing.close()
        super().destroy_node()


class NodeDied(Exception):
    """A node ended with an error, which is the cause of this one."""

    def __init__(self, name: str, error: Exception) -> None:
        super().__init__(f"{name} died: {error or type(error).__name__}")
        self.__cause__ = error


def describe(error: Exception) -> str:
    """Return the message of an error, and its traceback if the error is unexpected."""
    cause = error.__cause__ if isinstance(error, NodeDied) else error
    if isinstance(cause, RefusedError):
        return str(cause)
    if isinstance(cause, EXPLAINED):
        return str(error)
    if isinstance(cause, rclpy_implementation.RCLError) and "creating node" in str(cause):
        return in_short(cause)  # such as security that the middleware does not have
    return "".join(traceback.format_exception(cause)) + str(error)


class NodeThreads:
    """Spins nodes in one thread, by an EventsExecutor where that works.

    Attributes:
        problems: problems at the end, such as servos that may have torque on.
    """

    def __init__(self) -> None:
        self._nodes: list[Node] = []
        self._executor: Executor | None = None
        self._thread = threading.Thread(target=self._spin, name="nodes", daemon=True)
        self._ending = threading.Event()
        self._failure: NodeDied | None = None
        self.problems: list[str] = []

    @property
    def failure(self) -> NodeDied | None:
        """The first error of a node: of a callback, or its attribute `failure`."""
        for node in self._nodes:
            error = getattr(node, "failure", None)
            if self._failure is None and error is not None:
                self._failure = NodeDied(node.get_name(), error)
        return self._failure

    def start(self, node: Node) -> None:
        """Start to spin a node."""
        self._nodes.append(node)
        if self._executor is None:
            self._executor = _executor_of(node)
            self._thread.start()
        else:
            self._executor.add_node(node)

    def wait(
        self,
        stop: StopSignal,
        duration: float | None = None,
        update: Callable[[], object] = lambda: None,
    ) -> None:
        """Wait for `stop`, for `duration` [s], or for an error in a node.

        Args:
            stop: ends the wait.
            duration: the longest wait [s]; None: no limit.
            update: called ten times a second.

        Raises:
            NodeDied: a node ended with an error.
        """
        end = math.inf if duration is None else time.monotonic() + duration
        ahead = -math.inf  # the system's clock, of the monotonic one [s]
        while not stop() and (left := end - time.monotonic()) > 0.0:
            if self.failure is not None:
                raise self.failure
            before, ahead = ahead, time.time() - time.monotonic()
            if ahead < before - _POLL:
                self._restart_timers()
            update()
            stop.wait(min(_POLL, left))

    def close(self) -> None:
        """Stop what moves, end the thread, then destroy the nodes, the last one first.

        First the methods `make_safe` of the nodes are called, which return their problems; running
        callbacks do not delay that.
        """
        if self._ending.is_set():
            return
        self._ending.set()
        nodes, self._nodes = self._nodes, []
        for node in nodes:
            make_safe = getattr(node, "make_safe", None)
            if make_safe is not None:
                self.problems += make_safe()
        if self._thread.is_alive():
            self._thread.join(_PATIENCE)
        if self._thread.is_alive():
            self.problems.append("a callback does not return")
            atexit.register(os._exit, 1)  # it would abort the interpreter's exit
            atexit.register(sys.stdout.flush)  # the last one is called first
            return
        for node in reversed(nodes):
            node.destroy_node()

    def _restart_timers(self) -> None:
        """Restart the timers, because the system's clock was set back.

        They run on the steady clock, but the wheels of rclpy wait for them by the system's clock,
        as programs for an older glibc do: they would stand still for as long as the step.
        """
        for node in self._nodes:
            for timer in node.timers:
                if not timer.is_canceled():
                    timer.reset()

    def _spin(self) -> None:
        assert self._executor is not None
        try:
            while not self._ending.is_set():
                self._executor.spin_once(timeout_sec=_POLL)
        except Exception as error:
            self._failure = self._failure or NodeDied(_node_of(error), error)
        finally:
            self._executor.shutdown()


def _node_of(error: Exception) -> str:
    """Return the name of the node whose callback raised an error."""
    for frame, _ in traceback.walk_tb(error.__traceback__):
        owner = frame.f_locals.get("self")
        node = owner if isinstance(owner, Node) else getattr(owner, "_node", None)
        if isinstance(node, Node):
            return str(node.get_name())
    return "a node"


def _executor_of(node: Node) -> Executor:
    """Return an executor of a node: an EventsExecutor if rclpy and the middleware support it."""
    if EventsExecutor is not None:
        executor = EventsExecutor(context=node.context)
        try:
            executor.add_node(node)
            executor.spin_once(timeout_sec=0.0)  # raises if the middleware reports no events
            return executor
        except rclpy_implementation.RCLError:
            executor.remove_node(node)
            executor.shutdown()
    node.get_logger().warning(
        "rclpy or the middleware does not support the EventsExecutor: another executor runs the "
        "nodes, which needs more processor time"
    )
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    return executor


def steady_timer(node: Node, period: float, callback: Callable[[], object]) -> Timer:
    """Create a timer on the steady clock; the period is in seconds.

    A timer on the node's own clock stands still for hours when that clock is set back by hours, and
    while nothing publishes /clock.
    """
    return node.create_timer(period, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))


def check_arguments(node: Callable[[], Node]) -> None:
    """Print the help of a program that runs a node, if the command line asks for it.

    Raises:
        SystemExit: the help was printed, or there is an argument that is none of ROS.
    """
    parser = argparse.ArgumentParser(
        usage="%(prog)s [--ros-args ...]",
        description=(inspect.getdoc(node) or "").split("\n\n", 1)[0],
        epilog="--ros-args: -p PARAMETER:=VALUE and --params-file FILE set parameters, "
        "-r NAME:=NEW renames topics and services; all names: docs/reference/nodes.md and "
        "docs/reference/parameters.md",
    )
    parser.parse_args(without_ros_arguments(sys.argv[1:]))


def run_node(make: Callable[[], Node]) -> int:
    """Run one node as a program until a signal ends it; see `StopSignal` and `run_ros`.

    Raises:
        SystemExit: see `check_arguments`.
    """
    check_arguments(make)

    def work(threads: NodeThreads) -> None:
        node = make()
        check_parameters([node])
        threads.start(node)
        threads.wait(stop)

    with StopSignal() as stop:
        return run_ros(work)


def run_ros(work: Callable[[NodeThreads], object], arguments: Sequence[str] | None = None) -> int:
    """Run nodes in ROS.

    Args:
        work: starts the nodes and waits.
        arguments: of ROS; see `start_ros`.

    Returns:
        The exit code: 0, or 1 after an error at the start, in a callback, or at the end (servos
        that are not confirmed relaxed); the error is printed.
    """
    try:
        with ros_threads(arguments) as threads:
            work(threads)
    except Exception as error:
        print(describe(error), file=sys.stderr)
        return 1
    return 1 if threads.problems else 0


@contextmanager
def ros_threads(arguments: Sequence[str] | None = None) -> Iterator[NodeThreads]:
    """Start ROS and yield threads for nodes; end both, and print the problems of that.

    For the arguments see `start_ros`.
    """
    start_ros(arguments)
    threads = NodeThreads()
    try:
        with closing(threads):
            yield threads
    finally:
        rclpy.try_shutdown()
        for problem in threads.problems:
            print(problem, file=sys.stderr)


def start_ros(arguments: Sequence[str] | None = None) -> None:
    """Call `rclpy.init` without its signal handlers.

    If no log file can be written, a warning is printed. Fast DDS uses config/fastdds.xml unless the
    user has other settings.

    Args:
        arguments: the command line; None: `sys.argv`.

    Raises:
        HeadTrackingError: an argument of ROS is malformed.
        ParameterFileError: a parameter file is malformed.
    """
    # rosidl_generator_py does without its generator, whose parser takes 7 MB and 0.1 s
    sys.modules.setdefault("rosidl_generator_py.generate_py_impl", None)  # type: ignore[arg-type]
    arguments = list(sys.argv if arguments is None else arguments)
    reason = _why_no_log_file()
    if reason:
        print(f"no log file is written: {reason}", file=sys.stderr)
        arguments += ["--ros-args", "--disable-external-lib-logs", "--"]
    if not any(map(os.environ.get, _PROFILES.values())):
        settings = str(share_directory() / "config/fastdds.xml")
        os.environ.update({_PROFILES[name]: settings for name in _fast_dds()})
    try:
        with merged(arguments) as accepted:
            rclpy.init(args=accepted, signal_handler_options=SignalHandlerOptions.NO)
    except rclpy_implementation.UnknownROSArgsError as error:
        raise HeadTrackingError(
            f"not arguments of ROS: {error}; what follows --ros-args goes to ROS: put options of "
            "the program before it"
        ) from error
    except rclpy_implementation.RCLError as error:
        raise HeadTrackingError(in_short(error)) from error


def _fast_dds() -> list[str]:
    """Return the keys of `_PROFILES` for the installed Fast DDS."""
    try:
        share = Path(get_package_prefix("rmw_fastrtps_cpp")) / "share"
    except (LookupError, OSError):  # another middleware; or AMENT_PREFIX_PATH is not set
        return []
    return [name for name in _PROFILES if (share / name).is_dir()]


def _why_no_log_file() -> str:
    """Return why ROS's log folder cannot be written; empty if it can."""
    try:
        folder = get_logging_directory()
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return ""
    except (OSError, RuntimeError) as error:  # RuntimeError: HOME is not set
        return f"{error}; set ROS_LOG_DIR to a folder that can be written"


def in_short(error: Exception) -> str:
    """Return the message of an error of ROS in one line, without places in its source."""
    text = re.sub(r", at /\S+\.c(pp)?:\d+", "", str(error))
    text = re.sub(r"^failed to initialize \w+: |^Failed to parse ROS arguments: ", "", text)
    return " ".join(text.split())
