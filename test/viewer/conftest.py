import pytest

pytest.importorskip("viser", reason="viser is missing: pip install -r requirements/viewer.txt")
