import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from head_tracking.control import LEASE, JointOwners, OwnershipError
from head_tracking.dynamixel import StoppedError

PAN, TILT = JOINTS = ("head_pan_joint", "head_tilt_joint")
WHO = ("/head_tracker", "/point_head", "somebody")


class Clock:
    now = 0.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def owners(clock):
    return JointOwners(clock=clock)


def resume(owners):
    return owners.resume(owners.epoch.value)


def test_a_resume_older_than_a_stop_does_not_end_it(owners):
    owners.stop(dict)
    epoch = owners.epoch.value
    owners.stop(dict)
    with pytest.raises(StoppedError):
        owners.resume(epoch)
    assert owners.stopped


def test_stop_relaxes_before_it_notifies_and_notifies_also_after_an_error(owners):
    said = []
    owners.observe(lambda: said.append(owners.stopped))
    assert owners.stop(lambda: list(said)) == []
    assert said == [True]
    resume(owners)
    with pytest.raises(ZeroDivisionError):
        owners.stop(lambda: 1 // 0)
    assert said == [True, False, True]


def test_the_state_of_a_servo_bus_elsewhere_is_adopted(owners):
    owners.claim("/head_tracker", JOINTS)
    owners.follow(True, 3)
    with pytest.raises(StoppedError):
        owners.claim("/head_tracker", JOINTS)
    owners.follow(False, 3)
    assert owners.owns("/head_tracker", JOINTS)
    said = []
    owners.observe(lambda: said.append(owners.epoch.value))
    owners.follow(False, 3)
    owners.follow(False, 4)  # stopped and resumed meanwhile
    assert said == [4]
    assert owners.owns("/head_tracker", JOINTS)


def test_joints_lost_at_a_servo_bus_elsewhere_are_lost_here(owners):
    owners.claim("/head_tracker", JOINTS)
    owners.follow(False, 0, dict.fromkeys(JOINTS, "somebody"))  # owned before this owner was heard
    assert owners.owns("/head_tracker", JOINTS)
    assert owners.elsewhere(JOINTS) == "somebody"
    owners.follow(False, 0, dict.fromkeys(JOINTS, "/head_tracker"))
    assert owners.owns("/head_tracker", JOINTS)
    owners.follow(False, 0, {PAN: "/point_head", TILT: "/head_tracker"})
    assert not owners.owns("/head_tracker", JOINTS)
    assert owners.of(JOINTS) == {PAN: "/point_head", TILT: "/head_tracker"}
    owners.follow(False, 0, dict.fromkeys(JOINTS, ""))
    assert owners.elsewhere(JOINTS) == ""


def test_a_sender_with_the_name_of_a_controller_does_not_shorten_its_claim(owners, clock):
    owners.claim("/head_tracker", JOINTS)
    for request in (owners.claim, owners.take_over):
        with pytest.raises(OwnershipError, match="rename"):
            request("/head_tracker", JOINTS, lease=LEASE)
    clock.now += 2.0 * LEASE
    with pytest.raises(OwnershipError):
        owners.check("somebody", JOINTS)


JOINT_SETS = st.sets(st.sampled_from(JOINTS), min_size=1)
REQUESTS = st.one_of(
    st.tuples(st.just("claim"), st.sampled_from(WHO), JOINT_SETS),
    st.tuples(st.just("lease"), st.sampled_from(WHO), JOINT_SETS),
    st.tuples(st.just("take"), st.sampled_from(WHO), JOINT_SETS),
    st.tuples(st.just("check"), st.sampled_from(WHO), JOINT_SETS),
    st.tuples(st.just("release"), st.sampled_from(WHO)),
    st.tuples(st.just("stop")),
    st.tuples(st.just("resume")),
    st.tuples(st.just("wait"), st.floats(0.0, 1.5)),
)


@given(st.lists(REQUESTS, max_size=40))
def test_random_requests_match_a_model(requests):
    clock = Clock()
    owners = JointOwners(clock=clock)
    nobody = ("", math.inf)
    model = dict.fromkeys(JOINTS, nobody)
    before = {}
    stopped = False
    for request in requests:
        model = {j: own if clock.now < own[1] else nobody for j, own in model.items()}
        match request:
            case ("claim" | "lease" | "take" | "check" as how, who, joints):
                lease = LEASE if how == "lease" else math.inf
                attempt = {"take": owners.take_over, "check": owners.check}.get(how, owners.claim)
                given = (lease,) if how == "lease" else ()
                free = how == "take" or all(model[joint][0] in ("", who) for joint in joints)
                if how in ("lease", "check"):  # not by a sender with the name of a controller
                    free &= all(model[joint] != (who, math.inf) for joint in joints)
                if free and not stopped:
                    attempt(who, joints, *given)
                    if how != "check":
                        model |= dict.fromkeys(joints, (who, clock.now + lease))
                else:
                    with pytest.raises(StoppedError if stopped else OwnershipError) as refusal:
                        attempt(who, joints, *given)
                    if not stopped:
                        owner, until = model[refusal.value.joint]
                        assert refusal.value.owner == owner != ""
                        assert refusal.value.leased == math.isfinite(until)
                    if how == "claim" and stopped and not before.keys() & joints:
                        before |= dict.fromkeys(joints, (who, math.inf))
            case ("release", who):
                owners.release(who)
                model = {j: nobody if own[0] == who else own for j, own in model.items()}
                before = {j: own for j, own in before.items() if own[0] != who}
            case ("stop",):
                epoch = owners.epoch.value
                assert owners.stop(lambda: "relaxed") == "relaxed"
                assert owners.epoch.value > epoch
                if not stopped:
                    before = {j: own for j, own in model.items() if own[0] and math.isinf(own[1])}
                stopped, model = True, dict.fromkeys(JOINTS, nobody)
            case ("resume",):
                assert {*resume(owners)} == {own[0] for own in before.values()}
                if stopped:
                    model |= before
                stopped, before = False, {}
            case ("wait", seconds):
                clock.now += seconds
        expected = {j: own[0] if clock.now < own[1] else "" for j, own in model.items()}
        assert owners.of(JOINTS) == expected
        assert owners.stopped is stopped
        if stopped:
            with pytest.raises(StoppedError):
                owners.permit()
        else:
            assert owners.permit() == owners.epoch.value
