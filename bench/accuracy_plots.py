"""The plots of accuracy.md."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.stats import chi2

from bench.runs import PARAMETERS, Run

_COLOUR, _LAW = "#0072b2", "#d55e00"


def plot_nees(runs: Mapping[str, Sequence[Run]], path: Path) -> None:
    """A histogram of NEES for each scenario against the density of chi-square with 7 degrees of freedom."""
    from matplotlib.figure import Figure

    columns = min(3, len(runs))
    lines = -(-len(runs) // columns)
    figure = Figure(figsize=(3.4 * columns, 2.4 * lines), layout="constrained")
    panels = np.atleast_1d(figure.subplots(lines, columns, sharex=True)).ravel()
    edges = np.linspace(0.0, 30.0, 16)
    grid = np.linspace(0.0, 30.0, 200)
    for panel, (name, some) in zip(panels, runs.items(), strict=False):
        nees = np.array([run.nees for run in some if run.is_solved])
        width = edges[1] - edges[0]
        counts, _ = np.histogram(np.minimum(nees, edges[-1] - width / 2), edges)
        panel.bar(edges[:-1], counts / len(nees) / width, width, align="edge", color=_COLOUR, alpha=0.6)
        panel.plot(grid, chi2.pdf(grid, len(PARAMETERS)), color=_LAW)
        panel.set_title(f"{name}, {len(nees)} runs", fontsize=9)
        panel.set_yticks([])
        panel.set_xlabel("NEES (last bar: all beyond)", fontsize=8)
    for panel in panels[len(runs) :]:
        panel.set_axis_off()
    figure.savefig(path, dpi=90)


def plot_scaled_errors(runs: Mapping[str, Sequence[Run]], path: Path) -> None:
    """Every error over its stated sigma, with the band that holds 95 of 100."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 1.5 * len(runs) + 0.6), layout="constrained")
    panels = np.atleast_1d(figure.subplots(len(runs), 1, sharex=True, sharey=True))
    for panel, (name, some) in zip(panels, runs.items(), strict=True):
        panel.axhspan(-1.96, 1.96, color="0.92")
        solved = [run for run in some if run.is_solved]
        # The same spread in every plot: one recording of results, one picture.
        spread = np.linspace(-0.3, 0.3, len(solved))
        for place in range(len(PARAMETERS)):
            scaled = [run.errors[place] / run.stds[place] for run in solved]
            panel.plot(place + spread, np.clip(scaled, -6.0, 6.0), ".", color=_COLOUR, markersize=3)
        panel.set_ylabel(name, fontsize=8)
        panel.set_ylim(-6.2, 6.2)
    panels[-1].set_xticks(range(len(PARAMETERS)), PARAMETERS)
    figure.supylabel("error / sigma", fontsize=9)
    figure.savefig(path, dpi=90)
