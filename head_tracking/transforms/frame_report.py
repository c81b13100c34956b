"""Frames as text: the lists of tf2, and the tree."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from head_tracking.transforms.tree import Edge, JointEdge, StaticEdge, latest_parent

_NO_PARENT = "NO_PARENT"  # as in tf2
_STATIC_RATE = 10_000.0  # tf2's rate of one sample: one in 0.1 ms


def frames_as_string(edges: Iterable[Edge]) -> str:
    """Return a sentence for each frame, as tf2 does."""
    return "".join(
        f"Frame {edge.child} exists with parent {latest_parent(edge) or _NO_PARENT}.\n"
        for edge in edges
    )


def frames_as_yaml(edges: Iterable[Edge], authorities: Mapping[str, str], now: int) -> str:
    """Return parent, rate and stamps of each frame, as tf2 does.

    Args:
        edges: above each frame.
        authorities: the sender of each frame.
        now: the time [ns], for the delays; 0 for none.
    """
    lines: list[str] = []
    for edge in edges:
        if edge.history is not None and not edge.history:
            continue
        oldest, latest = _span(edge)
        lines += [
            f"{edge.child}: ",
            f"  parent: '{latest_parent(edge)}'",
            f"  broadcaster: '{authorities.get(edge.child, 'robot_description')}'",
            f"  rate: {rate(edge):.3f}",
            f"  most_recent_transform: {latest * 1e-9:.6f}",
            f"  oldest_transform: {oldest * 1e-9:.6f}",
        ]
        if now:
            lines.append(f"  transform_delay: {(now - latest) * 1e-9:.3f}")
        lines.append(f"  buffer_length: {(latest - oldest) * 1e-9:.3f}")
    return "\n".join([*lines, ""]) if lines else "[]"


def tree_as_string(edges: Iterable[Edge], names: Iterable[str], now: int) -> str:
    """Return the tree of frames, one on each line, with rates and ages.

    Args:
        edges: above each frame.
        names: of all frames.
        now: the time [ns], for the ages; 0 for none.
    """
    above = {edge.child: edge for edge in edges if latest_parent(edge)}
    children: dict[str, list[str]] = {name: [] for name in sorted(names)}
    for child, edge in above.items():
        children.setdefault(latest_parent(edge), []).append(child)
    lines: list[str] = []
    stack = [(frame, "", "") for frame in reversed(children) if frame not in above]
    while stack:
        frame, indent, branch = stack.pop()
        note = _note(above[frame], now) if frame in above else ""
        lines.append(f"{indent}{branch}{frame}{note}")
        below = indent + {"": "", "├── ": "│   ", "└── ": "    "}[branch]
        last = len(children.get(frame, ())) - 1
        stack.extend(
            (child, below, "└── " if index == last else "├── ")
            for index, child in reversed(list(enumerate(children.get(frame, ()))))
        )
    return "\n".join(lines)


def rate(edge: Edge) -> float:
    """Return samples per second; for a static frame the number of tf2."""
    if edge.history is None:
        return _STATIC_RATE
    oldest, latest = _span(edge)
    return len(edge.history) * 1e9 / max(latest - oldest, 100_000)


def _note(edge: Edge, now: int) -> str:
    if isinstance(edge, StaticEdge):
        return ""
    what = f"  [{edge.joint.name}]" if isinstance(edge, JointEdge) else "  [transforms]"
    if not edge.history:
        return f"{what} no samples"
    age = f", {(now - _span(edge)[1]) * 1e-9:.3f} s old" if now else ""
    return f"{what} {rate(edge):.1f} Hz{age}"


def _span(edge: Edge) -> tuple[int, int]:
    """Return the oldest and the latest stamp [ns] of an edge with samples."""
    return (0, 0) if edge.history is None else (edge.history.oldest, edge.history.stamps[-1])
