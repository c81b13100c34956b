"""Every model moves as its packets say."""

from __future__ import annotations

import pytest
from simulated_packets import InstructionPacket, InstructionPacket2, write

from head_tracking.dynamixel.models import ServoModel, all_models
from head_tracking.simulation import SimulatedServo


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
