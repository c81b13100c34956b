"""Frames in words: tf2's lists, and the tree drawn with ages and rates."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from head_tracking.transforms.tree import Edge, JointEdge, SampledEdge, StaticEdge

_NO_PARENT = "NO_PARENT"  # tf2's word
_STATIC_RATE = 10_000.0  # what tf2 says of one sample: it is spread over 0.1 ms


def frames_as_string(edges: Iterable[Edge]) -> str:
    """tf2's all_frames_as_string: a sentence a frame."""
    return "".join(f"Frame {edge.child} exists with parent {_parent(edge)}.\n" for edge in edges)


def frames_as_yaml(edges: Iterable[Edge], authorities: Mapping[str, str], now: int) -> str:
    """tf2's all_frames_as_yaml.

    Args:
        edges: above each frame.
        authorities: who said so, by frame.
        now: the time [ns], for the delays; 0 for none.
    """
    lines: list[str] = []
    for edge in edges:
        if edge.history is not None and not edge.history:
            continue
        oldest, latest = _span(edge)
        lines += [
            f"{edge.child}: ",
            f"  parent: '{_parent(edge)}'",
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
    """All frames, each on a line of its own below its parent, with what is known of it.

    Args:
        edges: above each frame.
        names: of all frames.
        now: the time [ns], for the ages; 0 for none.
    """
    above = {edge.child: edge for edge in edges if _parent(edge) != _NO_PARENT}
    children: dict[str, list[str]] = {name: [] for name in sorted(names)}
    for child, edge in above.items():
        children.setdefault(_parent(edge), []).append(child)
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


def problems(edges: Iterable[Edge], names: Iterable[str], now: int, max_age: int) -> list[str]:
    """What keeps frames from being looked up, a sentence each.

    Args:
        edges: above each frame.
        names: of all frames.
        now: the time [ns].
        max_age: older than this [ns] is too old.
    """
    above = {edge.child: edge for edge in edges}
    found = []
    roots = sorted(name for name in names if name not in above)
    if not roots:
        return ["no frame is known: is robot_description or /tf published in this domain?"]
    if len(roots) > 1:
        found.append(f"there are {len(roots)} trees that nothing connects: {', '.join(roots)}")
    silent, late = {}, {}
    for edge in above.values():
        if edge.history is None:
            continue
        what = edge.leader.joint if isinstance(edge, JointEdge) else edge.child
        if not edge.history:
            silent[what] = "joint" if isinstance(edge, JointEdge) else "frame"
        elif (age := now - edge.history.stamps[-1]) > max_age:
            late[what] = age * 1e-9
    found += [f"the {kind} {name!r} was never heard of" for name, kind in silent.items()]
    found += [f"{name!r} was last heard of {age:.1f} s ago" for name, age in late.items()]
    return found


def rate(edge: Edge) -> float:
    """Samples per second; for a frame that never moves what tf2 says."""
    if edge.history is None:
        return _STATIC_RATE
    oldest, latest = _span(edge)
    return len(edge.history) * 1e9 / max(latest - oldest, 100_000)


def _note(edge: Edge, now: int) -> str:
    if isinstance(edge, StaticEdge):
        return ""
    what = f"  [{edge.joint.name}]" if isinstance(edge, JointEdge) else "  [transforms]"
    if not edge.history:
        return f"{what} nothing known"
    age = f", {(now - _span(edge)[1]) * 1e-9:.3f} s old" if now else ""
    return f"{what} {rate(edge):.1f} Hz{age}"


def _parent(edge: Edge) -> str:
    """The newest parent."""
    if isinstance(edge, SampledEdge):
        return edge.history.values[-1][0] if edge.history else _NO_PARENT
    return edge.parent


def _span(edge: Edge) -> tuple[int, int]:
    """The oldest and the newest stamp [ns] of an edge of which something is known."""
    return (0, 0) if edge.history is None else (edge.history.oldest, edge.history.stamps[-1])
