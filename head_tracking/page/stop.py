"""STOP: relaxes the servos of one robot, whatever else on the page or in the graph has failed."""

from __future__ import annotations

import threading
import time
from typing import Any

from rclpy.node import Node
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from head_tracking.ros.kit.other_services import Outcome, wait_for_answer
from head_tracking.ros.kit.own_thread import OwnThread
from head_tracking.ros.kit.qos import EVERY_CHANGE

_ANSWER = 0.45  # s within which a person is told
_HANGS = 0.12  # s without an answer: the other service is asked as well
_AGAIN = 0.25  # s between attempts
_POLL = 0.01  # s


class Stop:
    """Calls `stop` of the servo bus until every servo is confirmed relaxed; `resume` ends that.

    A bus that offers no `stop`, or does not answer it, is asked to `relax`. The services are
    relative names: those of another namespace are another robot's. Nothing of it is shared with
    the rest of the page.

    Args:
        beside: the node that it belongs to.

    Attributes:
        count: grows with every stop, this page's or another's; what was begun before is over.
    """

    def __init__(self, beside: Node) -> None:
        self.count = 0
        self._own = OwnThread(beside, f"{beside.get_name()}_stop")
        node = self._own.node
        self._stop, self._relax, self._resume = (
            node.create_client(Trigger, name) for name in ("stop", "relax", "resume")
        )
        self._where = f"in the namespace {node.get_namespace()}"
        self._stopped: bool | None = None
        self._attempt: _Attempt | None = None
        self._lock = threading.Lock()
        node.create_subscription(Bool, "stopped", self._on_stopped, EVERY_CHANGE)
        self._own.start()

    @property
    def stopped(self) -> bool:
        """Whether the bus says that nothing moves before `resume`."""
        return self._stopped is True

    @property
    def refusal(self) -> str:
        """Why the page asks for nothing but Resume; empty: no STOP is in force or under way."""
        return "the head is stopped: press Resume first" if self.stopped or self._trying else ""

    @property
    def can_resume(self) -> bool:
        """Whether there is something to resume."""
        return self._trying or (self.stopped and bool(self._resume.service_is_ready()))

    @property
    def _trying(self) -> bool:
        attempt = self._attempt
        return attempt is not None and not attempt.over

    @property
    def outcome(self) -> Outcome | None:
        """How the last stop went, as far as is known now; None: there is none that counts."""
        attempt = self._attempt
        return None if attempt is None else attempt.outcome

    def stop(self) -> Outcome:
        """Relaxes all servos; answers within half a second, and goes on trying afterwards."""
        attempt = _Attempt(self._where)
        with self._lock:
            self.count += 1
            previous, self._attempt = self._attempt, attempt
        if previous is not None:
            previous.cancelled.set()
        threading.Thread(target=self._try, args=(attempt,), name="stop", daemon=True).start()
        attempt.confirmed.wait(_ANSWER)
        return attempt.outcome

    def resume(self) -> Outcome:
        """Lets the servos take commands again."""
        self.cancel()
        if not self._resume.service_is_ready():
            return Outcome(False, f"nobody offers resume {self._where}")
        answer = wait_for_answer(self._resume, Trigger.Request(), 2.0)
        if answer is None:
            return Outcome(False, "resume did not answer within 2 s")
        return Outcome(bool(answer.success), str(answer.message))

    def cancel(self) -> None:
        """Tries no more: somebody wants the head to move again."""
        with self._lock:
            attempt, self._attempt = self._attempt, None
        if attempt is not None:
            attempt.cancelled.set()

    def close(self) -> None:
        """Ends it."""
        self.cancel()
        self._own.close()

    def _on_stopped(self, message: Bool) -> None:
        if self._stopped and not message.data:
            self.cancel()  # somebody has resumed, here or elsewhere
        with self._lock:
            self.count += bool(message.data and not self._stopped)
        self._stopped = bool(message.data)

    def _try(self, attempt: _Attempt) -> None:
        pending: list[tuple[Any, Any]] = []

        def ask(client: Any) -> bool:
            """Whether it was there to be asked."""
            if not client.service_is_ready():
                return False
            future = client.call_async(Trigger.Request())
            future.add_done_callback(attempt.take)
            pending.append((client, future))
            return True

        relax_asked = False
        while not attempt.over:
            attempt.answered.clear()
            try:
                stop_asked = ask(self._stop)
                if not (stop_asked and attempt.answered.wait(_HANGS)):
                    relax_asked = ask(self._relax)
            except Exception:
                # whatever it is, the next attempt may do better
                if not self._own.node.context.ok():
                    return
                stop_asked = relax_asked = False
            if stop_asked or relax_asked:
                attempt.wait(_AGAIN)
            else:
                time.sleep(_POLL)  # neither is known yet
        for client, future in pending:
            client.remove_pending_request(future)


class _Attempt:
    """One press of STOP, and its result."""

    def __init__(self, where: str) -> None:
        self.confirmed, self.cancelled = threading.Event(), threading.Event()
        self.answered = threading.Event()
        self.outcome = Outcome(
            False,
            f"NOT confirmed: no servo_bus {where} has answered; it is tried again and again",
        )

    @property
    def over(self) -> bool:
        """Whether nothing more is to be tried."""
        return self.confirmed.is_set() or self.cancelled.is_set()

    def wait(self, seconds: float) -> None:
        """Waits so long [s], or until it is over."""
        deadline = time.monotonic() + seconds
        while not self.over and time.monotonic() < deadline:
            self.confirmed.wait(_POLL)

    def take(self, future: Any) -> None:
        """Takes an answer."""
        if future.cancelled() or future.exception() is not None or self.confirmed.is_set():
            return
        answer = future.result()
        self.outcome = Outcome(bool(answer.success), str(answer.message))
        if answer.success:
            self.confirmed.set()
        self.answered.set()
