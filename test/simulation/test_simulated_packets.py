from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from simulated_golden_vectors import INSTRUCTIONS, STATUSES

from head_tracking.dynamixel import ErrorBits
from head_tracking.simulation import (
    DamagedPacket,
    InstructionPacket,
    InstructionParser,
    SimulationError,
    StatusPacket,
)
from head_tracking.simulation.stream_parser import MAX_GAP

PING = InstructionPacket.ping(1)
READ = InstructionPacket.read(1, 36, 8)
instructions = st.builds(
    InstructionPacket,
    id=st.integers(0, 254),
    instruction=st.integers(0, 255),
    parameters=st.binary(max_size=60),
)


@pytest.mark.parametrize(("text", "packet"), INSTRUCTIONS.values(), ids=INSTRUCTIONS)
def test_instruction_has_the_vendors_bytes(text: str, packet: InstructionPacket) -> None:
    assert packet.encode() == bytes.fromhex(text)
    assert InstructionPacket.decode(bytes.fromhex(text)) == packet


@pytest.mark.parametrize(("text", "packet"), STATUSES.values(), ids=STATUSES)
def test_status_has_the_vendors_bytes(text: str, packet: StatusPacket) -> None:
    assert packet.encode() == bytes.fromhex(text)
    assert StatusPacket.decode(bytes.fromhex(text)) == packet


@pytest.mark.parametrize(("text", "packet"), INSTRUCTIONS.values(), ids=INSTRUCTIONS)
def test_parser_finds_the_packet_at_every_split(text: str, packet: InstructionPacket) -> None:
    data = bytes.fromhex(text)
    for split in range(len(data) + 1):
        parser = InstructionParser()
        assert parser.feed(data[:split], 0) + parser.feed(data[split:], 1) == [packet]
        assert parser.pending == 0


def test_parser_finds_the_packet_byte_by_byte() -> None:
    parser = InstructionParser()
    found = [parser.feed(bytes((byte,)), 0) for byte in READ.encode()]
    assert found[-1] == [READ]
    assert not any(found[:-1])


def test_several_packets_in_one_read() -> None:
    assert InstructionParser().feed(PING.encode() + READ.encode(), 0) == [PING, READ]


@pytest.mark.parametrize(
    "garbage",
    ["00", "FF", "FF 00", "01 02 03", "FF FF FF", "FF FF 01 00", "FF FF 01 01", "FF FF 01 FF"],
)
def test_garbage_before_a_packet_is_skipped(garbage: str) -> None:
    assert InstructionParser().feed(bytes.fromhex(garbage) + READ.encode(), 0) == [READ]


def test_header_within_the_data_does_not_mislead() -> None:
    packet = InstructionPacket.write(1, 30, bytes.fromhex("FF FF 01 02"))
    assert InstructionParser().feed(packet.encode() + PING.encode(), 0) == [packet, PING]


def test_damaged_packet_is_reported_once_and_the_next_one_is_found() -> None:
    damaged = bytearray(READ.encode())
    damaged[-1] ^= 0x40
    found = InstructionParser().feed(bytes(damaged) + PING.encode(), 0)
    assert found == [DamagedPacket(1), PING]


def test_packet_behind_a_truncated_one_is_found() -> None:
    found = InstructionParser().feed(READ.encode()[:6] + PING.encode() + READ.encode(), 0)
    assert [packet for packet in found if isinstance(packet, InstructionPacket)] == [PING, READ]


def test_beginning_of_a_packet_is_dropped_after_the_gap() -> None:
    parser = InstructionParser()
    data = READ.encode()
    parser.feed(data[:5], 0)
    assert parser.feed(data[5:], MAX_GAP + 1) == []
    assert parser.feed(PING.encode(), MAX_GAP + 2) == [PING]


def test_beginning_of_a_packet_is_kept_within_the_gap() -> None:
    parser = InstructionParser()
    data = READ.encode()
    parser.feed(data[:5], 0)
    assert parser.feed(data[5:], MAX_GAP) == [READ]


@settings(deadline=None)
@given(st.lists(st.binary(max_size=40), max_size=20))
def test_parser_never_raises_and_keeps_little(chunks: list[bytes]) -> None:
    parser = InstructionParser()
    for chunk in chunks:
        parser.feed(chunk, 0)
        assert parser.pending < 250


@settings(deadline=None)
@given(st.lists(st.binary(max_size=40), max_size=10))
def test_parser_recovers_from_anything_after_a_gap(chunks: list[bytes]) -> None:
    parser = InstructionParser()
    for chunk in chunks:
        parser.feed(chunk, 0)
    assert parser.feed(READ.encode(), MAX_GAP + 1) == [READ]


@settings(deadline=None)
@given(st.lists(instructions, max_size=6), st.data())
def test_parser_finds_all_packets_however_they_are_cut(
    packets: list[InstructionPacket], data: st.DataObject
) -> None:
    stream = b"".join(packet.encode() for packet in packets)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=10)))
    parser = InstructionParser()
    found: list[InstructionPacket | DamagedPacket] = []
    for start, end in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        found += parser.feed(stream[start:end], 0)
    assert found == packets


@settings(deadline=None)
@given(instructions)
def test_decoding_mirrors_encoding(packet: InstructionPacket) -> None:
    assert InstructionPacket.decode(packet.encode()) == packet


@settings(deadline=None)
@given(st.integers(0, 253), st.integers(0, 127), st.binary(max_size=100))
def test_status_decoding_mirrors_encoding(servo_id: int, error: int, data: bytes) -> None:
    packet = StatusPacket(servo_id, ErrorBits(error), data)
    assert StatusPacket.decode(packet.encode()) == packet


@settings(deadline=None)
@given(st.binary(max_size=60))
def test_decoders_never_raise(data: bytes) -> None:
    packet = InstructionPacket.decode(data)
    assert packet is None or packet.encode() == data
    status = StatusPacket.decode(data)
    assert status is None or status.encode() == data


def test_too_many_parameters_are_refused() -> None:
    with pytest.raises(SimulationError, match="244"):
        InstructionPacket.write(1, 0, bytes(244)).encode()


def test_sync_write_gives_each_servo_its_share() -> None:
    packet = InstructionPacket.sync_write(30, {1: b"\x01\x02", 2: b"\x03\x04"})
    assert packet.sync_write_share(1) == (30, b"\x01\x02")
    assert packet.sync_write_share(2) == (30, b"\x03\x04")
    assert packet.sync_write_share(3) is None


@pytest.mark.parametrize("parameters", ["", "1E", "1E 00", "1E 02 01 02", "1E 02 01 02 03 02"])
def test_malformed_sync_write_has_no_shares(parameters: str) -> None:
    assert InstructionPacket(254, 0x83, bytes.fromhex(parameters)).sync_write_share(1) is None
