"""Checks the built pages in Chromium: `make docs`, then `python tools/pages.py [FOLDER]`.

Opens each page in windows of the width of a laptop and of a telephone, and lists the elements that are cut
off. Types each public name into the search, and lists the names that the search does not find.
"""

from __future__ import annotations

import shutil
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

from playwright.sync_api import Browser, Page, sync_playwright
from playwright.sync_api import TimeoutError as BrowserTimeoutError

import tci

BUILT = Path(__file__).resolve().parent.parent / "docs" / "_build" / "html"
LAPTOP, TELEPHONE = 1250, 390
"""Widths [pixels] of the windows of a laptop and of a telephone."""
PATIENCE = 120_000
"""Time [ms] to wait for a page. It is long, because this check does not measure speed."""
CUT_OFF = """window => {
  const wide = document.documentElement.clientWidth, found = [];
  if (document.documentElement.scrollWidth > wide + 1) found.push("the page scrolls sideways");
  for (const one of document.querySelectorAll("article *")) {
    const words = (one.innerText || one.alt || "").slice(0, 50);
    const scrolls = getComputedStyle(one).overflowX;
    if (one.scrollWidth > one.clientWidth + 1 && one.clientWidth && scrolls !== "visible"
        && !(window === "telephone" && one.matches(".table-wrapper, div.math")))
      found.push(`${one.tagName} of ${one.scrollWidth} in ${one.clientWidth} pixels: ${words}`);
    if (one.matches("img") && one.getBoundingClientRect().right > wide + 1) found.push(`picture: ${words}`);
  }
  return found;
}"""
"""JavaScript that lists the elements that a page cuts off. On a telephone a table or a formula may scroll."""


class Quiet(SimpleHTTPRequestHandler):
    """Request handler that serves files and writes no log."""

    def log_message(self, *_: object) -> None:
        """Prints nothing."""


class Server(ThreadingHTTPServer):
    """Server that tolerates a browser that closes a connection before it has read the whole page."""

    def handle_error(self, *_: object) -> None:
        """Prints nothing."""


@contextmanager
def served(folder: Path) -> Iterator[str]:
    """Serves a folder on this machine and yields the address. The search of the pages works only with a
    server."""
    server = Server(("127.0.0.1", 0), partial(Quiet, directory=str(folder)))
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}"
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def opened(browser: Browser, width: int) -> Page:
    """Opens a browser window."""
    page = browser.new_page(viewport={"width": width, "height": 900})
    page.set_default_timeout(PATIENCE)
    return page


def cut_off(browser: Browser, folder: Path, width: int) -> list[str]:
    """Lists the elements that any page cuts off in a window of `width` [pixels]."""
    page, found = opened(browser, width), []
    kind = "telephone" if width == TELEPHONE else "laptop"
    files = sorted(folder.rglob("*.html"))
    for file in files:
        page.goto(file.as_uri(), wait_until="domcontentloaded")
        found += [
            f"{width} pixels, {file.relative_to(folder)}: {one}" for one in page.evaluate(CUT_OFF, kind)
        ]
    print(f"{len(files)} pages at {width} pixels")
    return found


def not_found(browser: Browser, address: str) -> list[str]:
    """Lists the public names that the search does not find."""
    page, missing = opened(browser, LAPTOP), []
    for name in tci.__all__:
        page.goto(f"{address}/search.html?q={name}", wait_until="domcontentloaded")
        try:
            page.wait_for_selector(f'#search-results a[href*="#tci.{name}"]')
        except BrowserTimeoutError:
            missing.append(f"the search does not find tci.{name}")
    print(f"{len(tci.__all__)} public names searched for")
    return missing


def main() -> None:
    """Prints all findings. Returns exit status 1 if there is any finding."""
    folder = Path(sys.argv[1]).resolve() if len(sys.argv) > 1 else BUILT
    if not (folder / "index.html").exists():
        sys.exit(f"{folder} has no index.html; valid: the folder of the pages that make docs builds")
    with sync_playwright() as playwright, served(folder) as address:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        found = [*cut_off(browser, folder, LAPTOP), *cut_off(browser, folder, TELEPHONE)]
        found += not_found(browser, address)
        browser.close()
    sys.exit("\n".join(found) or 0)


if __name__ == "__main__":
    main()
