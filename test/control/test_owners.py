import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from head_tracking.control import JUST_STOPPED, LEASE, JointOwners, OwnershipError

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


def test_who_owns_a_joint_keeps_it(owners):
    owners.claim("/head_tracker", JOINTS)
    with pytest.raises(OwnershipError, match=r"head_tilt_joint belongs to /head_tracker.*enable"):
        owners.claim("somebody", [TILT], LEASE)
    assert owners.of(JOINTS) == {PAN: "/head_tracker", TILT: "/head_tracker"}


def test_a_claim_by_commands_ends_with_them(owners, clock):
    owners.claim("somebody", [PAN], LEASE)
    with pytest.raises(OwnershipError, match="as long as that sends commands"):
        owners.claim("/other", [PAN], LEASE)
    clock.now += 1.01 * LEASE
    assert owners.of([PAN]) == {PAN: ""}
    owners.claim("/other", [PAN], LEASE)


def test_several_joints_are_claimed_all_or_none(owners):
    owners.claim("somebody", [TILT])
    with pytest.raises(OwnershipError):
        owners.claim("/head_tracker", JOINTS)
    assert owners.of(JOINTS) == {PAN: "", TILT: "somebody"}


def test_a_stop_takes_all_from_everybody_until_it_is_ended(owners, clock):
    owners.claim("/head_tracker", JOINTS)
    owners.stop()
    with pytest.raises(OwnershipError, match="stopped; call resume"):
        owners.claim("/head_tracker", JOINTS)
    with pytest.raises(OwnershipError, match="stopped just now"):
        owners.take_over("/point_head", JOINTS)  # which somebody had asked for before
    clock.now += 1.01 * JUST_STOPPED
    owners.take_over("/point_head", JOINTS)
    assert not owners.stopped
    assert owners.of([PAN]) == {PAN: "/point_head"}


def test_where_others_are_allowed_the_last_command_wins(clock):
    owners = JointOwners(exclusive=False, clock=clock)
    owners.claim("/head_tracker", JOINTS)
    owners.claim("somebody", [PAN], LEASE)
    assert owners.of(JOINTS) == {PAN: "somebody", TILT: "/head_tracker"}


def test_each_change_is_told(owners):
    told = []
    owners.on_change = lambda: told.append(dict(owners.of([PAN])))
    owners.claim("/head_tracker", [PAN])
    owners.claim("/head_tracker", [PAN])
    owners.release("/head_tracker")
    assert told == [{PAN: "/head_tracker"}, {PAN: ""}]


REQUESTS = st.one_of(
    st.tuples(st.just("claim"), st.sampled_from(WHO), st.sets(st.sampled_from(JOINTS), min_size=1)),
    st.tuples(st.just("lease"), st.sampled_from(WHO), st.sets(st.sampled_from(JOINTS), min_size=1)),
    st.tuples(st.just("take"), st.sampled_from(WHO), st.sets(st.sampled_from(JOINTS), min_size=1)),
    st.tuples(st.just("release"), st.sampled_from(WHO)),
    st.tuples(st.just("stop")),
    st.tuples(st.just("resume")),
    st.tuples(st.just("wait"), st.floats(0.0, 1.5)),
)


@given(st.lists(REQUESTS, max_size=40))
def test_it_does_what_a_small_model_does(requests):
    clock = Clock()
    owners = JointOwners(clock=clock)
    model: dict[str, tuple[str, float]] = dict.fromkeys(JOINTS, ("", math.inf))
    stopped, stopped_at = False, 0.0
    for request in requests:
        model = {j: own if clock.now < own[1] else ("", math.inf) for j, own in model.items()}
        match request:
            case ("claim" | "lease" as how, who, joints):
                lease = LEASE if how == "lease" else math.inf
                free = not stopped and all(model[joint][0] in ("", who) for joint in joints)
                if free:
                    owners.claim(who, joints, lease)
                    model |= dict.fromkeys(joints, (who, clock.now + lease))
                else:
                    with pytest.raises(OwnershipError):
                        owners.claim(who, joints, lease)
            case ("take", who, joints) if stopped and clock.now - stopped_at < JUST_STOPPED:
                with pytest.raises(OwnershipError):
                    owners.take_over(who, joints)
            case ("take", who, joints):
                owners.take_over(who, joints)
                stopped = False
                model |= dict.fromkeys(joints, (who, math.inf))
            case ("release", who):
                owners.release(who)
                model = {j: ("", math.inf) if own[0] == who else own for j, own in model.items()}
            case ("stop",):
                owners.stop()
                stopped, stopped_at = True, clock.now
                model = dict.fromkeys(JOINTS, ("", math.inf))
            case ("resume",):
                owners.stop(False)
                stopped = False
            case ("wait", seconds):
                clock.now += seconds
        expected = {j: own[0] if clock.now < own[1] else "" for j, own in model.items()}
        assert owners.of(JOINTS) == expected
        assert owners.stopped is stopped
