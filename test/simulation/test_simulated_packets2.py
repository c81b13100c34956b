"""Packets of protocol 2.0 and the parser that finds them."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from simulated_golden_vectors import INSTRUCTIONS_2, STATUSES_2

from head_tracking.dynamixel.protocol import crc16
from head_tracking.simulation import (
    DamagedPacket2,
    InstructionPacket2,
    InstructionParser2,
    SimulationError,
    StatusPacket2,
)
from head_tracking.simulation.protocol2 import joint_status
from head_tracking.simulation.stream_parser import MAX_GAP

Packet = InstructionPacket2
PING = Packet.ping(1)
TRICKY = st.lists(
    st.sampled_from((b"\xff", b"\xfd", b"\xff\xff\xfd", b"\x00", b"\xfe")), max_size=20
).map(b"".join)
"""Bytes full of headers and half headers."""
PACKETS = st.builds(
    Packet,
    st.one_of(st.integers(0, 252), st.just(254)),
    st.integers(0, 255),
    st.one_of(st.binary(max_size=40), TRICKY),
)


def test_crc_is_the_published_one() -> None:
    assert crc16(b"123456789") == 0xFEE8


@pytest.mark.parametrize(("text", "packet"), INSTRUCTIONS_2.values(), ids=INSTRUCTIONS_2)
def test_instruction_has_the_vendors_bytes(text: str, packet: InstructionPacket2) -> None:
    assert packet.encode() == bytes.fromhex(text)
    assert InstructionPacket2.decode(bytes.fromhex(text)) == packet


@pytest.mark.parametrize(("text", "packet"), STATUSES_2.values(), ids=STATUSES_2)
def test_status_has_the_vendors_bytes(text: str, packet: StatusPacket2) -> None:
    assert packet.encode() == bytes.fromhex(text)
    assert StatusPacket2.decode(bytes.fromhex(text)) == packet


def test_joint_status_has_the_vendors_layout() -> None:
    shares = [StatusPacket2(i, 0, bytes((i, 0, 0, 0))) for i in (3, 7, 4)]
    packet = joint_status(shares, (4, 4, 4))
    assert packet[:8] == bytes.fromhex("FF FF FD 00 FE 19 00 55")
    for number, share in enumerate(shares):
        start = 8 + 8 * number
        assert packet[start : start + 6] == bytes((0, share.id)) + share.data
        assert crc16(packet[: start + 6]).to_bytes(2, "little") == packet[start + 6 : start + 8]


@pytest.mark.parametrize(("text", "packet"), INSTRUCTIONS_2.values(), ids=INSTRUCTIONS_2)
def test_parser_finds_the_packet_at_every_split(text: str, packet: InstructionPacket2) -> None:
    data = bytes.fromhex(text)
    for split in range(len(data) + 1):
        parser = InstructionParser2()
        assert parser.feed(data[:split], 0) + parser.feed(data[split:], 1) == [packet]


def test_header_within_stuffed_data_does_not_mislead() -> None:
    packet = Packet.write(1, 116, b"\xff\xff\xfd\x00\x01\x03\x00\x01\x19\x4e")
    assert packet.encode().count(b"\xff\xff\xfd\x00") == 1
    assert InstructionParser2().feed(packet.encode(), 0) == [packet]


@pytest.mark.parametrize("garbage", ["00", "FF", "FF FF", "FF FF FD", "FF FF FD FD", "01 FF FF 02"])
def test_garbage_before_a_packet_is_skipped(garbage: str) -> None:
    parser = InstructionParser2()
    assert parser.feed(bytes.fromhex(garbage) + PING.encode(), 0) == [PING]


def test_packet_with_a_wrong_crc_is_reported_once() -> None:
    data = bytearray(PING.encode())
    data[-1] ^= 1
    parser = InstructionParser2()
    assert parser.feed(bytes(data) + PING.encode(), 0) == [DamagedPacket2(1), PING]


@pytest.mark.parametrize("length", [0, 2, 2000])
def test_impossible_length_is_no_packet(length: int) -> None:
    data = b"\xff\xff\xfd\x00\x01" + length.to_bytes(2, "little") + b"\x01"
    assert InstructionParser2().feed(data + PING.encode(), 0) == [PING]


@pytest.mark.parametrize("servo_id", [253, 255])
def test_no_servo_has_that_id(servo_id: int) -> None:
    data = Packet(servo_id, 1).encode()
    assert InstructionParser2().feed(data + PING.encode(), 0) == [PING]


def test_too_great_a_length_swallows_until_the_gap() -> None:
    data = bytearray(PING.encode())
    data[5] = 60
    parser = InstructionParser2()
    assert parser.feed(bytes(data), 0) == []
    assert parser.feed(PING.encode(), MAX_GAP + 1) == [PING]


def test_beginning_of_a_packet_is_dropped_after_the_gap() -> None:
    parser = InstructionParser2(max_gap=1_500_000)
    data = PING.encode()
    assert parser.feed(data[:5], 0) == []
    assert parser.feed(data[5:], 1_500_001) == []
    assert parser.feed(data, 1_600_000) == [PING]


@settings(deadline=None)
@given(st.lists(PACKETS, max_size=5), st.data())
def test_parser_finds_all_packets_however_they_are_cut(
    packets: list[InstructionPacket2], data: st.DataObject
) -> None:
    stream = b"".join(packet.encode() for packet in packets)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=6)))
    parser = InstructionParser2()
    found = []
    for start, end in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        found += parser.feed(stream[start:end], 0)
    assert found == packets


@settings(deadline=None)
@given(st.lists(st.one_of(st.binary(max_size=60), TRICKY), max_size=8))
def test_parser_recovers_from_anything_after_a_gap(chunks: list[bytes]) -> None:
    parser = InstructionParser2()
    for chunk in chunks:
        parser.feed(chunk, 0)
        assert parser.pending <= 1100
    assert parser.feed(PING.encode(), MAX_GAP + 1) == [PING]


@given(PACKETS)
def test_decoding_mirrors_encoding(packet: InstructionPacket2) -> None:
    assert InstructionPacket2.decode(packet.encode()) == packet


@given(st.integers(0, 252), st.integers(0, 255), st.one_of(st.binary(max_size=40), TRICKY))
def test_status_decoding_mirrors_encoding(servo_id: int, error: int, data: bytes) -> None:
    packet = StatusPacket2(servo_id, error, data)
    assert StatusPacket2.decode(packet.encode()) == packet


@given(st.one_of(st.binary(max_size=40), TRICKY))
def test_decoders_never_raise(data: bytes) -> None:
    for frame in (data, b"\xff\xff\xfd\x00" + data):
        InstructionPacket2.decode(frame)
        StatusPacket2.decode(frame)


def test_too_many_parameters_are_refused() -> None:
    with pytest.raises(SimulationError, match="do not fit"):
        Packet.write(1, 0, bytes(1100)).encode()


@given(st.binary(max_size=30))
def test_malformed_shares_never_raise(parameters: bytes) -> None:
    for code in (0x82, 0x83, 0x8A, 0x92, 0x93, 0x9A):
        packet = Packet(254, code, parameters)
        packet.sync_share(1)
        packet.bulk_share(1)
        packet.reads()
