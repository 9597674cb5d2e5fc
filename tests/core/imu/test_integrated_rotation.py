"""A gyroscope's turning against SciPy, one rotation after the other."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from calib_core.imu.integrated_rotation import turned_since


def test_turns_follow_one_another_about_the_gyroscopes_own_axes() -> None:
    """Uneven stamps, large turns about changing axes; as many readings as fill no power of two.

    Oracle: SciPy's rotations, multiplied one by one. Mutations: the product from the other side; the first reading's rate for
    the mean of two; a pass of the running product left out.
    """
    rng = np.random.default_rng(4)
    stamps_s = np.cumsum(rng.uniform(0.002, 0.02, 45))
    gyro = rng.normal(0.0, 4.0, (45, 3))
    expected = [Rotation.identity()]
    for k in range(44):
        mean = 0.5 * (gyro[k] + gyro[k + 1])
        expected.append(expected[-1] * Rotation.from_rotvec(mean * (stamps_s[k + 1] - stamps_s[k])))
    found = turned_since(stamps_s, gyro)
    np.testing.assert_allclose(found, Rotation.concatenate(expected).as_matrix(), atol=1e-12)
    assert turned_since(stamps_s[:1], gyro[:1]).shape == (1, 3, 3)
