"""Another program on the line: every wait is bounded, and STOP finds a gap."""

from __future__ import annotations

from contextlib import suppress

import pytest
from simulated_device import Bench, Rig

from head_tracking.dynamixel import (
    CommunicationError,
    DynamixelPort,
    Goal,
    ServoModel,
    TorqueError,
    servo_model,
)
from head_tracking.dynamixel.exceptions import LineBusyError
from head_tracking.dynamixel.protocol import Status, sync_write_packet
from head_tracking.dynamixel.servo import run
from head_tracking.simulation import SimulatedClock, SimulatedLine, SimulatedServo

_BYTE = 10_000  # ns at 1 Mbaud
_REQUEST = bytes.fromhex("FF FF 01 04 02 24 02 D2")
_REPLY = bytes.fromhex("FF FF 01 04 00 00 02 F8")
_RETURN_DELAY = 100_000  # ns


class SecondMaster:
    """Another program that polls a servo: what overlaps with its packets is lost.

    Args:
        line: The line, on whose other side the driver is.
        clock: Its clock.
        gap: From the end of a reply to the next request, s.

    Attributes:
        speaks: Whether the second master is there.
        spoken_over: How often the driver spoke over it.
        heard: Packets of the driver that reached the servos.
    """

    def __init__(self, line: SimulatedLine, clock: SimulatedClock, gap: float) -> None:
        self.speaks = True
        self.spoken_over = 0
        self.heard: list[bytes] = []
        self._line, self._clock = line, clock
        self._first = clock.now
        request, reply = len(_REQUEST) * _BYTE, len(_REPLY) * _BYTE
        self._spoken = ((0, request), (request + _RETURN_DELAY, request + _RETURN_DELAY + reply))
        self._period = self._spoken[1][1] + round(gap * 1e9)
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


def bench(gap: float, model: ServoModel) -> tuple[Bench, SecondMaster]:
    made = Bench([SimulatedServo(i, model) for i in (1, 2)])
    made.port.open()
    master = SecondMaster(made.line, made.clock, gap)
    made.port._line = master  # type: ignore[assignment]
    return made, master


def feedback(port: DynamixelPort, model: ServoModel) -> Status:
    return port.read(2, model.feedback.address, model.feedback.length)


@models
@pytest.mark.parametrize("gap", [0.0, 0.0002, 0.01])
def test_no_transaction_waits_long_for_a_second_master(gap: float, model: ServoModel) -> None:
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
def test_servos_are_read_between_the_packets_of_a_second_master(model: ServoModel) -> None:
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
def test_stop_is_sent_between_the_packets_of_a_second_master(
    gap: float, known: bool, model: ServoModel
) -> None:
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
def test_stop_that_finds_no_gap_is_reported(model: ServoModel) -> None:
    made, master = bench(0.0, model)
    master._period = master._spoken[0][1]  # requests without a pause
    made.pass_time(0.01)
    begin = made.clock.now
    with pytest.raises(LineBusyError):
        made.port.sync_write(torque(model), {1: b"\0"}, patience=0.1)
    assert 0.1e9 <= made.clock.now - begin < 0.11e9
    assert not master.heard and not master.spoken_over


@models
@pytest.mark.parametrize("gap", [0.00025, 0.005])
def test_stop_relaxes_servos_or_reports_that_it_could_not(gap: float, model: ServoModel) -> None:
    rig = Rig(*(SimulatedServo(i, model) for i in (1, 2)))
    made = rig.bench
    for _ in range(50):
        rig.bus.command({"j1": Goal(0.3), "j2": Goal(-0.3)})
        rig.step()
    assert rig.torque == [1, 1]
    master = SecondMaster(made.line, made.clock, gap)
    made.port._line = master  # type: ignore[assignment]
    rig.step(5)
    begin = made.clock.now
    reported: tuple[str, ...] = ()
    try:
        run(rig.bus.stopping(None), made.pass_time)
    except TorqueError as error:
        reported = tuple(error.problems)
    assert made.clock.now - begin < 2e9
    powered = {f"j{servo.id}" for servo in rig.servos if servo.register("Torque Enable")}
    assert powered <= set(reported)
    assert torque_off(model, 1, 2) in master.heard
