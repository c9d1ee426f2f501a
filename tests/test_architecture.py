"""The house stays as drawn: who may import whom, which door leads where, and how long a file is."""

import ast
import functools
import re
from collections.abc import Iterator, Mapping
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

ROOT = Path(__file__).parents[1]
LAYERS = {
    "records": 0, "terrain": 0, "rotations": 0, "smoothing": 0, "noise": 0, "registry": 0, "errors": 0,
    "files": 0, "quantities": 0, "options": 0, "validation": 0, "seals": 0, "faults": 0, "outputs": 0,
    "run_identity": 0,
    "robots": 1,
    "effects": 2, "tasks": 2, "data": 2, "truth_simulator": 2,
    "dynamics": 3,
    "evaluation": 4, "robot_link": 4,
    "control": 5, "training": 5, "diagnosis": 5, "results": 5,
    "reports": 6,
    "runtime": 7,
    "demo": 8,
    "cli": 9,
}  # fmt: skip
ENTRY_POINTS = 10  # what is not in the package
SHARED_ROWS = {0}  # rows whose packages may import each other
DOORS = {
    "ray": ("flywheel/runtime/pool/ray_backend.py",),
    "mlflow": ("flywheel/runtime/tracking/mlflow_client.py",),
    "zarr": ("flywheel/data/zarr_files.py",),
    "mujoco": (
        "flywheel/robots/",
        "flywheel/dynamics/plant/",
        "flywheel/effects/",
        "flywheel/truth_simulator/",
        "benchmarks/speed/",
        "benchmarks/sysid/",
    ),
}
# How MuJoCo adds elements; `add_plain` in flywheel/robots/added.py asks for them by other means.
ADDING = {
    name
    for kind in (mujoco.MjSpec, mujoco.MjsBody)
    for name in dir(kind)
    if name.startswith("add_")
}
parsed = functools.cache(ast.parse)
LONGEST_FILE = 600
LONGEST_FUNCTION = 60
ABSOLUTE = re.compile(r"^/(work|home|root|tmp|usr|opt|var|mnt|data|Users)\b|^[A-Z]:\\")


def sources(*folders: str) -> list[Path]:
    return sorted(path for folder in folders for path in (ROOT / folder).rglob("*.py"))


def relative(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def imports(tree: ast.AST) -> Iterator[tuple[str, int]]:
    """Full names of what is imported, `a.b` also for `from a import b`, with the line."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((alias.name, node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            if node.level:
                yield "." * node.level, node.lineno
            else:
                yield from ((f"{node.module}.{alias.name}", node.lineno) for alias in node.names)


def package_of(path: str) -> str:
    """`robots` of flywheel/robots/robot.py; `records` of flywheel/records.py."""
    return path.split("/")[1].removesuffix(".py")


def wrong_imports(path: str, source: str) -> list[str]:
    """What a file imports though its row may not, as sentences."""
    wrong = []
    inside = path.startswith("flywheel/") and package_of(path) != "__init__"
    own = package_of(path) if inside else ""
    row = LAYERS.get(own, ENTRY_POINTS)
    for name, line in imports(parsed(source)):
        top, *rest = name.split(".")
        where = f"{path}:{line} imports {name}"
        if top == "":
            wrong.append(f"{where}: imports are absolute here")
        if top in DOORS and not path.startswith(DOORS[top]):
            wrong.append(f"{where}: only {' and '.join(DOORS[top])} may")
        if inside and top in ("benchmarks", "pipelines", "tests"):
            wrong.append(f"{where}: nothing imports the entry points")
        other = rest[0] if rest else ""
        if not inside or top != "flywheel" or other == own or other not in LAYERS:
            continue
        if LAYERS[other] > row:
            wrong.append(f"{where}: row {row} may not import row {LAYERS[other]}")
        elif LAYERS[other] == row and row not in SHARED_ROWS:
            wrong.append(f"{where}: packages of row {row} do not know each other")
    return wrong


def test_a_file_imports_only_from_rows_above_and_through_its_doors() -> None:
    files = sources("flywheel", "benchmarks", "pipelines")
    assert [w for path in files for w in wrong_imports(relative(path), path.read_text())] == []


@pytest.mark.parametrize(
    ("path", "source"),
    [
        ("flywheel/robots/robot.py", "from flywheel.dynamics import baselines"),
        ("flywheel/robots/robot.py", "def f():\n    import flywheel.data.store"),
        ("flywheel/tasks/reach.py", "from flywheel.data import TrajectoryStore"),
        ("flywheel/training/loss.py", "from flywheel.control import Mppi"),
        ("flywheel/control/mppi.py", "from flywheel import training"),
        ("flywheel/records.py", "from flywheel.robots import Robot"),
        ("flywheel/data/store.py", "import zarr.storage"),
        ("flywheel/runtime/loop.py", "from ray import util"),
        ("flywheel/reports/page.py", "import mlflow"),
        ("flywheel/reports/page.py", "from flywheel.runtime.loop import run"),
        ("flywheel/results.py", "from flywheel.reports import write_page"),
        ("flywheel/control/gaits.py", "from mujoco import MjModel"),
        ("flywheel/cli/list.py", "import mujoco"),
        ("flywheel/runtime/loop.py", "from flywheel.cli import main"),
        ("flywheel/data/store.py", "from . import windows"),
    ],
)
def test_a_forbidden_import_is_found(path: str, source: str) -> None:
    assert len(wrong_imports(path, source)) == 1


@pytest.mark.parametrize(
    ("path", "source"),
    [
        ("flywheel/dynamics/gnn/graph.py", "from flywheel.robots import Robot"),
        ("flywheel/dynamics/gnn/graph.py", "from flywheel.dynamics.protocol import Dynamics"),
        ("flywheel/dynamics/plant/plant.py", "import mujoco"),
        ("flywheel/rotations.py", "from flywheel.errors import DataError"),
        ("flywheel/reports/page.py", "from flywheel.results import RunResult"),
        ("flywheel/cli/runs/run.py", "from flywheel.runtime import loop"),
    ],
)
def test_an_allowed_import_passes(path: str, source: str) -> None:
    assert wrong_imports(path, source) == []


def module_of(path: Path) -> str:
    """`flywheel.robots` of flywheel/robots/__init__.py; `flywheel.robots.robot` of its robot.py."""
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def import_graph(sources: Mapping[str, str]) -> dict[str, set[str]]:
    """Module -> those that it imports, anywhere in its file, from {module: its source}."""
    graph: dict[str, set[str]] = {}
    for module, source in sources.items():
        found = set()
        for name, _ in imports(parsed(source)):
            owner = name if name in sources else name.rpartition(".")[0]
            if owner in sources:
                found.add(owner)
        graph[module] = found
    return graph


def cycles(graph: dict[str, set[str]]) -> list[list[str]]:
    """Groups of modules that import each other in a circle: strongly connected, and more than one."""
    names = sorted(graph)
    place = {name: index for index, name in enumerate(names)}
    edges = [(place[name], place[other]) for name, others in graph.items() for other in others]
    rows, columns = np.array(edges).T
    matrix = coo_array((np.ones(len(edges)), (rows, columns)), shape=(len(names), len(names)))
    _, labels = connected_components(matrix, connection="strong")
    groups = [[n for n, own in zip(names, labels, strict=True) if own == k] for k in set(labels)]
    return sorted(group for group in groups if len(group) > 1)


def test_no_files_import_each_other_in_a_circle() -> None:
    graph = import_graph({module_of(path): path.read_text() for path in sources("flywheel")})
    assert cycles(graph) == []


def of_folders(graph: Mapping[str, set[str]], depth: int) -> dict[str, set[str]]:
    """The graph of the folders that deep below the top, of files above them, and of what they import."""

    def place(module: str) -> str:
        return ".".join(module.split(".")[:depth])

    folders: dict[str, set[str]] = {place(module): set() for module in graph}
    for module, others in graph.items():
        folders[place(module)] |= {place(other) for other in others} - {place(module)}
    return folders


def test_no_folders_import_each_other_in_a_circle() -> None:
    graph = import_graph({module_of(path): path.read_text() for path in sources("flywheel")})
    deepest = max(module.count(".") for module in graph)
    for depth in range(3, deepest + 1):  # rows above say it of the packages
        assert cycles(of_folders(graph, depth)) == [], depth


def test_a_circle_of_folders_is_found() -> None:
    files = {
        "f.p.a.one": "import f.p.b.one",
        "f.p.b.one": "",
        "f.p.b.two": "import f.p.a.two",
        "f.p.a.two": "import f.q",
        "f.q": "",
    }
    assert cycles(import_graph(files)) == []
    assert cycles(of_folders(import_graph(files), 3)) == [["f.p.a", "f.p.b"]]


def test_a_circle_of_imports_is_found() -> None:
    files = {
        "p.a": "from p import b",
        "p.b": "def f():\n    from p.c import name",
        "p.c": "import p.a",
        "p.d": "from p import a",
    }
    assert cycles(import_graph(files)) == [["p.a", "p.b", "p.c"]]


def silent_imports(source: str) -> list[str]:
    """Imports inside functions without a comment that says why: beside them, or in the line above."""
    lines = source.splitlines()
    functions = (ast.FunctionDef, ast.AsyncFunctionDef)
    inside = {
        node.lineno: node.end_lineno or node.lineno
        for function in ast.walk(parsed(source))
        if isinstance(function, functions)
        for node in ast.walk(function)
        if isinstance(node, ast.Import | ast.ImportFrom)
    }
    silent, explained = [], set()
    for line, end in sorted(inside.items()):
        above = lines[line - 2].strip()
        beside = any("#" in each for each in lines[line - 1 : end])
        if beside or above.startswith("#") or line - 1 in explained:
            explained |= set(range(line, end + 1))  # one comment serves a block of imports
        else:
            silent.append(f"{line}: {lines[line - 1].strip()}")
    return silent


def test_an_import_inside_a_function_says_why() -> None:
    """Except in flywheel/cli: every command imports what it needs, so that `--help` is instant."""
    files = {relative(path): path.read_text() for path in sources("flywheel")}
    silent = {name: silent_imports(text) for name, text in files.items()}
    assert [n for n, lines in silent.items() if lines and not n.startswith("flywheel/cli/")] == []


def test_an_import_without_a_reason_is_found() -> None:
    assert silent_imports("import a\ndef f():\n    import b\n    return b") == ["3: import b"]
    assert silent_imports("def f():\n    import b  # takes a second") == []
    assert silent_imports("def f():\n    # take a second\n    import b\n    import c") == []


def test_every_package_has_a_row() -> None:
    inside = [p for p in (ROOT / "flywheel").iterdir() if p.name[0] not in "_."]
    present = {p.stem for p in inside if p.suffix == ".py" or any(p.rglob("*.py"))}
    assert present <= LAYERS.keys()


def test_files_and_functions_stay_short() -> None:
    functions = (ast.FunctionDef, ast.AsyncFunctionDef)
    for path in sources("flywheel", "benchmarks", "pipelines"):
        source, name = path.read_text(), relative(path)
        assert len(source.splitlines()) <= LONGEST_FILE, f"{name}: so long, it is missing a noun"
        for node in ast.walk(parsed(source)):
            if isinstance(node, functions):
                length = (node.end_lineno or node.lineno) - node.lineno + 1
                assert length <= LONGEST_FUNCTION, f"{name}: {node.name} has {length} lines"


def test_no_path_of_one_machine_is_written_down() -> None:
    for path in sources("flywheel", "benchmarks", "pipelines", "tests"):
        for node in ast.walk(parsed(path.read_text())):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                where = f"{relative(path)}:{node.lineno} {node.value!r}"
                assert not ABSOLUTE.match(node.value), where


def added_with_the_mjcfs_defaults(source: str) -> list[str]:
    """Calls of MuJoCo's own ways to add an element, which begin with what the MJCF's <default> says."""
    return [
        f"{node.lineno}: {node.func.attr}"
        for node in ast.walk(parsed(source))
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Attribute)
        and node.func.attr in ADDING
    ]


def test_only_one_function_adds_elements_to_a_robot() -> None:
    for path in sources("flywheel", "benchmarks", "pipelines"):
        assert added_with_the_mjcfs_defaults(path.read_text()) == [], relative(path)


def test_an_element_added_in_mujocos_own_way_is_found() -> None:
    assert {"add_actuator", "add_geom", "add_site", "add_tendon", "add_freejoint"} <= ADDING
    assert added_with_the_mjcfs_defaults("spec.worldbody.add_geom(size=[1])") == ["1: add_geom"]
    assert added_with_the_mjcfs_defaults("axes.add_patch(circle)") == []


def test_the_library_does_not_print() -> None:
    for path in sources("flywheel"):
        for node in ast.walk(parsed(path.read_text())):
            called = node.func if isinstance(node, ast.Call) else None
            printing = isinstance(called, ast.Name) and called.id in {"print", "breakpoint"}
            assert not printing, f"{relative(path)}:{node.lineno}"


def test_no_file_is_named_for_nothing_in_particular() -> None:
    for path in sources("flywheel", "benchmarks", "pipelines"):
        assert path.stem not in {"utils", "util", "common", "helpers", "misc", "manager"}, path
        assert not re.search(r"_v\d+$|\d_new$|_old$", path.stem), path


OPENING = re.compile(r"(What|Whether)\b", re.IGNORECASE)
ENTRY = re.compile(r"[\w*., ]+?: +(.*)")


def phrases(docstring: str) -> list[str]:
    """A docstring's first line, and the texts in its sections."""
    lines = [line.strip() for line in docstring.strip().splitlines()]
    headings = [n for n, line in enumerate(lines) if re.fullmatch("(Args|[A-Z][a-z]+s):", line)]
    entries = lines[headings[0] + 1 :] if headings else []
    return [lines[0], *(found[1] if (found := ENTRY.match(line)) else line for line in entries)]


def openings(source: str) -> list[str]:
    """Phrases of docstrings, texts below fields, and help texts that begin with no noun."""
    tree = parsed(source)
    texts: list[str] = []
    for node in ast.walk(tree):
        value = node.value if isinstance(node, ast.Expr | ast.keyword) else None
        named = not isinstance(node, ast.keyword) or node.arg == "help"
        if named and isinstance(value, ast.Constant) and isinstance(value.value, str):
            texts += phrases(value.value)
    return [text for text in texts if OPENING.match(text)]


def test_a_docstring_names_its_result_with_a_noun() -> None:
    found = {
        str(path.relative_to(ROOT)): openings(path.read_text())
        for path in sources("flywheel", "benchmarks", "pipelines")
    }
    assert {path: texts for path, texts in found.items() if texts} == {}


@pytest.mark.parametrize(
    "source",
    [
        '"""What is left."""',
        'def f():\n    """Whether it is so."""',
        'def f():\n    """A fit.\n\n    Args:\n      a, b: what is fitted.\n    """',
        'class A:\n    """A fit.\n\n    Attributes:\n      a: a number.\n      b: whether it is so.\n    """',
        'a: int = 1\n"""What it is."""',
        'option(help="What it is.")',
    ],
)
def test_an_opening_without_a_noun_is_found(source: str) -> None:
    assert len(openings(source)) == 1
