"""Builds head_tracking: a ROS 2 package for colcon, a wheel for pip."""

import runpy
import sys
from pathlib import Path

from setuptools import find_packages, setup
from setuptools.dist import Distribution

NAME = "head_tracking"
# Not the working directory: colcon --symlink-install runs a link to this file somewhere else.
HERE = Path(__file__).resolve().parent

EXECUTABLES = (NAME, *runpy.run_path(str(HERE / NAME / "programs.py"))["COMMANDS"])
# pip's bin is on everybody's path, where `look` and others are programs of the system
WHEEL = not {"bdist_wheel", "editable_wheel", "dist_info"}.isdisjoint(sys.argv)
PROGRAMS = (NAME,) if WHEEL else EXECUTABLES

LAUNCHER = """\
#!/bin/sh
# Starts the command of this name; ros2 run looks only here.
self=$(readlink -f -- "$0")
exec "${self%/*}/../../bin/head_tracking" @COMMAND@ "$@"
"""


class InstallData(Distribution().get_command_class("install_data")):
    """Gives a wheel lib/head_tracking/<executable>; elsewhere setup.cfg puts the programs there."""

    def run(self):
        super().run()
        if "bdist_wheel" not in self.distribution.command_obj:
            return
        folder = Path(self.install_dir, "lib", NAME)
        folder.mkdir(parents=True)
        for name in EXECUTABLES:
            launcher = folder / name
            launcher.write_text(LAUNCHER.replace("@COMMAND@ ", "" if name == NAME else f"{name} "))
            launcher.chmod(0o755)
            self.outfiles.append(str(launcher))


def requirements(name):
    lines = (HERE / "requirements" / f"{name}.txt").read_text().splitlines()
    return [line for line in lines if line and not line.startswith("#")]


def share(folder):
    """List a folder's files as data_files wants them: per directory, no directories among them."""
    files = sorted(path.relative_to(HERE) for path in (HERE / folder).rglob("*") if path.is_file())
    return [(f"share/{NAME}/{path.parent}", [str(path)]) for path in files]


setup(
    name=NAME,
    version="0.2.0",
    description="Points a pan/tilt head at targets and keeps it there: "
    "Dynamixel and Feetech servos, transforms, tracking.",
    long_description=(HERE / "README.md").read_text(encoding="utf-8"),
    long_description_content_type="text/markdown",
    maintainer="head_tracking contributors",
    maintainer_email="maintainers@users.noreply.h-seed-df56c0b7.example",
    license="BSD-3-Clause",
    python_requires=">=3.10",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={
        NAME: [
            "py.typed",
            "page/static/*",
            "scene/pictures/*",
            "dynamixel/tables/*.toml",
            "feetech/tables/*.toml",
            "simulation/facts/*.csv",
        ]
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        *share("urdf"),
        *share("config"),
        *share("machine"),
    ],
    entry_points={
        "console_scripts": [
            f"{name} = {NAME}.programs:{name}"
            for name in (EXECUTABLES[:1] if WHEEL else EXECUTABLES)
        ]
    },
    # ROS is not required: its wheels would cover a sourced ROS. The extra is for bare machines.
    install_requires=requirements("libraries") + requirements("yourdfpy"),
    extras_require={
        **{name: requirements(name) for name in ("ros", "vision", "viewer")},
        "page": requirements("viewer"),
        "test": [line for name in ("test", "vision", "viewer") for line in requirements(name)],
    },
    cmdclass={"install_data": InstallData},
    zip_safe=False,
)
