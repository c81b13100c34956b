import io

import numpy as np
import pytest
import trimesh

from head_tracking.page.robot_shapes import described
from head_tracking.page.shapes import Box, Cylinder, Mesh, Missing, Sphere, mesh_file, robot_look
from head_tracking.transforms import parse_robot_model


def urdf(geometry: str, material: str = "") -> str:
    return (
        '<robot name="r"><material name="red"><color rgba="1 0 0 0.5"/></material>'
        f'<link name="a"><visual><origin xyz="1 2 3"/><geometry>{geometry}</geometry>{material}'
        "</visual></link></robot>"
    )


@pytest.mark.parametrize(
    ("geometry", "shape"),
    [
        ('<box size="1 2 3"/>', Box((1.0, 2.0, 3.0))),
        ('<cylinder radius="0.5" length="2"/>', Cylinder(0.5, 2.0)),
        ('<sphere radius="0.25"/>', Sphere(0.25)),
    ],
)
def test_simple_shapes(geometry, shape):
    look = robot_look(urdf(geometry, '<material name="red"/>'))
    (found,) = look.shapes
    assert found.geometry == shape
    assert found.T_link_shape.translation == (1.0, 2.0, 3.0)
    assert found.rgba == (1.0, 0.0, 0.0, 0.5)
    assert not look.notices


def test_the_robots_of_the_tutorials_are_shown_whole(robot):
    look = robot_look(robot.urdf)
    assert not look.notices
    assert {shape.link for shape in look.shapes} >= {"base_link", "camera_link", "head_pan_link"}


@pytest.fixture
def package(tmp_path):
    folder = tmp_path / "my_robot"
    folder.mkdir()
    trimesh.creation.box((1.0, 1.0, 1.0)).export(folder / "box.stl")
    (folder / "broken.stl").write_bytes(b"this is no mesh" * 10)
    (folder / "none.obj").write_text("v 0 0 0\n")
    return folder


@pytest.mark.parametrize(
    "address", ["package://my_robot/box.stl", "file://{}/box.stl", "{}/box.stl"]
)
def test_a_mesh_is_found_and_scaled(package, address):
    address = address.format(package)
    look = robot_look(
        urdf(f'<mesh filename="{address}" scale="2 2 2"/>'),
        {"my_robot": package}.get,
    )
    (shape,) = look.shapes
    assert isinstance(shape.geometry, Mesh)
    assert shape.geometry.mesh.extents == pytest.approx(np.array([2.0, 2.0, 2.0]))
    assert not look.notices


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("package://nobody/box.stl", "package 'nobody', which is not installed"),
        ("package://my_robot/missing.stl", "is not there: no file"),
        ("file:///nowhere/box.stl", "is not there: no file"),
        ("meshes/box.stl", "write package://"),
        ("http://example.com/box.stl", "of a kind that is not loaded"),
        ("package://my_robot/broken.stl", "package://my_robot/broken.stl"),
        ("package://my_robot/none.obj", "package://my_robot/none.obj"),
    ],
)
def test_a_mesh_that_can_t_be_shown_leaves_a_mark_and_a_notice(package, address, words):
    look = robot_look(urdf(f'<mesh filename="{address}"/>'), {"my_robot": package}.get)
    assert [type(shape.geometry) for shape in look.shapes] == [Missing]
    (notice,) = look.notices
    assert notice.startswith("a: ")
    assert words in notice


@pytest.mark.parametrize(
    ("geometry", "material"),
    [
        ('<box size="1 2"/>', ""),
        ('<sphere radius="0.25"/>', '<material name="m"><color rgba="1 2"/></material>'),
    ],
)
def test_a_shape_that_makes_no_sense_is_left_out(geometry, material):
    whole = '<link name="b"><visual><geometry><sphere radius="1"/></geometry></visual></link>'
    look = robot_look(urdf(geometry, material).replace("</robot>", f"{whole}</robot>"))
    assert [shape.link for shape in look.shapes] == ["b"]
    assert len(look.notices) == 1


def test_blanks_in_addresses_may_be_quoted(tmp_path):
    (tmp_path / "a b.stl").touch()
    assert mesh_file(f"file://{tmp_path}/a%20b.stl", lambda _: None) == tmp_path / "a b.stl"


def test_meshes_are_sent_in_a_format_that_keeps_their_colours(package, robot):
    box = trimesh.creation.box((1.0, 1.0, 1.0))
    box.visual.face_colors = np.tile([[200, 10, 10, 255]], (len(box.faces), 1))
    box.export(package / "red.ply")
    visual = '<visual><geometry><mesh filename="file://{}/{}"/></geometry></visual>'
    visuals = "".join(visual.format(package, name) for name in ("box.stl", "red.ply"))
    text = f'<robot name="r"><link name="a">{visuals}</link></robot>'
    found = described(parse_robot_model(text), robot_look(text), None, 1.0, "/mesh/")
    assert [shape["kind"] for shape in found.about["shapes"]] == ["mesh", "coloured"]
    assert [shape["mesh"] for shape in found.about["shapes"]] == ["/mesh/0", "/mesh/1"]
    for mesh, kind in zip(found.meshes, ("stl", "glb"), strict=True):
        again = trimesh.load(io.BytesIO(mesh), file_type=kind, force="mesh")
        assert again.extents == pytest.approx([1.0, 1.0, 1.0])
