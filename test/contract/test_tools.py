"""Programs beside a head: a simulated bus, tools in a terminal, a recording."""

import shlex
import signal
from contextlib import closing, suppress
from importlib.util import find_spec

import pytest
import serial
import yaml
from rig import TICK
from terminal import Terminal
from waiting import PATIENCE, wait_for

PING, PONG = (bytes.fromhex(f"FF FF 01 02 {end}") for end in ("01 FB", "00 FC"))


def ask(port, packet, length):
    """Return so many bytes of the answer; 0: none is expected."""
    with serial.Serial(port, 1_000_000, timeout=PATIENCE if length else 0.1) as device:
        device.write(packet)
        return device.read(length or 1)


def test_a_simulated_bus_has_models_of_both_protocols_and_leaves_no_link(bench):
    link = bench.folder / "servos"
    models = ("--servo", "AX-12:1", "--servo", "XL430-W250:3", "--servo", "mx-28:4")
    bus = bench.start("simulated_bus", *models, "--link", str(link))
    assert bus.read_until("servos").strip() == str(link)
    assert ask(str(link), PING, 6) == PONG
    answer = ask(str(link), bytes.fromhex("FF FF FD 00 03 03 00 01 1A E6"), 14)
    assert answer[4:12] == bytes.fromhex("03 07 00 55 00 24 04 32")  # model 1060
    assert bus.end(signal.SIGTERM) == 0, bus.output
    assert "AX-12 1, XL430-W250 3, MX-28 4" in bus.output
    assert not link.is_symlink()


def test_a_second_simulated_bus_takes_the_link_over(bench):
    link = str(bench.folder / "servos")
    first = bench.start("simulated_bus", "--link", link)
    first.read_until("servos")
    bench.start("simulated_bus", "--servo", "AX-12:7", "--link", link).read_until("servos")
    assert first.end(signal.SIGINT) == 0, first.output
    ping, pong = (bytes.fromhex(f"FF FF 07 02 {end}") for end in ("01 F5", "00 F6"))
    assert ask(link, ping, 6) == pong


def test_a_simulated_bus_counts_faults_echoes_and_collisions(bench):
    faulty = bench.start("simulated_bus", "--faults", "100", "--kinds", "drop", "--seed", "5")
    assert ask(faulty.read_until("/dev/").strip(), PING, 0) == b""
    faulty.end(signal.SIGINT)
    assert "faults: drop 1" in faulty.output
    twins = bench.start("simulated_bus", "--echo", "--servo", "AX-12:1", "--servo", "AX-18A:1")
    port = twins.read_until("/dev/").strip()
    assert ask(port, PING, 12) == PING + PONG
    read = bytes.fromhex("FF FF 01 04 02 00 02 F6")
    answer = ask(port, read, 16)
    assert answer[:8] == read and sum(answer[10:]) % 256 != 255  # the checksum is wrong
    twins.end(signal.SIGINT)
    assert "two senders at once: servos with the same id 1" in twins.output


@pytest.mark.parametrize("model", ["AX-12", "STS3215", "XL330-M288"])
def test_two_simulated_servos_with_one_id_are_found_as_that(bench, model):
    """As servos fresh from the box, which are practised with."""
    twins = bench.start("simulated_bus", "--servo", f"{model}:1", "--servo", f"{model}:1")
    port = twins.read_until("/dev/").strip()
    scan = bench.start("servo", "--port", port, "scan", "--bauds", "1000000", "--ids", "1-2")
    scan.read_until("used twice")
    assert scan.end() == 0
    change = bench.start("servo", "--port", port, "--yes", "set-id", "1", "2")
    assert change.end() == 1, change.output


def servo_on_terminal(bench, *words):
    terminal = Terminal()
    tool = ("-m", "head_tracking", "servo", "--port", bench.servos.name, *words)
    terminal.start(shlex.join(tool))
    return terminal


@pytest.mark.parametrize("ended", ["by ctrl-c", "because the port has vanished"])
def test_the_monitor_runs_until_it_is_interrupted(bench, ended):
    with closing(servo_on_terminal(bench, "monitor", "1", "2")) as terminal:
        terminal.waits_for("AX-12.*AX-12.*AX-12")
        if ended == "by ctrl-c":
            terminal.type("\x03")
        else:
            bench.servos.port.close()
        terminal.waits_for(r"\$ ")
        terminal.type("echo code $?\n")
        assert f"code {130 if ended == 'by ctrl-c' else 1}" in terminal.waits_for(r"code \d+\r")


def test_calibration_is_led_by_hand_and_written_to_a_file(bench):
    file = bench.folder / "head.yaml"
    words = ("calibrate", "head_pan:1", "--output", str(file))
    unattended = bench.start("servo", "--port", bench.servos.name, *words)
    assert unattended.end() == 3, unattended.output
    assert not file.exists()
    with closing(servo_on_terminal(bench, *words)) as terminal:
        for prompt, tick in (("zero", 512), ("lowest", 300), ("highest", 700)):
            terminal.waits_for(prompt)
            bench.servos.turn_by_hand(1, (tick - 512) * TICK)
            wait_for(lambda tick=tick: abs(bench.servos.ticks[0] - tick) < 10)
            bench.servos.at_rest()
            terminal.type("\n")
        wait_for(file.exists)
    motor = yaml.safe_load(file.read_text())["/**/servo_bus"]["ros__parameters"]
    motor = motor["head_pan_controller"]["motor"]
    assert [motor[key] for key in ("init", "min", "max")] == pytest.approx([512, 306, 694], abs=14)


@pytest.mark.skipif(find_spec("mcap_ros2") is None, reason="needs requirements/viewer.txt")
def test_a_recording_holds_what_was_published(bench):
    from mcap.exceptions import EndOfFile
    from mcap.reader import NonSeekingReader, make_reader
    from mcap_ros2.decoder import DecoderFactory

    folder = bench.folder / "recordings"
    bench.start("head_tracking", "--sim")
    words = ("recorder", "--ros-args", "-p", f"record_directory:={folder}")
    assert bench.start(*words, "-p", "record_directry:=x").end() == 1
    assert not folder.exists()  # what is refused leaves no file
    recorder = bench.start(*words)
    recorded = {"/joint_states", "/target_point", "/robot_description"}

    def written():
        found = set()
        for file in folder.glob("*.mcap"):
            with file.open("rb") as stream, suppress(EndOfFile):  # it is being written
                for _, channel, _ in NonSeekingReader(stream).iter_messages(log_time_order=False):
                    found.add(channel.topic)
        return found

    wait_for(lambda: recorded <= written())
    assert recorder.end(signal.SIGINT) == 0, recorder.output
    (file,) = folder.glob("*.mcap")
    with file.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        assert recorded <= {channel.topic for _, channel, _, _ in reader.iter_decoded_messages()}


def test_look_knows_the_joints_of_the_running_head(bench):
    bench.start("head_tracking", "--sim", "--target", "none", "--robot", "pxxls")
    look = bench.start("look", "1,0.5,0.4@base_link")
    assert look.end() == 0, look.output
