"""Instructions that several servos answer in turn."""

from __future__ import annotations

import pytest
from simulated_packets import InstructionPacket, InstructionPacket2

from head_tracking.dynamixel.models import servo_model
from head_tracking.simulation import SimulatedBus, SimulatedServo
from head_tracking.simulation.serial_line import SerialLine


@pytest.mark.parametrize("paced", [False, True])
@pytest.mark.parametrize(("model", "address"), [("STS3215", 56), ("XM430-W350", 132)])
def test_answers_without_a_return_delay_do_not_collide(
    model: str, address: int, paced: bool
) -> None:
    """lerobot sets the return delay of Feetech servos to 0."""
    b = SimulatedBus([SimulatedServo(i, servo_model(model)) for i in (1, 2)])
    for servo_id in (1, 2):
        b[servo_id].set_register("Return Delay Time", 0)
    asked = InstructionPacket2.sync_read(address, 2, (1, 2)).encode()
    if model == "STS3215":
        asked = InstructionPacket(254, 0x82, bytes((address, 2, 1, 2))).encode()
    alone = b.receive(asked, 0)
    assert [answer.delay for answer in alone] == [0, 0]
    line = SerialLine(b, paced=paced)
    line.send(asked, 0, 1_000_000)
    assert line.receive(10_000_000) == b"".join(answer.data for answer in alone)
    assert not line.overlaps
