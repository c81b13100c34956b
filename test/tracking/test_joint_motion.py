from hypothesis import given
from hypothesis import strategies as st

from head_tracking.tracking.joint_controller import JointMotion, MotionLimits
from head_tracking.transforms import JointLimits

JOINT = JointLimits(-1.5, 1.5)
DT = 0.02


@given(
    st.lists(st.floats(-4.0, 4.0), min_size=1, max_size=40),
    st.floats(0.1, 6.0),
    st.floats(2.0, 100.0),
)
def test_speed_acceleration_and_range_are_kept_whatever_is_wanted(wishes, speed, acceleration):
    limits = MotionLimits(speed, acceleration, 1e4)
    motion = JointMotion(0.0)
    for wish in wishes:
        for _ in range(25):
            before = motion.velocity
            motion.steer(wish, 0.0, DT, DT, limits, JOINT)
            motion.position += motion.velocity * DT
            assert abs(motion.velocity) <= speed + 1e-9
            assert -1.5 - 1e-9 <= motion.position <= 1.5 + 1e-9
            # braking at the end of the range comes first
            assert abs(motion.velocity - before) <= acceleration * DT * 1.7 + 1e-9
