"""`python -m benchmarks.speed.gpu` gives its rows and the same numbers as JSON, here on the processor."""

import json
import math

from typer.testing import CliRunner

from benchmarks.speed.gpu import DRY, app

run = CliRunner().invoke


def test_a_dry_run_measures_everything_and_trains():
    done = run(app, ["--dry"], catch_exceptions=False)
    assert done.exit_code == 0
    *printed, last = done.stdout.splitlines()
    answer = json.loads(last)
    rows = answer["rows"]
    assert answer["device"] == "cpu" and len(printed) == len(rows)
    assert all(row["of"] in line for row, line in zip(rows, printed, strict=True))
    kinds = [row["of"].split(",")[0] for row in rows]
    shapes = len(DRY.networks)
    assert kinds == ["training"] * shapes + ["learned steps", "plans of 0.5 s"] * shapes + ["loss"]
    for row in rows[:-1]:
        assert {"cpu", "one core"} <= row.keys()
        assert ("MuJoCo on all cores" in row) == (not row["of"].startswith("training"))
        assert all(value > 0 for value in row.values() if isinstance(value, float))
    assert math.isfinite(rows[-1]["start"]) and math.isfinite(rows[-1]["end"])


def test_a_gpu_that_is_not_there_is_bad_input(monkeypatch):
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    done = run(app, [])
    assert done.exit_code == 2
    assert "--device=cuda needs a CUDA GPU" in done.stderr
