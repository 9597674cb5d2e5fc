"""What whoever runs the server is given beside it: the image's bounds, and the list of what it is made of."""

from __future__ import annotations

import importlib.util
import itertools
import json
import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest
import yaml
from sqlalchemy import create_engine, make_url

from app.cli.parser import build_parser

ROOT = Path(__file__).resolve().parents[2]
SERVICE = yaml.safe_load((ROOT / "docker" / "compose.yaml").read_text())["services"]["unsweep"]
CLUSTER = yaml.safe_load((ROOT / "docker" / "compose.cluster.yaml").read_text())
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


def test_the_cluster_is_one_application_one_store_one_scheduler_and_two_workers():
    """All bounded, what jobs read and write under the same paths, nothing but the page reachable from outside.

    Mutations: the scheduler's port published; a worker without the data directory, or with it elsewhere; a bound left out; an
    image without the cluster's client.
    """
    services = CLUSTER["services"]
    assert {name: one.get("deploy", {}).get("replicas", 1) for name, one in services.items()} == {
        "unsweep": 1,
        "database": 1,
        "scheduler": 1,
        "worker": 2,
    }
    assert [name for name, one in services.items() if "ports" in one] == ["unsweep"]
    assert all(port.startswith("127.0.0.1:") for port in services["unsweep"]["ports"])
    assert services["worker"]["volumes"] == services["unsweep"]["volumes"]
    for name, one in services.items():
        assert one["cap_drop"] == ["ALL"], name
        assert one["mem_limit"] == one["memswap_limit"], name
        assert 0 < one["pids_limit"] <= 1024, name
        if name != "database":
            assert one["build"]["args"]["REQUIREMENTS"] == "requirements-fleet.txt"
            assert one["read_only"] is True
    assert {volume.partition(":")[0] for one in services.values() for volume in one.get("volumes", ())} >= set(
        CLUSTER["volumes"]
    )


def test_the_commands_of_the_containers_are_understood():
    """By the program's own parser and by dask's. Mutations: `--data` for `--data-dir`; an option that dask has dropped."""
    from distributed.cli import dask_scheduler, dask_worker

    for words in (SERVICE["command"], CLUSTER["services"]["unsweep"]["command"]):
        chosen = build_parser().parse_args(words)
        assert (chosen.command, str(chosen.data_dir), chosen.port) == ("serve", "/data", 8080)
    assert chosen.scheduler == "tcp://scheduler:8786"
    for name, command in (("scheduler", dask_scheduler.main), ("worker", dask_worker.main)):
        words = CLUSTER["services"][name]["entrypoint"] + CLUSTER["services"][name]["command"]
        assert words[:2] == ["dask", name]
        understood = command.make_context(name, words[2:])
        assert understood.params.get("nthreads", 1) == 1
    url = CLUSTER["services"]["unsweep"]["environment"]["UNSWEEP_DATABASE_URL"]
    assert "@database/" in url and url.startswith("postgresql+psycopg://")


def test_any_password_reaches_the_database(monkeypatch):
    """Oracle: what PostgreSQL's own library would send. Mutation: the password within the address, which an @ or a / cuts."""
    psycopg = pytest.importorskip("psycopg")
    chosen = "p@ss/w#rd:%41"

    def as_compose_does(value):
        return re.sub(r"\$\{UNSWEEP_DATABASE_PASSWORD:\?[^}]*\}", chosen, value)

    of = {name: service["environment"] for name, service in CLUSTER["services"].items() if "environment" in service}
    assert as_compose_does(of["database"]["POSTGRES_PASSWORD"]) == chosen
    monkeypatch.setenv("PGPASSWORD", as_compose_does(of["unsweep"].get("PGPASSWORD", "")))
    url = as_compose_does(of["unsweep"]["UNSWEEP_DATABASE_URL"])
    _, asked = create_engine(url).dialect.create_connect_args(make_url(url))
    usual = {option.keyword.decode(): option.val for option in psycopg.pq.Conninfo.get_defaults()}
    assert (asked["host"], asked["user"], asked["dbname"]) == ("database", "unsweep", "unsweep")
    assert asked.get("password", usual["password"].decode()) == chosen


def test_the_container_is_well_when_it_can_write_and_has_its_loops_compiled():
    """Mutations: health by a page that answers on a full disk too; loops compiled in somebody's first click; run as root."""
    assert "/readyz" in DOCKERFILE.partition("HEALTHCHECK")[2].partition("ENTRYPOINT")[0]
    assert DOCKERFILE.index("USER unsweep") < DOCKERFILE.index("RUN unsweep compile-kernels")
    assert "--require-hashes -r ${REQUIREMENTS}" in DOCKERFILE
    assert "ARG REQUIREMENTS=requirements.txt" in DOCKERFILE
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


def integrated(folder: Path, failing: str) -> subprocess.CompletedProcess[str]:
    """.ci/run with a `make` that fails at one target. The tests wait until the audit has begun, and the checks for the tests."""
    (folder / ".ci").mkdir()
    (folder / "make").write_text(
        f"""#!/bin/sh
echo make $1
touch begun-$1
case $1 in check) other=test;; test) other=audit;; *) other=$1;; esac
until [ -e begun-$other ]; do sleep 0.02; done
[ $1 = test ] && echo '=== 3 passed in 1.2s ==='
[ $1 = check ] && echo '=== 4 failed in 1.3s ==='
[ $1 = {failing} ] && exit {2 if failing == "test" else 1}
exit 0
"""
    )
    (folder / "make").chmod(0o755)
    run = shutil.copy(ROOT / ".ci" / "run", folder / ".ci" / "run")
    path = f"{folder}{os.pathsep}{os.environ['PATH']}"
    return subprocess.run([run], env={"PATH": path}, capture_output=True, text=True, timeout=60, check=False)


@pytest.mark.parametrize(("failing", "exit_code"), [("none", 0), ("check", 1), ("test", 2), ("sbom", 1), ("audit", 0)])
def test_integration_is_red_where_a_check_or_a_test_fails(tmp_path: Path, failing: str, exit_code: int):
    """An unformatted commit is red, its tests are run all the same, and their closing line is the last.

    Mutations: leave `make check`, the list or the audit out; the outcome of one of them left out, or of the audit not; stop where
    the checks fail, or forget what they say; run the tests only after them; the closing line before the list, or theirs.
    """
    done = integrated(tmp_path, failing)
    told = done.stdout.splitlines()
    assert done.returncode == exit_code
    assert [line for line in told if line.startswith("make ") and " " not in line[5:]] == [
        f"make {target}" for target in ("ready", "test", "check", "audit", "sbom")
    ]
    assert told[-1] == "=== 3 passed in 1.2s ==="
    assert ("make check did not pass; what it says is above." in told) == (failing == "check")


def test_integration_ends_where_what_it_needs_cannot_be_installed(tmp_path: Path):
    """Mutation: go on, so that the checks and the tests both try again, at once and into one place."""
    done = integrated(tmp_path, "ready")
    assert (done.returncode, done.stdout.splitlines()) == (1, ["make ready"])


def test_what_checks_and_tests_need_is_made_before_them():
    """By make's own account, in a checkout where nothing is installed: `make ready` does all that they would do first.

    Mutations: the checker's packages, the client or the compiled loops left out of `ready`.
    """

    def steps(target: str) -> list[str]:
        words = ["make", "--dry-run", "--no-print-directory", "--always-make", target]
        done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, timeout=60, check=True)
        return [line for line in done.stdout.splitlines() if not line.startswith("echo")]

    ready = steps("ready")
    own = {"check": ("ruff check", "ruff format", "mypy", "run check"), "test": ("run test", "browser", "pytest")}
    for target, ends in own.items():
        first = [line for line in steps(target) if line not in ready]
        assert [line for line in first if not any(words in line for words in ends)] == []
        assert len(first) == len(ends) or target == "test"


def test_nothing_is_installed_twice_at_once():
    """In the order in which several jobs may run what the Makefile lists. Oracle: make's own data base of rules.

    Mutations: the tests' packages not after the project; the client's modules not after the client; apt-get by two rules at once.
    """
    words = ["make", "--dry-run", "--print-data-base", "--question", "ready"]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, timeout=60, check=False)
    needs: dict[str, set[str]] = {}
    for line in done.stdout.splitlines():
        name, colon, rest = line.partition(":")
        if colon and not name.startswith(("#", "\t")) and "=" not in line:
            needs.setdefault(name, set()).update(rest.split())

    def before(name: str) -> set[str]:
        return {name}.union(*(before(other) for other in needs.get(name, ())))

    installed = [f".venv/.stamps/{name}" for name in ("venv", "requirements", "project", "test")]
    for rows in (("system-run", "system-test"), installed, ("client", "modules")):
        for earlier, later in itertools.pairwise(rows):
            assert earlier in before(later), f"{later} may run beside {earlier}"


def test_bytecode_that_pip_leaves_out_is_made_with_the_loops(monkeypatch):
    """Mutations: the step taken out of the Makefile; a name that no longer exists; a broken part ends the installation."""
    makefile = (ROOT / "Makefile").read_text()
    assert "--no-compile" in makefile
    assert "tools/first_imports.py" in makefile.partition("$(STAMPS)/kernels:")[2].partition("\n\n")[0]
    first_imports, asked = loaded("first_imports"), []

    def broken(name):
        asked.append(name)
        raise OSError

    monkeypatch.setattr(first_imports.importlib, "import_module", broken)
    first_imports.import_all()
    assert {"app.cli.serving", "open3d"} <= set(asked)
    assert all(importlib.util.find_spec(name) for name in asked)
