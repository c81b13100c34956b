"""Calibration files, and their application to a robot model."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Final, NamedTuple
from xml.etree import ElementTree

import yaml

from head_tracking.calibration.geometry import (
    PARAMETERS,
    Array,
    Estimate,
    HeadGeometry,
    Residuals,
)
from head_tracking.exceptions import HeadTrackingError
from head_tracking.share import write_file
from head_tracking.transforms import RobotModel, Rotation, Transform, parse_robot_model

_TIME: Final = "%Y-%m-%dT%H:%M:%S"
_MALFORMED: Final = (
    yaml.YAMLError, KeyError, TypeError, ValueError, AttributeError, OverflowError, RecursionError,
)  # fmt: skip
_DAY: Final = 86_400.0  # s
_OLD: Final = 180 * _DAY
_SAME: Final = 1e-6  # m, and of a quaternion


class CalibrationFileError(HeadTrackingError, ValueError):
    """A calibration file cannot be used with this robot.

    Attributes:
        path: path of the file.
    """

    def __init__(self, path: Path, text: str) -> None:
        super().__init__(f"{path}: {text}")
        self.path = path


class CalibratedJoint(NamedTuple):
    """A calibrated joint.

    Attributes:
        name: name of the joint.
        origin: calibrated origin in the parent link.
        axis: calibrated axis.
        replaces: origin in the model.
    """

    name: str
    origin: Transform
    axis: tuple[float, float, float]
    replaces: Transform


@dataclass(frozen=True, slots=True)
class Calibration:
    """A calibration of a robot's head.

    Attributes:
        robot: name of the robot model.
        made: time of the calibration [s, as time.time()].
        joints: the changed joints.
        estimates: estimates by name of the parameter.
        noise: standard deviation of a corner in the image [px].
        views: number of used views.
        left_out: number of excluded outliers.
        error_before: rms error of direction of the views with the uncalibrated model [rad].
        error_after: the same with the calibrated model [rad].
        residuals: of the views; None: loaded from a file.
        source: file of the calibration; None: not loaded from a file.
    """

    robot: str
    made: float
    joints: tuple[CalibratedJoint, ...]
    estimates: Mapping[str, Estimate]
    noise: float
    views: int
    left_out: int
    error_before: float
    error_after: float
    residuals: Residuals | None = field(default=None, compare=False, repr=False)
    source: Path | None = field(default=None, compare=False)

    @property
    def age(self) -> float:
        """Age of the calibration [s]."""
        return time.time() - self.made

    @property
    def is_old(self) -> bool:
        """Whether it is older than half a year (mountings may have become loose), or not dated."""
        return not -_DAY < self.age < _OLD

    @property
    def age_text(self) -> str:
        """Its age, and what to do because of that."""
        if self.age < -_DAY:
            return "its date is in the future: set the clock of this computer, or calibrate again"
        advice = "; it is old: calibrate again" if self.is_old else ""
        return f"{self.age / _DAY:.0f} days old{advice}"

    @property
    def errors_text(self) -> str:
        """By how much the views disagree before and after the calibration."""
        before, after = map(math.degrees, (self.error_before, self.error_after))
        return f"the views disagree by {before:.2f} degrees before, {after:.2f} degrees after (rms)"

    def angle_of_view(self, assumed: float) -> float:
        """Return the measured angle of view of a camera with an assumed one [rad].

        Raises:
            KeyError: the focal length was not to be estimated.
        """
        factor = math.exp(self.estimates["focal length"].value)
        return 2.0 * math.atan(math.tan(0.5 * assumed) / factor)

    @staticmethod
    def of(
        geometry: HeadGeometry,
        changes: Array,
        estimates: Mapping[str, Estimate],
        noise: float,
        views: int,
        left_out: int,
        residuals: Residuals,
    ) -> Calibration:
        """Return the calibration with changes of the model, values of `PARAMETERS`, shape (12,)."""
        model = geometry.model
        joints = tuple(
            CalibratedJoint(name, joint.origin, joint.axis, model.joint(name).origin)
            for name, joint in geometry.changed(changes).items()
        )
        return Calibration(
            model.name, time.time(), joints, estimates, noise, views, left_out,
            *residuals.errors(), residuals,
        )  # fmt: skip

    def save(self, path: str | Path) -> None:
        """Write a YAML file, atomically unless its folder is read-only.

        Raises:
            CalibrationFileError: it cannot be written; an earlier file is as before.
        """
        path = Path(path)
        document = {
            "robot": self.robot,
            "made": time.strftime(_TIME, time.localtime(self.made)),
            "joints": {
                name: {
                    "origin": _numbers(origin),
                    "axis": list(axis),
                    "replaces": _numbers(replaces),
                }
                for name, origin, axis, replaces in self.joints
            },
            "estimates": {name: each._asdict() for name, each in self.estimates.items()},
            **{name: getattr(self, name) for name in _NUMBERS},
        }
        text = _HEADER + yaml.safe_dump(document, sort_keys=False)
        try:
            write_file(path, text)
        except OSError as error:
            raise CalibrationFileError(
                path,
                f"it cannot be written ({error.strerror}); give a file in a writable folder, on a "
                "disk with free space",
            ) from error

    def apply(self, model: RobotModel) -> RobotModel:
        """Return a robot model, with its URDF, changed by this calibration.

        Args:
            model: a model that was read from a URDF.

        Raises:
            CalibrationFileError: the calibration was made with another model.
        """
        tree, difference = ElementTree.fromstring(model.urdf), ""
        for joint in self.joints:
            before = model.joints.get(joint.name)
            if before is None or not _is_same(before.origin, joint.replaces):
                difference = f"the joint {joint.name!r} differs; calibrate again"
            else:
                _write(tree, joint)
        if model.name != self.robot:
            difference = "it is another robot; give a calibration of this one"
        if difference:
            raise CalibrationFileError(
                self.source or Path("calibration"),
                f"the calibration of {self.robot!r} does not match the model {model.name!r}: "
                f"{difference}",
            )
        return parse_robot_model(ElementTree.tostring(tree, encoding="unicode"))

    @staticmethod
    def load(path: str | Path) -> Calibration:
        """Load a calibration file.

        Raises:
            CalibrationFileError: the file cannot be read, or is invalid.
        """
        path = Path(path)
        try:
            found = yaml.safe_load(path.read_text(encoding="utf-8"))
            if not isinstance(found, Mapping):
                raise ValueError("no names with values")
            return Calibration(
                str(found["robot"]),
                time.mktime(time.strptime(str(found["made"]), _TIME)),
                tuple(_joint(str(name), joint) for name, joint in found["joints"].items()),
                estimates={
                    str(name): Estimate(
                        _number(each["value"]),
                        _number(each["deviation"], 0.0),
                        bool(each["observable"]),
                    )
                    for name, each in found["estimates"].items()
                },
                **{name: read(found[name]) for name, read in _NUMBERS.items()},
                source=path,
            )
        except (OSError, *_MALFORMED) as error:
            problem = f"it is not valid: {' '.join(str(error).split())}"
            if isinstance(error, OSError):
                problem = str(error.strerror)
            elif isinstance(error, KeyError):
                problem = f"it has no {error}"
            raise CalibrationFileError(
                path, f"{problem}; create a calibration with `head_tracking calibrate`"
            ) from error


def summary(calibration: Calibration) -> list[tuple[str, str, str]]:
    """Return name, change and deviation of each estimate as texts."""
    rows = []
    for parameter in PARAMETERS:
        estimate = calibration.estimates.get(parameter.name)
        if estimate is None:
            continue
        change, unit = parameter.displayed(estimate.value)
        deviation, _ = parameter.displayed(estimate.deviation)
        if estimate.observable:
            rows.append((parameter.name, f"{change:+.2f} {unit}", f"± {deviation:.2f} {unit}"))
        else:
            rows.append((parameter.name, "not observable", "(value of the model)"))
    return rows


_HEADER = """# Camera mounting and joint zeros of a head, measured by `head_tracking calibrate`.
# For `--calibration FILE`. Origins: x y z [m], quaternion x y z w, of joints in the robot's model.
"""


def _write(tree: ElementTree.Element, joint: CalibratedJoint) -> None:
    """Set origin and axis of a joint in a URDF."""
    element = next(each for each in tree.findall("joint") if each.get("name") == joint.name)
    origin = element.find("origin")
    if origin is None:
        origin = ElementTree.SubElement(element, "origin")
    origin.set("xyz", _text(joint.origin.translation))
    origin.set("rpy", _text(joint.origin.rotation.as_rpy()))
    axis = element.find("axis")
    if axis is None:  # the default is 1 0 0
        axis = ElementTree.SubElement(element, "axis")
    axis.set("xyz", _text(joint.axis))


def _is_same(one: Transform, other: Transform) -> bool:
    apart = one.inverse() @ other
    return max(map(abs, apart[:6])) < _SAME


def _text(numbers: Sequence[float]) -> str:
    return " ".join(map(repr, map(float, numbers)))


def _numbers(transform: Transform) -> list[float]:
    return [float(number) for number in transform]


def _joint(name: str, found: Mapping[str, Any]) -> CalibratedJoint:
    x, y, z = map(_number, found["axis"])
    origin, replaces = _transform(found["origin"]), _transform(found["replaces"])
    return CalibratedJoint(name, origin, (x, y, z), replaces)


def _transform(numbers: Any) -> Transform:
    found = [_number(number) for number in numbers]
    x, y, z, *quaternion = found
    length = math.hypot(*quaternion)
    if len(quaternion) != 4 or abs(length - 1.0) > 1e-3:
        raise ValueError(f"an origin is x, y, z and a quaternion of length 1, not {found}")
    return Transform((x, y, z), Rotation(*(number / length for number in quaternion)))


def _number(number: Any, above: float = -math.inf) -> float:
    found = float(number)
    if not above < found < math.inf:
        raise ValueError(f"{number!r} is not a finite number above {above:g}")
    return found


_NUMBERS: Final[dict[str, Callable[[Any], Any]]] = {
    "noise": partial(_number, above=0.0),
    "views": int,
    "left_out": int,
    "error_before": _number,
    "error_after": _number,
}
"""How the attributes that are numbers are read from a file."""
