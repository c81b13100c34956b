"""Record docs/pictures/viewer.webp: the page while the head follows a face, in real time."""

import base64
import io
import itertools
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

from browser import open_browser, open_page, word
from PIL import Image
from playwright.sync_api import Error
from simulated_run import run_with_page
from visitor import first_sight

SIZE = (1120, 700)
SECONDS = 5.0
TAKES = 5
QUALITY = 62  # of WebP
LARGEST = 2_000_000  # bytes
APART = 0.08  # s between two pictures
FEWEST = 4.0  # pictures a second: with fewer it is no film


def filmed(page: Any) -> list[tuple[float, bytes]]:
    """Return the images of the page, with their times [s]; none if the head did not follow."""
    pictures: list[tuple[float, bytes]] = []
    session = page.context.new_cdp_session(page)

    def take(event: Any) -> None:
        data = base64.b64decode(event["data"])
        pictures.append((event["metadata"]["timestamp"], data))
        with suppress(Error):  # the browser may have been closed meanwhile
            session.send("Page.screencastFrameAck", {"sessionId": event["sessionId"]})

    session.on("Page.screencastFrame", take)
    session.send("Page.startScreencast", {"format": "jpeg", "quality": 95, "everyNthFrame": 1})
    words = set()
    while not pictures or pictures[-1][0] - pictures[0][0] < SECONDS:
        page.wait_for_timeout(200)
        words.add(word(page))
    session.send("Page.stopScreencast")
    if words <= {"on target", "moving"}:
        return pictures
    print(f"the badge said {', '.join(sorted(words))}; is the machine quiet?")
    return []


def main() -> int:
    """Record the film; return 1 if the computer is too busy."""
    path = Path(sys.argv[1]) / "viewer.webp"
    with open_browser() as browser, run_with_page("--target", "face") as (_, port):
        page = open_page(browser, port, *SIZE)
        first_sight(page)
        page.wait_for_timeout(18e3)  # the strip needs something to show
        pictures = next(filter(None, (filmed(page) for _ in range(TAKES))), [])
    if not pictures:
        return 1
    pictures.sort(key=lambda each: each[0])  # Chromium may send one before an earlier one
    pictures = list({int(time / APART): (time, data) for time, data in pictures}.values())
    rate = len(pictures) / SECONDS
    if rate < FEWEST:
        print(f"{rate:.1f} pictures a second are no film; try again when the machine is quiet")
        return 1
    times = [time for time, _ in pictures]
    lasts = [round(1e3 * (b - a)) for a, b in itertools.pairwise(times)]
    lasts.append(lasts[-1])
    images = [Image.open(io.BytesIO(data)).convert("RGB") for _, data in pictures]
    images[0].save(
        path, save_all=True, append_images=images[1:], duration=lasts, loop=0, quality=QUALITY,
        method=3,
    )  # fmt: skip
    print(f"filmed {path}: {rate:.1f} pictures a second, {path.stat().st_size / 1e3:.0f} kB")
    return int(path.stat().st_size > LARGEST)


if __name__ == "__main__":
    raise SystemExit(main())
