import pytest

pytest.importorskip(
    "mcap_ros2", reason="mcap_ros2 is missing: pip install -r requirements/viewer.txt"
)
