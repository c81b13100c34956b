import itertools
import math

import numpy as np
import pytest
from rendered_frames import SMALL

from head_tracking.scene import SCENES, Ball, Board, Renderer, SensorNoise, Swing, make_scene
from head_tracking.scene.render import Rendering
from head_tracking.scene.scenes import face
from head_tracking.transforms import Rotation, Transform
from head_tracking.vision import ColourDetector, ColourParameters
from head_tracking.vision.candidate import Frame
from head_tracking.vision.images import Picture

# optical frame at 0.6 m, looking along x
LEVEL = Transform((0.0, 0.0, 0.6), Rotation.from_rpy(-math.pi / 2, 0.0, -math.pi / 2))


def turned(pan: float, tilt: float) -> Transform:
    return Transform(LEVEL.translation, Rotation.from_rpy(0.0, tilt, pan) @ LEVEL.rotation)


@pytest.mark.parametrize("name", SCENES)
def test_a_room_fills_every_picture_with_colours_and_depths(name):
    renderer = Renderer(make_scene(name, np.random.default_rng(1)), SMALL)
    for pan, tilt in itertools.product((0.0, -2.5), (0.0, -0.9, 1.2)):
        seen = renderer.render(turned(pan, tilt), 1.0)
        assert seen.picture.shape == (240, 320, 3)
        # at the joints between walls a row of pixels can stay free
        assert np.isfinite(seen.depth).mean() > 0.985
        assert np.nanmin(seen.depth) > 0.3
        assert np.nanmax(seen.depth[np.isfinite(seen.depth)]) < 6.5


def test_the_nearer_one_hides_the_other_whatever_the_order():
    plain = np.full((64, 64, 4), (10, 200, 60, 255), np.uint8)
    near, far = Ball(0.1, (0, 0, 255), Swing(1.0, 0.6)), Board(plain, 0.5, Swing(2.0, 0.6))
    for things in ({"a": near, "b": far}, {"b": far, "a": near}):
        seen = Renderer(things, SMALL).render(LEVEL, 0.0)
        assert seen.depth[120, 160] == pytest.approx(0.9, abs=0.01)
        assert seen.picture[120, 160].argmax() == 2
        assert np.isclose(seen.depth, 2.0, atol=0.02).sum() > 1000


def test_noise_and_holes_are_as_asked_for():
    rng = np.random.default_rng(4)
    flat = Rendering(np.full((240, 320, 3), 128, np.uint8), np.full((240, 320), 2.0, np.float32))
    noise = SensorNoise((320, 240), rng, 5.0, 0.0015, 0.05)
    first, second = noise(flat), noise(flat)
    assert first.picture.astype(float).std() == pytest.approx(5.0, rel=0.05)
    assert np.nanstd(first.depth) == pytest.approx(0.0015 * 4, rel=0.05)
    assert np.isnan(first.depth).mean() == pytest.approx(0.05, abs=0.01)
    assert (first.picture != second.picture).mean() > 0.5
    assert (flat.picture == 128).all()


def test_a_person_walks_while_the_path_goes_on_and_stands_when_it_ends():
    walker = face(lambda time: (1.5, 0.5 * min(time, 2.0), 0.6))
    walking = {walker.image(0.1 * k).tobytes() for k in range(10)}
    standing = {walker.image(3.0 + 0.1 * k).tobytes() for k in range(10)}
    assert len(walking) > 1
    assert len(standing) == 1


def test_nothing_but_the_ball_looks_like_the_ball():
    things = make_scene("everything", np.random.default_rng(1))
    renderer = Renderer({name: one for name, one in things.items() if name != "ball"}, SMALL)
    noise = SensorNoise((SMALL.width, SMALL.height), np.random.default_rng(1), 4.0, 0.0, 0.0)
    detector = ColourDetector(ColourParameters())
    for pan, time in itertools.product(np.arange(-1.5, 1.6, 0.15), (0.0, 5.0)):
        picture = noise.picture(renderer.render(turned(pan, 0.0), time, depth=False).picture)
        assert detector.detect(Frame(0, SMALL, Picture(picture)), []) == []
