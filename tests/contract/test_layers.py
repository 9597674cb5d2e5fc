"""Who may import whom, read from the sources: layers, the order of the full method's stages, and no circle anywhere."""

from __future__ import annotations

import ast
from functools import lru_cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

#: Everything may see these; presets is a table of settings.
RECORDS = {
    "types",
    "errors",
    "settings",
    "events",
    "result",
    "presets",
    "intrinsics",
    "plane_kinds",
    "phrasing",
    "validation_messages",
    "stamp_rate",
    "sigmas",
    "record_files",
    "memoised",
    "growing",
    "paged",
}

#: Part of calib_core -> parts it may import besides itself and RECORDS.
MAY_IMPORT = {
    **dict.fromkeys(RECORDS, RECORDS),
    "geometry": set(),
    "gp": {"threads"},
    "imu": {"gp", "geometry", "threads"},
    "planes": {"geometry"},
    "factors": {"imu", "geometry", "threads"},
    "solver": {"geometry", "threads"},
    "contradictions": {"geometry"},
    "input_files": {"geometry", "contradictions"},
    "maps": {"geometry", "deskew", "threads"},
    "readers": {"maps", "threads"},
    "exporters": {"geometry"},
    "simulate": {"geometry"},
    "deskew": {"geometry"},
    "threads": set(),
    "message_log": set(),
    "method": {"message_log"},
    "document": {"geometry", "method"},
    "full": {
        "geometry",
        "gp",
        "imu",
        "planes",
        "factors",
        "solver",
        "method",
        "message_log",
        "deskew",
        "threads",
        "maps",
    },
    "paper": {"geometry", "gp", "imu", "planes", "factors", "solver", "full", "method"},
    "request": {"full", "planes"},
    "final_messages": {"full", "method"},
    "recording_break": {"full", "method", "message_log"},
    "calibrate": {
        "request",
        "final_messages",
        "recording_break",
        "full",
        "paper",
        "document",
        "method",
        "message_log",
        "maps",
        "solver",
        "threads",
    },
    "doctor": {"readers", "full", "planes", "geometry", "solver", "imu", "gp", "factors", "threads"},
    "audit": {"contradictions", "geometry", "input_files", "maps", "full", "calibrate"},
    "api": {
        "audit",
        "readers",
        "full",
        "request",
        "calibrate",
        "deskew",
        "exporters",
        "simulate",
        "input_files",
        "doctor",
        "maps",
    },
}

#: The full method in reading order: a stage knows those before it and the ground, never one after it.
STAGES = (
    "run",
    "prepare",
    "planes",
    "odometry",
    "initialise",
    "joint",
    "assess",
    "attempts",
    "calibrate",
    "clock_skew",
    "forecast_by_choice",
    "forecast",
    "known_extrinsic",
)
#: What the application sees of the library. threads: how many cores there are; it imports nothing.
APP_MAY_IMPORT = RECORDS | {
    "api",
    "doctor.report",
    "audit.report",
    "audit.given",
    "audit.pose",
    "audit.limits",
    "threads",
}
#: Third parties by part; anything else in these lists' parts is refused.
HEAVY = {"fastapi", "starlette", "uvicorn", "viser", "sqlalchemy", "typer", "rich", "websockets", "distributed"}


@lru_cache
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
        if path.name not in {"apply.py", "embedded_viser.py", "nodes.py", "page.py", "viser_poses.py"}:
            assert "viser" not in names, path
    for path in sources("app/api"):
        assert not {name.split(".")[0] for name, _ in imports_of(path)} & {"numpy", "scipy", "sqlalchemy"}, path


def test_what_jobs_are_ordered_and_told_by_is_no_business_of_numerics_or_the_web():
    """Mutation: `import numpy` in app/jobs/worker.py."""
    for name in ("worker", "orders", "coalesce"):
        tops = {found.split(".")[0] for found, _ in imports_of(ROOT / "app" / "jobs" / f"{name}.py")}
        assert not tops & {"numpy", "scipy", "fastapi", "viser"}


def test_a_server_starts_without_what_only_answers_need():
    """A server that was killed is to be up again soon: SciPy is a quarter of its start. Mutation: `import scipy` on top."""
    for path in sources("app"):
        if "migrations" in path.parts:  # Alembic's own, loaded by it where a store is brought up
            continue
        eager = {name.split(".")[0] for name, lazily in imports_of(path) if not lazily}
        assert not eager & {"scipy", "open3d", "alembic"}, path


def test_no_test_needs_another_ones_module():
    """What two of them share is in a module of its own. Mutation: an import of a helper beside the tests that it was made for."""
    shared = [
        f"{path.relative_to(ROOT)}: {name}"
        for path in sorted((ROOT / "tests").rglob("*.py"))
        for name, _ in imports_of(path)
        if name.startswith("tests.") and any(part.startswith("test_") for part in name.split("."))
    ]
    assert shared == []


def test_every_part_of_the_library_is_in_the_table():
    """Mutation: a new package nobody placed."""
    parts = {core_part(path) for path in sources("calib_core")} - {"__init__"}
    assert parts <= set(MAY_IMPORT)


def stage(name):
    """The stage of the full method that a dotted name belongs to; none for the package itself."""
    parts = name.split(".")
    return parts[2] if parts[:2] == ["calib_core", "full"] and len(parts) > 2 else None


def test_the_stages_of_the_full_method_are_a_staircase():
    """Mutations: `from calib_core.full.assess.observability import assess` in joint/; a stage that nobody placed."""
    for path in sources("calib_core/full"):
        own = stage(module_name(path))
        if own is None:
            continue
        assert own in STAGES, f"{path}: say in STAGES where {own} stands"
        for name, _ in imports_of(path):
            other = stage(name)
            if other is not None:
                assert STAGES.index(other) <= STAGES.index(own), (
                    f"{path.relative_to(ROOT)} imports {name}: up the stairs"
                )


@pytest.mark.parametrize(("file", "function", "least"), [("calibrate", "by_planes", 6), ("attempts", "judged", 2)])
def test_the_page_enters_the_stages_in_their_order(file, function, least):
    """From top to bottom, each once; records may be made before they are of use. Mutations: ask assess/ whether the lidar moved
    before initialise/ is entered; the answer made before planes are judged in joint/.
    """
    path = ROOT / "calib_core/full" / f"{file}.py"
    tree = ast.parse(path.read_text(encoding="utf-8"))
    stage_of = {name.rpartition(".")[2]: stage(name) for name, _ in imports_of(path) if stage(name)}
    (page,) = (node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name == function)
    calls = [node for node in ast.walk(page) if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)]
    calls = [node for node in calls if node.func.id[0].islower()]
    calls.sort(key=lambda node: (node.lineno, node.col_offset))
    entered = [STAGES.index(stage_of[node.func.id]) for node in calls if node.func.id in stage_of]
    assert len(entered) >= least
    assert entered == sorted(entered)


@pytest.mark.parametrize("package", ["calib_core", "app", "bench"])
def test_no_import_runs_in_a_circle(package):
    """Of files or of folders, inside functions and as strings too.

    Mutations: `from calib_core.calibrate import calibrate` in full/known_extrinsic.py; the same as
    `importlib.import_module("calib_core.calibrate")` in a function.
    """
    files = import_graph(package)
    found = [sorted(circle) for circle in (*circles(files), *circles(by_folder(files)))]
    assert found == [], f"imports run in a circle: {found}"


def test_circles_are_seen():
    """Mutations: follow one import only; count a file that imports itself; look at files, but not at folders."""
    assert circles({"a": {"b"}, "b": {"c", "d"}, "c": {"a"}, "d": {"d"}}) == [{"a", "b", "c"}]
    staircase = {"x.one.p": {"x.two.q"}, "x.two.q": set(), "x.two.r": {"x.one.s"}, "x.one.s": set()}
    assert circles(staircase) == []
    assert circles(by_folder(staircase)) == [{"x.one", "x.two"}]


def module_name(path):
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@lru_cache
def import_graph(package):
    """Modules of a package, and which of its modules each of them imports, by statement or by name in a string."""
    known = {module_name(path): path for path in sources(package)}
    graph = {}
    for module, path in known.items():
        strings = {
            node.value
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value in known
        }
        found = {nearest(name, known) for name in {name for name, _ in imports_of(path)} | strings}
        graph[module] = found - {module, package, ""}
    return graph


def nearest(name, known):
    """The module that a dotted name is, or is in."""
    while name and name not in known:
        name = name.rpartition(".")[0]
    return name


def by_folder(graph):
    """The same imports between folders; files beside folders stand for themselves."""
    parents = {name.rpartition(".")[0] for name in graph}

    def folder(name):
        own = name if name in parents else name.rpartition(".")[0]
        return name if any(other.startswith(own + ".") for other in parents) else own

    out = {}
    for name, found in graph.items():
        out.setdefault(folder(name), set()).update(folder(other) for other in found)
    return {name: found - {name} for name, found in out.items()}


def circles(graph):
    """Groups of two or more that can be reached from one another."""

    def reached(start):
        seen, ahead = set(), [start]
        while ahead:
            for other in graph.get(ahead.pop(), set()):
                if other not in seen:
                    seen.add(other)
                    ahead.append(other)
        return seen

    reach = {name: reached(name) for name in graph}
    found = []
    for name in graph:
        group = {other for other in reach[name] if name in reach.get(other, set())} | {name}
        if len(group) > 1 and group not in found:
            found.append(group)
    return found


#: The application's rooms from the ground up; each may see those before it.
APP_ROOMS = (
    "schemas",
    "axes",
    "errors",
    "limits",
    "process",
    "children",
    "locks",
    "logs",
    "settings",
    "storage",
    "events",
    "bus",
    "arrays",
    "jobs",
    "planes",
    "results",
    "uploads",
    "recordings",
    "kernels",
    "fleet",
    "compiling",
    "work",
    "scene",
    "server",
    "api",
    "application",  # puts the rooms together
    "openapi",
    "cli",
)


def app_room(dotted):
    """The room of a dotted name below app; the longest that fits."""
    fitting = [room for room in APP_ROOMS if dotted == room or dotted.startswith(room + ".")]
    return max(fitting, key=len, default=None)


@pytest.mark.parametrize("path", sources("app"), ids=lambda path: str(path.relative_to(ROOT)))
def test_the_application_s_rooms_see_only_those_below(path):
    """With rooms in a row there is no circle. Mutation: `from app.server.errors import ApiError` in app/jobs."""
    dotted = ".".join(path.relative_to(ROOT / "app").with_suffix("").parts).removesuffix(".__init__")
    room = app_room(dotted)
    if dotted == "__init__":
        return
    assert room is not None, f"{dotted} has no place in APP_ROOMS"
    for name, _ in imports_of(path):
        if name.startswith("app."):
            other = app_room(name.removeprefix("app."))
            assert other is not None, f"{dotted} imports {name}, which has no place in APP_ROOMS"
            assert APP_ROOMS.index(other) <= APP_ROOMS.index(room), f"{dotted} ({room}) imports {name} ({other})"
