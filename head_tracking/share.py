"""The files of the package: urdf/, config/, the state that persists, and how files are written."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from functools import cache
from pathlib import Path

from head_tracking.exceptions import HeadTrackingError

PACKAGE = "head_tracking"


class NotInstalledError(HeadTrackingError, FileNotFoundError):
    """A robot model, or the share directory of the package, does not exist."""


@cache
def share_directory() -> Path:
    """Return the folder that has urdf/ and config/.

    It is beside the package (a checkout), or is share/head_tracking below a parent of this file
    (colcon, pip) or below the Python environment.

    Raises:
        NotInstalledError: there is no such folder.
    """
    here = Path(__file__).resolve()
    candidates = [
        here.parents[1],
        *(parent / "share" / PACKAGE for parent in here.parents),
        Path(sys.prefix) / "share" / PACKAGE,
    ]
    for candidate in candidates:
        if (candidate / "urdf").is_dir() and (candidate / "config").is_dir():
            return candidate
    raise NotInstalledError(
        f"the share directory of {PACKAGE} with urdf/ and config/ is not in: "
        f"{', '.join(map(str, candidates))}; install the package again"
    )


def state_folder(name: str) -> Path:
    """Return a folder for state that persists between runs (XDG base directories).

    For users without a home it is below /tmp.
    """
    home = os.path.expanduser("~")
    if home == "~":
        home = "/tmp"
    folder = os.environ.get("XDG_STATE_HOME") or Path(home, ".local", "state")
    return Path(folder) / PACKAGE / name


def write_file(path: Path, text: str) -> None:
    """Write a file, atomically: if that fails, an earlier file is as before, and OSError is raised.

    A device, such as /dev/stdout, is written, not replaced; so is a file in a read-only folder.
    """
    draft = path.with_name(f".{path.name}.{os.getpid()}.draft")  # not that of another program
    try:
        if path.exists() and not path.is_file():
            raise PermissionError
        draft.write_text(text, encoding="utf-8")
        draft.replace(path)
    except PermissionError:
        path.write_text(text, encoding="utf-8")
    finally:
        with suppress(OSError):
            draft.unlink()


def check_writable(path: Path) -> None:
    """Raise OSError if a file cannot be written; existing contents stay."""
    existed = path.exists()
    path.open("a").close()
    if not existed:
        path.unlink()


def robot_names() -> list[str]:
    """Return the names of the robots that come with the package."""
    files = (share_directory() / "urdf").glob("*.urdf.xacro")
    return sorted(file.name.removesuffix(".urdf.xacro") for file in files)


def robot_file(name_or_path: str) -> Path:
    """Return the model file of a robot, given by its name (`kinectbot`) or by a path.

    Raises:
        NotInstalledError: there is no such robot or file.
    """
    names = robot_names()
    model = share_directory() / "urdf" / f"{name_or_path}.urdf.xacro"
    path = model if name_or_path in names else Path(name_or_path)
    if not path.is_file():
        raise NotInstalledError(
            f"there is no robot {name_or_path!r}; give one of {', '.join(names)} or the path of a "
            "URDF or xacro file"
        )
    return path


def robot_parameters(name_or_path: str) -> list[Path]:
    """Return the parameter file of a robot: config/NAME.yaml, or the one beside its model file.

    The list is empty for a robot that needs no parameters beside the defaults.
    """
    model = Path(name_or_path)
    beside = model.with_name(model.name.removesuffix(".xacro").removesuffix(".urdf") + ".yaml")
    own = [share_directory() / "config" / f"{name_or_path}.yaml", beside]
    return list(filter(Path.is_file, own))[:1]
