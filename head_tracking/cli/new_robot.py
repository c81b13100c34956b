"""new-robot: describes a pan/tilt head, and writes the model and the servo configuration for it."""

from __future__ import annotations

import argparse
import math
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

from head_tracking.cli.servo.bench import Terminal, ToolError, Workshop, find_servo
from head_tracking.cli.servo.calibrate import Motion, configuration, mount_of, ticks_by_hand
from head_tracking.cli.servo.overview import USUAL_BAUD_RATES, FoundServo, find_servos
from head_tracking.command_line import DONE, between, exit_code, servo_id, with_numbers
from head_tracking.configuration import configured_head
from head_tracking.dynamixel.configuration import ServoCalibration
from head_tracking.dynamixel.servo import Servo
from head_tracking.exceptions import RefusedError
from head_tracking.gaze import PanTiltHead
from head_tracking.share import share_directory
from head_tracking.transforms import load_robot_model

_MODEL: Final = "pan_tilt_head.xacro"
_MARGIN: Final = 0.03  # rad that the limits stay away from the ends found by hand
_MOVED: Final = 0.1  # rad: a servo that turned less was not meant
_ALIKE: Final = 0.85  # of the way: two servos of one joint turn at least so far alike
_PAN, _TILT = "head_pan", "head_tilt"
_POSES: Final = {
    "ahead": "Point the camera straight ahead",
    "left": "Turn the head as far to the left as it may go",
    "right": "Turn the head as far to the right as it may go",
    "up": "Point the camera straight ahead again, then as far up as it may go",
    "down": "Point the camera as far down as it may go",
}
_MEASURES: Final = {
    "pan_xyz": ("pan axis in base_link", "0 0 0.05"),
    "tilt_xyz": ("tilt axis, measured from the pan axis with the head straight ahead", "0 0 0.04"),
    "camera_xyz": ("lens of the camera, measured from the tilt axis", "0.03 0 0.03"),
}
"""What is measured with a ruler, and what two AX-12 on top of each other have."""

_EPILOG = """\
No servo is turned. Without --pan and --tilt you move the head by hand: that shows which servo is
pan, its direction, its zero and its range. Axes: x ahead, y to the left, z up.
exit codes: 0 done; 1 failed; 2 wrong command line; 3 refused or not confirmed; 130 Ctrl-C
"""

Poses = Mapping[str, Mapping[int, int]]
"""The tick of each servo id in each pose of _POSES."""


def main(
    arguments: Sequence[str] | None = None,
    workshop: Callable[[Terminal, str, int], Workshop] = Workshop,
    show: Callable[[Sequence[str]], int] = subprocess.call,
) -> int:
    """Describe the head on a port; return the exit code.

    Args:
        arguments: the command line.
        workshop: makes the port and the terminal.
        show: runs the command that shows the head in the page.
    """
    words = sys.argv[1:] if arguments is None else arguments
    options = _parser().parse_args(with_numbers(words))
    return exit_code("new-robot", lambda: _describe(options, workshop, show))


def _describe(
    options: argparse.Namespace,
    workshop: Callable[[Terminal, str, int], Workshop],
    show: Callable[[Sequence[str]], int],
) -> int:
    terminal = Terminal(assume_yes=options.yes)
    files = _new_files(options)
    measures = {name: _measure(terminal, options, name) for name in _MEASURES}
    rate, mounts = _calibrate(options, lambda baud: workshop(terminal, options.port, baud))
    calibrations = [mount for mount, *_ in mounts]
    seconds = {mount.joint_name: other for mount, *others in mounts for other in others}
    model = _model(options, calibrations, measures)
    text = configuration(calibrations, options.port, rate, "head_tracking new-robot", seconds)
    _check_and_write(files, (model, text))
    urdf = files[0]
    print(
        f"written: {files[0]}, {files[1]}\n"
        f"see it:    head_tracking --sim --viewer --robot {urdf}\n"
        f"turn it:   head_tracking --port {options.port} --robot {urdf} --viewer\n"
        f"in Python: Head.open({options.port!r}, robot={str(urdf)!r})"
    )
    if options.show:
        return show(
            [sys.executable, "-m", "head_tracking", "--sim", "--viewer", "--robot", str(urdf)]
        )
    return DONE


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="new_robot",
        description="Describes a pan/tilt head: writes NAME.urdf.xacro and NAME.yaml for --robot.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("name", type=_name, metavar="NAME", help="name of the robot, such as my_head")
    add("--folder", type=Path, default=Path(), help="where the files are written (here)")
    add("--port", default="/dev/ttyUSB0", metavar="DEV", help="serial port (%(default)s)")
    add(
        "--baud", type=int, metavar="RATE",
        help=f"its baud rate (the first of {' '.join(map(str, USUAL_BAUD_RATES))} with two servos)",
    )  # fmt: skip
    add("--pan", type=servo_id, metavar="ID", help="id of the pan servo (found by hand)")
    add("--tilt", type=servo_id, metavar="ID", help="id of the tilt servo (found by hand)")
    for joint, usual in ((_PAN, "-90 90"), (_TILT, "-45 45")):
        word = joint.removeprefix("head_")
        add(
            f"--{word}-range", type=between(-180.0, 180.0, "degrees"), nargs=2,
            default=[float(number) for number in usual.split()], metavar=("LOW", "HIGH"),
            help=f"with --{word}: limits in degrees, {_signs(word)} ({usual})",
        )  # fmt: skip
        add(
            f"--{word}-zero", type=between(0, 4095, "ticks", int), metavar="TICK",
            help=f"with --{word}: tick with the camera straight ahead (the servo's middle)",
        )  # fmt: skip
        add(
            f"--reverse-{word}", action="store_true",
            help=f"with --{word}: rising ticks turn the joint {_falling(word)}",
        )  # fmt: skip
    for name, (what, usual) in _MEASURES.items():
        add(
            f"--{name.replace('_', '-')}", type=between(-3.0, 3.0, "m"), nargs=3,
            metavar=("X", "Y", "Z"), help=f"{what} [m] (asked; {usual})",
        )  # fmt: skip
    add(
        "--camera-roll", type=between(-180.0, 180.0, "degrees"), default=0.0, metavar="DEG",
        help="how far the camera is turned clockwise about the direction in which it looks (0)",
    )  # fmt: skip
    add("--show", action="store_true", help="show the head in simulation, in a browser, at the end")
    add("--yes", action="store_true", help="answer every question with yes or its default")
    return parser


def _signs(joint: str) -> str:
    return "left positive" if joint == "pan" else "down positive"


def _falling(joint: str) -> str:
    return "to the right" if joint == "pan" else "up"


def _name(text: str) -> str:
    if not re.fullmatch(r"[A-Za-z]\w*", text, re.ASCII):
        raise argparse.ArgumentTypeError(
            f"{text!r} is no name; give letters, digits and underscores, such as my_head"
        )
    return text


def _new_files(options: argparse.Namespace) -> tuple[Path, Path]:
    """Return the paths of the model and of the configuration; refuse to overwrite."""
    if not options.folder.is_dir():
        raise ToolError(f"there is no folder {options.folder}; make it, or give another --folder")
    files = (
        options.folder / f"{options.name}.urdf.xacro",
        options.folder / f"{options.name}.yaml",
    )
    for file in files:
        if file.exists():
            raise RefusedError(f"{file} exists; choose another name or --folder, or remove it")
    return files


def _measure(terminal: Terminal, options: argparse.Namespace, name: str) -> str:
    """Return three numbers [m] from the command line, or from the terminal."""
    what, usual = _MEASURES[name]
    given = getattr(options, name)
    while given is None:
        answer = terminal.ask(f"{what}, x y z in metres", usual)
        with suppress(argparse.ArgumentTypeError):
            numbers = [between(-3.0, 3.0, "m")(word) for word in answer.split()]
            given = numbers if len(numbers) == 3 else None
        if given is None:
            terminal.say(f"{answer!r} is not three numbers from -3 to 3, such as {usual}")
    return " ".join(f"{number:g}" for number in given)


# The servos


def _calibrate(
    options: argparse.Namespace, workshop: Callable[[int], Workshop]
) -> tuple[int, list[list[ServoCalibration]]]:
    """Return the baud rate, and how the servos of pan and of tilt are mounted."""
    if (options.pan is None) != (options.tilt is None):
        raise RefusedError("give both --pan and --tilt, or neither to move the head by hand")
    if options.pan is not None and options.pan == options.tilt:
        raise RefusedError(f"pan and tilt cannot both be servo {options.pan}; give two ids")
    wanted = () if options.pan is None else (options.pan, options.tilt)
    rate, ids = _find_rate(workshop, options.baud, wanted)
    bench = workshop(rate)
    with bench.port() as port:
        links = [find_servo(port, number) for number in wanted or ids]
        if wanted:
            motions = [
                [_as_given(link, options, joint)]
                for link, joint in zip(links, ("pan", "tilt"), strict=True)
            ]
        else:
            motions = _by_hand(bench, links)
        margin = 0.0 if wanted else _MARGIN
        mounts = [
            [mount_of(name, *motion, margin) for motion in found]
            for name, found in zip((_PAN, _TILT), motions, strict=True)
        ]
    return rate, mounts


def _find_rate(
    workshop: Callable[[int], Workshop], baud_rate: int | None, wanted: Sequence[int]
) -> tuple[int, list[int]]:
    """Return the first baud rate at which two servos, or those that are wanted, answer."""
    found: list[FoundServo] = []
    rates = USUAL_BAUD_RATES if baud_rate is None else (baud_rate,)
    for rate in rates:
        found += find_servos(workshop(rate), (rate,), wanted or range(253))
        for own_rate in dict.fromkeys(servo.baud_rate for servo in found):
            ids = sorted({servo.id for servo in found if servo.baud_rate == own_rate})
            if len(ids) >= 2:
                bench = workshop(rate)
                named = {each.id: each.model for each in found if each.baud_rate == own_rate}
                text = ", ".join(f"{number} ({named[number]})" for number in ids)
                bench.terminal.say(f"servos at {own_rate} baud: {text}")
                return own_rate, ids
    seen = ", ".join(f"{servo.id} at {servo.baud_rate} baud" for servo in found) or "none"
    asked = " and ".join(map(str, wanted)) if wanted else "two"
    raise ToolError(
        f"the servos {asked} do not answer at one baud rate (found: {seen}); check power and "
        "cables, give the servos different ids and the same rate with `servo set-id` and "
        "`servo set-baud`, or name another rate with --baud"
    )


def _as_given(link: Servo, options: argparse.Namespace, joint: str) -> Motion:
    """Return how the command line says that a servo is mounted."""
    zero = getattr(options, f"{joint}_zero")
    zero = link.model.center if zero is None else zero
    sign = -1.0 if getattr(options, f"reverse_{joint}") else 1.0
    lower, upper = getattr(options, f"{joint}_range")
    if not lower < upper:
        raise RefusedError(
            f"--{joint}-range {lower:g} {upper:g} is not possible; the first number is the lower"
        )
    low, high = (
        zero + round(sign * math.radians(end) / link.model.radians_per_tick)
        for end in (lower, upper)
    )
    return Motion(link, zero, low, high)


def _by_hand(bench: Workshop, links: Sequence[Servo]) -> list[list[Motion]]:
    """Return the servos of pan and of tilt as somebody moves them by hand."""
    held = [link for link in links if link.get("Torque Enable")]
    if held:
        ids = ", ".join(str(link.id) for link in held)
        bench.terminal.confirm(f"Switch the torque of servo {ids} off? Hold the head: it may drop.")
        for link in held:
            link.set_torque(False)
    poses: dict[str, dict[int, int]] = {}
    for pose, prompt in _POSES.items():
        poses[pose] = ticks_by_hand(bench.terminal, links, prompt)
    pan = _moved(bench.terminal, links, poses, ("right", "left"))
    rest = [link for link in links if link not in [motion.link for motion in pan]]
    tilt = _moved(bench.terminal, rest, poses, ("up", "down"))
    return [pan, tilt]


def _moved(
    terminal: Terminal, links: Sequence[Servo], poses: Poses, ends: tuple[str, str]
) -> list[Motion]:
    """Return the servo that turned most between two poses, and a second one that turned as far.

    Raises:
        RefusedError: none turned, or others did that drive another joint.
    """
    low, high = (poses[end] for end in ends)

    def turn(link: Servo) -> float:
        return abs(high[link.id] - low[link.id]) * link.model.radians_per_tick

    most = max(map(turn, links), default=0.0)
    if most < _MOVED:
        raise RefusedError(
            f"no other servo turned between {ends[0]} and {ends[1]}; was the right joint moved? "
            "Run it again, or name the servos with --pan and --tilt"
        )
    moved = [link for link in links if turn(link) > 0.5 * most]
    if len(moved) > 1:
        ids = " and ".join(str(link.id) for link in moved)
        if len(moved) > 2 or min(map(turn, moved)) < _ALIKE * most:
            raise RefusedError(
                f"servos {ids} turned between {ends[0]} and {ends[1]}; move one joint at a time"
            )
        terminal.confirm(f"Servos {ids} turned alike. Do they drive one joint together?")
    return [Motion(link, poses["ahead"][link.id], low[link.id], high[link.id]) for link in moved]


# The files


def _model(
    options: argparse.Namespace,
    calibrations: Sequence[ServoCalibration],
    measures: Mapping[str, str],
) -> str:
    """Return the xacro: the package's own head with this one's measures."""
    values = {**measures, "camera_roll": f"{options.camera_roll:g}"}
    for calibration in calibrations:
        joint = calibration.joint_name.removeprefix("head_")
        values[f"{joint}_lower"] = f"{calibration.lower:.4f}"
        values[f"{joint}_upper"] = f"{calibration.upper:.4f}"
        values[f"{joint}_velocity"] = f"{calibration.model.no_load_speed:.2f}"
    text = (share_directory() / "urdf" / _MODEL).read_text(encoding="utf-8")
    text = text.replace('name="pan_tilt_head"', f'name="{options.name}"')
    for name, value in values.items():
        text, times = re.subn(rf'(property name="{name}" value=)"[^"]*"', rf'\1"{value}"', text)
        if times != 1:
            raise ToolError(f"{_MODEL} has no property {name}; install the package again")
    return text


def _check_and_write(files: Sequence[Path], texts: Sequence[str]) -> None:
    """Write the files where they are new, once they describe a head that can be pointed."""
    with tempfile.TemporaryDirectory() as folder:
        drafts = [Path(folder, file.name) for file in files]
        for draft, text in zip(drafts, texts, strict=True):
            draft.write_text(text, encoding="utf-8")
        head = configured_head(drafts[1:])
        names = [servo.joint_name for servo in head.servos]
        PanTiltHead(load_robot_model(drafts[0]), names[0], names[1], head.pointing_frame)
    for file, text in zip(files, texts, strict=True):
        with file.open("x", encoding="utf-8") as output:
            output.write(text)
