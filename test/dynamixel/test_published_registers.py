"""The tables of driver and simulator against a list that was copied from the vendor's pages.

`test/published/models.csv` has the models of ROBOTIS; `registers.csv` has what the pages of eight
of them and of both families of Feetech print: address, size, access, initial value, range and sign.
An empty cell is a value that the page does not print, or that the driver narrows.
"""

from __future__ import annotations

import csv
import math
from pathlib import Path

import pytest

from head_tracking.dynamixel import ConfigurationError, ServoModel, servo_model
from head_tracking.dynamixel.models import TABLES, all_models, read_model, servo_model_by_number
from head_tracking.simulation.models import registers_of, simulated_model

PUBLISHED = Path(__file__).parents[1] / "published"


def rows(name: str) -> list[dict[str, str]]:
    with (PUBLISHED / name).open(encoding="utf-8") as lines:
        return list(csv.DictReader(lines))


ROWS = rows("registers.csv")


def test_model_numbers_and_protocols_are_those_of_the_e_manual() -> None:
    own = {m.name: m for m in all_models() if m.family == "Dynamixel"}
    published = {row["model"]: (row["number"], row["protocol"]) for row in rows("models.csv")}
    assert {n: (str(m.model_number), str(m.protocol)) for n, m in own.items()} == published


def test_vendors_figures_of_an_ax_12() -> None:
    model = servo_model("AX-12")
    assert model.speed_unit == pytest.approx(0.0116239, abs=1e-7)
    assert model.no_load_speed == pytest.approx(6.178, abs=1e-3)
    assert model.radians_per_tick * model.ticks == pytest.approx(math.radians(300))


def test_every_model_is_found_by_name_and_number() -> None:
    for model in all_models():
        assert servo_model(model.name.lower()) is model
        assert all(servo_model(alias.lower()) is model for alias in model.aliases)
        if model.name != "STS3215-C001":  # the same for another voltage
            assert servo_model_by_number(model.model_number) is model
    with pytest.raises(ConfigurationError, match=r"'AX-99'.*AX-12 \(12\), .*XM540-W270"):
        servo_model("AX-99")
    with pytest.raises(ConfigurationError):
        servo_model_by_number(4711)


@pytest.mark.parametrize("name", sorted({row["model"] for row in ROWS}))
def test_registers_are_those_of_the_vendor(name: str) -> None:
    driver = servo_model(name).control_table
    simulator = {register.name: register for register in registers_of(name, 50)}
    for row in ROWS:
        if row["model"] != name:
            continue
        ours, theirs = driver[row["register"]], simulator[row["register"]]
        ranges = (ours.minimum, ours.maximum), (theirs.lowest, theirs.highest)
        for register, (lowest, highest) in zip((ours, theirs), ranges, strict=True):
            facts = {
                "address": register.address,
                "size": register.size,
                "access": "RW" if register.writable else "R",
                "initial": register.initial,
                "lowest": lowest,
                "highest": highest,
            }
            for fact, value in facts.items():
                assert row[fact] in ("", str(value)), (row["register"], fact)
        unsigned = f"bit {ours.sign_bit}" if ours.sign_bit else "none"
        assert row["sign"] in ("", "two's complement" if ours.signed else unsigned)
        assert theirs.signed == (row["sign"] == "two's complement"), row["register"]


NEW_MODEL = """
like = "XM430-W350"
name = "XM999-T1"
no_load_rpm = 100.0
aliases = ["XM999"]
watchdog = false
absent = ["LED"]

[registers]
"Model Number" = {initial = 9990}
"Velocity Limit" = {initial = 400}
"Extra 1-3" = {address = 700, size = 2, access = "RW", memory = "RAM", initial = 5, \
initial_step = 2, range = [0, 9]}
"""


def test_every_model_of_the_driver_can_be_simulated() -> None:
    for model in all_models():
        simulated = simulated_model(model)
        for fact in ("ticks", "center", "radians_per_tick", "endless", "no_load_speed"):
            assert getattr(simulated, fact) == pytest.approx(getattr(model, fact)), fact
        assert simulated.number == model.model_number
        names = {register.name for register in model.control_table}
        assert names == {register.name for register in registers_of(model.name, 50)}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for path in TABLES.glob("*.toml"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    return tmp_path


def add(folder: Path, text: str) -> ServoModel:
    path = folder / "new.toml"
    path.write_text(text, encoding="utf-8")
    return read_model(path)


def test_a_new_model_is_one_data_file(folder: Path) -> None:
    model, base = add(folder, NEW_MODEL), servo_model("XM430-W350")
    assert (model.name, model.model_number, model.aliases) == ("XM999-T1", 9990, ("XM999",))
    assert model.no_load_speed == pytest.approx(10.471976)
    assert (model.watchdog, model.offset) == (None, base.offset)
    table = model.control_table
    assert table["Velocity Limit"].initial == 400
    assert table["Velocity Limit"].address == base.control_table["Velocity Limit"].address
    assert "LED" not in table
    extra = [table[f"Extra {n}"] for n in (1, 2, 3)]
    assert [(each.address, each.initial) for each in extra] == [(700, 5), (702, 7), (704, 9)]
    assert model.feedback == base.feedback and model.goal == base.goal


@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        ('"XM430-W350"', '"XM430-W999"'),
        ("no_load_rpm", "no_load_speed"),
        ("initial_step", "initial_steps"),
        ('"RAM"', '"ROM"'),
        ("address = 700", "address = 116"),
        ('absent = ["LED"]', 'absent = ["Goal Position"]'),
        ("initial = 9990", "initial = 9990, unit = 'furlong'"),
        ("[registers]", "[registers"),
    ],
)
def test_a_file_that_describes_no_model_is_refused(folder: Path, right: str, wrong: str) -> None:
    assert right in NEW_MODEL
    with pytest.raises(ConfigurationError, match=r"new\.toml|W999"):
        add(folder, NEW_MODEL.replace(right, wrong))
