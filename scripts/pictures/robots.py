"""Draw robots.png: every robot that comes with the package, on one sheet."""

import sys
from pathlib import Path

import cv2
import numpy as np
import trimesh

from head_tracking.page.robot_shapes import RobotForBrowser
from head_tracking.share import robot_file, robot_names
from head_tracking.transforms import Rotation, Transform, load_robot_model

COLUMNS, WIDTH, HEIGHT, FINER = 6, 170, 190, 3
"""Robots in a row; size of a robot [pixels]; subpixels in a pixel."""
LIGHT = np.array([0.35, -0.55, 0.76])


def view(azimuth: float, elevation: float) -> np.ndarray:
    """Return the rotation into x to the right, y up, z towards the viewer; angles [degrees]."""
    a, e = np.radians([azimuth, elevation])
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    towards = np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])
    return np.stack([right, np.cross(towards, right), towards])


def mesh(kind: str, size: list[float]) -> trimesh.Trimesh:
    """Return a box, cylinder or sphere as small triangles [m]."""
    if kind == "box":
        solid = trimesh.creation.box(size)
    elif kind == "cylinder":
        solid = trimesh.creation.cylinder(*size)
    else:
        solid = trimesh.creation.icosphere(3, *size)
    return solid.subdivide_to_size(0.007, max_iter=20)


def triangles(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return corners in base_link (N, 3, 3) [m] and shaded colours (N, 3) of a robot's shapes."""
    model = load_robot_model(robot_file(name))
    straight = dict.fromkeys(model.joints, 0.0)
    corners, colours = [], []
    for shape in RobotForBrowser(model, None, "").about["shapes"]:
        x, y, z, *turn = shape["place"]
        pose = model.transform("base_link", shape["link"], straight)
        solid = mesh(shape["kind"], shape["size"])
        solid.apply_transform((pose @ Transform((x, y, z), Rotation(*turn))).as_matrix())
        rgb = 0.2 + 0.8 * np.array(shape["rgba"][:3])
        corners.append(solid.triangles)
        colours.append(rgb * (0.72 + 0.28 * solid.face_normals @ LIGHT)[:, None])
    return np.concatenate(corners), np.clip(np.concatenate(colours), 0, 1)


def picture(name: str) -> np.ndarray:
    """Return a robot with its name, seen from its left front; BGR, (HEIGHT, WIDTH, 3)."""
    corners, colours = triangles(name)
    seen = corners @ view(-40.0, 18.0).T
    low, high = (edge(seen[..., :2], axis=(0, 1)) for edge in (np.min, np.max))
    scale = FINER * min((WIDTH - 24) / (high[0] - low[0]), (HEIGHT - 44) / (high[1] - low[1]))
    flat = (seen[..., :2] - (low + high) / 2) * (scale, -scale)
    flat += FINER * np.array([WIDTH / 2, (HEIGHT - 20) / 2])
    image = np.full((HEIGHT * FINER, WIDTH * FINER, 3), 255, np.uint8)
    for index in np.argsort(seen[..., 2].mean(axis=1)):
        corner = np.round(flat[index]).astype(np.int32)
        cv2.fillConvexPoly(image, corner, (255 * colours[index, ::-1]).tolist())
    image = cv2.resize(image, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
    (width, _), _ = cv2.getTextSize(name, cv2.FONT_HERSHEY_SIMPLEX, 0.45, 1)
    where = ((WIDTH - width) // 2, HEIGHT - 8)
    cv2.putText(image, name, where, cv2.FONT_HERSHEY_SIMPLEX, 0.45, (60, 60, 60), 1, cv2.LINE_AA)
    return image


def main() -> None:
    """Draw the sheet into the folder of the command line."""
    pictures = [picture(name) for name in robot_names()]
    pictures += [np.full_like(pictures[0], 255)] * (-len(pictures) % COLUMNS)
    rows = [np.hstack(pictures[i : i + COLUMNS]) for i in range(0, len(pictures), COLUMNS)]
    path = Path(sys.argv[1], "robots.png")
    cv2.imwrite(str(path), np.vstack(rows), [cv2.IMWRITE_PNG_COMPRESSION, 9])
    print(f"drew {path}")


if __name__ == "__main__":
    main()
