"""calibrate: measures the pose of a head's camera, and writes a calibration file."""

from __future__ import annotations

import argparse
import math
import shlex
import sys
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

from head_tracking.calibration import Calibration, summary
from head_tracking.calibration.targets import LARGEST_MARKER, SMALLEST_MARKER, TARGETS
from head_tracking.cli.terminal import Terminal
from head_tracking.command_line import between, existing_file, exit_code, writable_file
from head_tracking.configuration import configured_head
from head_tracking.exceptions import HeadTrackingError
from head_tracking.head.head import Head
from head_tracking.share import robot_parameters
from head_tracking.transforms import Rotation, Transform
from head_tracking.vision.markers import DICTIONARIES

if TYPE_CHECKING:
    from head_tracking.vision import Pixels

SIMULATED_MOUNTING: Final = Transform(
    (0.006, -0.004, 0.008), Rotation.from_rpy(0.02, math.radians(3.0), math.radians(-2.0))
)
"""Pose of the simulated camera in the optical frame of the model."""
_AT_FIRST: Final = Transform(
    (0.0, 0.2, 0.7), Rotation.from_rpy(-0.5 * math.pi, 0.0, -0.5 * math.pi)
)
"""Pose in the scene, by the model, of the simulated camera before the head turns."""
SIMULATED_PLAY: Final = math.radians(1.0)
"""Play of the simulated joints between encoder and camera, from side to side [rad]."""

_EPILOG = """\
Fix the marker 1 to 3 m away, where the camera sees it; or stand still there (--target face), or let
it see the room (--target room). The head turns slowly for at most 90 s.
Ctrl-C or SIGTERM ends the calibration: the servos are relaxed, and no file is written.
exit codes: 0 done; 1 failed; 2 wrong command line; 3 not confirmed; 130 Ctrl-C; 143 SIGTERM
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Calibrate; return the exit code."""
    options = _parser().parse_args(sys.argv[1:] if arguments is None else arguments)
    return exit_code("calibrate", lambda: _calibrate(options))


def _calibrate(options: argparse.Namespace) -> None:
    from head_tracking.vision import MarkerParameters, camera_with_view, pictures

    marker = MarkerParameters(options.dictionary, options.marker_id, options.marker_size)
    view = math.radians(options.view)
    given = configured_head([*robot_parameters(options.robot), *options.params])
    open_head = (
        Head.simulated
        if options.sim
        else partial(Head.open, options.port, baud_rate=given.baud_rate)
    )
    try:
        with open_head(
            robot=options.robot, servos=given.servos, pointing_frame=given.pointing_frame
        ) as head:
            images = (
                _simulated_images(head, options.target, options.frame)
                if options.sim
                else pictures(options.camera)
            )
            source = iter(images)
            height, width = next(source)[1].shape[:2]  # there is a camera
            Terminal(assume_yes=options.yes).confirm(
                "The head will look around. Is its range free of obstacles?"
            )
            calibration = head.calibrate(
                source,
                target=options.target,
                marker=marker,
                frame=options.frame,
                model=camera_with_view(width, height, view),
                focal_length=options.focal_length,
                report=lambda text: print(text, file=sys.stderr),
            )
    except KeyboardInterrupt:
        print("calibrate: ended; the servos are relaxed, and no file is written", file=sys.stderr)
        raise
    for name, change, deviation in summary(calibration):
        print(f"{name:<22} {change:>18}  {deviation}")
    print(
        f"{calibration.views} views used, {calibration.left_out} ignored; corner noise "
        f"{calibration.noise:.2f} px\n{calibration.errors_text}"
    )
    if options.focal_length:
        print(f"angle of view: {math.degrees(calibration.angle_of_view(view)):.1f} degrees")
    calibration.save(options.output)
    servos = ["--sim"] if options.sim else ["--port", options.port]
    params = [word for file in options.params for word in ("--params", str(file))]
    words = ["head_tracking", *servos, "--robot", options.robot, *params, "--calibration"]
    print(f"written: {options.output}\nuse it:  {shlex.join([*words, str(options.output)])}")
    if options.picture:
        _draw(calibration, options.picture, (width, height))


def _simulated_images(
    head: Head, target: str, frame: str = "camera_optical_frame"
) -> Iterable[tuple[float, Pixels]]:
    """Return the images of a camera whose pose differs from the model, on joints with play.

    At first it looks at the target; a user turns a real head to it.
    """
    from head_tracking.scene import film

    joints, model = head.simulation, head.frames.model
    assert joints is not None and model is not None
    joints.set_link_play(SIMULATED_PLAY)

    def by_model() -> Transform:
        true = {name: joints.true_position(name) for name in head.joints}
        return model.transform(model.root, frame, true)

    scene = _AT_FIRST @ by_model().inverse()

    def pose(_: float) -> Transform:
        return scene @ by_model() @ SIMULATED_MOUNTING

    return film("empty" if target == "room" else f"still {target}", pose)


def _draw(calibration: Calibration, file: Path, size: tuple[int, int]) -> None:
    from head_tracking.calibration.picture import residual_picture
    from head_tracking.vision.opencv import cv2

    assert calibration.residuals is not None
    if not cv2.imwrite(str(file), residual_picture(calibration.residuals, size)):
        raise HeadTrackingError(f"cannot write the picture {file}")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="calibrate",
        description="Measures the pose of a head's camera: the head looks around.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("what", choices=("camera",), help="what to calibrate")
    add("--port", default="/dev/ttyUSB0", metavar="DEV", help="serial port (%(default)s)")
    add("--sim", action="store_true", help="simulate servos and a camera whose pose is wrong")
    add("--robot", default="kinectbot", metavar="NAME|FILE", help="name of the robot, or its model")
    add(
        "--params", action="append", type=existing_file, default=[], metavar="FILE",
        help="YAML file with parameters, as of `servo calibrate`; can be given several times",
    )  # fmt: skip
    add("--camera", default=0, type=_camera, help="number, device, file or URL (%(default)s)")
    add(
        "--frame", default="camera_optical_frame", metavar="NAME",
        help="its optical frame in the model (%(default)s)",
    )  # fmt: skip
    add(
        "--view", type=between(5.0, 170.0, "degrees"), default=60.0, metavar="DEG",
        help="its horizontal angle of view [degrees] (%(default)s)",
    )  # fmt: skip
    add("--focal-length", action="store_true", help="measure the angle of view as well")
    add(
        "--target", choices=TARGETS, default="marker",
        help="what to look at (%(default)s)",
    )  # fmt: skip
    add(
        "--marker-size", type=between(SMALLEST_MARKER, LARGEST_MARKER, "m"), default=0.16,
        metavar="M",
        help="edge of the marker's black square [m] (%(default)s)",
    )  # fmt: skip
    add(
        "--marker-id", type=between(-1, 100_000, "", int), default=-1, metavar="N",
        help="number of the marker; -1: any",
    )  # fmt: skip
    add(
        "--dictionary", default="4X4_50", choices=DICTIONARIES, metavar="NAME",
        help="of the marker (%(default)s)",
    )  # fmt: skip
    add(
        "--output", default="calibration.yaml", type=writable_file, metavar="FILE",
        help="the file to write (%(default)s)",
    )  # fmt: skip
    add("--picture", type=_picture, metavar="FILE", help="draw the errors before and after (.png)")
    add("--yes", action="store_true", help="start without confirmation")
    return parser


def _camera(text: str) -> int | str:
    return int(text) if text.isdecimal() else text


def _picture(text: str) -> Path:
    if not text.lower().endswith(".png"):
        raise argparse.ArgumentTypeError(f"{text!r} is not a picture; its name must end in .png")
    return writable_file(text)
