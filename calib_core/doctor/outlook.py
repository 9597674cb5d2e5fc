"""The planes to expect and the forecast, put into words and into the report's models."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib_core.doctor.report import Forecast, ParameterForecast, PlaneReport, PlanesReport
from calib_core.doctor.sampling import SampledScans
from calib_core.events import OnEvent, ShouldCancel, ignore_event, never_cancel
from calib_core.full.assess.observability import Knowledge
from calib_core.full.assess.plausibility import SIGNS_BORNE_OUT, SIGNS_RIGHT, borne_out
from calib_core.full.assess.weak_sentences import weak_directions
from calib_core.full.forecast import NO_PLANES, Outlook, forecast
from calib_core.full.planes.plane_tests import SEEMS, Fault
from calib_core.phrasing import joined
from calib_core.plane_kinds import kind_of, names_of
from calib_core.planes.segment import determinacy
from calib_core.result import COVARIANCE_ORDER
from calib_core.sigmas import std_text
from calib_core.types import Finding, FloatArray, ImuData, PlaneProposals, Recording, Scan

_UNITS = ("deg", "deg", "deg", "m", "m", "m", "s")
_TURNS = COVARIANCE_ORDER[:3]
#: As the search for a reference scan has it: below this, some direction is seen by hardly any plane.
_LEAST_DETERMINACY = 0.02


def foresee(
    sampled: SampledScans,
    imu: ImuData | None,
    offset_ns: int,
    *,
    whole: Sequence[Scan] | None = None,
    on_event: OnEvent = ignore_event,
    should_cancel: ShouldCancel = never_cancel,
) -> Outlook:
    """The planes and, where there is an IMU, what a solve would know.

    offset_ns: coarse, between the clocks.   whole: the recording's scans with all their points, for the planes.
    """
    readings = imu or ImuData(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3)))
    recording = Recording(name="", imu=readings, scans=sampled.scans, coarse_offset_ns=offset_ns)
    try:
        return forecast(
            recording,
            sampled.points,
            share=sampled.share,
            whole=whole,
            on_event=on_event,
            should_cancel=should_cancel,
        )
    except (ArithmeticError, np.linalg.LinAlgError, ValueError) as error:
        # What else the doctor has to say must not be lost with it.
        reason = f"the sampled points and readings fit no motion at all ({error})"
        return Outlook(NO_PLANES, code="forecast.failed", reason=reason)


def planes_report(proposals: PlaneProposals, gravity: FloatArray | None, faults: Sequence[Fault] = ()) -> PlanesReport:
    """The expected planes. gravity: (3,) [m/s2] in the planes' frame, None where it is not known.   faults: what seems wrong with
    each, () where that is not known.
    """
    up = None if gravity is None else -gravity / np.linalg.norm(gravity)
    found = [kind_of(patch.plane.normal, up) for patch in proposals.patches]
    no_faults: Sequence[Fault] = [""] * len(found)
    planes = [
        PlaneReport(
            name=name,
            kind=kind,
            tilt_deg=tilt,
            area_m2=patch.area_m2,
            distance_m=abs(patch.plane.offset_m),
            points=patch.n_points,
            rms_m=patch.rms_m,
            normal=_rounded(patch.plane.normal),
            doubt=SEEMS.get(fault, ""),
        )
        for patch, name, (kind, tilt), fault in zip(
            proposals.patches, names_of([k for k, _ in found]), found, faults or no_faults, strict=True
        )
    ]
    normals = np.array([patch.plane.normal for patch in proposals.patches])
    spread = 3.0 * determinacy(normals) if len(normals) >= 3 else 0.0
    determined = spread >= 3.0 * _LEAST_DETERMINACY
    text = _planes_in_words(planes, determined=determined)
    return PlanesReport(
        planes=tuple(planes),
        determinacy=round(spread, 4),
        determined=determined,
        text=text,
        up=None if up is None else _rounded(up),
    )


def _rounded(direction: FloatArray) -> tuple[float, float, float]:
    """A unit vector to a hundredth of a degree."""
    x, y, z = (round(float(component), 5) for component in direction)
    return x, y, z


def doubts_settled(findings: Sequence[Finding], forecast: Forecast | None) -> list[Finding]:
    """The findings, the gyroscope's unit and the axes' signs beyond doubt where the lidar's own motion bears them out.

    A forecast that knows all three turns laid the readings on the lidar's track: in the other unit they are 57 times off, with a
    flipped axis no start fits.
    """
    if forecast is None or not forecast.parameters or any(p.weak for p in forecast.parameters if p.name in _TURNS):
        return list(findings)

    def settled(finding: Finding) -> Finding:
        if finding.code == "imu.gyroscope_unit":
            return replace(finding, text=borne_out(finding.text), confidence=1.0)
        if finding.code == "imu.axis_signs":
            return replace(
                finding,
                code=SIGNS_BORNE_OUT,
                text=SIGNS_RIGHT,
                level="info",
                consequence="readings are used as they are",
                confidence=1.0,
            )
        return finding

    return [settled(finding) for finding in findings]


def _planes_in_words(planes: Sequence[PlaneReport], *, determined: bool) -> str:
    if not planes:
        return "No plane was found in any scan: record in front of walls and floor, at 1 to 20 m."
    words = {"wall": ("wall", "walls"), "slanted": ("slope", "slopes"), "plane": ("plane", "planes")}
    counted = []
    for kind, count in Counter(plane.kind for plane in planes).items():
        one, many = words.get(kind, (kind, f"{kind}s"))
        counted.append(f"{count} {many}" if count > 1 else one)
    listed = joined(counted)
    number = f"{len(planes)} planes" if len(planes) > 1 else "one plane"
    said = number if listed == number else f"{number} ({listed})" if len(planes) > 1 else f"{number} ({planes[0].name})"
    seen = f"{said[0].upper()}{said[1:]} {'are' if len(planes) > 1 else 'is'} seen"
    if determined:
        doubtful = [f"{plane.name} {plane.doubt}" for plane in planes if plane.doubt]
        left_out = f" Likely to be left out by a solve: {joined(doubtful)}." if doubtful else ""
        return f"{seen}; together they fix where the lidar is.{left_out}"
    open_to = "leave" if len(planes) > 1 else "leaves"
    return (
        f"{seen}, which {open_to} one direction of the lidar's motion undetermined: turn towards planes that face another "
        "direction."
    )


def forecast_report(outlook: Outlook, planes: PlanesReport, *, share: float) -> Forecast:
    """The forecast. share: of the recording that was looked at."""
    names = tuple(plane.name for plane in planes.planes if not plane.doubt)
    knowledge = outlook.knowledge
    if knowledge is None:
        return Forecast(
            text=f"No forecast: {outlook.reason}.",
            parameters=(),
            planes=names,
            reason=outlook.reason,
            code=outlook.code,
        )
    std = np.sqrt(np.diag(knowledge.covariance))
    parameters = tuple(
        ParameterForecast(
            name=COVARIANCE_ORDER[i],
            std=float(np.degrees(std[i]) if i < 3 else std[i]),
            unit=_UNITS[i],
            weak=bool(weak),
            advice=next((said.text for said in outlook.advice if weak and i in said.about), ""),
        )
        for i, weak in enumerate(weak_parameters(knowledge))
    )
    text = in_words(parameters)
    if share < 1.0:
        text += f" Looked at: the first {outlook.covered_s:.0f} s, {100 * share:.0f} % of the recording."
    return Forecast(
        text=text,
        parameters=parameters,
        weak=tuple(direction.text for direction in weak_directions(knowledge)),
        planes=names,
        advice=tuple(said.text for said in outlook.advice),
        covered_s=round(outlook.covered_s, 2),
    )


def weak_parameters(knowledge: Knowledge) -> list[bool]:
    """Of the seven parameters, those that the data alone leave beyond the contract's limits."""
    return [axis in knowledge.weak_axes for axis in COVARIANCE_ORDER]


def in_words(parameters: Sequence[ParameterForecast]) -> str:
    """One sentence on all seven."""
    by_name: dict[str, ParameterForecast] = {parameter.name: parameter for parameter in parameters}
    known: list[str] = []
    unknown: list[str] = []
    for group, preposition, names in (
        ("rotation", "about", ("rx", "ry", "rz")),
        ("translation", "along", ("tx", "ty", "tz")),
        ("time offset", "", ("dt",)),
    ):
        good = [by_name[n] for n in names if not by_name[n].weak]
        bad = [n[-1] for n in names if by_name[n].weak]
        if good:
            where = f" {preposition} {joined([p.name[-1] for p in good])}" if bad else ""
            known.append(f"the {group}{where} to {_largest(good)}")
        if bad:
            where = f" {preposition} {joined(bad)}" if good else ""
            unknown.append(f"the {group}{where}")
    if not known:
        return "A solve would know none of the parameters well."
    text = f"A solve would know {joined(known)} (1 sigma)"
    return f"{text}, but not {joined(unknown, 'nor')}." if unknown else f"{text}."


def _largest(parameters: Sequence[ParameterForecast]) -> str:
    """Of one unit."""
    return std_text(max(parameter.std for parameter in parameters), parameters[0].unit)
