"""The command that counts mutants makes those it says, and notices which are noticed."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

from tests.mutants.mutation import mutants_of
from tests.mutants.sample import HERE, drawn, equivalents, shares, sources
from tests.mutants.trial import ROOT


@pytest.mark.parametrize(
    ("source", "changed"),
    [
        ("x = a + b", ["x = a - b", "x = a"]),
        ("x = (a - b) * c", ["x = (a + b) * c", "x = a * c", "x = (a - b) / c", "x = a - b"]),
        ("x += a", ["x -= a"]),
        ("x = a @ b", []),
        ("x = a < b", ["x = a <= b", "x = a >= b"]),
        ("x = a <= b < c", ["x = a < b < c", "x = a > b < c", "x = a <= b <= c", "x = a <= b >= c"]),
        ("x = a is not b", ["x = a is b"]),
        ("x = a and b or c", ["x = (a or b) or c", "x = (a and b) and c"]),
        ("x = a or b or c", ["x = a and b or c", "x = a or (b and c)"]),
        ("x = -a", ["x = a"]),
        ("x = b if a else c", ["x = b if not a else c"]),
        ("x = b if not a else c", ["x = b if a else c"]),
        ("x = [a for a in b if f(a)]", ["x = [a for a in b if not f(a)]"]),
        ("x = 3", ["x = 4", "x = 2"]),
        ("x = 0", ["x = 1", "x = -1"]),
        ("x = True", ["x = False"]),
        ("x = (0.5, 1.0, 0.0)", ["x = (1.0, 1.0, 0.0)", "x = (0.5, 0.0, 0.0)", "x = (0.5, 1.0, 1.0)"]),
        ("x = ('words', None)", []),
        ("x = a[:b]", ["x = a[:b + 1]"]),
        ("x = max(a, b)", ["x = min(a, b)"]),
        ("x = np.argmin(a)", ["x = np.argmax(a)"]),
        ("x = f(a, b)", ["x = f(b, a)"]),
        ("x = f(a, b.c, *d)", []),
        ("x = f(a, key=b, strict=c)", ["x = f(a, strict=c)"]),
        ("x = f(key=a, other=b)", ["x = f(other=b)", "x = f(key=a)"]),
        ("f = lambda a=1: b", ["f = lambda a=2: b", "f = lambda a=0: b"]),
        ("return a", ["return None"]),
        ("assert a == 1, f'{a + 1}'", []),
        ("x = ('é', a + b)", ["x = ('é', a - b)", "x = ('é', a)"]),
    ],
)  # fmt: skip
def test_a_line_has_these_mutants(source: str, changed: list[str]) -> None:
    found = mutants_of("file.py", source)
    assert sorted(mutant.after for mutant in found) == sorted(changed)
    assert all(mutant.before == source for mutant in found)


def test_a_statement_is_left_out_but_not_one_that_gives_a_name_its_first_value() -> None:
    source = "def f(a):\n    b = a\n    b = c\n    self.x = b\n    g()\n    raise d"
    gone = [m.before for m in mutants_of("file.py", source) if m.after == "pass"]
    assert gone == ["b = c", "self.x = b", "g()", "raise d"]


def test_declarations_and_words_are_left_alone() -> None:
    source = (
        "@d(frozen=True)\nclass A(b + c):\n    'Words.'\n    x: f(1)\n    def g(self) -> h(2): ..."
    )
    assert mutants_of("file.py", source) == []


def test_a_mutant_is_named_by_its_place_and_its_lines_wherever_they_stand() -> None:
    source = "class A:\n    def f(self):\n        x = g(\n            a < b\n        )\n"
    first = mutants_of("file.py", source)[0]
    assert str(first) == "file.py:4 A.f\n    - x = g(a < b)\n    + x = g(a <= b)"
    lower = mutants_of("file.py", "y = z\n\n" + source)[0]
    assert (lower.key, lower.line) == (first.key, 6)


def test_of_a_long_statement_the_part_about_the_change_is_said() -> None:
    first = mutants_of("file.py", f"x = [{'a, ' * 99}b < c{', d' * 99}]")[0]
    assert len(first.before) < 170 > len(first.after)
    assert "a, b < c, d" in first.before
    assert "a, b <= c, d" in first.after


@pytest.mark.slow
def test_every_mutant_is_another_program() -> None:
    source = (ROOT / "flywheel/control/mppi.py").read_text()
    mutants = mutants_of("mppi.py", source)
    said = {ast.dump(ast.parse(mutant.source)) for mutant in mutants}
    assert len(said) == len(mutants) > 100
    assert ast.dump(ast.parse(source)) not in said


def test_a_sample_is_drawn_in_proportion_to_the_sizes_of_the_files() -> None:
    assert shares([100, 300, 0], [50, 50, 0], 40) == [10, 30, 0]
    assert shares([100, 300], [50, 5], 40) == [35, 5]
    assert shares([1, 1, 1], [9, 9, 9], 10) in ([4, 3, 3], [3, 4, 3], [3, 3, 4])
    assert shares([5], [3], 10) == [3]


def test_a_sample_hangs_on_its_seed_and_hardly_on_edits() -> None:
    files = sources(["flywheel/runtime/stages/gate.py", "flywheel/control/knots.py"])

    def keys(seed: int, of: list) -> list[set]:
        return [{m.key for m in mutants} for mutants in drawn(of, seed, 40).values()]

    assert keys(1, files) == keys(1, files)
    assert keys(1, files) != keys(2, files)
    gate, knots = files
    edited = type(gate)(
        gate.path, gate.tests, gate.text.replace("len(names) < 2", "len(names) < 9")
    )
    before, after = keys(1, [gate, knots]), keys(1, [edited, knots])
    assert before[1] == after[1]
    assert len(before[0] - after[0]) < 8


def test_the_tests_of_all_sources_exist() -> None:
    for source in sources():
        for test in source.tests:
            assert (ROOT / test).exists(), test


def test_every_equivalent_mutant_has_a_reason() -> None:
    assert (HERE / "equivalent.toml").exists()
    assert all(why.strip() for why in equivalents().values())


TOY = """
from pathlib import Path
from tests.mutants.trial import PASSED, FAILED, TIMED_OUT, Bench, prepare

prepare(["pytest", "xdist", "hypothesis"])
SLOW = "1 if all(iter(lambda: 1, 0)) else 1"
with Bench(Path({root!r})) as bench:
    module, tests = "flywheel/toy.py", ["tests/test_toy.py"]
    sound = (bench.tree / module).read_text()
    for change, limit, code in (("1", 90.0, PASSED), ("2", 90.0, FAILED), (SLOW, 3.0, TIMED_OUT)):
        got = bench.tested(tests, limit, module, "ONE = " + change)
        assert got.code == code, got
    assert (bench.tree / module).read_text() == sound
assert not bench.tree.exists()
"""


@pytest.mark.nightly
@pytest.mark.slow
def test_a_trial_tells_what_tests_notice_and_leaves_no_trace(tmp_path: Path) -> None:
    toy = {
        "flywheel/__init__.py": "",
        "flywheel/toy.py": "ONE = 1\n",
        "tests/test_toy.py": "from flywheel.toy import ONE\ndef test_one(): assert ONE == 1\n",
        "pyproject.toml": "[tool.pytest.ini_options]\n",
    }
    for name, content in toy.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(content)
    program = TOY.format(root=str(tmp_path))
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
    assert {p.relative_to(tmp_path).as_posix() for p in tmp_path.rglob("*.*")} == toy.keys()
