"""`Head` from within: moments between its steps that a program can hardly hit."""

import signal
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from functools import partial

import pytest
from rig import Servos, swing_until_learned
from waiting import PATIENCE, wait_for

from head_tracking import FrameError, Head, HeadState, RefusedCommandError
from head_tracking.control.dynamixel_backend import DynamixelBackend
from head_tracking.dynamixel import BusStoppedError, ServoBus
from head_tracking.dynamixel.serial_port import open_serial
from head_tracking.head.head_control import HeadControl
from head_tracking.transforms import TransformBuffer


@pytest.fixture
def servos(tmp_path):
    with closing(Servos(tmp_path / "servos")) as servos:
        yield servos


def test_a_head_is_open_when_both_joints_are_measured(servos, kinectbot, monkeypatch):
    """Replies are lost on a disturbed line; the error would speak of a clock that jumped."""
    start, servo = DynamixelBackend.start, servos.port.use(lambda bus: bus[2])

    def start_without_tilt(backend):
        servos.port.use(lambda bus: servo.set_register("ID", 9))
        restore = partial(servos.port.use, lambda bus: servo.set_register("ID", 2))
        threading.Timer(0.5, restore).start()
        start(backend)

    monkeypatch.setattr(DynamixelBackend, "start", start_without_tilt)
    with Head(servos.name, kinectbot, reply_timeout=0.2) as head:
        assert len(head.joints) == 2


def test_joints_are_not_called_silent_before_the_first_cycle(servos, kinectbot, caplog):
    """Connecting takes that long with more servos, or an adapter with a latency timer."""

    def open_late(port, baud_rate):
        time.sleep(0.7)
        return open_serial(port, baud_rate)

    with Head(servos.name, kinectbot, reply_timeout=0.2, open_device=open_late) as head:
        assert head.joints
    assert "silent" not in caplog.text


def test_a_head_that_fails_after_it_has_connected_leaves_its_port(servos, kinectbot, monkeypatch):
    """As in a notebook, which keeps the error and with it the head."""
    with monkeypatch.context() as patch:
        patch.setattr(HeadControl, "begin", lambda _: 1 / 0)
        with pytest.raises(ZeroDivisionError) as kept:
            Head(servos.name, kinectbot, reply_timeout=0.2)
    with Head(servos.name, kinectbot, reply_timeout=0.2) as head:
        assert head.state is HeadState.HOLDING
    assert kept.traceback


def test_learned_servo_values_are_saved_for_the_next_run(servos, kinectbot, tmp_path, monkeypatch):
    adapter = tmp_path / "usb-FTDI_USB_Adapter_A1"
    adapter.symlink_to(servos.name)
    monkeypatch.setattr("head_tracking.dynamixel.port.stable_name", lambda _: str(adapter))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    pan, found = "head_pan_joint: delay of its servo", []
    for run in range(4):
        with Head(servos.name, kinectbot, reply_timeout=0.2) as head:
            found.append(head.learned[pan].source)
            if run in (0, 1):
                swing_until_learned(head, pan)
            elif run == 2:
                head.learn("forget")
    assert found == ["not observable", "saved", "saved", "not observable"]


def test_a_turn_begins_where_the_head_is_now_not_where_it_was_in_the_cycle_before(
    servos, kinectbot, monkeypatch
):
    permit, present, ages = Head._permit, HeadControl.present, []

    def permit_late(head, *epoch):
        time.sleep(0.2)
        return permit(head, *epoch)

    def note(control):
        ages.append(control.now - control._clock.checked)
        return present(control)

    with Head(servos.name, kinectbot, reply_timeout=0.2) as head:
        monkeypatch.setattr(Head, "_permit", permit_late)
        monkeypatch.setattr(HeadControl, "present", note)
        assert head.look_at((2.0, 1.0, 0.6)).arrived
    assert ages[0] < 0.1


LOOK = partial(Head.look_at, point=(2.0, 2.0, 0.6))


@pytest.mark.parametrize(
    ("kind", "step", "command"),
    [
        (TransformBuffer, "lookup_transform", LOOK),
        (DynamixelBackend, "call", LOOK),
        (DynamixelBackend, "call", Head.resume),
    ],
)
def test_a_command_is_refused_if_relax_comes_before_one_of_its_steps(
    servos, kinectbot, monkeypatch, kind, step, command
):
    carry_out = getattr(kind, step)

    def relaxing_before(*arguments, **named):
        monkeypatch.undo()
        head.relax()
        assert servos.torque == [0, 0]
        return carry_out(*arguments, **named)

    with Head(servos.name, kinectbot, reply_timeout=0.2) as head:
        monkeypatch.setattr(kind, step, relaxing_before)
        with pytest.raises(RefusedCommandError) as refused:
            command(head)
        assert refused.value.state == head.state == HeadState.RELAXED
        assert servos.torque == [0, 0]


def test_resume_is_refused_if_its_torque_is_cut_by_a_relax_that_was_called_before(monkeypatch):
    """It began in the epoch of the relax, before the servos were relaxed."""
    relax = ServoBus.relax_at_once

    def resuming_before(bus, *arguments, **named):  # the bus waits for its end
        monkeypatch.setattr(ServoBus, "relax_at_once", relax)
        resumed.append(threads.submit(head.resume))
        wait_for(bus.requests.has_waiting)
        bus.requests.begin_next()
        while bus.joint("head_pan_joint").servos[0].held_by is None:
            bus.requests.advance(bus.requests.under_way[-1])
        return relax(bus, *arguments, **named)

    resumed = []
    monkeypatch.setattr(ServoBus, "relax_at_once", resuming_before)
    with Head.simulated() as head, ThreadPoolExecutor() as threads:
        head.relax()
        with pytest.raises(RefusedCommandError) as refused:
            resumed[0].result(PATIENCE)
        assert refused.value.state == head.state == HeadState.RELAXED
        head.resume()
        assert head.state is HeadState.HOLDING


def test_nothing_waits_for_joints_of_a_time_before_the_first_measurement(monkeypatch):
    before = time.time()
    with Head.simulated() as head:
        monkeypatch.setattr("head_tracking.head.head._TIMEOUT", PATIENCE)
        for stamp in (1.0, before):
            began = time.monotonic()
            with pytest.raises(FrameError):
                head.pose("camera_link", stamp=stamp)
            assert time.monotonic() - began < PATIENCE / 2
        assert head.pose("camera_link", stamp=time.time() + 0.2)


def test_a_command_waits_for_a_bus_that_is_delayed_by_a_busy_machine():
    with Head.simulated() as head, ThreadPoolExecutor() as threads:
        (thread,) = head._servos.threads
        with thread._owner:
            looking = threads.submit(head.look_at, (2.0, 0.3, 0.6))
            time.sleep(2.5)
        assert looking.result(PATIENCE).arrived


@pytest.mark.parametrize("command", [Head.stop, Head.relax])
def test_ctrl_c_is_raised_after_stop_and_relax(monkeypatch, command):
    """Else it could end a thread that relaxes the servos."""
    relax = DynamixelBackend.relax_now

    def interrupted(*arguments):
        signal.raise_signal(signal.SIGINT)
        return relax(*arguments)

    with Head.simulated() as head:
        assert head.look_at((2.0, 0.3, 0.6)).arrived
        monkeypatch.setattr(DynamixelBackend, "relax_now", interrupted)
        with pytest.raises(KeyboardInterrupt):
            command(head)
        assert not any(head._bus.joint(joint).on for joint in head.joints)
        monkeypatch.undo()


def test_torque_that_comes_too_late_for_a_command_stays_off(monkeypatch):
    with Head.simulated() as head:
        (thread,) = head._servos.threads
        monkeypatch.setattr("head_tracking.head.head._EXECUTION", 0.1)
        with thread._owner, pytest.raises(BusStoppedError):
            head.look_at((2.0, 2.0, 0.6))
        cycle = thread.bus.cycle
        before = cycle.cycles
        wait_for(lambda: cycle.cycles > before + 20)
        assert not any(thread.bus.joint(joint).on for joint in head.joints)
