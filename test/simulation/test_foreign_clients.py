"""Programs of others talk to simulated servos: they know nothing of this package."""

from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType
from typing import Any

import pytest
from waiting import wait_for

from head_tracking.dynamixel.models import servo_model
from head_tracking.simulation import SimulatedPort, SimulatedServo

TIMEOUT = 2.0  # s for an answer: a busy machine is no fault


def simulated(name: str) -> SimulatedPort:
    """Return a port with two servos, one and two ticks beyond their center."""
    center = servo_model(name).center
    return SimulatedPort([SimulatedServo(i, name, position=center + i) for i in (1, 2)])


def arrive(port: SimulatedPort, goals: dict[int, int]) -> bool:
    """Return whether the servos come to these ticks."""

    def is_there() -> bool:
        here = port.use(lambda bus: {servo: bus[servo].true_ticks for servo in goals})
        return all(abs(here[servo] - goal) < 20 for servo, goal in goals.items())

    return wait_for(is_there)


# rustypot: a driver in Rust with protocols of its own


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("AX-12", "Ax"),
        ("MX-28", "Mx"),
        ("XL-320", "Xl320"),
        ("XL330-M288", "Xl330"),
        ("STS3215", "Sts3215"),
        ("SCS0009", "Scs0009"),
    ],
)
def test_rustypot_reads_and_moves_servos(name, kind):
    library = pytest.importorskip("rustypot", reason="rustypot is not installed")
    model = servo_model(name)
    raw = name == "XL-320"  # the library has no radians for it
    tick, center = (1, 0) if raw else (model.radians_per_tick, model.center)
    goals = {1: model.center - model.ticks // 10, 2: model.center + model.ticks // 8}
    with simulated(name) as port:
        controller = getattr(library, f"{kind}PyController")(port.port_name, 1_000_000, TIMEOUT)
        assert controller.ping(1)
        if name != "SCS0009":  # the library has its bytes in the wrong order
            assert controller.read_model_number(2) == [model.model_number]
        position = (model.center + 1 - center) * tick
        assert controller.read_present_position(1) == pytest.approx([position], abs=2.1 * tick)
        if kind in ("Xl330", "Sts3215"):
            assert controller.sync_read_raw_present_position([1, 2]) == [2049, 2050]
        controller.sync_write_torque_enable([1, 2], [True, True])
        controller.sync_write_goal_position(
            [1, 2], [(goal - center) * tick for goal in goals.values()]
        )
        assert arrive(port, goals)
        controller.close()


# the SDKs of the makers, as their examples use them


@contextmanager
def opened(sdk: ModuleType, name: str) -> Iterator[tuple[SimulatedPort, Any]]:
    """Open simulated servos with an SDK that waits longer than it usually does."""
    with simulated(name) as port:
        handler = sdk.PortHandler(port.port_name)
        assert handler.openPort()
        assert handler.setBaudRate(1_000_000)
        original = handler.setPacketTimeout

        def wait_longer(length: int) -> None:
            original(length)
            handler.packet_timeout = TIMEOUT * 1e3

        handler.setPacketTimeout = wait_longer
        yield port, handler
        handler.closePort()


@pytest.fixture
def dynamixel_sdk():
    return pytest.importorskip("dynamixel_sdk")


@pytest.fixture
def scservo_sdk():
    sdk = pytest.importorskip("scservo_sdk", reason="ftservo-python-sdk is not installed")
    if not hasattr(sdk, "sms_sts"):
        pytest.skip("the older feetech-servo-sdk is installed, which has the same module name")
    return sdk


def test_ax_servos(dynamixel_sdk):
    handler = dynamixel_sdk.PacketHandler(1.0)
    with opened(dynamixel_sdk, "AX-12") as (ax, port):
        assert handler.ping(port, 1) == (12, 0, 0)
        assert handler.read2ByteTxRx(port, 1, 36) == (513, 0, 0)
        assert handler.write2ByteTxRx(port, 1, 30, 600) == (0, 0)
        assert arrive(ax, {1: 600})
        assert handler.write2ByteTxRx(port, 1, 30, 2000) == (0, 8)


def test_x_servos(dynamixel_sdk):
    handler = dynamixel_sdk.PacketHandler(2.0)
    with opened(dynamixel_sdk, "XL330-M288") as (_, port):
        assert handler.ping(port, 1) == (1200, 0, 0)
        assert handler.read4ByteTxRx(port, 1, 132) == (2049, 0, 0)
        group = dynamixel_sdk.GroupSyncRead(port, handler, 132, 4)
        for servo_id in (1, 2):
            assert group.addParam(servo_id)
        assert group.txRxPacket() == 0
        assert [group.getData(i, 132, 4) for i in (1, 2)] == [2049, 2050]
        assert handler.write1ByteTxRx(port, 1, 64, 1) == (0, 0)
        assert handler.write1ByteTxRx(port, 1, 9, 0) == (0, 7)  # EEPROM with torque on
        found, result = handler.broadcastPing(port)
        assert result == 0
        assert {i: data[0] for i, data in found.items()} == {1: 1200, 2: 1200}
        assert handler.reboot(port, 1) == (0, 0)


def test_sts_servos(scservo_sdk):
    with opened(scservo_sdk, "STS3215") as (sts, port):
        handler = scservo_sdk.sms_sts(port)
        assert handler.ping(1) == (777, 0, 0)
        assert handler.ReadPos(2) == (2050, 0, 0)
        assert handler.WritePosEx(1, 1800, 2400, 50) == (0, 0)  # torque comes on by itself
        assert arrive(sts, {1: 1800})
        for servo_id in (1, 2):
            assert handler.SyncWritePosEx(servo_id, 2300, 2400, 50)
        assert handler.groupSyncWrite.txPacket() == 0
        assert arrive(sts, {1: 2300, 2: 2300})
        group = scservo_sdk.GroupSyncRead(handler, 56, 4)
        for servo_id in (1, 2):
            assert group.addParam(servo_id)
        assert group.txRxPacket() == 0
        for servo_id in (1, 2):
            assert group.isAvailable(servo_id, 56, 2)[0]
            assert group.getData(servo_id, 56, 2) == pytest.approx(2300, abs=20)


def test_scs_servos(scservo_sdk):
    with opened(scservo_sdk, "SCS0009") as (scs, port):
        handler = scservo_sdk.scscl(port)
        assert handler.ping(1) == (1284, 0, 0)
        assert handler.ReadPos(2) == (servo_model("SCS0009").center + 2, 0, 0)
        assert handler.WritePos(1, 700, 0, 500) == (0, 0)
        assert arrive(scs, {1: 700})
