"""Programs of others talk to the simulated bus: they know nothing of this package."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from waiting import eventually

from head_tracking.dynamixel.models import servo_model
from head_tracking.simulation import SimulatedPort, SimulatedServo

TIMEOUT = 2.0  # s for an answer: a busy machine is no fault


@pytest.fixture
def ax() -> Iterator[SimulatedPort]:
    with SimulatedPort([SimulatedServo(1), SimulatedServo(2)]) as port:
        yield port


@pytest.fixture
def xl330() -> Iterator[SimulatedPort]:
    model = servo_model("XL330-M288")
    with SimulatedPort([SimulatedServo(i, model, position=2000 + i) for i in (1, 2)]) as port:
        yield port


class TestRustypot:
    """rustypot: a driver in Rust with protocols of its own."""

    @pytest.fixture(autouse=True)
    def rustypot(self):
        self.library = pytest.importorskip("rustypot", reason="rustypot is not installed")

    def test_ax_servos_are_found_read_and_moved(self, ax: SimulatedPort) -> None:
        controller = self.library.AxPyController(ax.port_name, 1_000_000, TIMEOUT)
        assert controller.ping(1)
        assert controller.read_model_number(2) == [12]
        assert controller.read_present_position(1) == [0.0]
        controller.write_torque_enable(1, 1)
        controller.write_goal_position(1, 0.5)
        joint = 0.5 / servo_model("AX-12").radians_per_tick + 512
        assert eventually(lambda: abs(ax.true_ticks(1) - joint) < 3)
        assert controller.read_present_position(1)[0] == pytest.approx(0.5, abs=0.02)
        controller.sync_write_goal_position([1, 2], [-0.2, 0.3])
        assert eventually(lambda: ax.true_ticks(2) > 560 and ax.true_ticks(1) < 480)
        controller.close()

    def test_x_servos_are_read_together_and_moved(self, xl330: SimulatedPort) -> None:
        controller = self.library.Xl330PyController(xl330.port_name, 1_000_000, TIMEOUT)
        assert controller.ping(1)
        assert controller.read_model_number(1) == [1200]
        for fast in (False, True):
            controller.set_fast_sync_read(fast)
            raw = controller.sync_read_raw_present_position([1, 2])
            assert raw == [2001, 2002]
        controller.sync_write_torque_enable([1, 2], [True, True])
        controller.sync_write_raw_goal_position([1, 2], [1500, 2500])
        assert eventually(lambda: abs(xl330.true_ticks(2) - 2500) < 8)
        assert eventually(lambda: abs(xl330.true_ticks(1) - 1500) < 8)
        goals = xl330.use(lambda bus: [bus.write_log.goals(i)[-1] for i in (1, 2)])
        assert goals == [1500, 2500]
        controller.close()

    def test_xl320_and_mx_answer_too(self) -> None:
        for name, kind in (("XL-320", "Xl320PyController"), ("MX-28", "MxPyController")):
            with SimulatedPort([SimulatedServo(1, servo_model(name))]) as port:
                controller = getattr(self.library, kind)(port.port_name, 1_000_000, TIMEOUT)
                assert controller.ping(1)
                assert controller.read_model_number(1) == [servo_model(name).model_number]
                controller.close()


class TestDynamixelSdk:
    """dynamixel_sdk, as its examples use it."""

    @pytest.fixture(autouse=True)
    def sdk(self):
        self.sdk = pytest.importorskip("dynamixel_sdk")

    def open(self, simulated: SimulatedPort, protocol: int):
        port = self.sdk.PortHandler(simulated.port_name)
        assert port.openPort()
        assert port.setBaudRate(1_000_000)
        original = port.setPacketTimeout
        port.setPacketTimeout = lambda length: (original(length), self._wait_longer(port))[0]
        return port, self.sdk.PacketHandler(float(protocol))

    @staticmethod
    def _wait_longer(port) -> None:
        port.packet_timeout = TIMEOUT * 1e3

    def test_ax_servos(self, ax: SimulatedPort) -> None:
        port, handler = self.open(ax, 1)
        assert handler.ping(port, 1) == (12, 0, 0)
        assert handler.read2ByteTxRx(port, 1, 36) == (512, 0, 0)
        assert handler.write2ByteTxRx(port, 1, 30, 600) == (0, 0)
        assert eventually(lambda: abs(ax.true_ticks(1) - 600) < 2)
        assert handler.write2ByteTxRx(port, 1, 30, 2000) == (0, 8)
        port.closePort()

    def test_x_servos(self, xl330: SimulatedPort) -> None:
        port, handler = self.open(xl330, 2)
        assert handler.ping(port, 1) == (1200, 0, 0)
        assert handler.read4ByteTxRx(port, 1, 132) == (2001, 0, 0)
        group = self.sdk.GroupSyncRead(port, handler, 132, 4)
        for servo_id in (1, 2):
            assert group.addParam(servo_id)
        assert group.txRxPacket() == 0
        assert [group.getData(i, 132, 4) for i in (1, 2)] == [2001, 2002]
        assert handler.write1ByteTxRx(port, 1, 64, 1) == (0, 0)
        assert handler.write1ByteTxRx(port, 1, 9, 0) == (0, 7)  # EEPROM with torque on
        found, result = handler.broadcastPing(port)
        assert result == 0
        assert {i: data[0] for i, data in found.items()} == {1: 1200, 2: 1200}
        assert handler.reboot(port, 1) == (0, 0)
        port.closePort()

    def test_mx_bulk_read(self) -> None:
        model = servo_model("MX-28")
        servos = [SimulatedServo(i, model, position=1000 * i) for i in (1, 2)]
        with SimulatedPort(servos) as simulated:
            port, handler = self.open(simulated, 1)
            port.ser.timeout = 0
            data = bytes((0, 2, 1, 36, 2, 2, 36))
            packet = [0xFF, 0xFF, 0xFE, len(data) + 2, 0x92, *data, 0]
            assert handler.txPacket(port, packet) == 0
            port.setPacketTimeout(8)
            answers = [handler.rxPacket(port) for _ in (1, 2)]
            assert [(answer[2], answer[5] | answer[6] << 8) for answer, _ in answers] == [
                (1, 1000),
                (2, 2000),
            ]
            port.closePort()
