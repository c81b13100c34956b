"""python -m head_tracking: the program head_tracking."""

from __future__ import annotations

from head_tracking.programs import head_tracking

if __name__ == "__main__":
    raise SystemExit(head_tracking())
