"""docs/explain/estimator.md lists the constants of tracking with their values."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PARTS = re.split(r"^`(\w+\.py)`$", (ROOT / "docs/explain/estimator.md").read_text(), flags=re.M)
TABLES = dict(zip(PARTS[1::2], PARTS[2::2], strict=True))


@pytest.mark.parametrize("name", TABLES)
def test_every_constant_is_listed_with_its_value_and_origin(name):
    (file,) = (ROOT / "head_tracking").rglob(f"*/{name}")
    rows = set(re.findall(r"^\| (`.*`) \| (.*?) \| .* \| [tbdp] \|$", TABLES[name], re.M))
    found = re.findall(r"^(_?[A-Z][A-Z_, ]*) = (\d[\de., +*/-]*?)(?=  #|$)", file.read_text(), re.M)
    assert rows >= {(", ".join(f"`{each}`" for each in names.split(", ")), value)
                    for names, value in found}  # fmt: skip
