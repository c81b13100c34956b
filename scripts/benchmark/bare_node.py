"""A minimal node at 50 Hz, to which the cost of a run is compared.

It publishes two messages and receives one of them, with an EventsExecutor, until SIGTERM.
"""

import signal

import rclpy
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState

RATE = 50.0  # Hz


def main() -> None:
    """Run until SIGTERM."""
    ending: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _: ending.append(number))
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node("bare")
    publishers = [node.create_publisher(JointState, topic, 10) for topic in ("one", "two")]
    message = JointState(name=["pan", "tilt"], position=[0.0, 0.0], velocity=[0.0, 0.0])

    def publish() -> None:
        message.header.stamp = node.get_clock().now().to_msg()
        for publisher in publishers:
            publisher.publish(message)

    node.create_timer(1.0 / RATE, publish)
    node.create_subscription(JointState, "one", lambda _: None, 10)
    executor = EventsExecutor()
    executor.add_node(node)
    print("ready", flush=True)
    while not ending:
        executor.spin_once(timeout_sec=0.1)
    executor.shutdown()
    node.destroy_node()
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
