"""The supervisor of a run: starts its processes, watches them, and ends them.

    supervisor ── control   servo bus, head and their ROS interface; tells which servos have torque
               ├─ vision    cameras and detectors; started anew if it ends
               └─ page      the page in a browser; started anew if it ends

If control dies, the supervisor relaxes the servos. If the supervisor dies, the others notice by the
end of their line, and end; control relaxes the servos. It imports no ROS, and stays small.
"""

from __future__ import annotations

import json
import math
import os
import select
import selectors
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from typing import Any, Final

from head_tracking.exceptions import RefusedError
from head_tracking.ros.kit.head_lock import HeadLock
from head_tracking.ros.kit.stop_signal import ENDING
from head_tracking.run.node_sets import CONTROL, PAGE, VISION
from head_tracking.run.options import Run
from head_tracking.run.stop_key import StopKey

_NICENESS: Final = {CONTROL: 0, VISION: 5, PAGE: 10}
_END_PATIENCE: Final = {CONTROL: 8.0, VISION: 5.0, PAGE: 5.0}  # s; afterwards a process is killed
_PAUSES: Final = (1.0, 2.0, 4.0, 8.0, 16.0, 30.0)  # s before a process is started again
_LONGEST: Final = 1 << 16  # bytes of a message
_LOOK_PERIOD: Final = 0.1  # s; what is due, such as a real head that wants to start
_LASTING: Final = 60.0  # s; a process that ran longer begins with the first pause


class Process:
    """A process of the run, and this end of its line.

    Args:
        name: control, vision or page.
        arguments: of its program.
        descriptors: files that it inherits.

    Attributes:
        started: when, by the monotonic clock [s].
    """

    def __init__(self, name: str, arguments: list[str], descriptors: Sequence[int] = ()) -> None:
        self.name = name
        self.started = time.monotonic()
        self._line, theirs = socket.socketpair(type=socket.SOCK_SEQPACKET)
        with theirs:
            self._process = subprocess.Popen(
                [
                    *(sys.executable, "-m", "head_tracking.run.child"),
                    *(name, str(theirs.fileno()), *arguments),
                ],
                pass_fds=[theirs.fileno(), *descriptors],
            )
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, self._process.pid, _NICENESS[name])

    def fileno(self) -> int:
        """Return the descriptor of the line, for a selector."""
        return self._line.fileno()

    def send(self, message: Mapping[str, Any]) -> None:
        """Send a message; nothing if the process has gone."""
        with suppress(OSError):
            self._line.send(json.dumps(message).encode())

    def receive(self) -> dict[str, Any] | None:
        """Return the message that has come; None if the process has ended."""
        data = b""
        with suppress(OSError):
            data = self._line.recv(_LONGEST)
        return json.loads(data) if data else None

    def ask_to_end(self) -> None:
        """End the line to the process; it may still send."""
        with suppress(OSError):
            self._line.shutdown(socket.SHUT_WR)

    def kill(self) -> None:
        """Kill the process."""
        self._process.kill()

    def wait(self) -> int:
        """Return the exit code; kill the process if it does not end soon."""
        try:
            code = self._process.wait(_END_PATIENCE[self.name])
        except subprocess.TimeoutExpired:
            self._process.kill()
            code = self._process.wait()
        self._line.close()
        return code


class NodeProcess:
    """A process that is started anew when it ends: its nodes, and when to start it.

    Attributes:
        nodes: what it runs, as it was asked for, by name.
        running: the process; None: it has ended, or was not needed yet.
        start_at: when to start it again, by the monotonic clock [s]; None: not.
    """

    def __init__(self, name: str, arguments: list[str], descriptors: Sequence[int]) -> None:
        self.name, self._arguments, self._descriptors = name, arguments, descriptors
        self.nodes: dict[str, dict[str, Any]] = {}
        self.running: Process | None = None
        self.start_at: float | None = None
        self._work: set[str] = set()
        self._ends = 0

    def add(self, node: dict[str, Any]) -> None:
        """Let it run one more node."""
        self.nodes[node["name"]] = node
        if self.running is not None:
            self.running.send(node)
        elif self.start_at is None:
            self.start_at = time.monotonic()

    def start(self) -> Process:
        """Start the process with all of its nodes."""
        self.running = Process(self.name, self._arguments, self._descriptors)
        self.start_at = None
        for node in self.nodes.values():
            self.running.send(node)
        return self.running

    def received(self, message: Mapping[str, Any]) -> None:
        """Record what the process reports of a node: that it works, or cannot, or is disabled."""
        name = message["node"]
        if not message["problem"]:
            self._work.add(name)
            self.nodes[name]["enabled"] = message["enabled"]
        elif not self._is_kept(name):
            self.nodes.pop(name, None)

    def _is_kept(self, name: str) -> bool:
        """Whether a node is started again: it has worked once, or is the page, which is tried."""
        return name in self._work or self.name == PAGE

    def ended(self) -> list[dict[str, Any]]:
        """Record that the process has ended; return reports of the nodes that never worked."""
        assert self.running is not None
        self._ends = 0 if time.monotonic() - self.running.started > _LASTING else self._ends
        code = self.running.wait()
        self.running = None
        failed = [name for name in self.nodes if not self._is_kept(name)]
        self.nodes = {name: node for name, node in self.nodes.items() if self._is_kept(name)}
        if self.nodes:
            pause = _PAUSES[min(self._ends, len(_PAUSES) - 1)]
            self._ends += 1
            self.start_at = time.monotonic() + pause
            _say(f"the {self.name} process {_ended(code)}; it is started again in {pause:g} s")
        problem = f"the {self.name} process {_ended(code)}"
        return [{"node": name, "problem": problem} for name in failed]


class Supervisor:
    """Runs the processes of a run until control has ended.

    Args:
        plan: the run.
    """

    def __init__(self, plan: Run) -> None:
        self._plan = plan
        self._ending = self._gives_way = self._is_ready = False
        self._kill_at = math.inf
        self._servos: list[tuple[str, int, dict[str, str]]] = []
        self._keys = StopKey()
        self._lock = HeadLock(plan.arguments, simulated=plan.simulated)
        held = self._lock.descriptors
        self._others = {
            name: NodeProcess(name, plan.ros_arguments, held) for name in (VISION, PAGE)
        }
        self._selector = selectors.DefaultSelector()

    def run(self) -> int:
        """Return the exit code of control; 1 if it was killed.

        Raises:
            RefusedError: another head runs on this machine.
            EndRequestedError: there was a signal before anything had started.
        """
        woken = _wake_on(ENDING)
        self._selector.register(woken, selectors.EVENT_READ)
        self._acquire(lambda seconds: bool(select.select([woken], [], [], seconds)[0]))
        if self._keys.has_terminal:
            _hear((signal.SIGTSTP, signal.SIGCONT))
        control = Process(CONTROL, list(self._plan.arguments), self._lock.descriptors)
        self._selector.register(control, selectors.EVENT_READ, control)
        for node in self._plan.nodes:
            if node.process == PAGE:  # it takes the longest to start, and waits for nobody
                self._others[PAGE].add({"enabled": True, **asdict(node)})
        import head_tracking.dynamixel  # noqa: F401  now: after a crash there is no time for it

        try:
            while control in self._selector.get_map():
                for key, _ in self._selector.select(_LOOK_PERIOD):
                    if key.fileobj is woken:
                        self._on_signals(woken.recv(64), control)
                    elif key.fileobj is self._keys:
                        control.send({"key": self._keys.read()})
                    else:
                        self._read(key.data, control)
                self._look(control)
            return self._finish(control)
        finally:
            self._keys.release()

    def _look(self, control: Process) -> None:
        """Do what is due."""
        self._start_due()
        self._update_keys(control)
        if self._ending and time.monotonic() > self._kill_at:
            control.kill()
        if self._lock.is_wanted and not self._ending:
            _say(f"{self._lock.reason}; this simulated head ends")
            self._gives_way = True
            self._end(control)

    def _finish(self, control: Process) -> int:
        """End the other processes, and make the servos safe if control has not; return the code."""
        for other in self._others.values():
            if other.running is not None:
                other.running.ask_to_end()
        code = control.wait()
        if self._servos or code < 0:
            self._make_safe(code)
        for other in self._others.values():
            if other.running is not None:
                other.running.wait()
        return 1 if self._gives_way or code < 0 else code

    def _acquire(self, wait: Callable[[float], bool]) -> None:
        """Lock the head, unless other heads are allowed and one has it."""
        if not self._plan.allow_others:
            self._lock.acquire(wait)
        elif not self._plan.simulated:
            with suppress(RefusedError):
                self._lock.acquire(wait, shared=True, patience=0.0)

    def _end(self, control: Process) -> None:
        """Ask control to end, and kill it if it does not."""
        if not self._ending:
            control.ask_to_end()
            self._kill_at = time.monotonic() + _END_PATIENCE[CONTROL]
        self._ending = True

    def _on_signals(self, numbers: bytes, control: Process) -> None:
        if signal.SIGTSTP in numbers:
            self._keys.suspend()
        if not set(ENDING).isdisjoint(numbers):
            self._end(control)

    def _update_keys(self, control: Process) -> None:
        """Read keys while control can stop and the terminal is ours."""
        if not (self._keys.has_terminal and self._is_ready):
            return
        self._keys.acquire()
        if self._keys.works == (self._keys in self._selector.get_map()):
            return
        if self._keys.works:
            self._selector.register(self._keys, selectors.EVENT_READ)
        else:
            self._selector.unregister(self._keys)
        control.send({"keys": self._keys.works})

    def _start_due(self) -> None:
        for other in self._others.values():
            is_due = other.start_at is not None and other.start_at <= time.monotonic()
            if is_due and not self._ending:
                process = other.start()
                self._selector.register(process, selectors.EVENT_READ, process)

    def _read(self, process: Process, control: Process) -> None:
        message = process.receive()
        if message is None:
            self._selector.unregister(process)
            if process is not control:
                for report in self._others[process.name].ended():
                    control.send(report)
        elif process is not control:
            self._others[process.name].received(message)
            control.send(message)
        elif "servos" in message:
            self._servos = message["servos"]
        elif "ready" in message:
            self._is_ready = True
        else:
            self._others[message["process"]].add(message)

    def _make_safe(self, code: int) -> None:
        """Relax the servos, or hold them: control has ended without having done so."""
        from head_tracking.dynamixel import DynamixelError, relax_servos

        hold = self._plan.hold_on_crash
        results = [f"the control process {_ended(code)}"]
        for port, baud_rate, models in self._servos:
            try:
                problems = relax_servos(
                    port, {int(each): model for each, model in models.items()}, baud_rate, hold=hold
                )
            except DynamixelError as error:
                problems = dict.fromkeys(map(int, models), str(error))
            for servo, problem in problems.items():
                done = (
                    f"may have torque on: {problem}" if problem else "holds" if hold else "relaxed"
                )
                results.append(f"servo {servo} on {port}: {done}")
        for result in results:  # afterwards: nobody may read what is written
            _say(result)


def _wake_on(signals: Sequence[signal.Signals]) -> socket.socket:
    """Return a socket that can be read after one of these signals: their numbers."""
    woken, waking = socket.socketpair()
    waking.setblocking(False)
    signal.set_wakeup_fd(waking.detach())
    _hear(signals)
    return woken


def _hear(signals: Sequence[signal.Signals]) -> None:
    """Let signals only wake; those that are ignored stay so, such as SIGHUP after nohup."""
    for number in signals:
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, lambda *_: None)


def _ended(code: int) -> str:
    if code >= 0:
        return f"has ended with exit code {code}"
    return f"was killed by {signal.Signals(-code).name}"


def _say(text: str) -> None:
    """Write a line above the status line of control."""
    print(f"\r\x1b[K{text}" if sys.stderr.isatty() else text, file=sys.stderr, flush=True)
