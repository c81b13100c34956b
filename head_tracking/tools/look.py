"""look: turns a running head to a point or a frame, and says whether it got there."""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing

import rclpy
from geometry_msgs.msg import PointStamped
from rclpy.node import Node
from std_srvs.srv import Trigger

from head_tracking.command_line import PointInFrame, finite, point_in_frame, with_points
from head_tracking.gaze import Arrival, PanTiltHead
from head_tracking.ros.messages import target_message
from head_tracking.ros.spinning import NodeThreads
from head_tracking.ros.start import program, start_ros, without_ros_arguments
from head_tracking.ros.stop_signal import StopSignal
from head_tracking.tf import Buffer, listening_buffer
from head_tracking.tracking import Target
from head_tracking.transforms import LATEST, RobotModelError, TransformException, Vector3

_PERIOD = 0.05  # s
_SETTLE_TIME = 0.3  # s
_RECENTERING_NODES = ("head_tracker", "point_head")


class CannotLook(Exception):
    """The head was not turned; the message says why."""


class Look:
    """Speaks with a running head.

    Args:
        node: publishes and listens; somebody else spins it.
        buffer: the robot's frames, fed by somebody else.
        options: what a person asked for.
        stop: tells when it is enough.
    """

    def __init__(
        self, node: Node, buffer: Buffer, options: argparse.Namespace, stop: StopSignal
    ) -> None:
        self._node = node
        self._buffer = buffer.core
        self._options = options
        self._stop = stop
        self._targets = node.create_publisher(PointStamped, options.topic, 10)

    def at(self, point: Vector3, frame: str) -> str:
        """Turns the head to a point [m] in a frame and waits until it is there; the message.

        Raises:
            CannotLook: the head did not get there.
        """
        head = self._head()
        self._wait_for(
            lambda: self._targets.get_subscription_count() > 0,
            f"no head listens on {self._options.topic}: is head_tracking running in this domain?",
        )
        return (
            self._follow(head, point, frame)
            if self._options.follow
            else self._turn(
                head, lambda: self._place(head, point, frame), lambda: self._send(point, frame)
            )
        )

    def centre(self) -> str:
        """Lets the head look straight ahead and waits until it does; the message.

        Raises:
            CannotLook: nobody can do it, or it did not happen.
        """
        head = self._head()
        clients = [
            self._node.create_client(Trigger, f"{name}/recenter") for name in _RECENTERING_NODES
        ]
        self._wait_for(
            lambda: any(client.service_is_ready() for client in clients),
            f"no {' or '.join(_RECENTERING_NODES)} answers: is head_tracking running here?",
        )
        client = next(client for client in clients if client.service_is_ready())
        answer = client.call_async(Trigger.Request())
        self._wait_for(answer.done, "the head did not answer")
        if not answer.result().success:
            raise CannotLook(answer.result().message)
        centre = head.pan_limits.clamp(0.0), head.tilt_limits.clamp(0.0)

        def miss() -> float:
            present = self._positions(head)
            return max(abs(here - there) for here, there in zip(present, centre, strict=True))

        return self._wait_until_there(miss, lambda: None)

    def _turn(
        self, head: PanTiltHead, place: Callable[[], Vector3], send: Callable[[], None]
    ) -> str:
        return self._wait_until_there(lambda: head.miss(place(), *self._positions(head)), send)

    def _follow(self, head: PanTiltHead, point: Vector3, frame: str) -> str:
        while True:
            miss = head.miss(self._place(head, point, frame), *self._positions(head))
            message = f"the head misses the target by {math.degrees(miss):.2f} degrees"
            if self._stop():
                break
            if sys.stdout.isatty():
                print(f"\r{message}  ", end="", flush=True)
            self._send(point, frame)
            self._stop.wait(_PERIOD)
        if miss > self._options.tolerance:
            raise CannotLook(f"stopped: {message}")
        return f"stopped: {message}"

    def _wait_until_there(self, miss: Callable[[], float], send: Callable[[], None]) -> str:
        arrival = Arrival(self._options.tolerance, _SETTLE_TIME)
        end = time.monotonic() + self._options.timeout
        while True:
            angle = miss()
            degrees = f"{math.degrees(angle):.2f} degrees"
            if arrival.step(angle, time.monotonic()):
                return f"arrived: the head misses the target by {degrees}"
            if time.monotonic() > end or self._stop():
                raise CannotLook(
                    f"did not arrive: the head misses the target by {degrees}{self._others()}"
                )
            send()
            self._stop.wait(_PERIOD)

    def _others(self) -> str:
        others = self._node.count_publishers(self._targets.topic_name) - 1
        return f"; {others} other programs publish {self._options.topic} too" if others else ""

    def _head(self) -> PanTiltHead:
        """The robot's head, as soon as the robot and its joints are known."""
        o = self._options
        self._wait_for(
            lambda: self._buffer.model is not None,
            "no robot_description is published: is head_tracking running in this domain?",
        )
        assert self._buffer.model is not None
        try:
            head = PanTiltHead(self._buffer.model, o.pan_joint, o.tilt_joint, o.camera)
        except RobotModelError as error:
            raise CannotLook(str(error)) from error
        self._wait_for(
            lambda: all(
                self._buffer.latest_joint_position(joint) for joint in (o.pan_joint, o.tilt_joint)
            ),
            f"nobody publishes the positions of {o.pan_joint} and {o.tilt_joint} on joint_states",
        )
        return head

    def _positions(self, head: PanTiltHead) -> tuple[float, float]:
        pan, tilt = (
            self._buffer.latest_joint_position(joint) for joint in (head.pan_joint, head.tilt_joint)
        )
        if pan is None or tilt is None:
            raise CannotLook("the clock has jumped; where the head is now, nobody has said yet")
        return pan[1], tilt[1]

    def _place(self, head: PanTiltHead, point: Vector3, frame: str) -> Vector3:
        """The point in the head's base frame, if the head can look there."""
        try:
            placed = self._buffer.transform_point(point, head.base_frame, frame)
        except TransformException as error:
            raise CannotLook(f"nothing moves: {error}") from error
        gaze = head.gaze(placed, *self._positions(head))
        if not gaze.reached:
            raise CannotLook(f"nothing moves: {gaze.reason}")
        return placed

    def _send(self, point: Vector3, frame: str) -> None:
        self._targets.publish(target_message(Target(LATEST, frame, point)))

    def _wait_for(self, what: Callable[[], bool], otherwise: str) -> None:
        end = time.monotonic() + self._options.wait
        while not what():
            if time.monotonic() > end or self._stop():
                raise CannotLook(otherwise)
            self._stop.wait(0.02)


def look(node: Node, buffer: Buffer, arguments: Sequence[str], stop: StopSignal) -> int:
    """Does what the command line says; 0 if the head got there."""
    options = parse_arguments(arguments)
    work = Look(node, buffer, options, stop)
    try:
        if options.centre:
            print(work.centre())
        else:
            print(work.at(options.point, options.frame))
    except CannotLook as error:
        print(f"look: {error}", file=sys.stderr)
        return 1
    return 0


def parse_arguments(arguments: Sequence[str]) -> argparse.Namespace:
    """What to look at; on a mistake the process ends with code 2."""
    parser = argparse.ArgumentParser(
        prog="look",
        description="Turns a running head and says whether it got there.",
        epilog="Exit code 0: it looks there. 1: it does not, and the message says why. 2: usage.",
    )
    parser.add_argument(
        "where",
        nargs="*",
        type=_number_or_point,
        metavar="x,y,z@frame",
        help="a point [m] and its frame, such as 1,0.5,0@base_link; or X Y Z with --frame",
    )
    parser.add_argument("--frame", help="the frame of X Y Z; alone: the frame to look at")
    parser.add_argument("--follow", action="store_true", help="go on until Ctrl-C")
    parser.add_argument("--centre", "--center", action="store_true", help="look straight ahead")
    parser.add_argument(
        "--tolerance",
        type=_degrees,
        default=math.radians(2.0),
        metavar="DEG",
        help="the largest miss that counts as arrived (default 2)",
    )
    parser.add_argument(
        "--timeout", type=finite, default=8.0, metavar="S", help="for the turn (default 8)"
    )
    parser.add_argument(
        "--wait", type=finite, default=10.0, metavar="S", help="for a running head (default 10)"
    )
    parser.add_argument("--topic", default="target_point", help="default: %(default)s")
    parser.add_argument("--camera", default="camera_link", help="what looks (%(default)s)")
    parser.add_argument("--pan-joint", default="head_pan_joint", help="default: %(default)s")
    parser.add_argument("--tilt-joint", default="head_tilt_joint", help="default: %(default)s")
    options = parser.parse_intermixed_args(with_points(arguments))
    if options.centre == bool(options.where or options.frame):
        parser.error("say where to look: x,y,z@frame, --frame alone, or --centre alone")
    points = [one for one in options.where if isinstance(one, PointInFrame)]
    if len(options.where) == len(points) == 1 and options.frame is None:
        options.point, options.frame = points[0]
        return options
    if not options.centre and (points or options.frame is None or len(options.where) not in (0, 3)):
        parser.error("a point needs a frame, such as: look 1,1,0@base_link")
    options.point = tuple(options.where) or (0.0, 0.0, 0.0)
    return options


@program("look")
def main() -> int:
    """Turns the head; returns the exit code."""
    arguments = without_ros_arguments(sys.argv)[1:]
    parse_arguments(arguments)
    with StopSignal() as stop, ExitStack() as resources:
        start_ros()
        resources.callback(rclpy.try_shutdown)
        node = Node("look", start_parameter_services=False)
        buffer = listening_buffer(node)
        resources.enter_context(closing(NodeThreads())).start(node)
        return look(node, buffer, arguments, stop)


def _number_or_point(text: str) -> float | PointInFrame:
    return point_in_frame(text) if "@" in text or "," in text else finite(text)


def _degrees(text: str) -> float:
    return math.radians(finite(text))


if __name__ == "__main__":
    raise SystemExit(main())
