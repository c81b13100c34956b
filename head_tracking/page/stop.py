"""STOP: relaxes the servos of one robot, independently of the rest of the page."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Mapping
from concurrent.futures import Future, InvalidStateError, wait
from contextlib import suppress
from functools import partial
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from std_srvs.srv import Trigger

from head_tracking.exceptions import HeadTrackingError
from head_tracking.ros.kit.joint_owners import control_from_message
from head_tracking.ros.kit.others import message_of, wait_for_answer
from head_tracking.ros.kit.threads import NodeThread
from head_tracking.ros.kit.topics import EVERY_CHANGE

ANSWER = 0.45  # s after which who asks for STOP hears what is known
_RETRY = 0.25  # s between attempts
_LATE = 1.0  # s without confirmation
_POLL = 0.01  # s
_SERVICES = "stop", "resume"


class Stop:
    """Calls `stop` of the servo bus until every servo is confirmed relaxed; `resume` ends that.

    The services are those that the buses of the namespace name in `joint_control`: a service `stop`
    may be that of a mobile base. All of them are called.

    Attributes:
        count: number of STOPs, of this page and of others; each ends what was begun before it.
        late: number of STOPs of this page that were not confirmed in time.
        stopped: whether the bus has published that it ignores commands until `resume`.
        owners: the node that owns each joint, without its namespace; empty for none.
        buses: names of the nodes that have published `joint_control`, without their namespace.
    """

    def __init__(self, beside: Node) -> None:
        self.count, self.late, self.stopped = 0, 0, False
        self.owners: Mapping[str, str] = {}
        self.buses: set[str] = set()
        self._epoch = 0
        self._own = NodeThread.beside(beside, "stop")
        node = self._own.node
        self._clients: dict[str, dict[str, Any]] = {name: {} for name in _SERVICES}
        self._where = f"in the namespace {node.get_namespace()}"
        self._attempt: Attempt | None = None
        self._lock = threading.Lock()
        node.create_subscription(DiagnosticStatus, "joint_control", self._on_control, EVERY_CHANGE)
        self._own.start()

    def permit(self, stops: int | None = None) -> int:
        """Return the number of STOPs at which something that moves the head is requested.

        Args:
            stops: that number, of a request that has waited meanwhile; None: it is made now.

        Raises:
            HeadTrackingError: the head is stopped, or was after the request was made.
        """
        count = self.count
        if self.stopped or self._trying:
            raise HeadTrackingError("The head is stopped: press Resume first.")
        self.require(count if stops is None else stops)
        return count

    def require(self, stops: int) -> None:
        """Raise HeadTrackingError if there was a STOP after that number of them."""
        if stops != self.count:
            raise HeadTrackingError("The head was stopped after this was requested.")

    @property
    def can_resume(self) -> bool:
        """Whether there is a STOP to end."""
        return self._trying or (self.stopped and bool(self._ready("resume")))

    @property
    def _trying(self) -> bool:
        attempt = self._attempt
        return attempt is not None and not attempt.ended.done()

    @property
    def outcome(self) -> Outcome | None:
        """The result of the last STOP so far; None: there is none in force."""
        attempt = self._attempt
        return None if attempt is None else attempt.outcome

    def begin(self) -> Attempt:
        """Begin to relax all servos, or join the attempt in progress; never wait."""
        with self._lock:
            self.count += 1
            attempt = self._attempt
            if attempt is None or attempt.ended.done():
                attempt = self._attempt = Attempt(self._where)
                threading.Thread(target=self._try, args=[attempt], name="stop", daemon=True).start()
        return attempt

    def resume(self) -> str:
        """Let the servos accept commands again; return the answer of the bus.

        Raises:
            HeadTrackingError: there is no bus, or it refuses or does not answer.
        """
        self.cancel()
        clients = self._ready("resume")
        if not clients:
            raise HeadTrackingError(f"There is no service resume {self._where}.")
        answers = [wait_for_answer(client, Trigger.Request(), 2.0) for client in clients]
        return "; ".join(map(message_of, answers))

    def cancel(self) -> None:
        """End the attempts of a STOP."""
        with self._lock:
            attempt, self._attempt = self._attempt, None
        if attempt is not None:
            attempt.end()

    def close(self) -> None:
        """End the thread."""
        self.cancel()
        self._own.close()

    def _ready(self, service: str) -> list[Any]:
        """Return the clients of a service of buses that are there."""
        return [one for one in list(self._clients[service].values()) if one.service_is_ready()]

    def _on_control(self, message: DiagnosticStatus) -> None:
        with suppress(ValueError):  # it is malformed
            control = control_from_message(message)
            if self.stopped and not control.stopped and control.epoch == self._epoch:
                self.cancel()  # somebody has resumed; a bus that was restarted has another epoch
            with self._lock:
                self.count += bool(control.stopped and not self.stopped)
            self.stopped, self._epoch = control.stopped, control.epoch
            owners = control.owners.items()
            self.owners = {joint: owner.rpartition("/")[2] for joint, owner in owners}
            if not control.node:
                return  # its services are not known
            self.buses.add(control.node.rpartition("/")[2])
            for service, clients in self._clients.items():
                name = control.service(service)
                if name not in clients:
                    clients[name] = self._own.node.create_client(Trigger, name)

    def _try(self, attempt: Attempt) -> None:
        pending: list[tuple[Any, Any]] = []
        late_at = time.monotonic() + _LATE
        while not attempt.ended.done() and self._own.node.context.ok():
            if time.monotonic() > late_at:
                self.late, late_at = self.late + 1, math.inf
            clients = self._ready("stop")
            if not clients:
                attempt.wait(_POLL)  # until one is discovered
                continue
            attempt.asked = [client.service_name for client in clients]
            for client in clients:
                with suppress(Exception):  # of any kind: the next attempt may succeed
                    future = client.call_async(Trigger.Request())
                    future.add_done_callback(partial(attempt.on_answer, client.service_name))
                    pending.append((client, future))
            attempt.wait(_RETRY)
        for client, future in pending:
            client.remove_pending_request(future)


class Outcome(NamedTuple):
    """The result of a STOP: whether every servo is relaxed, and a sentence for the user."""

    done: bool
    text: str


class Attempt:
    """One STOP; it ends when every servo is confirmed relaxed, or with `resume`.

    Attributes:
        ended: is done when it has ended.
        asked: names of the services that must confirm.
        outcome: the result so far.
    """

    def __init__(self, where: str) -> None:
        self.ended: Future[None] = Future()
        self.asked: list[str] = []
        self._answers: dict[str, Trigger.Response] = {}
        self.outcome = Outcome(
            False, f"NOT confirmed: no servo_bus {where} has answered; the page keeps trying"
        )

    def wait(self, timeout: float = ANSWER) -> Outcome:
        """Wait until it has ended, for some time [s] at most; return the result so far."""
        wait([self.ended], timeout)
        return self.outcome

    def end(self) -> None:
        """End it; may be called twice."""
        with suppress(InvalidStateError):
            self.ended.set_result(None)

    def on_answer(self, service: str, future: Any) -> None:
        """Note the answer of a service."""
        if future.cancelled() or future.exception() is not None or self.ended.done():
            return
        self._answers[service] = future.result()
        answers = [self._answers[name] for name in self.asked if name in self._answers]
        done = len(answers) == len(self.asked) and all(answer.success for answer in answers)
        self.outcome = Outcome(done, "; ".join(str(answer.message) for answer in answers))
        if done:
            self.end()
