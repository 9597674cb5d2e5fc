"""What a forecast becomes without some of its planes, against forecasts and solves that never had them."""

from __future__ import annotations

import errno
from dataclasses import replace
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib_core.calibrate import calibrate
from calib_core.full.forecast import Outlook, forecast
from calib_core.full.forecast_by_choice import Foresight, keep_foresight, kept_foresight, narrowed_scatter
from calib_core.settings import CalibrateSettings
from calib_core.simulate import generate
from calib_core.types import Narrowed, Plane, Recording
from tests.core.full.conftest import SHORT


@pytest.fixture(scope="module")
def recording() -> Recording:
    return generate(SHORT, seed=4)[0]


@pytest.fixture(scope="module")
def outlook(recording: Recording) -> Outlook:
    return forecast(recording, [len(scan.points) for scan in recording.scans])


@pytest.fixture(scope="module")
def foresight(outlook: Outlook) -> Foresight:
    assert outlook.foresight is not None
    return outlook.foresight


@pytest.fixture(scope="module")
def of_all(recording: Recording, outlook: Outlook) -> np.ndarray:
    """What a solve by all planes knows, whole ones."""
    return stds(recording, [replace(_suggested(p.plane), outline_m=None) for p in outlook.proposals.patches])


def stds(recording: Recording, planes: list[Plane]) -> np.ndarray:
    """(7,) of a solve by these planes, which all of them count in."""
    result = calibrate(recording, CalibrateSettings(crispness=False), planes=planes).result
    assert len(result.quality.planes) == len(planes)
    assert result.uncertainty is not None
    return np.sqrt(np.diag(np.array(result.uncertainty.covariance)))


def test_it_is_what_a_solve_without_the_plane_knows(
    recording: Recording, outlook: Outlook, foresight: Foresight, of_all: np.ndarray
) -> None:
    """Oracle: solves of the same recording by these planes. Mutations: the planes left out counted instead; one plane's points
    left in; the growth along the worst direction for all seven, as n n^T gives it: 1.8 where 1.1 is right.
    """
    assert foresight.proposed == len(outlook.proposals.patches) == 6

    left = [1, 2, 3, 5]
    truth = stds(recording, [_suggested(outlook.proposals.patches[place].plane) for place in left]) / of_all
    assert truth.max() > 1.3
    np.testing.assert_allclose(foresight.growth(left), truth, rtol=0.25)


def _suggested(plane: Plane) -> Plane:
    return replace(plane, suggested=True)


def cut_short(outline_m: np.ndarray, share: float) -> np.ndarray:
    """The part of a convex outline (K, 3) on the lower side along its longer direction, so much of that length."""
    along = np.linalg.svd(outline_m - outline_m.mean(axis=0))[2][0]
    height = outline_m @ along
    height = height - height.min() - share * np.ptp(height)
    corners = []
    for a, b, at, then in zip(outline_m, np.roll(outline_m, -1, axis=0), height, np.roll(height, -1), strict=True):
        corners += [a] if at <= 0.0 else []
        corners += [a + (b - a) * at / (at - then)] if (at <= 0.0) != (then <= 0.0) else []
    return np.array(corners)


def test_it_is_what_a_solve_with_a_part_of_a_plane_knows(
    recording: Recording, outlook: Outlook, foresight: Foresight, of_all: np.ndarray
) -> None:
    """Oracle: solves of the same recording with the outline. Mutations: the whole plane counted; left out; the part's place, or
    its spread, passed over.
    """
    patches = outlook.proposals.patches
    place, share = 1, 0.3
    left = cut_short(patches[place].outline_m, share)

    planes = [replace(_suggested(p.plane), outline_m=left if k == place else None) for k, p in enumerate(patches)]
    truth = stds(recording, planes) / of_all
    assert truth.max() > 1.15
    told = foresight.growth(range(6), {place: Narrowed(patches[place].outline_m, left)})
    np.testing.assert_allclose(told, truth, rtol=0.12)
    assert (told <= foresight.growth([0, 2, 3, 4, 5]) + 1e-9).all()


def test_a_part_s_moments_are_those_of_the_points_within() -> None:
    """Oracle: half a million points, evenly over a turned rectangle, and those of them in a corner of it: exactly that part where
    the bin saw the whole. Mutations: a law's variance for an even spread's; the lidar's pose left out; d moved by nothing; the
    shares' logarithm without the whole's.
    """
    rng = np.random.default_rng(1)
    R, p = Rotation.from_rotvec([0.4, -0.2, 0.9]).as_matrix(), np.array([0.3, -1.0, 0.5])
    whole, left = (np.array([(0, 0, 2.0), (x, 0, 2.0), (x, y, 2.0), (0, y, 2.0)]) for x, y in ((4.0, 3.0), (1.0, 1.2)))
    seen = np.column_stack([rng.uniform(0.0, 4.0, 500_000), rng.uniform(0.0, 3.0, 500_000), np.full(500_000, 2.0)])
    d = 0.01 * seen[:, 0] + 0.003 * rng.normal(size=len(seen))
    y = np.column_stack([(seen - p) @ R, np.ones(len(seen)), d])
    within = (seen[:, 0] < 1.0) & (seen[:, 1] < 1.2)
    scatter, expected = y.T @ y, y[within].T @ y[within]
    along = np.array([[np.cos(0.3), np.sin(0.3), 0.0], [-np.sin(0.3), np.cos(0.3), 0.0]])
    found = narrowed_scatter(scatter[None], along, (R[None], p[None]), Narrowed(whole, left))[0]
    np.testing.assert_allclose(found, expected, rtol=0.02, atol=2e-3 * expected[3, 3])
    np.testing.assert_allclose(found, found.T)
    assert np.linalg.eigvalsh(found).min() > -1e-9 * found[3, 3]


def test_it_never_falls_where_planes_go(foresight: Foresight) -> None:
    """Law. What came into view stays. Mutations: not held above 1; nothing left counted as what is held; what came late gone
    too.
    """
    rng = np.random.default_rng(3)
    before, left = np.ones(7), list(range(6))
    np.testing.assert_array_equal(foresight.growth(left), before)
    for place in rng.permutation(6):
        left.remove(int(place))
        now = foresight.growth(left)
        assert (now >= before * (1.0 - 1e-9)).all() or not np.isfinite(before).all()
        before = now
    assert np.isinf(before).all()
    late = replace(foresight, proposed=4, of_proposal=np.array([0, 1, 2, 3, -1, -1]))
    np.testing.assert_allclose(late.growth([0, 2]), foresight.growth([0, 2, 4, 5]))


def test_what_is_kept_tells_the_same(foresight: Foresight, tmp_path: Path) -> None:
    """Mutations: arrays in single precision; an older problem left where there is none; a damaged one told as one."""
    keep_foresight(tmp_path / "new", foresight)
    kept = kept_foresight(tmp_path / "new")
    assert kept is not None
    np.testing.assert_array_equal(kept.growth([0, 1, 2, 3]), foresight.growth([0, 1, 2, 3]))
    (file,) = (tmp_path / "new").iterdir()
    for torn in (file.read_bytes()[:-100], b""):
        file.write_bytes(torn)
        assert kept_foresight(tmp_path / "new") is None
    keep_foresight(tmp_path / "new", None)
    assert not list((tmp_path / "new").iterdir())
    assert kept_foresight(tmp_path / "new") is None


def test_a_full_disk_takes_no_report_away(
    foresight: Foresight, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Mutations: what cannot be written raised; half a file left behind; an older problem left for the new report."""
    keep_foresight(tmp_path, foresight)

    def full(file: BinaryIO, **_: object) -> None:
        file.write(b"half")
        raise OSError(errno.ENOSPC, "no space left")

    monkeypatch.setattr(np, "savez", full)
    keep_foresight(tmp_path, foresight)
    assert not list(tmp_path.iterdir())
    (tmp_path / "file").touch()
    keep_foresight(tmp_path / "file" / "below", foresight)
    assert kept_foresight(tmp_path / "file" / "below") is None
