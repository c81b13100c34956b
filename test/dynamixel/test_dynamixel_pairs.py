"""Two servos on one joint, which a stiff bracket joins: they never push against each other."""

import pytest
from simulated_device import Rig

from head_tracking.dynamixel import (
    BusReading,
    ConfigurationError,
    EventKind,
    Goal,
    GoalError,
    JointConfiguration,
    ServoCalibration,
    Torque,
    servo_model,
)
from head_tracking.dynamixel.servo import run
from head_tracking.simulation import SimulatedBus, SimulatedServo

APART = 12  # ticks; what accelerating and friction make of a stiff bracket
MODELS = ["XM430-W350", "AX-12"]


class Pair(Rig):
    """A joint with two servos, face to face."""

    def __init__(self, name: str) -> None:
        model = servo_model(name)
        low, high, last = model.ticks // 4, 3 * model.ticks // 4, model.ticks - 1
        second = ServoCalibration("j", 2, last - model.center, last - low, last - high, model)
        self.joint = JointConfiguration(
            "j", 1, model.center, low, high, controller="c", model=model, second=second
        )
        bus = SimulatedBus(
            [
                SimulatedServo(1, model),
                SimulatedServo(2, model, position=float(last - model.center)),
            ]
        )
        bus.couple(1, 2)
        self.apart = self.goals_apart = 0.0
        super().__init__(bus, joints=[self.joint])

    def step(self, count: int = 1) -> BusReading:
        first, second = self.servos
        for _ in range(count):
            super().step()
            last = first.model.ticks - 1
            self.apart = max(self.apart, abs(first.true_ticks + second.true_ticks - last))
            if self.powered == 2:
                goals = sum(servo.register("Goal Position") for servo in self.servos)
                self.goals_apart = max(self.goals_apart, abs(goals - last))
        return self.reading

    def send(self, share: float) -> None:
        """Go to a part of the range."""
        lower, upper = self.joint.lower, self.joint.upper
        self.bus.command({"j": Goal(lower + share * (upper - lower), 2.0)}, clamp=True)
        self.step(80)

    @property
    def powered(self) -> int:
        """How many of the two have torque."""
        return sum(self.torque)

    @property
    def position(self) -> float:
        return self.joint.position(self.servos[0].true_ticks)


@pytest.mark.parametrize("name", MODELS)
def test_servos_whose_torque_comes_on_in_motion_do_not_push_against_each_other(name):
    pair = Pair(name)
    pair.send(0.9)
    pair.bus.command({"j": Goal(pair.joint.lower, 5.0)})
    pair.step(9)
    run(pair.bus.switching_torque(None, False))
    run(pair.bus.switching_torque(None, True), pair.bench.pass_time)
    pair.step(5)
    pair.goals_apart = 0
    pair.step(30)
    assert pair.goals_apart <= 1


@pytest.mark.parametrize("relaxed", [False, True])
@pytest.mark.parametrize("name", MODELS)
def test_narrowed_limits_move_both_goals(name, relaxed):
    pair = Pair(name)
    pair.send(0.9)
    ticks = pair.joint.model.ticks
    if relaxed:
        run(pair.bus.switching_torque(None, False))
    pair.bus.joint("j").reconfigure(highest=ticks // 2)
    if relaxed:
        run(pair.bus.switching_torque(None, True))  # its goal is the limit, at the lowest speed
        pair.send(0.5)
    pair.step(60)
    assert pair.position == pytest.approx(pair.joint.position(ticks // 2), abs=0.05)
    assert pair.apart < APART and pair.goals_apart < APART


def test_limits_that_leave_a_pair_no_position_are_refused():
    pair = Pair("AX-12")
    model, joint = pair.joint.model, pair.bus.joint("j")
    highest = model.position_limits[1]
    pair.bus.close()
    pair.servos[1].set_register(highest, round(0.44 * model.ticks))
    pair.bus.connect()  # the second servo allows only 0.3 rad and more
    before = joint.limits
    with pytest.raises(ConfigurationError):
        joint.reconfigure(highest=round(0.52 * model.ticks))
    assert joint.limits == before
    joint.reconfigure(highest=round(0.6 * model.ticks))
    narrowed = joint.limits
    assert before[0] == narrowed[0] < narrowed[1] < before[1]
    joint.reconfigure(None, pair.joint.max, None)
    assert joint.limits == before
    pair.bus.close()
    pair.servos[0].set_register(highest, round(0.4 * model.ticks))
    with pytest.raises(ConfigurationError):
        pair.bus.connect()
    assert pair.powered == 0


def test_a_servo_that_comes_back_with_other_limits_is_not_taken_back():
    pair = Pair("XM430-W350")
    pair.send(0.2)
    second, limit = pair.servos[1], pair.joint.model.position_limits[1]
    second.set_register("ID", 99)
    pair.step(20)
    second.set_register(limit, round(0.44 * second.model.ticks))  # the joint's 0.56 and more
    pair.bus.joint("j").reconfigure(highest=round(0.52 * second.model.ticks))
    second.set_register("ID", 2)
    pair.step(100)
    assert not pair.bus.joint("j").complete
    assert not second.register("Torque Enable")


@pytest.mark.parametrize("name", MODELS)
def test_no_servo_of_a_pair_holds_alone_when_the_other_one_cannot_be_used(name):
    pair = Pair(name)
    pair.send(0.6)
    second = pair.servos[1]
    second.power_off()
    pair.step(20)
    register, wheel = ("Operating Mode", 1) if name != "AX-12" else ("CCW Angle Limit", 0)
    second.set_register(register, wheel)
    second.power_on()
    pair.step(60)
    assert EventKind.UNUSABLE in pair.kinds
    assert pair.powered == 0
    assert pair.bus.joint("j").torque is Torque.OFF_UNTIL_COMMANDED


def test_one_of_a_pair_that_restarts_to_recover_is_not_reported_as_shut_down():
    pair = Pair("XM430-W350")
    pair.send(0.6)
    pair.servos[1].overload()
    pair.step(5)
    run(pair.bus.recovering())
    pair.step()
    (text,) = [event.text for event in pair.events if event.kind is EventKind.RECOVERED]
    assert Torque.OFF_BY_FAULT.value not in text


@pytest.mark.parametrize("silent", [1, 2])
def test_no_goal_goes_to_one_servo_while_the_other_does_not_answer(silent):
    pair = Pair("XM430-W350")
    pair.send(0.6)
    mute = pair.servos[silent - 1]
    mute.set_register("ID", 99)
    pair.step(20)
    with pytest.raises(GoalError):
        pair.send(0.2)
    goals = [servo.register("Goal Position") for servo in pair.servos]
    pair.step(10)
    assert [servo.register("Goal Position") for servo in pair.servos] == goals
    mute.set_register("ID", silent)
    pair.step(60)
    named = {e.text[:8] for e in pair.events if e.kind in (EventKind.LOST, EventKind.RETURNED)}
    assert named == {f"j (id {silent})"}
    pair.send(0.2)
    assert pair.bus.joint("j").torque is Torque.ON
    assert pair.apart < APART and pair.goals_apart < APART


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("stop", [False, True])
def test_a_pair_that_kept_its_torque_while_its_cable_was_out_holds_unless_it_was_stopped(
    name, stop
):
    pair = Pair(name)
    pair.send(0.6)
    before = pair.position
    for servo in pair.servos:
        servo.set_register("ID", servo.id + 90)
    pair.step(20)
    assert not pair.bus.joint("j").on
    if stop:
        pair.bus.relax_at_once(0.1)
    for servo in reversed(pair.servos):
        servo.set_register("ID", servo.id - 90)
        pair.step(7)
    pair.step(60)
    assert pair.powered == (0 if stop else 2)
    assert pair.bus.joint("j").on is not stop
    assert pair.position == pytest.approx(before, abs=0.02)


@pytest.mark.parametrize("name", MODELS)
def test_no_servo_of_a_pair_holds_alone_when_the_other_one_lost_its_power_while_both_were_away(
    name,
):
    pair = Pair(name)
    pair.send(0.6)
    for servo in pair.servos:
        servo.set_register("ID", servo.id + 90)
    pair.step(20)
    pair.servos[0].set_register("ID", 1)
    pair.step(20)
    pair.servos[1].set_register("Torque Enable", 0)
    pair.servos[1].set_register("ID", 2)
    pair.step(20)
    assert pair.powered == 0
    pair.send(0.2)
    assert pair.bus.joint("j").torque is Torque.ON


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("relaxed", [0, 1])
def test_no_servo_of_a_pair_goes_on_alone_when_another_program_relaxes_one(name, relaxed):
    pair = Pair(name)
    pair.send(0.9)
    pair.servos[relaxed].set_register("Torque Enable", 0)
    pair.step(15)
    assert pair.powered != 1  # a goal switches the torque of some models on
    assert (EventKind.TORQUE_LOST in pair.kinds) == (pair.powered == 0)
    pair.send(0.2)
    assert pair.bus.joint("j").torque is Torque.ON
    assert pair.apart < APART and pair.goals_apart < APART
