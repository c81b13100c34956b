"""The parser by which servos hear packets of both protocols."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from simulated_packets import InstructionPacket, InstructionPacket2

from head_tracking.simulation.packets import DamagedPacket, PacketParser

MAX_GAP = {1: 100_000_000, 2: 10_000_000}
KINDS = {1: InstructionPacket, 2: InstructionPacket2}
TRICKY = st.lists(
    st.sampled_from((b"\xff", b"\xfd", b"\xff\xff\xfd", b"\x00", b"\xfe")), max_size=20
).map(b"".join)
"""Bytes full of headers and half headers."""
PARAMETERS = st.one_of(st.binary(max_size=60), TRICKY)
IDS = st.one_of(st.integers(0, 252), st.just(254))
both = pytest.mark.parametrize("kind", KINDS.values(), ids=("1.0", "2.0"))


GARBAGE = ("FF", "FF FF", "01 02 03", "FF FF FF", "FF FF 01 00", "FF FF 01 FF", "FF FF FD FD")


@both
def test_packets_behind_garbage_and_damaged_and_truncated_ones_are_found(kind):
    ping, read = kind.ping(1), kind.read(1, 36, 8)
    damaged = bytearray(kind.read(7, 36, 2).encode())
    damaged[-1] ^= 0x40
    for garbage in map(bytes.fromhex, GARBAGE):
        assert PacketParser(kind.PROTOCOL).feed(garbage + ping.encode(), 0) == [ping], garbage
    found = PacketParser(kind.PROTOCOL).feed(bytes(damaged) + ping.encode(), 0)
    assert found == [DamagedPacket(7), ping]
    truncated = read.encode()[:-2] + ping.encode()  # the ping is taken for the missing end
    found = PacketParser(kind.PROTOCOL).feed(truncated + read.encode(), 0)
    assert [packet for packet in found if not isinstance(packet, DamagedPacket)] == [read]


@both
@settings(max_examples=30)
@given(st.lists(PARAMETERS, max_size=8))
def test_parser_never_raises_and_recovers(kind, chunks):
    heard = PacketParser(kind.PROTOCOL)
    for chunk in chunks:
        heard.feed(chunk, 0)
        assert len(heard._held) <= 1100
    assert heard.feed(kind.ping(1).encode(), MAX_GAP[kind.PROTOCOL] + 1) == [kind.ping(1)]


@both
@settings(max_examples=30)
@given(st.data())
def test_parser_finds_all_packets_for_any_split(kind, data):
    codes = st.integers(0, 255)
    packets = data.draw(st.lists(st.builds(kind, IDS, codes, PARAMETERS), max_size=5))
    stream = b"".join(packet.encode() for packet in packets)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=10)))
    heard = PacketParser(kind.PROTOCOL)
    found = []
    for start, end in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        found += heard.feed(stream[start:end], 0)
    assert found == packets
