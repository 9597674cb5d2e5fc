"""What whoever runs the server is given beside it: the image's bounds, and the list of what it is made of."""

from __future__ import annotations

import importlib.util
import json
import re
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
SERVICE = yaml.safe_load((ROOT / "docker" / "compose.yaml").read_text())["services"]["unsweep"]
DOCKERFILE = (ROOT / "docker" / "Dockerfile").read_text()
FLAW = {"id": "CVE-1", "fix_versions": ["2"]}


def loaded(name):
    """A tool as a module."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "tools" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


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
    told = json.loads(json.dumps(loaded("sbom").document()))
    text = (ROOT / "requirements.txt").read_text()
    pins = re.findall(r"^([\w.-]+)==([\w.]+)", text, re.MULTILINE)
    assert [(part["name"], part["version"]) for part in told["components"]] == [(n.lower(), v) for n, v in pins]
    assert sum(len(part["hashes"]) for part in told["components"]) == text.count("--hash=sha256:")
    assert sum("licenses" in part for part in told["components"]) > 0.9 * len(pins)


@pytest.mark.parametrize(
    ("code", "out", "err", "exit_code", "words"),
    [
        (0, [{"name": "a", "version": "1", "vulns": []}], "", 0, "No known vulnerability in 1 pinned versions"),
        (1, [{"name": "a", "version": "1", "vulns": [FLAW]}], "", 1, "a 1: CVE-1, mended in 2"),
        (0, [{"name": "a", "skip_reason": "not on PyPI"}], "", 0, "were not audited: the package index"),
        (1, None, "requests.exceptions.ConnectionError: Max retries", 0, "were not audited"),
        (1, None, "timed out after 180 s", 0, "were not audited"),
        (1, None, "ValueError: a hash is none", 2, "could not be audited: ValueError"),
    ],
)
def test_an_audit_without_a_network_says_so_and_does_not_fail(code, out, err, exit_code, words):
    """What pip-audit leaves behind, taken down from it. Mutations: an advisory that fails nothing; no network taken for no
    advisory, or for a defect; a defect taken for no network; an index that knows none of the pins taken for a clean one.
    """
    audit = loaded("audit")
    told = "" if out is None else json.dumps({"dependencies": out})
    got, sentences = audit.verdict(code, told, err)
    assert got == exit_code
    assert words in sentences


def test_integration_lists_and_audits_the_parts_after_the_tests():
    """Mutations: either left out of .ci/run; pytest's closing line printed before them."""
    run = (ROOT / ".ci" / "run").read_text()
    order = [run.index(words) for words in ("make test", "make sbom", "make audit", "grep -E")]
    assert order == sorted(order)
