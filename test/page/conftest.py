import pytest

pytest.importorskip("nicegui", reason="nicegui is missing: pip install 'nicegui>=3.18,<4'")
