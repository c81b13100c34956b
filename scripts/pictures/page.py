"""Takes the pictures of the page for docs/pictures/, in Debian's chromium: viewer*.png."""

import sys
from pathlib import Path
from typing import Any

from browser import open_browser, open_page, open_tab
from simulated_run import run_with_page
from visitor import face, first_sight, stays_on_target

SIZE, PHONE = (1280, 800), (390, 844)
SETTLING = 20.0  # s until the chart is filled
LARGEST = 400_000  # bytes


def take(page: Any, path: Path) -> int:
    """Take a picture; return its size [bytes]."""
    page.wait_for_timeout(2e3)
    page.screenshot(path=path)
    size = path.stat().st_size
    print(f"took {path}, {size / 1e3:.0f} kB")
    return size


def main() -> int:
    """Take pictures of the page of a simulated head; return 1 if one is too large."""
    folder, sizes = Path(sys.argv[1]), []
    with open_browser() as browser, run_with_page() as (_, port):
        page = open_page(browser, port, *SIZE)
        first_sight(page)
        page.get_by_text("Centre", exact=True).click()  # where the people are
        page.wait_for_timeout(3e3)
        face(page)
        page.wait_for_timeout(1e3 * SETTLING)
        sizes.append(take(page, folder / "viewer.png"))
        for tab in ("joints", "tune", "health"):
            open_tab(page, tab)
            sizes.append(take(page, folder / f"viewer-{tab}.png"))
        page.close()
        page = open_page(browser, port, *PHONE, color_scheme="dark")
        stays_on_target(page)
        sizes.append(take(page, folder / "viewer-phone.png"))
    return int(max(sizes) > LARGEST)


if __name__ == "__main__":
    raise SystemExit(main())
