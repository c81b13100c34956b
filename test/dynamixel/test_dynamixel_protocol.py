"""Packets of both protocols: published vectors, ROBOTIS' own encoder, and any bytes at all."""

from __future__ import annotations

import pytest
from dynamixel_sdk import Protocol1PacketHandler, Protocol2PacketHandler
from hypothesis import given
from hypothesis import strategies as st

from head_tracking.dynamixel import CommunicationError
from head_tracking.dynamixel.protocol import (
    Instruction,
    Status,
    decode_status,
    encode_packet,
    find_packet,
)
from head_tracking.simulation import packets as simulated


class Catcher:
    """Takes the place of the SDK's port and keeps what is written."""

    is_using = False
    packet = b""

    def clearPort(self) -> None:
        pass

    def writePort(self, packet: list[int]) -> int:
        self.packet = bytes(packet)
        return len(packet)


@given(st.integers(0, 252), st.sampled_from([1, 2, 3, 4, 5, 6]), st.binary(max_size=60))
def test_packets_are_those_of_the_sdk(servo_id: int, code: int, parameters: bytes) -> None:
    port = Catcher()
    handler = Protocol1PacketHandler()
    size = len(parameters) + 2
    assert handler.txPacket(port, [0, 0, servo_id, size, code, *parameters, 0]) == 0
    assert encode_packet(1, servo_id, code, parameters) == port.packet
    if b"\xff\xff\xfd" in parameters:
        return  # the SDK does not stuff
    port.is_using = False
    words = [0, 0, 0, 0, servo_id, size + 1 & 0xFF, size + 1 >> 8, code, *parameters, 0, 0]
    assert Protocol2PacketHandler().txPacket(port, words) == 0
    assert encode_packet(2, servo_id, code, parameters) == port.packet


statuses = st.builds(
    simulated.Status,
    st.integers(0, 252),
    st.integers(0, 0x7F),
    st.lists(st.sampled_from([b"\xff", b"\xfd", b"\0", b"\x01"]), max_size=30).map(b"".join),
)
protocols = st.sampled_from([1, 2])


@given(protocols, statuses, st.binary(max_size=20).filter(lambda noise: b"\xff" not in noise))
def test_what_a_servo_sends_is_found_and_decoded(
    protocol: int, sent: simulated.Status, noise: bytes
) -> None:
    packet = simulated.encode_status(protocol, sent)
    found = find_packet(protocol, noise + packet)
    assert found == (packet, len(noise) + len(packet), False)
    assert decode_status(protocol, packet) == Status(*sent)


@pytest.mark.parametrize("protocol", [1, 2])
def test_packet_that_is_too_long_is_refused(protocol: int) -> None:
    with pytest.raises(CommunicationError):
        encode_packet(protocol, 1, Instruction.WRITE, bytes(2000))
