"""Detection rate and processor time of the network and the cascade, on photographs."""

import time
from statistics import mean, median
from typing import Any

from frame import row, table
from photographs import EMPTY, KINDS, SIZES, empty, fetch, photographs

from head_tracking.vision import (
    Camera,
    FaceDetector,
    FaceParameters,
    Frame,
    Picture,
    require_opencv,
)

CAMERA = Camera(640, 480, 500.0, 500.0, 319.5, 239.5)
ROLLS = (0, 20, 30, 45)
LIGHTS = (1.0, 0.5, 0.25)
PARTS = 5  # of each photograph without a face
ROUNDS = 9


def faces() -> str:
    """Return the table, or the reason why it cannot be measured."""
    require_opencv()  # one thread, as in the nodes: two that wait for each other cost more
    try:
        fetch()
    except Exception as error:
        return f"No photographs of people: {error}."
    net = FaceDetector(FaceParameters())
    contenders = {"cascade": FaceDetector(FaceParameters(net="none"))}
    if net.shortcoming:
        return f"The net was not measured: {net.shortcoming}."
    contenders["net"] = net
    rows = []
    for kind in KINDS:
        for name, detector in contenders.items():
            cells = [_share(detector, kind, roll) for roll in ROLLS]
            rows.append(f"| {kind} | {name} | " + " | ".join(cells) + " |")
    head = "face | by | " + " | ".join(f"{roll}°" for roll in ROLLS)
    sizes = ", ".join(map(str, SIZES))
    return "\n\n".join(
        (
            "Faces of people on photographs (scikit-image's astronaut; of face_recognition's "
            f"tests), {sizes} pixels wide in images of 640 by 480, in full, half and a quarter of "
            "the light, turned in the image to both sides; each image alone. Faces found, and in "
            "brackets those of 40 pixels (asked for: 90 % up to 45°):",
            table(head, rows),
            _empty(contenders),
            _cost(contenders),
        )
    )


def _frame(picture: Any) -> Frame:
    return Frame(0, CAMERA, Picture(picture))


def _share(detector: FaceDetector, kind: str, roll: float) -> str:
    found: list[tuple[float, bool]] = []
    for shot in photographs(kind, roll, lights=LIGHTS):
        boxes = [face.box for face in detector.detect(_frame(shot.picture), [])]
        found.append((shot.size, any(map(shot.shows, boxes))))
    small = [hit for size, hit in found if size == SIZES[0]]
    whole = 100 * sum(hit for _, hit in found) / len(found)
    return f"{whole:.0f} % ({100 * sum(small) / len(small):.0f} %)"


def _empty(contenders: dict[str, FaceDetector]) -> str:
    counts = dict.fromkeys(contenders, 0)
    total = 0
    for picture in empty(PARTS):
        total += 1
        for name, detector in contenders.items():
            counts[name] += len(detector.detect(_frame(picture), []))
    listed = ", ".join(f"{name} {count}" for name, count in counts.items())
    return (
        f"Faces found in {total} parts of {len(EMPTY)} photographs without a face: {listed} "
        "(asked for: fewer than the cascade)."
    )


def _cost(contenders: dict[str, FaceDetector]) -> str:
    """Measure processor time with and without faces, in interleaved rounds."""
    shots = [shot.picture for kind in KINDS for shot in photographs(kind, 20, (60,), (1.0,))]
    pictures = shots + list(empty(1))[: len(shots)]
    net = contenders["net"]
    hints = [[face.box for face in net.detect(_frame(picture), [])] for picture in shots]
    rounds: dict[str, list[float]] = {name: [] for name in (*contenders, "net, followed")}
    for _ in range(ROUNDS):
        spent: dict[str, list[float]] = {name: [] for name in rounds}
        for i, picture in enumerate(pictures):
            for name, detector in contenders.items():
                spent[name].append(_milliseconds(detector, picture, []))
            if i < len(shots) and hints[i]:
                net._since_search = 0
                spent["net, followed"].append(_milliseconds(net, picture, hints[i]))
        for name, times in spent.items():
            rounds[name].append(mean(times))
    rows = []
    for name, times in rounds.items():
        ratios = [one / cascade for one, cascade in zip(times, rounds["cascade"], strict=True)]
        asked = {"net": "0.20"}.get(name, "")
        spread = f"{min(ratios):.2f} to {max(ratios):.2f}"
        rows.append(row(name, f"{median(times):.1f} ms", f"{median(ratios):.2f}", spread, asked))
    head = "by | an image | of the cascade's | in each round | asked for"
    return (
        "Processor time on one core for the whole image of 640 by 480, one thread, half of the "
        f"images without a face, medians of {ROUNDS} rounds (`followed`: near the face of the "
        "image before, as in four of five images):\n\n" + table(head, rows)
    )


def _milliseconds(detector: FaceDetector, picture: Any, hints: list[Any]) -> float:
    frame = _frame(picture)
    start = time.process_time()
    detector.detect(frame, hints)
    return 1e3 * (time.process_time() - start)
