"""Make sure that the machine has what no Python package brings, before anything is installed.

As root on Debian and its kin the missing packages are installed; everybody else is told the one command to run.
Runs on the machine's own python3, whatever its age, so it stays with plain syntax and the standard library.
"""

import ctypes
import os
import shutil
import subprocess
import sys
from pathlib import Path

OLDEST_PYTHON = (3, 11)

# Shared libraries that `import open3d` opens, each with the Debian package that has it.
LIBRARIES = (
    ("libEGL.so.1", "libegl1"),
    ("libGL.so.1", "libgl1"),
    ("libX11.so.6", "libx11-6"),
    ("libusb-1.0.so.0", "libusb-1.0-0"),
    ("libgomp.so.1", "libgomp1"),
)
# And one that Playwright's own Node opens.
TEST_LIBRARIES = (("libatomic.so.1", "libatomic1"),)
BROWSERS = ("chromium", "google-chrome", "google-chrome-stable")
# A browser without a font draws boxes, and the screenshots would show them.
BROWSER_PACKAGES = ("chromium", "fonts-dejavu-core")
# Where Debian keeps the server that tests of the store start; what others have is not looked for, and these tests are left out.
DATABASES = Path("/usr/lib/postgresql")


def can_make_environments():
    """True where `python3 -m venv` will work: Debian ships it apart from python3."""
    try:
        import ensurepip
        import venv
    except ImportError:
        return False
    return bool(ensurepip and venv)


def can_load(library):
    """True where the dynamic linker finds `library`."""
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def is_debian():
    """True on Debian itself, whose chromium is a package; Ubuntu's is a snap, see tools/browser.py."""
    try:
        with open("/etc/os-release") as facts:
            return "ID=debian" in facts.read().split()
    except OSError:
        return False


def missing_packages(purpose):
    """Debian packages to install for `purpose` ("run" or "test"), in a fixed order."""
    packages = [] if can_make_environments() else ["python3-venv"]
    if sys.platform.startswith("linux"):
        libraries = LIBRARIES + TEST_LIBRARIES if purpose == "test" else LIBRARIES
        packages += [package for library, package in libraries if not can_load(library)]
    if purpose == "test" and is_debian() and not any(shutil.which(browser) for browser in BROWSERS):
        packages += BROWSER_PACKAGES
    if purpose == "test" and is_debian() and not any(DATABASES.glob("*/bin/postgres")):
        packages.append("postgresql")
    return packages


def install(packages):
    """Install `packages` with apt-get. Returns True when it worked."""
    environment = dict(os.environ, DEBIAN_FRONTEND="noninteractive")
    sys.stderr.write("Installing the system packages %s\n" % " ".join(packages))
    sys.stderr.flush()
    steps = (
        ["apt-get", "-qq", "update"],
        ["apt-get", "-qq", "-y", "-o", "Dpkg::Use-Pty=0", "install", "--no-install-recommends", *packages],
    )
    # The update may fail on one broken source while the packages are still to be had: only the install decides.
    for step in steps:
        process = subprocess.Popen(step, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        said = process.communicate()[0]
    if process.returncode != 0:
        sys.stderr.write(said.decode("utf-8", "replace"))
    return process.returncode == 0


def prepare(purpose):
    """The sentence to fail with, or "" when everything is there (now)."""
    if sys.version_info < OLDEST_PYTHON:
        found = "%d.%d" % sys.version_info[:2]
        return (
            "unsweep needs Python 3.11 or newer, but %s is Python %s; "
            "install a newer one and say `make %s PYTHON=python3.12`." % (sys.executable, found, purpose)
        )
    packages = missing_packages(purpose)
    if not packages:
        return ""
    names = " ".join(packages)
    if shutil.which("apt-get") is None:
        return (
            "unsweep needs what Debian calls %s, and this machine has neither them nor apt-get; "
            "install them with your system's own package manager and say `make %s` again." % (names, purpose)
        )
    command = "apt-get update && apt-get install --yes --no-install-recommends " + names
    if os.geteuid() != 0:
        command = command.replace("apt-get", "sudo apt-get")
        return "unsweep needs system packages that are missing here; run `%s` and then `make %s` again." % (
            command,
            purpose,
        )
    if not install(packages):
        return "apt-get could not install %s (its own words are above); run `%s` by hand, then `make %s` again." % (
            names,
            command,
            purpose,
        )
    return ""


if __name__ == "__main__":
    sentence = prepare(sys.argv[1])
    if sentence:
        sys.stderr.write(sentence + "\n")
    sys.exit(1 if sentence else 0)
