"""Angles and quaternions that people and files read, against SciPy and against the product of three turns."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib_core.exporters import export
from calib_core.geometry import euler_xyz_deg, roll_pitch_yaw_rad
from calib_core.types import FloatArray
from tests.core.exporters.parsers import PARSERS
from tests.core.exporters.results import make_result


def _turned(roll: float, pitch: float, yaw: float) -> FloatArray:
    """Rz(yaw) Ry(pitch) Rx(roll), each written out."""
    (cr, sr), (cp, sp), (cy, sy) = ((np.cos(a), np.sin(a)) for a in (roll, pitch, yaw))
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return np.asarray(about_z @ about_y @ about_x)


def test_angles_give_the_rotation_back() -> None:
    """Mutations: turn about the moving axes in the other order; the sign of the pitch."""
    rng = np.random.default_rng(5)
    for roll, pitch, yaw in rng.uniform([-3.1, -1.5, -3.1], [3.1, 1.5, 3.1], (50, 3)):
        np.testing.assert_allclose(roll_pitch_yaw_rad(_turned(roll, pitch, yaw)), [roll, pitch, yaw], atol=1e-12)
        R = Rotation.from_rotvec([roll, pitch, yaw]).as_matrix()
        np.testing.assert_allclose(
            Rotation.from_euler("xyz", euler_xyz_deg(R), degrees=True).as_matrix(), R, atol=1e-12
        )


@pytest.mark.parametrize("pitch_deg", [90.0, -90.0])
def test_at_the_pole_yaw_is_zero_and_the_rotation_is_kept(pitch_deg: float) -> None:
    """Roll and yaw are one turn there. Mutations: roll 0 instead; the turn's sign at one of both poles."""
    for turn in np.radians([-170.0, -30.0, 0.0, 75.0, 180.0]):
        for share in (0.0, 0.3, 1.0):
            R = _turned(share * turn, np.radians(pitch_deg), (1.0 - share) * turn)
            roll, pitch, yaw = roll_pitch_yaw_rad(R)
            assert yaw == 0.0
            np.testing.assert_allclose(np.degrees(pitch), pitch_deg, atol=1e-6)
            np.testing.assert_allclose(_turned(roll, pitch, yaw), R, atol=1e-9)


@pytest.mark.parametrize("name", ["urdf", "li-init"])
def test_the_document_and_the_exports_say_the_same_at_the_pole(name: str) -> None:
    """Mutation: an exporter with angles of its own that has the other one zero."""
    R = _turned(np.radians(40.0), np.radians(90.0), 0.0)
    angles_deg = euler_xyz_deg(R)
    assert angles_deg[2] == 0.0
    text = export(make_result(R, np.zeros(3)), name)
    wanted = np.array(angles_deg) if name == "li-init" else np.radians(angles_deg)
    written = [float(word) for word in text.replace('"', " ").split() if word.lstrip("-").replace(".", "", 1).isdigit()]
    assert any(np.allclose(written[k : k + 3], wanted, atol=1e-6) for k in range(len(written) - 2)), text
    T, _ = PARSERS[name](text)
    np.testing.assert_allclose(T[:3, :3], R, atol=1e-9)
