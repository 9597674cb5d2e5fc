"""The committed numbers: baseline.json, which the gate judges by, and the tables under bench/results."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

from bench.metrics import Metric, workload_of

FOLDER = Path(__file__).resolve().parent
BASELINE = FOLDER / "baseline.json"
RESULTS = FOLDER / "results"


def read_baseline(path: Path = BASELINE) -> dict[str, Metric]:
    """Blessed metrics by key; none where nothing was blessed yet."""
    if not path.is_file():
        return {}
    return {entry["key"]: Metric.model_validate(entry) for entry in json.loads(path.read_text(encoding="utf-8"))}


def bless(measured: Iterable[Metric], path: Path = BASELINE) -> None:
    """Make the judged among the measured the baseline of their workloads, whose other keys go; other workloads' stay."""
    judged = {metric.key: metric for metric in measured if metric.is_judged()}
    ran = {workload_of(key) for key in judged}
    metrics = {key: before for key, before in read_baseline(path).items() if workload_of(key) not in ran} | judged
    entries = [metrics[key].model_dump() for key in sorted(metrics)]
    path.write_text(json.dumps(entries, indent=2) + "\n", encoding="utf-8")


def write_results(name: str, metrics: Iterable[Metric], folder: Path = RESULTS) -> Path:
    """The numbers of one workload, for the README and for whoever compares."""
    folder.mkdir(exist_ok=True)
    path = folder / f"{name}.json"
    path.write_text(json.dumps([metric.model_dump() for metric in metrics], indent=2) + "\n", encoding="utf-8")
    return path
