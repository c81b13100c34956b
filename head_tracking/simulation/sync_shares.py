"""What a sync write holds for each servo; both protocols lay it out alike."""

from __future__ import annotations

from collections.abc import Mapping


def join_shares(data: Mapping[int, bytes]) -> tuple[int, bytes]:
    """Return the length of all shares, and the bytes behind it: each id with its share."""
    length = len(next(iter(data.values())))
    return length, b"".join(bytes((servo_id,)) + share for servo_id, share in data.items())


def find_share(shares: bytes, length: int, servo_id: int) -> bytes | None:
    """Return the share of a servo; None if there is none, or the shares are malformed."""
    if length == 0 or len(shares) % (length + 1):
        return None
    for start in range(0, len(shares), length + 1):
        if shares[start] == servo_id:
            return shares[start + 1 : start + 1 + length]
    return None
