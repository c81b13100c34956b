"""new-robot on simulated servos: from unknown servos to a head that points."""

from pathlib import Path

import pytest
import yaml
from simulated_device import Bench, Keyboard
from waiting import wait_for

from head_tracking import Head
from head_tracking.cli import new_robot
from head_tracking.cli.servo.session import Session
from head_tracking.cli.terminal import Terminal
from head_tracking.command_line import DONE, FAILED, REFUSED
from head_tracking.configuration import configured_head
from head_tracking.exceptions import RefusedError
from head_tracking.simulation import SimulatedPort, SimulatedServo
from head_tracking.transforms import load_robot_model


class User:
    """A user with an unknown head: tilt is servo 5, pan is servo 9, servo 3 belongs to an arm."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.folder = folder
        self.bench = Bench(
            [
                SimulatedServo(3, "XL430-W250"),
                SimulatedServo(5, "XL430-W250", position=2100),
                SimulatedServo(9, "XL430-W250", position=1500),
            ]
        )
        self.answers = ""
        self.poses: list[dict[int, int]] = []
        self._monkeypatch = monkeypatch
        monkeypatch.setattr(Terminal, "wait_for_enter", lambda *_: self._move())

    def _move(self) -> None:
        if not self.poses:
            raise RefusedError("the input has ended")
        for number, tick in self.poses.pop(0).items():
            self.bench.turn_by_hand(number, tick)

    def run(self, *arguments: str) -> int:
        def session(terminal: Terminal, port_name: str, baud_rate: int) -> Session:
            return Session(terminal, port_name, baud_rate, lambda *_: self.bench.port)

        self._monkeypatch.setattr("sys.stdin", Keyboard(self.answers))
        words = ["my_head", "--folder", str(self.folder), "--port", "/dev/sim", *arguments]
        return new_robot.main(words, session)

    @property
    def files(self) -> list[Path]:
        return sorted(self.folder.iterdir())

    def motors(self) -> list[dict[str, object]]:
        values = yaml.safe_load((self.folder / "my_head.yaml").read_text())
        bus = values["/**/servo_bus"]["ros__parameters"]
        return [bus[f"{name}_controller"]["motor"] for name in bus["dynamixels"]]


@pytest.fixture
def user(tmp_path, monkeypatch):
    return User(tmp_path, monkeypatch)


BY_HAND = [{}, {9: 2600}, {9: 600}, {9: 1500}, {5: 2900}, {5: 1700}]
"""Ahead, right, left, ahead, up, down: both servos are mounted the other way round."""

GIVEN = ("--pan", "9", "--tilt", "5")


def test_an_unknown_head_is_described_and_points(user):
    user.poses = [dict(pose) for pose in BY_HAND]
    user.answers = "high\n0 0\n0 0 0.12\n0 0.01 0.05\n0.04 0 0.02\n"  # two are asked again
    before = user.bench.bus[3].true_ticks
    assert user.run() == DONE
    assert user.bench.bus[3].true_ticks == before
    pan, tilt = user.motors()
    assert (pan["id"], tilt["id"]) == (9, 5)
    assert pan["init"] == pytest.approx(1500, abs=3)
    assert pan["min"] == pytest.approx(2580, abs=5)  # 0.03 rad, 20 ticks, from the end
    assert pan["max"] == pytest.approx(620, abs=5)
    assert tilt["min"] == pytest.approx(2880, abs=5)
    assert tilt["max"] == pytest.approx(1720, abs=5)
    model = user.folder / "my_head.urdf.xacro"

    servos = [
        SimulatedServo(i, "XL430-W250", position=p) for i, p in ((3, 2048), (5, 2100), (9, 1500))
    ]
    joints = configured_head([user.folder / "my_head.yaml"]).servos
    with (
        SimulatedPort(servos) as port,
        Head(port.port_name, load_robot_model(model), joints, reply_timeout=0.3) as head,
    ):
        frames = head.frames
        camera = frames.lookup_transform("base_link", "camera_link").transform.translation
        assert camera == pytest.approx((0.04, 0.01, 0.19), abs=0.002)
        upper_left = (2.0, 0.8, 0.7)
        wait_for(lambda: head.look_at(upper_left).arrived)
        assert servos[2].true_ticks < 1400 and servos[1].true_ticks > 2200


def test_a_joint_that_did_not_turn_is_named_and_asked_for_again(user, capsys):
    user.poses = [{}, {}, {}, *(dict(pose) for pose in BY_HAND)]
    user.answers = "\n\n\n"
    assert user.run() == DONE
    assert "the servo of head_pan did not turn" in capsys.readouterr().err


def test_a_joint_with_two_servos_is_described(user):
    user.poses = [*BY_HAND[:4], {5: 2900, 3: 1250}, {5: 1700, 3: 2450}]
    user.answers = "\n\n\ny\n"
    assert user.run() == DONE
    text = yaml.safe_load((user.folder / "my_head.yaml").read_text())
    bus = text["/**/servo_bus"]["ros__parameters"]
    tilt = bus["head_tilt_controller"]
    assert {tilt["motor"]["id"], tilt["second_motor"]["id"]} == {3, 5}
    assert "second_motor" not in bus["head_pan_controller"]
    directions = [motor["max"] - motor["min"] for motor in (tilt["motor"], tilt["second_motor"])]
    assert directions[0] * directions[1] < 0
    with Head.simulated(robot=user.folder / "my_head.urdf.xacro") as head:
        assert head.look_at((2.0, 0.8, 0.3)).arrived


def test_options_replace_the_poses(user):
    options = ("--pan-zero", "1500", "--reverse-tilt", "--tilt-range", "-30", "20")
    place = ("--pan-xyz", "0", "0", "0.3", "--camera-roll", "90")
    user.bench.bus[5].set_register("Drive Mode", 1)
    assert user.run(*GIVEN, *options, *place, "--yes") == DONE
    pan, tilt = user.motors()
    assert (pan["init"], pan["min"], pan["max"]) == (1500, 476, 2524)
    assert (tilt["init"], tilt["min"], tilt["max"]) == (2048, 2389, 1820)
    assert (pan["reverse"], tilt["reverse"]) == (0, 1)  # of the servo's memory
    with Head.simulated(robot=user.folder / "my_head.urdf.xacro") as head:
        camera = head.frames.lookup_transform("base_link", "camera_optical_frame").transform
        assert camera.translation[2] == pytest.approx(0.37, abs=0.002)
        assert camera.rotation @ (1.0, 0.0, 0.0) == pytest.approx((0.0, 0.0, -1.0), abs=0.01)


def test_feetech_servos_are_described_with_the_offset_in_their_memory(user):
    user.bench = Bench([SimulatedServo(5, "STS3215"), SimulatedServo(253, "STS3215")])
    user.bench.bus[5].set_offset(-85)
    user.poses = [{}, {253: 2600}, {253: 600}, {253: 1500}, {5: 2900}, {5: 1700}]
    assert user.run("--yes") == DONE
    pan, tilt = user.motors()
    assert (pan["id"], pan["model"], pan["offset"], tilt["offset"]) == (253, "STS3215", 0, -85)
    with Head.simulated(robot=user.folder / "my_head.urdf.xacro") as head:
        assert head.look_at((2.0, 0.8, 0.3)).arrived


@pytest.mark.parametrize("name", ["my_head.yaml", "my_head.urdf.xacro"])
def test_nothing_is_overwritten(user, name):
    (user.folder / name).write_text("precious")
    assert user.run(*GIVEN, "--yes") == REFUSED
    assert (user.folder / name).read_text() == "precious"
    assert len(user.files) == 1


def test_a_file_that_another_program_writes_meanwhile_stays(user, monkeypatch):
    other = user.folder / "my_head.yaml"
    monkeypatch.setattr(new_robot, "PanTiltHead", lambda *_: other.write_text("precious"))
    assert user.run(*GIVEN, "--yes") == FAILED
    assert user.files == [other]
    assert other.read_text() == "precious"


def test_a_full_disk_leaves_no_file(user, monkeypatch):
    open_file = Path.open

    def open_on_full_disk(path, mode="r", *others, **named):
        if (mode, path.suffix) == ("x", ".yaml"):
            path.symlink_to("/dev/full")
            mode = "w"
        return open_file(path, mode, *others, **named)

    monkeypatch.setattr(Path, "open", open_on_full_disk)
    assert user.run(*GIVEN, "--yes") == FAILED
    assert user.files == []


def test_the_end_of_the_input_is_no_answer(user):
    user.answers = "0 0 0.1\n"  # then Ctrl-D
    assert user.run(*GIVEN) == REFUSED
    assert user.files == []


def test_torque_off_needs_confirmation(user):
    user.bench.bus[5].set_register("Torque Enable", 1)
    user.answers = "\n\n\nn\n"
    assert user.run() == REFUSED
    assert user.bench.bus[5].register("Torque Enable") == 1
    assert user.files == []


@pytest.mark.parametrize(
    "wrong",
    [
        [{}, {9: 600, 5: 1000}, {9: 2600, 5: 3000}],  # two at once, to the same side
        [{}, {9: 600, 5: 1500}, {9: 2600, 5: 2800}],  # two at once, not alike
        [{}, {9: 600}, {9: 1500}],  # pan to one side only
        [{9: 600}, {}, {9: 2600}],  # ahead at the end of the range
        [*BY_HAND[:5], {5: 2100}],  # tilt up only
        [*BY_HAND[:4], {9: 600}, {9: 2600}],  # pan in place of tilt
    ],
    ids=["both", "unlike", "pan", "zero", "tilt", "same"],
)
def test_a_joint_with_impossible_poses_is_asked_for_again(user, wrong):
    again = BY_HAND[4:] if len(wrong) > 3 else BY_HAND[1:]
    user.poses = [*wrong, {9: 1500, 5: 2100}, *again]
    user.answers = "0 0 0.12\n\n\n"
    assert user.run() == DONE
    pan, tilt = user.motors()
    assert [motor["id"] for motor in (pan, tilt)] == [9, 5]
    for motor, ticks in ((pan, (2580, 1500, 620)), (tilt, (2880, 2100, 1720))):
        assert [motor["min"], motor["init"], motor["max"]] == pytest.approx(ticks, abs=5)
    assert 'value="0 0 0.12"' in (user.folder / "my_head.urdf.xacro").read_text()


def test_two_servos_on_pan_leave_none_for_tilt(user):
    user.bench = Bench([SimulatedServo(n, "XL430-W250", position=2048) for n in (5, 9)])
    user.poses = [{}, {5: 1000, 9: 1000}, {5: 3000, 9: 3000}, {}, {}, {}, {}]
    user.answers = "\n\n\ny\n"
    assert user.run() == REFUSED
    assert len(user.poses) == 4
    assert user.files == []


@pytest.mark.parametrize(
    "arguments",
    [
        ("--pan", "9"),
        ("--pan", "9", "--tilt", "9"),
        (*GIVEN, "--pan-range", "90", "-90"),
        (*GIVEN, "--tilt-zero", "100"),
    ],
    ids=["tilt is missing", "same", "range", "beyond the servo"],
)
def test_impossible_options_are_refused(user, arguments):
    assert user.run(*arguments, "--yes") == REFUSED
    assert user.files == []


def test_servos_that_do_not_answer_and_a_missing_folder_are_errors(user):
    assert user.run("--pan", "7", "--tilt", "5", "--yes") == FAILED
    for folder in (str(user.folder / "none"), "/proc"):  # nothing can be written into /proc
        assert user.run("--folder", folder, "--yes") == FAILED  # before the head is moved by hand
    assert user.files == []
