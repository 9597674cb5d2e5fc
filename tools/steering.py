"""Every number that steers the full method, from the records themselves: `python -m tools.steering` writes the table.

A record is a frozen dataclass beside its stage's page. A field's name says the quantity and its unit, the comment above it
says why it is so large. Fields without a comment of their own share the one above them. The table stands in
docs/how-it-works.md between two marks; a test holds it against the records, so that none can be left out.

A reason begins with where the number comes from, one of SOURCES. What was judged has a column beside it that says how far an
answer moves with the number a half smaller and a half larger (bench/sensitivity.py, which measures it).

`loose` finds numbers of the stages' sources that are in no record. Not all numbers steer: structure (0 to 3, one half),
shapes, indices and what is written, factors of units, guards against round-off and coefficients of formulas may stand where
they are, and so may FACTS, which are mathematics under a name.
"""

from __future__ import annotations

import ast
import csv
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from math import log10
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "how-it-works.md"
BEGIN, END = "<!-- steering numbers: python -m tools.steering -->", "<!-- end of steering numbers -->"

#: How far answers move: a row a number, by bench/sensitivity.py.
SHIFTS = ROOT / "bench" / "results" / "sensitivity.csv"
#: How a reason begins: by arithmetic that stands there; on what; out of which; or what depends on it.
SOURCES = ("derived", "measured", "data sheets", "judged")

#: Stage, file and class of every record, in reading order.
RECORDS = (
    ("prepare", "calib_core/full/prepare/settings.py", "Length"),
    ("prepare", "calib_core/full/prepare/settings.py", "Sampled"),
    ("prepare", "calib_core/full/prepare/settings.py", "Noise"),
    ("prepare", "calib_core/full/prepare/settings.py", "Spectrum"),
    ("prepare", "calib_core/full/prepare/settings.py", "Stamps"),
    ("prepare", "calib_core/full/prepare/settings.py", "Sweeps"),
    ("prepare", "calib_core/full/prepare/settings.py", "Rotor"),
    ("prepare", "calib_core/full/prepare/settings.py", "Steps"),
    ("prepare", "calib_core/full/prepare/settings.py", "Sieving"),
    ("prepare", "calib_core/full/prepare/settings.py", "Lasers"),
    ("prepare", "calib_core/full/prepare/settings.py", "ToneSizes"),
    ("planes", "calib_core/planes/settings.py", "SegmentSettings"),
    ("planes", "calib_core/full/planes/settings.py", "Search"),
    ("planes", "calib_core/full/planes/settings.py", "Patches"),
    ("planes", "calib_core/full/planes/settings.py", "Judgement"),
    ("planes", "calib_core/full/planes/settings.py", "Curved"),
    ("odometry", "calib_core/full/odometry/settings.py", "TrackSettings"),
    ("odometry", "calib_core/full/odometry/settings.py", "MapSettings"),
    ("odometry", "calib_core/full/odometry/settings.py", "Following"),
    ("odometry", "calib_core/full/odometry/settings.py", "Within"),
    ("odometry", "calib_core/full/odometry/settings.py", "Standstill"),
    ("odometry", "calib_core/full/odometry/settings.py", "Pairs"),
    ("initialise", "calib_core/full/initialise/settings.py", "Lags"),
    ("initialise", "calib_core/full/initialise/settings.py", "Vectors"),
    ("initialise", "calib_core/full/initialise/settings.py", "Profile"),
    ("initialise", "calib_core/full/initialise/settings.py", "Agreeing"),
    ("initialise", "calib_core/full/initialise/settings.py", "Guiding"),
    ("initialise", "calib_core/full/initialise/settings.py", "Rotating"),
    ("initialise", "calib_core/full/initialise/settings.py", "ClockRates"),
    ("initialise", "calib_core/full/initialise/settings.py", "Rigid"),
    ("initialise", "calib_core/full/initialise/settings.py", "Linear"),
    ("initialise", "calib_core/full/initialise/settings.py", "Signs"),
    ("initialise", "calib_core/full/initialise/settings.py", "Upright"),
    ("joint", "calib_core/full/joint/first_estimate.py", "Beginning"),
    ("joint", "calib_core/full/joint/policies.py", "Round"),
    ("joint", "calib_core/full/joint/policies.py", "Sampling"),
    ("joint", "calib_core/full/joint/policies.py", "Propagation"),
    ("joint", "calib_core/full/joint/policies.py", "PlaneSet"),
    ("joint", "calib_core/full/joint/policies.py", "Steadying"),
    ("joint", "calib_core/full/joint/policies.py", "Surfaces"),
    ("joint", "calib_core/full/joint/policies.py", "Tones"),
    ("joint", "calib_core/full/joint/policies.py", "Settling"),
    ("joint", "calib_core/full/joint/policies.py", "Limits"),
    ("joint", "calib_core/full/joint/settings.py", "Chain"),
    ("joint", "calib_core/full/joint/settings.py", "Hearing"),
    ("joint", "calib_core/full/joint/settings.py", "Holding"),
    ("joint", "calib_core/full/joint/settings.py", "Wandering"),
    ("joint", "calib_core/full/joint/settings.py", "Measuring"),
    ("joint", "calib_core/full/joint/settings.py", "Surveying"),
    ("joint", "calib_core/full/joint/settings.py", "Straying"),
    ("joint", "calib_core/full/joint/settings.py", "Regaining"),
    ("joint", "calib_core/full/joint/settings.py", "Doubting"),
    ("joint", "calib_core/full/joint/settings.py", "Watching"),
    ("joint", "calib_core/full/joint/settings.py", "Sheets"),
    ("assess", "calib_core/full/assess/settings.py", "Plausible"),
    ("assess", "calib_core/full/assess/settings.py", "Wording"),
    ("assess", "calib_core/full/assess/settings.py", "Parts"),
    ("assess", "calib_core/full/assess/settings.py", "Given"),
    ("assess", "calib_core/full/assess/settings.py", "ClockSteps"),
    ("assess", "calib_core/full/assess/settings.py", "Silence"),
    ("assess", "calib_core/full/assess/settings.py", "AccelerometersApart"),
    ("assess", "calib_core/full/assess/settings.py", "Bending"),
    ("assess", "calib_core/full/assess/settings.py", "Filtered"),
    ("assess", "calib_core/full/assess/settings.py", "FirstLook"),
    ("forecast", "calib_core/full/forecast.py", "Forecasting"),
)
#: Where numbers steer: the stages, and the search for planes that they share.
STEERED = ("calib_core/full", "calib_core/planes")
#: Named numbers that nobody chose: mathematics, the contract's units, the layout of a matrix.
FACTS = frozenset({
    "CALIBRATION", "GRAVITY", "BIAS_START", "UNITS", "LIMITS", "STANDING", "_TAPERED", "_NORMAL_MAD", "_DEGREES", "_QUARTILES",
    "_UNIFORM_STDS", "_GOLDEN", "_UPPER_CENTRE", "_UPPER_44", "_ROW_KEY", "_BIN_COLUMNS", "_LASERS_SHARE",
})  # fmt: skip
#: Calls whose numbers are shapes, digits or the share of a job that is done.
_SHAPES = frozenset({"zeros", "empty", "eye", "full", "reshape", "broadcast_to", "round", "tell", "stage", "portion"})
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


def loose() -> Iterator[str]:
    """Numbers that steer and are in no record: "file:line: number"."""
    for folder in STEERED:
        for path in sorted((ROOT / folder).rglob("*.py")):
            name = path.relative_to(ROOT).as_posix()
            records = {record for _, file, record in RECORDS if file == name}
            for number in loose_in(path.read_text(encoding="utf-8"), records, kernels=path.stem == "kernels"):
                yield f"{name}:{number}"


def loose_in(source: str, records: set[str], *, kernels: bool = False) -> list[str]:
    """Those of one source, "line: number". records: its classes whose fields have reasons.   kernels: whole numbers are sizes."""
    tree = ast.parse(source)
    free = _free_of_reasons(tree, records)
    return [
        f"{node.lineno}: {node.value}"
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant)
        and isinstance(node.value, int | float)
        and not isinstance(node.value, bool)
        and id(node) not in free
        and not (kernels and isinstance(node.value, int))
        and not _is_structure(float(node.value))
    ]


def _is_structure(value: float) -> bool:
    """Whether a number is too plain to be a choice: a half, 0 to 3, and guards against round-off."""
    return value in {0.0, 0.5, 1.0, 2.0, 3.0} or 0.0 < value <= 1e-6


def _free_of_reasons(tree: ast.Module, records: set[str]) -> set[int]:
    """Nodes whose number needs no reason: records, facts, shapes, indices, texts, powers of ten, coefficients."""
    free: set[int] = set()
    for node in ast.walk(tree):
        parts: list[ast.AST] = []
        match node:
            case ast.ClassDef(name=name) if name in records:
                parts = [field for field in node.body if isinstance(field, ast.AnnAssign)]
            case ast.Assign(targets=[ast.Name(id=name)]) if name in FACTS:
                parts = [node]
            case ast.Call(func=ast.Name(id="Schedule" | "Round")):
                parts = [node]
            case ast.Subscript():
                parts = [node.slice]
            case ast.JoinedStr():
                parts = [node]
            case ast.Call(func=ast.Name(id=name) | ast.Attribute(attr=name)) if name in _SHAPES:
                parts = [*node.args, *node.keywords]
            case ast.Call(func=ast.Name(id="slice" | "range") | ast.Attribute(attr="arange")):
                parts = [each for each in node.args if isinstance(each, ast.Constant) and each.value in {6, 9, 10, 12}]
            case ast.BinOp():
                parts = [each for each in (node.left, node.right) if _is_factor(each)]
        free |= {id(each) for part in parts for each in ast.walk(part)}
    return free


def _is_factor(node: ast.expr) -> bool:
    """Whether an operand is a power of ten, which changes a unit, or a small whole number of a formula."""
    if not isinstance(node, ast.Constant) or not isinstance(node.value, int | float):
        return False
    value = float(node.value)
    return (value > 0.0 and log10(value).is_integer()) or value in {4.0, 6.0, 9.0, 15.0, 16.0}


def _comment_above(lines: list[str], at: int) -> str:
    """The `#:` lines that end right above a line, as one sentence."""
    found: list[str] = []
    while at > 0 and lines[at - 1].strip().startswith("#:"):
        at -= 1
        found.insert(0, lines[at].strip().removeprefix("#:").strip())
    return " ".join(found)


def table() -> str:
    """The table as Markdown."""
    rows = [
        "| stage | record | number | value | unit | why | less, more |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    moves = shifts()
    for n in numbers():
        reason = n.reason.replace("|", "\\|")
        rows.append(
            f"| {n.stage} | {n.record} | `{n.name}` | {n.value} | {n.unit} | {reason} | {moves.get((n.record, n.name), '')} |"
        )
    return "\n".join(rows)


def shifts() -> dict[tuple[str, str], str]:
    """By record and number, how far the answer moves with it a half smaller and a half larger [sigma], or what becomes of it."""
    with SHIFTS.open(newline="", encoding="utf-8") as file:
        return {(row["record"], row["number"]): f"{row['less']}, {row['more']}" for row in csv.DictReader(file)}


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
