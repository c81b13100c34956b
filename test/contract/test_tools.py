"""Programs beside a head: a simulated bus, the servo tool, doctor, a recording."""

import re
import shlex
import signal
from contextlib import closing
from importlib.util import find_spec

import pytest
import yaml
from dynamixel_sdk import PacketHandler, PortHandler
from rig import JOINTS, TICK, command
from terminal import Terminal
from waiting import wait_for


@pytest.fixture
def port(bench):
    """Two AX-12 of another process."""
    bus = bench.start("simulated_bus", "--link", str(bench.folder / "bus"))
    yield bus.read_until("bus").strip()
    assert bus.end(signal.SIGINT) == 0, bus.output


def test_servos_of_any_ids_are_simulated_for_any_driver(bench):
    link = bench.folder / "one"
    bus = bench.start("simulated_bus", "--ids", "3", "--link", str(link))
    handler = PortHandler(bus.read_until("one").strip())
    assert handler.setBaudRate(1_000_000)
    assert PacketHandler(1.0).ping(handler, 3)[:2] == (12, 0)
    assert PacketHandler(1.0).ping(handler, 4)[1] != 0
    handler.closePort()
    assert bus.end(signal.SIGTERM) == 0
    assert not link.is_symlink()


def test_the_servo_tool_reads_asks_before_it_writes_and_has_exit_codes(bench, port):
    def run(*words):
        program = bench.start("servo", "--port", port, *words)
        return program.end(), program.output

    code, text = run("scan", "--bauds", "1000000", "--ids", "0-8")
    assert code == 0, text
    found = [line.split()[:3] for line in text.splitlines() if "AX-12" in line]
    assert found == [["1000000", "1", "AX-12"], ["1000000", "2", "AX-12"]]
    assert run("set", "1", "LED", "1")[0] == 0
    assert run("set", "1", "Temperature Limit", "60")[0] == 3  # it cannot ask: no terminal
    assert re.search(r"Temperature Limit +70", run("info", "1")[1])
    assert run("--yes", "set", "1", "Temperature Limit", "60")[0] == 0
    assert re.search(r"Temperature Limit +60", run("info", "1")[1])
    assert run("info", "9")[0] == 1


def test_new_robot_describes_a_head_with_feetech_servos(bench):
    link, model = bench.folder / "feetech", bench.folder / "my_head.urdf.xacro"
    bus = bench.start(
        "simulated_bus", "--link", str(link), "--servo", "STS3215:5", "--servo", "STS3215:9"
    )
    port = bus.read_until("feetech").strip()
    words = ("my_head", "--folder", str(bench.folder), "--pan", "9", "--tilt", "5", "--yes")
    program = bench.start("new_robot", *words, "--port", port)
    assert program.end() == 0, program.output
    doctor = bench.start("doctor", "--port", port, "--robot", str(model), "--listen", "0")
    assert doctor.end() in (0, 1, 2), doctor.output
    joints = [line for line in doctor.output.splitlines() if "STS3215, firmware" in line]
    assert [line.split()[0] for line in joints] == ["green", "green"], doctor.output
    assert bus.end(signal.SIGINT) == 0, bus.output


def test_doctor_reports_the_servos_by_its_exit_code(bench, port):
    good = bench.start("doctor", "--port", port, "--listen", "0")
    code = good.end()
    levels = {line.split()[0] for line in good.output.splitlines() if JOINTS[0] in line}
    assert "green" in levels, good.output
    assert code in (0, 1, 2), good.output
    params = bench.folder / "ids.yaml"
    params.write_text("servo_bus: {ros__parameters: {head_pan_controller: {motor: {id: 9}}}}\n")
    bad = bench.start("doctor", "--port", port, "--listen", "0", "--params", str(params))
    assert bad.end() == 2, bad.output


def on_terminal(bench, tool, *words):
    """A tool in a terminal; its Python comes from `Terminal.start`."""
    terminal = Terminal()
    terminal.start(shlex.join([*command(tool)[1:], "--port", bench.servos.name, *words]))
    return terminal


@pytest.mark.parametrize("ended", ["by ctrl-c", "because the port has vanished"])
def test_the_monitor_runs_until_it_is_interrupted(bench, ended):
    with closing(on_terminal(bench, "servo", "monitor", "1", "2")) as terminal:
        terminal.waits_for("AX-12.*AX-12.*AX-12")
        if ended == "by ctrl-c":
            terminal.type("\x03")
        else:
            bench.servos.port.close()
        terminal.waits_for(r"\$ ")
        terminal.type("echo code $?\n")
        assert f"code {130 if ended == 'by ctrl-c' else 1}" in terminal.waits_for(r"code \d+\r")


def move_by_hand(bench, terminal, *poses):
    """Turn a servo to a tick and press Enter, at each prompt."""
    for prompt, servo, tick in poses:
        terminal.waits_for(prompt)
        bench.servos.turn_by_hand(servo, (tick - 512) * TICK)
        wait_for(lambda: abs(bench.servos.ticks[servo - 1] - tick) < 10)  # noqa: B023
        bench.servos.at_rest()
        terminal.type("\n")


def test_calibration_is_led_by_hand_and_written_to_a_file(bench):
    file = bench.folder / "head.yaml"
    words = ("calibrate", "head_pan:1", "--output", str(file))
    unattended = bench.start("servo", "--port", bench.servos.name, *words)
    assert unattended.end() == 3, unattended.output
    assert not file.exists()
    with closing(on_terminal(bench, "servo", *words)) as terminal:
        move_by_hand(bench, terminal, ("zero", 1, 512), ("lowest", 1, 300), ("highest", 1, 700))
        wait_for(file.exists)
    motor = yaml.safe_load(file.read_text())["/**/servo_bus"]["ros__parameters"]
    motor = motor["head_pan_controller"]["motor"]
    assert [motor[key] for key in ("init", "min", "max")] == pytest.approx([512, 306, 694], abs=14)


def test_a_head_is_described_by_hand_in_a_terminal(bench):
    measures = ("--pan-xyz", "0", "0", "0.05", "--tilt-xyz", "0", "0", "0.04")
    words = ("my_head", "--folder", str(bench.folder), "--baud", "1000000", *measures)
    words = (*words, "--camera-xyz", "0.03", "0", "0.03")
    file = bench.folder / "my_head.yaml"
    unattended = bench.start("new_robot", "--port", bench.servos.name, *words)
    assert unattended.end() == 3, unattended.output
    assert not file.exists()
    poses = [("ahead", 1, 512), ("left", 1, 700), ("right", 1, 300), ("up", 2, 400)]
    with closing(on_terminal(bench, "new_robot", *words)) as terminal:
        move_by_hand(bench, terminal, *poses, ("down", 2, 600))
        wait_for(file.exists)
    bus = yaml.safe_load(file.read_text())["/**/servo_bus"]["ros__parameters"]
    for name, ticks in (("head_pan", (512, 306, 694)), ("head_tilt", (512, 406, 594))):
        motor = bus[f"{name}_controller"]["motor"]
        assert [motor[key] for key in ("init", "min", "max")] == pytest.approx(ticks, abs=14)


@pytest.mark.skipif(find_spec("mcap_ros2") is None, reason="needs requirements/viewer.txt")
def test_a_recording_holds_what_was_published(bench):
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    folder = bench.folder / "recordings"
    bench.start("head_tracking", "--sim")
    recorder = bench.start("recorder", "--ros-args", "-p", f"record_directory:={folder}")
    wait_for(lambda: bench.person.state("head_tracker") == "tracking")
    recorded = {"/joint_states", "/target_point", "/robot_description"}

    def hears(topic):
        listeners = bench.person.node.get_subscriptions_info_by_topic(topic)
        return any(listener.node_name.startswith("recorder") for listener in listeners)

    wait_for(lambda: all(map(hears, recorded)))
    bench.person.wait_for_joints()
    heard = set()

    def has_heard():
        heard.add(bench.person.joint_stamps[JOINTS[0]])
        return len(heard) > 60

    wait_for(has_heard)
    assert recorder.end(signal.SIGINT) == 0, recorder.output
    (file,) = folder.glob("*.mcap")
    with file.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        found = {}
        for _, channel, _, message in reader.iter_decoded_messages():
            found.setdefault(channel.topic, []).append(message)
    assert recorded <= found.keys()
    pans = [  # a joint that did not answer in a cycle is left out of its message
        dict(zip(m.name, m.position, strict=True))[JOINTS[0]]
        for m in found["/joint_states"]
        if JOINTS[0] in m.name
    ]
    assert len(pans) > 20
    assert max(pans) - min(pans) > 0.05
