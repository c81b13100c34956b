"""viewer: the page that shows and steers the robot in a browser."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any

from head_tracking.exceptions import HeadTrackingError
from head_tracking.gaze.head_parameters import HeadParameters
from head_tracking.page import MISSING, installed
from head_tracking.ros.kit.node_parameters import NodeParameters
from head_tracking.ros.kit.spinning import ClosingNode


class ViewerNode(ClosingNode):
    """Serves the page, and `joint_states` where nobody else does; no node depends on it.

    Attributes:
        settled: parameters with which another one takes its place: browsers find it, and are known.

    Raises:
        HeadTrackingError: NiceGUI is missing, or the address can't be listened on.
    """

    def __init__(self, **options: Any) -> None:
        if not installed():
            raise HeadTrackingError(MISSING)
        from head_tracking.page.robot import Robot
        from head_tracking.page.server import Page, PageParameters
        from head_tracking.recording.recorder import RecorderParameters

        super().__init__("viewer", **options)
        head = NodeParameters(self, HeadParameters).value
        page = NodeParameters(self, PageParameters).value
        recorder = NodeParameters(self, RecorderParameters).value
        self.robot = Robot(self, head, recorder)
        self.closing.callback(self.robot.close)
        try:
            self.page = Page(self.robot, page, self._report)
        except BaseException:  # else the nodes of the robot would stay, with their threads
            self.closing.close()
            raise
        self.closing.callback(self.page.close)
        self.settled = {"port": self.page.port, "token": self.page.token}
        self._log_address(page.host)

    @property
    def late_stops(self) -> int:
        """How many STOPs of the page were not confirmed in time."""
        return self.robot.stop.late

    def create_subscription(
        self, kind: Any, topic: str, callback: Callable[..., object], *others: Any, **options: Any
    ) -> Any:
        """Create a subscription; an error in its callback costs the message only."""
        callback = self._surviving(callback)
        return super().create_subscription(kind, topic, callback, *others, **options)

    def create_timer(
        self, period: float, callback: Callable[..., object], *others: Any, **options: Any
    ) -> Any:
        """Create a timer; an error in its callback costs that call only."""
        return super().create_timer(period, self._surviving(callback), *others, **options)

    def _surviving(self, callback: Callable[..., object]) -> Callable[..., object]:
        """Return a callback that logs its errors: no message may end the page and its STOP."""

        @wraps(callback)
        def surviving(*arguments: Any) -> None:
            try:
                callback(*arguments)
            except Exception as error:
                self._report(f"{type(error).__name__}: {error}")

        return surviving

    def _report(self, text: str) -> None:
        self.get_logger().error(f"page: {text}", throttle_duration_sec=5.0)

    def _log_address(self, host: str) -> None:
        from head_tracking.page.access import reached_at

        token = f"/?token={self.page.token}" if self.page.token else ""
        address = f"http://{reached_at(host)}:{self.page.port}{token}"
        self.get_logger().info(f"the robot is at {address}")
        if token:
            self.get_logger().warning(
                f"the page listens on {host}: everybody who reaches this machine there and knows "
                "the token can steer the robot; the connection is not encrypted"
            )
