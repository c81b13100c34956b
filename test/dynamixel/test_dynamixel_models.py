"""Every model: its table, and every register of it through driver and simulator."""

import csv
import math
from dataclasses import replace
from operator import attrgetter
from pathlib import Path

import pytest
from dynamixel_fakes import PAN, TILT
from simulated_device import Bench, Rig, joint_of

from head_tracking.dynamixel import (
    ConfigurationError,
    JointConfiguration,
    ServoModel,
    check_configuration,
    servo_model,
)
from head_tracking.dynamixel.configuration import TemperatureParameters
from head_tracking.dynamixel.models import TABLES, all_models, read_model, servo_model_by_number
from head_tracking.dynamixel.protocol import Instruction
from head_tracking.dynamixel.servo import Servo
from head_tracking.simulation import SimulatedServo
from head_tracking.simulation.models import registers_of

every_model = pytest.mark.parametrize("model", all_models(), ids=lambda model: model.name)


@every_model
def test_every_register_is_read_as_the_servo_holds_it_and_holds_what_the_vendor_says(model):
    servo = SimulatedServo(1, model)
    bench = Bench([servo])
    bench.port.open()
    link = Servo(bench.port, 1, model)
    alone = {register.name: link.get(register.name) for register in model.control_table}
    together = {register.name: value for register, value in link.registers()}
    facts = attrgetter("address", "size", "signed", "writable", "eeprom")
    vendors = {r.name: r for r in registers_of(model.name, servo.register("Firmware Version"))}
    for register in model.control_table:
        assert facts(register) == facts(vendors[register.name]), register.name
        assert alone[register.name] == servo.register(register.name), register.name
        assert together[register.name] == alone[register.name], register.name
        if register.initial is not None:
            initial = register.initial
            if register.name == "Goal Velocity":
                initial = servo.register("Velocity Limit")
            assert alone[register.name] == initial, register.name


@every_model
def test_joint_of_every_model_goes_where_it_is_sent(model):
    servo = SimulatedServo(1, model)
    rig = Rig(servo, joints=[joint_of(1, model, 100, model.ticks - 100)])
    margin = 0
    if "CW Compliance Margin" in model.control_table:
        margin = model.control_table["CW Compliance Margin"].initial or 0
    rig.go(-0.3, 15, 2.0)  # speed and load have both signs
    state = rig.go(0.3, 45, 2.0).states["j1"]
    assert state.position == pytest.approx(0.3, abs=0.012 + margin * model.radians_per_tick)
    assert not rig.bus.servos[0].errors
    assert rig.bus.servos[0].voltage == pytest.approx(servo.supply_voltage, abs=0.11)
    assert rig.bus.close() == ()
    assert rig.torque == [0]


@pytest.mark.parametrize(
    ("name", "instructions"),
    [
        ("AX-12", [Instruction.READ] * 2),
        ("MX-28", [Instruction.BULK_READ]),
        ("MX-28(2.0)", [Instruction.SYNC_READ]),
        ("XL-320", [Instruction.SYNC_READ]),
        ("XM430-W350", [Instruction.SYNC_READ]),
        ("STS3215", [Instruction.SYNC_READ]),
    ],
)
def test_servos_are_read_with_as_few_packets_as_they_understand(name, instructions):
    model = servo_model(name)
    rig = Rig(*(SimulatedServo(i, model) for i in (1, 2)))
    rig.step()  # the first one also asks whether torque is on
    sent = []
    write = rig.bench.line.write
    rig.bench.line.write = lambda data: (sent.append(data), write(data))
    rig.bus.step()
    assert [packet[4 if model.protocol == 1 else 7] for packet in sent] == instructions


# The tables of driver and simulator against a list that was copied from the vendor's pages

# `test/published/models.csv` has the models of ROBOTIS; `registers.csv` has what the pages of eight
# of them and of both families of Feetech print: address, size, access, initial value, range and
# sign. An empty cell is a value that the page does not print, or that the driver narrows.

PUBLISHED = Path(__file__).parents[1] / "published"


def rows(name: str) -> list[dict[str, str]]:
    with (PUBLISHED / name).open(encoding="utf-8") as lines:
        return list(csv.DictReader(lines))


ROWS = rows("registers.csv")


def test_model_numbers_and_protocols_are_those_of_the_e_manual():
    own = {m.name: m for m in all_models() if m.family == "Dynamixel"}
    published = {row["model"]: (row["number"], row["protocol"]) for row in rows("models.csv")}
    assert {n: (str(m.model_number), str(m.protocol)) for n, m in own.items()} == published


def test_vendors_figures_of_an_ax_12():
    model = servo_model("AX-12")
    assert model.speed_unit == pytest.approx(0.0116239, abs=1e-7)
    assert model.no_load_speed == pytest.approx(6.178, abs=1e-3)
    assert model.radians_per_tick * model.ticks == pytest.approx(math.radians(300))


def test_every_model_is_found_by_name_and_number():
    for model in all_models():
        assert servo_model(model.name.lower()) is model
        assert all(servo_model(alias.lower()) is model for alias in model.aliases)
        if model.name != "STS3215-C001":  # the same for another voltage
            assert servo_model_by_number(model.model_number) is model
    with pytest.raises(ConfigurationError, match=r"'AX-99'.*AX-12 \(12\), .*XM540-W270"):
        servo_model("AX-99")
    with pytest.raises(ConfigurationError, match=r"is AX-12\b.* meant"):
        servo_model("ax12")
    with pytest.raises(ConfigurationError):
        servo_model_by_number(4711)


@pytest.mark.parametrize("name", sorted({row["model"] for row in ROWS}))
def test_registers_are_those_of_the_vendor(name):
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


@pytest.fixture
def folder(tmp_path):
    for path in TABLES.glob("*.toml"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    return tmp_path


def add(folder: Path, text: str) -> ServoModel:
    path = folder / "new.toml"
    path.write_text(text, encoding="utf-8")
    return read_model(path)


def test_a_new_model_is_one_data_file(folder):
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
        ('like = "XM430', 'model_number = 12\nlike = "XM430'),  # it has its place in [registers]
    ],
)
def test_a_file_that_describes_no_model_is_refused(folder, right, wrong):
    assert right in NEW_MODEL
    with pytest.raises(ConfigurationError, match=r"new\.toml|W999"):
        add(folder, NEW_MODEL.replace(right, wrong, 1))


# The configuration of joints

REVERSED = JointConfiguration("head_pan_joint", 1, 500, 800, 200, controller="head_pan_controller")


@pytest.mark.parametrize(
    "joint", [PAN, TILT, REVERSED, replace(PAN, init=0), replace(PAN, init=1023)]
)
def test_every_tick_round_trips(joint):
    for tick in range(1024):
        assert joint.ticks(joint.position(tick)) == tick


def test_zero_is_at_init_and_positions_of_a_reversed_servo_fall_with_ticks():
    joint = replace(PAN, init=400)
    assert joint.position(400) == 0.0
    assert joint.position(401) == pytest.approx(math.radians(300.0) / 1024)
    assert REVERSED.direction == -1
    assert REVERSED.position(501) == pytest.approx(-PAN.resolution)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("min", [-1]),
        ("max", [1024, True]),  # 1024 is the tutorial's
        ("init", [1024, 512.0]),
        ("id", [254, -1, "1"]),
        ("model", ["AX-12"]),
        ("joint_name", [" "]),
        ("controller", [""]),
        ("joint_speed", [math.nan, 0.0, -1.0, 100.0, "fast"]),
        ("max_speed", [math.inf, 0.0]),
        ("reverse", [True]),  # an AX-12 has no such setting
    ],
)
def test_impossible_configuration_is_refused(name, values):
    for value in values:
        with pytest.raises(ConfigurationError, match=name):
            replace(PAN, **{name: value})


@pytest.mark.parametrize(
    ("low", "zero", "high"), [(300, 200, 1023), (800, 900, 200), (512, 512, 512)]
)
def test_a_zero_outside_the_range_is_refused(low, zero, high):
    with pytest.raises(ConfigurationError, match="min"):
        replace(PAN, min=low, init=zero, max=high)


@pytest.mark.parametrize("name", ["id", "joint_name", "controller"])
def test_joints_may_not_share_and_a_bus_has_one(name):
    other = replace(TILT, **{name: getattr(PAN, name)})
    with pytest.raises(ConfigurationError):
        check_configuration([])
    with pytest.raises(ConfigurationError, match=name):
        check_configuration([PAN, other])


@pytest.mark.parametrize(
    "option",
    [
        *({"warn": value} for value in (66.0, -math.inf)),
        {"error": 69.0},
        *({"rest": value} for value in (math.nan, math.inf)),
    ],
)
def test_senseless_temperatures_are_refused(option):
    with pytest.raises(ConfigurationError):
        TemperatureParameters(**option)
