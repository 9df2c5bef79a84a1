"""Opens a page of the viewer in headless Chromium, reads commands from stdin and prints answers to stdout.

python tools/bench/browser_page.py ADDRESS

The command `click X Y` clicks at these pixels; the end of stdin closes the page. This program is a separate
process, so that controlling the browser uses no processor time of the viewer.
"""

from __future__ import annotations

import shutil
import sys
import time

from playwright.sync_api import sync_playwright

FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


def main() -> None:
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
        page = browser.new_page(viewport={"width": 1400, "height": 1000})
        begin = time.perf_counter()
        page.goto(sys.argv[1])
        page.wait_for_selector("canvas")
        page.get_by_text("commands pass, within limits").first.wait_for()
        box = page.locator("canvas").first.bounding_box()
        assert box is not None
        print(time.perf_counter() - begin, box["x"], box["y"], box["width"], box["height"], flush=True)
        for line in sys.stdin:
            _, x, y = line.split()
            page.mouse.click(float(x), float(y))
        browser.close()


if __name__ == "__main__":
    main()
