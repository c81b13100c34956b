"""The shapes of a robot for the browser."""

import io
import json

import numpy as np
import pytest
import trimesh

from head_tracking.page import robot_shapes
from head_tracking.page.robot_shapes import RobotForBrowser
from head_tracking.transforms import parse_robot_model


def shown(visuals: str, links: str = "") -> RobotForBrowser:
    """A robot whose link `a` has visuals."""
    text = (
        '<robot name="r"><material name="red"><color rgba="1 0 0 0.5"/></material>'
        f'<link name="a">{visuals}</link>{links}</robot>'
    )
    return RobotForBrowser(parse_robot_model(text), None, "/mesh/")


def visual(geometry: str, material: str = "") -> str:
    origin = '<origin xyz="1 2 3"/>'
    return f"<visual>{origin}<geometry>{geometry}</geometry>{material}</visual>"


@pytest.mark.parametrize(
    ("geometry", "kind", "size"),
    [
        ('<box size="1 2 3"/>', "box", [1.0, 2.0, 3.0]),
        ('<cylinder radius="0.5" length="2"/>', "cylinder", [0.5, 2.0]),
        ('<sphere radius="0.25"/>', "sphere", [0.25]),
    ],
)
def test_simple_shapes(geometry, kind, size):
    about = shown(visual(geometry, '<material name="red"/>')).about
    (found,) = about["shapes"]
    assert (found["kind"], found["size"], found["rgba"]) == (kind, size, [1.0, 0.0, 0.0, 0.5])
    assert found["place"][:3] == [1.0, 2.0, 3.0]
    assert not about["notices"]


def test_the_robots_of_the_tutorials_are_shown_whole(robot):
    about = RobotForBrowser(robot, None, "/mesh/").about
    assert not about["notices"]
    assert {shape["link"] for shape in about["shapes"]} >= {"base_link", "camera_link"}


@pytest.fixture
def package(tmp_path, monkeypatch):
    folder = tmp_path / "my_robot"
    folder.mkdir()
    trimesh.creation.box((1.0, 1.0, 1.0)).export(folder / "box.stl")
    red = trimesh.creation.box((1.0, 1.0, 1.0))
    red.visual.face_colors = np.tile([[200, 10, 10, 255]], (len(red.faces), 1))
    red.export(folder / "red.ply")
    (folder / "broken.stl").write_bytes(b"this is no mesh" * 10)
    (folder / "none.obj").write_text("v 0 0 0\n")
    monkeypatch.setattr(robot_shapes, "find_package", {"my_robot": folder}.get)
    return folder


@pytest.mark.parametrize(
    "address", ["package://my_robot/box.stl", "file://{}/box.stl", "{}/box.stl"]
)
def test_a_mesh_is_found_and_scaled(package, address):
    mesh = f'<mesh filename="{address.format(package)}" scale="2 2 2"/>'
    found = shown(visual(mesh))
    (sent,) = found.meshes
    again = trimesh.load(io.BytesIO(sent), file_type="stl", force="mesh")
    assert again.extents == pytest.approx([2.0, 2.0, 2.0])
    assert not found.about["notices"]


def test_meshes_are_sent_in_a_format_that_keeps_their_colours(package):
    meshes = (f'<mesh filename="{package}/{name}"/>' for name in ("box.stl", "red.ply"))
    found = shown("".join(map(visual, meshes)))
    shapes = [(shape["kind"], shape["mesh"]) for shape in found.about["shapes"]]
    assert shapes == [("mesh", "/mesh/0"), ("coloured", "/mesh/1")]
    for mesh, kind in zip(found.meshes, ("stl", "glb"), strict=True):
        again = trimesh.load(io.BytesIO(mesh), file_type=kind, force="mesh")
        assert again.extents == pytest.approx([1.0, 1.0, 1.0])


@pytest.mark.parametrize(
    "address",
    [
        "package://nobody/box.stl",
        "file:///nowhere/box.stl",
        "http://example.com/box.stl",
        "package://my_robot/broken.stl",
        "package://my_robot/none.obj",
    ],
)
def test_a_mesh_that_cannot_be_shown_is_left_out_and_named(package, address):
    found = shown(visual(f'<mesh filename="{address}"/>'))
    assert not found.about["shapes"]
    (notice,) = found.about["notices"]
    assert notice.startswith("a: ")
    assert address in notice


@pytest.mark.parametrize(
    ("geometry", "material"),
    [
        ('<box size="1 2"/>', ""),
        ('<sphere radius="0.25"/>', '<material name="m"><color rgba="nan 1 1 1"/></material>'),
        ('<box size="1 inf 1"/>', ""),
        ('<mesh filename="package://my_robot/box.stl" scale="1 nan 1"/>', ""),
    ],
)
def test_an_invalid_shape_is_left_out(package, geometry, material):
    link = '<link name="b"><visual><geometry><sphere radius="1"/></geometry></visual></link>'
    joint = '<joint name="j" type="fixed"><parent link="a"/><child link="b"/></joint>'
    robot = shown(visual(geometry, material), link + joint)
    about = robot.about
    assert [shape["link"] for shape in about["shapes"]] == ["b"]
    json.dumps([about, len(robot.meshes)], allow_nan=False)
    assert len(about["notices"]) == 1
