import pickle
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest

from head_tracking.share import robot_file
from head_tracking.transforms import (
    RobotModelError,
    Transform,
    load_robot_model,
    parse_robot_model,
    with_fixed_root,
)

TWO_LINKS = '<link name="a"/><link name="b"/>'
JOINT = '<joint name="j" type="{type}"><parent link="{parent}"/><child link="b"/>{more}</joint>'
BACK = '<joint name="k" type="fixed"><parent link="b"/><child link="a"/></joint>'
LIMIT = '<limit lower="-1" upper="1"/>'


def robot(*parts: str) -> str:
    return '<robot name="r">' + "".join(parts) + "</robot>"


def joint(type: str = "revolute", parent: str = "a", more: str = LIMIT) -> str:
    return JOINT.format(type=type, parent=parent, more=more)


@pytest.mark.parametrize(
    "urdf",
    [
        "<robot",
        '<robot name="r"><link name="a">',
        "",
        "<sdf/>",
        '<robot><link name="a"/></robot>',
        robot(),
        robot("<link/>"),
        robot(TWO_LINKS),
        robot('<link name="a"/><link name="a"/>'),
        robot(TWO_LINKS, joint(), joint()),
        robot(TWO_LINKS, joint(parent="z")),
        robot(TWO_LINKS, joint(), joint().replace('"j"', '"k"')),
        robot(TWO_LINKS, joint(parent="b")),
        robot(TWO_LINKS, joint(type="ball")),
        robot(TWO_LINKS, joint(type="")),
        robot(TWO_LINKS, '<joint name="j" type="fixed"><child link="b"/></joint>'),
        robot(TWO_LINKS, joint(more="")),
        robot(TWO_LINKS, joint(more='<limit lower="1" upper="-1"/>')),
        robot(TWO_LINKS, joint(more='<limit lower="nan" upper="1"/>')),
        robot(TWO_LINKS, joint(more='<limit lower="-1" upper="1" velocity="-1"/>')),
        robot(TWO_LINKS, joint(more=LIMIT + '<axis xyz="0 0 0"/>')),
        robot(TWO_LINKS, joint(more=LIMIT + '<axis xyz="0 1"/>')),
        robot(TWO_LINKS, joint(more=LIMIT + '<origin rpy="a b c"/>')),
        robot(TWO_LINKS, joint(more=LIMIT + '<mimic joint="k"/>')),
        robot(TWO_LINKS, joint(more=LIMIT + '<mimic joint="j"/>')),
        robot('<link name="root"/>', TWO_LINKS, joint(), BACK),
        robot('<link name="a"><visual><geometry><box size="x"/></geometry></visual></link>'),
    ],
)  # fmt: skip
def test_an_invalid_model_is_refused(urdf):
    with pytest.raises(RobotModelError):
        parse_robot_model(urdf)


@pytest.mark.parametrize("in_child", [False, True])
def test_a_missing_parser_is_an_error_that_users_can_correct(in_child, monkeypatch):
    monkeypatch.setattr("head_tracking.transforms.urdf._parses_in_child", in_child)
    monkeypatch.setitem(sys.modules, "yourdfpy", None)
    with pytest.raises(RobotModelError):
        parse_robot_model(robot('<link name="a"/>'))


def test_limits_that_an_exporter_did_not_know_are_accepted():
    limit = '<limit lower="0" upper="0" velocity="0" effort="0"/>'
    model = parse_robot_model(robot(TWO_LINKS, joint(more=limit)))
    limits = model.joints["j"].limits
    assert (limits.lower, limits.upper, limits.velocity) == (0.0, 0.0, float("inf"))


@pytest.mark.parametrize("kind", ["floating", "planar"])
def test_a_base_that_walks_is_the_root(kind):
    free = f'<joint name="free" type="{kind}"><parent link="world"/><child link="a"/></joint>'
    model = parse_robot_model(robot('<link name="world"/>', free, TWO_LINKS, joint()))
    assert (model.root, model.links, list(model.joints)) == ("a", ("a", "b"), ["j"])
    with pytest.raises(RobotModelError):  # what is fixed to the world would be a second root
        parse_robot_model(
            robot(TWO_LINKS, joint(type=kind), '<link name="c"/>', BACK.replace('"b"', '"c"'))
        )


def test_a_missing_file_and_a_broken_xacro_name_the_file(tmp_path):
    with pytest.raises(RobotModelError):
        load_robot_model(tmp_path / "nothing.urdf")
    broken = tmp_path / "broken.urdf.xacro"
    broken.write_text('<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">'
                      "<xacro:undefined/></robot>")  # fmt: skip
    with pytest.raises(RobotModelError):
        load_robot_model(broken)


def test_models_are_loaded_in_threads_at_once(kinectbot):
    with ThreadPoolExecutor(4) as pool:
        models = pool.map(load_robot_model, [robot_file("kinectbot")] * 8)
    assert {model.urdf for model in models} == {kinectbot.urdf}


def test_a_second_world_is_refused(kinectbot):
    with pytest.raises(RobotModelError):
        with_fixed_root(kinectbot, "torso_link", Transform.identity())


def run(program: str) -> None:
    """Run a program with a group of processes of its own."""
    command = [sys.executable, "-c", program]
    subprocess.run(command, start_new_session=True, check=True, timeout=120)


def test_a_child_process_parses_the_same_and_keeps_its_libraries():
    run("""
import sys
from concurrent.futures import ThreadPoolExecutor
from head_tracking.share import robot_file
from head_tracking.transforms import RobotModelError, load_robot_model, parse_robot_model
from head_tracking.transforms.urdf import parse_in_child_process
parse_in_child_process()
child = load_robot_model(robot_file("kinectbot"))
try:
    parse_robot_model("<sdf/>")
except RobotModelError:
    assert not {"yourdfpy", "lxml", "xacro"} & sys.modules.keys()
from head_tracking.transforms.urdf_parser import parse_robot_model
here = parse_robot_model(child.urdf)
assert (child.name, child.links, child.joints) == (here.name, here.links, here.joints)
""")


@pytest.mark.parametrize("call", [("parse_robot_model", [robot(TWO_LINKS, joint())]), None])
def test_a_parsing_child_of_a_killed_program_is_silent(call):
    command = [sys.executable, "-m", "head_tracking.transforms.urdf_parser"]
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    with subprocess.Popen(command, **pipes) as child:
        child.stdout.close()
        child.stdin.write(pickle.dumps(call) if call else b"")
        child.stdin.close()
        assert child.stderr.read() == b""


def test_ctrl_c_in_all_processes_does_not_end_a_parsing_child():
    run("""
import os, signal, threading
from head_tracking.transforms.urdf import parse_in_child_process, parse_robot_model
signal.signal(signal.SIGINT, lambda *_: None)
def interrupt():
    while True:
        os.killpg(0, signal.SIGINT)
threading.Thread(target=interrupt, daemon=True).start()
parse_in_child_process()
for _ in range(2):
    parse_robot_model('<robot name="r"><link name="a"/></robot>')
""")
