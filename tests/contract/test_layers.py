"""Who may import whom, read from the sources: the table of house-style.md, section 1, and nothing beside it."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

#: Everything may see these; presets is a table of settings.
RECORDS = {"types", "errors", "settings", "events", "result", "presets", "intrinsics"}

#: Part of calib_core -> parts it may import besides itself and RECORDS.
MAY_IMPORT = {
    **dict.fromkeys(RECORDS, RECORDS),
    "geometry": set(),
    "gp": set(),
    "imu": {"gp", "geometry"},
    "planes": {"geometry"},
    "factors": {"imu", "geometry"},
    "solver": {"geometry"},
    "documents": set(),
    "maps": {"geometry", "deskew"},
    "readers": {"maps"},
    "exporters": set(),
    "simulate": {"geometry"},
    "deskew": {"geometry"},
    "full": {"geometry", "gp", "imu", "planes", "factors", "solver", "calibrate", "deskew", "maps"},
    "paper": {"geometry", "gp", "imu", "planes", "factors", "solver", "full", "calibrate"},
    "calibrate": {"geometry", "gp", "imu", "full", "paper", "solver", "maps"},
    "doctor": {"readers", "full", "planes", "geometry", "solver", "imu", "gp", "factors"},
    "audit": {"geometry", "maps", "full", "calibrate"},
    "api": {"audit", "readers", "full", "calibrate", "deskew", "exporters", "simulate", "documents", "doctor", "maps"},
}

#: What the application sees of the library.
APP_MAY_IMPORT = RECORDS | {"api", "doctor.report", "audit.report", "audit.given", "audit.limits"}
#: Third parties by part; anything else in these lists' parts is refused.
HEAVY = {"fastapi", "starlette", "uvicorn", "viser", "sqlalchemy", "typer", "rich", "tuspyserver", "websockets"}


def imports_of(path):
    """Dotted names a module imports, with whether each import is inside a function."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    inside = {
        id(node)
        for function in ast.walk(tree)
        if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef)
        for node in ast.walk(function)
    }
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found += [(alias.name, id(node) in inside) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            base = node.module or ""
            found += [(f"{base}.{alias.name}", id(node) in inside) for alias in node.names]
    return found


def sources(package):
    return sorted((ROOT / package).rglob("*.py"))


def core_part(path):
    return path.relative_to(ROOT / "calib_core").parts[0].removesuffix(".py")


@pytest.mark.parametrize("path", sources("calib_core"), ids=lambda path: str(path.relative_to(ROOT)))
def test_the_estimator_knows_only_what_it_may(path):
    """Mutation: `from app import settings` or `from calib_core.readers import load` in pipeline/ fails here."""
    part = core_part(path)
    for name, lazily in imports_of(path):
        top = name.split(".")[0]
        assert top not in {"app", "tests", "bench"} | HEAVY, f"{path} imports {name}"
        if top == "open3d":
            assert lazily, f"{path} imports open3d eagerly"
            assert part == "maps", f"{path} imports open3d"
        if top == "calib_core" and part != "__init__":
            other = name.split(".")[1]
            allowed = MAY_IMPORT[part] | RECORDS | {part, "__version__"}
            assert other in allowed, f"{path.relative_to(ROOT)} imports {name}; {part} may see {sorted(allowed)}"


@pytest.mark.parametrize("path", sources("app"), ids=lambda path: str(path.relative_to(ROOT)))
def test_the_application_sees_the_library_by_its_entry_points(path):
    """Mutation: `from calib_core.solver import trust_region` in app/scene fails here."""
    for name, _ in imports_of(path):
        top = name.split(".")[0]
        assert top not in {"tests", "bench"}, f"{path} imports {name}"
        if top == "calib_core":
            below = name.removeprefix("calib_core.")
            seen = any(
                below == allowed or below.startswith(allowed + ".") for allowed in APP_MAY_IMPORT | {"__version__"}
            )
            assert seen, f"{path.relative_to(ROOT)} imports {name}; the application may see {sorted(APP_MAY_IMPORT)}"


def test_scene_building_knows_no_viewer_and_routes_do_no_arithmetic():
    """Mutation: `import viser` in scene/build.py, or `import numpy` in app/api."""
    for path in sources("app/scene"):
        names = {name.split(".")[0] for name, _ in imports_of(path)}
        assert "fastapi" not in names, path
        if path.name not in {"apply.py", "page.py"}:
            assert "viser" not in names, path
    for path in sources("app/api"):
        assert not {name.split(".")[0] for name, _ in imports_of(path)} & {"numpy", "scipy", "sqlalchemy"}, path


def test_workers_start_without_numpy_so_that_thread_caps_are_in_force():
    """Mutation: `import numpy` in app/jobs/worker.py."""
    for name in ("worker", "orders", "coalesce"):
        tops = {found.split(".")[0] for found, _ in imports_of(ROOT / "app" / "jobs" / f"{name}.py")}
        assert not tops & {"numpy", "scipy", "fastapi", "viser"}


def test_every_part_of_the_library_is_in_the_table():
    """Mutation: a new package nobody placed."""
    parts = {core_part(path) for path in sources("calib_core")} - {"__init__"}
    assert parts <= set(MAY_IMPORT)
