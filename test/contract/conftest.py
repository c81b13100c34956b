"""Tests of what users meet: executables, ROS names, exit codes, closed-loop figures.

They import nothing of the package but its public Python API and the simulated servos.
"""

import os

# what is killed leaves shared memory files behind
os.environ["FASTDDS_BUILTIN_TRANSPORTS"] = "UDPv4"

from collections.abc import Iterator
from contextlib import closing

import pytest
from rig import Bench, Person, Servos

from head_tracking import Head


@pytest.fixture(autouse=True, scope="module")
def discovery() -> Iterator[None]:
    """Other tests of this process may have switched the discovery of other processes off."""
    with pytest.MonkeyPatch.context() as environment:
        environment.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        yield


@pytest.fixture
def bench(tmp_path) -> Iterator[Bench]:
    with closing(Bench(tmp_path)) as bench:
        yield bench


@pytest.fixture
def person(bench: Bench) -> Person:
    """Somebody with ROS tools at the bench of the test or of its file."""
    return bench.person


@pytest.fixture(scope="module")
def module_bench(tmp_path_factory) -> Iterator[Bench]:
    """The same for all tests of a file, for what takes long to start."""
    with closing(Bench(tmp_path_factory.mktemp("bench"))) as bench:
        yield bench


@pytest.fixture(scope="module")
def running(request, module_bench) -> Bench:
    """The same beside a program, with the options of the file."""
    module_bench.run(*request.module.RUN)
    module_bench.person.wait_for_joints()
    return module_bench


@pytest.fixture
def servos(tmp_path) -> Iterator[Servos]:
    with closing(Servos(tmp_path / "servos")) as servos:
        yield servos


@pytest.fixture
def head(servos, kinectbot) -> Iterator[Head]:
    """A head for a Python program; it ends relaxed."""
    with Head(servos.name, kinectbot, reply_timeout=0.2) as head:
        yield head
    assert servos.torque == [0, 0]
