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
    bulk_read_packet,
    decode_status,
    encode_packet,
    find_packet,
    read_packet,
    sync_read_packet,
    sync_write_packet,
    write_packet,
)
from head_tracking.simulation import packets as simulated


@pytest.mark.parametrize(
    ("packet", "published"),
    [
        (encode_packet(1, 1, Instruction.PING), "FF FF 01 02 01 FB"),
        (read_packet(1, 1, 36, 8), "FF FF 01 04 02 24 08 CC"),
        (write_packet(1, 1, 30, b"\0\x02\x64\0"), "FF FF 01 07 03 1E 00 02 64 00 70"),
        (encode_packet(1, 254, 5), "FF FF FE 02 05 FA"),
        (
            sync_write_packet(1, 30, {0: b"\x10\0\x50\x01", 1: b"\x20\x02\x60\x03"}),
            "FF FF FE 0E 83 1E 04 00 10 00 50 01 01 20 02 60 03 67",
        ),
        (bulk_read_packet((1, 2), 36, 2), "FF FF FE 09 92 00 02 01 24 02 02 24 17"),
        (encode_packet(2, 1, Instruction.PING), "FF FF FD 00 01 03 00 01 19 4E"),
        (read_packet(2, 1, 132, 4), "FF FF FD 00 01 07 00 02 84 00 04 00 1D 15"),
        (
            write_packet(2, 1, 116, b"\xff\xff\xfd\0"),
            "FF FF FD 00 01 0A 00 03 74 00 FF FF FD FD 00 21 E7",
        ),
        (encode_packet(2, 1, Instruction.REBOOT), "FF FF FD 00 01 03 00 08 2F 4E"),
        (
            sync_read_packet(2, (1, 2), 132, 4),
            "FF FF FD 00 FE 09 00 82 84 00 04 00 01 02 CE FA",
        ),
        (
            sync_read_packet(2, (3, 7, 4), 132, 4, fast=True),
            "FF FF FD 00 FE 0A 00 8A 84 00 04 00 03 07 04 20 F2",
        ),
        (
            sync_write_packet(2, 116, {1: b"\x96\0\0\0", 2: b"\xaa\0\0\0"}),
            "FF FF FD 00 FE 11 00 83 74 00 04 00 01 96 00 00 00 02 AA 00 00 00 82 87",
        ),
    ],
)  # fmt: skip
def test_published_vectors(packet: bytes, published: str) -> None:
    assert packet.hex(" ").upper() == published


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


@pytest.mark.parametrize(
    ("protocol", "packet", "status"),
    [
        (1, "FF FF 01 03 00 20 DB", Status(1, 0, b"\x20")),
        (1, "FF FF 01 04 20 00 02 D8", Status(1, 32, b"\0\x02")),
        (1, "FF FF 01 02 24 D8", Status(1, 36)),
        (2, "FF FF FD 00 01 08 00 55 00 A6 00 00 00 8C C0", Status(1, 0, b"\xa6\0\0\0")),
        (2, "FF FF FD 00 01 08 00 55 00 FF FF FF FF 96 38", Status(1, 0, b"\xff" * 4)),
        (2, "FF FF FD 00 01 04 00 55 07 B0 8C", Status(1, 7)),
    ],
)
def test_published_replies(protocol: int, packet: str, status: Status) -> None:
    data = bytes.fromhex(packet)
    assert find_packet(protocol, data) == (data, len(data), False)
    assert decode_status(protocol, data) == status


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
    assert decode_status(protocol, packet) == sent


@given(protocols, st.lists(st.binary(max_size=40), max_size=5).map(b"".join))
def test_any_bytes_are_survived_and_do_not_hide_a_packet(protocol: int, noise: bytes) -> None:
    reply = simulated.encode_status(protocol, simulated.Status(7, 0, b"\x01\x02"))
    rest, found = noise + reply, []
    while (packet := find_packet(protocol, rest)).packet:
        found.append(packet.packet)
        rest = rest[packet.end :]
    assert found[-1] == reply or reply in found[-1]


@pytest.mark.parametrize(
    ("protocol", "damaged", "good"),
    [
        (1, "FF FF 01 04 02 24 02 D3", "FF FF 01 04 00 00 02 F8"),
        (2, "FF FF FD 00 01 04 00 55 07 B0 8D", "FF FF FD 00 01 04 00 55 00 A1 0C"),
    ],
)
def test_damaged_packet_before_a_good_one_is_reported(
    protocol: int, damaged: str, good: str
) -> None:
    assert find_packet(protocol, bytes.fromhex(damaged)) == (b"", 0, True)
    both = bytes.fromhex(damaged + good)
    assert find_packet(protocol, both) == (bytes.fromhex(good), len(both), True)


def test_echo_of_an_instruction_is_no_status_in_protocol_2() -> None:
    ping = encode_packet(2, 1, Instruction.PING)
    assert find_packet(2, ping).packet == ping
    assert decode_status(2, ping) is None


@pytest.mark.parametrize("protocol", [1, 2])
def test_packet_that_is_too_long_is_refused(protocol: int) -> None:
    with pytest.raises(CommunicationError, match="too long"):
        encode_packet(protocol, 1, Instruction.WRITE, bytes(2000))
