"""Random faults in a running head: only commands move it, STOP holds, and it follows again."""

import math
import random
import signal
import time

import pytest
from geometry_msgs.msg import PointStamped
from rig import JOINTS, TICK
from sensor_msgs.msg import JointState
from waiting import repeating, wait_for

from head_tracking.gaze import PanTiltHead

ON_TARGET = math.radians(3.0)
POSITION_MARGIN = 0.5  # rad beside the range of the targets for the head
GOAL_MARGIN = 1.3  # rad for goals, which lie ahead of the head
FOREIGN = -2.2  # rad; other programs command this position, away from every target
INVALID = (math.nan, math.inf, -math.inf)
LAYOUTS = {
    "one run": ("head_tracking",),
    "a process for each node": (
        "servo_bus", "robot_state_publisher", "joint_state_publisher", "head_tracker",
    ),
}  # fmt: skip


def target_at(now):
    """Where the target is in base_link [m] at a time [s]."""
    bearing = 0.35 + 0.15 * math.sin(0.6 * now)
    return 2.0 * math.cos(bearing), 2.0 * math.sin(bearing), 1.0 + 0.1 * math.cos(0.6 * now)


class Chaos:
    """A robot whose target swings slowly, and its faults.

    Args:
        bench: the domain and the servos.
        model: of the robot.
        names: of its programs.
        seed: of all random choices.
    """

    def __init__(self, bench, model, names, seed):
        self.bench, self.person, self.servos = bench, bench.person, bench.servos
        self.random = random.Random(seed)
        self.is_commanded = self.is_stopped = False
        self.head = PanTiltHead(model, *JOINTS, "camera_link")
        self.from_base = model.transform(self.head.base_frame, "base_link", {})
        gazes = [self.head.gaze(self.from_base @ target_at(0.1 * k), 0, 0) for k in range(110)]
        self.ranges = [
            (min(0.0, *angles), max(0.0, *angles))
            for angles in zip(*((gaze.pan, gaze.tilt) for gaze in gazes), strict=True)
        ]
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
            self.person.look_at(*target_at(time.monotonic()))

    # what must always be so

    def check(self):
        """Check what was written to the servos since the last call, and where they are."""

        def take(bus):
            writes = list(bus.write_log.writes)
            bus.write_log.writes.clear()
            return writes

        for write in self.servos.port.use(take):
            if write.torque:
                assert self.is_commanded, f"torque before the first command: {write}"
                assert not self.is_stopped, f"torque after STOP: {write}"
                if "Goal Position" in write.names:
                    self.check_range(write.id - 1, TICK * (write.goal - 512), GOAL_MARGIN)
        for index, position in enumerate(self.servos.true):
            self.check_range(index, position, POSITION_MARGIN)

    def check_range(self, index, angle, margin):
        low, high = self.ranges[index]
        assert low - margin <= angle <= high + margin, JOINTS[index]

    def wait_for(self, condition):
        def checked():
            self.check()
            return condition()

        wait_for(checked)

    def wait(self, seconds):
        end = time.monotonic() + seconds
        self.wait_for(lambda: time.monotonic() > end)

    def measures(self):
        """Whether all programs run and the joints are measured."""
        for name, program in self.programs.items():
            assert program.process.poll() is None, f"{name} has ended"
        stamp, _ = self.person.measured.get(JOINTS[0], (0.0, 0.0))
        return stamp > max(self.started, time.time() - 0.5)

    def follows(self):
        target = self.from_base @ target_at(time.monotonic())
        return (
            self.measures()
            and self.servos.torque == [1, 1]
            and self.head.miss(target, *self.servos.true) < ON_TARGET
            and set(self.person.owners.values()) == {"/head_tracker"}
        )

    # faults

    def kill(self, number=signal.SIGKILL):
        name = self.random.choice(sorted(self.programs))
        program = self.programs[name]
        program.process.send_signal(number)
        if number == signal.SIGTERM:
            self.wait_for(lambda: program.process.poll() is not None)
        else:
            self.wait(self.random.uniform(0.0, 0.6))
        program.kill()
        self.start(name)

    def terminate(self):
        self.kill(signal.SIGTERM)

    def freeze(self):
        process = self.random.choice(sorted(self.programs.items()))[1].process
        process.send_signal(signal.SIGSTOP)
        self.wait(self.random.uniform(0.1, 1.0))
        process.send_signal(signal.SIGCONT)

    def unplug(self):
        self.wait_for(self.measures)  # without an adapter no robot starts
        self.servos.port.close()
        self.wait(self.random.uniform(0.05, 1.0))
        self.servos.port.open()

    def flood(self, kind, topic, make):
        """Publish messages as fast as possible."""
        publisher = self.person.node.create_publisher(kind, topic, 10)
        end = time.monotonic() + self.random.uniform(0.1, 0.5)
        while time.monotonic() < end:
            publisher.publish(make())
        self.person.node.destroy_publisher(publisher)  # or no run starts beside it
        self.check()

    def flood_targets(self):
        def make():
            frame = self.random.choice(("base_link", "nowhere", "", "a/b", "x" * 99))
            last = (*INVALID, 1e308) if frame == "base_link" else (0.5, 1e308)
            return self.person.point(1.0, -2.0, self.random.choice(last), frame)

        self.flood(PointStamped, "target_point", make)

    def flood_commands(self):
        def make():
            names = self.random.choice((list(JOINTS), [JOINTS[0]], ["nobody"], [""], []))
            bad = FOREIGN if names == ["nobody"] else self.random.choice(INVALID)
            longer = self.random.random() < 0.3
            positions = [FOREIGN] * (len(names) + 1) if longer else [bad] * len(names)
            return JointState(name=names, position=positions)

        self.flood(JointState, "joint_commands", make)

    def foreign_commands(self):
        """Command joints that the tracker owns: it has commanded them in the last second."""
        self.wait_for(lambda: self.follows() and self.person.state("head_tracker") == "tracking")
        message = JointState(name=list(JOINTS), position=[FOREIGN, 0.0], velocity=[1.0, 1.0])
        self.flood(JointState, "joint_commands", lambda: message)

    def stop(self):
        self.wait_for(self.follows)
        self.wait_for(lambda: self.person.call("stop").success)
        self.stay_stopped()

    def stop_without_adapter(self):
        self.wait_for(self.follows)
        self.servos.port.close()
        self.wait(self.random.uniform(0.0, 0.3))
        assert not self.person.call("stop").success or self.servos.torque == [0, 0]
        self.servos.port.open()
        self.wait_for(lambda: self.servos.torque == [0, 0])
        self.stay_stopped()

    def stay_stopped(self):
        """Let faults happen that must not end the STOP, then resume."""
        assert self.servos.torque == [0, 0]
        self.check()
        self.is_stopped = True
        for fault in self.random.sample((self.flood_targets, self.flood_commands, self.unplug), 2):
            fault()
        self.wait(self.random.uniform(0.2, 0.6))
        self.is_stopped = False
        self.wait_for(lambda: self.person.call("resume").success)
        self.wait_for(lambda: self.person.call("head_tracker/enable", True).success)


@pytest.mark.parametrize(("layout", "seed"), [("one run", 1), ("a process for each node", 2)])
def test_only_commands_move_the_head_and_it_stops_and_recovers(bench, kinectbot, layout, seed):
    chaos = Chaos(bench, kinectbot, LAYOUTS[layout], seed)
    faults = [
        chaos.kill, chaos.terminate, chaos.freeze, chaos.unplug, chaos.flood_targets,
        chaos.flood_commands, chaos.foreign_commands, chaos.stop, chaos.stop_without_adapter,
    ]  # fmt: skip
    chaos.random.shuffle(faults)
    with repeating(chaos.publish, period=0.03):
        for fault in (chaos.flood_targets, chaos.flood_commands, chaos.unplug):
            fault()  # before the first command
        chaos.is_commanded = True
        while faults:
            chaos.wait_for(chaos.follows)
            for fault in faults[:3]:
                print(fault.__name__)
                fault()
            del faults[:3]
        chaos.wait_for(chaos.follows)
