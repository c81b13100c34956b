"""Installation by pip and colcon, and the set-up of scripts/run."""

import os
import shlex
import shutil
import subprocess
import sys
import zipfile
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree

import pytest
from program_names import NODES, PROGRAMS
from waiting import PATIENCE

SOURCE = Path(__file__).resolve().parents[1]
VERSION = ElementTree.parse(SOURCE / "package.xml").getroot().findtext("version")
EXECUTABLES = NODES | PROGRAMS
# Print which copy is loaded and where the ament index finds it.
REPORT = """
from ament_index_python.packages import get_package_prefix, get_package_share_directory
import head_tracking
print(head_tracking.__file__)
print(get_package_prefix("head_tracking"))
print(get_package_share_directory("head_tracking"))
"""
LOAD_ALL = """
from importlib.metadata import distribution
for script in distribution("head_tracking").entry_points.select(group="console_scripts"):
    assert callable(script.load()), script
"""


def requires(*modules):
    missing = [module for module in modules if find_spec(module) is None]
    return pytest.mark.skipif(bool(missing), reason=f"not installed: {', '.join(missing)}")


def run(*command, **options):
    """Run a command and return its output; fail with the output."""
    done = subprocess.run(
        [str(word) for word in command],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=PATIENCE,
        check=False,
        **options,
    )
    assert done.returncode == 0, f"{shlex.join(map(str, command))}:\n{done.stdout}"
    return done.stdout


def environment(**changes):
    """Return variables with which a program finds the installed copy, not this checkout.

    LD_LIBRARY_PATH stays, because the libraries are those of this environment.
    """
    paths = ("PYTHONPATH", "AMENT_PREFIX_PATH", "COLCON_PREFIX_PATH")
    return {name: value for name, value in os.environ.items() if name not in paths} | changes


def libraries():
    """Return the folders of third-party packages."""
    return [place for place in sys.path if place.endswith("-packages")]


def files_below(folder):
    return {
        path.relative_to(folder).as_posix()
        for path in Path(folder).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    """Copy all files that git knows or does not ignore."""
    destination = tmp_path_factory.mktemp("workspace") / "src" / "head_tracking"
    listing = ("ls-files", "-z", "--cached", "--others", "--exclude-standard")
    try:
        names = run("git", "-C", SOURCE, *listing).split("\0")
    except (FileNotFoundError, AssertionError):  # no git, or not a clone
        left_out = (".*", "__pycache__", "*.egg-info", "build", "install", "log", "dist")
        shutil.copytree(SOURCE, destination, ignore=shutil.ignore_patterns(*left_out))
        return destination
    for name in filter(None, names):
        if (SOURCE / name).is_file():
            (destination / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(SOURCE / name, destination / name)
    return destination


@pytest.fixture(scope="module")
def wheel(source, tmp_path_factory):
    """Build the wheel from a copy, because pip builds in the source folder."""
    folder = tmp_path_factory.mktemp("wheel")
    shutil.copytree(source, folder / "source")
    offline = ("--no-deps", "--no-index", "--no-build-isolation")
    run(sys.executable, "-m", "pip", "wheel", *offline, "-w", folder, folder / "source")
    (path,) = folder.glob("*.whl")
    return path


@requires("pip", "setuptools", "wheel")
def test_the_wheel_holds_the_package_its_share_directory_and_the_launchers(wheel, source):
    assert wheel.name == f"head_tracking-{VERSION}-py3-none-any.whl"
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
        data = f"head_tracking-{VERSION}.data/data"
        share = f"{data}/share/head_tracking"
        assert f"{share}/package.xml" in names
        assert f"{data}/share/ament_index/resource_index/packages/head_tracking" in names
        for folder in ("urdf", "config", "machine"):
            expected = {f"{share}/{folder}/{name}" for name in files_below(source / folder)}
            assert expected
            assert expected <= names
        code = {f"head_tracking/{name}" for name in files_below(source / "head_tracking")}
        assert code == {name for name in names if name.startswith("head_tracking/")}

        launchers = [
            entry for entry in archive.infolist() if f"{data}/lib/head_tracking/" in entry.filename
        ]
        assert {Path(entry.filename).name for entry in launchers} == EXECUTABLES
        assert all(entry.external_attr >> 16 & 0o111 for entry in launchers)

        metadata = archive.read(f"head_tracking-{VERSION}.dist-info/METADATA").decode()
    needed = [line for line in metadata.splitlines() if line.startswith("Requires-Dist")]
    assert any("ros-jazzy-rclpy" in line for line in needed)
    for line in needed:  # ROS wheels would cover a sourced ROS
        assert "ros-" not in line or 'extra == "ros"' in line


@requires("pip", "setuptools", "wheel", "ament_index_python", "yourdfpy")
def test_an_installed_wheel_runs_without_its_environment_being_active(wheel, tmp_path):
    prefix = tmp_path / "a prefix"
    run(sys.executable, "-m", "venv", "--without-pip", prefix)
    python = prefix / "bin" / "python"
    install = ("install", "--quiet", "--no-deps", "--no-index")
    run(sys.executable, "-m", "pip", "--python", python, *install, wheel, env=environment())
    (packages,) = prefix.glob("lib/python*/site-packages")
    (packages / "libraries.pth").write_text("\n".join(libraries()))

    assert {path.name for path in (prefix / "lib/head_tracking").iterdir()} == EXECUTABLES
    assert EXECUTABLES & {path.name for path in (prefix / "bin").iterdir()} == {"head_tracking"}
    link = tmp_path / "link"
    link.symlink_to(prefix / "lib" / "head_tracking" / "doctor")
    words = ("--sim", "--listen", "0")
    for program in ([link], [prefix / "bin" / "head_tracking", "doctor"]):
        message = run(*program, *words, env=environment(), cwd=tmp_path)
        assert "kinectbot: camera_link" in message

    variables = environment(AMENT_PREFIX_PATH=str(prefix))
    seen = run(python, "-c", REPORT + LOAD_ALL, env=variables, cwd=tmp_path)
    file, found, share = seen.splitlines()
    assert Path(file).is_relative_to(prefix)
    assert (found, share) == (str(prefix), str(prefix / "share" / "head_tracking"))


@requires("colcon_core", "colcon_ros", "setuptools", "ament_package", "yourdfpy")
@pytest.mark.parametrize("option", [None, "--symlink-install"])
def test_colcon_builds_what_ros2_run_looks_for(source, option, tmp_path):
    python = Path(sys.executable)
    if " " in str(python):  # colcon writes programs that cannot start such a Python
        (tmp_path / "python").symlink_to(sys.prefix)
        python = tmp_path / "python" / "bin" / python.name
    variables = environment(PYTHONPATH=os.pathsep.join(libraries()))

    colcon = (python, "-c", "import sys; from colcon_core.command import main; sys.exit(main())")
    bases = ("--build-base", tmp_path / "build", "--install-base", tmp_path / "install")
    build = ("--log-base", tmp_path / "log", "build", "--base-paths", source, *bases)
    run(*colcon, *build, *([option] if option else []), cwd=tmp_path, env=variables)

    prefix = tmp_path / "install" / "head_tracking"
    programs = prefix / "lib" / "head_tracking"
    assert {path.name for path in programs.iterdir()} == EXECUTABLES
    assert all(os.access(path, os.X_OK) for path in programs.iterdir())
    assert (prefix / "share/head_tracking/package.xml").is_file()
    for folder in ("urdf", "config", "machine"):
        installed = prefix / "share" / "head_tracking" / folder
        assert files_below(installed) == files_below(source / folder)

    report, doctor = (python, "-c", REPORT), (programs / "doctor", "--sim", "--listen", "0")
    lines = ("source install/setup.bash", *(shlex.join(map(str, c)) for c in (report, doctor)))
    sourced = run("bash", "-c", " && ".join(lines), cwd=tmp_path, env=variables)
    file, found, share, findings = sourced.split("\n", 3)
    assert Path(file).is_relative_to(tmp_path)
    assert (found, share) == (str(prefix), str(prefix / "share" / "head_tracking"))
    assert "kinectbot: camera_link" in findings


def test_package_xml_names_the_ros_packages_and_the_version_of_the_wheel():
    package = ElementTree.parse(SOURCE / "package.xml").getroot()
    assert f'version="{VERSION}"' in (SOURCE / "setup.py").read_text()
    named = {element.text for element in package.findall("exec_depend")}
    lines = (SOURCE / "requirements" / "ros.txt").read_text().split()
    wheels = [line.removeprefix("ros-jazzy-") for line in lines if line.startswith("ros-jazzy-")]
    needed = {wheel.split(">")[0].split("[")[0].replace("-", "_") for wheel in wheels}
    assert "rclpy" in needed
    assert needed <= named | {"ament_package"}


PYTHON = """\
#!/bin/sh
case "$2" in
  *version_info*) echo {version} "$0" ;;
  *rclpy*) {rclpy} ;;
  *ensurepip*) exit {has_venv} ;;
  *) echo "installs something" >&2; exit 9 ;;
esac
"""


@pytest.fixture
def start(tmp_path):
    """Start a copy of scripts/run with a stand-in for Python and uname."""
    checkout = tmp_path / "a checkout"
    tools = tmp_path / "tools"
    tools.mkdir()
    for folder in ("scripts", "requirements"):
        shutil.copytree(SOURCE / folder, checkout / folder)
    for file in ("setup.py", "pyproject.toml"):
        shutil.copy2(SOURCE / file, checkout)

    def write(name, text):
        (tools / name).write_text(text)
        (tools / name).chmod(0o755)

    def start(version="3.12", has_venv=True, has_ros=False, machine="Linux x86_64", **variables):
        rclpy = "echo 'numpy<3'" if has_ros else "echo 'ImportError: no rclpy here' >&2; exit 1"
        code = PYTHON.format(version=version, has_venv=0 if has_venv else 1, rclpy=rclpy)
        write("python3", code)
        write("uname", f"#!/bin/sh\necho {machine}\n")
        kept = {"HOME": str(tmp_path), "PATH": f"{tools}{os.pathsep}{os.environ['PATH']}"}
        done = subprocess.run(
            [checkout / "scripts" / "run"],
            env=kept | variables,
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=PATIENCE,
            check=False,
        )
        assert done.returncode != 0
        assert done.stdout == ""
        return done.stderr

    start.checkout = checkout
    return start


@pytest.mark.parametrize(
    ("circumstances", "message"),
    [
        ({"version": "3.9"}, "python3 is Python 3.9; head_tracking needs 3.10 to 3.13"),
        ({"version": "3.14"}, "python3 is Python 3.14; head_tracking needs 3.10 to 3.13"),
        ({"HEAD_TRACKING_PYTHON": "python-of-nowhere"}, "python-of-nowhere"),
        ({"ROS_DISTRO": "humble"}, "ROS 2 Humble is sourced, but"),
        ({"ROS_DISTRO": "jazzy"}, "(ImportError: no rclpy here)"),
        ({"machine": "Linux aarch64"}, "this is Linux aarch64"),
        ({"has_venv": False}, "apt install python3-venv"),
    ],
)
def test_an_unsupported_machine_is_refused_with_the_reason(start, circumstances, message):
    assert message in start(**circumstances)
    assert not (start.checkout / ".venv").exists()


@pytest.mark.parametrize(("distribution", "version"), [("humble", "3.10"), ("lyrical", "3.14")])
def test_another_ros_is_accepted_with_one_line(start, distribution, version):
    message = start(ROS_DISTRO=distribution, version=version, has_ros=True).splitlines()
    assert distribution.capitalize() in message[0]
    assert f"setting up .venv, once: Python {version}, the system's ROS 2" in message[1]


def test_a_failed_set_up_is_repeated(start):
    for _ in range(2):
        message = start()
        assert "setting up .venv, once: Python 3.12" in message
        assert "set-up failed" in message


def test_an_environment_of_another_program_is_not_changed(start):
    keep = start.checkout / ".venv" / "keep"
    keep.parent.mkdir()
    keep.touch()
    assert "was not made by this script" in start()
    assert keep.exists()


@pytest.mark.parametrize(
    ("words", "lists"),
    [
        ("--sim", set()),
        ("--viewer --mode point --sim", {"viewer", "vision"}),
        ("--port /dev/ttyUSB0 --viewer", {"viewer"}),
        ("--port /dev/ttyUSB0 --target face", {"vision"}),
        ("calibrate camera", {"vision"}),
    ],
)
def test_a_complete_environment_gets_the_libraries_of_the_options(start, words, lists):
    checkout = start.checkout
    line = 'source "$0/scripts/environment.bash"; surroundings'
    key = run("bash", "-c", line, str(checkout), cwd=checkout, env=dict(os.environ))
    programs = checkout / ".venv" / "bin"
    programs.mkdir(parents=True)
    (checkout / ".venv" / "head_tracking.base").write_text(key)
    (checkout / ".venv" / "head_tracking.in-use").touch()
    log = checkout / "log"
    for name in ("python", "head_tracking"):
        (programs / name).write_text(f'#!/bin/sh\necho {name} "$@" >>"{log}"\n')
        (programs / name).chmod(0o755)
    command = [checkout / "scripts" / "run", *words.split()]
    for _ in range(2):
        subprocess.run(command, check=True, capture_output=True, timeout=PATIENCE)
    done = log.read_text()
    assert done.count(f"head_tracking {words}\n") == 2
    for name in ("viewer", "vision"):
        assert done.count(f"requirements/{name}.txt") == (name in lists)  # once, if at all


def test_an_environment_that_is_active_is_not_made_anew(start):
    line = 'source "$0/scripts/environment.bash"; surroundings'
    key, active_key = (
        run("bash", "-c", line, str(start.checkout), cwd=start.checkout, env=os.environ | active)
        for active in ({}, _activated(start.checkout / ".venv"))
    )
    assert key == active_key


def _activated(environment):
    """Return the variables that `activate` of an environment sets."""
    programs = environment / "bin"
    programs.mkdir(parents=True)
    (programs / "python3").symlink_to(shutil.which("sh"))  # any other program
    return {"VIRTUAL_ENV": str(environment), "PATH": f"{programs}{os.pathsep}{os.environ['PATH']}"}
