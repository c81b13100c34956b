"""Record the joint positions while the head turns, and draw them.

python examples/record_and_plot.py /dev/ttyUSB0 turn.svg     or, without hardware: --sim turn.svg
"""

import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from head_tracking import Head

SVG = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 -120 {width} 240" fill="none">{lines}</svg>'
)
COLOURS = ("crimson", "royalblue")


def main(port: str = "--sim", file: str = "turn.svg") -> None:
    """Run the example."""
    recorded: list[tuple[float, float]] = []  # pan and tilt [rad], every 20 ms
    with (
        Head.simulated() if port == "--sim" else Head.open(port) as head,
        ThreadPoolExecutor() as pool,
    ):
        turn = pool.submit(head.look_at, (1.0, 1.0, 0.2))
        while not turn.done():
            pan, tilt = head.joints.values()
            recorded.append((pan, tilt))
            time.sleep(0.02)
        print(turn.result())
    lines = ""
    for positions, colour in zip(zip(*recorded, strict=True), COLOURS, strict=True):
        points = " ".join(f"{2 * x},{-100 * angle:.1f}" for x, angle in enumerate(positions))
        lines += f'<polyline stroke="{colour}" points="{points}"/>'
    Path(file).write_text(SVG.format(width=2 * len(recorded), lines=lines))


if __name__ == "__main__":
    main(*sys.argv[1:])
