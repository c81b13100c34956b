"""Two heads look at one point at the same time. Each has its own port and thread.

python examples/two_heads.py /dev/ttyUSB0 /dev/ttyUSB1     or, without hardware: --sim --sim
"""

import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack

from head_tracking import Head

POINT = (1.5, 0.5, 0.6)  # m, in base_link of the first head
BESIDE = (0.0, 0.4, 0.0)  # m; the second head is to the left of the first


def main(*ports: str) -> None:
    """Run the example."""
    with ExitStack() as opened:
        heads = [
            opened.enter_context(Head.simulated() if port == "--sim" else Head.open(port))
            for port in ports
        ]
        points = [POINT, tuple(a - b for a, b in zip(POINT, BESIDE, strict=True))]
        with ThreadPoolExecutor() as threads:
            for result in threads.map(Head.look_at, heads, points):
                print(result)


if __name__ == "__main__":
    main(*(sys.argv[1:] or ("--sim", "--sim")))
