"""Packets of Feetech servos, as the maker's page prints them (ftservo-wiki 9522ce1, ft-scs.md)."""

import pytest

from head_tracking.dynamixel import servo_model
from head_tracking.dynamixel.protocol import (
    encode_packet,
    read_packet,
    sync_read_packet,
    sync_write_packet,
    write_packet,
)
from head_tracking.simulation import SimulatedBus, SimulatedServo

STS = servo_model("STS3215")
SPEED_1000 = bytes.fromhex("00 08 00 00 E8 03")  # position 2048, time 0, 1000 steps/s
OK = "FF FF 01 02 00 FC"
AT_1304 = "FF FF 01 0A 00 18 05 00 00 00 00 77 23 3D"  # 11.9 V, 35 degrees
AT_2047 = "FF FF 02 0A 00 FF 07 00 00 00 00 77 23 53"

VECTORS = {
    "ping": ("FF FF 01 02 01 FB", encode_packet(1, 1, 0x01), [OK]),
    "read position": (
        *("FF FF 01 04 02 38 02 BE", read_packet(1, 1, 56, 2)),
        ["FF FF 01 04 00 18 05 DD"],
    ),
    "write id": ("FF FF FE 04 03 05 01 F4", write_packet(1, 254, 5, b"\x01"), []),
    "write goal": (
        *("FF FF 01 09 03 2A 00 08 00 00 E8 03 D5", write_packet(1, 1, 42, SPEED_1000)),
        [OK],
    ),
    "sync write": (
        "FF FF FE 20 83 2A 06 01 00 08 00 00 E8 03 02 00 08 00 00 E8 03 "
        "03 00 08 00 00 E8 03 04 00 08 00 00 E8 03 58",
        sync_write_packet(1, 42, dict.fromkeys((1, 2, 3, 4), SPEED_1000)),
        [],
    ),
    "sync read": (
        *("FF FF FE 06 82 38 08 01 02 36", sync_read_packet(1, (1, 2), 56, 8)),
        [AT_1304, AT_2047],
    ),
}


@pytest.mark.parametrize(("printed", "ours", "answers"), VECTORS.values(), ids=VECTORS)
def test_driver_and_simulated_servos_send_what_the_maker_prints(
    printed: str, ours: bytes, answers: list[str]
) -> None:
    assert ours == bytes.fromhex(printed)
    servos = [SimulatedServo(1, STS, position=1304), SimulatedServo(2, STS, position=2047)]
    for servo in servos:
        servo.supply_voltage, servo.temperature = 11.9, 35.0
    answered = [answer.data for answer in SimulatedBus(servos).receive(ours, 0)]
    assert answered == [bytes.fromhex(answer) for answer in answers]
    if SPEED_1000 in ours:
        names = ("Goal Position", "Moving Speed", "Torque Enable")
        assert [servos[0].register(name) for name in names] == [2048, 1000, 1]


def test_values_of_scs_servos_have_the_high_byte_first() -> None:
    scs = servo_model("SCS0009")
    values = scs.goal_values((0x0123, 0x0245, 0))
    assert scs.goal.encode(*values) == bytes.fromhex("01 23 00 00 02 45")
    assert scs.control_table.block("Model Number").layout.unpack(b"\x05\x04") == (1284,)


def test_what_is_written_under_the_lock_is_forgotten_at_power_off() -> None:
    servo = SimulatedServo(1, STS)
    bus = SimulatedBus([servo])
    bus.receive(write_packet(1, 1, 13, b"\x3c"), 0)
    assert servo.register("Temperature Limit") == 60
    servo.power_off()
    servo.power_on()
    assert servo.register("Temperature Limit") == 70
    bus.receive(write_packet(1, 1, 55, b"\0"), 1_000_000_000)
    bus.receive(write_packet(1, 1, 13, b"\x3c"), 1_000_000_000)
    servo.power_off()
    servo.power_on()
    assert servo.register("Temperature Limit") == 60
