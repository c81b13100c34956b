"""The servo bus in a process of its own, which no busy thread of this one can delay."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

from rclpy.node import Node
from rclpy.parameter import Parameter

from head_tracking.exceptions import HeadTrackingError
from head_tracking.ros.bus_status import BusStatus
from head_tracking.ros.spinning import steady_timer
from head_tracking.ros.stop_signal import ENDING, StopSignal

_REPLY_TIMEOUT = 0.5  # s
_START_TIMEOUT = 20.0  # s, on a busy machine with servos that have to be waited for
_END_TIMEOUT = 8.0  # s
_WATCH_PERIOD = 0.1  # s


class BusProcessError(HeadTrackingError):
    """The process of the servo bus has ended by itself, or does not answer."""


class Report(NamedTuple):
    """What the process tells of its bus.

    Attributes:
        status: all of its buses.
        true_positions: where its simulated joints really are [rad].
    """

    status: BusStatus
    true_positions: Mapping[str, float]


class Questions:
    """Questions to another process and their answers, told apart by a number.

    Args:
        connection: to the other process, which answers (number, question) by (number, answer).
    """

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._number = 0

    def ask(self, what: str | None, timeout: float) -> Any:
        """Return the answer to a question; None if it does not come in time, s.

        Raises:
            EOFError: The other process has gone.
            OSError: The same.
        """
        self._number += 1
        self._connection.send((self._number, what))
        deadline = time.monotonic() + timeout
        while self._connection.poll(max(0.0, deadline - time.monotonic())):
            number, answer = self._connection.recv()
            if number == self._number:  # else it answers an earlier question, too late
                return answer
        return None


class BusProcessNode(Node):
    """Runs the node servo_bus in a child process, and stands for it in this one.

    The child brakes and relaxes the servos and ends when it is asked to, and when this process has
    gone, however it went.

    Args:
        simulated: whether the child simulates the servos.
        arguments: ROS's arguments for the child.
        stop: asks to stop while the child starts.
        parameter_overrides: for the node servo_bus.

    Raises:
        BusProcessError: the bus could not start; the child has said why.
        StoppedError: somebody asked to stop meanwhile; the child has ended.
    """

    def __init__(
        self,
        simulated: bool,
        arguments: Sequence[str],
        stop: StopSignal,
        parameter_overrides: Sequence[Parameter] = (),
        **options: Any,
    ) -> None:
        super().__init__("bus_process", **options)
        wanted = {
            "simulated": simulated,
            "parameters": {each.name: each.value for each in parameter_overrides},
        }
        self._child, theirs = Pipe()
        program = [sys.executable, "-m", "head_tracking.bus_process"]
        # Ctrl-C reaches the child, too: it is kept for when the child can listen
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
        try:
            self._process = subprocess.Popen(
                [*program, str(theirs.fileno()), json.dumps(wanted), *arguments],
                pass_fds=[theirs.fileno()],
            )
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
            theirs.close()
        self._questions = Questions(self._child)
        self._asking = threading.Lock()
        self._problems: list[str] | None = None
        self._report = self._started(stop)
        steady_timer(self, _WATCH_PERIOD, self._watch)

    @property
    def pid(self) -> int:
        """The child's process id."""
        return self._process.pid

    def status(self) -> BusStatus:
        """The buses now, or as they were last known."""
        return self._newest().status

    def true_position(self, joint: str) -> float:
        """Where a simulated joint really is [rad], or was when it was last known."""
        return self._newest().true_positions[joint]

    def stop(self) -> dict[str, str]:
        """Relaxes all servos at once; see `ServoBusNode.stop`."""
        problems = self._ask("stop")
        if problems is None:
            joints = self._report.status.states or ("the servos",)
            return dict.fromkeys(joints, "the servo bus's process does not answer")
        return dict(problems)

    def resume(self) -> tuple[str, ...]:
        """Ends a stop; see `ServoBusNode.resume`."""
        return tuple(self._ask("resume") or ())

    def make_safe(self) -> list[str]:
        """Ends the process, which relaxes the servos; what went wrong."""
        if self._problems is None:
            self._problems = []
            has_ended = self._process.poll() is not None  # and that has been told
            self._child.close()
            try:
                code = self._process.wait(_END_TIMEOUT)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
                self._problems.append(
                    f"the servo bus's process did not end within {_END_TIMEOUT:g} s and was "
                    "killed; the servos may have torque on"
                )
            else:
                if code and not has_ended:
                    self._problems.append(f"the servo bus's process ended with exit code {code}")
        return self._problems

    def destroy_node(self) -> None:
        """Ends the process, which relaxes the servos."""
        self.make_safe()
        super().destroy_node()

    def _started(self, stop: StopSignal) -> Report:
        """The first report, when the nodes of this process can hear the child."""
        deadline = time.monotonic() + _START_TIMEOUT
        topic = self.resolve_topic_name("servo_states")
        report: Report | None = None
        try:
            while report is None or not self.count_publishers(topic):
                report = self._ask() or report
                ended = self._process.poll() is not None
                stop.check()  # Ctrl-C reaches the child, too
                if ended:
                    raise BusProcessError(
                        "the servo bus's process could not start (exit code "
                        f"{self._process.returncode}); what it said stands above"
                    )
                if time.monotonic() > deadline:
                    raise BusProcessError(
                        f"the servo bus's process was not heard within {_START_TIMEOUT:g} s; "
                        "is ROS_AUTOMATIC_DISCOVERY_RANGE OFF?"
                    )
                time.sleep(0.02)
        except BaseException:
            self.make_safe()
            raise
        return report

    def _newest(self) -> Report:
        report = self._ask()
        if report is not None:
            self._report = report
        return self._report

    def _ask(self, what: str | None = None) -> Any:
        """What the child says; None if it says nothing (yet, or any more)."""
        with self._asking, suppress(EOFError, OSError):
            return self._questions.ask(what, _REPLY_TIMEOUT)
        return None

    def _watch(self) -> None:
        code = self._process.poll()
        if code is not None and self._problems is None:
            raise BusProcessError(
                f"the servo bus's process has ended (exit code {code}); unless it said that the "
                "servos are relaxed, they may have torque on"
            )
