"""Draw head.png: the head follows its target."""

from __future__ import annotations

import io
import math
import sys
import time
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import rclpy
import trimesh
import yourdfpy
from geometry_msgs.msg import PointStamped

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from head_tracking.ros.kit.spinning import NodeThreads
from head_tracking.ros.kit.stop_signal import StopSignal
from head_tracking.run.control import Composition, compose
from head_tracking.run.options import parse_arguments
from head_tracking.transforms import RobotModel, TransformException

SECONDS = 14.0
TARGET_COLOUR, HEAD_COLOUR = "#d9480f", "#1864ab"

Samples = dict[str, list[float]]


def record(head: Composition) -> tuple[Samples, dict[str, float], tuple[float, ...]]:
    """Set-points and true joint positions [rad] over time [s]; one moment, and its target."""
    tracker, simulated = head.nodes["head_tracker"], head.simulated
    assert simulated is not None
    seen: list[Any] = []
    node = rclpy.create_node("picture")
    node.create_subscription(PointStamped, "target_point", seen.append, 1)
    samples: Samples = {key: [] for key in ("time", "pan", "tilt", "wanted_pan", "wanted_tilt")}
    moment: dict[str, float] = {}
    target: tuple[float, ...] = ()
    start = time.monotonic()
    while (now := time.monotonic() - start) < SECONDS:
        rclpy.spin_once(node, timeout_sec=0.01)
        if not seen or tracker.interface.control.frames.head is None:
            continue
        message = seen[-1]
        point = (message.point.x, message.point.y, message.point.z)
        try:
            placed = head.buffer.core.transform_point(
                point, tracker.interface.control.frames.head.base_frame, message.header.frame_id
            )
        except TransformException:
            continue
        pan, tilt = (simulated.true_position(f"head_{name}_joint") for name in ("pan", "tilt"))
        gaze = tracker.interface.control.frames.head.gaze(placed, pan, tilt)
        for key, value in zip(samples, (now, pan, tilt, gaze.pan, gaze.tilt), strict=True):
            samples[key].append(value)
        if not moment and now > 3.0 and -0.7 < pan < -0.5:
            moment = {"head_pan_joint": pan, "head_tilt_joint": tilt}
            target = head.buffer.core.transform_point(point, "base_link", message.header.frame_id)
    node.destroy_node()
    return samples, moment, target


def draw_robot(axes: Any, model: RobotModel, positions: dict[str, float], target: Any) -> None:
    """Draw the shapes of the model, the optical axis and the target."""
    robot = yourdfpy.URDF.load(
        io.BytesIO(model.urdf.encode()), build_scene_graph=False, load_meshes=False
    ).robot
    colours = {material.name: material.color.rgba for material in robot.materials}
    for link in robot.links:
        for visual in link.visuals:
            pose = model.transform("base_link", link.name, positions).as_matrix()
            pose = pose @ (np.eye(4) if visual.origin is None else visual.origin)
            triangles = shape(visual.geometry) @ pose[:3, :3].T + pose[:3, 3]
            light = brightness(triangles)
            colour = np.asarray(colours[visual.material.name][:3])
            axes.add_collection3d(
                Poly3DCollection(triangles, facecolors=np.clip(colour * light[:, None], 0, 1))
            )
    camera = model.transform("base_link", "camera_link", positions)
    sight = np.stack([camera.translation, camera.apply((0.45, 0, 0))])
    axes.plot(*sight.T, color=HEAD_COLOUR, linestyle="--")
    axes.scatter(*target, color=TARGET_COLOUR, s=70, depthshade=False)
    axes.set(xlim=(-0.13, 0.52), ylim=(-0.325, 0.325), zlim=(0, 0.65))
    axes.set_box_aspect((1, 1, 1), zoom=1.3)
    axes.view_init(elev=14, azim=-75)
    axes.set_axis_off()


def brightness(triangles: np.ndarray) -> np.ndarray:
    """Return the brightness of each triangle, shape (N,); light from above and in front."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    return 0.72 + 0.28 * normals @ np.array([0.35, -0.55, 0.76])


def shape(geometry: Any) -> np.ndarray:
    """Return the triangles of a box, cylinder or sphere, shape (N, 3, 3) [m]."""
    if geometry.box is not None:
        mesh = trimesh.creation.box(geometry.box.size)
    elif geometry.cylinder is not None:
        cylinder = geometry.cylinder
        mesh = trimesh.creation.cylinder(cylinder.radius, cylinder.length, sections=48)
    else:
        mesh = trimesh.creation.icosphere(3, geometry.sphere.radius)
    return np.asarray(mesh.vertices[mesh.faces])


def draw_head(
    path: Path, model: RobotModel, samples: Samples, moment: dict[str, float], target: Any
) -> None:
    """Draw the picture."""
    figure = plt.figure(figsize=(10, 4.2))
    draw_robot(figure.add_axes((0.0, -0.05, 0.42, 1.1), projection="3d"), model, moment, target)
    for index, joint in enumerate(("pan", "tilt")):
        axes = figure.add_axes((0.47, 0.57 - 0.44 * index, 0.51, 0.36))
        axes.plot(
            samples["time"],
            np.degrees(samples[f"wanted_{joint}"]),
            color=TARGET_COLOUR,
            label="target",
        )
        axes.plot(samples["time"], np.degrees(samples[joint]), color=HEAD_COLOUR, label="head")
        axes.set_ylabel(f"{joint} (degrees)")
        axes.set_xlim(0, SECONDS)
        axes.grid(alpha=0.25)
        axes.spines[["top", "right"]].set_visible(False)
        if index == 0:
            axes.legend(loc="lower right", bbox_to_anchor=(1, 0.98), frameon=False, ncols=2)
            axes.tick_params(labelbottom=False)
        else:
            axes.set_xlabel("time (s)")
    figure.savefig(path, dpi=110)


def main() -> None:
    """Run the simulated head and draw its motion."""
    folder = Path(sys.argv[1])
    plan = parse_arguments(["--sim"])
    rclpy.init(args=plan.ros_arguments)
    with ExitStack() as resources, closing(NodeThreads()) as threads:
        head = compose(plan, threads, resources, StopSignal())
        samples, moment, target = record(head)
        model = head.buffer.core.model
    assert model is not None
    draw_head(folder / "head.png", model, samples, moment, target)
    print(f"drew {folder / 'head.png'}")
    error = max(
        abs(a - b)
        for joint in ("pan", "tilt")
        for t, a, b in zip(samples["time"], samples[joint], samples[f"wanted_{joint}"], strict=True)
        if t > 3
    )
    print(f"largest joint error after 3 s: {math.degrees(error):.1f} degrees")
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
