"""Why the tool `servo` stops."""

from __future__ import annotations


class ToolError(Exception):
    """Something that was asked for cannot be done."""


class RefusedError(ToolError):
    """Something that was asked for could do harm, or was not confirmed."""
