"""Files that were cut short or overwritten."""

from __future__ import annotations


def overwrite(path):
    """Some bytes in the middle of the file, its size and all else as it was."""
    content = bytearray(path.read_bytes())
    middle = len(content) // 2
    content[middle : middle + 64] = bytes(byte ^ 0xFF for byte in content[middle : middle + 64])
    path.write_bytes(content)


def cut(path):
    """The second half gone."""
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
