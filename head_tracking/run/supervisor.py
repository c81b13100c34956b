"""The supervisor of a run: starts its processes, watches them, and ends them.

    supervisor ── control   servo bus, head and their ROS interface; reports its servos
               ├─ vision    cameras and detectors; restarted if it ends
               └─ page      the page in the browser; restarted if it ends

If control dies, or hangs and does not carry out STOP, the supervisor relaxes the servos. If the
supervisor dies, its channels close, and the other processes end; control relaxes the servos first.
The supervisor does not import ROS.
"""

from __future__ import annotations

import math
import os
import selectors
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from head_tracking.exceptions import HeadTrackingError, RefusedError
from head_tracking.programs import NO_ROS, has_ros
from head_tracking.ros.kit.head_lock import HeadLock
from head_tracking.ros.kit.stop_signal import ENDING, EndRequestedError, StopSignal
from head_tracking.run.child import END, Channel
from head_tracking.run.node_sets import CONTROL, PAGE, VISION
from head_tracking.run.options import Run, parse_arguments
from head_tracking.run.status_line import CLEAR_LINE, StatusLine, can_clear_line
from head_tracking.run.stop_key import STOP, StopKey

_RANGE: Final = "ROS_AUTOMATIC_DISCOVERY_RANGE"
_NICENESS: Final = {CONTROL: -10, VISION: -5, PAGE: 0}  # where the system allows that
_END_TIMEOUT: Final = {CONTROL: 8.0, VISION: 5.0, PAGE: 5.0}  # s; then the process is killed
_PAUSES: Final = (1.0, 2.0, 4.0, 8.0, 16.0, 30.0)  # s before each restart in a row
_STOP_TIMEOUT: Final = 5.0  # s in which control must have carried out STOP; then it is killed
_POLL_PERIOD: Final = 0.1  # s
_STABLE_TIME: Final = 60.0  # s; after a longer life the next restart has the first pause


def main() -> int:
    """Run the head until a signal; return the exit code."""
    plan = parse_arguments(sys.argv[1:])
    # ROS's setup.bash sets SUBNET, so SUBNET is no choice of the user.
    is_local = plan.options.sim and not plan.options.network
    if is_local and os.environ.get(_RANGE, "") in ("", "SUBNET", "LOCALHOST"):
        os.environ[_RANGE] = "LOCALHOST"
        for name in ("ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER"):  # they reach other machines, too
            os.environ.pop(name, None)
    StatusLine().prepare_logging()
    try:
        if not has_ros():
            raise HeadTrackingError(NO_ROS)
        return Supervisor(plan).run()
    except EndRequestedError:
        return 0
    except HeadTrackingError as error:
        print(f"head_tracking: {error}", file=sys.stderr)
        return 1


class ChildProcess:
    """A process of the run, the nodes that it shall run, and the supervisor's end of its channel.

    Args:
        descriptors: file descriptors that it inherits.

    Attributes:
        channel: carries messages; None: the process does not run.
        nodes: the requested nodes that have not failed, by name.
        start_at: when to start it, by the monotonic clock [s]; None: not planned.
    """

    def __init__(self, name: str, arguments: Sequence[str], descriptors: Sequence[int]) -> None:
        self.name, self._arguments, self._descriptors = name, arguments, descriptors
        self.channel: Channel | None = None
        self.nodes: dict[str, dict[str, Any]] = {}
        self.start_at: float | None = None
        self._ends_in_a_row = 0
        self._working: set[str] = set()

    def start(self) -> Channel:
        """Start the process with its nodes, and return the channel.

        Raises:
            OSError: the machine has no memory, process or file descriptor left for it.
        """
        self.start_at, self._started = None, time.monotonic()
        ours, theirs = socket.socketpair(type=socket.SOCK_SEQPACKET)
        with theirs:
            program = (sys.executable, "-m", "head_tracking.run.child")
            # modules as here: -m would prefer a queue.py of the working folder
            paths = {"PYTHONSAFEPATH": "1", "PYTHONPATH": os.pathsep.join(sys.path)}
            # Ctrl-C waits until the process handles it; the process unblocks it then
            mask = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
            try:
                self._process = subprocess.Popen(
                    [*program, self.name, str(theirs.fileno()), *self._arguments],
                    pass_fds=[theirs.fileno(), *self._descriptors],
                    env=os.environ | paths,
                )
            finally:
                signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, self._process.pid, _NICENESS[self.name])
        with suppress(OSError):
            if self.name != CONTROL:  # without memory, the system kills this process first
                Path(f"/proc/{self._process.pid}/oom_score_adj").write_text("1000")
            elif len(os.sched_getaffinity(0)) > 1:  # a core is left if control does not pause
                os.sched_setscheduler(self._process.pid, os.SCHED_RR, os.sched_param(1))
        self.channel = Channel(ours)
        for node in self.nodes.values():
            self.channel.send(**node)
        return self.channel

    def send(self, **message: Any) -> None:
        """Send a message, if the process runs."""
        if self.channel is not None:
            self.channel.send(**message)

    def add(self, node: dict[str, Any]) -> None:
        """Add a node, and plan the start of the process if it does not run."""
        self.send(**self.nodes.setdefault(node["name"], node))
        if self.channel is None and self.start_at is None:
            self.start_at = time.monotonic()

    def on_report(
        self, node: str, problem: str, enabled: bool = True, parameters: Any = ()
    ) -> None:
        """Record the state in which a node is to be restarted; leave one out that cannot start."""
        if problem:
            self.nodes.pop(node, None)
            _print(problem)
        else:
            self._working.add(node)
            self.nodes[node]["enabled"] = enabled
            self.nodes[node]["parameters"] |= parameters

    def kill(self) -> None:
        """Kill the process."""
        self._process.kill()

    def end(self) -> int:
        """Return the exit code; kill the process if it does not end in time."""
        try:
            code = self._process.wait(_END_TIMEOUT[self.name])
        except subprocess.TimeoutExpired:
            self.kill()
            code = self._process.wait()
        if self.channel is not None:
            self.channel.close()
        self.channel = None
        return code

    def drop_failed(self, code: int) -> list[str]:
        """Return the nodes that an ended process has never started, and request them no more.

        A first start that was killed is tried once more; one that has failed would fail again.
        """
        is_retried = code < 0 and not self._ends_in_a_row
        failed = [] if is_retried else sorted(self.nodes.keys() - self._working)
        for node in failed:
            del self.nodes[node]
        return failed

    def plan_restart(self, event: str) -> None:
        """Plan the restart of the process, if it has nodes, after an event that is printed."""
        problem = f"the {self.name} process {event}"
        if not self.nodes:
            return _print(problem)
        if time.monotonic() - self._started > _STABLE_TIME:
            self._ends_in_a_row = 0
        pause = _PAUSES[min(self._ends_in_a_row, len(_PAUSES) - 1)]
        self._ends_in_a_row += 1
        self.start_at = time.monotonic() + pause
        _print(f"{problem}; it is restarted in {pause:g} s")


class Supervisor:
    """Runs the processes of a run until control has ended."""

    def __init__(self, plan: Run) -> None:
        self._plan = plan
        self._ending = self._yields = self._is_ready = self._reads_keys = False
        self._kill_at = self._stop_by = math.inf
        self._servos: list[tuple[str, int, dict[str, str]]] = []
        self._keys = StopKey()
        self._lock = HeadLock(plan.arguments, simulated=plan.options.sim)
        self._control = ChildProcess(CONTROL, plan.arguments, self._lock.descriptors)
        self._others = {
            name: ChildProcess(name, plan.ros_arguments, self._lock.descriptors)
            for name in (VISION, PAGE)
        }
        self._selector = selectors.DefaultSelector()

    def run(self) -> int:
        """Return the exit code of control; 1 if it was killed.

        Raises:
            RefusedError: another head runs on this machine.
            EndRequestedError: a signal came before the first process was started.
        """
        with StopSignal() as stop:
            self._acquire(stop.wait)
            try:
                return self._run(stop)
            finally:
                self._keys.release()

    def _run(self, stop: StopSignal) -> int:
        self._selector.register(self._control.start(), selectors.EVENT_READ, self._control)
        for node in self._plan.nodes:
            if node.process == PAGE:  # first, because it takes the longest to start
                self._others[PAGE].add(asdict(node))
        if not self._plan.options.sim:  # now, because after a crash it would take time
            import head_tracking.dynamixel  # noqa: F401

        while self._control.channel in self._selector.get_map():
            ready = self._selector.select(_POLL_PERIOD)
            if stop():  # Ctrl-C ends the other processes, too, which is expected then
                self._end()
            for key, _ in ready:
                if key.fileobj is self._keys:
                    self._press(self._keys.read())
                else:
                    self._read(key.data)
            self._update()
        return self._finish()

    def _update(self) -> None:
        for other in self._others.values():
            is_due = other.start_at is not None and other.start_at <= time.monotonic()
            if is_due and not self._ending:
                try:
                    self._selector.register(other.start(), selectors.EVENT_READ, other)
                except OSError as error:
                    other.plan_restart(f"cannot start: {error}")
        self._update_keys()
        if time.monotonic() > min(self._kill_at, self._stop_by):
            self._control.kill()
        if self._lock.is_wanted and not self._ending:
            _print(f"{self._lock.reason}; this simulated head ends")
            self._yields = True
            self._end()

    def _finish(self) -> int:
        """End the other processes; make the servos safe if control has not; return the code."""
        for other in self._others.values():
            other.send(**END)
        code = self._control.end()
        if self._servos or code < 0:
            self._make_safe(code)
        for other in self._others.values():
            if other.channel is not None:
                other.end()
        return 1 if self._yields or code < 0 else code

    def _acquire(self, wait: Callable[[float], bool]) -> None:
        """Lock the head; with --allow-others only if it is free."""
        if not self._plan.options.allow_others:
            self._lock.acquire(wait)
        elif not self._plan.options.sim:
            with suppress(RefusedError):
                self._lock.acquire(wait, shared=True, patience=0.0)

    def _end(self) -> None:
        """Ask control to end, and plan to kill it if it does not."""
        if not self._ending:
            self._control.send(**END)
            self._kill_at = time.monotonic() + _END_TIMEOUT[CONTROL]
        self._ending = True

    def _press(self, key: str) -> None:
        """Pass a key to control; plan to kill it if it hangs and does not carry out STOP."""
        if not key or not self._is_ready or self._stop_by < math.inf:
            return  # more messages to a process that hangs would block this one
        if key == STOP:
            self._stop_by = time.monotonic() + _STOP_TIMEOUT
        self._control.send(key=key)

    def _update_keys(self) -> None:
        """Read keys while control is ready and this program is in the foreground."""
        if self._is_ready:
            self._keys.acquire()
        if self._keys.works == self._reads_keys:
            return
        self._reads_keys = self._keys.works
        if self._reads_keys:
            self._selector.register(self._keys, selectors.EVENT_READ)
        else:
            self._selector.unregister(self._keys)
        self._control.send(keys=self._reads_keys)

    def _read(self, process: ChildProcess) -> None:
        assert process.channel is not None
        message = process.channel.receive()
        if message is None:
            self._selector.unregister(process.channel)
            if process is not self._control and not self._ending:
                code = process.end()
                event = _describe_end(code)
                for node in process.drop_failed(code):
                    problem = f"the {process.name} process {event}"
                    self._control.send(node=node, problem=problem)
                process.plan_restart(event)
        elif "stop" in message:
            self._press(STOP)
        elif process is not self._control:
            process.on_report(**message)
            self._control.send(**message)
        elif "servos" in message:
            self._servos = message["servos"]
        elif "ready" in message:
            self._is_ready = True
        elif "stopped" in message:
            self._stop_by = math.inf
        else:
            self._others[message["process"]].add(message)

    def _make_safe(self, code: int) -> None:
        """Relax or hold the servos, because control has ended without doing it."""
        from head_tracking.dynamixel import DynamixelError, relax_servos

        hold = self._plan.options.on_crash == "hold" and self._stop_by == math.inf
        success = "holds" if hold else "relaxed"
        results = [f"the control process {_describe_end(code)}"]
        for port, baud_rate, models in self._servos:
            try:
                problems = relax_servos(
                    port, {int(each): model for each, model in models.items()}, baud_rate, hold=hold
                )
            except DynamixelError as error:
                problems = dict.fromkeys(map(int, models), str(error))
            for servo, problem in problems.items():
                result = f"may have torque on: {problem}" if problem else success
                results.append(f"servo {servo} on {port}: {result}")
        for result in results:  # printed last, because printing may block
            _print(result)


def _describe_end(code: int) -> str:
    if code >= 0:
        return f"has ended with exit code {code}"
    return f"was killed by {signal.Signals(-code).name}"


def _print(text: str) -> None:
    """Print a line above the status line of control."""
    clear = CLEAR_LINE if can_clear_line(sys.stderr) else ""
    print(f"{clear}{text}", file=sys.stderr, flush=True)
