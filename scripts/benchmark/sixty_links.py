"""A robot with 60 links, made from one with 15."""

from __future__ import annotations

from head_tracking.transforms import RobotModel, parse_robot_model

BASE = "base_link"
ARM = "arm_joint_"
_LOOK = '<visual><geometry><box size="0.05 0.02 0.02"/></geometry></visual>'


def sixty_links(model: RobotModel, *, visible: bool = False) -> RobotModel:
    """The robot with arms of 45 more links, all of whose joints move; `visible`: each is a box."""

    def parent(i: int) -> str:
        return f"arm_{i - 1}" if i % 15 else BASE

    look = _LOOK if visible else ""
    arms = "".join(
        f'<link name="arm_{i}">{look}</link><joint name="{ARM}{i}" type="revolute">'
        f'<parent link="{parent(i)}"/><child link="arm_{i}"/>'
        f'<origin xyz="0.1 0.02 0.05" rpy="0.1 0.2 0.3"/><axis xyz="0 0 1"/>'
        '<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
        for i in range(45)
    )
    return parse_robot_model(model.urdf.replace("</robot>", arms + "</robot>"))
