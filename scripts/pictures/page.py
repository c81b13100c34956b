"""Takes the pictures of the page for docs/pictures/, in Debian's chromium: viewer*.png."""

from __future__ import annotations

import sys
from pathlib import Path

from browser import open_browser, open_tab
from simulated_run import SimulatedRun, own_domain
from visitor import Visitor, face, first_sight

SIZE, PHONE = (1280, 800), (390, 844)
SETTLING = 20.0  # s until the chart is filled
LARGEST = 400_000  # bytes


def take(visitor: Visitor, path: Path) -> int:
    """Take a picture; return its size [bytes]."""
    visitor.page.wait_for_timeout(2e3)
    visitor.page.screenshot(path=path)
    size = path.stat().st_size
    print(f"took {path}, {size / 1e3:.0f} kB")
    return size


def main() -> int:
    """Take pictures of the page of a simulated head; return 1 if one is too large."""
    own_domain()
    folder, sizes = Path(sys.argv[1]), []
    with open_browser() as browser, SimulatedRun("--viewer") as run:
        width, height = SIZE
        visitor = Visitor(browser.new_page(viewport={"width": width, "height": height}), run.port)
        first_sight(visitor)
        face(visitor)
        visitor.page.wait_for_timeout(1e3 * SETTLING)
        sizes.append(take(visitor, folder / "viewer.png"))
        for tab in ("joints", "tune", "health"):
            open_tab(visitor.page, tab)
            sizes.append(take(visitor, folder / f"viewer-{tab}.png"))
        visitor.page.close()
        width, height = PHONE
        page = browser.new_page(viewport={"width": width, "height": height}, color_scheme="dark")
        visitor = Visitor(page, run.port)
        visitor.stays_on_target()
        sizes.append(take(visitor, folder / "viewer-phone.png"))
    return int(max(sizes) > LARGEST)


if __name__ == "__main__":
    raise SystemExit(main())
