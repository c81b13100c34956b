"""A head with other servos: XL430 at 57600 bit/s; the tilt servo is mounted in reverse.

python examples/other_servos.py /dev/ttyUSB0     or, without hardware: --sim
"""

import sys

from head_tracking import Head, JointConfiguration
from head_tracking.dynamixel import servo_model

XL430 = servo_model("XL430-W250")
PAN = JointConfiguration("head_pan_joint", 11, 2048, 1024, 3072, XL430, controller="pan")
TILT = JointConfiguration(  # min above max: fewer ticks mean a larger angle
    "head_tilt_joint", 12, init=2048, min=2700, max=1400, model=XL430, controller="tilt"
)


def open_head(port: str) -> Head:
    """Return the head."""
    if port == "--sim":
        return Head.simulated(robot="kinectbot", servos=(PAN, TILT))
    return Head.open(port, robot="kinectbot", servos=(PAN, TILT), baud_rate=57_600)


def main(port: str = "--sim") -> None:
    """Run the example."""
    with open_head(port) as head:
        print(head.look_at((1.0, 0.5, 0.3)))
        for servo in head.statistics.servos:
            print(f"{servo.joint_name}: {servo.model}, {servo.voltage:.1f} V")


if __name__ == "__main__":
    main(*sys.argv[1:])
