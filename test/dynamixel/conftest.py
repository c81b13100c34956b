import pytest
from dynamixel_fakes import FakeRig


@pytest.fixture
def rig() -> FakeRig:
    """Pan and tilt on a fake port."""
    return FakeRig()
