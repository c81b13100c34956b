"""Instructions that several servos answer in turn."""

from __future__ import annotations

import pytest
from simulated_packets import InstructionPacket, InstructionPacket2, StatusPacket, StatusPacket2

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


def test_bulk_read_reads_what_each_is_asked() -> None:
    published = "FF FF FD 00 FE 0D 00 92 01 90 00 02 00 02 92 00 01 00 1A 05"
    bus = SimulatedBus([SimulatedServo(i, "XM430-W350") for i in (1, 2)])
    answers = bus.receive(bytes.fromhex(published), 0)
    assert [StatusPacket2.decode(answer.data) for answer in answers] == [
        StatusPacket2(1, 0, (120).to_bytes(2, "little")),
        StatusPacket2(2, 0, bytes((30,))),
    ]


def test_bulk_read_of_protocol_1_is_for_mx_servos() -> None:
    published = bytes.fromhex("FF FF FE 09 92 00 02 01 1E 02 02 24 1D")
    servos = [SimulatedServo(i, "MX-28", position=1000 + i) for i in (1, 2)]
    answers = SimulatedBus(servos).receive(published, 0)
    assert [StatusPacket.decode(answer.data) for answer in answers] == [
        StatusPacket(1, data=(1001).to_bytes(2, "little")),
        StatusPacket(2, data=(1002).to_bytes(2, "little")),
    ]
    assert SimulatedBus([SimulatedServo(i, "AX-12") for i in (1, 2)]).receive(published, 0) == []
