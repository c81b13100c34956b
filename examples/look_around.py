"""Look at four points in turn, and print the remaining angle at each.

python examples/look_around.py /dev/ttyUSB0     or, without hardware: --sim
"""

import math
import sys

from head_tracking import Head, UnreachableError

POINTS = [(2.0, 0.0, 0.6), (2.0, 1.5, 0.9), (2.0, -1.5, 0.2), (-2.0, 0.0, 0.6)]  # m, in base_link


def main(port: str = "--sim") -> None:
    """Run the example."""
    with Head.simulated() if port == "--sim" else Head.open(port) as head:
        for point in POINTS:
            try:
                result = head.look_at(point, frame="base_link")
                print(point, "arrived" if result.arrived else "blocked", f"{result.miss:.4f} rad")
            except UnreachableError as error:
                print(point, f"out of reach by {math.degrees(error.miss):.0f} degrees")


if __name__ == "__main__":
    main(*sys.argv[1:])
