"""The last minute of a robot: kept, written to a file, read again."""

from __future__ import annotations

import bisect
import gzip
import json
import math
import threading
import zlib
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from head_tracking.transforms import Rotation, Transform, TransformException
from head_tracking.viewer.observation import Observation

_FORMAT = "head_tracking recording 1"
_LARGEST = 200_000_000  # bytes, unpacked


class RecordingError(ValueError):
    """A file is no recording; says why."""


class Recorder:
    """Keeps what was seen in the last `seconds`."""

    def __init__(self, seconds: float) -> None:
        self._length = round(seconds * 1e9)
        self._seen: deque[Observation] = deque()
        self._lock = threading.Lock()

    def add(self, seen: Observation) -> None:
        """Takes what is seen now."""
        with self._lock:
            if self._seen and seen.stamp < self._seen[-1].stamp:
                self._seen.clear()  # time jumped back
            self._seen.append(seen)
            while seen.stamp - self._seen[0].stamp > self._length:
                self._seen.popleft()

    def recording(self) -> Recording:
        """What is kept now; from any thread.

        Raises:
            RecordingError: that is nothing.
        """
        with self._lock:
            seen = tuple(self._seen)
        return Recording(seen)


@dataclass(frozen=True, slots=True)
class Recording:
    """What was seen of a robot, oldest first; at least one observation.

    Raises:
        RecordingError: there is none, or they are not in order.
    """

    seen: tuple[Observation, ...]

    def __post_init__(self) -> None:
        if not self.seen:
            raise RecordingError("there is nothing in the recording")
        stamps = [one.stamp for one in self.seen]
        if stamps != sorted(stamps):
            raise RecordingError("the recording's stamps are not in order")

    @property
    def duration(self) -> float:
        """From the first to the last [s]."""
        return (self.seen[-1].stamp - self.seen[0].stamp) * 1e-9

    def at(self, time: float) -> Observation:
        """What was seen at, or last before, `time` [s] from the start."""
        stamp = self.seen[0].stamp + round(time * 1e9)
        index = bisect.bisect_right(self.seen, stamp, key=lambda one: one.stamp)
        return self.seen[max(0, index - 1)]

    def to_bytes(self) -> bytes:
        """As a file: JSON, packed by gzip."""
        document = {"format": _FORMAT, "seen": [_plain(one) for one in self.seen]}
        return gzip.compress(json.dumps(document).encode(), compresslevel=4)

    @staticmethod
    def from_bytes(data: bytes) -> Recording:
        """A recording from a file.

        Raises:
            RecordingError: it is none, or damaged; says why.
        """
        try:
            unpacker = zlib.decompressobj(wbits=31)
            text = unpacker.decompress(data, _LARGEST)
            if unpacker.unconsumed_tail or not unpacker.eof:
                raise RecordingError("the file is too large or was cut off")
            document = json.loads(text)
        except (zlib.error, ValueError, RecursionError) as error:
            raise RecordingError(f"the file is no recording of head_tracking: {error}") from error
        if not isinstance(document, dict) or document.get("format") != _FORMAT:
            raise RecordingError(f"the file is no {_FORMAT!r}; save one with the button above")
        try:
            return Recording(tuple(_observation(one) for one in document["seen"]))
        except RecordingError:
            raise
        except (KeyError, TypeError, AttributeError, ValueError, TransformException) as error:
            raise RecordingError(f"the recording is damaged: {error!r}") from error


def _plain(seen: Observation) -> dict[str, Any]:
    return {
        "stamp": seen.stamp,
        "joints": dict(seen.joints),
        "frames": {name: list(transform) for name, transform in seen.frames.items()},
        "target": seen.target,
        "target_text": seen.target_text,
        "error": seen.error,
        "state": seen.state,
        "target_stamp": seen.target_stamp,
    }


def _observation(plain: Mapping[str, Any]) -> Observation:
    target = plain["target"]
    error, target_stamp = plain["error"], plain.get("target_stamp")
    return Observation(
        int(plain["stamp"]),
        {str(name): _finite(position) for name, position in plain["joints"].items()},
        {str(name): _transform(numbers) for name, numbers in plain["frames"].items()},
        None if target is None else _point(target),
        str(plain["target_text"]),
        None if error is None else _finite(error),
        str(plain["state"]),
        None if target_stamp is None else int(target_stamp),
    )


def _finite(value: Any) -> float:
    number = float(value)
    if not math.isfinite(number):
        raise RecordingError("the recording is damaged: a number in it is not finite")
    return number


def _point(numbers: Sequence[Any]) -> tuple[float, float, float]:
    x, y, z = map(_finite, numbers)
    return x, y, z


def _transform(numbers: Sequence[Any]) -> Transform:
    return Transform(
        _point(numbers[:3]), Rotation.from_quaternion_xyzw([_finite(n) for n in numbers[3:]])
    )
