"""Settings of the server, from the command line or from environment variables named UNSWEEP_..."""

from __future__ import annotations

import ipaddress
import os
from pathlib import Path

from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict

from app.limits import LEAST_MEMORY_BYTES, JobLimits, fair_memory_bytes
from app.schemas.jobs import JobKind

GIB = 1024**3


def default_data_dir() -> Path:
    """The folder for records and files where none is named: the user's own data folder."""
    base = os.environ.get("XDG_DATA_HOME")
    return (Path(base) if base else Path.home() / ".local" / "share") / "unsweep"


class AppSettings(BaseSettings):
    """Every choice of the server, frozen, with units in the names."""

    model_config = SettingsConfigDict(env_prefix="UNSWEEP_", frozen=True, extra="forbid", allow_inf_nan=False)

    host: str = Field(default="127.0.0.1", description="address to listen on; any but loopback needs a token")
    port: int = Field(default=8080, ge=0, le=65535, description="port to listen on; 0: any free one")
    data_dir: Path = Field(default_factory=default_data_dir, description="records, uploads, caches and results")
    recordings_dir: Path | None = Field(default=None, description="the server's own recordings, opened in place")
    token: str | None = Field(
        default=None,
        min_length=8,
        description="what every request shows; one below 32 characters may have to wait for wrong ones of its address; None: "
        "loopback only",
    )
    session_hours: float = Field(
        default=168.0, gt=0, description="how long a browser that has shown the token may stay"
    )
    trusted_proxies: tuple[str, ...] = Field(
        default=(), description="addresses of reverse proxies whose X-Forwarded-For and X-Forwarded-Proto are believed"
    )
    max_connections: int = Field(default=800, ge=10, description="open connections; more are answered 503")
    log_json: bool = Field(default=False, description="the log as one JSON object a line, for machines")
    database_url: str | None = Field(default=None, description="SQLAlchemy URL; None: SQLite in the data directory")
    scheduler: str | None = Field(
        default=None, description="address of a dask.distributed cluster that runs the jobs; None: this machine does"
    )
    allowed_origins: tuple[str, ...] = Field(
        default=(), description="origins accepted besides the server's own, as https://calib.example.org behind a proxy"
    )
    max_upload_bytes: int = Field(default=64 * GIB, gt=0, description="the largest recording accepted")
    min_free_bytes: int = Field(default=GIB, ge=0, description="disk space that must stay free after an upload")
    quota_bytes: int | None = Field(
        default=None, gt=0, description="the most that the data directory may take; None: what the disk has"
    )
    keep_days: float | None = Field(
        default=None, gt=0, le=36500, description="a recording that nobody used for so long is removed; None: never"
    )
    max_body_bytes: int = Field(default=2**20, gt=0, description="the largest body of any other request")
    concurrent_jobs: int = Field(default=2, ge=1, description="jobs that run at once on this machine; more are queued")
    max_waiting_jobs: int = Field(default=1000, ge=1, description="jobs that may wait; more are refused")
    simulate_limit_s: float = Field(default=1800.0, gt=0, description="the longest a sample may take to be made")
    inspect_limit_s: float = Field(default=3600.0, gt=0, description="the longest an inspection may take")
    planes_limit_s: float = Field(
        default=3600.0, gt=0, description="the longest that reading and finding planes may take"
    )
    solve_limit_s: float = Field(default=14400.0, gt=0, description="the longest a solve may take")
    job_memory_bytes: int | None = Field(
        default=None, ge=LEAST_MEMORY_BYTES, description="memory of one job; None: its share of the machine's"
    )
    job_file_bytes: int = Field(default=256 * GIB, gt=0, description="the largest file that a job may write")
    cancel_grace_s: float = Field(default=2.0, ge=0, description="time a cancelled job has before it is terminated")
    max_scenes: int = Field(default=16, ge=1, description="3D scenes open at once; the longest unused one closes")
    scene_idle_s: float = Field(default=900.0, gt=0, description="a scene nobody looks at closes after this time")
    displayed_points: int = Field(default=60_000, ge=1000, description="points of a cloud sent to the browser")
    upload_expiry_days: int = Field(default=5, ge=1, description="an upload that does not go on is removed after this")

    def store_url(self) -> str:
        """Where records are kept."""
        return self.database_url or f"sqlite:///{self.data_dir / 'unsweep.sqlite'}"

    def job_limits(self) -> JobLimits:
        """What one job may take of the machine."""
        memory_bytes = self.job_memory_bytes or fair_memory_bytes(self.concurrent_jobs)
        return JobLimits(memory_bytes=memory_bytes, file_bytes=self.job_file_bytes)

    def limit_s(self, kind: JobKind) -> float:
        """The longest a job of that kind may take."""
        limits: dict[JobKind, float] = {
            "simulate": self.simulate_limit_s,
            "inspect": self.inspect_limit_s,
            "planes": self.planes_limit_s,
            "solve": self.solve_limit_s,
            "audit": self.solve_limit_s,
            "surface": self.solve_limit_s,
        }
        return limits[kind]

    def is_loopback(self) -> bool:
        """Whether only programs on this machine can connect."""
        if self.host == "localhost":
            return True
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return False
