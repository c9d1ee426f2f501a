"""Documents keep their form, their links lead somewhere, and their code runs.

`xml`, and `python` and `yaml` whose first line is the name of a file, is saved under that name. Other
`python` and `bash` blocks run in order in one folder per document. `console` and `text` blocks are only
shown.
Commands of flywheel in `bash` run in this process, which has imported everything. A run that is not refused
has processes of its own, and so a real shell.
"""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from typer.testing import CliRunner

from flywheel.cli.main import app

ROOT = Path(__file__).parents[1]
DOCUMENTS = sorted(p for p in (ROOT / "docs").glob("*.md"))
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```", flags=re.MULTILINE | re.DOTALL)
NAMED = re.compile(r"# (\w+\.(?:py|yaml))\n")  # a file, in its first line
# A command, where its output or its errors go, and whether it is refused, with which code; or another line.
LINE = re.compile(
    r"(?:PYTHONPATH=\. )?flywheel ((?:\$\([^)\n]*\)|[^|<>&;\n])+?)(?: (\| tee|2>) (\S+))?"
    r"( && exit 1(?:\ntest \$\? -eq (\d+))?)?\n|.*\n"
)
# Pages with a search over all effects, a whole run, and what tests/unit has in a smaller size.
LONG = {"own_effect", "robot_runs", "wrong_in_many_ways", "demo"}
LINK = re.compile(r"\]\(([^)#]+?)(?:#[^)]*)?\)")
RESULTS = sorted(p for p in (ROOT / "docs" / "results").glob("*.md") if p.stem != "index")
DECISIONS = sorted((ROOT / "docs" / "decisions").glob("0*.md"))
HASH = re.compile(r"`(?=[0-9a-f]*[0-9])(?=[0-9a-f]*[a-f])[0-9a-f]{7,40}`")


@pytest.mark.slow
@pytest.mark.parametrize(
    "document",
    [pytest.param(p, marks=[pytest.mark.nightly] if p.stem in LONG else []) for p in DOCUMENTS],
    ids=lambda p: p.stem,
)
def test_the_code_in_a_document_runs(document, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "configs").symlink_to(ROOT / "configs")
    names: dict[str, object] = {"__name__": "__main__"}
    for match in BLOCK.finditer(document.read_text()):
        language, code = match.groups()
        line = document.read_text()[: match.start()].count("\n") + 2
        if language in ("python", "yaml") and (file := NAMED.match(code)):
            Path(file[1]).write_text(code)
        elif language == "xml" and "<mujoco" in code:  # else a part of one
            Path(re.findall(r"<!-- (\S+) -->", code)[0]).write_text(code)
        elif language == "python":
            exec(compile("\n" * (line - 1) + code, str(document), "exec"), names)
        elif language == "bash":
            run_bash(code, f"{document.name}:{line}")
        else:
            assert language in {"console", "text", "yaml", "json", "xml"}, f"{document.name}:{line}"


def run_bash(code: str, where: str) -> None:
    """Run a block; fail with all that it said."""
    script = ""
    for line in LINE.finditer(re.sub(r" +#.*", "", code.replace("\\\n", " "))):
        words, to, file, refused, expected = line.groups()
        if not words or (re.match(r"run \w", words) and not refused):
            script += line[0]
            continue
        in_a_shell(script, where)
        script, arguments = "", in_a_shell(f"printf '%s\\n' {words}", where).splitlines()
        said = CliRunner().invoke(app, arguments)
        wanted = int(expected or (2 if refused else 0))
        assert said.exit_code == wanted, f"{where}\n{said.output}\n{said.exception!r}"
        if file:
            Path(file).write_text(said.stderr if to == "2>" else said.stdout)
    in_a_shell(script, where)


def in_a_shell(script: str, where: str) -> str:
    """What bash prints, which makes of words what they stand for."""
    command = ["bash", "-euo", "pipefail", "-c", script]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, f"{where}\n{done.stdout}\n{done.stderr}"
    return done.stdout


@pytest.mark.parametrize(
    "document", [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))], ids=lambda p: p.stem
)
def test_links_between_documents_lead_somewhere(document: Path) -> None:
    targets = [t for t in LINK.findall(document.read_text()) if "://" not in t]
    missing = [t for t in targets if not (document.parent / t).exists()]
    assert missing == []


def test_a_name_is_in_the_file_that_contributing_says() -> None:
    """ "`Search.fit_until` in `flywheel/diagnosis/selection/search.py`"."""
    text = (ROOT / "docs" / "contributing.md").read_text()
    found = re.findall(r"((?:`[\w.]+`(?: and )?)+) in\s`((?:flywheel|tests)/[\w/]+\.py)`", text)
    assert len(found) >= 5
    for names, path in found:
        source = (ROOT / path).read_text()
        for name in re.findall(r"`([\w.]+)`", names):
            defined = rf"^\s*(?:def|class) {name.rpartition('.')[2]}\b|^{name}\b.* = "
            assert re.search(defined, source, re.MULTILINE), f"{name} is not in {path}"


@pytest.mark.parametrize("page", RESULTS, ids=lambda p: p.stem)
def test_a_result_is_one_page_of_one_commit(page: Path) -> None:
    text = page.read_text()
    assert len(text.splitlines()) <= 120
    assert len(set(HASH.findall(text))) <= 1
    for part in ("**Question.**", "**Command", "## What fails"):
        assert part in text, part


@pytest.mark.parametrize("page", DECISIONS, ids=lambda p: p.stem)
def test_a_decision_says_context_decision_and_consequences(page: Path) -> None:
    lines = page.read_text().splitlines()
    assert len(lines) <= 60
    headings = [line.removeprefix("## ") for line in lines if line.startswith("## ")]
    assert headings == ["Context", "Decision", "Consequences"]


def test_every_dependency_has_its_reason() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    wanted = {
        re.split(r"[<>=!~ ]", line)[0]
        for lines in (project["dependencies"], *extras.values())
        for line in lines
    } - {f"flywheel[{extra}]" for extra in extras}
    named: set[str] = set()
    for line in (ROOT / "docs" / "decisions" / "0002-dependencies.md").read_text().splitlines():
        cells = [cell.strip() for cell in line.split("|")[1:-1]]
        if cells and cells[0].strip("`") in extras:  # the second table begins with the extra
            cells = cells[1:]
        if len(cells) >= 2 and cells[1]:
            named |= set(cells[0].split(", "))
    assert wanted <= named, wanted - named


def test_the_menu_of_the_site_has_every_page() -> None:
    menu = (ROOT / "mkdocs.yml").read_text()
    pages = [p.relative_to(ROOT / "docs").as_posix() for p in (ROOT / "docs").rglob("*.md")]
    assert [page for page in pages if page not in menu] == []
