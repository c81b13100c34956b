"""What a detector found in one image."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from head_tracking.transforms import Vector3
from head_tracking.vision.camera import Box, Camera
from head_tracking.vision.images import DepthImage, Picture

Mask: TypeAlias = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Frame:
    """One image and what belongs to it.

    Attributes:
        stamp: when it was taken [ns].
        camera: what took it.
        picture: its colours; None where only depths are looked at.
        depth: aligned depths; None where there are none.
    """

    stamp: int
    camera: Camera
    picture: Picture | None = None
    depth: DepthImage | None = None


@dataclass(frozen=True, slots=True)
class Candidate:
    """One thing that may be the target.

    Attributes:
        box: around it.
        centre: column and row of its middle.
        confidence: how sure the detector is, 0 to 1.
        label: what it is, if there are different ones, such as a marker's number.
        unique: the label is the name of one thing, wherever it is.
        mask: which pixels of the box belong to it; None: an ellipse that fills most of it.
        position: where it is in the optical frame [m], if the detector knows.
        points: columns and rows to show, such as corners and features, shape (N, 2).
    """

    box: Box
    centre: tuple[float, float]
    confidence: float
    label: str = ""
    unique: bool = False
    mask: Mask | None = None
    position: Vector3 | None = None
    points: npt.NDArray[np.float32] = field(
        default_factory=lambda: np.zeros((0, 2), np.float32), compare=False
    )


class Detector(Protocol):
    """Finds things of one kind; may remember where they were."""

    @property
    def parameters(self) -> Any:
        """How it looks; may change on the way."""

    @parameters.setter
    def parameters(self, value: Any) -> None: ...

    def detect(self, frame: Frame, hints: Sequence[Box]) -> list[Candidate]:
        """All things of the kind.

        Args:
            frame: where to look.
            hints: where things that are followed should be now.
        """

    def select(self, frame: Frame, box: Box) -> None:
        """A person shows what to follow."""

    def reset(self) -> None:
        """Forgets what was selected."""


class GivenDetector:
    """Passes on what another program has found.

    Attributes:
        candidates: of the next frame.
    """

    def __init__(self, parameters: Any = None) -> None:
        self.parameters = parameters
        self.candidates: list[Candidate] = []

    def detect(self, frame: Frame, hints: Sequence[Box]) -> list[Candidate]:
        """What was found in it."""
        return self.candidates

    def select(self, frame: Frame, box: Box) -> None:
        """The other program does not choose."""

    def reset(self) -> None:
        """Remembers nothing."""


def ellipse_mask(height: int, width: int, fill: float = 0.7) -> Mask:
    """The pixels of an ellipse in the middle of a box.

    Args:
        height: of the box in pixels.
        width: of the box in pixels.
        fill: its axes as a share of the box.
    """
    v = (np.arange(height) + 0.5) / height * 2 - 1
    u = (np.arange(width) + 0.5) / width * 2 - 1
    return np.asarray(u * u + (v * v)[:, None] <= fill * fill)
