"""The parser by which servos hear packets of both protocols."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from head_tracking.dynamixel.protocol import Instruction, encode_packet, read_packet
from head_tracking.simulation.packets import DamagedPacket, Packet, PacketParser, decode

MAX_GAP = {1: 100_000_000, 2: 10_000_000}
PING = Packet(1, Instruction.PING)
TRICKY = st.lists(
    st.sampled_from((b"\xff", b"\xfd", b"\xff\xff\xfd", b"\x00", b"\xfe")), max_size=20
).map(b"".join)
"""Bytes full of headers and half headers."""
PARAMETERS = st.one_of(st.binary(max_size=60), TRICKY)
IDS = st.one_of(st.integers(0, 252), st.just(254))
both = pytest.mark.parametrize("protocol", [1, 2])


GARBAGE = ("FF", "FF FF", "01 02 03", "FF FF FF", "FF FF 01 00", "FF FF 01 FF", "FF FF FD FD")


@both
def test_packets_behind_garbage_and_damaged_and_truncated_ones_are_found(protocol):
    ping, read = encode_packet(protocol, *PING), read_packet(protocol, 1, 36, 8)
    damaged = bytearray(read_packet(protocol, 7, 36, 2))
    damaged[-1] ^= 0x40
    for garbage in map(bytes.fromhex, GARBAGE):
        assert PacketParser(protocol).feed(garbage + ping, 0) == [PING], garbage
    found = PacketParser(protocol).feed(bytes(damaged) + ping, 0)
    assert found == [DamagedPacket(7), PING]
    truncated = read[:-2] + ping  # the ping is taken for the missing end
    found = PacketParser(protocol).feed(truncated + read, 0)
    whole = [packet for packet in found if not isinstance(packet, DamagedPacket)]
    assert whole == [decode(protocol, read)]


@both
@settings(max_examples=30)
@given(st.lists(PARAMETERS, max_size=8))
def test_parser_never_raises_and_recovers(protocol, chunks):
    heard = PacketParser(protocol)
    for chunk in chunks:
        heard.feed(chunk, 0)
        assert len(heard._held) <= 1100
    assert heard.feed(encode_packet(protocol, *PING), MAX_GAP[protocol] + 1) == [PING]


@both
@settings(max_examples=30)
@given(st.data())
def test_parser_finds_all_packets_for_any_split(protocol, data):
    codes = st.integers(0, 255)
    packets = data.draw(st.lists(st.builds(Packet, IDS, codes, PARAMETERS), max_size=5))
    stream = b"".join(encode_packet(protocol, *packet) for packet in packets)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=10)))
    heard = PacketParser(protocol)
    found = []
    for start, end in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        found += heard.feed(stream[start:end], 0)
    assert found == packets
