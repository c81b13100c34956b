"""Every model: its table, and every register of it through driver and simulator."""

from __future__ import annotations

import pytest
from simulated_device import Bench, joint_of

from head_tracking.dynamixel import (
    ConfigurationError,
    Goal,
    ServoModel,
    servo_model,
)
from head_tracking.dynamixel.control_table import Register
from head_tracking.dynamixel.exceptions import RangeError
from head_tracking.dynamixel.models import all_models, servo_model_by_number
from head_tracking.dynamixel.protocol import Instruction
from head_tracking.dynamixel.reading import ReadMethod
from head_tracking.dynamixel.servo import Servo
from head_tracking.simulation import SimulatedServo

every_model = pytest.mark.parametrize("model", all_models(), ids=lambda model: model.name)

ROBOTIS = {
    "AX-12": (12, 1),
    "AX-12W": (300, 1),
    "AX-18A": (18, 1),
    "RX-10": (10, 1),
    "RX-24F": (24, 1),
    "RX-28": (28, 1),
    "RX-64": (64, 1),
    "MX-12W": (360, 1),
    "MX-28": (29, 1),
    "MX-64": (310, 1),
    "MX-106": (320, 1),
    "MX-28(2.0)": (30, 2),
    "MX-64(2.0)": (311, 2),
    "MX-106(2.0)": (321, 2),
    "XL-320": (350, 2),
    "XL430-W250": (1060, 2),
    "XL330-M077": (1190, 2),
    "XL330-M288": (1200, 2),
    "XC330-M181": (1230, 2),
    "XC330-M288": (1240, 2),
    "XC330-T181": (1210, 2),
    "XC330-T288": (1220, 2),
    "XM430-W210": (1030, 2),
    "XM430-W350": (1020, 2),
    "XM540-W150": (1130, 2),
    "XM540-W270": (1120, 2),
    "XC430-W150": (1070, 2),
    "2XL430-W250": (1090, 2),
    "XH430-W350": (1000, 2),
    "XH540-V150": (1150, 2),
    "XW540-T140": (1180, 2),
}


def test_model_numbers_and_protocols_are_those_of_the_e_manual() -> None:
    own = [model for model in all_models() if model.family == "Dynamixel"]
    assert {m.name: (m.model_number, m.protocol) for m in own} == ROBOTIS


@every_model
def test_model_is_found_by_name_and_number(model: ServoModel) -> None:
    assert servo_model(model.name.lower()) is model
    same = model if model.name != "STS3215-C001" else servo_model("STS3215")  # for another voltage
    assert servo_model_by_number(model.model_number) is same
    assert all(servo_model(alias) is model for alias in model.aliases)


def test_unknown_model_names_those_that_are_known() -> None:
    with pytest.raises(
        ConfigurationError, match=r"'AX-99'; known are .*AX-12 \(12\), .*XM540-W270"
    ):
        servo_model("AX-99")
    with pytest.raises(ConfigurationError, match="number 4711"):
        servo_model_by_number(4711)


@every_model
def test_every_register_is_read_as_the_servo_holds_it_and_holds_what_the_vendor_says(
    model: ServoModel,
) -> None:
    servo = SimulatedServo(1, model)
    bench = Bench([servo])
    bench.port.open()
    link = Servo(bench.port, 1, model)
    alone = {register.name: link.get(register.name) for register in model.control_table}
    together = {register.name: value for register, value in link.registers()}
    bench.bus.advance(bench.now())
    moving = {"Realtime Tick"}
    for register in model.control_table:
        if register.name not in moving:
            assert alone[register.name] == servo.register(register.name), register.name
            assert together[register.name] == alone[register.name], register.name
        if register.initial is not None and register.name not in moving | {"Moving Status"}:
            initial = register.initial
            if register.name == "Goal Velocity":
                initial = servo.register("Velocity Limit")
            assert alone[register.name] == initial, register.name


def _settable(model: ServoModel) -> list[Register]:
    special = {"ID", "Baud Rate", "Status Return Level", "Torque Enable", "Lock", "Protocol Type"}
    modes = {"Operating Mode", "Control Mode", "Drive Mode", "Bus Watchdog", "Goal Position"}
    goals = {"Goal Velocity", "Current", "Goal Current", "Goal PWM", "Torque Ctrl Mode Enable"}
    return [r for r in model.control_table if r.writable and r.name not in special | modes | goals]


@every_model
def test_every_setting_is_written_and_kept_and_nothing_beyond_its_range_is_sent(
    model: ServoModel,
) -> None:
    servo = SimulatedServo(1, model)
    bench = Bench([servo])
    bench.port.open()
    link = Servo(bench.port, 1, model)
    for register in _settable(model):
        assert register.minimum is not None and register.maximum is not None
        if register.name.startswith("Indirect Data"):
            continue  # shows what its address points at
        before = link.get(register.name)
        value = min(register.maximum, max(register.minimum, before + (before < register.maximum)))
        link.set(register.name, value)
        assert servo.register(register.name) == value, register.name
        link.set(register.name, before)
        for beyond in (register.minimum - 1, register.maximum + 1):
            with pytest.raises(RangeError):
                link.set(register.name, beyond)
        assert servo.register(register.name) == before, register.name


@every_model
def test_joint_of_every_model_goes_where_it_is_sent(model: ServoModel) -> None:
    servos = [SimulatedServo(1, model), SimulatedServo(2, model)]
    bench = Bench(servos)
    bus = bench.servo_bus([joint_of(i, model, 100, model.ticks - 100) for i in (1, 2)])
    bus.connect()
    margin = 0
    if "CW Compliance Margin" in model.control_table:
        margin = model.control_table["CW Compliance Margin"].initial or 0
    goals = {"j1": Goal(0.3, 2.0), "j2": Goal(-0.2)}
    for _ in range(60):
        bus.command(goals)
        reading = bus.step()
        bench.pass_time(0.02)
    for name, goal in goals.items():
        state = reading.states[name]
        assert state.position == pytest.approx(
            goal.position, abs=0.012 + margin * model.radians_per_tick
        )
        assert state.goal is not None
    for servo in bus.servos:
        assert not servo.errors
        assert servo.voltage == pytest.approx(servos[0].supply_voltage, abs=0.11)
    assert bus.close() == ()
    assert [servo.register("Torque Enable") for servo in servos] == [0, 0]


_METHODS = {
    Instruction.READ: ReadMethod.EACH,
    Instruction.BULK_READ: ReadMethod.BULK,
    Instruction.SYNC_READ: ReadMethod.SYNC,
    Instruction.FAST_SYNC_READ: ReadMethod.FAST_SYNC,
}


def _first_methods(model: ServoModel, firmware: int = 50) -> object:
    """How two servos of a model are read, by what goes over the wire."""
    servos = [SimulatedServo(i, model) for i in (1, 2)]
    for servo in servos:
        servo.set_register("Firmware Version", firmware)
    bench = Bench(servos)
    bus = bench.servo_bus([joint_of(i, model) for i in (1, 2)])
    bus.connect()
    bus.step()
    sent: list[bytes] = []
    write = bench.line.write
    bench.line.write = lambda data, timeout: (sent.append(data), write(data, timeout))  # type: ignore[method-assign,assignment,func-returns-value]
    bus.step()
    codes = [packet[4 if model.protocol == 1 else 7] for packet in sent]
    return [_METHODS[Instruction(code)] for code in dict.fromkeys(codes)]


@pytest.mark.parametrize(
    ("name", "firmware", "method"),
    [
        ("AX-12", 24, ReadMethod.EACH),
        ("MX-28", 41, ReadMethod.BULK),
        ("MX-28(2.0)", 45, ReadMethod.SYNC),
        ("XL-320", 30, ReadMethod.SYNC),
        ("XM430-W350", 44, ReadMethod.SYNC),
        ("XM430-W350", 45, ReadMethod.FAST_SYNC),
        ("XL330-M288", 45, ReadMethod.SYNC),
        ("XL330-M288", 46, ReadMethod.FAST_SYNC),
    ],
)
def test_servos_are_read_with_as_few_packets_as_they_understand(
    name: str, firmware: int, method: ReadMethod
) -> None:
    assert _first_methods(servo_model(name), firmware) == [method]
