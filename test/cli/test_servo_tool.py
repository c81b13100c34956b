"""The tool `servo` on simulated servos, in simulated time."""

import errno
import os
import shlex
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from random import Random

import pytest
import yaml
from simulated_device import Bench, Keyboard, as_device

from head_tracking.cli.servo import main as tool
from head_tracking.cli.servo.session import Session
from head_tracking.cli.terminal import Terminal
from head_tracking.command_line import DONE, FAILED, REFUSED
from head_tracking.dynamixel.exceptions import PortMissingError
from head_tracking.dynamixel.models import servo_model
from head_tracking.dynamixel.serial_port import port_error
from head_tracking.simulation import SimulatedBus, SimulatedLine, SimulatedPort, SimulatedServo
from head_tracking.simulation.faults import Fault, Faults

AX_12 = servo_model("AX-12")
XL430 = servo_model("XL430-W250")
XL_320 = servo_model("XL-320")


class Tool(Bench):
    """Simulated servos and the tool."""

    def __init__(self, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
        super().__init__(
            [
                SimulatedServo(1, AX_12, eeprom_time=0.006),
                SimulatedServo(2, AX_12, eeprom_time=0.006, position=300),
                SimulatedServo(7, XL430, eeprom_time=0.006, position=1000),
                SimulatedServo(8, XL_320, eeprom_time=0.006),
            ],
            reply_timeout=0.03,
        )
        for servo in self.bus:
            code = {rate: code for code, rate in servo.model.baud_rates.items()}[1_000_000]
            servo.set_register("Baud Rate", code)
        self.answers = ""
        self.impossible = 0
        self.accepts_any_rate = False
        self.on_enter: list[Callable[[], None]] = []
        self._capsys, self._monkeypatch = capsys, monkeypatch
        self.output = self.messages = ""

    def open_device(self, name: str, baud_rate: int) -> SimulatedLine:
        if name == "/dev/none":
            raise PortMissingError(name, ())
        if name == "/dev/null":
            raise port_error(name, OSError(errno.ENOTTY, "Could not configure port"))
        if baud_rate == self.impossible:
            raise port_error(name, ValueError("Failed to set custom baud rate"))
        match = not self.accepts_any_rate
        return as_device(SimulatedLine(self.bus, self.clock, baud_rate, match_baud_rate=match))

    def run(self, *arguments: str) -> int:
        """Run the tool; its text is in `output` and `messages` afterwards."""

        def session(terminal: Terminal, port_name: str, baud_rate: int) -> Session:
            return Session(terminal, port_name, baud_rate, self.make_port, self.pass_time)

        self._monkeypatch.setattr(Terminal, "wait_for_enter", lambda *_: self.on_enter.pop(0)())
        self._monkeypatch.setattr("sys.stdin", Keyboard(self.answers))
        code = tool.main(["--port", "/dev/sim", *arguments], session)
        captured = self._capsys.readouterr()
        self.output, self.messages = captured.out, captured.err
        return code

    def rows(self) -> list[list[str]]:
        """Return the words of each row of the printed table."""
        return [line.split() for line in self.output.splitlines()[1:]]

    def move_by_hand(self, servo_id: int, *ticks: int) -> None:
        """Turn a servo to the next tick at each Enter."""
        self.on_enter += [partial(self.turn_by_hand, servo_id, tick) for tick in ticks]


@pytest.fixture
def bench(capsys, monkeypatch):
    return Tool(capsys, monkeypatch)


# scan


@pytest.mark.parametrize(("ids", "any_rate"), [(["--ids", "0-10"], True), ([], False)])
def test_scan_lists_each_servo_once_with_its_baud_rate(bench, ids, any_rate):
    bench.accepts_any_rate = any_rate
    bench[2].set_register("Baud Rate", 34)
    bench[8].set_register("Status Return Level", 0)
    assert bench.run("scan", "--bauds", "1000000", "57600", "115200", *ids) == DONE
    assert bench.rows() == [
        ["1000000", "1", "AX-12", "(12)", "1.0"],
        ["1000000", "7", "XL430-W250", "(1060)", "2.0"],
        ["1000000", "8", "answers", "no", "reads", "2.0"],
        ["57600", "2", "AX-12", "(12)", "1.0"],
    ]
    assert "set-id" not in bench.messages


def test_scan_uses_the_rate_of_the_port_and_fails_without_servos(bench):
    bench[2].set_register("Baud Rate", 34)
    for arguments in (("--baud", "57600", "scan"), ("scan", "--baud", "57600")):
        assert bench.run(*arguments, "--ids", "0-10") == DONE
        assert [row[1] for row in bench.rows()] == ["2"]
    assert bench.run("scan", "--bauds", "1000000", "--ids", "30-33") == FAILED
    assert bench.output == ""


@pytest.mark.parametrize("rate", ["117600", "57600"])
def test_scan_skips_rates_that_adapter_or_port_do_not_support(bench, rate):
    bench.impossible = 57_600
    assert bench.run("scan", "--bauds", rate, "1000000", "--ids", "1") == DONE
    assert rate in bench.messages
    assert "AX-12" in bench.output
    assert bench.run("scan", "--bauds", rate, "--ids", "1") == FAILED
    assert bench.run("--port", "/dev/null", "scan", "--ids", "1") == FAILED
    assert len(bench.messages.splitlines()) == 1


@pytest.mark.parametrize(
    ("models", "ids"),
    [
        (("AX-12", "AX-12"), []),
        (("XL430-W250", "XL430-W250"), ["--ids", "0-5"]),
        (("AX-12", "XL430-W250"), ["--ids", "0-5"]),
    ],
)
def test_scan_warns_of_two_servos_with_one_id(bench, models, ids):
    first, second = models
    bench.bus = SimulatedBus([SimulatedServo(1, first), SimulatedServo(1, second, position=300)])
    bench.accepts_any_rate = True
    assert bench.run("scan", "--bauds", "1000000", *ids) == DONE
    assert "id 1 " in bench.messages and "set-id" in bench.messages


@pytest.mark.parametrize("seed", range(2))
def test_scan_finds_servos_whose_answers_are_sometimes_lost(bench, seed):
    bench.bus = SimulatedBus(bench.bus, faults=Faults(Random(seed), 0.2, [Fault.DROP]))
    assert bench.run("scan", "--bauds", "1000000", "--ids", "0-10") == DONE
    assert [row[1] for row in bench.rows()] == ["1", "2", "7", "8"]


# info


def test_info_shows_all_registers_in_units(bench):
    assert bench.run("info", "7") == DONE
    assert "servo 7: XL430-W250, protocol 2.0" in bench.output
    for register in XL430.control_table:
        assert (register.name in bench.output) == (not register.name.startswith("Indirect"))
    assert "-1.608 rad (-92.1°)" in bench.output
    assert "1000000 baud" in bench.output
    assert bench.run("info", "7", "--all") == DONE
    assert "Indirect Address 28" in bench.output


@pytest.mark.parametrize("servo_id", ["1", "7"])
@pytest.mark.parametrize("kind", [Fault.DROP, Fault.CORRUPT, Fault.STALL])
def test_info_reads_a_servo_whose_answers_are_often_lost_damaged_or_late(bench, servo_id, kind):
    bench.bus = SimulatedBus(bench.bus, faults=Faults(Random(1), 0.25, [kind]))
    assert bench.run("info", servo_id) == DONE, bench.messages
    assert "1000000 baud" in bench.output


@pytest.mark.parametrize(
    "command",
    [("info", "44"), ("info", "1"), ("--port", "/dev/none", "info", "7"), ("relax", "44")],
)
def test_a_command_for_a_servo_or_port_that_does_not_answer_fails(bench, command):
    bench[1].set_register("Status Return Level", 0)
    assert bench.run(*command) == FAILED
    assert bench.messages and not bench.output


# set


@pytest.mark.parametrize(
    ("servo_id", "name", "text", "value"),
    [
        (1, "LED", "1", 1),
        (7, "Max Position Limit", "90deg", 3072),
        (1, "12", "7.5V", 75),
        (7, "Homing Offset", "-100", -100),
        (7, "Homing Offset", "-5e-1 rad", -326),
        (1, "Return Delay Time", "500us", 250),
        (7, "Profile Velocity", "22.9rpm", 100),
        (7, "Bus Watchdog", "1s", 50),
    ],
)
def test_set_accepts_names_addresses_counts_and_quantities(bench, servo_id, name, text, value):
    bench[servo_id].set_register("Torque Enable", int(name == "Profile Velocity"))
    assert bench.run("--yes", "set", str(servo_id), name, text) == DONE
    name = "Min Voltage Limit" if name == "12" else name
    assert bench[servo_id].register(name) == value


@pytest.mark.parametrize(
    ("servo_id", "state", "command"),
    [
        (1, {"Lock": 1}, ("Temperature Limit", "60")),
        (7, {"Max Position Limit": 2000, "Torque Enable": 1}, ("Goal Position", "2001")),
        (7, {"Operating Mode": 4, "Torque Enable": 1}, ("Goal Position", "300")),
        (7, {"Operating Mode": 1}, ("Torque Enable", "1")),
        (1, {"CCW Angle Limit": 0}, ("Torque Enable", "1")),
        (8, {"Torque Enable": 1}, ("Temperature Limit", "60")),
    ],
)
def test_set_refuses_what_could_do_harm(bench, servo_id, state, command):
    for name, value in state.items():
        bench[servo_id].set_register(name, value)
    before = bench[servo_id].register(command[0])
    assert bench.run("--yes", "set", str(servo_id), *command) == REFUSED
    assert bench[servo_id].register(command[0]) == before


@pytest.mark.parametrize(("answer", "code"), [("y\n", DONE), ("\n", REFUSED)])
def test_set_asks_before_it_writes_eeprom(bench, answer, code):
    bench.answers = answer
    assert bench.run("set", "7", "temperature limit", "60") == code
    assert bench[7].register("Temperature Limit") == (60 if code == DONE else 72)


@pytest.mark.parametrize(
    ("register", "values"),
    [
        ("Colour", ["1"]),
        ("profile", ["1"]),
        ("Present Position", ["1"]),
        ("LED", ["2", "one", "0.5", "full"]),
        ("Max Voltage Limit", ["20V", "7rpm"]),
        ("Goal Position", ["1e99"]),
    ],
)
def test_set_of_impossible_values_fails(bench, register, values):
    for value in values:
        assert bench.run("--yes", "set", "7", register, value) == FAILED


def test_two_servos_with_one_id_are_named(bench):
    bench.bus = SimulatedBus([SimulatedServo(1, AX_12), SimulatedServo(1, "MX-28")])
    bench.accepts_any_rate = True
    assert bench.run("info", "1") == FAILED
    assert "two servos answer as id 1" in bench.messages


def test_a_feetech_servo_is_set_to_damping(bench):
    bench.bus = SimulatedBus([SimulatedServo(4, "STS3215")])
    assert bench.run("set", "4", "Torque Enable", "2") == DONE
    assert bench[4].register("Torque Enable") == 2


@pytest.mark.parametrize(("servo_id", "register"), [(1, "Moving Speed"), (7, "Goal Position")])
def test_a_goal_needs_torque_and_torque_on_keeps_the_present_position(bench, servo_id, register):
    servo, number = bench[servo_id], str(servo_id)
    servo.set_register("Goal Position", 900)
    stands = servo.true_ticks
    assert bench.run("set", number, register, "300") == REFUSED
    assert servo.register("Torque Enable") == 0
    assert bench.run("set", number, "Torque Enable", "1") == DONE
    bench.pass_time(1.0)
    assert servo.register("Torque Enable") == 1
    assert servo.true_ticks == pytest.approx(stands, abs=2)
    assert bench.run("set", number, register, "300") == DONE
    assert servo.register(register) == 300


@pytest.mark.parametrize(("servo_id", "level"), [(1, 0), (7, 1), (8, 0)])
def test_the_status_return_level_can_be_set_and_restored(bench, servo_id, level):
    assert bench.run("--yes", "set", str(servo_id), "Status Return Level", str(level)) == DONE
    assert bench[servo_id].register("Status Return Level") == level
    model = bench[servo_id].model.name
    back = ("--yes", "--model", model, "set", str(servo_id), "Status Return Level", "2")
    bench.pass_time(0.1)
    assert bench.run(*back) == DONE
    assert bench[servo_id].register("Status Return Level") == 2


@pytest.mark.parametrize(
    ("servo_id", "register", "answer"),
    [(1, "Moving Speed", "n\n"), (8, "Moving Speed", "y\n"), (7, "Profile Velocity", "n\n")],
)
def test_full_speed_is_set_by_its_name_and_a_goal_at_it_needs_confirmation(
    bench, servo_id, register, answer
):
    number = str(servo_id)
    assert bench.run("set", number, "Torque Enable", "1") == DONE
    for zero in ("0", "0.001 rad/s"):
        assert bench.run("--yes", "set", number, register, zero) == REFUSED
    assert bench[servo_id].register(register) == 1
    assert bench.run("set", number, "Goal Position", "600") == DONE
    assert bench.run("set", number, register, "full") == DONE
    assert bench[servo_id].register(register) == 0
    assert bench.run("info", number) == DONE
    assert "full speed" in bench.output and "0 rad/s  " not in bench.output.split(register)[1][:60]
    bench.answers = answer
    yes = answer == "y\n"
    assert bench.run("set", number, "Goal Position", "500") == (DONE if yes else REFUSED)
    assert "full speed" in bench.messages
    assert bench[servo_id].register("Goal Position") == (500 if yes else 600)


@pytest.mark.parametrize(("servo_id", "answer"), [(1, "y\n"), (7, "n\n")])
def test_torque_on_outside_the_limits_needs_confirmation(bench, servo_id, answer):
    servo, low = bench[servo_id], servo_id == 1
    servo.set_register("CCW Angle Limit" if low else "Min Position Limit", 400 if low else 1500)
    stands = round(servo.true_ticks)
    bench.answers = answer
    code = bench.run("set", str(servo_id), "Torque Enable", "1")
    assert str(stands) in bench.messages and str(400 if low else 1500) in bench.messages
    assert code == (DONE if answer == "y\n" else REFUSED)
    assert servo.register("Torque Enable") == (code == DONE)


def test_torque_on_is_refused_after_more_than_a_turn_by_hand(bench):
    bench.turn_by_hand(7, 5000)
    assert bench.run("set", "7", "Torque Enable", "1") == REFUSED
    assert bench[7].register("Torque Enable") == 0


def test_what_was_set_is_shown_in_counts_and_in_its_unit(bench):
    assert bench.run("--yes", "set", "1", "Return Delay Time", "100us") == DONE
    assert bench.output == "servo 1: Return Delay Time = 50, 100 µs\n"
    assert bench.run("set-baud", "1", "12345") == FAILED
    assert bench.messages.endswith(" 19200 baud, 9600 baud\n")  # not the counts of the register


def test_common_options_may_come_after_the_command(bench):
    assert bench.run("set", "7", "Temperature Limit", "60", "--yes") == DONE
    assert bench[7].register("Temperature Limit") == 60
    assert bench.run("info", "1", "--port", "/dev/none") == FAILED
    assert "/dev/none" in bench.messages
    bench[2].set_register("Baud Rate", 34)
    assert bench.run("info", "2", "--baud", "57600") == DONE
    bench[1].set_register("Status Return Level", 0)
    command = ("set", "1", "Status Return Level", "2", "--model", "AX-12", "--yes")
    assert bench.run(*command) == DONE


@pytest.mark.parametrize(
    ("rate", "arguments"),
    [(1_000_000, ["set", "7", "Goal Position", "1100"]), (57_600, ["info", "7"])],
)
def test_a_command_that_an_error_shows_can_be_typed(bench, rate, arguments):
    """It names program, port and baud rate: the defaults are perhaps those of another robot."""
    code = {value: key for key, value in bench[7].model.baud_rates.items()}[rate]
    bench[7].set_register("Baud Rate", code)
    bench[7].set_register("Status Return Level", 2 if rate == 1_000_000 else 0)
    given = ["--port", "/dev/left", "--baud", str(rate)]
    assert bench.run(*given, *arguments) in (FAILED, REFUSED)
    _, shown, command = bench.messages.strip().partition("head_tracking servo ")
    words = shlex.split(command.replace("MODEL", "XL430-W250"))
    assert shown and words[:2] == ["--port", "/dev/left"]
    assert bench.run(*words, "--yes") == DONE, bench.messages


# set-id, set-baud


def test_set_id_sets_a_free_id(bench):
    bench.answers = "n\n"
    assert bench.run("set-id", "1", "5") == REFUSED
    assert bench.run("--yes", "set-id", "7", "253") == FAILED  # of protocol 1 only
    bench[2].set_register("Torque Enable", 1)
    assert bench.run("--yes", "set-id", "2", "5") == REFUSED
    for taken in ("2", "7"):
        assert bench.run("--yes", "set-id", "1", taken) == REFUSED
        assert bench.run("--yes", "set", "1", "ID", taken) == REFUSED
    assert bench.run("--yes", "set-id", "1", "5") == DONE
    assert [servo.id for servo in bench.bus] == [5, 2, 7, 8]


@pytest.mark.parametrize("servo_id", [1, 7, 8])
def test_set_baud_changes_the_rate_and_checks_it(bench, servo_id):
    assert bench.run("--yes", "set-baud", str(servo_id), "57600") == DONE
    assert bench[servo_id].baud_rate == 57_600
    assert bench.run("--baud", "57600", "--yes", "set-baud", str(servo_id), "1000000") == DONE


@pytest.mark.parametrize(
    ("servo_id", "command", "rate"),
    [
        (1, ("set-baud", "1", "250000"), 250_000),  # not of the adapter
        (7, ("set-baud", "7", "4500000"), 4_500_000),
        (1, ("set-baud", "1", "1234"), 1234),  # not of the servo
        (1, ("set", "1", "Baud Rate", "7"), 250_000),
        (1, ("set", "1", "Baud Rate", "99"), 0),  # a code of no rate
    ],
)
def test_unsupported_rates_are_refused(bench, servo_id, command, rate):
    bench.impossible = rate
    assert bench.run("--yes", *command) == FAILED
    assert bench[servo_id].baud_rate == 1_000_000


# relax, monitor


def test_relax_switches_torque_off_and_changes_no_other_register(bench):
    for servo in bench.bus:
        servo.set_register("Torque Enable", 1)
    bench[7].set_register("Moving Threshold", 7)  # has the address of an AX-12's Torque Enable
    assert bench.run("relax", "2", "7") == DONE
    assert [servo.register("Torque Enable") for servo in bench.bus] == [1, 0, 0, 1]
    assert bench.run("relax") == DONE
    assert [servo.register("Torque Enable") for servo in bench.bus] == [0, 0, 0, 0]
    assert bench[7].register("Moving Threshold") == 7


def test_relax_of_all_reads_back_and_relaxes_the_others_too(bench):
    for servo in bench.bus:
        servo.set_register("Torque Enable", 1)
    bench.bus.faults = Faults(Random(3), 0.2, [Fault.DEAFNESS])
    assert bench.run("relax") == DONE
    assert bench.torque == [0, 0, 0, 0]
    bench[2].set_register("Torque Enable", 1)
    bench.bus.faults = None
    assert bench.run("relax", "44", "2") == FAILED
    assert bench.torque == [0, 0, 0, 0]
    assert bench.run("--baud", "57600", "relax") == FAILED  # nobody hears that


def test_monitor_shows_measured_values(bench):
    bench[8].supply_voltage = 9.5
    assert bench.run("monitor", "--count", "2", "--rate", "5") == DONE
    rows = {line.split()[0]: line for line in bench.output.splitlines()[-4:]}
    assert set(rows) == {"1", "2", "7", "8"}
    assert "off" in rows["1"] and "512" in rows["1"] and "+0.000" in rows["1"]
    assert "-1.084 -62.1" in rows["2"]
    assert "1000" in rows["7"] and " 11.1 " in rows["7"]
    assert "input voltage" in rows["8"]
    assert bench.clock() > 1.2
    assert max(map(len, bench.output.splitlines())) <= 80
    bench[2].set_register("Model Number", 107)  # EX-106+, which is not supported
    bench[8].set_register("Status Return Level", 0)
    assert bench.run("monitor", "--count", "1") == DONE
    assert [line.split()[0] for line in bench.output.splitlines()[-2:]] == ["1", "7"]
    assert bench.run("monitor", "1", "2", "--count", "1") == FAILED


def test_monitor_ends_when_the_reader_of_its_output_has_ended():
    with SimulatedPort([SimulatedServo(1)]) as port:
        command = [sys.executable, "-m", "head_tracking", "servo", "--port", port.port_name]
        with subprocess.Popen([*command, "monitor", "1"], stdout=subprocess.PIPE) as process:
            assert process.stdout is not None
            process.stdout.readline()
            process.stdout.close()
            assert process.wait(60.0) == DONE


def test_monitor_shows_servos_that_stop_answering(bench):
    looks = []

    def leave(seconds):
        looks.append(seconds)
        bench[2].power_off()
        bench.clock.now += round(seconds * 1e9)

    bench.pass_time = leave
    assert bench.run("monitor", "1", "2", "--count", "2") == DONE
    last = bench.output.splitlines()[-1]
    assert last.split()[0] == "2" and "no answer" in last and "300" in last


# calibrate


def test_calibrate_writes_zero_range_and_direction(bench, tmp_path):
    bench[1].set_register("Torque Enable", 1)
    bench.answers = "y\n"
    bench.move_by_hand(1, 520)
    bench.on_enter.append(partial(bench[1].set_register, "ID", 9))  # as if its plug were loose
    bench.on_enter.append(lambda: bench[9].set_register("ID", 1) or bench.turn_by_hand(1, 200))
    bench.move_by_hand(1, 850)
    bench.move_by_hand(7, 4096 + 2100, 4096 + 3000, 4096 + 1500)  # a turn further
    file = tmp_path / "head.yaml"
    command = ("calibrate", "head_pan:1", "head_tilt:7", "--output", str(file), "--margin", "0.05")
    assert bench.run(*command) == DONE
    assert bench[1].register("Torque Enable") == 0
    parameters = yaml.safe_load(file.read_text())["/**/servo_bus"]["ros__parameters"]
    assert (parameters["port_name"], parameters["baud_rate"]) == ("/dev/sim", 1_000_000)
    pan, tilt = (parameters[f"{name}_controller"] for name in parameters["dynamixels"])
    assert (pan["joint_name"], tilt["joint_name"]) == ("head_pan_joint", "head_tilt_joint")
    assert (pan["motor"]["model"], pan["motor"]["id"]) == ("AX-12", 1)
    for joint, ticks, error in ((pan, (520, 210, 840), 4), (tilt, (2100, 2967, 1533), 12)):
        motor = joint["motor"]
        assert [motor[key] for key in ("init", "min", "max")] == pytest.approx(ticks, abs=error)


def test_if_the_disk_is_full_the_earlier_file_stays_and_the_poses_are_printed(bench, tmp_path):
    file = tmp_path / "head.yaml"
    file.write_text("precious")
    file.with_name(f".{file.name}.{os.getpid()}.draft").symlink_to("/dev/full")
    bench.answers = "y\n"
    bench.move_by_hand(1, 520, 200, 850)
    assert bench.run("calibrate", "head_pan:1", "--output", str(file)) == FAILED
    assert [each.read_text() for each in tmp_path.iterdir()] == ["precious"]
    (joint,) = yaml.safe_load(bench.output)["/**/servo_bus"]["ros__parameters"]["dynamixels"]
    assert joint == "head_pan"


@pytest.mark.parametrize(
    ("servo_id", "poses"), [(1, (512, 512, 520)), (1, (100, 300, 800)), (7, (2048, 3500, 4500))]
)
def test_impossible_poses_are_asked_for_again(bench, tmp_path, servo_id, poses):
    center = bench[servo_id].model.center
    bench.move_by_hand(servo_id, *poses, center, center - 300, center + 300)
    file = tmp_path / "head.yaml"
    assert bench.run("calibrate", f"head_pan:{servo_id}", "--output", str(file)) == DONE
    assert not bench.on_enter
    assert yaml.safe_load(file.read_text())["/**/servo_bus"]["ros__parameters"]["dynamixels"]


def test_what_calibrate_refuses_changes_nothing(bench, tmp_path):
    file = tmp_path / "head.yaml"
    file.write_text("precious")
    bench[1].set_register("Torque Enable", 1)
    for arguments in (
        ("head_pan:1",),  # torque on, and the answer is no
        ("head_pan:1", "--output", str(file)),
        ("head_pan:1", "head_tilt:1"),
        ("head_pan:1", "head_pan:2"),
    ):
        bench.answers = "n\n"
        assert bench.run("calibrate", *arguments) == REFUSED
    for place in ("none/head.yaml", "."):
        with pytest.raises(SystemExit) as end:
            bench.run("calibrate", "head_pan:1", "--output", str(tmp_path / place))
        assert end.value.code == 2
    assert file.read_text() == "precious"
    assert bench[1].register("Torque Enable") == 1


# Feetech servos


@pytest.fixture
def feetech(bench):
    bench.bus = SimulatedBus(
        [SimulatedServo(1, "STS3215"), SimulatedServo(2, "STS3032", position=1000)]
    )
    return bench


def test_scan_and_info_know_feetech_servos(feetech):
    feetech[1].set_register("Baud Rate", 1)
    assert feetech.run("scan", "--bauds", "1000000", "500000", "--ids", "0-5") == DONE
    assert feetech.rows() == [
        ["1000000", "2", "STS3032", "(521)", "1.0"],
        ["500000", "1", "STS3215", "(777)", "1.0"],
    ]
    assert feetech.run("--yes", "set", "2", "Position Offset", "2114") == FAILED  # overflow
    feetech[2].set_offset(-85)
    assert feetech.run("info", "2") == DONE
    table = {line.split()[0]: line.split() for line in feetech.output.splitlines()[2:]}
    assert table["3"][1:4] == ["Model", "Number", "521"]
    assert table["31"][1:5] == ["Position", "Offset", str(2048 + 85), "-0.1304"]
    assert table["56"][1:4] == ["Present", "Position", "1085"]


@pytest.mark.parametrize(
    ("arguments", "register", "value"),
    [
        (["set-id", "1", "5"], "ID", 5),
        (["set", "1", "Position Offset", "-85"], "Position Offset", 2048 + 85),
        (["set-baud", "1", "500000"], "Baud Rate", 1),
    ],
)
def test_feetech_registers_persist_without_power(feetech, arguments, register, value):
    servo = feetech[1]
    assert feetech.run("--yes", *arguments) == DONE
    assert servo.register("EEPROM Lock") == 1
    servo.power_off()
    servo.power_on()
    assert servo.register(register) == value


def test_relax_of_all_relaxes_feetech_servos_and_leaves_their_start_torque(feetech):
    for servo in feetech.bus:
        servo.set_register("Torque Enable", 1)
    assert feetech.run("relax") == DONE
    assert [servo.register("Torque Enable") for servo in feetech.bus] == [0, 0]
    assert [servo.register("Minimum Start Torque") for servo in feetech.bus] == [16, 16]
