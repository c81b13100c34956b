"""Render images and depths of a scene without a graphics processor."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from head_tracking.scene.drawings import Texture
from head_tracking.scene.objects import Ball, Board, Panel, Scene, Wall
from head_tracking.transforms import Transform
from head_tracking.vision.camera import Camera
from head_tracking.vision.opencv import cv2

Array: TypeAlias = npt.NDArray[np.float64]

_NEAR = 0.05  # m: minimum depth
_EDGE = 2  # pixels around a texture, for the interpolation at its edge
_LIGHT = np.array([-0.5, 0.35, 0.8]) / np.linalg.norm([-0.5, 0.35, 0.8])


class Rendering(NamedTuple):
    """An image with depths.

    Attributes:
        picture: shape (height, width, 3), blue, green, red.
        depth: z in the optical frame [m], shape (height, width); infinite: no object.
    """

    picture: npt.NDArray[np.uint8]
    depth: npt.NDArray[np.float32]


class Canvas(NamedTuple):
    """Image and depths during rendering.

    Attributes:
        picture: shape (height, width, 4), because copying four bytes is faster than three.
        depth: as in `Rendering`; None: not requested.
    """

    picture: Texture
    depth: npt.NDArray[np.float32] | None


class _Plane(NamedTuple):
    """A flat image in the optical frame: upper left corner and edges [m]."""

    texture: Texture
    corner: Array
    right: Array
    down: Array
    is_wall: bool

    @classmethod
    def of(cls, thing: Board | Panel, T_optical_scene: Transform, time: float) -> _Plane:
        """Return the plane of a thing at a time [s]."""
        texture = thing.image(time)
        corner, right, down = T_optical_scene.apply_many(_corners(thing, texture, time))
        return cls(texture, corner, right - corner, down - corner, isinstance(thing, Wall))

    def distance(self) -> float:
        """Return the distance of the farthest corner [m]: objects on the plane are drawn later."""
        sides = (self.right * i + self.down * j for i in (0, 1) for j in (0, 1))
        return max(float(np.linalg.norm(self.corner + side)) for side in sides)


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
        T_optical_scene = T_scene_optical.inverse()
        drawn: list[tuple[float, Ball | _Plane]] = []
        walls = []
        for thing in self.scene.things.values():
            if isinstance(thing, Ball):
                middle = np.array(T_optical_scene @ thing.path(time))
                drawn.append((float(np.linalg.norm(middle)), thing))
                continue
            plane = _Plane.of(thing, T_optical_scene, time)
            if plane.is_wall:
                walls.append(plane)
            else:
                drawn.append((plane.distance(), plane))
        canvas = Canvas(np.full((*shape, 4), 120, np.uint8), self._room(walls) if depth else None)
        for wall in walls:
            self._draw_plane(canvas, wall)
        for _, item in sorted(drawn, key=lambda one: -one[0]):
            if isinstance(item, Ball):
                self._draw_ball(canvas, item, T_scene_optical, time)
            else:
                self._draw_plane(canvas, item)
        picture = np.asarray(cv2.cvtColor(canvas.picture, cv2.COLOR_BGRA2BGR))
        none = np.empty((0, 0), np.float32)
        return Rendering(picture, none if canvas.depth is None else canvas.depth)

    def _room(self, walls: list[_Plane]) -> npt.NDArray[np.float32]:
        """Return the depths of the walls; in a convex room, the nearest plane is visible."""
        nearest = np.zeros((self.camera.height, self.camera.width), np.float32)
        for wall in walls:
            np.maximum(nearest, self._inverse_depth(wall), out=nearest)
        with np.errstate(divide="ignore"):
            return np.divide(1.0, nearest, out=nearest)

    def _inverse_depth(
        self, plane: _Plane, rows: slice = slice(None), columns: slice = slice(None)
    ) -> npt.NDArray[np.float32]:
        """Return the inverse depths of a plane in a part of the image [1/m]."""
        (a, b, c), (d, e, f), (px, py, pz) = plane.right, plane.down, plane.corner
        normal = b * f - c * e, c * d - a * f, a * e - b * d
        away = normal[0] * px + normal[1] * py + normal[2] * pz
        if abs(away) < 1e-9:  # seen edge on
            return np.zeros((1, 1), np.float32)
        x, y, z = (part / away for part in normal)
        camera = self.camera
        across = (self._u[columns] - np.float32(camera.cx)) * np.float32(x / camera.fx)
        down = (self._v[rows] - np.float32(camera.cy)) * np.float32(y / camera.fy)
        return across + (down + np.float32(z))

    def _draw_plane(self, canvas: Canvas, plane: _Plane) -> None:
        """Draw a plane; the depths of walls are set before."""
        outline = self._outline(plane.corner, plane.right, plane.down)
        if outline is None:
            return
        rows, columns = _bounds(outline, canvas.picture.shape)
        if rows.stop <= rows.start or columns.stop <= columns.start:
            return
        c, offset = self.camera, np.array([columns.start, rows.start], np.float64)
        inside = np.zeros((rows.stop - rows.start, columns.stop - columns.start), np.uint8)
        edge = np.round(outline - offset).astype(np.int32)
        cv2.fillConvexPoly(inside, edge, 255)
        if plane.is_wall:  # avoid gaps between neighbouring walls
            cv2.polylines(inside, [edge], True, 255, 3)
        texture = self._fitting(plane)
        height, width = (size - 2 * _EDGE for size in texture.shape[:2])
        # from texture pixels to image pixels of the drawn part
        to_image = c.matrix @ np.column_stack(
            (plane.right / width, plane.down / height, plane.corner)
        )
        to_image = np.array([[1, 0, -offset[0]], [0, 1, -offset[1]], [0, 0, 1.0]]) @ to_image
        half = np.array([[1, 0, 0.5 - _EDGE], [0, 1, 0.5 - _EDGE], [0, 0, 1.0]])
        seen = cv2.warpPerspective(texture, to_image @ half, inside.shape[::-1])
        if plane.is_wall:
            whole = cv2.compare(cv2.min(inside, seen[..., 3]), 255, cv2.CMP_EQ)
            cv2.copyTo(seen, whole, canvas.picture[rows, columns])
            return
        _blend(canvas.picture[rows, columns], cv2.copyTo(seen, inside))
        if canvas.depth is not None:
            solid = (inside > 0) & (seen[..., 3] > 127)
            inverse = self._inverse_depth(plane, rows, columns)
            np.divide(1.0, inverse, out=canvas.depth[rows, columns], where=solid & (inverse > 0))

    def _fitting(self, plane: _Plane) -> Texture:
        """Return the smallest copy of a texture that is not coarser than the image."""
        # keeping the texture keeps its id unique
        _, sizes = self._sizes.get(id(plane.texture), (None, []))
        if not sizes:
            sizes = _sizes(plane.texture)
            self._sizes[id(plane.texture)] = plane.texture, sizes
        ends = [plane.corner, plane.corner + plane.right, plane.corner + plane.down]
        nearest = max(_NEAR, min(float(end[2]) for end in ends))
        pixels = float(np.linalg.norm(plane.right)) * self.camera.fx / nearest
        return next((t for t in reversed(sizes) if t.shape[1] >= 0.8 * pixels), sizes[0])

    def _outline(self, corner: Array, right: Array, down: Array) -> Array | None:
        """Return the visible outline of a plane, shape (N, 2) [pixels]; None: not visible."""
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
        # a box around the ball at its nearest depth contains its image
        radius = ball.radius * away / np.sqrt(away**2 - ball.radius**2) * 1.3
        low, high = middle - radius, middle + radius
        z = middle[2] - ball.radius
        edges = np.array([[low[0], low[1]], [high[0], high[1]]]) / min(z, middle[2])
        outline = np.vstack((edges, (middle[:2] - radius) / (middle[2] + ball.radius)))
        outline = np.vstack((outline, (middle[:2] + radius) / (middle[2] + ball.radius)))
        rows, columns = _bounds(outline * [c.fx, c.fy] + [c.cx, c.cy], canvas.picture.shape)
        if rows.stop <= rows.start or columns.stop <= columns.start:
            return
        x = (np.arange(columns.start, columns.stop) - c.cx) / c.fx
        y = (np.arange(rows.start, rows.stop) - c.cy) / c.fy
        rays = np.dstack((*np.meshgrid(x, y), np.ones((len(y), len(x)))))
        squared = (rays**2).sum(axis=2)
        along = rays @ middle
        root = along**2 - squared * (away**2 - ball.radius**2)
        depth = (along - np.sqrt(np.maximum(root, 0.0))) / squared
        normals = (rays * depth[..., None] - middle) / ball.radius
        light = T_scene_optical.rotation.inverse().apply(_LIGHT.tolist())
        shade = 0.65 + 0.35 * np.clip(normals @ np.array(light), 0.0, 1.0)
        seen = np.full((*depth.shape, 4), 255, np.uint8)
        seen[..., :3] = np.clip(shade[..., None] * np.array(ball.colour), 0, 255)
        # coverage of the pixels at the edge
        width = np.sqrt(np.maximum(away**2 * squared - along**2, 0.0) / squared)
        pixel = middle[2] / c.focal_length()
        seen[..., 3] = np.clip((ball.radius - width) / pixel * 255 + 127, 0, 255)
        _blend(canvas.picture[rows, columns], _premultiplied(seen))
        if canvas.depth is not None:
            np.copyto(canvas.depth[rows, columns], depth, where=root > 0, casting="same_kind")


def _corners(thing: Board | Panel, texture: Texture, time: float) -> list[Array]:
    """Return upper left, upper right and lower left corner [m]."""
    if isinstance(thing, Panel):
        corner, right, down = map(np.array, (thing.corner, thing.right, thing.down))
        return [corner, corner + right, corner + down]
    position = np.array(thing.path(time))
    outwards = np.array([position[0], position[1], 0.0])
    outwards /= max(float(np.linalg.norm(outwards)), 1e-9)
    right = np.cross(outwards, [0.0, 0.0, 1.0]) * thing.width
    down = np.array([0.0, 0.0, -thing.width * texture.shape[0] / texture.shape[1]])
    corner = position - right * thing.anchor[0] - down * thing.anchor[1]
    return [corner, corner + right, corner + down]


def _bounds(outline: Array, shape: tuple[int, ...]) -> tuple[slice, slice]:
    left, top = np.floor(outline.min(axis=0)).astype(int) - 1
    right, bottom = np.ceil(outline.max(axis=0)).astype(int) + 2
    return (
        slice(min(max(top, 0), shape[0]), min(max(bottom, 0), shape[0])),
        slice(min(max(left, 0), shape[1]), min(max(right, 0), shape[1])),
    )


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


def _sizes(texture: Texture) -> list[Texture]:
    """Return a texture and reduced copies, with premultiplied alpha and an edge."""
    copies = [_premultiplied(texture)]
    while min(copies[-1].shape[:2]) >= 8:
        height, width = copies[-1].shape[:2]
        half = cv2.resize(copies[-1], (width // 2, height // 2), interpolation=cv2.INTER_AREA)
        copies.append(np.asarray(half))
    return [cv2.copyMakeBorder(copy, *[_EDGE] * 4, cv2.BORDER_REPLICATE) for copy in copies]
