"""new-robot on simulated servos: from a port with unknown servos to a head that tracks."""

from __future__ import annotations

import io
import math
import time
from pathlib import Path

import pytest
import yaml
from simulated_device import Bench

from head_tracking import Head
from head_tracking.cli import new_robot
from head_tracking.cli.servo.bench import Terminal, Workshop
from head_tracking.command_line import DONE, FAILED, REFUSED
from head_tracking.simulation import SimulatedPort, SimulatedServo


class Keyboard(io.StringIO):
    def isatty(self) -> bool:
        return True


class Newcomer:
    """Somebody with a head that nobody has described: tilt is servo 5, pan 9, an arm has 3."""

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
        self.shown: list[str] = []
        self._monkeypatch = monkeypatch
        monkeypatch.setattr(Terminal, "wait_for_enter", lambda *_: self._move(self.poses.pop(0)))

    def _move(self, pose: dict[int, int]) -> None:
        bus, clock = self.bench.bus, self.bench.clock
        for number, tick in pose.items():
            bus.advance(clock.now)
            bus[number].lead(tick, 0.5, 2.0)
            self.bench.pass_time(2.0)
            bus.advance(clock.now)

    def run(self, *arguments: str) -> int:
        def workshop(terminal: Terminal, port_name: str, baud_rate: int) -> Workshop:
            return Workshop(
                terminal, port_name, baud_rate, lambda *_: self.bench.port, clock=self.bench.clock
            )

        def show(command: list[str]) -> int:
            self.shown = command
            return DONE

        self._monkeypatch.setattr("sys.stdin", Keyboard(self.answers))
        words = ["my_head", "--folder", str(self.folder), "--port", "/dev/sim", *arguments]
        return new_robot.main(words, workshop, show)

    @property
    def files(self) -> list[Path]:
        return sorted(self.folder.iterdir())

    def motors(self) -> list[dict[str, object]]:
        values = yaml.safe_load((self.folder / "my_head.yaml").read_text())
        bus = values["/**/servo_bus"]["ros__parameters"]
        return [bus[f"{name}_controller"]["motor"] for name in bus["dynamixels"]]


@pytest.fixture
def newcomer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Newcomer:
    return Newcomer(tmp_path, monkeypatch)


BY_HAND = [{}, {9: 600}, {9: 2600}, {9: 1500, 5: 2900}, {5: 1700}]
"""Ahead, left, right, up, down: both servos are mounted the other way round."""

GIVEN = ("--pan", "9", "--tilt", "5")


def test_a_head_that_nobody_has_described_tracks(newcomer: Newcomer) -> None:
    newcomer.poses = [dict(pose) for pose in BY_HAND]
    newcomer.answers = "0 0 0.12\n0 0.01 0.05\n0.04 0 0.02\n"
    before = newcomer.bench.bus[3].true_ticks
    assert newcomer.run("--show") == DONE
    assert newcomer.bench.bus[3].true_ticks == before
    pan, tilt = newcomer.motors()
    assert (pan["id"], tilt["id"]) == (9, 5)
    assert pan["init"] == pytest.approx(1500, abs=3)
    assert pan["min"] == pytest.approx(2580, abs=5)  # 0.03 rad, 20 ticks, from the end
    assert pan["max"] == pytest.approx(620, abs=5)
    assert tilt["min"] == pytest.approx(2880, abs=5)
    assert tilt["max"] == pytest.approx(1720, abs=5)
    model = newcomer.folder / "my_head.urdf.xacro"
    assert str(model) in newcomer.shown

    servos = [
        SimulatedServo(i, "XL430-W250", position=p) for i, p in ((3, 2048), (5, 2100), (9, 1500))
    ]
    with SimulatedPort(servos) as port, Head.open(port.port_name, robot=model) as head:
        frames = head.frames
        camera = frames.lookup_transform("base_link", "camera_link").transform.translation
        assert camera == pytest.approx((0.04, 0.01, 0.19), abs=0.002)
        upper_left = (2.0, 0.8, 0.7)
        assert head.look_at(upper_left).arrived
        assert servos[2].true_ticks < 1400 and servos[1].true_ticks > 2200
        begin = time.monotonic()
        worst = 0.0
        while (now := time.monotonic() - begin) < 4.0:
            point = (2.0, 0.8 * math.cos(now), 0.3)
            head.follow(point)
            if now > 1.5:
                x, y, z = frames.lookup_transform("camera_link", "base_link").transform @ point
                worst = max(worst, math.hypot(y, z) / x)
            time.sleep(0.03)
    assert worst < math.radians(10.0)


def test_a_joint_with_two_servos_is_described(newcomer: Newcomer) -> None:
    newcomer.poses = [{}, {9: 600}, {9: 2600}, {9: 1500, 5: 2900, 3: 1250}, {5: 1700, 3: 2450}]
    newcomer.answers = "\n\n\ny\n"
    assert newcomer.run() == DONE
    text = yaml.safe_load((newcomer.folder / "my_head.yaml").read_text())
    bus = text["/**/servo_bus"]["ros__parameters"]
    tilt = bus["head_tilt_controller"]
    assert {tilt["motor"]["id"], tilt["second_motor"]["id"]} == {3, 5}
    assert "second_motor" not in bus["head_pan_controller"]
    directions = [motor["max"] - motor["min"] for motor in (tilt["motor"], tilt["second_motor"])]
    assert directions[0] * directions[1] < 0
    with Head.simulated(robot=newcomer.folder / "my_head.urdf.xacro") as head:
        assert head.look_at((2.0, 0.8, 0.3)).arrived


def test_options_replace_the_poses(newcomer: Newcomer) -> None:
    options = ("--pan-zero", "1500", "--reverse-tilt", "--tilt-range", "-30", "20")
    assert newcomer.run(*GIVEN, *options, "--pan-xyz", "0", "0", "0.3", "--yes") == DONE
    pan, tilt = newcomer.motors()
    assert (pan["init"], pan["min"], pan["max"]) == (1500, 476, 2524)
    assert (tilt["init"], tilt["min"], tilt["max"]) == (2048, 2389, 1820)
    assert newcomer.shown == []
    with Head.simulated(robot=newcomer.folder / "my_head.urdf.xacro") as head:
        camera = head.frames.lookup_transform("base_link", "camera_link").transform.translation
        assert camera[2] == pytest.approx(0.37, abs=0.002)


def test_the_direction_in_the_memory_of_a_servo_is_noted(newcomer: Newcomer) -> None:
    newcomer.bench.bus[5].set_register("Drive Mode", 1)
    assert newcomer.run(*GIVEN, "--yes") == DONE
    assert [motor["reverse"] for motor in newcomer.motors()] == [0, 1]


def test_feetech_servos_are_described_with_the_offset_in_their_memory(newcomer: Newcomer) -> None:
    newcomer.bench = Bench([SimulatedServo(5, "STS3215"), SimulatedServo(9, "STS3215")])
    newcomer.bench.bus[5].set_offset(-85)
    assert newcomer.run(*GIVEN, "--yes") == DONE
    pan, tilt = newcomer.motors()
    assert (pan["model"], pan["offset"], tilt["offset"]) == ("STS3215", 0, -85)
    with Head.simulated(robot=newcomer.folder / "my_head.urdf.xacro") as head:
        assert head.look_at((2.0, 0.8, 0.3)).arrived


def test_a_camera_on_its_side_is_described(newcomer: Newcomer) -> None:
    assert newcomer.run(*GIVEN, "--camera-roll", "90", "--yes") == DONE
    with Head.simulated(robot=newcomer.folder / "my_head.urdf.xacro") as head:
        turned = head.frames.lookup_transform(
            "base_link", "camera_optical_frame"
        ).transform.rotation
        assert turned @ (1.0, 0.0, 0.0) == pytest.approx((0.0, 0.0, -1.0), abs=0.01)


@pytest.mark.parametrize("name", ["my_head.yaml", "my_head.urdf.xacro"])
def test_nothing_is_overwritten(newcomer: Newcomer, name: str) -> None:
    (newcomer.folder / name).write_text("precious")
    assert newcomer.run(*GIVEN, "--yes") == REFUSED
    assert (newcomer.folder / name).read_text() == "precious"
    assert len(newcomer.files) == 1


def test_torque_stays_as_it_is_until_somebody_agrees(newcomer: Newcomer) -> None:
    newcomer.bench.bus[5].set_register("Torque Enable", 1)
    newcomer.answers = "\n\n\nn\n"
    assert newcomer.run() == REFUSED
    assert newcomer.bench.bus[5].register("Torque Enable") == 1
    assert newcomer.files == []


@pytest.mark.parametrize(
    "poses",
    [
        [{}, {}, {}, {}, {}],  # nothing was moved
        [{}, {9: 600}, {9: 2600}, {9: 600}, {9: 2600}],  # pan moves in place of tilt
        [{}, {9: 600, 5: 1000}, {9: 2600, 5: 3000}, {}, {}],  # two at once
        [{}, {9: 600, 5: 1500}, {9: 2600, 5: 2800}, {}, {}],  # two at once, not alike
        [{9: 600}, {}, {9: 2600}, {5: 2900}, {5: 1700}],  # zero is at the end of the range
    ],
    ids=["none", "same", "both", "unlike", "zero"],
)
def test_poses_that_make_no_sense_are_refused(
    newcomer: Newcomer, poses: list[dict[int, int]]
) -> None:
    newcomer.poses = [dict(pose) for pose in poses]
    assert newcomer.run() == REFUSED
    assert newcomer.files == []


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
def test_options_that_are_not_possible_are_refused(
    newcomer: Newcomer, arguments: tuple[str, ...]
) -> None:
    assert newcomer.run(*arguments, "--yes") == REFUSED
    assert newcomer.files == []


def test_servos_that_do_not_answer_are_an_error(newcomer: Newcomer) -> None:
    assert newcomer.run("--pan", "7", "--tilt", "5", "--yes") == FAILED
    assert newcomer.files == []


def test_a_folder_that_is_not_there_is_an_error(newcomer: Newcomer) -> None:
    assert newcomer.run(*GIVEN, "--folder", str(newcomer.folder / "none"), "--yes") == FAILED


@pytest.mark.parametrize(
    "arguments",
    [("my head",), ("my_head", "--pan", "300"), ("my_head", "--pan-xyz", "0", "x", "0")],
)
def test_a_wrong_command_line_ends_with_2(
    arguments: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(SystemExit) as end:
        new_robot.main(arguments)
    assert end.value.code == 2


def test_an_answer_that_is_no_measure_is_asked_for_again(newcomer: Newcomer) -> None:
    newcomer.answers = "high\n0 0\n0 0 0.4\n\n\n"
    assert newcomer.run(*GIVEN) == DONE
    with Head.simulated(robot=newcomer.folder / "my_head.urdf.xacro") as head:
        camera = head.frames.lookup_transform("base_link", "camera_link").transform.translation
        assert camera[2] == pytest.approx(0.47, abs=0.002)
