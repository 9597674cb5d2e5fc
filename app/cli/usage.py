"""argparse as the command line wants it: one sentence where the words do not fit, and the numbers that options take."""

from __future__ import annotations

import argparse
import math
from typing import Literal, NoReturn

#: What the program fills with a recording's first scans.
LEAST_MEMORY_MB = 200


class UsageError(Exception):
    """The words do not fit; str() is one sentence."""


class Parser(argparse.ArgumentParser):
    """argparse that raises one sentence instead of printing its usage and leaving."""

    def error(self, message: str) -> NoReturn:
        """Called by argparse. message: what does not fit."""
        raise UsageError(f"{message[:1].upper()}{message[1:]}; see `{self.prog} --help`.")


def natural(text: str) -> int:
    """A whole number from 0 on."""
    return _whole(text, 0)


def positive(text: str) -> int:
    """A whole number from 1 on."""
    return _whole(text, 1)


def megabytes(text: str) -> int:
    """Memory for one recording [MB]."""
    if not text.isdecimal() or int(text) < LEAST_MEMORY_MB:
        raise argparse.ArgumentTypeError(
            f"expected {LEAST_MEMORY_MB} MB or more, since no recording is read with less, but found `{text}`"
        )
    return int(text)


def seconds(text: str) -> float:
    """A length of time above 0."""
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not 0.0 < number < math.inf:
        raise argparse.ArgumentTypeError(f"expected seconds above 0, but found `{text}`")
    return number


def _whole(text: str, least: Literal[0, 1]) -> int:
    if not text.isdecimal() or int(text) < least:
        raise argparse.ArgumentTypeError(f"expected a whole number from {least} on, but found `{text}`")
    return int(text)
