import pytest

from head_tracking.gaze import PanTiltHead


@pytest.fixture(scope="session")
def head(kinectbot):
    return PanTiltHead(
        kinectbot, "head_pan_joint", "head_tilt_joint", "camera_link", tilt_limits=(-1.08, 1.47)
    )
