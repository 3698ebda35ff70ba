"""Draws the documents' pictures of the viewer anew: `python scripts/draw_viewer.py`. Needs [view] and Chromium.

A tracker and a policy act beside the first chair of examples/sample, as docs/viewer.md shows it.
"""

import sys
import time
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).parents[1]
PICTURES = ROOT / "docs" / "viewer"
WIDTH, HEIGHT = 1280, 657
MOMENT = 11.0
"""[s] By then both sit."""
PATIENCE = 300.0
"""[s] A browser without a graphics card, on a busy machine, takes long."""
SCROLL = """[...document.querySelectorAll('*')].forEach(one => {
    if (one.scrollHeight > one.clientHeight + 20 && getComputedStyle(one).overflowY !== 'visible') one.scrollTop = 1e6;
})"""
CLOSE = "[...document.querySelectorAll('[class*=Notification-close]')].forEach(one => one.click())"


def main() -> None:
    """Draw."""
    sys.path.insert(0, str(ROOT / "tests"))
    from chromium import Browser  # pyright: ignore[reportMissingImports]
    from mimicbench.viewer.page import Page, ViewConfig

    page = Page(ViewConfig(ROOT / "examples" / "sample", 18200, kind="retarget"))
    with Browser() as browser:
        browser.call(
            "Emulation.setDeviceMetricsOverride", width=WIDTH, height=HEIGHT, deviceScaleFactor=1, mobile=False
        )
        browser.go(page.url)
        browser.wait_for("· 1 of ", PATIENCE)
        browser.choose("Method", "tracker")
        browser.choose("Compare with", "online")
        browser.click("Act")
        wait_until(lambda: page.session.time > MOMENT)
        browser.click("Pause")
        browser.click("Elevation map")
        time.sleep(2.0)
        browser.run(CLOSE)
        time.sleep(2.0)
        browser.run(SCROLL.replace("1e6", "0"))
        browser.screenshot(PICTURES / "page.png")
        browser.run(SCROLL)
        page.session.show(MOMENT)
        time.sleep(10.0)
        browser.screenshot(PICTURES / "curves.png")
    page.close()


def wait_until(condition: Callable[[], bool]) -> None:
    """Until the page has done what was asked."""
    end = time.monotonic() + PATIENCE
    while not condition() and time.monotonic() < end:
        time.sleep(0.1)


if __name__ == "__main__":
    main()
