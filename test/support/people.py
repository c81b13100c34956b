"""Rendered people who leave, are replaced by others, come back and cross, and who is followed."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple

import numpy as np
from rendered_frames import SMALL

from head_tracking.scene import Renderer, SensorNoise
from head_tracking.scene.drawings import Texture, pattern
from head_tracking.scene.objects import Path, Thing, Wall
from head_tracking.scene.room import room
from head_tracking.scene.scenes import FACE_WIDTH, face, stride
from head_tracking.transforms import Rotation, Transform, Vector3
from head_tracking.vision import (
    Box,
    Candidate,
    DepthImage,
    DistanceParameters,
    Frame,
    IdentityParameters,
    Picture,
    VisualTracker,
)

PERIOD = 0.1  # s
SHIRTS = (
    (150, 80, 40), (60, 130, 40), (40, 40, 180), (230, 230, 230), (30, 30, 30), (40, 170, 220),
    (160, 60, 140), (130, 130, 125), (70, 90, 120), (180, 160, 60),
)  # fmt: skip
"""Blue, green, red: bright and pale ones, white, grey and black."""
_DRAWN = np.array([(150, 180, 225), (35, 45, 70), (150, 80, 40)], float)
"""Skin, hair and shirt of the person in blue; the three are told apart by their colours."""
HAIR = ((35, 45, 70), (20, 20, 20), (120, 190, 220), (150, 150, 155))
SKIN = ((150, 180, 225), (90, 120, 170), (60, 85, 130), (175, 200, 240))
_POSE = Transform((0.0, 0.0, 0.75), Rotation.from_rpy(-math.pi / 2, 0.0, -math.pi / 2))


class Looks(NamedTuple):
    """The colours of a person: blue, green, red."""

    skin: tuple[int, int, int]
    hair: tuple[int, int, int]
    shirt: tuple[int, int, int]


@cache
def dressed(looks: Looks) -> list[Texture]:
    """Return the stride of the person in blue with other colours, as light and dark as before."""
    return [_recoloured(one, looks) for one in stride("walker")]


def _recoloured(picture: Texture, looks: Looks) -> Texture:
    pixels = picture[..., :3].astype(float)
    shades = pixels @ _DRAWN.T / (_DRAWN**2).sum(axis=1)
    away = np.linalg.norm(pixels[..., None, :] - shades[..., None] * _DRAWN, axis=-1)
    part = away.argmin(axis=-1)
    shade = np.take_along_axis(shades, part[..., None], axis=-1)
    is_part = away.min(axis=-1) < 0.2 * np.linalg.norm(pixels, axis=-1)
    new = np.where(is_part[..., None], np.clip(shade * np.array(looks)[part], 0, 255), pixels)
    return np.dstack([new.round().astype(np.uint8), picture[..., 3]])


@dataclass(frozen=True)
class Person:
    """Somebody in the scene."""

    looks: Looks  # colours of skin, hair and clothes
    path: Path  # of the face's middle, in the scene [m]
    shown: Sequence[tuple[float, float]]  # when this person is there [s]: pairs of begin and end

    def is_there(self, time: float) -> bool:
        return any(begin <= time < end for begin, end in self.shown)


def draw_looks(rng: np.random.Generator, *others: Looks) -> Looks:
    """Return somebody whose clothes have another colour than those of others."""
    free = [shirt for shirt in SHIRTS if shirt not in [other.shirt for other in others]]
    return Looks(
        SKIN[rng.integers(len(SKIN))], HAIR[rng.integers(len(HAIR))], free[rng.integers(len(free))]
    )


def followed(
    people: Sequence[Person], duration: float, seed: int, *, depth: bool = True
) -> list[int | None]:
    """Return the index of the person who is followed in each picture; None if nobody is.

    Faces are found where they are, with the noise of a detector; who is behind somebody is not.
    """
    distances = DistanceParameters() if depth else DistanceParameters(object_size=FACE_WIDTH)
    tracker = VisualTracker(None, distances, IdentityParameters())
    rng = np.random.default_rng(seed)
    names = [f"person {i}" for i in range(len(people))]
    boards = {
        name: face(person.path, dressed(person.looks))
        for name, person in zip(names, people, strict=True)
    }
    around, noise = _surroundings(seed % 4 > 1)
    renderers: dict[tuple[int, ...], Renderer] = {}
    result: list[int | None] = []
    for step in range(round(duration / PERIOD)):
        time = step * PERIOD
        there = tuple(i for i, person in enumerate(people) if person.is_there(time))
        if there not in renderers:
            scene = {**around, **{names[i]: boards[names[i]] for i in there}}
            renderers[there] = Renderer(scene, SMALL)
        seen = noise(renderers[there].render(_POSE, time))
        found = _faces([(i, people[i].path(time)) for i in there], rng)
        metres = DepthImage(np.nan_to_num(seen.depth * 1000).astype(np.uint16))
        frame = Frame(
            round((time + 1) * 1e9), SMALL, Picture(seen.picture), metres if depth else None
        )
        sighting = tracker.update(frame.stamp, tracker.locate(frame, list(found)), _POSE)
        result.append(None if sighting is None else found[sighting.candidate])
    return result


@cache
def _surroundings(colourful: bool) -> tuple[dict[str, Thing], SensorNoise]:
    """Return a room, with a pale wall or one of many colours behind the people, and noise."""
    rng = np.random.default_rng(5)
    things = room()
    if colourful:
        front = things["front"]
        assert isinstance(front, Wall)
        things["front"] = replace(front, texture=pattern(rng))
    return things, SensorNoise((SMALL.width, SMALL.height), rng, 4.0, 0.0015, 0.01)


class _Faces(dict[Candidate, int]):
    """Which person each candidate is."""


def _faces(there: Sequence[tuple[int, Vector3]], rng: np.random.Generator) -> _Faces:
    found = _Faces()
    nearest: list[Box] = []
    for index, point in sorted(there, key=lambda item: math.hypot(*item[1])):
        optical = _POSE.inverse() @ point
        pixel = SMALL.pixel(optical)
        if pixel is None:
            continue
        width = SMALL.focal_length() * FACE_WIDTH / math.hypot(*optical)
        u, v = np.array(pixel) + rng.normal(0.0, 0.02 * width, 2)
        box = Box(u - width / 2, v - width / 2, width, width)
        hidden = any(
            math.dist(box.centre, other.centre) < 0.5 * (width + other.width) for other in nearest
        )
        nearest.append(box)
        if not hidden and 0 < u < SMALL.width and 0 < v < SMALL.height:
            found[Candidate(box, box.centre, float(rng.uniform(0.8, 1.0)))] = index
    return found


def at(distance: float, azimuth: float, height: float = 0.75) -> Path:
    """Return the path of somebody who stands still."""
    point = (distance * math.cos(azimuth), distance * math.sin(azimuth), height)
    return lambda time: point


def replaced(seed: int) -> bool:
    """Return whether somebody else gets the number of a person who has left.

    Somebody in other clothes appears 0.2 to 0.6 m beside, 0.1 to 1.8 s later.
    """
    rng = np.random.default_rng(seed)
    first = draw_looks(rng)
    distance, azimuth = rng.uniform(1.2, 2.2), rng.uniform(-0.15, 0.15)
    beside = rng.uniform(0.2, 0.6) * rng.choice((-1, 1))
    end = rng.uniform(1.0, 1.5)
    begin = end + rng.uniform(0.1, 1.8)
    people = [
        Person(first, at(distance, azimuth), [(0.0, end)]),
        Person(
            draw_looks(rng, first),
            at(distance + rng.uniform(-0.1, 0.1), azimuth + beside / distance),
            [(begin, math.inf)],
        ),
    ]
    last = min(end + 1.95, begin + 0.8)  # then the first person is forgotten
    names = followed(people, last, seed, depth=bool(seed % 2))
    assert 0 in names
    return 1 in names


def returned(seed: int) -> bool:
    """Return whether a person who comes back within 1.8 s and 0.3 m is followed again."""
    rng = np.random.default_rng(seed)
    distance, azimuth = rng.uniform(1.2, 2.2), rng.uniform(-0.15, 0.15)
    beside = rng.uniform(-0.3, 0.3)
    end = rng.uniform(1.0, 1.5)
    begin = end + rng.uniform(0.2, 1.5)

    def path(time: float) -> Vector3:
        return at(distance, azimuth + (beside / distance if time >= begin else 0.0))(time)

    names = followed(
        [Person(draw_looks(rng), path, [(0.0, end), (begin, math.inf)])],
        begin + 0.35,
        seed,
        depth=bool(seed % 2),
    )
    return names[-1] == 0


def crossed(seed: int) -> bool:
    """Return whether a person is kept while somebody else walks past, before or behind."""
    rng = np.random.default_rng(seed)
    first = draw_looks(rng)
    distance = rng.uniform(1.4, 2.0)
    other = distance + rng.uniform(0.25, 0.7) * rng.choice((-1, 1))
    speed, side = rng.uniform(0.4, 1.2), rng.choice((-1, 1))
    sway = rng.uniform(0.0, 0.2)
    middle = 1.0 + 0.8 / speed

    def stand(time: float) -> Vector3:
        return at(distance, sway * math.sin(time) / distance)(time)

    def walk(time: float) -> Vector3:
        return at(other, side * speed * (time - middle) / other)(time)

    people = [
        Person(first, stand, [(0.0, math.inf)]),
        Person(draw_looks(rng, first), walk, [(0.6, math.inf)]),
    ]
    names = followed(people, middle + 1.2 / speed, seed, depth=bool(seed % 2))
    return 1 not in names and names[-1] == 0
