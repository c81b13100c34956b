"""Pictures and depths of a scene, by the processor alone."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from head_tracking.scene.drawings import Texture
from head_tracking.scene.objects import Ball, Board, Scene, Wall
from head_tracking.transforms import Transform
from head_tracking.vision.camera import Camera
from head_tracking.vision.opencv import cv2

Array: TypeAlias = npt.NDArray[np.float64]

_NEAR = 0.05  # m: what is closer is not drawn
_LIGHT = np.array([-0.5, 0.35, 0.8]) / np.linalg.norm([-0.5, 0.35, 0.8])


class Rendering(NamedTuple):
    """What a camera sees.

    Attributes:
        picture: shape (height, width, 3), blue, green, red.
        depth: z in the optical frame [m], shape (height, width); infinite where nothing is.
    """

    picture: npt.NDArray[np.uint8]
    depth: npt.NDArray[np.float32]


class Canvas(NamedTuple):
    """A picture under way.

    Attributes:
        picture: shape (height, width, 4): with alpha, because four bytes are copied faster.
        depth: as in `Rendering`.
    """

    picture: Texture
    depth: npt.NDArray[np.float32]


class Renderer:
    """Draws a scene for one camera. Keeps smaller copies of the textures, for sharp pictures."""

    def __init__(self, scene: Scene, camera: Camera) -> None:
        self.scene = scene
        self.camera = camera
        self._sizes = {
            name: _pyramid(thing.texture)
            for name, thing in scene.things.items()
            if isinstance(thing, Board | Wall)
        }

    def render(self, T_scene_optical: Transform, time: float) -> Rendering:
        """What is seen from a pose of the camera's optical frame at a time [s]."""
        shape = (self.camera.height, self.camera.width)
        canvas = Canvas(np.full((*shape, 4), 120, np.uint8), np.full(shape, np.inf, np.float32))
        T_optical_scene = T_scene_optical.inverse()
        for name, thing in self.scene.things.items():
            if isinstance(thing, Ball):
                self._draw_ball(canvas, thing, T_scene_optical, time)
            else:
                corners = _corners(thing, time)
                corner, right, down = T_optical_scene.apply_many(corners)
                self._draw_plane(canvas, self._sizes[name], corner, right - corner, down - corner)
        return Rendering(np.asarray(cv2.cvtColor(canvas.picture, cv2.COLOR_BGRA2BGR)), canvas.depth)

    def _draw_plane(
        self, canvas: Canvas, sizes: list[Texture], corner: Array, right: Array, down: Array
    ) -> None:
        outline = self._outline(corner, right, down)
        if outline is None:
            return
        rows, columns = _bounds(outline, canvas.depth.shape)
        if rows.stop <= rows.start or columns.stop <= columns.start:
            return
        normal = np.cross(right, down)
        away = float(normal @ corner)
        if abs(away) < 1e-9:
            return  # seen edge on
        c = self.camera
        u = np.arange(columns.start, columns.stop, dtype=np.float32)
        v = np.arange(rows.start, rows.stop, dtype=np.float32)
        inverse = (
            (normal[0] / away) * (u - c.cx) / c.fx
            + ((normal[1] / away) * (v - c.cy) / c.fy + normal[2] / away)[:, None]
        ).astype(np.float32)
        inside = np.zeros(inverse.shape, np.uint8)
        offset = np.array([columns.start, rows.start], np.float64)
        cv2.fillConvexPoly(inside, np.round(outline - offset).astype(np.int32), 1)
        depth = canvas.depth[rows, columns]
        visible = (inside > 0) & (inverse * depth > 1.0)
        if not visible.any():
            return
        texture = _fitting(sizes, float(np.linalg.norm(right)) * c.fx * float(inverse.max()))
        height, width = texture.shape[:2]
        # takes texture pixels to image pixels of the part that is drawn
        to_image = c.matrix @ np.column_stack((right / width, down / height, corner))
        to_image = np.array([[1, 0, -offset[0]], [0, 1, -offset[1]], [0, 0, 1.0]]) @ to_image
        half = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1.0]])
        seen = cv2.warpPerspective(
            texture, to_image @ half, inside.shape[::-1], borderMode=cv2.BORDER_REPLICATE
        )
        _blend(canvas.picture[rows, columns], seen, visible)
        visible &= seen[..., 3] > 127
        np.divide(1.0, inverse, out=depth, where=visible)

    def _outline(self, corner: Array, right: Array, down: Array) -> Array | None:
        """The plane's edge in the image, shape (N, 2), without what is behind the camera."""
        points = [corner, corner + right, corner + right + down, corner + down]
        kept: list[Array] = []
        for here, there in zip(points, points[1:] + points[:1], strict=True):
            if here[2] >= _NEAR:
                kept.append(here)
            if (here[2] >= _NEAR) != (there[2] >= _NEAR):
                share = (_NEAR - here[2]) / (there[2] - here[2])
                kept.append(here + share * (there - here))
        if len(kept) < 3:
            return None
        x, y, z = np.array(kept).T
        c = self.camera
        outline = np.column_stack((c.fx * x / z + c.cx, c.fy * y / z + c.cy))
        return np.asarray(np.clip(outline, -1e5, 1e5))

    def _draw_ball(
        self, canvas: Canvas, ball: Ball, T_scene_optical: Transform, time: float
    ) -> None:
        middle = np.array(T_scene_optical.inverse() @ ball.path(time))
        away = float(np.linalg.norm(middle))
        if middle[2] - ball.radius < _NEAR:
            return
        c = self.camera
        # the box around the ball at its nearest depth holds all of it
        radius = ball.radius * away / np.sqrt(away**2 - ball.radius**2) * 1.3
        low, high = middle - radius, middle + radius
        z = middle[2] - ball.radius
        edges = np.array([[low[0], low[1]], [high[0], high[1]]]) / min(z, middle[2])
        outline = np.vstack((edges, (middle[:2] - radius) / (middle[2] + ball.radius)))
        outline = np.vstack((outline, (middle[:2] + radius) / (middle[2] + ball.radius)))
        rows, columns = _bounds(outline * [c.fx, c.fy] + [c.cx, c.cy], canvas.depth.shape)
        if rows.stop <= rows.start or columns.stop <= columns.start:
            return
        x = (np.arange(columns.start, columns.stop) - c.cx) / c.fx
        y = (np.arange(rows.start, rows.stop) - c.cy) / c.fy
        rays = np.dstack((*np.meshgrid(x, y), np.ones((len(y), len(x)))))
        squared = (rays**2).sum(axis=2)
        along = rays @ middle
        root = along**2 - squared * (away**2 - ball.radius**2)
        depth = (along - np.sqrt(np.maximum(root, 0.0))) / squared
        before = canvas.depth[rows, columns]
        visible = (root > 0) & (depth < before)
        normals = (rays * depth[..., None] - middle) / ball.radius
        light = T_scene_optical.rotation.inverse().apply(_LIGHT.tolist())
        shade = 0.65 + 0.35 * np.clip(normals @ np.array(light), 0.0, 1.0)
        seen = np.full((*depth.shape, 4), 255, np.uint8)
        seen[..., :3] = np.clip(shade[..., None] * np.array(ball.colour), 0, 255)
        # the share of a pixel at the edge that the ball covers
        width = np.sqrt(np.maximum(away**2 * squared - along**2, 0.0) / squared)
        pixel = middle[2] / c.focal_length()
        seen[..., 3] = np.clip((ball.radius - width) / pixel * 255 + 127, 0, 255)
        _blend(canvas.picture[rows, columns], seen, visible)
        before[visible] = depth[visible]


def _corners(thing: Board | Wall, time: float) -> list[Array]:
    """Upper left, upper right and lower left corner [m]."""
    if isinstance(thing, Wall):
        corner, right, down = map(np.array, (thing.corner, thing.right, thing.down))
        return [corner, corner + right, corner + down]
    position = np.array(thing.path(time))
    outwards = np.array([position[0], position[1], 0.0])
    outwards /= max(float(np.linalg.norm(outwards)), 1e-9)
    right = np.cross(outwards, [0.0, 0.0, 1.0]) * thing.width
    down = np.array([0.0, 0.0, -thing.height])
    corner = position - right * thing.anchor[0] - down * thing.anchor[1]
    return [corner, corner + right, corner + down]


def _bounds(outline: Array, shape: tuple[int, ...]) -> tuple[slice, slice]:
    left, top = np.floor(outline.min(axis=0)).astype(int) - 1
    right, bottom = np.ceil(outline.max(axis=0)).astype(int) + 2
    return (
        slice(min(max(top, 0), shape[0]), min(max(bottom, 0), shape[0])),
        slice(min(max(left, 0), shape[1]), min(max(right, 0), shape[1])),
    )


def _blend(picture: Texture, seen: Texture, visible: npt.NDArray[np.bool_]) -> None:
    if seen[..., 3].min() < 255:
        alpha = seen[..., 3:].astype(np.float32) / 255
        seen = (picture + (seen.astype(np.float32) - picture) * alpha).astype(np.uint8)
    cv2.copyTo(seen, visible.view(np.uint8), picture)


def _pyramid(texture: Texture) -> list[Texture]:
    return list(_halved(texture))


def _halved(texture: Texture) -> Iterator[Texture]:
    while min(texture.shape[:2]) >= 4:
        yield texture
        alpha = texture[..., 3:].astype(np.float32) / 255
        colours = cv2.pyrDown(texture[..., :3] * alpha)
        weight = cv2.pyrDown(alpha)
        texture = np.dstack(
            (
                np.clip(colours / np.maximum(weight, 1e-3)[..., None], 0, 255),
                weight * 255,
            )
        ).astype(np.uint8)


def _fitting(sizes: list[Texture], pixels: float) -> Texture:
    """The smallest copy that is not coarser than the image."""
    return next((t for t in reversed(sizes) if t.shape[1] >= 0.8 * pixels), sizes[0])
