from __future__ import annotations

import pytest
from simulated_golden_vectors import INSTRUCTIONS, STATUSES
from simulated_packets import StatusPacket

from head_tracking.dynamixel.protocol import ErrorBits
from head_tracking.simulation import (
    SimulatedBus,
    SimulatedServo,
    SimulationError,
)

ANSWERS = {
    "ping 1": "ping",
    "read position": "position 512",
    "read 36..43": "36..43",
    "read model": "model 12",
    "torque on": "ping",
    "torque off": "ping",
    "goal 512": "ping",
    "goal 512, speed 100": "ping",
    "torque limit 1023": "ping",
}

UNKNOWN = ("reg write goal 500", "factory reset 0")


def golden(name: str) -> bytes:
    return bytes.fromhex(INSTRUCTIONS[name][0])


def bus() -> SimulatedBus:
    return SimulatedBus([SimulatedServo(0), SimulatedServo(1), SimulatedServo(2)])


@pytest.mark.parametrize("name", INSTRUCTIONS)
def test_published_instructions_get_published_answers(name: str) -> None:
    answers = [answer.data for answer in bus().receive(golden(name), 0)]
    if name == "read temperature":
        assert answers == [StatusPacket(1, data=b"\x1e").encode()]
    elif name in UNKNOWN:
        assert [StatusPacket.decode(answer)[1] for answer in answers] == [ErrorBits.INSTRUCTION]
    elif name in ANSWERS:
        assert answers == [bytes.fromhex(STATUSES[ANSWERS[name]][0])]
    else:
        assert answers == []  # broadcasts


def test_published_sync_write_sets_goals_and_speeds() -> None:
    b = bus()
    b.receive(golden("sync write goals and speeds"), 0)
    assert (b[1].register("Goal Position"), b[1].register("Moving Speed")) == (512, 100)
    assert (b[2].register("Goal Position"), b[2].register("Moving Speed")) == (300, 100)
    assert b[0].register("Torque Enable") == 0


def test_answers_wait_for_the_return_delay() -> None:
    b = bus()
    assert b.receive(golden("ping 1"), 0)[0].delay == 500_000
    b[1].set_register("Return Delay Time", 0)
    assert b.receive(golden("ping 1"), 0)[0].delay == 0


def test_wrong_checksum_is_answered_by_the_addressed_servo() -> None:
    data = bytearray(golden("read position"))
    data[-1] ^= 1
    answers = bus().receive(bytes(data), 0)
    assert [answer.data for answer in answers] == [bytes.fromhex(STATUSES["checksum"][0])]


def test_bus_needs_a_servo() -> None:
    with pytest.raises(SimulationError):
        SimulatedBus([])
