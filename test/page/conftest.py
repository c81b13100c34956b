import pytest

for library in ("nicegui", "mcap_ros2"):
    pytest.importorskip(
        library, reason=f"{library} is missing: pip install -r requirements/viewer.txt"
    )
