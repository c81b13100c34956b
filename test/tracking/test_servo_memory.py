"""What was learned of the servos is kept from one run to the next."""

import time
from dataclasses import replace

import pytest
from closed_loop import ClosedLoop, Conditions
from plant import PlainServo
from runs import around, sine

from head_tracking.head.servo_memory import ServoMemory
from head_tracking.share import state_folder
from head_tracking.tracking import LAWS, ServoValues, Tracker

VALUES = ServoValues(delay=0.1, deviation=0.015, dead_band=0.002)
LATE = PlainServo(dead_time=0.1)
SWING = sine(0.5)


def follow(head, servo, saved=None, duration=8.0, start=(0.0, 0.0), path=SWING):
    tracker = Tracker(head, LAWS["predictive"](head, 0.02))
    tracker.law.expect({head.pan_joint: saved} if saved else {})
    conditions = Conditions(duration=duration, noise=0.002, delay=0.05, servos=servo, start=start)
    return ClosedLoop(path, replace(conditions, field=(3.0, 3.0))).run(tracker).recording, tracker


def test_a_head_that_knows_its_servos_tracks_well_at_once(head):
    _, first = follow(head, LATE)
    (saved,) = first.law.to_save.values()  # not of the tilt servo, which has hardly moved
    assert saved.delay == pytest.approx(0.1, abs=0.03)
    band = first.law.servos[head.pan_joint].values["dead band"]
    assert (saved.dead_band is None) == (band.source == "not observable")
    fresh, _ = follow(head, LATE, duration=1.5, start=(0.1, 0.0))
    knowing, again = follow(head, LATE, saved, duration=1.5, start=(0.1, 0.0))
    assert knowing.rms < 0.9 * fresh.rms
    assert not any(servo.is_contradicted for servo in again.law.servos.values())


@pytest.mark.parametrize(
    "wrong",
    [
        replace(VALUES, delay=0.3),
        replace(VALUES, delay=0.2, dead_band=0.012),
    ],
)
def test_values_that_do_not_fit_are_dropped(head, wrong):
    servo = PlainServo(dead_time=0.03)
    fresh, _ = follow(head, servo)
    misled, tracker = follow(head, servo, wrong)
    contradicted = [name for name, servo in tracker.law.servos.items() if servo.is_contradicted]
    assert contradicted == [head.pan_joint]
    assert tracker.law.delays[0] == pytest.approx(0.05, abs=0.03)
    assert misled.between(4.0).rms < 1.3 * fresh.between(4.0).rms
    assert abs(misled.positions).max() < 0.8


def test_files_keep_values_by_servo(tmp_path):
    memory = ServoMemory({"pan": "usb-FTDI_A1 AX-12 1", "tilt": ""}, tmp_path / "new")
    assert memory.load() == {}
    memory.save({"pan": VALUES, "tilt": VALUES})
    assert memory.load() == {"pan": VALUES}
    renamed = ServoMemory(
        {"neck": "usb-FTDI_A1 AX-12 1", "pan": "usb-FTDI_A1 AX-12 2"}, tmp_path / "new"
    )
    assert renamed.load() == {"neck": VALUES}
    memory.forget()
    assert memory.load() == renamed.load() == {}


@pytest.mark.parametrize("text", ["", "delay: .nan", "- 1", "delay: [", "delay: x", "\x00", "{}"])
def test_files_that_cannot_be_used_are_left_out(tmp_path, text):
    memory = ServoMemory({"pan": "servo"}, tmp_path)
    memory.save({"pan": VALUES})
    (file,) = tmp_path.iterdir()
    for content in (text, file.read_text().replace("0.1", text or "-1"), file.read_text()[:30]):
        file.write_text(content)
        assert memory.load() == {}


def test_a_folder_that_cannot_be_written_keeps_nothing(tmp_path):
    (tmp_path / "file").write_text("")
    memory = ServoMemory({"pan": "servo"}, tmp_path / "file" / "folder")
    memory.save({"pan": VALUES})
    memory.forget()
    assert memory.load() == {}


def test_a_user_without_a_home_starts_too(monkeypatch):
    monkeypatch.delenv("XDG_STATE_HOME", raising=False)
    monkeypatch.delenv("HOME", raising=False)
    monkeypatch.setattr("os.getuid", lambda: 999_999)
    assert state_folder("servos").is_absolute()
    assert ServoMemory({}).load() == {}


def kinks(t):
    return around(abs(t % 1.2 - 0.6) - 0.3)


@pytest.mark.parametrize(
    ("path", "servo"),
    [
        (SWING, PlainServo(dead_time=0.0, dead_band=0.0)),
        (SWING, PlainServo(dead_time=0.07, dead_band=0.0, resolution=0.005)),
        (SWING, PlainServo(dead_time=0.3, dead_band=0.0, resolution=0.0005)),
        (SWING, PlainServo(dead_time=0.06, dead_band=0.003, resolution=0.0005)),
        (SWING, PlainServo(dead_time=0.06, dead_band=0.006, resolution=0.0005)),
        (SWING, PlainServo(acceleration=5.0, dead_band=0.0)),
        (kinks, PlainServo(dead_time=0.1, acceleration=5.0, dead_band=0.01)),
        (kinks, PlainServo(dead_time=0.05, acceleration=20.0, dead_band=0.0)),
        (kinks, PlainServo(dead_time=0.1, acceleration=20.0, dead_band=0.0)),
    ],
)
def test_delay_dead_band_and_acceleration_are_learned_or_called_not_observable(head, path, servo):
    _, tracker = follow(head, servo, path=path)
    model = tracker.law.servos[head.pan_joint]
    band, limit = model.values["dead band"], model.values["acceleration"]
    is_weak = servo.acceleration < 100.0
    off = abs(model.mean - servo.dead_time - servo.lag + 0.005)
    assert off < (2.0 * model.deviation if is_weak else 0.008)
    assert is_weak or model.deviation < 0.03
    assert limit.source == ("learned" if is_weak else "not observable")
    if is_weak:
        assert limit.value == pytest.approx(servo.acceleration, rel=0.4)
    if band.source == "learned":
        assert band.value == pytest.approx(servo.dead_band, abs=2.0 * band.deviation)
        assert band.value == pytest.approx(servo.dead_band, abs=0.003)


def test_what_is_known_from_an_earlier_run_says_so_and_has_an_age(head, tmp_path):
    memory = ServoMemory({"pan": "usb-FTDI_A1 AX-12 1"}, tmp_path)
    unknown = replace(VALUES, dead_band=None)
    memory.save({"pan": unknown})
    assert memory.load() == {"pan": unknown}
    law = LAWS["predictive"](head, 0.02)
    law.expect({head.pan_joint: unknown})
    assert law.servos[head.pan_joint].values["dead band"].source == "not observable"
    memory.save({"pan": VALUES})
    saved = memory.load()["pan"]
    law = LAWS["predictive"](head, 0.02)
    assert {each.source for each in law.learned.values()} <= {"not observable"}
    law.expect({head.pan_joint: saved})
    assert law.delays[0] == pytest.approx(0.1, abs=0.02)
    assert not law.to_save, "nothing was learned yet"
    values = law.servos[head.pan_joint].values
    names = ("delay of its servo", "dead band", "acceleration")
    sources = [values[name].source for name in names]
    assert sources == ["saved", "saved", "not observable"]
    for name in names[:2]:
        assert values[name].learned == pytest.approx(time.time(), abs=60.0)
    ages = {0.0: "0 s", 90.0: "90 s", 600.0: "10 min", 7200.0: "2 h", 20 * 86_400.0: "20 days"}
    for age, text in ages.items():
        assert f", saved {text} ago" in values["dead band"].described(saved.saved + age)
