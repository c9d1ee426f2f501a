"""Tables of models: the protocol, nothing tested in training, cells that are made once."""

from collections import Counter
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from benchmarks import tables
from benchmarks.paper.__main__ import main
from benchmarks.paper.datasets import RATES, DataSets
from benchmarks.paper.definition import SIZES, TABLES, Cell, read_table, table_names
from benchmarks.paper.rows import CellRow, left_out_table, page, plants_table, result_table, spread
from benchmarks.paper.table import Table, publisher
from benchmarks.paper.worker import settings_digest
from benchmarks.rows import write_rows
from flywheel.errors import ConfigError, DataError, FlywheelError
from flywheel.runtime.pool.lock import hold
from flywheel.runtime.pool.pool import WorkerPool
from tests.unit.runtime.local_backend import LocalBackend

TINY = f"""
extends: {TABLES}/shared/real.yaml
name: tiny
robots: {{prism3: ["gait:roll"]}}
methods:
  arx: {{model: arx, fit: {{}}}}
  network: {{simulations: 1, published: {{prism3: ["49", "27", "4.0", "7.0"]}}}}
  alone: {{simulations: 1, recordings: false}}
  mjcf_restarted: {{model: informed_floor}}
"""
SHORTEST = ["seconds=[0.6, 0.6]", "run.evaluate.horizon_seconds=0.1"]
SHORT = ["repetitions=3", "seconds=[1.6, 1.6]"]


@pytest.mark.parametrize("size", ["", *SIZES])
@pytest.mark.parametrize("name", table_names())
def test_a_table_can_be_read_at_every_size(name: str, size: str) -> None:
    config = read_table(name, size)
    cells = config.cells()
    assert len({cell.name for cell in cells}) == len(cells) >= len(config.methods)
    assert (config.seconds == (3.0, 4.0)) == (size == "smoke")
    network = config.config("prism3", next(iter(config.methods.values()))).network
    assert (network.decomposition == "primitives") == (size == "paper")


def test_a_data_set_has_nine_trajectories_of_which_three_are_tested(tmp_path: Path) -> None:
    for robot in ("prism3", "icosa6"):
        plans = DataSets(read_table("sim2sim"), robot, tmp_path).plans
        assert len(plans) == len({plan.id for plan in plans}) == len({p.seed for p in plans}) == 54
        assert all(30.0 <= plan.seconds <= 60.0 for plan in plans)
        for dataset in range(6):
            own = [plan for plan in plans if plan.dataset == dataset]
            assert Counter(p.split for p in own) == {"train": 5, "validation": 1, "test": 3}
            assert len({plan.controller for plan in own if plan.split == "test"}) == 3


def starts(seed: int, folder: Path, table: str = "perturbed") -> dict[str, list[np.ndarray]]:
    """(P, 3) points at the start of gaits on one plant, by split, and of the keyframe [L]."""
    told = [*SHORTEST, "run.datasets=[{name: nominal}]", f"run.seed={seed}"]
    data = DataSets(read_table(table, "", told), "prism3", folder)
    found: dict[str, list[np.ndarray]] = {}
    for plan in data.plans:
        data.record(plan)
        points = data.store.read(plan.id).trajectory.observations.points[0]
        found.setdefault(plan.split, []).append(points / data.robot.length)
    plant = data.recorder.plant(0)
    return found | {"keyframe": [plant.observe(plant.rest()).points[0] / data.robot.length]}


def apart(one: np.ndarray, other: np.ndarray) -> float:
    """RMS distance of points (P, 3), however either stands about the vertical."""
    one, other = (points - points.mean(axis=0) * [1, 1, 0] for points in (one, other))
    flat = [points[:, 0] + 1j * points[:, 1] for points in (one, other)]
    turned = np.vdot(*flat)
    gaps = flat[0] * turned / abs(turned) - flat[1], one[:, 2] - other[:, 2]
    return float(np.sqrt(sum((np.abs(gap) ** 2).mean() for gap in gaps)))


def test_perturbed_gaits_begin_near_the_keyframe_and_each_elsewhere(tmp_path: Path) -> None:
    found, again = (starts(seed, tmp_path / str(seed)) for seed in (0, 1))
    (own,) = found["keyframe"]
    begun = [*found["train"], *found["validation"], *found["test"], *again["test"]]
    assert len(begun) == 12 and max(apart(points, own) for points in begun) < 0.02
    pairs = [apart(one, other) for one, other in combinations(begun, 2)]
    assert min(pairs) > 1e-5  # no tested one is among those to learn from, nor is it another seed's
    fallen = starts(0, tmp_path / "fall", "long")
    assert max(apart(points, own) for points in fallen["test"]) > 0.1


def test_other_starts_are_other_settings_and_other_trajectories_of_the_same_seeds() -> None:
    one, other = read_table("long"), read_table("long", "", ["starts=perturbed"])
    cell = one.cells()[0]
    assert settings_digest(one, cell) != settings_digest(other, cell)
    plans = [DataSets(table, "prism3", Path()).plans for table in (one, other)]
    assert not {plan.id for plan in plans[0]} & {plan.id for plan in plans[1]}
    assert [plan.seed for plan in plans[0]] == [plan.seed for plan in plans[1]]
    with pytest.raises(FlywheelError, match="a real robot stands where it is"):
        read_table("real2sim", "smoke", ["starts=perturbed"])


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("methods.arx.model=arcs", "arcs"),
        ("methods.persistence.exact=true", "exact is for floor and informed_floor"),
        ("methods.network.simulations=3", "simulations: at most 0 here"),
        ("methods.network.recordings=false", "recordings=false is for a network with simulations"),
        ("robots.prism3=[walk]", "unknown controllers"),
        ("tested=3", "leave none to learn from"),
        ("run.network.chunk=17", "chunk"),
        ("seconds=[4, 3]", "the least and the largest; got 4 and 3"),
        ("seconds=[1.4, 3]", "shortest trajectory, 1.4 s, must have 0.5 s .* horizon of 1 s"),
        ("seeds=[0, 1, 0]", "seeds has a value twice"),
        ("robots.icosa6=[throw, throw, random]", "icosa6 has a value twice"),
        ("methods.network.run.measurement.noise=0.01", "measurement of a model would change noth"),
        ("methods.arx.run.seed=3", "seed of a model would change nothing"),
        ("real={hidden: [torque_sped]}", "no hidden effect 'torque_sped'"),
    ],
)
def test_a_table_that_cannot_be_made_is_refused(override: str, message: str) -> None:
    with pytest.raises(FlywheelError, match=message):
        read_table("sim2sim", "smoke", [override])


def test_trajectories_may_be_elsewhere_and_numbers_are_the_same(tmp_path: Path) -> None:
    here = read_table("sim2sim", "smoke")
    there = read_table("sim2sim", "smoke", [f"run.store={tmp_path / 's'}"])
    assert DataSets(here, "icosa6", tmp_path).store.url == str(tmp_path / "icosa6" / "store")
    assert DataSets(there, "icosa6", tmp_path).store.url == str(tmp_path / "s" / "icosa6")
    cell = here.cells()[0]
    assert settings_digest(here, cell) == settings_digest(there, cell)


def test_settings_may_stand_after_options(monkeypatch, capsys) -> None:
    told = ["paper_table.py", "sim2sim", "--only", "nothing", "run.mppi.samples=2"]
    monkeypatch.setattr("sys.argv", told)
    with pytest.raises(SystemExit, match="2"):
        main()
    assert "No cell of the table sim2sim has nothing in its name" in capsys.readouterr().err


def test_each_part_of_a_name_is_that_of_a_cell(tmp_path: Path) -> None:
    with pytest.raises(
        ConfigError, match=r"has prism3.\*.tdpe_mjfc in .* Did you mean 'tdpe_mjcf'"
    ):
        Table(read_table("sim2sim"), tmp_path, [".arx", "prism3.*.tdpe_mjfc"])


def test_a_folder_has_the_trajectories_of_one_definition(tmp_path: Path) -> None:
    file = tmp_path / "tiny.yaml"
    file.write_text(TINY)

    def begin(*told: str) -> None:
        table = Table(read_table(str(file), "smoke", [*SHORT, *told]), tmp_path)
        table._check_trajectories("prism3")

    begin("seeds=[0, 1]")
    begin("seeds=[2]", "fit.windows=17")
    with pytest.raises(ConfigError, match=r"other settings:\n  seconds: .* -> \[1.8, 1.8\]"):
        begin("seconds=[1.8, 1.8]")
    with pytest.raises(ConfigError, match="real.noise: "):
        begin("real.noise=0.01")


def test_two_processes_do_not_make_one_table(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.setattr("sys.argv", ["paper_table.py", "sim2sim", "--folder", str(tmp_path)])
    with hold(tmp_path / "table.lock", "The table"), pytest.raises(SystemExit, match="2"):
        main()
    assert "is in use by process" in capsys.readouterr().err


def test_a_tested_trajectory_is_not_trained_on_under_another_name(tmp_path: Path) -> None:
    data = DataSets(read_table("components", "smoke", SHORTEST), "prism3", tmp_path)
    tested = next(plan for plan in data.plans if plan.split == "test")
    learned = next(plan for plan in data.plans if plan.split == "train")
    for plan in (tested, learned):
        data.record(plan)
    test = data.store.seal("test", [tested.id])
    data.check_apart(data.store.seal("train", [learned.id]), test)
    copied = replace(data.store.read(tested.id), id="copy", split="train")
    data.store.commit("copy", [copied])
    with pytest.raises(DataError, match=f"{tested.id} is also in the training data, as copy"):
        data.check_apart(data.store.seal("wrong", [learned.id, "copy"]), test)

    # the MJCF's winches, with the true rates, move as those of the slower plant
    rates = data.store.read(learned.id + RATES)
    assert rates.trajectory.states is not None
    there = data.recorder.plant(0).winch(rates.trajectory.states)
    known = data.robot.winches_of(rates)
    assert np.allclose(known, there, atol=1e-9)
    assert not np.allclose(data.robot.winches_of(data.store.read(learned.id)), there, atol=1e-3)


@pytest.mark.slow
def test_a_table_is_made_once_and_shown(tmp_path: Path) -> None:
    file = tmp_path / "tiny.yaml"
    file.write_text(TINY)
    config = read_table(str(file), "smoke", SHORT)
    table = Table(config, tmp_path / "results")
    backend, shown = LocalBackend(), []
    table.make(WorkerPool(backend, [table.workers], 1), show=lambda rows: shown.append(len(rows)))
    rows = table.rows()
    assert [row.method for row in rows] == list(config.methods) and shown == [1, 2, 3, 4, 4]
    assert all(np.isfinite([row.full_mse, row.short_rot, row.rollout_cpu]).all() for row in rows)
    assert len({row.test for row in rows}) == 1 and len({row.train for row in rows}) == 3
    learned = {row.method: row.learned for row in rows}
    assert learned["network"] == pytest.approx(2 * learned["arx"] - 2 * 0.5)
    assert learned["alone"] == pytest.approx(learned["network"] - learned["arx"])
    assert "(49)" in (table.folder / "table.md").read_text()
    assert list(table.folder.glob("prism3/models/*.network.s0/trainer.lock"))

    again = LocalBackend()
    table.make(WorkerPool(again, [table.workers], 1))
    assert not again.done
    with pytest.raises(ConfigError, match="arx.s0 with other settings"):
        Table(read_table(str(file), "smoke", [*SHORT, "fit.windows=17"]), table.folder)

    for cell in table.folder.glob("cells/*"):
        cell.unlink()
    longer = Table(read_table(str(file), "smoke", [*SHORT, "seconds=[1.8, 1.8]"]), table.folder)
    with pytest.raises(ConfigError, match="has trajectories of other settings"):
        longer.make(WorkerPool(again, [longer.workers], 1))


ROW = CellRow("prism3", "nominal", "network", 0, 2.95, 60.0, 30.0, "a" * 64, "b" * 64, "c" * 64)


def test_diverged_cells_are_counted_and_not_averaged() -> None:
    rows = [replace(ROW, full_mse=value) for value in (1.0, 2.0)]
    assert spread(rows, "full_mse") == "1.5 ± 0.71"
    assert spread([*rows, ROW], "full_mse") == "1.5 ± 0.71, 1 of 3 diverged"
    assert spread([ROW], "full_mse") == "diverged"
    text = "\n".join(page(read_table("sim2sim"), [replace(ROW, full_mse=3.0)]))
    assert "| network | 3 (1.1 ± 0.9) | diverged (14.0 ± 7.8)" in text
    assert "|  | 1 | 0.0885 |" in text  # mean over xyz, and without the division by L


def test_the_mean_of_plants_counts_each_plant_once_however_many_seeds_it_has() -> None:
    def rows(**errors: tuple[float, ...]) -> list[CellRow]:
        return [
            replace(ROW, dataset=name, seed=seed, full_mse=value, short_rot=value / 10)
            for name, values in errors.items()
            for seed, value in enumerate(values)
        ]

    lines = plants_table(
        rows(hard=(1.0, 3.0), soft=(8.0,)), rows(soft=(4.0,), none=(90.0,), hard=(2.0,))
    )
    assert [line.split(" | ")[:2] for line in lines[2:]] == [
        ["| hard", "2 ± 1.4 (2)"],
        ["| soft", "8 (4)"],
        ["| mean", "5 ± 4.2 (3 ± 1.4)"],
    ]
    assert lines[2].endswith("| 0.2 ± 0.14 (0.2) |")
    diverged = plants_table(rows(hard=(1.0, np.nan)), rows(hard=(2.0,)))
    assert [line.split(" | ")[1] for line in diverged[2:]] == [
        "1, 1 of 2 diverged (2)",
        "diverged (2)",
    ]


def test_the_long_training_is_longer_at_its_usual_size_alone() -> None:
    for size, longer in (("", True), *((size, False) for size in SIZES)):
        runs = [read_table(name, size).config("prism3") for name in ("long", "sim2sim")]
        steps = [run.training.initial.steps for run in runs]
        assert (steps[0] > steps[1]) == longer and steps[0] >= steps[1]
        assert [run.training.symmetries for run in runs] == [True, False]


class FakeBoard:
    """Counts what is published."""

    def __init__(self) -> None:
        self.runs: list[str] = []
        self.files: list[str] = []

    def run(self, key, name, tags, parent=None):
        self.runs.append(key)
        return key

    def log(self, run, rows):
        assert all(isinstance(value, float) for _, values in rows for value in values.values())

    def describe(self, run, params):
        assert params["dataset"] == "nominal"

    def status(self, run, status):
        pass

    def artifact(self, run, path):
        self.files.append(path)


def test_a_cell_is_published_once() -> None:
    board = FakeBoard()
    publish = publisher(board, read_table("sim2sim"))  # type: ignore[arg-type]
    publish([ROW], "RUNNING")
    publish([ROW, replace(ROW, method="arx")], "FINISHED")
    cells = [key.partition("/")[2] for key in board.runs if "/" in key]
    assert cells == ["prism3.nominal.network.s0", "prism3.nominal.arx.s0"]
    assert board.files == ["table.csv", "table.md"]


def test_results_of_a_table_that_were_collected_before_stay(tmp_path, monkeypatch):
    config = read_table("sim2sim")

    def row(method: str, error: float, seed: int = 0) -> CellRow:
        settings = settings_digest(config, Cell("prism3", "nominal", method, seed))
        return replace(ROW, method=method, seed=seed, settings=settings, full_mse=error)

    monkeypatch.setattr(tables, "PAPER", tmp_path)
    write_rows(tmp_path / "sim2sim.csv", [row("arx", 9.0), row("network", 8.0)])
    folder = tmp_path / "results"
    with pytest.raises(ConfigError, match="no result of the table sim2sim in"):
        tables.collect_paper("sim2sim", folder)
    write_rows(folder / "cells" / "prism3.nominal.network.s0.csv", [row("network", 3.0)])
    tables.collect_paper("sim2sim", folder)
    found = tables.paper_rows("sim2sim")
    assert [(row.method, row.full_mse) for row in found] == [("arx", 9.0), ("network", 3.0)]

    (folder / "cells" / "prism3.nominal.network.s0.csv").unlink()
    write_rows(folder / "cells" / "prism3.nominal.arx.s2.csv", [row("arx", 5.0, seed=2)])
    with pytest.raises(ConfigError, match="no result of the table sim2sim in"):
        tables.collect_paper("sim2sim", folder)
    tables.collect_paper("sim2sim", folder, ["seeds=[0,2]"])
    more = tables.paper_rows("sim2sim")
    assert [(row.method, row.seed) for row in more] == [("arx", 0), ("network", 0), ("arx", 2)]
    (left,) = left_out_table([(config, more)])[2:]
    assert left.startswith("| sim2sim | 2 of 144, and 1 of other seeds | icosa6 |")

    lines = result_table(config, found)
    assert lines[0].startswith("| prism3: model | whole: MSE/L [%] | ")
    assert lines[3].startswith("| network | 3 (1.1 ± 0.9) | ")
    (left,) = left_out_table([(config, found)])[2:]
    assert left.startswith("| sim2sim | 2 of 144 | icosa6 | friction_low, ")
    assert left.endswith(", mjcf_restarted, restarted_random_roll, restarted |  |")


@pytest.mark.parametrize(
    "damage",
    [
        lambda text: "",
        lambda text: "garbage\n",
        lambda text: text[:-5],
        lambda text: text.replace(",network,", ",arx,"),
        lambda text: text + text.splitlines()[1] + "\n",
    ],
)
def test_a_damaged_result_is_refused_and_not_left_out(damage, tmp_path: Path) -> None:
    config = read_table("sim2sim")
    cell = Cell("prism3", "nominal", "network", 0)
    row = replace(ROW, settings=settings_digest(config, cell), full_mse=1.25)
    file = tmp_path / "cells" / f"{cell.name}.csv"
    write_rows(file, [row])
    assert Table(config, tmp_path).rows() == [row]
    file.write_text(damage(file.read_text()))
    with pytest.raises(ConfigError, match="is damaged, or not the result of prism3.nominal.net"):
        Table(config, tmp_path)
