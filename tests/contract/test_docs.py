"""The pages say what the code is: the table of numbers, the files they name, the codes of refusals."""

from __future__ import annotations

import ast
import io
import re
import tokenize
from pathlib import Path

import pytest

from bench import sensitivity
from tools import presets
from tools.steering import PAGE, RECORDS, SOURCES, loose, loose_in, numbers, with_table

ROOT = Path(__file__).resolve().parents[2]
PAGES = (
    "README.md",
    "docs/accuracy.md",
    "docs/how-it-works.md",
    "docs/performance.md",
    "docs/architecture.md",
    "docs/contract.md",
    "docs/fleets.md",
    "docs/formats.md",
    "docs/security.md",
    "tests/README.md",
    "calib_core/CONVENTIONS.md",
)
#: Fewer words than these say of no file what it is for.
FEWEST_WORDS = 3
#: Files of other programs that are spoken of.
ELSEWHERE = {"IccSensors.py"}
#: Files that the program writes, or has at its address.
WRITTEN = {"planes.json", "/api/openapi.json", "NAME.json", "summary.csv", "summary.json"}
#: Where a page's bare file names may be.
FOLDERS = ("", "calib_core", "calib_core/full", *(f"calib_core/full/{room}" for room in (
    "prepare", "planes", "odometry", "initialise", "joint", "assess"
)), "bench/results", "docs", "calib_core/readers/container")  # fmt: skip


def test_the_table_of_numbers_is_that_of_the_records() -> None:
    """Mutations: change a number in a record, or add one, without `python -m tools.steering`."""
    page = PAGE.read_text(encoding="utf-8")
    assert with_table(page) == page


def test_the_tables_of_sensors_are_those_of_the_presets() -> None:
    """Mutations: change a density or a word of a preset, or add one, without `python -m tools.presets`."""
    page = presets.PAGE.read_text(encoding="utf-8")
    assert presets.with_tables(page) == page


def test_every_number_has_its_reason() -> None:
    """Mutation: a field at the top of a record without a comment."""
    found = list(numbers())
    assert {(n.stage, n.record) for n in found} == {(stage, record) for stage, _, record in RECORDS}
    assert [f"{n.record}.{n.name}" for n in found if not n.reason] == []


def test_every_reason_begins_with_where_its_number_comes_from() -> None:
    """Mutation: a reason that only describes, "Points of each scan."."""
    assert [f"{n.record}.{n.name}" for n in numbers() if not n.reason.startswith(SOURCES)] == []


def test_what_is_judged_has_its_sensitivity_measured() -> None:
    """At the value it has, by `python -m bench.sensitivity`. Mutation: change a judged number's value, or judge one more."""
    rows = sensitivity.read()
    judged = [n for n in numbers() if sensitivity.is_judged(n)]
    assert len(judged) > 100
    assert [n.name for n in judged if rows.get(sensitivity.name_of(n), {}).get("value") != n.value] == []


def test_no_number_steers_from_outside_the_records() -> None:
    """Mutations: `len(x) < 10` in a stage; `_ENOUGH = 0.6` above it; a record taken off RECORDS."""
    assert list(loose()) == []


def test_loose_numbers_are_seen_and_structure_is_not() -> None:
    """Mutations: let comparisons through as coefficients are; count the fields of any class, or every call's numbers."""
    steering = (
        "_ENOUGH = 0.6",
        "few = len(x) < 10",
        "y = max(x, 8)",
        "y = 4.7 * x",
        "for k in range(20): pass",
        "y = f(x, 0.02)",
        "def f(x, least=12): pass",
        "y = np.radians(20.0)",
        "class Other:\n    field_m: float = 0.25",
    )
    structure = (
        "y = 0.5 * x[5:7] / 2.0",
        "y = np.zeros((5, 9))",
        "y = 1e3 * x",
        "y = t**3 / 6",
        "y = f'{x:.4f} {7 * x}'",
        "y = np.maximum(x, 1e-12)",
        "class Known:\n    field_m: float = 0.25",
        "UNITS = (0.01, 8)",
    )
    assert [len(loose_in(source, {"Known"})) for source in steering] == [1] * len(steering)
    assert [loose_in(source, {"Known"}) for source in structure] == [[]] * len(structure)


@pytest.mark.parametrize("page", PAGES)
def test_every_file_that_a_page_names_is_there(page: str) -> None:
    """Mutation: a file moved, and its name left in the page."""
    text = (ROOT / page).read_text(encoding="utf-8")
    named = set(re.findall(r"`([\w./-]+\.(?:py|md|csv|json))", text)) - WRITTEN
    missing = [name for name in sorted(named) if not any((ROOT / folder / name).is_file() for folder in FOLDERS)]
    assert missing == []


def test_every_room_has_its_place_in_the_architecture() -> None:
    """Mutations: a new file beside app/bus.py, or a new folder in calib_core; one that went, still in the list."""
    text = (ROOT / "docs/architecture.md").read_text(encoding="utf-8")
    for package in ("calib_core", "app"):
        (listed,) = re.findall(rf"^{package}/\n((?:  .*\n)+)", text, re.MULTILINE)
        named = [name for line in listed.splitlines() for name in re.split(r"  +", line.strip())[:-1]]
        folder = ROOT / package
        rooms = {f"{path.parent.name}/" for path in folder.glob("*/*.py")}
        files = {path.name for path in folder.glob("*.py")} - {"__init__.py"}
        assert sorted(named) == sorted(rooms | files)


def test_every_room_and_every_file_says_what_it_is_for() -> None:
    """Mutations: a folder whose `__init__` is empty; a file's docstring of which a rename left the full stop."""
    silent = []
    for package in ("calib_core", "app", "bench"):
        for path in sorted((ROOT / package).rglob("*.py")):
            told = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
            if len(re.findall(r"\w+", told.partition("\n")[0])) < FEWEST_WORDS:
                silent.append(path.relative_to(ROOT).as_posix())
    assert silent == []


def test_three_questions_are_answered_by_two_files_each() -> None:
    """The page, at the stage that is named, names the file in bold words; the file is there.

    Mutations: a file of the table moved; its name taken out of its stage; the stage's number changed.
    """
    text = (ROOT / "docs/architecture.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| [^|]+\? \| `([\w./-]+)`, stage (\d) \| `([\w./]+)` \|$", text, re.MULTILINE)
    assert len(rows) == 3
    for page, stage, file in rows:
        told = (ROOT / page).read_text(encoding="utf-8").partition(f"\n## {stage}. ")[2].partition("\n## ")[0]
        answers = ["".join(each) for each in re.findall(r"\*\*(.+?)\*\*([^*]{0,30})", told, re.DOTALL)]
        assert any(f"`{Path(file).name}`" in answer for answer in answers), (stage, file)
        assert (ROOT / file).is_file()


@pytest.mark.parametrize("page", PAGES)
def test_every_page_and_picture_that_is_linked_is_there(page: str) -> None:
    """Mutation: a picture renamed."""
    path = ROOT / page
    linked = re.findall(r"\]\(([^)#:]+)\)", path.read_text(encoding="utf-8"))
    assert [name for name in linked if not (path.parent / name).is_file()] == []
    assert linked or page != "docs/how-it-works.md"


def test_every_file_that_a_docstring_or_a_comment_names_is_there() -> None:
    """But for pages that a campaign writes. Mutations: a file moved, and its name left in a docstring; look at no comments."""
    there = ["/" + path.relative_to(ROOT).as_posix() for path in _sources()]
    missing = [
        f"{path.relative_to(ROOT)}: {name}"
        for path in _sources()
        if path.suffix == ".py"
        for text in _prose(path.read_text(encoding="utf-8"))
        for name in re.findall(r"(?<![\w*{<>.-])((?:[\w-]+/)*[\w-]+\.(?:py|md))\b", text)
        if name not in ELSEWHERE
        and not (path.is_relative_to(ROOT / "bench") and name.endswith(".md"))
        and not any(other.endswith("/" + name) for other in there)
    ]
    assert missing == []


def _sources() -> list[Path]:
    folders = ("calib_core", "app", "bench", "tools", "tests", "docs")
    return [
        *ROOT.glob("*.*"),
        *(p for folder in folders for p in (ROOT / folder).rglob("*.*") if p.suffix in {".py", ".md"}),
    ]


def _prose(source: str) -> list[str]:
    """Docstrings and comments, of a source that may name a file."""
    if not re.search(r"\.(?:py|md)\b", source):
        return []
    kinds = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef
    told = [ast.get_docstring(node) or "" for node in ast.walk(ast.parse(source)) if isinstance(node, kinds)]
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    return told + [token.string for token in tokens if token.type == tokenize.COMMENT]


def test_every_field_and_argument_that_a_docstring_explains_is_there() -> None:
    """Mutations: a field renamed, and its old name left in the docstring; the end of a sentence taken for a name's."""
    unknown = [
        f"{path.relative_to(ROOT)}: {name}"
        for package in ("calib_core", "app", "bench", "tools")
        for path in sorted((ROOT / package).rglob("*.py"))
        for name in explained_but_unknown(path.read_text(encoding="utf-8"))
    ]
    assert unknown == []


def test_a_field_that_is_gone_is_seen() -> None:
    """Mutations: read classes only; take a name in the docstring itself for a use; the first of several names alone."""
    gone = (
        'class A:\n    """One.\n\n    left, size_m: (N,).   gone: (3,).\n    """\n\n    left: int\n    size_m: float',
        'def f(left):\n    """One. left: of it.   gone: no longer."""',
        'class A:\n    """One.   left, gone: both."""\n\n    left: int',
    )
    assert [explained_but_unknown(source) for source in gone] == [["gone"]] * 3
    assert explained_but_unknown('def f(left):\n    """One is (N,), as said below: two.   Mutation: three."""') == []


def explained_but_unknown(source: str) -> list[str]:
    """Names that a docstring explains, `name: ...` at the start of a line or a sentence, and that its code does not have."""
    unknown = []
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        told = ast.get_docstring(node)
        if told is None or not (rows := re.findall(r"(?:^|   |\. )([a-z]\w*(?:, [a-z]\w*)*): ", told, re.MULTILINE)):
            continue
        has = set(re.findall(r"\w+", "\n".join(ast.unparse(each) for each in node.body[1:])))
        if not isinstance(node, ast.ClassDef):
            has |= set(re.findall(r"\w+", ast.unparse(node.args)))
        unknown += [name for row in rows for name in row.split(", ") if name not in has]
    return unknown


def test_the_codes_of_refusals_are_all_on_the_page() -> None:
    """Mutation: a new `Refused("some.code", ...)` that the page does not know."""
    page = (ROOT / "docs/architecture.md").read_text(encoding="utf-8")
    sources = [path.read_text(encoding="utf-8") for path in (ROOT / "calib_core").rglob("*.py")]
    codes = {code for text in sources for code in re.findall(r'(?:Refused|_refuse)\(\s*"([a-z_]+\.[a-z_]+)"', text)}
    codes |= {code for text in sources for code in re.findall(r'Refused\(\s*"([a-z_]+\.[a-z_]+)"', text)}
    assert len(codes) > 10
    assert [code for code in sorted(codes) if f"`{code}`" not in page] == []


def test_how_cost_grows_is_quoted_from_its_page_and_by_its_date() -> None:
    """Oracle: the table of lengths in growth.md. Mutations: the page's figures, or its day, changed alone."""
    page = (ROOT / "bench/results/growth.md").read_text(encoding="utf-8")
    lengths = page.partition("| s | planes used |")[2].partition("\n\n")[0]
    rows = {cells[1]: cells for line in lengths.splitlines() if len(cells := [c.strip() for c in line.split("|")]) > 9}
    minute, ten, half_hour = (rows[size] for size in ("60", "600", "1800"))
    (day,) = re.findall(r"Measured on (\d{4}-\d\d-\d\d)", page)
    times = [float(row[5]) / float(minute[5]) for row in (ten, half_hour)]
    memory_gb = [f"{float(row[9]) / 1e3:.1f}" for row in (minute, ten, half_hour)]
    text = " ".join((ROOT / "docs/performance.md").read_text(encoding="utf-8").split())
    assert f"measured on {day}" in text
    assert f"ten minutes take {times[0]:.1f} times as long as one, half an hour {times[1]:.0f} times" in text
    assert f"memory was {memory_gb[0]}, {memory_gb[1]} and {memory_gb[2]} GB" in text


def test_what_a_night_needs_is_reckoned_from_the_table_of_costs() -> None:
    """Oracle: the rows of bench/results/fleet.md. Mutations: a row, or the plan, changed alone."""
    costs = (ROOT / "bench/results/fleet.md").read_text(encoding="utf-8")
    plan = (ROOT / "docs/fleets.md").read_text(encoding="utf-8")
    row = r"^\| (20|60) s \| (\d+ MB) \| ([\d.]+) s \| [\d.]+ s \| (\d+ MB) \| (\d+ MB) \| (\d+ MB) \|"
    rows = re.findall(row, costs, re.MULTILINE)
    assert [of[0] for of in rows] == ["20", "60"]
    for length, file, cpu_s, *others in rows:
        assert f"| {length} s | {file} | {cpu_s} s | {' | '.join(others)} |" in plan
    hours = [round(10_000 * float(of[2]) / 3600.0) for of in rows]
    night = re.search(
        r"^\| CPU \| (\d+) core hours: (\d+) cores; .* \| (\d+) core hours: (\d+) cores; ", plan, re.MULTILINE
    )
    assert night is not None
    needed = [each for hour in hours for each in (hour, -(-hour // 10))]
    assert [int(each) for each in night.groups()] == needed
