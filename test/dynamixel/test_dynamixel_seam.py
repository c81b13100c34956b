"""Torque comes on only where no way to a goal crosses the seam of the encoder's scale."""

from contextlib import suppress
from dataclasses import dataclass

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from simulated_device import Bench, Rig

from head_tracking.dynamixel import (
    BusReading,
    EventKind,
    Goal,
    GoalError,
    JointConfiguration,
    ServoCalibration,
    Torque,
    TorqueError,
    servo_model,
)
from head_tracking.dynamixel.servo import run
from head_tracking.simulation import SimulatedServo

SLACK = 25  # ticks by which a motion may overshoot


@dataclass(frozen=True)
class Case:
    """A joint and where its relaxed shaft is led by hand."""

    model: str  # Of its servos
    low: int  # Lowest tick of the first servo
    high: int  # Highest tick of it
    zero: int  # Tick of position 0
    # Lowest tick of the second servo, which turns the other way; None: there is none
    second: int | None
    start: int  # Where the shaft is led, in ticks of the first servo, beyond a turn, too
    goals: tuple[float, ...]  # As parts of the range
    reversed: bool = False  # Whether the first servo is mounted the other way round


@st.composite
def cases(draw: st.DrawFn, model: str, pair: bool) -> Case:
    ticks = servo_model(model).ticks
    width = draw(st.integers(ticks // 20, ticks - 1))
    low = draw(st.one_of(st.just(0), st.integers(0, ticks - 1 - width)))
    low = draw(st.sampled_from([low, ticks - 1 - width]))
    high = low + width
    turn = ticks if servo_model(model).endless else ticks * 6 // 5  # AX: 300 of 360 degrees
    farthest = turn // 2 - 30 - width // 2  # beyond it, only an X servo knows which turn it is
    if model.startswith("X"):
        farthest = ticks * 3 // 4
    overshoot = draw(st.integers(-width, max(1, farthest)))
    start = high + overshoot if draw(st.booleans()) else low - overshoot
    second = draw(st.integers(0, ticks - 1 - width)) if pair else None
    goals = draw(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=3))
    zero = draw(st.integers(low, high))
    return Case(model, low, high, zero, second, start, tuple(goals), draw(st.booleans()))


class Led(Rig):
    """A joint whose relaxed shaft is led by hand."""

    def __init__(self, case: Case) -> None:
        self.case = case
        model = servo_model(case.model)
        begin = (case.low + case.high) // 2
        if case.model.startswith("MX"):  # its scale goes round for a hand, too
            begin = case.start
        servos = [SimulatedServo(1, model, position=float(begin % model.ticks))]
        second = None
        if case.second is not None:
            servos.append(SimulatedServo(2, model, position=float(self.other(begin))))
            ends = (self.other(case.low), self.other(case.high))
            if case.reversed:
                ends = ends[::-1]
            second = ServoCalibration("j", 2, self.other(case.zero), *ends, model)
        ends = (case.high, case.low) if case.reversed else (case.low, case.high)
        self.joint = JointConfiguration(
            "j", 1, case.zero, *ends, controller="c", model=model, second=second
        )
        self.before = servos[0].true_ticks
        self.turned = float(begin)  # ticks of the first servo, beyond a turn, too
        self.lowest = self.highest = self.turned
        super().__init__(*servos, joints=[self.joint])

    def other(self, tick: int) -> int:
        """The tick of the second servo at a tick of the first."""
        assert self.case.second is not None
        return self.case.second + self.case.high - tick

    def step(self, count: int = 1) -> BusReading:
        ticks = servo_model(self.case.model).ticks
        for _ in range(count):
            super().step()
            now = self.servos[0].true_ticks
            self.turned += (now - self.before + ticks / 2) % ticks - ticks / 2
            self.before = now
            self.lowest = min(self.lowest, self.turned)
            self.highest = max(self.highest, self.turned)
        return self.reading

    def lead(self, tick: int) -> None:
        """Lead the relaxed shaft by hand to a tick of the first servo, beyond a turn, too."""
        way = tick - self.turned
        steps = 1 + int(abs(way) // 1000)
        for _ in range(steps):
            for servo, sign in zip(self.servos, (1.0, -1.0), strict=False):
                servo.lead(servo.true_ticks + sign * way / steps, 0.1, 50.0)
            self.step(20)
        self.step(10)
        self.lowest = self.highest = self.turned


def drive(case: Case) -> Led:
    """Lead the shaft away, then send goals; check where it has been."""
    rig = Led(case)
    rig.lead(rig.case.start)
    start, joint = rig.turned, rig.joint
    for share in case.goals:
        goal = joint.lower + share * (joint.upper - joint.lower)
        for _ in range(3):
            rig.bus.command({"j": Goal(goal, 4.0)}, clamp=True)
            rig.step(15)
        rig.step(60)
    assert rig.lowest >= min(case.low, start) - SLACK, (start, rig.lowest)
    assert rig.highest <= max(case.high, start) + SLACK, (start, rig.highest)
    if case.low <= start <= case.high and 0 < round(start) < servo_model(case.model).ticks - 1:
        others = [rig.other(round(start))] if case.second is not None else []
        if all(0 <= each < servo_model(case.model).ticks for each in others):
            assert rig.bus.joint("j").torque is Torque.ON  # what is allowed is not refused
    return rig


relaxed = settings(
    max_examples=5,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)


@pytest.mark.parametrize(
    ("name", "pair"),
    [
        ("XM430-W350", False),
        ("XM430-W350", True),
        ("MX-28", False),
        ("AX-12", False),
        ("STS3215", False),
        ("SCS0009", False),
    ],
)
@relaxed
@given(data=st.data())
def test_no_servo_turns_through_what_is_forbidden(data, name, pair):
    drive(data.draw(cases(name, pair)))


@pytest.mark.parametrize(
    "case",
    [
        Case("XM430-W350", 0, 4095, 2000, None, -30, (0.5,)),
        Case("MX-28", 3000, 4095, 3500, None, 4199, (0.1,), True),
        Case("MX-28", 0, 900, 500, None, -140, (0.9, 0.0)),
        Case("XM430-W350", 1000, 2000, 1500, 3000, 900, (0.5,)),
        Case("STS3215", 3000, 4095, 3500, None, 4199, (0.1,)),
        Case("STS3215", 0, 900, 500, None, -140, (0.9, 0.0)),
    ],
)
def test_no_servo_turns_over_the_end_of_its_scale(case):
    drive(case)


@pytest.mark.parametrize(
    ("name", "low", "distance"),
    [
        ("MX-12W", 0, 200),
        ("MX-28", 2047, 60),
        ("MX-28", 0, 1800),
        ("STS3215", 0, 60),
        ("STS3215", 2047, 1800),
        ("STS3250", 2047, 200),
    ],
)
def test_no_servo_overshoots_the_end_of_its_scale_at_full_speed(name, low, distance):
    end, away = (low, distance) if low == 0 else (low + 2048, low + 2048 - distance)
    rig = Led(Case(name, low, low + 2048, low + 1024, None, away, ()))
    rig.lead(rig.case.start)
    for _ in range(60):
        rig.bus.command({"j": Goal(rig.joint.position(end), 50.0)}, clamp=True)
        rig.step()
    assert rig.lowest >= 0 and rig.highest <= 4095


@pytest.mark.parametrize("name", ["AX-12", "MX-28", "STS3215"])
@pytest.mark.parametrize("high", [0.5, 0.97])
def test_a_servo_that_is_pushed_over_the_end_of_its_scale_does_not_turn_all_round(name, high):
    ticks = servo_model(name).ticks
    rig = Led(Case(name, ticks // 40, round(high * ticks), ticks // 4, None, ticks // 20, ()))
    rig.lead(rig.case.start)
    rig.go(rig.joint.position(ticks // 20))
    rig.servos[0].lead(-0.15 * ticks, 0.3, 50.0)
    for _ in range(100):
        with suppress(GoalError):
            rig.bus.command({"j": Goal(0.0, 4.0)})
        rig.step()
    assert rig.lowest >= -0.2 * ticks and not any(rig.torque)
    assert rig.bus.joint("j").torque is Torque.OFF_ON_REQUEST


def test_a_servo_that_crossed_its_whole_scale_while_unplugged_holds_where_it_is():
    rig = Led(Case("MX-28", 40, 4055, 2048, None, 80, ()))
    rig.lead(rig.case.start)
    rig.go(rig.joint.position(100))
    rig.go(rig.joint.position(4000), 3)
    rig.bench.line.plugged = False
    rig.step(200)
    rig.bench.line.plugged = True
    rig.step(30)
    assert rig.torque == [1] and rig.servos[0].true_ticks > 3900


SEAM = [
    Case("XM430-W350", 3000, 4095, 3500, None, 4199, (0.1,)),
    Case("XM430-W350", 0, 900, 500, None, -140, (0.9,), True),
    Case("MX-28", 3000, 4095, 3500, None, 4199, (0.1,)),
    Case("AX-12", 200, 800, 500, None, 1023, (0.1,)),
    Case("AX-12", 200, 800, 500, None, 0, (0.9,)),
    Case("AX-12", 0, 51, 0, None, -206, (0.0,)),
    Case("XM430-W350", 1000, 2000, 1500, 3095, 900, (0.5,)),
]


@pytest.mark.parametrize("case", SEAM)
def test_torque_beyond_the_seam_is_refused_until_the_shaft_is_turned_back(case):
    rig = drive(case)
    assert rig.bus.joint("j").torque is Torque.OFF_UNTIL_COMMANDED
    assert not any(rig.torque)
    assert EventKind.TORQUE_FAILED in rig.kinds
    with pytest.raises(TorqueError):
        run(rig.bus.switching_torque(None, True))
    rig.lead((case.low + case.high) // 2)
    run(rig.bus.switching_torque(None, True))


def test_two_servos_do_not_turn_back_in_opposite_directions_after_limits_were_narrowed():
    rig = Led(Case("MX-28", 3056, 4095, 3556, 2900, 3500, ()))
    rig.lead(5443)
    rig.bus.joint("j").reconfigure(3126, 3556)
    with pytest.raises(TorqueError):
        run(rig.bus.switching_torque(None, True))
    assert not any(rig.torque)


@pytest.mark.parametrize(
    ("secondary", "mirrored", "refused"),
    [(1, False, True), (3, False, False), (3, True, True), (9, False, False), (255, True, False)],
)
def test_a_servo_that_obeys_packets_with_goals_of_another_servo_is_refused(
    secondary, mirrored, refused
):
    model = servo_model("XM430-W350")
    servos = [SimulatedServo(i, model) for i in (1, 2, 3)]
    servos[1].set_register("Secondary ID", secondary)
    bench = Bench(servos)
    ends = (4095, 0) if mirrored else (0, 4095)  # the same goals: Drive Mode is reversed
    second = ServoCalibration("tilt", 3, 2048, *ends, model)
    joints = [
        JointConfiguration("pan", 1, 2048, 0, 4095, controller="p", model=model),
        JointConfiguration("tilt", 2, 2048, 0, 4095, controller="t", model=model, second=second),
    ]
    assert bench.accepts(joints) is not refused
    assert {servo.register("Torque Enable") for servo in servos} == {0}
