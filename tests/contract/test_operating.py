"""What whoever runs the server is given beside it: the image's bounds, and the list of what it is made of."""

from __future__ import annotations

import importlib.util
import json
import re
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parents[2]
SERVICE = yaml.safe_load((ROOT / "docker" / "compose.yaml").read_text())["services"]["unsweep"]
DOCKERFILE = (ROOT / "docker" / "Dockerfile").read_text()


def test_the_container_is_bounded_and_may_write_in_few_places():
    """Mutations: a bound left out; the whole file system writable; swap beside the memory."""
    assert SERVICE["read_only"] is True
    assert SERVICE["cap_drop"] == ["ALL"]
    assert SERVICE["security_opt"] == ["no-new-privileges:true"]
    assert SERVICE["mem_limit"] == SERVICE["memswap_limit"]
    assert 0 < SERVICE["pids_limit"] <= 1024
    assert all("size=" in mount and "nosuid" in mount for mount in SERVICE["tmpfs"])
    assert all(port.startswith("127.0.0.1:") for port in SERVICE["ports"])


def test_the_container_is_well_when_it_can_write_and_has_its_loops_compiled():
    """Mutations: health by a page that answers on a full disk too; loops compiled in somebody's first click; run as root."""
    assert "/readyz" in DOCKERFILE.partition("HEALTHCHECK")[2].partition("ENTRYPOINT")[0]
    assert DOCKERFILE.index("USER unsweep") < DOCKERFILE.index("RUN unsweep compile-kernels")
    assert "--require-hashes -r requirements.txt" in DOCKERFILE
    assert {line.split()[1] for line in DOCKERFILE.splitlines() if line.startswith("FROM")} == {"${BASE}"}


def test_the_list_of_parts_has_every_pin_with_its_hashes():
    """Oracle: the lock file, counted another way. Mutation: continued lines not joined: no hashes."""
    spec = importlib.util.spec_from_file_location("sbom", ROOT / "tools" / "sbom.py")
    sbom = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(sbom)
    told = json.loads(json.dumps(sbom.document()))
    text = (ROOT / "requirements.txt").read_text()
    pins = re.findall(r"^([\w.-]+)==([\w.]+)", text, re.MULTILINE)
    assert [(part["name"], part["version"]) for part in told["components"]] == [(n.lower(), v) for n, v in pins]
    assert sum(len(part["hashes"]) for part in told["components"]) == text.count("--hash=sha256:")
    assert sum("licenses" in part for part in told["components"]) > 0.9 * len(pins)
