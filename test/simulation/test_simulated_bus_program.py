"""The executable simulated_bus, as a shell starts it."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import serial
from simulated_packets import InstructionPacket, InstructionPacket2, StatusPacket, StatusPacket2

from head_tracking.cli import simulated_bus

PATIENCE = 20.0
PING = InstructionPacket.ping(1).encode()
PONG = StatusPacket(1).encode()


class Program:
    def __init__(self, *options: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "head_tracking", "simulated_bus", *options],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert self.process.stdout is not None
        self.port = self.process.stdout.readline().strip()

    def stop(self) -> tuple[int, str]:
        """End it; return its exit code and what it told."""
        self.process.send_signal(signal.SIGINT)
        _, messages = self.process.communicate(timeout=PATIENCE)
        return self.process.returncode, messages


@pytest.fixture
def start() -> Iterator[Callable[..., Program]]:
    programs: list[Program] = []

    def begin(*options: str) -> Program:
        programs.append(Program(*options))
        return programs[-1]

    yield begin
    for program in programs:
        program.process.kill()
        program.process.communicate(timeout=PATIENCE)


def ask(port: str, packet: bytes, length: int, baud_rate: int = 1_000_000) -> bytes:
    with serial.Serial(port, baud_rate, timeout=PATIENCE if length else 0.1) as device:
        device.write(packet)
        return device.read(length or 1)


def test_models_and_protocols_can_be_mixed(start, tmp_path: Path) -> None:
    link = str(tmp_path / "servos")
    program = start("--ids", "1", "--servo", "XL430-W250:3", "--servo", "mx-28:4", "--link", link)
    assert program.port == link
    assert ask(link, PING, 6) == PONG
    answer = ask(link, InstructionPacket2.ping(3).encode(), 14)
    assert StatusPacket2.decode(answer) == StatusPacket2(
        3, 0, (1060).to_bytes(2, "little") + b"\x32"
    )
    code, messages = program.stop()
    assert code == 0
    assert "AX-12 1, XL430-W250 3, MX-28 4" in messages


def test_faults_are_counted_at_the_end(start) -> None:
    program = start("--faults", "100", "--kinds", "drop", "--seed", "5")
    assert ask(program.port, PING, 0) == b""
    assert "faults: drop 1" in program.stop()[1]


def test_a_second_simulator_takes_the_link_over(start, tmp_path: Path) -> None:
    link = str(tmp_path / "servos")
    first = start("--link", link)
    assert start("--ids", "7", "--link", link).port == link
    assert first.stop()[0] == 0
    ping = InstructionPacket.ping(7).encode()
    assert ask(link, ping, 6) == StatusPacket(7).encode()


def test_echoes_are_sent_and_collisions_counted_at_the_end(start) -> None:
    program = start("--echo", "--servo", "AX-12:1", "--servo", "AX-18A:1")
    assert ask(program.port, PING, 12) == PING + PONG
    read = InstructionPacket.read(1, 0, 2).encode()
    answer = ask(program.port, read, 16)
    assert answer[:8] == read and StatusPacket.decode(answer[8:]) is None
    assert "two senders at once: servos with the same id 1" in program.stop()[1]


def test_an_unsupported_baud_rate_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        assert simulated_bus.main(["--baud", "2000000"]) == 1
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
    assert "AX-12 has no baud rate 2000000" in capsys.readouterr().err
