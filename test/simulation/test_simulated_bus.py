"""What simulated servos on a bus answer: published packets (e-manual), and group reads."""

import pytest
from waiting import wait_for

from head_tracking.configuration.simulated import SimulatedJoints
from head_tracking.dynamixel import JointConfiguration, ServoCalibration, servo_model
from head_tracking.dynamixel.protocol import sync_read_packet
from head_tracking.simulation import SerialLine, SimulatedBus, SimulatedServo
from head_tracking.simulation.packets import Status, decode_status

OK = "FF FF 01 02 00 FC"
AX = [
    ("FF FF 01 02 01 FB", [OK]),  # ping
    ("FF FF 01 04 02 2B 01 CC", ["FF FF 01 03 00 1E DD"]),  # temperature: 30
    ("FF FF 01 04 02 24 02 D2", ["FF FF 01 04 00 00 02 F8"]),  # position: 512
    ("FF FF 01 04 02 24 02 D3", ["FF FF 01 02 10 EC"]),  # with a wrong checksum
    ("FF FF 01 04 02 24 08 CC", ["FF FF 01 0A 00 00 02 00 00 00 00 78 1E 5C"]),  # 36 to 43
    ("FF FF 01 04 02 00 02 F6", ["FF FF 01 04 00 0C 00 EE"]),  # model: 12
    ("FF FF 01 04 03 18 01 DE", [OK]),  # torque on
    ("FF FF 01 05 03 1E 00 02 D6", [OK]),  # goal 512
    ("FF FF 01 07 03 1E 00 02 64 00 70", [OK]),  # goal 512, speed 100
    ("FF FF 01 05 03 22 FF 03 D2", [OK]),  # torque limit 1023
    ("FF FF 01 05 04 1E F4 01 E2", ["FF FF 01 02 40 BC"]),  # reg write: not supported
    ("FF FF 00 02 06 F7", ["FF FF 00 02 40 BD"]),  # factory reset: not supported
    ("FF FF FE 04 03 18 00 E2", []),  # torque off, to all
    ("FF FF FE 02 05 FA", []),  # action
    ("FF FF FE 09 92 00 02 01 1E 02 02 24 1D", []),  # bulk read: not of these servos
]
OK_2 = "FF FF FD 00 01 04 00 55 00 A1 0C"
XM430_W210 = [
    ("FF FF FD 00 01 03 00 01 19 4E", ["FF FF FD 00 01 07 00 55 00 06 04 26 65 5D"]),  # ping
    ("FF FF FD 00 FE 03 00 01 31 42", ["FF FF FD 00 01 07 00 55 00 06 04 26 65 5D"]),  # of all
    (
        "FF FF FD 00 01 07 00 02 84 00 04 00 1D 15",  # position: 166
        ["FF FF FD 00 01 08 00 55 00 A6 00 00 00 8C C0"],
    ),
    ("FF FF FD 00 01 06 00 03 40 00 01 DB 66", [OK_2]),  # torque on
    ("FF FF FD 00 01 09 00 03 74 00 00 02 00 00 CA 89", [OK_2]),  # goal 512
    ("FF FF FD 00 01 03 00 08 2F 4E", [OK_2]),  # reboot
    (
        "FF FF FD 00 FE 09 00 82 84 00 04 00 01 02 CE FA",  # sync read of 1 and 2
        ["FF FF FD 00 01 08 00 55 00 A6 00 00 00 8C C0"],
    ),
]


def answers(bus: SimulatedBus, sent: str) -> list[str]:
    found = bus.receive(bytes.fromhex(sent), 0)
    return [answer.data.hex(" ").upper() for answer in found]


def bus() -> SimulatedBus:
    return SimulatedBus([SimulatedServo(0), SimulatedServo(1), SimulatedServo(2)])


@pytest.mark.parametrize(("sent", "expected"), AX)
def test_published_packets_are_answered(sent, expected):
    assert answers(bus(), sent) == expected


@pytest.mark.parametrize(("sent", "expected"), XM430_W210)
def test_published_packets_of_protocol_2_are_answered(sent, expected):
    servo = SimulatedServo(1, "XM430-W210", position=166, firmware=38)
    assert answers(SimulatedBus([servo]), sent) == expected


@pytest.mark.parametrize("paced", [False, True])
@pytest.mark.parametrize(("model", "address"), [("STS3215", 56), ("XM430-W350", 132)])
def test_answers_without_a_return_delay_do_not_collide(model, address, paced):
    """lerobot sets the return delay of Feetech servos to 0."""
    b = SimulatedBus([SimulatedServo(i, servo_model(model)) for i in (1, 2)])
    for servo_id in (1, 2):
        b[servo_id].set_register("Return Delay Time", 0)
    asked = sync_read_packet(b[1].model.protocol, (1, 2), address, 2)
    alone = b.receive(asked, 0)
    assert [answer.delay for answer in alone] == [0, 0]
    line = SerialLine(b, paced=paced)
    line.send(asked, 0, 1_000_000)
    assert line.receive(10_000_000) == b"".join(answer.data for answer in alone)
    assert not line.overlaps


# Several


def test_bulk_read_reads_what_each_is_asked():
    published = "FF FF FD 00 FE 0D 00 92 01 90 00 02 00 02 92 00 01 00 1A 05"
    bus = SimulatedBus([SimulatedServo(i, "XM430-W350") for i in (1, 2)])
    answers = bus.receive(bytes.fromhex(published), 0)
    assert [decode_status(2, answer.data) for answer in answers] == [
        Status(1, 0, (120).to_bytes(2, "little")),
        Status(2, 0, bytes((30,))),
    ]


def test_bulk_read_of_protocol_1_is_for_mx_servos():
    published = bytes.fromhex("FF FF FE 09 92 00 02 01 1E 02 02 24 1D")
    servos = [SimulatedServo(i, "MX-28", position=1000 + i) for i in (1, 2)]
    answers = SimulatedBus(servos).receive(published, 0)
    assert [decode_status(1, answer.data) for answer in answers] == [
        Status(1, 0, (1001).to_bytes(2, "little")),
        Status(2, 0, (1002).to_bytes(2, "little")),
    ]
    assert SimulatedBus([SimulatedServo(i, "AX-12") for i in (1, 2)]).receive(published, 0) == []


def test_two_servos_of_a_joint_are_coupled():
    second = ServoCalibration("lift", 8, 500, 900, 100)
    joint = JointConfiguration("lift", 7, controller="lift_controller", second=second)
    joints = SimulatedJoints([joint])
    assert joints.use(lambda bus: [servo.id for servo in bus]) == [7, 8]
    joints.use(lambda bus: bus[7].lead(joint.ticks(0.5), 0.1))
    wait_for(lambda: abs(second.position(joints.use(lambda bus: bus[8].true_ticks)) - 0.5) < 0.06)
