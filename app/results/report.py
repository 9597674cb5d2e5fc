"""A result as one self-contained page: verdict, numbers with their standard deviations, planes, what to record next."""

from __future__ import annotations

from html import escape

from app.results.verdict import verdict
from app.schemas.results import Thickness
from calib_core.result import CalibrationResult

_STYLE = """
body{font:16px/1.5 system-ui,sans-serif;max-width:52rem;margin:2rem auto;padding:0 1rem;color:#1a1b1e;background:#fff}
h1{font-size:1.5rem}h2{font-size:1.15rem;margin-top:2rem}
table{border-collapse:collapse}td,th{padding:.2rem .9rem .2rem 0;text-align:left}
td.n{font-variant-numeric:tabular-nums;text-align:right}pre{background:#f4f4f6;padding:.8rem;overflow:auto}
"""


def report_page(result: CalibrationResult, walls: Thickness | None) -> str:
    """The page. Every text in it is escaped: topic and plane names come from files."""
    name = escape(result.provenance.recording.name)
    parts = [
        '<!doctype html><html lang="en"><head><meta charset="utf-8">',
        f"<title>Calibration of {name}</title><style>{_STYLE}</style></head><body>",
        f"<h1>Calibration of {name}</h1><p>{escape(verdict(result))}</p>",
        _answer(result),
        _sentences("What was noticed", [message.text for message in result.messages]),
        _sentences("Weak directions", [weak.text for weak in result.observability.weak_directions]),
        _sentences("What to record next", result.observability.advice),
        _planes(result),
        _walls(walls),
        _origin(result),
        "</body></html>\n",
    ]
    return "".join(parts)


def _answer(result: CalibrationResult) -> str:
    transform, uncertainty = result.T_imu_lidar, result.uncertainty
    if transform is None or uncertainty is None:
        return ""
    rows = [
        (name, f"{value:.4f} deg", f"{std:.4f} deg about the lidar's {axis}")
        for name, axis, value, std in zip(
            ("Roll", "Pitch", "Yaw"), "xyz", transform.euler_xyz_deg, uncertainty.rotation_std_deg, strict=True
        )
    ]
    rows += [
        (f"Position {axis}", f"{value * 1e3:.2f} mm", f"{std * 1e3:.2f} mm")
        for axis, value, std in zip("xyz", transform.translation_m, uncertainty.translation_std_m, strict=True)
    ]
    offset_s = result.time_offset_s or 0.0
    rows.append(("Time offset", f"{offset_s * 1e3:.3f} ms", f"{uncertainty.time_offset_std_s * 1e3:.3f} ms"))
    matrix = "\n".join("  ".join(f"{value: .9f}" for value in row) for row in transform.matrix)
    return (
        "<h2>T_imu_lidar</h2><p>Takes lidar coordinates to IMU coordinates, x_imu = R x_lidar + p; the time offset is "
        "added to IMU stamps.</p>"
        + _table(("", "value", "one standard deviation"), rows)
        + f"<p>As a matrix, last column in metres:</p><pre>{matrix}</pre>"
    )


def _planes(result: CalibrationResult) -> str:
    rows = [(plane.name, f"{plane.points}", f"{plane.rms_m * 1e3:.2f} mm") for plane in result.quality.planes]
    return "<h2>Planes</h2>" + _table(("plane", "points", "rms distance"), rows) if rows else ""


def _walls(walls: Thickness | None) -> str:
    if walls is None:
        return ""
    rows = [
        (wall.name, f"{wall.before_rms_m * 1e3:.1f} mm", f"{wall.after_rms_m * 1e3:.1f} mm") for wall in walls.walls
    ]
    rows.append(("all", f"{walls.before_rms_m * 1e3:.1f} mm", f"{walls.after_rms_m * 1e3:.1f} mm"))
    return "<h2>Wall thickness (rms)</h2>" + _table(("plane", "raw", "de-skewed"), rows)


def _origin(result: CalibrationResult) -> str:
    recording = result.provenance.recording
    rows = [
        ("recording", recording.name, ""),
        ("sha256", recording.sha256, ""),
        ("lidar", recording.lidar_topic, recording.lidar_frame_id),
        ("IMU", recording.imu_topic, recording.imu_frame_id),
        *((name, version, "") for name, version in sorted(result.provenance.software.items())),
    ]
    return "<h2>Where it comes from</h2>" + _table(("", "", "frame"), rows)


def _sentences(title: str, sentences: list[str]) -> str:
    if not sentences:
        return ""
    return f"<h2>{title}</h2><ul>" + "".join(f"<li>{escape(text)}</li>" for text in sentences) + "</ul>"


def _table(head: tuple[str, str, str], rows: list[tuple[str, str, str]]) -> str:
    cells = "".join(f'<th scope="col">{escape(text)}</th>' for text in head)
    body = "".join(
        f'<tr><th scope="row">{escape(first)}</th>'
        f'<td class="n">{escape(second)}</td><td class="n">{escape(third)}</td></tr>'
        for first, second, third in rows
    )
    return f"<table><thead><tr>{cells}</tr></thead><tbody>{body}</tbody></table>"
