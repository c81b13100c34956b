"""Steer the head with the keyboard: a, d, w, s and Enter; a space stops; r resumes.

python examples/keyboard.py /dev/ttyUSB0     or, without hardware: --sim
"""

import math
import sys

from head_tracking import Head, RefusedCommandError, UnreachableError

STEPS = {"a": (0.2, 0.0), "d": (-0.2, 0.0), "w": (0.0, 0.15), "s": (0.0, -0.15)}  # rad


def main(port: str = "--sim") -> None:
    """Run the example."""
    left = up = 0.0
    with Head.simulated() if port == "--sim" else Head.open(port) as head:
        for key in (key for line in sys.stdin for key in line.rstrip("\n")):
            if key == " ":
                print(head.stop())
            elif key == "r":
                head.resume()
            elif key in STEPS:
                yaw, pitch = left + STEPS[key][0], up + STEPS[key][1]
                ahead = (
                    math.cos(yaw) * math.cos(pitch),
                    math.sin(yaw) * math.cos(pitch),
                    math.sin(pitch),
                )
                try:
                    head.look_at([3.0 * number for number in ahead], "torso_link")
                    left, up = yaw, pitch
                except (RefusedCommandError, UnreachableError) as error:
                    print(error)
            pan, tilt = head.joints.values()
            print(f"pan {pan:+.2f} tilt {tilt:+.2f} rad, {head.state}")


if __name__ == "__main__":
    main(*sys.argv[1:])
