"""The simulated bus behind a real pty."""

import os
import threading

import pytest
import serial
from simulated_device import OnAnswers
from waiting import PATIENCE, wait_for

from head_tracking.dynamixel.models import servo_model
from head_tracking.dynamixel.protocol import (
    Instruction,
    encode_packet,
    read_packet,
    write_packet,
)
from head_tracking.simulation import (
    SimulatedBus,
    SimulatedPort,
    SimulatedServo,
    SimulationError,
)
from head_tracking.simulation.packets import Status, encode_status

PING = encode_packet(1, 1, Instruction.PING)
PONG = encode_status(1, Status(1, 0))


def client_of(port_name: str) -> serial.Serial:
    """Return a plain program that has the port open."""
    return serial.Serial(port_name, 1_000_000, timeout=PATIENCE)


def ask(client: serial.Serial, data: bytes, length: int) -> bytes:
    client.write(data)
    return client.read(length)


def test_unread_answers_do_not_block_the_bus():
    servos = SimulatedServo(1), SimulatedServo(2)
    with SimulatedPort(servos) as port, client_of(port.port_name) as client:
        read = read_packet(1, 1, 0, 50)
        for _ in range(500):  # 28 kB of answers that nobody reads
            client.write(read)
        client.write(write_packet(1, 2, 25, b"\x01"))
        wait_for(lambda: port.use(lambda bus: bus[2].register("LED")) == 1)


@pytest.mark.parametrize("stale", [None, "/dev/pts/does-not-exist"])
def test_link_names_the_port(tmp_path, stale):
    link = tmp_path / "ttyHead"
    if stale:
        link.symlink_to(stale)
    with SimulatedPort([SimulatedServo(1)], link=link) as port:
        assert port.port_name == str(link)
        client = client_of(str(link))
        assert ask(client, PING, 6) == PONG
        client.close()
    assert not os.path.lexists(link)


@pytest.mark.parametrize("kind", ["device", "file", "missing folder"])
def test_an_impossible_link_is_refused(tmp_path, kind):
    link = tmp_path / "ttyHead"
    if kind == "device":
        link.symlink_to("/dev/null")
    elif kind == "file":
        link.write_text("data")
    else:
        link = tmp_path / "none" / "ttyHead"
    descriptors = len(os.listdir("/proc/self/fd"))
    with pytest.raises(SimulationError):
        SimulatedPort([SimulatedServo(1)], link=link).open()
    assert len(os.listdir("/proc/self/fd")) == descriptors
    assert kind != "device" or os.readlink(link) == "/dev/null"
    assert kind != "file" or link.read_text() == "data"


def test_unplugged_adapter_returns_with_the_same_link_and_leaves_nothing(tmp_path):
    def resources():
        return len(os.listdir("/proc/self/fd")), threading.active_count()

    link, before = tmp_path / "ttyHead", resources()
    port = SimulatedPort([SimulatedServo(1)], link=link)
    for _ in range(5):
        port.open()
        port.open()
        client = client_of(str(link))
        assert ask(client, PING, 6) == PONG
        port.close()
        assert not os.path.lexists(link)
        assert port.port_name == ""
        with pytest.raises(OSError):
            client.write(PING)
        client.close()
        port.close()
    assert resources() == before


@pytest.mark.parametrize("baud_rate", [57_600, 250_000, 4_500_000])
def test_only_servos_with_the_baud_rate_of_the_program_receive(baud_rate):
    servo = SimulatedServo(1, servo_model("XM430-W350"))
    code = {rate: code for code, rate in servo.model.baud_rates.items()}.get(baud_rate)
    if code is not None:
        servo.set_register("Baud Rate", code)
    with SimulatedPort([servo], match_baud_rate=True) as port:
        device = serial.Serial(port.port_name, baud_rate, timeout=PATIENCE if code else 0.05)
        device.write(encode_packet(2, 1, Instruction.PING))
        assert len(device.read(14)) == (0 if code is None else 14)
        device.close()


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_an_internal_error_removes_the_port():
    failed = threading.Event()

    def fail(answer):
        raise ZeroDivisionError("a defect of the simulator")

    bus = SimulatedBus([SimulatedServo(1)], faults=OnAnswers(fail))
    with SimulatedPort(bus, on_failure=failed.set) as port:
        client = client_of(port.port_name)
        client.write(PING)
        assert failed.wait(PATIENCE)
        assert isinstance(port.failure, ZeroDivisionError)
        assert port.port_name == ""
        with pytest.raises(OSError):
            client.write(PING)
        client.close()
        port.close()
        port.open()
