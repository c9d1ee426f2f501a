"""Every document's code runs: `xml` is saved under the name in its first line, `python` and `bash`
blocks run in order in one folder per document. `console` and `text` blocks are only shown."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
DOCUMENTS = sorted(p for p in (ROOT / "docs").glob("*.md"))
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```", flags=re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\(([^)#]+?)(?:#[^)]*)?\)")


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda p: p.stem)
def test_the_code_in_a_document_runs(
    document: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "configs").symlink_to(ROOT / "configs")
    names: dict[str, object] = {"__name__": "__main__"}
    for match in BLOCK.finditer(document.read_text()):
        language, code = match.groups()
        line = document.read_text()[: match.start()].count("\n") + 2
        if language == "xml":
            Path(re.findall(r"<!-- (\S+) -->", code)[0]).write_text(code)
        elif language == "python":
            exec(compile("\n" * (line - 1) + code, str(document), "exec"), names)
        elif language == "bash":
            run_bash(code, f"{document.name}:{line}")
        else:
            assert language in {"console", "text", "yaml", "json"}, f"{document.name}:{line}"


def run_bash(code: str, where: str) -> None:
    """Run a block with the `flywheel` of this environment; fail with all that it said."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", code],
        env={**os.environ, "PATH": path},
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, f"{where}\n{done.stdout}\n{done.stderr}"


@pytest.mark.parametrize(
    "document", [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))], ids=lambda p: p.stem
)
def test_links_between_documents_lead_somewhere(document: Path) -> None:
    targets = [t for t in LINK.findall(document.read_text()) if "://" not in t]
    missing = [t for t in targets if not (document.parent / t).exists()]
    assert missing == []
