"""A Chromium for what only a browser can do: printing the book, and reading its pages as a reader does.

    python book/browser.py     # prints where one is; or says how to get one, and ends with 1

Playwright drives it: it waits for what a page does, sees every request and error of every frame, and prints with an
outline. The browser itself is whichever the machine has, since the one that Playwright would download is large.
"""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from playwright.sync_api import Browser, Playwright, sync_playwright

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "microsoft-edge", "msedge")
MAC = ("Google Chrome", "Chromium", "Microsoft Edge")
HOW_TO_GET_ONE = """no Chromium, Chrome or Edge here. Any of these brings one:
  Debian:           sudo apt-get install chromium
  Fedora:           sudo dnf install chromium
  macOS:            brew install --cask chromium
  anywhere:         .venv/bin/playwright install --with-deps chromium
One that is not found by itself is named by GVP_BROWSER=/path/to/chromium"""
FLAGS = (
    "--use-angle=swiftshader",  # 3D without a GPU, the same on every machine
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
)


class NoBrowserError(Exception):
    """There is no browser here; the text says how to get one."""


def find_browser(playwright: Playwright) -> str:
    """The path of a Chromium: the one named by ``GVP_BROWSER``, the system's, or Playwright's own download.

    Raises
    ------
    NoBrowserError
        Where there is none.
    """
    named = os.environ.get("GVP_BROWSER")
    if named:
        if found := shutil.which(named):
            return found
        raise NoBrowserError(f"GVP_BROWSER={named} is no program; it names a Chromium, Chrome or Edge.")
    programs = [shutil.which(name) for name in NAMES]
    programs += [f"/Applications/{name}.app/Contents/MacOS/{name}" for name in MAC]
    programs.append(playwright.chromium.executable_path)
    for program in programs:
        if program and Path(program).exists():
            return program
    raise NoBrowserError(HOW_TO_GET_ONE)


@contextmanager
def open_browser() -> Iterator[Browser]:
    """A headless Chromium. Playwright starts it without its sandbox: it is shown nothing but the book's own pages."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=find_browser(playwright), args=list(FLAGS))
        try:
            yield browser
        finally:
            browser.close()


def main() -> int:
    """Print where a browser is."""
    with sync_playwright() as playwright:
        try:
            print(find_browser(playwright))
        except NoBrowserError as error:
            print(error, file=sys.stderr)
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
