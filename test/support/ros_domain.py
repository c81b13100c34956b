"""ROS domains for tests: one that nobody else on this machine tests in.

The ports of domains above 100 are among those that Linux gives to any socket.
"""

import fcntl
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def own_domain() -> Iterator[str]:
    """A ROS domain that is this test's own until the end: heads that share one refuse to run."""
    for number in range(100, 50, -1):
        place = Path(tempfile.gettempdir()) / f"head_tracking_test_domain_{number}"
        with place.open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            yield str(number)
            return
    raise RuntimeError("no ROS domain from 51 to 100 is free: another test run holds them")
