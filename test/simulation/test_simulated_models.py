"""Every register of every model, as packets see it."""

from __future__ import annotations

import pytest
from simulated_packets import InstructionPacket, InstructionPacket2, write

from head_tracking.dynamixel.control_table import Register
from head_tracking.dynamixel.models import ServoModel, all_models, servo_model
from head_tracking.dynamixel.protocol import REFUSALS, StatusCode
from head_tracking.simulation import SimulatedServo

OWN = {
    "ID",
    "Lock",
    "Status Return Level",
    "Torque Enable",
    "Secondary ID",
    "Bus Watchdog",
    "Current",
}
"""Registers that change what the servo does with the packets after them."""
LIMITED = {"Goal Position", "Moving Speed", "Goal Velocity", "Goal PWM", "Goal Current"}
"""Registers whose range is narrowed by others."""


def fits(register: Register, value: int) -> bool:
    """Whether a packet can carry a value."""
    signed = register.minimum is not None and register.minimum < 0
    limit = 256**register.size
    return -limit // 2 <= value < limit // 2 if signed else 0 <= value < limit


@pytest.mark.parametrize(
    "name", ["AX-12", "MX-28", "MX-28(2.0)", "XL-320", "XL330-M288", "XM430-W350"]
)
def test_registers_accept_exactly_their_range_if_they_are_writable(name: str) -> None:
    model = servo_model(name)
    refusal = 8 if model.protocol == 1 else StatusCode.ACCESS
    for register in model.control_table:
        if not register.writable:
            assert write(SimulatedServo(1, model), register.name, 0) == refusal, register
            continue
        if register.name in OWN or register.name.startswith("Indirect Data"):
            continue  # the latter stands for other registers
        assert register.minimum is not None and register.maximum is not None
        for value in (register.minimum, register.maximum):
            servo = SimulatedServo(1, model)
            error = write(servo, register.name, value)
            refused = error & (REFUSALS if model.protocol == 1 else 0x7F)
            assert (servo.register(register.name) == value) == (not refused), (register, value)
            if refused:
                assert register.name in LIMITED | {"Operating Mode"}, (register, value)
        for value in (register.minimum - 1, register.maximum + 1):
            servo = SimulatedServo(1, model)
            before = servo.register(register.name)
            assert not fits(register, value) or write(servo, register.name, value) != 0, register
            assert servo.register(register.name) == before


@pytest.mark.parametrize("model", all_models(), ids=lambda model: model.name)
def test_a_goal_speed_is_kept(model: ServoModel) -> None:
    servo = SimulatedServo(1, model)
    servo.advance(0)
    speed = round(0.3 * model.no_load_speed / model.speed_unit)
    goal = model.center + round(model.ticks * 0.4)
    write(servo, "Torque Enable", 1)
    data = model.encode_goal(goal, speed)
    kind = InstructionPacket if model.protocol == 1 else InstructionPacket2
    servo.execute(kind.write(1, model.goal.address, data), 0)
    way = model.ticks * 0.4 * model.radians_per_tick
    servo.advance(round(0.5 * way / (speed * model.speed_unit) * 1e9))
    assert servo.drive.speed == pytest.approx(speed * model.speed_unit, rel=0.06)
