from importlib.util import find_spec

import pytest


@pytest.fixture(scope="session", autouse=True)
def opencv():
    if find_spec("cv2") is None:
        pytest.skip("needs OpenCV: pip install -r requirements/vision.txt")
