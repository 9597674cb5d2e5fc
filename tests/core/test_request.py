"""What somebody asks for and does not fit together: one sentence, or one thing that is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib_core.errors import SettingsError
from calib_core.events import Event, LogEvent
from calib_core.request import each_once, say_unused, with_offset_to_hold
from calib_core.settings import CalibrateSettings, Gravity, ImuNoise, Prior
from calib_core.types import ImuData, InitialGuess, Plane, Recording

FLOOR, WALL = Plane("floor", np.array([0.0, 0.0, 1.0]), 1.2), Plane("wall", np.array([1.0, 0.0, 0.0]), 3.0)


def turned(plane: Plane, deg: float, by_m: float = 0.0, **more: object) -> Plane:
    """The same, a little turned and farther away."""
    across = np.roll(plane.normal, 1)
    normal = np.cos(np.radians(deg)) * plane.normal + np.sin(np.radians(deg)) * across
    return replace(plane, normal=normal, offset_m=plane.offset_m + by_m, **more)  # type: ignore[arg-type]


class Said(list[str]):
    """Codes and sentences that were said."""

    def __call__(self, event: Event) -> None:
        assert isinstance(event, LogEvent)
        self.append(f"{event.code}: {event.text}")


@pytest.mark.parametrize(
    ("deg", "by_m", "twice"),
    [(0.0, 0.0, True), (1.0, 0.0, True), (0.0, -0.02, True), (5.0, 0.0, False), (0.0, 0.12, False)],
)
def test_a_surface_that_is_given_twice_counts_once(deg: float, by_m: float, twice: bool) -> None:
    """A kerb is another surface. Seen: a floor given twice lost all its points, and was said not to lie where it was put.

    Mutations: none; the later one; whatever it is turned by; however far.
    """
    said = Said()
    again = turned(FLOOR, deg, by_m, name="ground")
    kept = each_once([FLOOR, WALL, again], said)
    assert [plane.name for plane in kept] == ["floor", "wall", *["ground"] * (not twice)]
    assert [text.startswith("planes.twice: ground is the same surface as floor") for text in said] == [True] * twice


def test_two_parts_of_a_surface_are_two_and_what_is_insisted_on_is() -> None:
    """Mutations: outlines no matter; one outline enough; the suggested one."""
    corners = np.zeros((3, 3))
    parts = [replace(FLOOR, outline_m=corners), turned(FLOOR, 0.5, name="b", outline_m=corners)]
    assert each_once(parts, Said()) == parts
    assert each_once([parts[0], FLOOR], Said()) == parts[:1]
    suggested = replace(FLOOR, suggested=True)
    (kept,) = each_once([suggested, turned(FLOOR, 1.0, name="ground")], Said())
    assert (kept.name, kept.suggested) == ("floor", False)
    assert kept.normal[2] < 1.0


def test_planes_of_one_name_get_names_of_their_own() -> None:
    """Mutations: left as they are; the second number for the third."""
    side = replace(WALL, normal=np.array([0.0, 1.0, 0.0]))
    back = replace(WALL, normal=np.array([-1.0, 0.0, 0.0]))
    said = Said()
    assert [plane.name for plane in each_once([WALL, side, back], said)] == ["wall", "wall (2)", "wall (3)"]
    assert said[1] == "planes.named: two planes are called wall: one of them is renamed wall (3)"


def test_an_offset_that_is_held_and_not_given_is_that_of_one_clock() -> None:
    """Seen: 0.3 to 1.6 ms off, known to a nanosecond, as the turning had it. Mutations: that; held although it is estimated; not
    said; of clocks a year apart, too; what is given put aside.
    """
    imu = ImuData(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3)))
    recording, held, said = Recording("x", imu, ()), CalibrateSettings(estimate_time_offset=False), Said()
    R = np.eye(3)
    guess = with_offset_to_hold(recording, held, InitialGuess(R_imu_lidar=R), said)
    assert guess is not None
    assert (guess.time_offset_ns, guess.R_imu_lidar is R) == (0, True)
    assert said[0].startswith("offset.held: no time offset to hold was given: it is held at 0")
    alone = with_offset_to_hold(recording, held, None, said)
    assert alone is not None
    assert alone.time_offset_ns == 0
    given = InitialGuess(time_offset_ns=7)
    apart = replace(recording, coarse_offset_ns=31_536_000_000_000_000)
    assert with_offset_to_hold(apart, held, given, said) is given
    assert with_offset_to_hold(recording, CalibrateSettings(), None, said) is None
    assert with_offset_to_hold(recording, held.model_copy(update={"method": "paper"}), None, said) is None
    assert len(said) == 2
    with pytest.raises(SettingsError, match=r"31,536,000\.0 s apart; give the time offset"):
        with_offset_to_hold(apart, held, None, said)


def test_what_the_published_method_does_not_obey_is_said() -> None:
    """Seen: the same answer to the last digit with a prior, an ideal IMU, a bias that stands and an offset that is held, unsaid.

    Mutations: never; of the default method; of what it obeys; what is as it always is.
    """
    noise = ImuNoise(gyroscope_noise_density_rad_s_sqrt_hz=1e-4, accelerometer_noise_density_m_s2_sqrt_hz=1e-3)
    obeyed = CalibrateSettings(
        method="paper", points_per_plane_per_scan=50, field_of_view_deg=40.0, gravity=Gravity(magnitude_m_s2=9.81),
        random_seed=3, crispness=False, excluded_spans_s=((0.0, 1.0),),
    )  # fmt: skip
    more = obeyed.model_copy(update={"estimate_time_offset": False, "priors": (Prior(axis="tz", value=0.0, std=1.0),)})
    for settings, named in (
        (obeyed, ""),
        (more, "estimate time offset, priors"),
        (more.model_copy(update={"method": "full"}), ""),
        (obeyed.model_copy(update={"imu_noise": noise}), "imu noise"),
        (
            obeyed.model_copy(update={"imu_noise": noise.model_copy(update={"range_std_m": 0.02})}),
            "imu noise (except the",
        ),
    ):
        said = Said()
        say_unused(settings, said)
        assert [f"ignores the settings {named}" in text for text in said] == [True] * bool(named)
