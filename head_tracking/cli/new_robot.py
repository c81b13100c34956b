"""new-robot: writes the model and the servo parameters of a pan/tilt head."""

from __future__ import annotations

import argparse
import math
import re
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from typing import Final

from head_tracking.cli.servo.joint_calibration import (
    Ticks,
    by_hand,
    calibration_of,
    configuration,
    relax_for_hand,
)
from head_tracking.cli.servo.overview import FoundServo, find_servos
from head_tracking.cli.servo.session import USUAL_BAUD_RATES, Session, ToolError, find_servo
from head_tracking.cli.terminal import Terminal
from head_tracking.command_line import (
    baud_rate,
    between,
    exit_code,
    servo_id,
    with_negative_values,
)
from head_tracking.configuration import configured_head
from head_tracking.dynamixel.configuration import ServoCalibration
from head_tracking.dynamixel.servo import Servo
from head_tracking.exceptions import RefusedError
from head_tracking.gaze import PanTiltHead
from head_tracking.programs import has_ros
from head_tracking.share import check_writable, share_directory
from head_tracking.transforms import load_robot_model

_MODEL: Final = "pan_tilt_head.xacro"
_MARGIN: Final = 0.03  # rad between the limits and the ends found by hand
_MIN_TURN: Final = 0.1  # rad; less does not count as moved
_SAME_TURN: Final = 0.85  # smallest ratio of the turns of two servos on one joint
_POSES: Final = {
    "head_pan": (
        "Point the camera straight ahead",
        "Turn the head to the right as far as it may go",
        "Turn the head to the left as far as it may go",
    ),
    "head_tilt": (
        "Point the camera straight ahead again",
        "Point the camera up as far as it may go",
        "Point the camera down as far as it may go",
    ),
}
"""Zero, the lowest and the highest position of each joint."""

_MEASURES: Final = {
    "pan_xyz": ("pan axis in base_link", "0 0 0.05"),
    "tilt_xyz": ("tilt axis, measured from the pan axis with the head straight ahead", "0 0 0.04"),
    "camera_xyz": ("lens of the camera, measured from the tilt axis", "0.03 0 0.03"),
}
"""What is measured with a ruler, and the values for two AX-12 on top of each other."""

_EPILOG = """\
No servo is turned. Without --pan and --tilt you move the head by hand: this shows which servo is
pan, its direction, its zero and its range. Axes: x ahead, y to the left, z up.
exit codes: 0 done; 1 failed; 2 wrong command line; 3 refused or not confirmed; 130 Ctrl-C
"""


def main(
    arguments: Sequence[str] | None = None,
    make_session: Callable[[Terminal, str, int], Session] = Session,
) -> int:
    """Describe the head on a port; return the exit code."""
    words = sys.argv[1:] if arguments is None else arguments
    options = _parser().parse_args(with_negative_values(words))
    return exit_code("new-robot", lambda: _describe(options, make_session))


def _describe(
    options: argparse.Namespace, make_session: Callable[[Terminal, str, int], Session]
) -> None:
    terminal = Terminal(assume_yes=options.yes)
    urdf, parameters = files = _new_files(options)
    measures = {name: _measure(terminal, options, name) for name in _MEASURES}
    session = make_session(terminal, options.port, options.baud or USUAL_BAUD_RATES[0])
    rate, joints = _calibrate(options, session)
    model = _model(options, [first for first, *_ in joints], measures)
    text = configuration(joints, options.port, rate, "head_tracking new-robot")
    _check_and_write(files, (model, text))
    script = share_directory() / "scripts" / "run"  # adds what the page needs
    in_checkout = Path(sys.prefix) == script.parents[1] / ".venv" and script.exists()
    program = str(script) if in_checkout else "head_tracking"
    print(f"written:   {urdf}, {parameters}")
    if has_ros():
        print(f"see it:    {program} --sim --viewer --robot {urdf}")
        print(f"turn it:   {program} --port {options.port} --robot {urdf} --viewer")
    print(f"in Python: Head.open({options.port!r}, robot={str(urdf)!r})")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="new_robot",
        description="Describes a pan/tilt head: writes NAME.urdf.xacro and NAME.yaml for --robot.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("name", type=_name, metavar="NAME", help="name of the robot, such as my_head")
    add("--folder", type=Path, default=Path(), help="folder of the files (here)")
    add("--port", default="/dev/ttyUSB0", metavar="DEV", help="serial port (%(default)s)")
    add(
        "--baud", type=baud_rate, metavar="RATE",
        help=f"its baud rate (the first with two servos of {' '.join(map(str, USUAL_BAUD_RATES))})",
    )  # fmt: skip
    add("--pan", type=servo_id, metavar="ID", help="id of the pan servo (default: found by hand)")
    add("--tilt", type=servo_id, metavar="ID", help="id of the tilt servo (default: found by hand)")
    for word, usual, positive, reverse in (
        ("pan", "-90 90", "left positive", "to the right"),
        ("tilt", "-45 45", "down positive", "up"),
    ):
        add(
            f"--{word}-range", type=between(-180.0, 180.0, "degrees"), nargs=2,
            default=[float(number) for number in usual.split()], metavar=("LOW", "HIGH"),
            help=f"with --{word}: limits in degrees, {positive} ({usual})",
        )  # fmt: skip
        add(
            f"--{word}-zero", type=between(0, 4095, "ticks", int), metavar="TICK",
            help=f"with --{word}: tick with the camera straight ahead (the middle)",
        )  # fmt: skip
        add(
            f"--reverse-{word}", action="store_true",
            help=f"with --{word}: rising ticks turn the joint {reverse}",
        )  # fmt: skip
    for name, (what, usual) in _MEASURES.items():
        add(
            f"--{name.replace('_', '-')}", type=between(-3.0, 3.0, "m"), nargs=3,
            metavar=("X", "Y", "Z"), help=f"{what} [m] (asked; {usual})",
        )  # fmt: skip
    add(
        "--camera-roll", type=between(-180.0, 180.0, "degrees"), default=0.0, metavar="DEG",
        help="angle by which the camera is turned clockwise about its axis (0)",
    )  # fmt: skip
    add("--yes", action="store_true", help="answer every question with yes or its default")
    return parser


def _name(text: str) -> str:
    if not re.fullmatch(r"[A-Za-z]\w*", text, re.ASCII):
        raise argparse.ArgumentTypeError(
            f"{text!r} is not a name; give letters, digits and underscores, such as my_head"
        )
    return text


def _new_files(options: argparse.Namespace) -> tuple[Path, Path]:
    """Return the paths of the model and of the parameters; refuse to overwrite files."""
    folder, name = options.folder, options.name
    if not folder.is_dir():
        raise ToolError(f"the folder {folder} does not exist; make it, or give another --folder")
    files = folder / f"{name}.urdf.xacro", folder / f"{name}.yaml"
    for file in files:
        if file.exists():
            raise RefusedError(f"{file} exists; give another name or --folder, or remove it")
        check_writable(file)
    return files


def _measure(terminal: Terminal, options: argparse.Namespace, name: str) -> str:
    """Return three numbers [m] from the command line or from the terminal."""
    what, usual = _MEASURES[name]
    given = getattr(options, name)
    while given is None:
        answer = terminal.ask(f"{what}, x y z in metres", usual)
        with suppress(argparse.ArgumentTypeError):
            numbers = [between(-3.0, 3.0, "m")(word) for word in answer.split()]
            given = numbers if len(numbers) == 3 else None
        if given is None:
            terminal.print(f"{answer!r} is not three numbers from -3 to 3, such as {usual}")
    return " ".join(f"{number:g}" for number in given)


# The servos


def _calibrate(
    options: argparse.Namespace, session: Session
) -> tuple[int, list[list[ServoCalibration]]]:
    """Return the baud rate, and the calibrations of the servos of pan and of tilt."""
    if (options.pan is None) != (options.tilt is None):
        raise RefusedError("give both --pan and --tilt, or neither to move the head by hand")
    if options.pan is not None and options.pan == options.tilt:
        raise RefusedError(f"pan and tilt cannot both be servo {options.pan}; give two ids")
    given = () if options.pan is None else (options.pan, options.tilt)
    rate, ids = _find_rate(session, options.baud, given)
    with session.port(rate) as port:
        servos = [find_servo(port, number) for number in given or ids]
        if not given:
            return rate, _by_hand(session.terminal, servos)
        return rate, [
            [calibration_of(joint, servo, _as_given(servo, options, joint), 0.0)]
            for joint, servo in zip(_POSES, servos, strict=True)
        ]


def _find_rate(
    session: Session, baud_rate: int | None, given: Sequence[int]
) -> tuple[int, list[int]]:
    """Return the first baud rate at which two servos, or the given ones, answer, and their ids."""
    found: list[FoundServo] = []
    for rate in USUAL_BAUD_RATES if baud_rate is None else (baud_rate,):
        found += find_servos(session, (rate,), given or range(254))
        for own_rate in dict.fromkeys(servo.baud_rate for servo in found):
            models = {servo.id: servo.model for servo in found if servo.baud_rate == own_rate}
            if len(models) >= 2:
                text = ", ".join(f"{number} ({models[number]})" for number in sorted(models))
                session.terminal.print(f"servos at {own_rate} baud: {text}")
                return own_rate, sorted(models)
    each = dict.fromkeys(f"{servo.id} at {servo.baud_rate} baud" for servo in found)
    seen = ", ".join(each) or "none"
    names = f"the servos {' and '.join(map(str, given))}" if given else "two servos"
    raise ToolError(
        f"{names} do not answer at one baud rate (found: {seen}); check power and cables, give the "
        "servos different ids and the same rate with `head_tracking servo set-id` and "
        "`head_tracking servo set-baud`, or give another rate with --baud"
    )


def _as_given(servo: Servo, options: argparse.Namespace, name: str) -> list[int]:
    """Return the ticks of a servo at zero, lowest and highest position from the command line."""
    joint = name.removeprefix("head_")
    zero = getattr(options, f"{joint}_zero")
    zero = servo.model.center if zero is None else zero
    lower, upper = ends = getattr(options, f"{joint}_range")
    if not lower < upper:
        raise RefusedError(
            f"--{joint}-range {lower:g} {upper:g} is not possible; the first number is the lower"
        )
    sign = -1.0 if getattr(options, f"reverse_{joint}") else 1.0
    tick = sign * servo.model.radians_per_tick
    return [zero, *(zero + round(math.radians(end) / tick) for end in ends)]


def _by_hand(terminal: Terminal, servos: Sequence[Servo]) -> list[list[ServoCalibration]]:
    """Return the calibrations of the servos of pan and of tilt, which are moved by hand."""
    relax_for_hand(terminal, servos)
    joints: list[list[ServoCalibration]] = []
    for joint, prompts in _POSES.items():
        used = {calibration.id for found in joints for calibration in found}
        others = [servo for servo in servos if servo.id not in used]
        if not others:
            raise RefusedError(f"no servo is left for {joint}")
        calibrated = partial(_calibrated, terminal, others, joint)
        joints.append(by_hand(terminal, others, joint, prompts, calibrated))
    return joints


def _calibrated(
    terminal: Terminal, servos: Sequence[Servo], joint: str, zero: Ticks, low: Ticks, high: Ticks
) -> list[ServoCalibration]:
    """Return the calibrations of those servos that drive a joint, by its poses."""
    return [
        calibration_of(joint, servo, [pose[servo.id] for pose in (zero, low, high)], _MARGIN)
        for servo in _moved(terminal, servos, joint, low, high)
    ]


def _moved(
    terminal: Terminal, servos: Sequence[Servo], joint: str, low: Ticks, high: Ticks
) -> list[Servo]:
    """Return the servo that turned most between two poses, and a second one that turned as far.

    Raises:
        RefusedError: no servo turned, or servos of another joint turned.
    """
    turns = {
        servo.id: abs(high[servo.id] - low[servo.id]) * servo.model.radians_per_tick
        for servo in servos
    }
    most = max(turns.values())
    if most < _MIN_TURN:
        raise RefusedError(
            f"the servo of {joint} did not turn; turn the joint by hand to both ends, or give the "
            "servos with --pan and --tilt"
        )
    moved = [servo for servo in servos if turns[servo.id] > 0.5 * most]
    if len(moved) > 1:
        ids = " and ".join(str(servo.id) for servo in moved)
        if len(moved) > 2 or min(turns[servo.id] for servo in moved) < _SAME_TURN * most:
            raise RefusedError(f"servos {ids} turned; move one joint at a time")
        terminal.confirm(f"Servos {ids} turned by the same angle. Do they drive one joint?")
    return moved


# The files


def _model(
    options: argparse.Namespace,
    calibrations: Sequence[ServoCalibration],
    measures: Mapping[str, str],
) -> str:
    """Return the xacro: the model of the package with the measures of this head."""
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
    """Check that the files describe a head that can be pointed, and write new files."""
    with tempfile.TemporaryDirectory() as folder:
        drafts = [Path(folder, file.name) for file in files]
        for draft, text in zip(drafts, texts, strict=True):
            draft.write_text(text, encoding="utf-8")
        head = configured_head(drafts[1:])
        names = [servo.joint_name for servo in head.servos]
        PanTiltHead(load_robot_model(drafts[0]), names[0], names[1], head.pointing_frame)
    with ExitStack() as undo:  # both files or none
        for path, text in zip(files, texts, strict=True):
            with path.open("x", encoding="utf-8") as file:
                undo.callback(path.unlink, missing_ok=True)
                file.write(text)
        undo.pop_all()
