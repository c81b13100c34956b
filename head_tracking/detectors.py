"""The detectors of objects in images, by name: data only, without NumPy and OpenCV."""

from __future__ import annotations

from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any, Final, NamedTuple

if TYPE_CHECKING:
    from head_tracking.vision import Detector


class DetectorSpec(NamedTuple):
    """A detector.

    Attributes:
        path: its class, as `module:class`.
        target: its name for `--target`.
        scene: the scene in which a simulated camera shows such an object.
        needs_selection: whether it detects only what a user has selected.
    """

    path: str
    target: str
    scene: str
    needs_selection: bool = False

    def load(self) -> type[Detector]:
        """Import the class."""
        loaded: type[Detector] = resolve_name(self.path)
        return loaded

    def make(self, parameters: Any = None) -> Detector:
        """Make a detector with an object of its `Parameters`; None: the defaults."""
        made = self.load()
        return made(made.Parameters() if parameters is None else parameters)


_VISION = "head_tracking.vision"
DETECTORS: Final = {
    "face": DetectorSpec(f"{_VISION}.faces:FaceDetector", "face", "faces"),
    "colour": DetectorSpec(f"{_VISION}.colour:ColourDetector", "ball", "ball"),
    "features": DetectorSpec(
        f"{_VISION}.features:FeatureDetector", "features", "picture", needs_selection=True
    ),
    "marker": DetectorSpec(f"{_VISION}.markers:MarkerDetector", "marker", "marker"),
}
"""The detectors, by the name that the parameter `follow` of `visual_target` has."""
