"""The real port on a pty: exact bytes out, all kinds of bytes back."""

from __future__ import annotations

import errno
import os
import threading
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest
import serial
from hypothesis import given, settings
from hypothesis import strategies as st
from serial.tools import list_ports
from waiting import eventually

from head_tracking.dynamixel import (
    Adapter,
    CommunicationError,
    ConfigurationError,
    CorruptReplyError,
    DynamixelPort,
    ErrorBits,
    NotConnectedError,
    PortBusyError,
    PortError,
    PortLostError,
    PortMissingError,
    PortPermissionError,
    ReadGroup,
    ReadMethod,
    ReplyTimeoutError,
    Status,
    serial_ports,
)
from head_tracking.dynamixel import port as port_module
from head_tracking.dynamixel.serial_port import port_error

READ = "FF FF 01 04 02 24 02 D2"
POSITION_512 = "FF FF 01 04 00 00 02 F8"
PONG = "FF FF 01 02 00 FC"


class Peer:
    """The other end of a pty: for each packet that comes in, says the next line of a script."""

    def __init__(self) -> None:
        self.master, self.slave = os.openpty()
        tty.setraw(self.slave)
        self.name = os.ttyname(self.slave)
        self.received: list[str] = []
        self._thread: threading.Thread | None = None

    def answer(self, *script: tuple[int, str]) -> None:
        """Answer packets: for each pair, read so many bytes, then say the text."""

        def play() -> None:
            for length, text in script:
                data = b""
                while len(data) < length:
                    data += os.read(self.master, length - len(data))
                self.received.append(data.hex(" ").upper())
                if text:
                    os.write(self.master, bytes.fromhex(text))

        self._thread = threading.Thread(target=play, daemon=True)
        self._thread.start()

    def finish(self) -> list[str]:
        """Return what came in."""
        assert self._thread is not None
        self._thread.join(10.0)
        assert not self._thread.is_alive()
        return self.received

    def vanish(self) -> None:
        os.close(self.master)
        os.close(self.slave)
        self.master = self.slave = -1

    def close(self) -> None:
        for descriptor in (self.master, self.slave):
            if descriptor >= 0:
                os.close(descriptor)


@pytest.fixture
def peer() -> Iterator[Peer]:
    p = Peer()
    yield p
    p.close()


@pytest.fixture
def port(peer: Peer) -> Iterator[DynamixelPort]:
    # Patient, because the other end is a thread on a machine that may be busy.
    p = DynamixelPort(peer.name, reply_timeout=5.0)
    p.open()
    yield p
    p.close()


@pytest.fixture
def hasty(peer: Peer) -> Iterator[DynamixelPort]:
    """For tests in which the answer never comes."""
    p = DynamixelPort(peer.name, reply_timeout=0.02)
    p.open()
    yield p
    p.close()


Call = Callable[[DynamixelPort], object]


@pytest.mark.parametrize(
    ("call", "sent", "reply", "result"),
    [
        (lambda p: p.ping(1), "FF FF 01 02 01 FB", PONG, ErrorBits(0)),
        (
            lambda p: p.read(1, 43, 1),
            "FF FF 01 04 02 2B 01 CC",
            "FF FF 01 03 00 20 DB",
            Status(1, ErrorBits(0), b"\x20"),
        ),
        (lambda p: p.read(1, 36, 2), READ, POSITION_512, Status(1, ErrorBits(0), b"\x00\x02")),
        (
            lambda p: p.read(1, 36, 8),
            "FF FF 01 04 02 24 08 CC",
            "FF FF 01 0A 00 00 02 00 00 00 00 78 1E 5C",
            Status(1, ErrorBits(0), bytes.fromhex("00 02 00 00 00 00 78 1E")),
        ),
        (
            lambda p: p.read(1, 0, 2),
            "FF FF 01 04 02 00 02 F6",
            "FF FF 01 04 00 0C 00 EE",
            Status(1, ErrorBits(0), b"\x0c\x00"),
        ),
        (
            lambda p: p.read(1, 36, 2),
            READ,
            "FF FF 01 04 20 00 02 D8",
            Status(1, ErrorBits.OVERLOAD, b"\x00\x02"),
        ),
        (lambda p: p.write(1, 24, b"\x01"), "FF FF 01 04 03 18 01 DE", PONG, ErrorBits(0)),
        (lambda p: p.write(1, 24, b"\x00"), "FF FF 01 04 03 18 00 DF", PONG, ErrorBits(0)),
        (
            lambda p: p.write(1, 30, b"\x00\x02"),
            "FF FF 01 05 03 1E 00 02 D6",
            "FF FF 01 02 02 FA",
            ErrorBits.ANGLE_LIMIT,
        ),
        (
            lambda p: p.write(1, 30, b"\x00\x02\x64\x00"),
            "FF FF 01 07 03 1E 00 02 64 00 70",
            "FF FF 01 02 08 F4",
            ErrorBits.RANGE,
        ),
        (
            lambda p: p.write(1, 34, b"\xff\x03"),
            "FF FF 01 05 03 22 FF 03 D2",
            "FF FF 01 02 24 D8",
            ErrorBits.OVERLOAD | ErrorBits.OVERHEATING,
        ),
        (
            lambda p: p.write(1, 24, b"\x01", acknowledged=False),
            "FF FF 01 04 03 18 01 DE",
            "",
            ErrorBits(0),
        ),
        (
            lambda p: p.sync_write(30, {0: b"\x10\x00\x50\x01", 1: b"\x20\x02\x60\x03"}),
            "FF FF FE 0E 83 1E 04 00 10 00 50 01 01 20 02 60 03 67",
            "",
            None,
        ),
        (
            lambda p: p.sync_write(30, {1: b"\x00\x02", 2: b"\x2c\x01"}),
            "FF FF FE 0A 83 1E 02 01 00 02 02 2C 01 22",
            "",
            None,
        ),
        (
            lambda p: p.sync_write(30, {1: b"\x00\x02\x64\x00", 2: b"\x2c\x01\x64\x00"}),
            "FF FF FE 0E 83 1E 04 01 00 02 64 00 02 2C 01 64 00 54",
            "",
            None,
        ),
    ],
)
def test_golden_packets(
    peer: Peer, port: DynamixelPort, call: Call, sent: str, reply: str, result: object
) -> None:
    peer.answer((len(bytes.fromhex(sent)), reply))
    told = call(port)
    assert (told._replace(stamp=0.0) if isinstance(told, Status) else told) == result
    assert peer.finish() == [sent]


@pytest.mark.parametrize(
    "noise",
    [
        "00",
        "FF",
        "00 01 02 03 04 05 06 07",
        "FF FF 02 04 00 FF 01 F9",  # an answer of another servo
        "FF FF FE 02 00 FF",
        "FF FF 01 02 80 7C",  # bit 7 of the error byte never occurs
    ],
)
def test_noise_before_the_answer_is_skipped(peer: Peer, port: DynamixelPort, noise: str) -> None:
    peer.answer((8, f"{noise} {POSITION_512}"))
    assert port.read(1, 36, 2).data == b"\x00\x02"


def test_answer_in_pieces_is_put_together(peer: Peer, port: DynamixelPort) -> None:
    peer.answer((8, "FF FF 01"), (0, "04 00 00"), (0, "02"), (0, "F8"))
    assert port.read(1, 36, 2).data == b"\x00\x02"


def test_silence_is_a_timeout(hasty: DynamixelPort) -> None:
    with pytest.raises(ReplyTimeoutError):
        hasty.read(1, 36, 2)


def test_waiting_costs_hardly_any_processor_time(peer: Peer) -> None:
    """The SDK's own waiting spins for as long as the timeout lasts."""
    port = DynamixelPort(peer.name, reply_timeout=0.5)
    port.open()
    before = time.thread_time()
    with pytest.raises(ReplyTimeoutError):
        port.ping(1)
    assert time.thread_time() - before < 0.25
    port.close()


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
def test_damaged_answer_is_never_a_value_nor_a_crash(
    peer: Peer, hasty: DynamixelPort, reply: str
) -> None:
    peer.answer((8, reply))
    with pytest.raises(CommunicationError):
        while True:  # the peer may be slower than a hasty timeout
            try:
                hasty.read(1, 36, 2)
            except ReplyTimeoutError:
                if peer.received:
                    raise
    peer.finish()


@pytest.mark.parametrize(
    ("reply", "message"),
    [
        ("FF FF 01 02 08 F4", "answered .*read of 2.* with 0 byte.*range"),
        ("FF FF 01 03 00 20 DB", "with 1 byte"),
        ("FF FF 01 06 00 00 02 00 00 F6", "with 4 byte"),
        ("FF FF 01 04 00 00 02 F9", "damaged reply"),
        ("FF FF 01 04 10 00 02 E8", "servo 1 received a damaged"),
    ],
)
def test_corrupt_answer_is_explained(
    peer: Peer, port: DynamixelPort, reply: str, message: str
) -> None:
    # After damage the question is for one byte more, lest an answer comes late.
    again = "FF FF 01 05 00 FF 00 02 F8" if "damaged reply" in message else POSITION_512
    peer.answer((8, reply), (8, again))
    with pytest.raises(CorruptReplyError, match=message):
        port.read(1, 36, 2)
    assert port.read(1, 36, 2).data == b"\x00\x02"  # and the port works on


def test_late_answer_is_not_taken_for_the_next(peer: Peer, hasty: DynamixelPort) -> None:
    late = "FF FF 01 04 00 FF 03 F8"  # position 1023
    with pytest.raises(ReplyTimeoutError):
        hasty.read(1, 36, 2)
    assert os.read(peer.master, 100) == bytes.fromhex(READ)
    peer.answer((8, f"{late} FF FF 01 05 00 FF 00 02 F8"))
    with suppress(ReplyTimeoutError):  # a busy machine
        assert hasty.read(1, 36, 2).data == b"\x00\x02"
    assert peer.finish() == ["FF FF 01 04 02 23 03 D2"]


def test_old_bytes_are_not_taken_for_the_answer(peer: Peer, port: DynamixelPort) -> None:
    os.write(peer.master, bytes.fromhex("FF FF 01 04 00 FF 03 F8"))  # late: position 1023
    assert eventually(lambda: _waiting(peer) >= 8)
    peer.answer((8, POSITION_512))
    assert port.read(1, 36, 2).data == b"\x00\x02"


def test_endless_babble_ends_with_the_timeout(peer: Peer, hasty: DynamixelPort) -> None:
    stop = threading.Event()

    def babble() -> None:
        os.set_blocking(peer.master, False)
        while not stop.is_set():
            try:
                os.write(peer.master, bytes(200))
            except BlockingIOError:
                time.sleep(0.001)

    thread = threading.Thread(target=babble, daemon=True)
    thread.start()
    with pytest.raises(CommunicationError):
        hasty.read(1, 36, 2)
    stop.set()
    thread.join(10.0)


def test_port_that_takes_no_data_is_lost(peer: Peer) -> None:
    port = DynamixelPort(peer.name)
    port.open()
    with pytest.raises(PortLostError):
        for _ in range(10_000):  # nobody reads the other end
            port.sync_write(30, {servo_id: bytes(4) for servo_id in range(40)})
    assert not port.is_open


def test_vanished_port_is_lost(peer: Peer, port: DynamixelPort) -> None:
    peer.vanish()
    with pytest.raises(PortLostError):
        port.read(1, 36, 2)
    assert not port.is_open
    with pytest.raises(NotConnectedError):
        port.ping(1)
    port.close()


def test_port_that_vanishes_while_waiting_is_lost(peer: Peer, port: DynamixelPort) -> None:
    peer.answer((8, ""))

    def unplug() -> None:
        peer.finish()
        peer.vanish()

    thread = threading.Thread(target=unplug)
    thread.start()
    with pytest.raises(PortLostError):
        port.read(1, 36, 2)
    thread.join()


def test_sync_write_wants_equal_shares_and_nothing_sends_nothing(port: DynamixelPort) -> None:
    with pytest.raises(CommunicationError):
        port.sync_write(30, {1: b"\x00", 2: b"\x00\x00"})
    port.sync_write(30, {})


class CannedLine:
    """A line on which the answer is there at once, whatever the question."""

    def __init__(self, answer: bytes) -> None:
        self._answer = answer
        self._rest = b""

    def discard_input(self) -> None:
        pass

    def write(self, data: bytes, timeout: float) -> None:
        self._rest = self._answer

    def read(self, limit: int, deadline: float) -> bytes:
        data, self._rest = self._rest[:limit], self._rest[limit:]
        return data


class CannedDevice:
    """Takes the place of an open device.

    Args:
        answer: What comes back, whatever the question.
    """

    adapter = Adapter()

    def __init__(self, answer: bytes) -> None:
        self.line = CannedLine(answer)

    def close(self) -> None:
        pass


def canned_port(answer: bytes) -> DynamixelPort:
    port = DynamixelPort(
        "canned", reply_timeout=1e-6, open_device=lambda name, rate: CannedDevice(answer)
    )
    port.open()
    return port


POSITION_512_2 = "FF FF FD 00 01 08 00 55 00 A6 00 00 00 8C C0"
READ_2 = "FF FF FD 00 01 07 00 02 84 00 04 00 1D 15"
pieces = st.one_of(
    st.binary(max_size=12),
    st.sampled_from([b"\xff\xff\x01", b"\xff\xff\xfd\x00\x01", b"\xff\xff\xfd\x00\xfe"]),
    st.sampled_from([bytes.fromhex(READ), bytes.fromhex(POSITION_512), bytes.fromhex(PONG)]),
    st.sampled_from([bytes.fromhex(READ_2), bytes.fromhex(POSITION_512_2)]),
)


@settings(max_examples=300)
@given(st.lists(pieces, max_size=6).map(b"".join), st.sampled_from([1, 2]))
def test_no_bytes_make_a_read_crash_or_return_the_wrong_length(
    answer: bytes, protocol: int
) -> None:
    try:
        reply = canned_port(answer).read(1, 36, 2, protocol)
    except CommunicationError:
        return
    assert len(reply.data) == 2
    assert reply.data in answer


groups = st.builds(
    ReadGroup,
    st.sampled_from([ReadMethod.BULK, ReadMethod.SYNC, ReadMethod.FAST_SYNC]),
    st.sampled_from([1, 2]),
    st.just(36),
    st.sampled_from([2, 4]),
    st.sampled_from([(1,), (1, 2), (3, 1, 2)]),
)


@settings(max_examples=300)
@given(st.lists(pieces, max_size=6).map(b"".join), groups)
def test_no_bytes_make_a_group_read_crash(answer: bytes, group: ReadGroup) -> None:
    replies = list(canned_port(answer).read_group(group))
    assert len(replies) == len(group.ids)
    for reply in replies:
        assert isinstance(reply, CommunicationError) or len(reply.data) == group.length


def test_opening_twice_and_closing_twice_is_harmless(peer: Peer) -> None:
    port = DynamixelPort(peer.name)
    port.open()
    port.open()
    assert port.is_open
    port.close()
    port.close()
    assert not port.is_open


def test_missing_port_lists_what_exists(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(PortMissingError):
        DynamixelPort("/dev/ttyNone").open()
    monkeypatch.setattr(port_module, "serial_ports", lambda: ("/dev/ttyUSB0", "/dev/ttyACM0"))
    with pytest.raises(PortMissingError):
        DynamixelPort("/dev/ttyNone").open()
    monkeypatch.setattr(port_module, "serial_ports", tuple)
    with pytest.raises(PortMissingError):
        DynamixelPort("/dev/ttyNone").open()


def test_a_port_that_has_gone_is_looked_for_without_listing_the_others(
    peer: Peer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    link = tmp_path / "servos"
    link.symlink_to(peer.name)
    port = DynamixelPort(str(link))
    port.open()
    port.close()
    link.unlink()
    listed: list[object] = []

    def comports() -> list[object]:
        listed.append(None)
        return []

    monkeypatch.setattr(list_ports, "comports", comports)
    with pytest.raises(PortMissingError):
        port.open()
    assert not listed


def test_second_program_finds_the_port_busy(peer: Peer, port: DynamixelPort) -> None:
    with pytest.raises(PortBusyError):
        DynamixelPort(peer.name).open()
    port.close()
    again = DynamixelPort(peer.name)
    again.open()
    again.close()


def test_forbidden_port_names_the_group(peer: Peer) -> None:
    serial_ports()  # what this imports must be there before the rights go
    os.chmod(peer.name, 0)
    root = os.geteuid() == 0
    if root:
        os.seteuid(65534)  # root may open anything
    try:
        with pytest.raises(PortPermissionError):
            DynamixelPort(peer.name).open()
    finally:
        if root:
            os.seteuid(0)


def test_group_is_dialout_when_the_device_does_not_tell() -> None:
    error = port_error("/dev/ttyNone", OSError(errno.EACCES, ""))
    assert isinstance(error, PortPermissionError)
    assert "group dialout" in str(error)


def test_file_is_no_port() -> None:
    with pytest.raises(PortError):
        DynamixelPort("/etc/passwd").open()
    for_others = port_error("/etc/passwd", OSError(errno.EACCES, ""))
    assert "must be a serial device" in str(for_others)


def test_nobody_is_told_to_join_root() -> None:
    assert "usermod" not in str(PortPermissionError("/dev/ttyUSB0", "root"))


def test_port_that_cannot_do_the_baud_rate_says_so(
    peer: Peer, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise ValueError("Failed to set custom baud rate (3000000): [Errno 22]")  # as pyserial does

    monkeypatch.setattr(serial.Serial, "_reconfigure_port", refuse)
    port = DynamixelPort(peer.name, 3_000_000)
    before = len(os.listdir("/proc/self/fd"))
    with pytest.raises(PortError):
        port.open()
    assert not port.is_open
    assert len(os.listdir("/proc/self/fd")) == before


@pytest.mark.parametrize("baud_rate", [0, 117_600, 1_000_001])
def test_baud_rate_that_no_servo_knows_lists_the_others(baud_rate: int) -> None:
    with pytest.raises(ConfigurationError, match=f"{baud_rate} baud; allowed are 9600, .*1000000"):
        DynamixelPort("/dev/ttyUSB0", baud_rate)


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), 100.0])
def test_senseless_timeout_is_refused(value: float) -> None:
    with pytest.raises(ConfigurationError, match="reply_timeout"):
        DynamixelPort("/dev/ttyUSB0", reply_timeout=value)


def test_opening_and_failing_leaves_no_descriptor(peer: Peer) -> None:
    before = len(os.listdir("/proc/self/fd"))
    for _ in range(3):
        port = DynamixelPort(peer.name, reply_timeout=0.001)
        port.open()
        with pytest.raises(PortBusyError):
            DynamixelPort(peer.name).open()
        with pytest.raises(ReplyTimeoutError):
            port.ping(1)
        port.close()
    assert len(os.listdir("/proc/self/fd")) == before


def _waiting(peer: Peer) -> int:
    import array
    import fcntl
    import termios

    count = array.array("i", [0])
    fcntl.ioctl(peer.slave, termios.FIONREAD, count)
    return count[0]
