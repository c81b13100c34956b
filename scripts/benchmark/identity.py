"""Identity of the followed person among rendered people who leave, return and cross."""

from frame import table
from people import crossed, replaced, returned

from head_tracking.vision.opencv import require_opencv

_EPISODES = 200


def identity() -> str:
    """Return a row for each kind of episode."""
    require_opencv()
    kinds = (
        (
            "somebody in other clothes 0.2 to 0.6 m beside, up to 1.8 s later: takes over",
            replaced,
            0,
        ),
        ("the same person up to 0.3 m beside, up to 1.5 s later: followed again", returned, 95),
        ("somebody walks past, before or behind: followed person kept", crossed, 95),
    )
    rows = []
    for what, happens, asked in kinds:
        count = sum(happens(seed) for seed in range(5000, 5000 + _EPISODES))
        rows.append(f"| {what} | {asked} % | {count} of {_EPISODES} |")
    return table("episode | asked | measured", rows)
