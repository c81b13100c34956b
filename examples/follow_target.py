"""Follow a target that moves on a circle, and print the tracking error.

python examples/follow_target.py /dev/ttyUSB0     or, without hardware: --sim
"""

import math
import sys
import time

from head_tracking import Head


def target(seconds: float) -> tuple[float, float, float]:
    """Return the position of the target in base_link [m]."""
    return 2.0, 0.8 * math.cos(1.5 * seconds), 0.6 + 0.4 * math.sin(1.5 * seconds)


def main(port: str = "--sim") -> None:
    """Run the example."""
    with Head.simulated() if port == "--sim" else Head.open(port) as head:
        began = time.time()
        while (now := time.time()) < began + 5.0:
            head.follow(target(now - began), stamp=now)
            time.sleep(1 / 30)
            if head.error is not None:
                print(f"{head.state:10} {math.degrees(head.error):5.1f} degrees")


if __name__ == "__main__":
    main(*sys.argv[1:])
