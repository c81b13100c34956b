"""ROS domains for tests: one that nobody else on this machine tests in.

The ports of domains above 100 are among those that Linux gives to any socket.
"""

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

FOLDER = Path("/tmp")  # as the locks of heads: not TMPDIR, which may differ between test runs


@contextmanager
def own_domain() -> Iterator[str]:
    """A ROS domain that is this test's own until the end: heads that share one refuse to run."""
    for number in range(100, 50, -1):
        place = FOLDER / f"head_tracking_test_domain_{number}"
        with suppress(PermissionError):  # another user has made it
            place.touch()
        with place.open() as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            yield str(number)
            return
    raise RuntimeError("no ROS domain from 51 to 100 is free: another test run holds them")
