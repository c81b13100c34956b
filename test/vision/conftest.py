import pytest

pytest.importorskip("cv2", reason="needs OpenCV: pip install -r requirements/vision.txt")
