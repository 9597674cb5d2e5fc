"""Print the path of a Chromium for the browser tests, fetching Playwright's own where the machine has none.

Debian's is installed by tools/system_packages.py; Ubuntu's package is a snap, which will not run in containers.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

from playwright.sync_api import sync_playwright

BROWSERS = ("chromium", "google-chrome", "google-chrome-stable")


def find_browser() -> str:
    """The path of an executable."""
    named = os.environ.get("UNSWEEP_CHROMIUM")
    installed = (shutil.which(name) for name in BROWSERS)
    found = named or next((path for path in installed if path and "snap" not in str(Path(path).resolve())), None)
    return found or fetched_browser()


def fetched_browser() -> str:
    """Playwright's own Chromium; with the libraries it needs where this runs as root."""
    with sync_playwright() as playwright:
        path = playwright.chromium.executable_path
    if not Path(path).is_file():
        words = [sys.executable, "-m", "playwright", "install", "chromium"]
        subprocess.run([*words, "--with-deps"] if os.geteuid() == 0 else words, check=True, stdout=sys.stderr)
    return path


if __name__ == "__main__":
    try:
        sys.stdout.write(find_browser() + "\n")
    except subprocess.CalledProcessError:
        sys.exit("The browser tests need a Chromium and none could be fetched; install one and say `make test` again.")
