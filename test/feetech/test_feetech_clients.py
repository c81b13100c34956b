"""Programs of others talk to simulated Feetech servos: they know nothing of this package."""

from __future__ import annotations

import math
from collections.abc import Iterator

import pytest
from waiting import eventually

from head_tracking.simulation import SimulatedPort, SimulatedServo

TIMEOUT = 2.0  # s for an answer: a busy machine is no fault


@pytest.fixture
def sts() -> Iterator[SimulatedPort]:
    servos = [SimulatedServo(i, "STS3215", position=2000 + i) for i in (1, 2)]
    with SimulatedPort(servos) as port:
        yield port


@pytest.fixture
def scs() -> Iterator[SimulatedPort]:
    with SimulatedPort([SimulatedServo(i, "SCS0009", position=500 + i) for i in (1, 2)]) as port:
        yield port


class TestRustypot:
    """rustypot: a driver in Rust with protocols of its own."""

    @pytest.fixture(autouse=True)
    def rustypot(self):
        self.library = pytest.importorskip("rustypot", reason="rustypot is not installed")

    def test_sts_servos_are_found_read_and_moved(self, sts: SimulatedPort) -> None:
        controller = self.library.Sts3215PyController(sts.port_name, 1_000_000, TIMEOUT)
        assert controller.ping(1)
        assert controller.read_raw_present_position(1) == [2001]
        assert controller.sync_read_raw_present_position([1, 2]) == [2001, 2002]
        controller.sync_write_torque_enable([1, 2], [True, True])
        controller.sync_write_raw_goal_position([1, 2], [1500, 2500])
        assert eventually(lambda: abs(sts.true_ticks(1) - 1500) < 20)
        assert eventually(lambda: abs(sts.true_ticks(2) - 2500) < 20)
        controller.close()

    def test_scs_servos_are_read_and_moved(self, scs: SimulatedPort) -> None:
        controller = self.library.Scs0009PyController(scs.port_name, 1_000_000, TIMEOUT)
        tick = math.radians(300.0 / 1024.0)  # its middle is 511; raw values have the wrong order
        here = controller.read_present_position(1)[0]
        assert here == pytest.approx((501 - 511) * tick, abs=tick)
        controller.write_torque_enable(1, True)
        controller.write_goal_position(1, (700 - 511) * tick)
        assert eventually(lambda: abs(scs.true_ticks(1) - 700) < 8)
        controller.close()


class TestMakersSdk:
    """scservo_sdk of the maker (ftservo-python-sdk), as its examples use it."""

    @pytest.fixture(autouse=True)
    def sdk(self):
        self.sdk = pytest.importorskip("scservo_sdk", reason="ftservo-python-sdk is not installed")
        if not hasattr(self.sdk, "sms_sts"):
            pytest.skip("the older feetech-servo-sdk is installed, which has the same module name")

    def open(self, simulated: SimulatedPort):
        port = self.sdk.PortHandler(simulated.port_name)
        assert port.openPort()
        assert port.setBaudRate(1_000_000)
        original = port.setPacketTimeout

        def wait_longer(length: int) -> None:
            original(length)
            port.packet_timeout = TIMEOUT * 1e3

        port.setPacketTimeout = wait_longer
        return port

    def test_sts_servos(self, sts: SimulatedPort) -> None:
        port = self.open(sts)
        handler = self.sdk.sms_sts(port)
        assert handler.ping(1) == (777, 0, 0)
        assert handler.ReadPos(2) == (2002, 0, 0)
        assert handler.WritePosEx(1, 1800, 2400, 50) == (0, 0)  # torque comes on by itself
        assert eventually(lambda: abs(sts.true_ticks(1) - 1800) < 20)
        for servo_id in (1, 2):
            assert handler.SyncWritePosEx(servo_id, 2300, 2400, 50)
        assert handler.groupSyncWrite.txPacket() == 0
        assert eventually(lambda: all(abs(sts.true_ticks(i) - 2300) < 20 for i in (1, 2)))
        group = self.sdk.GroupSyncRead(handler, 56, 4)
        for servo_id in (1, 2):
            assert group.addParam(servo_id)
        assert group.txRxPacket() == 0
        for servo_id in (1, 2):
            assert group.isAvailable(servo_id, 56, 2)[0]
            assert group.getData(servo_id, 56, 2) == pytest.approx(2300, abs=20)
        port.closePort()

    def test_the_lock_of_the_memory(self, sts: SimulatedPort) -> None:
        port = self.open(sts)
        handler = self.sdk.sms_sts(port)
        assert handler.unLockEprom(1) == (0, 0)
        assert handler.write2ByteTxRx(1, 31, 2048 + 85) == (0, 0)
        assert handler.LockEprom(1) == (0, 0)
        assert handler.ReadPos(1)[0] == 2001 + 85
        port.closePort()

    def test_scs_servos(self, scs: SimulatedPort) -> None:
        port = self.open(scs)
        handler = self.sdk.scscl(port)
        assert handler.ping(1) == (1284, 0, 0)
        assert handler.ReadPos(2) == (502, 0, 0)
        assert handler.WritePos(1, 700, 0, 500) == (0, 0)
        assert eventually(lambda: abs(scs.true_ticks(1) - 700) < 8)
        port.closePort()
