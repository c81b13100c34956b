"""Random sequences of transforms, clears and lookups: the buffer ends where tf2's rules end.

Any frame may be put into any other at any time, so that there are loops, frames that change
parents, gaps, equal stamps, stamps of zero, frames that stop being static, and samples at the edge
of the cache. Where tf2 itself is installed the same sequences are given to it too.
"""

import random
from typing import Any

import numpy as np
import pytest
from tf2_model import Refused, Tf2Model

from head_tracking.transforms import (
    Rotation,
    StampedTransform,
    Transform,
    TransformBuffer,
    TransformException,
)

SECOND = 1_000_000_000
FRAMES = "abcde"


class RealTf2:
    """The buffer of an installed tf2, with the methods of `Tf2Model`."""

    def __init__(self) -> None:
        tf2_py = pytest.importorskip("tf2_py")
        from rclpy.duration import Duration

        self._core = tf2_py.BufferCore(Duration(seconds=10))
        self.clear = self._core.clear

    def set_transform(self, stamp, parent, child, transform, *, static) -> None:
        from head_tracking.tf.messages import transform_stamped

        put = self._core.set_transform_static if static else self._core.set_transform
        put(transform_stamped(StampedTransform(stamp, parent, child, transform)), "test")

    def lookup(self, target, source, stamp):
        from rclpy.time import Time

        try:
            found = self._core.lookup_transform_core(target, source, Time(nanoseconds=stamp))
        except Exception as error:
            raise Refused(type(error).__name__) from error
        t, r = found.transform.translation, found.transform.rotation
        there = Transform((t.x, t.y, t.z), Rotation(r.x, r.y, r.z, r.w))
        return Time.from_msg(found.header.stamp).nanoseconds, there.as_matrix()


def ask(buffer: TransformBuffer, model: Any, target: str, source: str, stamp: int) -> None:
    try:
        expected = model.lookup(target, source, stamp)
    except Refused as refused:
        with pytest.raises(TransformException) as found:
            buffer.lookup_transform(target, source, stamp)
        assert type(found.value).__name__ == str(refused), (target, source, stamp)
        assert not buffer.can_transform(target, source, stamp)
        return
    answer = buffer.lookup_transform(target, source, stamp)
    assert answer.stamp == expected[0], (target, source, stamp)
    assert np.allclose(answer.transform.as_matrix(), expected[1], atol=1e-9)
    assert buffer.can_transform(target, source, stamp)


def random_transform(rnd: random.Random) -> Transform:
    """Return a transform, which often is a translation only."""
    turn = rnd.choice((0.0, 3.0))
    return Transform.from_xyz_rpy(
        [rnd.uniform(-3, 3) for _ in range(3)], [rnd.uniform(-turn, turn) for _ in range(3)]
    )


AGES = (0, 0, 0, SECOND // 7, 9 * SECOND, 10 * SECOND - 1, 10 * SECOND, 10 * SECOND + 1)


@pytest.mark.parametrize("tf2", [Tf2Model, RealTf2])
@pytest.mark.parametrize("seed", range(12))
def test_long_histories_end_as_in_tf2(seed, tf2):
    """A tree in motion, with pauses, late samples, hand-overs, static frames and clears."""
    rnd = random.Random(seed)
    model = tf2()
    buffer = TransformBuffer()
    parents = {"b": "a", "c": "b", "d": "b", "e": "a"}
    now = SECOND
    for _ in range(200):
        now += rnd.choice((0, SECOND // 10, SECOND // 10, SECOND // 3, 4 * SECOND))
        if rnd.random() < 0.02:
            buffer.clear()
            model.clear()
        child = rnd.choice("bcde" if seed % 2 else FRAMES)
        if rnd.random() < 0.1 or child not in parents:
            parents[child] = rnd.choice(FRAMES.replace(child, ""))
        stamp = max(0, now - rnd.choice(AGES))
        static = rnd.random() < (0.05 if seed % 3 else 0.4)
        sample = stamp, parents[child], child, random_transform(rnd)
        for each in (buffer, model):
            each.set_transform(*sample, static=static)
        for _ in range(3):
            asked = rnd.choice((0, stamp, now - rnd.choice(AGES), now - rnd.randrange(12 * SECOND)))
            ask(buffer, model, rnd.choice(FRAMES), rnd.choice(FRAMES), max(0, asked))
