"""Packets of both protocols, damaged replies, and another program on the line."""

from contextlib import suppress
from dataclasses import replace

import pytest
from dynamixel_sdk import Protocol1PacketHandler, Protocol2PacketHandler
from hypothesis import given
from hypothesis import strategies as st
from simulated_device import Bench, OnAnswers, Rig

from head_tracking.dynamixel import (
    Adapter,
    CommunicationError,
    CorruptReplyError,
    DynamixelPort,
    Goal,
    ReplyTimeoutError,
    ServoModel,
    TorqueError,
    servo_model,
)
from head_tracking.dynamixel.protocol import (
    Instruction,
    Status,
    decode_status,
    encode_packet,
    find_packet,
    sync_write_packet,
)
from head_tracking.dynamixel.reading import ReadGroup
from head_tracking.dynamixel.servo import run
from head_tracking.simulation import (
    SimulatedBus,
    SimulatedClock,
    SimulatedLine,
    SimulatedServo,
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
def test_packets_are_those_of_the_sdk(servo_id, code, parameters):
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
def test_what_a_servo_sends_is_found_and_decoded(protocol, sent, noise):
    packet = simulated.encode_status(protocol, sent)
    found = find_packet(protocol, noise + packet)
    assert found == (packet, len(noise) + len(packet), False)
    assert decode_status(protocol, packet) == Status(*sent)


@pytest.mark.parametrize("protocol", [1, 2])
def test_packet_that_is_too_long_is_refused(protocol):
    with pytest.raises(CommunicationError):
        encode_packet(protocol, 1, Instruction.WRITE, bytes(2000))


# Published packets, damaged replies and any bytes at all, through the port


class ScriptedDevice:
    """Says one thing whatever is asked, and keeps what was."""

    adapter = Adapter()

    def __init__(self, answer: str) -> None:
        self.sent = ""
        self.answer = bytes.fromhex(answer)  # what it says
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
    port = DynamixelPort("scripted", reply_timeout=1e-6, open_device=lambda *_: device)
    port.open()
    return port, device


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
def test_noise_before_a_reply_is_skipped(noise):
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
def test_a_damaged_reply_is_an_error(reply):
    port, _ = scripted(reply)
    with pytest.raises(CommunicationError):
        port.read(1, 36, 2)


def test_the_late_reply_to_a_write_is_no_refusal_of_the_next_read():
    port, device = scripted("")
    with pytest.raises(ReplyTimeoutError):
        port.write(1, 24, b"\x00")
    device.answer = bytes.fromhex(f"FF FF 01 02 01 FB {POSITION_512}")  # error bit: low voltage
    assert port.read(1, 36, 2).data == b"\x00\x02"


@pytest.mark.parametrize("model", ["AX-12", "XM430-W350"])
def test_the_late_reply_to_a_ping_is_not_taken_for_the_reply_to_the_next(model):
    late = iter([45_300_000])  # ns

    def delay(answer):
        return [replace(answer, late=next(late, 0))]

    servo = SimulatedServo(1, servo_model(model), boot_time=0.0)
    bench = Bench(SimulatedBus([servo], faults=OnAnswers(delay)))
    protocol, port = servo.model.protocol, bench.port
    port.open()
    with pytest.raises(ReplyTimeoutError):
        port.ping(1, protocol)
    bench.clock.now = 1_045_323_000  # its reply is still being sent when the late one arrives
    assert port.ping(1, protocol) == 0
    port.sync_write(24, {1: b"\0"}, protocol)
    assert not bench.line.overlaps


@pytest.mark.parametrize(
    ("model", "place"),
    [*(("MX-28", at) for at in (0, 2, 3, 6, -1)), *(("XM430-W350", at) for at in (0, 4, 5, 9, -1))],
)
def test_a_servo_whose_replies_are_damaged_does_not_hide_those_of_its_neighbour(model, place):
    bulk = model == "MX-28"

    def damage(answer):
        data = bytearray(answer.data)
        if data[2 if bulk else 4] == 1:  # its id
            data[place] ^= 8
        return [replace(answer, data=bytes(data))]

    servos = [SimulatedServo(each, servo_model(model), boot_time=0.0) for each in (1, 2)]
    bench = Bench(SimulatedBus(servos, faults=OnAnswers(damage)))
    bench.port.open()
    group = ReadGroup(servos[0].model.protocol, 36, 4, (1, 2), bulk)
    for _ in range(5):
        first, second = bench.port.read_group(group)
        assert isinstance(first, CorruptReplyError)
        assert second.id == 2


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
def test_any_bytes_are_replies_of_the_right_length_or_errors(answer, group):
    port, _ = scripted(answer.hex())
    replies = port.read_group(group)
    assert len(replies) == len(group.ids)
    for reply in replies:
        assert isinstance(reply, CommunicationError) or len(reply.data) == group.length


# Another program on the line: every wait is bounded, and STOP finds a gap


_BYTE = 10_000  # ns at 1 Mbaud
_REQUEST = bytes.fromhex("FF FF 01 04 02 24 02 D2")
_REPLY = bytes.fromhex("FF FF 01 04 00 00 02 F8")
_RETURN_DELAY = 100_000  # ns


class SecondMaster:
    """Another program that polls a servo: what overlaps with its packets is lost.

    Args:
        line: The line, on whose other side the driver is.
        clock: Its clock.
        gap: From the end of a reply to the next request, s; None: requests without a pause.
    """

    def __init__(self, line: SimulatedLine, clock: SimulatedClock, gap: float | None) -> None:
        self.speaks = True  # Whether the second master is there
        self.spoken_over = 0  # How often the driver spoke over it
        self.heard: list[bytes] = []  # Packets of the driver that reached the servos
        self._line, self._clock = line, clock
        self._first = clock.now
        request, reply = len(_REQUEST) * _BYTE, len(_REPLY) * _BYTE
        self._spoken = ((0, request), (request + _RETURN_DELAY, request + _RETURN_DELAY + reply))
        self._period = request if gap is None else self._spoken[1][1] + round(gap * 1e9)
        self._taken = clock.now  # until when its packets have been handed over

    def _ends(self, since: int) -> tuple[int, bytes]:
        """Return when the next foreign packet after a time ends, and the packet."""
        turn = (since - self._first) // self._period
        while True:
            for (_, end), packet in zip(self._spoken, (_REQUEST, _REPLY), strict=True):
                time = self._first + turn * self._period + end
                if time > since:
                    return time, packet
            turn += 1

    def close(self) -> None:
        self._line.close()

    def discard_input(self) -> None:
        self._line.discard_input()
        self._taken = max(self._taken, self._clock.now)

    def write(self, data: bytes) -> None:
        begin, end = self._clock.now, self._clock.now + len(data) * _BYTE
        turn = (begin - self._first) // self._period
        for start, stop in (
            (self._first + n * self._period + start, self._first + n * self._period + stop)
            for n in range(turn, turn + 3)
            for start, stop in self._spoken
        ):
            if self.speaks and start < end and begin < stop:
                self.spoken_over += 1
                return
        self.heard.append(data)
        self._line.write(data)

    def read(self, limit: int, deadline: float) -> bytes:
        assert self._clock.now < self._first + 60_000_000_000, "waits for ever"
        if not self.speaks:
            return self._line.read(limit, deadline)
        end, packet = self._ends(self._taken)
        if own := self._line.read(limit, min(deadline, end * 1e-9)):
            return own
        if end > round(deadline * 1e9):
            return b""
        self._clock.now = max(self._clock.now, end)
        data = b""
        while end <= self._clock.now:  # all that has arrived comes at once
            data, self._taken = data + packet, end
            end, packet = self._ends(end)
        return data


models = pytest.mark.parametrize(
    "model", [servo_model(name) for name in ("AX-12", "STS3215")], ids=lambda m: m.name
)


def torque(model: ServoModel) -> int:
    return model.control_table["Torque Enable"].address


def torque_off(model: ServoModel, *ids: int) -> bytes:
    return sync_write_packet(1, torque(model), dict.fromkeys(ids, b"\0"))


def share_line(bench: Bench, gap: float | None) -> SecondMaster:
    """Open the port of a bench where a second master speaks."""
    bench.port.close()
    bench.device = SecondMaster(bench.line, bench.clock, gap)
    bench.port.open()
    return bench.device


def bench(gap: float | None, model: ServoModel) -> tuple[Bench, SecondMaster]:
    made = Bench([SimulatedServo(i, model) for i in (1, 2)])
    return made, share_line(made, gap)


def feedback(port: DynamixelPort, model: ServoModel) -> Status:
    return port.read(2, model.feedback.address, model.feedback.length)


@models
@pytest.mark.parametrize("gap", [0.0, 0.0002, 0.01])
def test_no_transaction_waits_long_for_a_second_master(gap, model):
    made, _ = bench(gap, model)
    port = made.port
    for call in (
        lambda: feedback(port, model),
        lambda: port.ping(2),
        lambda: port.write(2, torque(model), b"\0"),
    ) * 20:
        begin = made.clock.now
        with suppress(CommunicationError):
            call()
        assert made.clock.now - begin < 0.06 * 1e9
        made.pass_time(0.003)
    assert len(port._buffer) < 10_000


@models
def test_servos_are_read_between_the_packets_of_a_second_master(model):
    made, master = bench(0.002, model)
    master.speaks = False
    expected = feedback(made.port, model).data
    master.speaks = True
    replies = 0
    for _ in range(200):
        with suppress(CommunicationError):
            replies += feedback(made.port, model).data == expected
        made.pass_time(0.0031)
    assert replies > 50


@models
@pytest.mark.parametrize("gap", [0.00025, 0.005])
@pytest.mark.parametrize("known", [False, True], ids=["unknown", "known"])
def test_stop_is_sent_between_the_packets_of_a_second_master(gap, known, model):
    for offset in range(0, 500_000, 37_000):
        made, master = bench(gap, model)
        if known:
            with pytest.raises(CommunicationError):
                for _ in range(20):
                    made.port.read(1, model.feedback.address, 8)
        made.clock.now += offset
        made.pass_time(0.01)
        begin = made.clock.now
        before = master.spoken_over
        made.port.sync_write(torque(model), {1: b"\0"}, patience=0.5)
        assert made.clock.now - begin < 0.5 * 1e9
        assert master.spoken_over == before
        assert master.heard[-1] == torque_off(model, 1)


@models
def test_stop_that_finds_no_gap_is_sent_all_the_same(model):
    made, master = bench(None, model)
    made.pass_time(0.01)
    begin = made.clock.now
    made.port.sync_write(torque(model), {1: b"\0"}, patience=0.1)
    assert 0.1e9 <= made.clock.now - begin < 0.11e9
    assert master.spoken_over == 1


@models
@pytest.mark.parametrize("gap", [0.00025, 0.005])
def test_stop_relaxes_servos_or_reports_that_it_could_not(gap, model):
    rig = Rig(*(SimulatedServo(i, model) for i in (1, 2)))
    made = rig.bench
    for _ in range(50):
        rig.bus.command({"j1": Goal(0.3), "j2": Goal(-0.3)})
        rig.step()
    assert rig.torque == [1, 1]
    master = share_line(made, gap)
    rig.step(5)
    begin = made.clock.now
    reported = ()
    try:
        run(rig.bus.stopping(None), made.pass_time)
    except TorqueError as error:
        reported = tuple(error.problems)
    assert made.clock.now - begin < 2e9
    powered = {f"j{servo.id}" for servo in rig.servos if servo.register("Torque Enable")}
    assert powered <= set(reported)
    assert torque_off(model, 1, 2) in master.heard
