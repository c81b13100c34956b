"""The imports between packages; see docs/explain/architecture.md."""

import ast
import importlib
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import head_tracking
from head_tracking.tracking import TrackingLaw

NAME = "head_tracking"
PACKAGE = Path(head_tracking.__file__).parent
CORE = {
    "transforms", "gaze", "tracking", "targets", "vision", "scene", "dynamixel", "simulation",
    "control", "parameters", "configuration", "head", "calibration", "detectors",
}  # fmt: skip

ALLOWED: dict[str, set[str]] = {
    "exceptions": set(),
    "compatibility": set(),
    "output": set(),
    "command_line": {"output", "share", "signals"},
    "signals": set(),
    "parameters": set(),
    "parameter_files": {"parameters"},
    "transforms": set(),
    "gaze": {"transforms", "parameters"},
    "tracking": {"gaze", "transforms", "parameters"},
    "targets": {"tracking", "transforms", "parameters"},
    "detectors": {"vision"},
    "vision": {"transforms", "parameters", "detectors"},
    "scene": {"vision", "transforms", "parameters"},
    "dynamixel": {"feetech", "parameters"},
    "feetech": set(),
    "simulation": set(),  # an error of the driver must not be repeated in the simulator
    "configuration": {"dynamixel", "gaze", "parameters", "parameter_files", "simulation"}
    | {"tracking"},
    "calibration": {"gaze", "parameters", "share", "transforms", "vision"},
    "control": {"dynamixel", "transforms"},
    "head": {"control", "dynamixel", "gaze", "share", "simulation", "tracking", "transforms"}
    | {"calibration", "configuration", "parameters", "signals", "vision"},
    "share": set(),
    "tf": {"transforms", "parameters", "ros"},
    "ros": CORE | {"tf", "share", "recording", "programs", "parameter_files", "command_line"},
    "recording": {"tracking", "transforms", "vision", "parameters", "ros"},
    "page": {"tracking", "targets", "transforms", "gaze", "vision", "dynamixel", "parameters"}
    | {"tf", "ros", "recording", "control", "head", "calibration", "share"},
    "cli": CORE
    | {"run", "tf", "share", "ros", "command_line", "programs", "parameter_files"}
    | {"output"},
    "programs": {"output"},
    "__main__": {"programs"},
    "run": CORE
    | {"tf", "ros", "page", "share", "output", "command_line", "programs"}
    | {"parameter_files"},
}
"""Packages that a package may import, besides itself and `exceptions`."""

ONLY_IN = {
    "cv2": {"vision/opencv.py"},
    "yourdfpy": {"transforms/urdf_parser.py"},
    "xacro": {"transforms/urdf_parser.py"},
    "rich": {"cli/terminal.py", "cli/servo/overview.py", "cli/doctor/findings.py"},
}

ROS = ("rclpy", "rcl_interfaces", "builtin_interfaces", "std_srvs", "ament_index_python")


MODULES = {
    path.relative_to(PACKAGE).as_posix(): [*ast.walk(ast.parse(path.read_text()))]
    for path in sorted(PACKAGE.rglob("*.py"))
}
"""The syntax nodes of every file."""


def imported(path: str) -> Iterator[str]:
    for node in MODULES[path]:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path} imports relatively"
            assert node.module is not None
            yield node.module


def test_a_module_imports_only_what_its_package_may():
    for path in MODULES:
        here = path.partition("/")[0].removesuffix(".py")
        for module in imported(path):
            parts = module.split(".")
            if here == "__init__":
                assert parts[0] != NAME or parts[1:] in ([], ["head"], ["head", "head"]), module
            elif parts[0] == NAME:
                allowed = ALLOWED[here] | {here, "exceptions", "compatibility"}
                assert parts[1] in allowed, f"{path} imports {module}"
            if here in CORE:
                assert parts[0] not in ROS, f"{path} is core and imports {module}"
                assert not parts[0].endswith("_msgs"), f"{path} is core and imports {module}"


@pytest.mark.parametrize("library", ONLY_IN)
def test_a_library_is_imported_by_one_file(library):
    users = {
        path
        for path in MODULES
        if any(module.split(".")[0] == library for module in imported(path))
    }
    assert users == ONLY_IN[library]


def test_the_contract_suite_knows_only_packages():
    for file in (PACKAGE.parent / "test" / "contract").glob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(NAME):
                assert len(node.module.split(".")) <= 2, f"{file.name} imports {node.module}"


def test_timers_of_nodes_run_on_the_steady_clock():
    """A timer on the node's clock would stop for hours after a clock step of hours."""
    calls = {
        path: {word.arg for word in call.keywords}
        for path in MODULES
        for call in MODULES[path]
        if isinstance(call, ast.Call)
        and isinstance(call.func, ast.Attribute)
        and call.func.attr == "create_timer"
        and not isinstance(call.func.value, ast.Call)  # super()
    }
    assert calls == {"ros/kit/spinning.py": {"clock"}}


def test_the_table_of_laws_can_import_a_law_from_its_own_file():
    base = f"{TrackingLaw.__module__.removeprefix(f'{NAME}.').replace('.', '/')}.py"
    assert f"{NAME}.tracking.laws" not in {*imported(base), TrackingLaw.__module__}


def test_the_core_loads_without_ros_and_without_opencv():
    code = (
        "import sys\n"
        f"for name in {(*ROS, 'cv2')!r}: sys.modules[name] = None\n"
        + "".join(f"import head_tracking.{name}\n" for name in sorted(CORE))
        + "import head_tracking.cli.doctor.__main__, head_tracking.cli.simulated_bus\n"
        + "import head_tracking.cli.servo.main, head_tracking.cli.check_model\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=PACKAGE.parent, timeout=120)


def test_exported_names_exist_once():
    names = [path for path in MODULES if path.endswith("/__init__.py")]
    assert names
    for name in names:
        package = importlib.import_module(
            f"{NAME}.{Path(name).parent.as_posix().replace('/', '.')}"
        )
        exported = getattr(package, "__all__", [])
        assert len(exported) == len(set(exported))
        for member in exported:
            assert hasattr(package, member), f"{name} exports {member}, which is not there"


def test_a_class_name_has_one_meaning():
    """The simulator has its own codec and registers: those classes are the same things again."""
    places = {}
    for path in MODULES:
        for node in MODULES[path]:
            if isinstance(node, ast.ClassDef):
                places.setdefault(node.name, set()).add(path)
    twice = {name: found for name, found in places.items() if len(found) > 1}
    assert twice.pop("Status") == twice.pop("Instruction") == {
        "dynamixel/protocol.py", "simulation/packets.py"
    }  # fmt: skip
    assert twice.pop("Register") == {"dynamixel/control_table.py", "simulation/models.py"}
    assert twice == {}


def test_a_file_name_has_one_meaning():
    """The same thing in two layers has the same name: as of the core and of its node."""
    names = [path.rpartition("/")[2] for path in MODULES]
    assert {name for name in names if names.count(name) > 1 and not name.startswith("__")} == {
        "buffer.py", "bus.py", "exceptions.py", "fictitious_target.py", "frame_target.py",
        "images.py", "models.py", "port.py", "recorder.py", "servo.py",
    }  # fmt: skip
