"""config/head.rviz names the topics that the nodes use; RViz itself is not here to read it."""

from pathlib import Path

import yaml

CONFIG = Path(__file__).parents[2] / "config" / "head.rviz"


def test_rviz_is_told_the_topics_of_the_nodes():
    manager = yaml.safe_load(CONFIG.read_text())["Visualization Manager"]
    displays = {display["Class"].split("/")[1]: display for display in manager["Displays"]}
    assert displays["RobotModel"]["Description Topic"]["Value"] == "/robot_description"
    assert displays["RobotModel"]["Description Topic"]["Durability Policy"] == "Transient Local"
    assert displays["PointStamped"]["Topic"]["Value"] == "/target_point"
    assert displays["Marker"]["Topic"]["Value"] == "/target_point_marker"
    assert "TF" in displays
    assert manager["Global Options"]["Fixed Frame"] == "world"
