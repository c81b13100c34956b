"""Render images and depths of a scene without a graphics processor."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from head_tracking.scene.drawings import Texture
from head_tracking.scene.objects import Ball, Panel, Scene, Thing, Wall
from head_tracking.transforms import Transform, Vector3
from head_tracking.vision.camera import Camera
from head_tracking.vision.opencv import cv2

Array: TypeAlias = npt.NDArray[np.float64]

_NEAR = 0.05  # m: minimum depth
_FARTHEST = np.float32(1e-6)  # 1/m: least inverse depth
_EDGE_ON = 1e-3  # cubic metres times square pixels: least volume of a plane and its distance
_EDGE = 1  # pixels around a texture, for the interpolation at its edge


class Rendering(NamedTuple):
    """An image with depths.

    Attributes:
        picture: shape (height, width, 3), blue, green, red.
        depth: z in the optical frame [m], shape (height, width); infinite: no object.
    """

    picture: npt.NDArray[np.uint8]
    depth: npt.NDArray[np.float32]


class _Plane(NamedTuple):
    """A flat image in the optical frame.

    Attributes:
        thing: what it shows.
        texture: the image.
        corners: clockwise from the upper left one, shape (4, 3) [m].
    """

    thing: Thing
    texture: Texture
    corners: Array


class Renderer:
    """Renders a scene for one camera, from far to near."""

    def __init__(self, scene: Scene, camera: Camera) -> None:
        self.scene = scene
        self.camera = camera
        self._sizes: dict[int, tuple[Texture, list[Texture]]] = {}
        self._u = np.arange(camera.width, dtype=np.float32)
        self._v = np.arange(camera.height, dtype=np.float32)[:, None]

    def render(self, T_scene_optical: Transform, time: float, *, depth: bool = True) -> Rendering:
        """Return image and depths.

        Args:
            T_scene_optical: pose of the camera.
            time: [s].
            depth: whether to compute depths; otherwise their array is empty.
        """
        shape = (self.camera.height, self.camera.width)
        nearness = np.zeros(shape, np.float32) if depth else None  # inverse depths [1/m]
        canvas = np.full((*shape, 4), 120, np.uint8)  # copying four bytes is faster than three
        for plane in sorted(self._planes(T_scene_optical, time), key=_order):
            self._draw_plane(canvas, nearness, plane)
        picture = np.asarray(cv2.cvtColor(canvas, cv2.COLOR_BGRA2BGR))
        if nearness is None:
            return Rendering(picture, np.empty((0, 0), np.float32))
        with np.errstate(divide="ignore"):
            return Rendering(picture, np.reciprocal(nearness))

    def _planes(self, T_scene_optical: Transform, time: float) -> list[_Plane]:
        """Return all things as flat images at a time [s]."""
        things = list(self.scene.values())
        textures = [thing.image(time) for thing in things]
        corners = [
            _corners(thing, texture, time, T_scene_optical.translation)
            for thing, texture in zip(things, textures, strict=True)
        ]
        points = np.reshape(corners, (-1, 3))
        seen = T_scene_optical.inverse().apply_many(points).reshape(-1, 4, 3)
        return list(map(_Plane, things, textures, seen))

    def _inverse(self, plane: _Plane) -> Array | None:
        """Return the matrix from image pixels to a plane; None: it is seen edge on.

        The matrix times (u, v, 1) is (i, j, 1) / z: the point corner + i right + j down, and its
        inverse depth [1/m].
        """
        corner, end, _, below = plane.corners
        to_image = self.camera.matrix @ np.column_stack((end - corner, below - corner, corner))
        if abs(np.linalg.det(to_image)) < _EDGE_ON:
            return None
        return np.asarray(np.linalg.inv(to_image))

    def _linear(
        self, row: Array, rows: slice = slice(None), columns: slice = slice(None)
    ) -> npt.NDArray[np.float32]:
        """Return a row of such a matrix times (u, v, 1) for a part of the image."""
        a, b, c = row.astype(np.float32)
        return np.asarray(a * self._u[columns] + (b * self._v[rows] + c))

    def _draw_plane(
        self, canvas: Texture, inverse_depths: npt.NDArray[np.float32] | None, plane: _Plane
    ) -> None:
        """Draw a plane. In a convex room, the nearest wall is visible."""
        outline = self._outline(plane)
        if outline is None:
            return
        rows, columns = _bounds(outline, canvas.shape)
        if rows.stop <= rows.start or columns.stop <= columns.start:
            return
        inverse = self._inverse(plane)
        if inverse is None:
            return
        texture = self._fitting(plane)
        # a point behind the camera is outside any texture
        nearness = np.maximum(self._linear(inverse[2], rows, columns), _FARTHEST)
        depth = np.reciprocal(nearness)
        height, width = (size - 2 * _EDGE for size in texture.shape[:2])
        middle = (_EDGE - 0.5) * inverse[2]
        x = depth * self._linear(width * inverse[0] + middle, rows, columns)
        y = depth * self._linear(height * inverse[1] + middle, rows, columns)
        part = canvas[rows, columns]
        near = None if inverse_depths is None else inverse_depths[rows, columns]
        if isinstance(plane.thing, Wall):
            cv2.remap(texture, x, y, cv2.INTER_LINEAR, part, cv2.BORDER_TRANSPARENT)
            if near is not None:
                np.maximum(near, nearness, out=near)
            return
        seen = cv2.remap(texture, x, y, cv2.INTER_LINEAR)
        _blend(part, seen)
        if near is not None:
            np.copyto(near, nearness, where=seen[..., 3] > 127)

    def _fitting(self, plane: _Plane) -> Texture:
        """Return the smallest copy of a texture that is not coarser than the image."""
        # keeping the texture keeps its id unique
        _, sizes = self._sizes.get(id(plane.texture), (None, []))
        if not sizes:
            # neighbouring panels leave no gap; the edge of a board is smooth
            is_panel = isinstance(plane.thing, Panel)
            edge = cv2.BORDER_REPLICATE if is_panel else cv2.BORDER_CONSTANT
            sizes = _sizes(plane.texture, edge)
            self._sizes[id(plane.texture)] = plane.texture, sizes
        nearest = max(_NEAR, float(plane.corners[:, 2].min()))
        pixels = math.dist(*plane.corners[:2].tolist()) * self.camera.fx / nearest
        return next((t for t in reversed(sizes) if t.shape[1] >= 0.8 * pixels), sizes[0])

    def _outline(self, plane: _Plane) -> list[tuple[float, float]] | None:
        """Return the visible outline of a plane [pixels]; None: not visible."""
        points = plane.corners.tolist()
        kept: list[tuple[float, float, float]] = []
        for here, there in zip(points, points[1:] + points[:1], strict=True):
            if here[2] >= _NEAR:
                kept.append(here)
            if (here[2] >= _NEAR) != (there[2] >= _NEAR):
                share = (_NEAR - here[2]) / (there[2] - here[2])
                kept.append(tuple(a + share * (b - a) for a, b in zip(here, there, strict=True)))
        c = self.camera
        return [(c.fx * x / z + c.cx, c.fy * y / z + c.cy) for x, y, z in kept] or None


def _order(plane: _Plane) -> tuple[bool, float]:
    """Order walls first, then by the farthest corner: objects on a plane are drawn after it."""
    return not isinstance(plane.thing, Wall), -float(np.square(plane.corners).sum(axis=1).max())


def _corners(thing: Thing, texture: Texture, time: float, camera: Vector3) -> Array:
    """Return the corners of a thing's image, clockwise from the upper left one, shape (4, 3) [m].

    A ball looks like a disc at its nearest point, with the same outline.
    """
    if isinstance(thing, Panel):
        corner, right, down = map(np.array, (thing.corner, thing.right, thing.down))
    elif isinstance(thing, Ball):
        sight = np.subtract(thing.path(time), camera)
        away = max(float(np.linalg.norm(sight)), thing.radius + _NEAR / 2)
        ahead = sight / away
        half = (away - thing.radius) * thing.radius / math.sqrt(away**2 - thing.radius**2)
        right = np.array((ahead[1], -ahead[0], 0.0)) / max(math.hypot(*ahead[:2]), 1e-9)
        right, down = 2.0 * half * right, 2.0 * half * np.cross(ahead, right)
        corner = camera + (away - thing.radius) * ahead - (right + down) / 2.0
    else:
        x, y, z = thing.path(time)
        away = max(math.hypot(x, y), 1e-9)
        right = np.array((thing.width * y / away, -thing.width * x / away, 0.0))
        down = np.array((0.0, 0.0, -thing.width * texture.shape[0] / texture.shape[1]))
        aside, above = thing.anchor
        corner = np.array((x, y, z)) - aside * right - above * down
    return np.array((corner, corner + right, corner + right + down, corner + down))


def _bounds(outline: Sequence[tuple[float, float]], shape: tuple[int, ...]) -> tuple[slice, slice]:
    """Return the rows and columns of the pixels around an outline in an image."""
    return _range([v for _, v in outline], shape[0]), _range([u for u, _ in outline], shape[1])


def _range(places: Sequence[float], size: int) -> slice:
    first, last = math.floor(min(places)) - 1, math.ceil(max(places)) + 2
    return slice(min(max(first, 0), size), min(max(last, 0), size))


def _blend(picture: Texture, seen: Texture) -> None:
    """Draw an image with premultiplied alpha over another."""
    through = cv2.cvtColor(255 - seen[..., 3], cv2.COLOR_GRAY2BGRA)
    cv2.add(cv2.multiply(picture, through, scale=1 / 255), seen, dst=picture)


def _premultiplied(texture: Texture) -> Texture:
    """Return an image with its colours multiplied by its alpha."""
    if texture[..., 3].min() == 255:
        return texture
    alpha = texture[..., 3]
    factors = cv2.merge([alpha, alpha, alpha, np.full_like(alpha, 255)])
    return np.asarray(cv2.multiply(texture, factors, scale=1 / 255))


def _sizes(texture: Texture, edge: int) -> list[Texture]:
    """Return a texture and reduced copies, with premultiplied alpha and a kind of edge."""
    copies = [_premultiplied(texture)]
    while min(copies[-1].shape[:2]) >= 8:
        height, width = copies[-1].shape[:2]
        half = cv2.resize(copies[-1], (width // 2, height // 2), interpolation=cv2.INTER_AREA)
        copies.append(np.asarray(half))
    return [cv2.copyMakeBorder(copy, *[_EDGE] * 4, edge) for copy in copies]
