"""What is asked of one recording of many and what came of it: JSON both ways, on this machine and between machines."""

from __future__ import annotations

from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field

from calib_core.settings import CalibrateSettings, ReadSettings

#: A recording whose worker was lost is tried so often in all: one that kills its worker every time must not go on for ever.
TRIES = 3
#: The code of what a worker of another version says, which does nothing else.
OTHER_VERSION = "job.other_version"


class FleetOrder(BaseModel):
    """One recording to calibrate. Its paths are whole, and the same on every machine that may be asked."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    name: str = Field(description="of its document in the output folder, without suffix")
    recording: Path
    reading: ReadSettings = ReadSettings()
    solving: CalibrateSettings = CalibrateSettings()
    planes: Path | None = None
    initial_guess: Path | None = None
    asked: str = Field(default="{}", description="what its document will not say that it was made with (provenance.py)")
    time_limit_s: float | None = Field(default=None, gt=0)
    memory_bytes: int | None = Field(default=None, gt=0)


class FleetOutcome(BaseModel):
    """What came of it: a document, refused ones too, or the reason why there is none.

    is_lost: the process ended without a word, or its machine did; trying again may help.
    tries: how often it has been tried by now, as far as who ran it knows.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    document: str | None = None
    code: str = ""
    text: str = ""
    is_lost: bool = False
    duration_s: float = 0.0
    tries: int = 1


def out_of_memory(order: FleetOrder) -> FleetOutcome:
    """What came of an order that needed too much."""
    most = (
        "memory than there is" if order.memory_bytes is None else f"than the {order.memory_bytes / 1e6:.0f} MB allowed"
    )
    text = f"{order.recording} needed more {most}: allow more with --memory-limit-mb, or calibrate a part with --end-s."
    return FleetOutcome(code="job.memory", text=text)
