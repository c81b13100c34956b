"""Make the message packages of this folder, which are not among the ROS wheels, for the tests.

`build.py PREFIX` leaves them in PREFIX, for the Python that runs it, and does nothing if they are
there already. It needs a C++ compiler. A package is a folder with its definitions in msg, srv and
action; it may use the packages of the wheels, and none of this folder.
"""

import hashlib
import logging
import os
import shutil
import subprocess
import sys
import sysconfig
from concurrent.futures import ProcessPoolExecutor
from contextlib import redirect_stdout
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROS = Path(sys.prefix)  # where the wheels leave headers, libraries and share
# What Fast DDS serializes with, and what it describes a type with.
SUPPORTS = ["rosidl_typesupport_fastrtps_c", "rosidl_typesupport_introspection_c"]


def say(text: str) -> None:
    print("head_tracking:   " + text, file=sys.stderr)


def generate(package: Path, sources: Path, modules: Path) -> None:
    """Write a package's C sources, a folder for each generator, and its Python modules."""
    from rosidl_adapter import convert_to_idl
    from rosidl_generator_c.cli import GenerateC
    from rosidl_generator_py.cli import GeneratePython
    from rosidl_generator_type_description.cli import HashTypeDescription
    from rosidl_typesupport_c.cli import GenerateCTypesupport
    from rosidl_typesupport_fastrtps_c.cli import GenerateFastRTPSCTypesupport
    from rosidl_typesupport_introspection_c.cli import GenerateIntrospectionCTypesupport

    name, ros = package.name, [ROS / "share"]
    idl, code, fastdds, introspection, choice = (
        sources / label / name for label in ("idl", "code", "fastdds", "introspection", "choice")
    )
    definitions = [path.relative_to(package) for path in sorted(package.glob("*/*"))]
    for path in definitions:
        convert_to_idl(package, name, path, idl)
    files = [f"{idl}:{path.with_suffix('.idl')}" for path in definitions]
    hashes = HashTypeDescription("hashes").generate_type_hashes(name, files, ros, idl)
    GenerateC("c").generate(name, files, ros, code, type_description_files=hashes)
    GenerateFastRTPSCTypesupport("fastdds").generate(name, files, ros, fastdds)
    GenerateIntrospectionCTypesupport("introspection").generate(name, files, ros, introspection)
    GenerateCTypesupport("choice", typesupport_implementations=SUPPORTS).generate(
        name, files, ros, choice
    )
    GeneratePython("python", typesupport_implementations=["rosidl_typesupport_c"]).generate(
        name, files, ros, modules
    )


def compile_package(name: str, sources: Path, modules: Path, libraries: Path) -> None:
    """Compile all C sources of a package into the extension module that its Python imports."""
    import numpy

    folders = [*sources.glob(f"*/{name}"), modules]
    c, cpp = (
        sorted(path for folder in folders for path in folder.rglob(pattern))
        for pattern in ("*.c", "*.cpp")
    )
    # Most of the time of a C++ file goes into its headers; as one file they are read once.
    together = sources / f"{name}.cpp"
    together.write_text("".join(f'#include "{path}"\n' for path in cpp))
    headers = [*sources.iterdir(), ROS / "include", *(ROS / "include").iterdir()]
    headers += [sysconfig.get_path("include"), numpy.get_include()]
    module = modules / f"{name}_s__rosidl_typesupport_c{sysconfig.get_config_var('EXT_SUFFIX')}"
    subprocess.run(
        ["cc", "-shared", "-fPIC", "-w", "-o", module]
        + [f"-I{path}" for path in headers]
        + [together, *c, "-Wl,--as-needed", f"-Wl,-rpath,{ROS / 'lib'}"]
        + [*(ROS / "lib").glob("lib*.so"), "-lstdc++"],
        check=True,
    )
    for support in SUPPORTS:  # ROS loads each from a library, by its name
        (libraries / f"lib{name}__{support}.so").symlink_to(module)


def build(package: Path, prefix: Path) -> None:
    sources, libraries = prefix / "sources", prefix / "lib"
    python = f"python{sysconfig.get_python_version()}"
    modules = libraries / python / "site-packages" / package.name
    try:
        with redirect_stdout(open(os.devnull, "w")):  # the generators name every file
            generate(package, sources, modules)
        compile_package(package.name, sources, modules, libraries)
    except Exception as error:
        say(f"{package.name} was not built ({error}): its tests will be skipped")
        shutil.rmtree(modules, ignore_errors=True)


def main(prefix: Path) -> None:
    digest = hashlib.sha256(f"{sys.version} {ROS} {shutil.which('c++')}".encode())
    for path in sorted(HERE.rglob("*.*")):
        if path.is_file() and "__pycache__" not in path.parts:
            digest.update(f"{path.relative_to(HERE)}\n".encode() + path.read_bytes())
    stamp = prefix / "stamp"
    if stamp.is_file() and stamp.read_text() == digest.hexdigest():
        return
    packages = sorted(path for path in HERE.iterdir() if (path / "msg").is_dir())
    names = " ".join(path.name for path in packages)
    say(f"building {names} for the tests, once (they have no wheels; half a minute) ...")
    shutil.rmtree(prefix, ignore_errors=True)
    (prefix / "lib").mkdir(parents=True)
    if shutil.which("c++"):
        os.environ["AMENT_PREFIX_PATH"] = str(ROS)
        logging.disable()  # the wheels list each plug-in twice
        with ProcessPoolExecutor() as processes:
            for _ in processes.map(build, packages, [prefix] * len(packages)):
                pass
    else:
        say("not built (there is no c++): their tests will be skipped")
    stamp.write_text(digest.hexdigest())  # also after a failure: not again until something changes


if __name__ == "__main__":
    main(Path(sys.argv[1]).absolute())
