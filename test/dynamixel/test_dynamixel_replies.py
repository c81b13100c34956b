"""Published packets, damaged replies and any bytes at all, through the port."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from simulated_device import Bench

from head_tracking.dynamixel import (
    Adapter,
    CommunicationError,
    DynamixelPort,
    ReplyTimeoutError,
    servo_model,
)
from head_tracking.dynamixel.protocol import (
    Status,
)
from head_tracking.dynamixel.reading import ReadGroup
from head_tracking.simulation import SimulatedServo


class ScriptedDevice:
    """Says one thing whatever is asked, and keeps what was.

    Attributes:
        answer: what it says.
    """

    adapter = Adapter()

    def __init__(self, answer: str) -> None:
        self.sent = ""
        self.answer = bytes.fromhex(answer)
        self._rest = b""

    def discard_input(self) -> None:
        pass

    def write(self, data: bytes) -> None:
        self.sent += data.hex(" ").upper()
        self._rest = self.answer

    def read(self, limit: int, deadline: float) -> bytes:
        data, self._rest = self._rest, b""
        return data

    def close(self) -> None:
        pass


def scripted(answer: str) -> tuple[DynamixelPort, ScriptedDevice]:
    device = ScriptedDevice(answer)
    port = DynamixelPort("scripted", reply_timeout=1e-6, open_device=lambda *_: device)  # type: ignore[arg-type,return-value]
    port.open()
    return port, device


def group(*ids: int) -> ReadGroup:
    """The present position of X servos."""
    return ReadGroup(2, 132, 4, ids)


READ = "FF FF 01 04 02 24 02 D2"
POSITION_512 = "FF FF 01 04 00 00 02 F8"
READ_2 = "FF FF FD 00 01 07 00 02 84 00 04 00 1D 15"
POSITION_166 = "FF FF FD 00 01 08 00 55 00 A6 00 00 00 8C C0"


@pytest.mark.parametrize(
    "noise",
    [
        "00",
        "FF",
        "00 01 02 03 04 05 06 07",
        "FF FF 02 04 00 FF 01 F9",  # an answer of another servo
        "FF FF FE 02 00 FF",
        "FF FF 01 02 80 7C",  # bit 7 of the error byte never occurs
        READ,  # the echo of an adapter
    ],
)
def test_noise_before_a_reply_is_skipped(noise: str) -> None:
    port, _ = scripted(f"{noise} {POSITION_512}")
    assert port.read(1, 36, 2).data == b"\x00\x02"


@pytest.mark.parametrize(
    "reply",
    [
        "FF FF 01 04 00 00 02 F9",  # checksum
        "FF FF 01 04 00 00",  # truncated
        "FF FF 01",
        "FF FF 01 02 08 F4",  # error without data: IndexError in the SDK
        "FF FF 01 02 00 FC",  # no data
        "FF FF 01 03 00 20 DB",  # one byte: the SDK takes the checksum for the second
        "FF FF 01 06 00 00 02 00 00 F6",  # too long
        "FF FF 01 00 00 FE",  # impossible length
        "FF FF 01 01 00 FD",
        "FF FF 01 04 10 00 02 E8",  # the servo received a damaged packet
    ],
)
def test_a_damaged_reply_is_an_error(reply: str) -> None:
    port, _ = scripted(reply)
    with pytest.raises(CommunicationError):
        port.read(1, 36, 2)


def test_the_late_reply_to_a_write_is_no_refusal_of_the_next_read() -> None:
    port, device = scripted("")
    with pytest.raises(ReplyTimeoutError):
        port.write(1, 24, b"\x00")
    device.answer = bytes.fromhex(f"FF FF 01 02 01 FB {POSITION_512}")  # error bit: low voltage
    assert port.read(1, 36, 2).data == b"\x00\x02"


pieces = st.one_of(
    st.binary(max_size=12),
    st.sampled_from([b"\xff\xff\x01", b"\xff\xff\xfd\x00\x01", b"\xff\xff\xfd\x00\xfe"]),
    st.sampled_from([READ, POSITION_512, READ_2, POSITION_166]).map(bytes.fromhex),
)
groups = st.builds(
    ReadGroup,
    st.sampled_from([1, 2]),
    st.just(36),
    st.sampled_from([2, 4]),
    st.sampled_from([(1,), (1, 2), (3, 1, 2)]),
    st.booleans(),
)


@given(st.lists(pieces, max_size=6).map(b"".join), groups)
def test_any_bytes_are_replies_of_the_right_length_or_errors(
    answer: bytes, group: ReadGroup
) -> None:
    port, _ = scripted(answer.hex())
    replies = port.read_group(group)
    assert len(replies) == len(group.ids)
    for reply in replies:
        assert isinstance(reply, CommunicationError) or len(reply.data) == group.length


def test_servos_are_read_together_and_a_missing_one_does_not_crash() -> None:
    model = servo_model("XM430-W350")
    bench = Bench([SimulatedServo(i, model) for i in (1, 3)])
    bench.port.open()
    whole = list(bench.port.read_group(group(1, 3)))
    assert [reply.data for reply in whole if isinstance(reply, Status)] == [b"\0\x08\0\0"] * 2
    broken = list(bench.port.read_group(group(1, 2, 3)))
    assert len(broken) == 3
    assert isinstance(broken[1], CommunicationError)
    again = list(bench.port.read_group(group(1, 3)))
    assert [reply.data for reply in again if isinstance(reply, Status)] == [b"\0\x08\0\0"] * 2


def test_all_servos_answer_a_broadcast_ping() -> None:
    bench = Bench([SimulatedServo(1, servo_model("XM430-W350")), SimulatedServo(7)])
    bench.port.open()
    assert {key: value[0] for key, value in bench.port.find_all().items()} == {1: 1020}
