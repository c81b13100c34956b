"""Random faults in a running head: only commands move it, STOP holds, and it follows again."""

import math
import random
import signal
import time

import pytest
from geometry_msgs.msg import PointStamped
from rig import DEGREE, JOINTS, TICK, bearing
from sensor_msgs.msg import JointState
from waiting import repeating, wait_for

POSITIONS = (-0.7, 1.0)  # rad; the target is in the middle of it
GOALS = (-1.5, 1.8)  # rad; they lie ahead of the head
FOREIGN = -2.2  # rad; other programs command this position
INVALID = (math.nan, math.inf, -math.inf)
LAYOUTS = {
    "one run": ("head_tracking",),
    "a process for each node": (
        "servo_bus", "robot_state_publisher", "joint_state_publisher", "head_tracker",
    ),
}  # fmt: skip


def target():
    """Return where the target is in base_link now [m]; it swings slowly."""
    now = time.monotonic()
    aside = 0.35 + 0.15 * math.sin(0.6 * now)
    return 2.0 * math.cos(aside), 2.0 * math.sin(aside), 1.0 + 0.1 * math.cos(0.6 * now)


class Chaos:
    """A robot that follows the target, and its faults."""

    def __init__(self, bench, names, seed):
        self.bench, self.person, self.servos = bench, bench.person, bench.servos
        self.random = random.Random(seed)
        self.is_commanded = self.is_stopped = False
        self.programs = {}
        for name in names:
            self.start(name)

    def start(self, name):
        port = self.servos.name
        timeout = ("-p", "servo_bus:reply_timeout:=0.1")  # STOP waits for the port twice as long
        words = {
            "head_tracking": ("--port", port, "--target", "none", "--ros-args", *timeout),
            "servo_bus": ("--ros-args", "-p", f"port_name:={port}", *timeout),
        }
        self.started = time.time()
        self.programs[name] = self.bench.start(name, *words.get(name, ()), own_group=True)

    def publish(self):
        if self.is_commanded:
            self.person.look_at(*target())

    def check(self):
        """Check what was written to the servos since the last call, and where they are."""

        def take(bus):
            writes = list(bus.writes)
            bus.writes.clear()
            return writes

        for write in self.servos.port.use(take):
            if write.torque:
                assert self.is_commanded, f"torque before the first command: {write}"
                assert not self.is_stopped, f"torque after STOP: {write}"
                if "Goal Position" in write.names:
                    assert GOALS[0] <= TICK * (write.goal - 512) <= GOALS[1], write
        for position in self.servos.true:
            assert POSITIONS[0] <= position <= POSITIONS[1]

    def wait_for(self, condition):
        def checked():
            self.check()
            return condition()

        wait_for(checked)

    def wait(self, shortest, longest):
        end = time.monotonic() + self.random.uniform(shortest, longest)
        self.wait_for(lambda: time.monotonic() > end)

    def measures(self):
        """Return whether all programs run and the joints are measured."""
        for name, program in self.programs.items():
            assert program.process.poll() is None, f"{name} has ended"
        stamp, _ = self.person.measured.get(JOINTS[0], (0.0, 0.0))
        return stamp > max(self.started, time.time() - 0.5)

    def follows(self):
        return (
            self.measures()
            and self.servos.torque == [1, 1]
            and abs(self.servos.true[0] - bearing(*target()[:2])) < 3 * DEGREE
            and set(self.person.owners.values()) == {"/head_tracker"}
        )

    # faults

    def kill(self):
        name = self.random.choice(sorted(self.programs))
        self.programs[name].process.kill()
        self.wait(0.0, 0.6)
        self.programs[name].kill()
        self.start(name)

    def freeze(self):
        process = self.programs[self.random.choice(sorted(self.programs))].process
        process.send_signal(signal.SIGSTOP)
        self.wait(0.1, 1.0)
        process.send_signal(signal.SIGCONT)

    def unplug(self):
        self.wait_for(self.measures)  # without an adapter no robot starts
        self.servos.port.close()
        self.wait(0.05, 1.0)
        self.servos.port.open()

    def flood(self):
        """Publish invalid targets and commands as fast as possible."""
        targets = self.person.node.create_publisher(PointStamped, "target_point", 10)
        commands = self.person.node.create_publisher(JointState, "joint_commands", 10)
        end = time.monotonic() + self.random.uniform(0.2, 0.8)
        while time.monotonic() < end:
            frame = self.random.choice(("base_link", "nowhere", "", "a/b", "x" * 99))
            last = (*INVALID, 1e308) if frame == "base_link" else (0.5, 1e308)
            targets.publish(self.person.point(1.0, -2.0, self.random.choice(last), frame))
            names = self.random.choice((list(JOINTS), [JOINTS[0]], ["nobody"], [""], []))
            bad = FOREIGN if names == ["nobody"] else self.random.choice(INVALID)
            longer = self.random.random() < 0.3
            positions = [FOREIGN] * (len(names) + 1) if longer else [bad] * len(names)
            commands.publish(JointState(name=names, position=positions))
        for publisher in (targets, commands):  # or no run starts beside them
            self.person.node.destroy_publisher(publisher)
        self.check()

    def foreign_commands(self):
        """Command joints that the tracker owns: it has commanded them in the last second."""
        self.wait_for(lambda: self.follows() and self.person.state("head_tracker") == "tracking")
        onward = JointState(name=list(JOINTS), position=[FOREIGN, 0.0], velocity=[1.0, 1.0])
        with repeating(lambda: self.person.publish("joint_commands", onward), period=0.001):
            self.wait(0.1, 0.5)

    def stop(self):
        self.wait_for(self.follows)
        self.stop_and_resume()

    def stop_without_adapter(self):
        self.wait_for(self.follows)
        self.servos.port.close()
        self.stop_and_resume()

    def stop_and_resume(self):
        """STOP, let faults happen that must not end it, and resume."""
        assert not self.person.call("stop").success or self.servos.torque == [0, 0]
        self.servos.port.open()
        self.wait_for(lambda: self.servos.torque == [0, 0])
        self.is_stopped = True
        self.flood()
        self.unplug()
        self.wait(0.2, 0.6)
        self.is_stopped = False
        self.wait_for(lambda: self.person.call("resume").success)
        self.wait_for(lambda: self.person.call("head_tracker/enable", True).success)


@pytest.mark.parametrize(("layout", "seed"), [("one run", 1), ("a process for each node", 2)])
def test_only_commands_move_the_head_and_it_stops_and_recovers(bench, layout, seed):
    chaos = Chaos(bench, LAYOUTS[layout], seed)
    faults = [
        chaos.kill, chaos.kill, chaos.freeze, chaos.unplug, chaos.flood, chaos.foreign_commands,
        chaos.stop, chaos.stop_without_adapter,
    ]  # fmt: skip
    chaos.random.shuffle(faults)
    with repeating(chaos.publish, period=0.03):
        chaos.flood()  # before the first command
        chaos.unplug()
        chaos.is_commanded = True
        while faults:
            chaos.wait_for(chaos.follows)
            for fault in faults[:3]:
                print(fault.__name__)
                fault()
            del faults[:3]
        chaos.wait_for(chaos.follows)
