"""Every model: its table, and every register of it through driver and simulator."""

from __future__ import annotations

import pytest
from simulated_device import Bench, Rig, joint_of

from head_tracking.dynamixel import (
    ServoModel,
    servo_model,
)
from head_tracking.dynamixel.models import all_models
from head_tracking.dynamixel.protocol import Instruction
from head_tracking.dynamixel.servo import Servo
from head_tracking.simulation import SimulatedServo

every_model = pytest.mark.parametrize("model", all_models(), ids=lambda model: model.name)


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
    for register in model.control_table:
        assert alone[register.name] == servo.register(register.name), register.name
        assert together[register.name] == alone[register.name], register.name
        if register.initial is not None:
            initial = register.initial
            if register.name == "Goal Velocity":
                initial = servo.register("Velocity Limit")
            assert alone[register.name] == initial, register.name


@every_model
def test_joint_of_every_model_goes_where_it_is_sent(model: ServoModel) -> None:
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
def test_servos_are_read_with_as_few_packets_as_they_understand(
    name: str, instructions: list[Instruction]
) -> None:
    model = servo_model(name)
    rig = Rig(*(SimulatedServo(i, model) for i in (1, 2)))
    sent: list[bytes] = []
    write = rig.bench.line.write
    rig.bench.line.write = lambda data: (sent.append(data), write(data))  # type: ignore[method-assign,assignment,func-returns-value]
    rig.bus.step()
    assert [packet[4 if model.protocol == 1 else 7] for packet in sent] == instructions
