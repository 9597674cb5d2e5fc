"""The README's table of accuracy, made from the committed results: `python -m bench readme` writes it anew."""

from __future__ import annotations

from pathlib import Path

from bench.metrics import Metric
from bench.store import FOLDER, RESULTS, read_results
from bench.workloads import WORKLOADS

README = FOLDER.parent / "README.md"
START, END = "<!-- bench -->\n", "<!-- /bench -->\n"
_HEAD = (
    "| recording | runs | rotation, rms (expected) | translation, rms (expected) "
    "| time offset, rms (expected) | NEES / 7 |\n"
    "| --- | --- | --- | --- | --- | --- |\n"
)


def table(folder: Path = RESULTS) -> str:
    """One row for each workload that has committed results."""
    rows = [_row(name, read_results(name, folder)) for name in WORKLOADS if (folder / f"{name}.json").is_file()]
    return _HEAD + "".join(rows) if rows else "Not measured yet.\n"


def with_table(text: str, made: str) -> str:
    """The README's text with the table between the two marks replaced."""
    before, _, rest = text.partition(START)
    _, _, after = rest.partition(END)
    return before + START + made + END + after


def _row(name: str, metrics: dict[str, Metric]) -> str:
    def value(key: str) -> float:
        return metrics[f"{name}.{key}"].value

    cells = [
        name,
        f"{value('runs'):.0f}",
        f"{value('e_R_rms_deg'):.4f} deg ({value('sigma_R_deg'):.4f})",
        f"{value('e_p_rms_mm'):.2f} mm ({value('sigma_p_mm'):.2f})",
        f"{value('e_dt_rms_ms'):.4f} ms ({value('sigma_dt_ms'):.4f})",
        f"{value('nees_over_freedom'):.2f}",
    ]
    return "| " + " | ".join(cells) + " |\n"
