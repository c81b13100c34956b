"""Runs nodes: one thread and executor each, ended by a signal, by time, or by a node that dies."""

from __future__ import annotations

import sys
import threading
import time
import traceback
from collections.abc import Callable, Sequence

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import ParameterException
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from head_tracking.ros.stop_signal import StopSignal

_POLL = 0.1  # s
_PATIENCE = 3.0  # s that a node's callbacks may take to return at the end

_EXPLAINED = (
    ("head_tracking.dynamixel.exceptions", "DynamixelError"),
    ("head_tracking.transforms", "RobotModelError"),
    ("head_tracking.transforms", "TransformException"),
    ("head_tracking.vision.opencv", "OpenCVMissingError"),
    ("head_tracking.ros.detections", "MessagesMissingError"),
)


def explained_errors() -> tuple[type[Exception], ...]:
    """Errors whose message is all that a person needs to know.

    What has not been imported has not been raised, and a servo bus needs no vision.
    """
    ours = (getattr(sys.modules.get(module), name, None) for module, name in _EXPLAINED)
    return (ParameterException, FileNotFoundError, ValueError, *filter(None, ours))


class NodeDied(Exception):
    """A node ended with an error.

    Attributes:
        name: the node.
        error: what ended it.
    """

    def __init__(self, name: str, error: Exception) -> None:
        super().__init__(f"{name} died: {error or type(error).__name__}")
        self.name = name
        self.error = error


def describe(error: Exception) -> str:
    """The error for a person: its message; the traceback too if nobody has foreseen it."""
    cause = error.error if isinstance(error, NodeDied) else error
    if isinstance(cause, explained_errors()):
        return str(error)
    return "".join(traceback.format_exception(cause)) + str(error)


class NodeThreads:
    """Nodes that spin, each in a thread of its own.

    Small executors answer faster than one big one: each wakes for its own node only.

    Attributes:
        problems: what went wrong at the end, such as servos that may have torque on.
    """

    def __init__(self) -> None:
        self._spinning: list[tuple[Node, threading.Thread]] = []
        self._ending = threading.Event()
        self._failure: NodeDied | None = None
        self.problems: list[str] = []

    @property
    def failure(self) -> NodeDied | None:
        """The first node that died."""
        return self._failure

    def start(self, node: Node) -> None:
        """Spins a node from now on."""
        thread = threading.Thread(
            target=self._spin, args=(node,), name=node.get_name(), daemon=True
        )
        self._spinning.append((node, thread))
        thread.start()

    def wait(self, stop: StopSignal, duration: float | None = None) -> None:
        """Waits until somebody asks to stop, `duration` [s] is over, or a node dies.

        Raises:
            NodeDied: a node ended with an error.
        """
        end = None if duration is None else time.monotonic() + duration
        while not stop() and (end is None or time.monotonic() < end):
            if self._failure is not None:
                raise self._failure
            left = _POLL if end is None else max(0.0, min(_POLL, end - time.monotonic()))
            stop.wait(left)

    def close(self) -> None:
        """Makes safe what moves, ends the threads, then destroys the nodes, the last one first.

        A node with a method `make_safe` comes first, whatever its callbacks or another node's do;
        the method returns what went wrong.
        """
        self._ending.set()
        for node, _ in self._spinning:
            make_safe = getattr(node, "make_safe", None)
            if make_safe is not None:
                self.problems += make_safe()
        deadline = time.monotonic() + _PATIENCE
        while self._spinning:
            node, thread = self._spinning.pop()
            thread.join(max(0.0, deadline - time.monotonic()))
            if thread.is_alive():
                self.problems.append(f"{node.get_name()}: a callback does not return")
            else:
                node.destroy_node()

    def exit_code(self) -> int:
        """1 after saying what went wrong at the end, 0 if nothing did."""
        for problem in self.problems:
            print(problem, file=sys.stderr)
        return 1 if self.problems else 0

    def _spin(self, node: Node) -> None:
        executor = SingleThreadedExecutor(context=node.context)
        executor.add_node(node)
        try:
            while not self._ending.is_set():
                executor.spin_once(timeout_sec=_POLL)
        except Exception as error:
            self._failure = self._failure or NodeDied(node.get_name(), error)
        finally:
            executor.remove_node(node)
            executor.shutdown()


def steady_timer(node: Node, period: float, callback: Callable[[], object]) -> None:
    """Calls back after each period [s] of a clock that runs whatever happens to the node's.

    A timer on the node's own clock waits for hours when that is set back by hours, and for ever
    while nobody publishes /clock.
    """
    node.create_timer(period, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))


def run_node(make: Callable[[], Node], args: Sequence[str] | None = None) -> int:
    """Runs one node as a program until somebody asks it to end; see `StopSignal`.

    Returns:
        The exit code: 0, or 1 if the node could not start, died, or did not end well (servos that
        were not confirmed relaxed); the reason is printed.
    """
    with StopSignal() as stop:
        return run_until(stop, make, args)


def run_until(stop: StopSignal, make: Callable[[], Node], args: Sequence[str] | None = None) -> int:
    """Runs one node as a program until `stop`; see `run_node`."""
    rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    threads = NodeThreads()
    try:
        threads.start(make())
        threads.wait(stop)
    except Exception as error:
        print(describe(error), file=sys.stderr)
        return 1
    finally:
        threads.close()
        rclpy.try_shutdown()
    return threads.exit_code()
