"""What all errors have in common whose message is all that a person needs to know."""

from __future__ import annotations


class HeadTrackingError(Exception):
    """Something that a person can mend; the message says what is wrong, what is allowed, or both.

    A program that ends by it prints the message; by any other error, the traceback too.
    """


class RefusedError(HeadTrackingError):
    """A run refuses to start, or to go on, whichever of its nodes has found out why."""
