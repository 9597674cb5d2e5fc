"""Every number that steers the full method, from the records themselves: `python -m tools.steering` writes the table.

A record is a frozen dataclass beside its stage's page. A field's name says the quantity and its unit, the comment above it
says why it is so large. Fields without a comment of their own share the one above them. The table stands in
docs/how-it-works.md between two marks; a test holds it against the records, so that none can be left out.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "how-it-works.md"
BEGIN, END = "<!-- steering numbers: python -m tools.steering -->", "<!-- end of steering numbers -->"

#: Stage, file and class of every record, in reading order.
RECORDS = (
    ("joint", "calib_core/full/joint/begin.py", "Beginning"),
    ("joint", "calib_core/full/joint/schedule.py", "Round"),
    ("joint", "calib_core/full/joint/schedule.py", "Sampling"),
    ("joint", "calib_core/full/joint/schedule.py", "Propagation"),
    ("joint", "calib_core/full/joint/schedule.py", "PlaneSet"),
    ("joint", "calib_core/full/joint/schedule.py", "Surfaces"),
    ("joint", "calib_core/full/joint/schedule.py", "Settling"),
    ("joint", "calib_core/full/joint/schedule.py", "Limits"),
)
#: Unit by the end of a field's name, longest first.
UNITS = (
    ("_m_s2", "m/s2"), ("_rad_s", "rad/s"), ("_m_s", "m/s"), ("_sigmas", "sigma"), ("_deg", "deg"), ("_rad", "rad"),
    ("_sweeps", "sweeps"), ("_std_m", "m"), ("_hz", "Hz"), ("_m", "m"), ("_s", "s"),
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Number:
    """One field of a record."""

    stage: str
    record: str
    name: str
    value: str
    reason: str

    @property
    def unit(self) -> str:
        """By the name's end; nothing for a count or a ratio."""
        return next((unit for end, unit in UNITS if self.name.endswith(end)), "")


def numbers() -> Iterator[Number]:
    """All of them, in the order of the records."""
    for stage, path, record in RECORDS:
        text = (ROOT / path).read_text(encoding="utf-8")
        lines = text.splitlines()
        classes = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.ClassDef) and node.name == record]
        reason = ""
        for field in classes[0].body:
            if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
                reason = _comment_above(lines, field.lineno - 1) or reason
                value = "" if field.value is None else ast.unparse(field.value)
                yield Number(stage, record, field.target.id, value, reason)


def _comment_above(lines: list[str], at: int) -> str:
    """The `#:` lines that end right above a line, as one sentence."""
    found: list[str] = []
    while at > 0 and lines[at - 1].strip().startswith("#:"):
        at -= 1
        found.insert(0, lines[at].strip().removeprefix("#:").strip())
    return " ".join(found)


def table() -> str:
    """The table as Markdown."""
    rows = ["| stage | record | number | value | unit | why |", "| --- | --- | --- | --- | --- | --- |"]
    for n in numbers():
        reason = n.reason.replace("|", "\\|")
        rows.append(f"| {n.stage} | {n.record} | `{n.name}` | {n.value} | {n.unit} | {reason} |")
    return "\n".join(rows)


def with_table(page: str) -> str:
    """The page with its table made anew."""
    before, rest = page.split(BEGIN)
    _, after = rest.split(END)
    return f"{before}{BEGIN}\n{table()}\n{END}{after}"


def main() -> int:
    """Write the table into the page."""
    PAGE.write_text(with_table(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
