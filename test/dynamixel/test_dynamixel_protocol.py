"""Packets of both protocols: published vectors, ROBOTIS' own encoder, and any bytes at all."""

from __future__ import annotations

import pytest
from dynamixel_sdk import Protocol1PacketHandler, Protocol2PacketHandler
from hypothesis import given
from hypothesis import strategies as st

from head_tracking.dynamixel import CommunicationError
from head_tracking.dynamixel.protocol import (
    BROADCAST_ID,
    MAX_ID,
    DamagedPacket,
    Instruction,
    Packet,
    PacketParser,
    Status,
    bulk_read_packet,
    decode_packet,
    encode_packet,
    encode_status,
    find_status,
    read_packet,
    sync_read_packet,
    sync_write_packet,
    write_packet,
)


@pytest.mark.parametrize(
    ("packet", "published"),
    [
        (encode_packet(1, 1, Instruction.PING), "FF FF 01 02 01 FB"),
        (read_packet(1, 1, 36, 8), "FF FF 01 04 02 24 08 CC"),
        (write_packet(1, 1, 30, b"\0\x02\x64\0"), "FF FF 01 07 03 1E 00 02 64 00 70"),
        (encode_packet(1, 254, Instruction.ACTION), "FF FF FE 02 05 FA"),
        (
            sync_write_packet(1, 30, {0: b"\x10\0\x50\x01", 1: b"\x20\x02\x60\x03"}),
            "FF FF FE 0E 83 1E 04 00 10 00 50 01 01 20 02 60 03 67",
        ),
        (bulk_read_packet((1, 2), 36, 2), "FF FF FE 09 92 00 02 01 24 02 02 24 17"),
        (encode_status(1, Status(1, 0, b"\x20")), "FF FF 01 03 00 20 DB"),
        (encode_packet(2, 1, Instruction.PING), "FF FF FD 00 01 03 00 01 19 4E"),
        (read_packet(2, 1, 132, 4), "FF FF FD 00 01 07 00 02 84 00 04 00 1D 15"),
        (
            write_packet(2, 1, 116, b"\xff\xff\xfd\0"),
            "FF FF FD 00 01 0A 00 03 74 00 FF FF FD FD 00 21 E7",
        ),
        (encode_packet(2, 1, Instruction.REBOOT), "FF FF FD 00 01 03 00 08 2F 4E"),
        (
            sync_read_packet((1, 2), 132, 4),
            "FF FF FD 00 FE 09 00 82 84 00 04 00 01 02 CE FA",
        ),
        (
            sync_read_packet((3, 7, 4), 132, 4, fast=True),
            "FF FF FD 00 FE 0A 00 8A 84 00 04 00 03 07 04 20 F2",
        ),
        (
            sync_write_packet(2, 116, {1: b"\x96\0\0\0", 2: b"\xaa\0\0\0"}),
            "FF FF FD 00 FE 11 00 83 74 00 04 00 01 96 00 00 00 02 AA 00 00 00 82 87",
        ),
        (
            encode_status(2, Status(1, 0, b"\xa6\0\0\0")),
            "FF FF FD 00 01 08 00 55 00 A6 00 00 00 8C C0",
        ),
        (encode_status(2, Status(1, 7)), "FF FF FD 00 01 04 00 55 07 B0 8C"),
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


any_packet = st.builds(
    Packet,
    st.one_of(st.integers(0, MAX_ID[2]), st.just(BROADCAST_ID)),
    st.integers(0, 0x7F),
    st.lists(st.sampled_from([b"\xff", b"\xfd", b"\0", b"\x01"]), max_size=30).map(b"".join),
)
protocols = st.sampled_from([1, 2])


@given(protocols, any_packet)
def test_what_is_encoded_is_decoded(protocol: int, packet: Packet) -> None:
    assert decode_packet(protocol, encode_packet(protocol, *packet)) == packet


@given(protocols, st.lists(any_packet, max_size=4), st.lists(st.integers(1, 9), min_size=1))
def test_a_stream_is_parsed_however_it_is_cut(
    protocol: int, packets: list[Packet], cuts: list[int]
) -> None:
    parser = PacketParser(protocol)
    stream = b"".join(encode_packet(protocol, *packet) for packet in packets)
    found: list[Packet | DamagedPacket] = []
    step = 0
    while stream:
        size = cuts[step % len(cuts)]
        found += parser.feed(stream[:size], step)
        stream = stream[size:]
        step += 1
    assert found == packets
    assert parser.pending == 0


@given(protocols, st.lists(st.binary(max_size=40), max_size=5))
def test_any_bytes_are_survived_and_do_not_hide_a_packet(
    protocol: int, pieces: list[bytes]
) -> None:
    parser = PacketParser(protocol, max_gap=1000)
    for time, piece in enumerate(pieces):
        parser.feed(piece, time)
    ping = encode_packet(protocol, 1, Instruction.PING)
    assert parser.feed(ping, 10_000)[-1] == Packet(1, Instruction.PING)


def test_damaged_packet_is_told_once_and_old_beginnings_are_dropped() -> None:
    parser = PacketParser(1, max_gap=100)
    damaged = bytes.fromhex("FF FF 01 04 02 24 02 D3")
    good = bytes.fromhex("FF FF 01 04 02 24 02 D2")
    assert parser.feed(damaged + good, 0) == [DamagedPacket(1), Packet(1, 2, b"\x24\x02")]
    parser.feed(good[:5], 10)
    assert parser.feed(good, 200) == [Packet(1, 2, b"\x24\x02")]


def test_echo_of_an_instruction_is_no_status_in_protocol_2() -> None:
    ping = encode_packet(2, 1, Instruction.PING)
    answer = encode_status(2, Status(1, 0, b"\x06\x04\x26"))
    assert find_status(2, ping).status is None
    assert find_status(2, ping + answer).status == Status(1, 0, b"\x06\x04\x26")


@pytest.mark.parametrize("protocol", [1, 2])
def test_packet_that_is_too_long_is_refused(protocol: int) -> None:
    with pytest.raises(CommunicationError, match="too long"):
        encode_packet(protocol, 1, Instruction.WRITE, bytes(2000))
