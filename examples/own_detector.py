"""Follow the output of your own detector; the camera is on the head.

Replace `detect`. It returns a point in the camera's optical frame (x right, y down, z ahead, in
metres) and the time of the image. The head needs the time, because it has moved since then.

python examples/own_detector.py /dev/ttyUSB0     or, without hardware: --sim
"""

import math
import sys
import time

from head_tracking import Head

BALL = (1.5, 0.6, 0.4)  # m, in base_link; it does not move


def detect(head: Head) -> tuple[tuple[float, float, float], float]:
    """Return the position of the ball in the camera's frame, and the time of the image."""
    seen = time.time() - 0.02
    point = head.pose("base_link", "camera_optical_frame", stamp=seen) @ BALL
    time.sleep(0.05)  # the detector needs some time
    return point, seen


def main(port: str = "--sim") -> None:
    """Run the example."""
    with Head.simulated() if port == "--sim" else Head.open(port) as head:
        time.sleep(0.2)  # head.pose needs some history
        end = time.time() + 4.0
        while time.time() < end:
            point, stamp = detect(head)
            head.follow(point, frame="camera_optical_frame", stamp=stamp)
        assert head.error is not None
        print(f"{head.state}: the head misses the ball by {math.degrees(head.error):.2f} degrees")


if __name__ == "__main__":
    main(*sys.argv[1:])
