"""What was learned of servos, kept in files from one run to the next: one file for each servo."""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Final

import yaml

from head_tracking.share import state_folder, write_file
from head_tracking.tracking import ServoValues

_KEPT: Final = "delay", "deviation", "dead_band"


class ServoMemory:
    """Keeps what a run has learned of its servos for the next one.

    Args:
        servos: what identifies the servo of each joint; empty: not known, nothing is kept.
    """

    def __init__(self, servos: Mapping[str, str], folder: Path | None = None) -> None:
        self._folder = folder or state_folder("servos")
        self._servos = {joint: name for joint, name in servos.items() if name}

    def load(self) -> dict[str, ServoValues]:
        """Return the values of earlier runs, by joint; a file that cannot be used is left out."""
        return {joint: value for joint in self._servos if (value := self._read(self._file(joint)))}

    def save(self, values: Mapping[str, ServoValues]) -> None:
        """Keep values, by joint; where files cannot be written, nothing is kept."""
        for joint in self._servos.keys() & values.keys():
            kept = {name: getattr(values[joint], name) for name in _KEPT}
            text = yaml.safe_dump({name: kept[name] and float(kept[name]) for name in _KEPT})
            with suppress(OSError):
                self._folder.mkdir(parents=True, exist_ok=True)
                write_file(self._file(joint), text)

    def forget(self) -> None:
        """Delete what is kept."""
        for joint in self._servos:
            with suppress(OSError):
                self._file(joint).unlink()

    def _file(self, joint: str) -> Path:
        name = "".join(c if c.isalnum() or c in "-_." else "_" for c in self._servos[joint])
        return self._folder / f"{name}.yaml"

    @staticmethod
    def _read(file: Path) -> ServoValues | None:
        try:
            found = yaml.safe_load(file.read_text())
            band = found["dead_band"]
            numbers = [float(found[name]) for name in _KEPT if found[name] is not None]
            values = ServoValues(
                float(found["delay"]),
                float(found["deviation"]),
                band and float(band),
                saved=file.stat().st_mtime,
            )
        except (OSError, ValueError, TypeError, KeyError, yaml.YAMLError):
            return None
        return values if all(0.0 <= number < math.inf for number in numbers) else None
