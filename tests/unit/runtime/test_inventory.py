"""Whatever is done to a file of a run is found, and a run does not go on from what it rests on."""

import os
import pickle
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from flywheel.cli.runs.opening import open_run
from flywheel.data import TrajectoryStore
from flywheel.errors import ModelError, RunError
from flywheel.results import RunResult
from flywheel.runtime.run.folder import RunFolder
from flywheel.runtime.run.inventory import Fault, Inventory, check_sound
from flywheel.runtime.run.rewinding import rewind
from flywheel.seals import Unsound
from tests.damage import flip
from tests.unit.runtime.tiny_run import TINY, Bench

pytestmark = pytest.mark.slow

SMALL = {"control_arm": True, "evaluate": {**TINY["evaluate"], "floor": False}}
SEGMENTS = "store/segments"
MINE, OTHER = "i0001-mppi-collect-0000", "i0001-mppi-collect-0001"
SERVED = "models/i0001-{}/served"
# What is tampered with, and a sibling of its kind.
SIBLINGS = {
    "snapshot": ("store/snapshots/i0001-mppi.json", "store/snapshots/i0001-control.json"),
    "receipt": (f"{SEGMENTS}/{MINE}/receipt.json", f"{SEGMENTS}/{OTHER}/receipt.json"),
    "telemetry": (f"{SEGMENTS}/{MINE}/telemetry.json", f"{SEGMENTS}/{OTHER}/telemetry.json"),
    "segment": (f"{SEGMENTS}/{MINE}", f"{SEGMENTS}/{OTHER}"),
    "iteration": ("iterations/i0001-mppi.json", "iterations/i0001-control.json"),
    "weights": tuple(f"{SERVED.format(arm)}/weights.npz" for arm in ("mppi", "control")),
    "side file": tuple(f"{SERVED.format(arm)}/weights.json" for arm in ("mppi", "control")),
    "model": ("models/i0001-mppi", "models/i0001-control"),
    "checkpoint": tuple(f"models/i0001-{arm}/checkpoint.pt" for arm in ("mppi", "control")),
}
ALONE = {
    "array": f"{SEGMENTS}/{MINE}/*.zarr/points/c.0.0.0",
    "robot of the model": f"{SERVED.format('mppi')}/robot.xml",
    "result": "result.json",
    "configuration": "config.yaml",
    "robot": "robot.xml",
    "identity": "run.json",
}
FILES = {name: first for name, (first, _) in SIBLINGS.items()} | ALONE
FOLDERS = {"segment", "model"}
# What a look at every byte finds, and going on does not rest on.
NOT_RELIED_ON = {"telemetry", "checkpoint"}


@pytest.fixture(scope="module")
def runs(tmp_path_factory) -> tuple[Path, Path]:
    """Two finished runs of one configuration: the same numbers, in two folders."""
    made = []
    for name in ("mine", "foreign"):
        bench = Bench(tmp_path_factory.mktemp(name) / "run", **SMALL)
        bench.files.path.mkdir()
        bench.turn()
        made.append(bench.files.path)
    return made[0], made[1]


@pytest.fixture(scope="module")
def finished(runs) -> Path:
    return runs[0]


def look(run: Path) -> list[Fault]:
    return Inventory(RunFolder(run), TrajectoryStore(run / "store")).faults()


def refused(run: Path) -> str:
    """What is said when the run is to go on; nothing if it would."""
    try:
        check_sound(RunFolder(run), TrajectoryStore(run / "store"))
    except RunError as error:
        return str(error)
    return ""


@contextmanager
def kept(*paths: Path) -> Iterator[None]:
    """As they were, whatever is done to them."""
    with TemporaryDirectory() as aside:
        for number, path in enumerate(paths):
            copy(path, Path(aside) / str(number))
        try:
            yield
        finally:
            for number, path in enumerate(paths):
                copy(Path(aside) / str(number), path)


def remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def instead(make: Callable[[Path], object]) -> Callable[[Path], None]:
    def change(path: Path) -> None:
        remove(path)
        make(path)

    return change


DONE: dict[str, Callable[[Path], object]] = {
    "flipped": flip,
    "cut short": lambda path: path.write_bytes(path.read_bytes()[: path.stat().st_size // 2]),
    "emptied": lambda path: path.write_bytes(b""),
    "overwritten with noise": lambda path: path.write_bytes(bytes(range(256)) * 4),
    "made a list": lambda path: path.write_text("[]"),
    "made a mapping": lambda path: path.write_text('{"sha256": 1, "content": {}}'),
    "nested deeply": lambda path: path.write_text("[" * 100_000),
    "removed": remove,
    "made a folder": instead(Path.mkdir),
    "made a pipe": instead(os.mkfifo),
    "made a link to nowhere": instead(lambda path: path.symlink_to("nowhere")),
}


def test_a_run_that_was_left_in_peace_is_sound(finished):
    assert look(finished) == []
    assert refused(finished) == ""


@pytest.mark.parametrize(
    ("what", "how"),
    [  # every way to damage one file, and two ways to damage each
        pytest.param(what, how, marks=[] if usual else [pytest.mark.nightly])
        for what in FILES
        for how in DONE
        if what not in FOLDERS
        for usual in [what == "snapshot" or how in ("flipped", "removed")]
    ],
)
def test_whatever_is_done_to_a_file_is_found_and_not_gone_on_from(finished, what, how):
    (victim,) = finished.glob(FILES[what])
    with kept(victim):
        DONE[how](victim)
        found, said = look(finished), refused(finished)
    if (what, how) == ("result", "removed"):  # the run has just not come to its end
        assert not found and not said
        return
    assert any(named(victim.relative_to(finished), fault) for fault in found), found
    assert bool(said) == (what not in NOT_RELIED_ON | {"array"}), said
    assert not said or "rewind" in said or "Restore a copy of it" in said


def named(path: Path, fault: Fault) -> bool:
    """Of what lies within a segment the segment is named, with what is wrong in it."""
    parts = path.as_posix().removeprefix("store/").split("/")
    return fault.where == "/".join(parts[:2] if parts[0] == "segments" else parts)


@pytest.mark.parametrize("what", SIBLINGS)
def test_things_whose_names_were_exchanged_are_found(finished, what):
    one, other = (finished / path for path in SIBLINGS[what])
    with kept(one, other):
        one.rename(one.with_name(".between"))
        other.rename(one)
        one.with_name(".between").rename(other)
        found, said = look(finished), refused(finished)
    assert {fault.kind for fault in found} <= {"altered", "foreign"}, found
    for path in (one, other):
        assert any(inside(path.relative_to(finished), fault) for fault in found), found
    assert bool(said) == (what not in NOT_RELIED_ON)


@pytest.mark.parametrize("part", ["iterations", "models", "store/segments", "store/snapshots"])
def test_a_file_in_the_place_of_a_folder_is_found(finished, part):
    with kept(finished / part):
        remove(finished / part)
        (finished / part).write_text("x")
        found = look(finished)
        assert ("altered", short(Path(part))) in [(f.kind, f.where) for f in found]
        assert refused(finished)


def test_weights_that_are_another_models_are_not_taken_for_an_iterations(finished):
    one, other = (finished / path for path in SIBLINGS["model"])
    with kept(one, other):
        copy(other, one)
        run = open_run(finished)
        with pytest.raises(ModelError, match="not those that were trained here"):
            run.weights(run.iteration("i0001-mppi"))
        assert run.weights(run.iteration("i0001-control")).digest


def test_what_is_said_of_a_fault_travels_between_processes(finished):
    with pytest.raises(Unsound) as caught:
        TrajectoryStore(finished / "store").read_segment("i0009")
    back = pickle.loads(pickle.dumps(caught.value))
    assert (str(back), back.kind) == (str(caught.value), "missing")


@pytest.mark.parametrize("what", SIBLINGS)
def test_a_thing_copied_over_another_is_found(finished, what):
    one, other = (finished / path for path in SIBLINGS[what])
    with kept(one):
        copy(other, one)
        found, said = look(finished), refused(finished)
    assert found and {fault.kind for fault in found} <= {"altered", "foreign"}, found
    assert all(inside(one.relative_to(finished), fault) for fault in found), found
    assert bool(said) == (what not in NOT_RELIED_ON)


@pytest.mark.parametrize("what", ["snapshot", "segment", "iteration", "model"])
def test_a_thing_copied_or_moved_to_a_name_of_its_own_is_found(finished, what):
    one = finished / FILES[what]
    another = one.with_name("i0009-mppi" + one.suffix)
    try:
        copy(one, another)
        found = look(finished)
        assert [(f.where, f.kind) for f in found] == [
            (short(another.relative_to(finished)), "foreign")
        ]
        with kept(one):
            remove(one)
            kinds = {fault.kind for fault in look(finished)}
            assert refused(finished)
        assert kinds >= {"missing", "foreign"}, kinds
    finally:
        remove(another)


@pytest.mark.parametrize("what", [*FILES, "store"])
def test_a_thing_of_another_run_of_the_same_configuration_is_found(runs, what):
    mine, foreign = runs
    if what == "store":
        victim = mine / "store/store.json"
    else:
        (victim,) = mine.glob(FILES[what])
    source = foreign / victim.relative_to(mine)
    same = contents(source) == contents(victim)
    with kept(victim):
        copy(source, victim)
        found, said = look(mine), refused(mine)
    if same:  # nothing was changed
        assert not found
        return
    kinds = {fault.kind for fault in found}
    assert kinds <= {"foreign", "altered"} and ("foreign" in kinds or what in ("configuration",)), (
        found
    )
    assert bool(said) == (what not in NOT_RELIED_ON)


def contents(path: Path) -> dict[str, bytes]:
    files = [path] if path.is_file() else [p for p in path.rglob("*.*") if p.suffix != ".lock"]
    files = [p for p in files if p.is_file()]
    return {p.relative_to(path).as_posix(): p.read_bytes() for p in files}


def copy(source: Path, target: Path) -> None:
    remove(target)
    shutil.copytree(source, target) if source.is_dir() else shutil.copy2(source, target)


def short(path: Path) -> str:
    return path.as_posix().removeprefix("store/")


def inside(path: Path, fault: Fault) -> bool:
    """The fault is that of this path, or of something in it."""
    return named(path, fault) or fault.where.startswith(f"{short(path)}/")


def outcome(run: Path) -> dict[str, object]:
    """What must be the same after everything."""
    result = RunResult.load(run)
    turns = {f"{t.iteration} {t.arm}": (t.model, t.snapshot, t.test) for t in result.iterations}
    return turns | {"pooled": result.pooled, "finished": result.finished}


def test_going_back_sets_what_is_damaged_aside_and_the_run_comes_to_the_same_end(
    finished, tmp_path
):
    run = tmp_path / "run"
    shutil.copytree(finished, run)
    (array,) = run.glob(ALONE["array"])
    for victim in (array, run / FILES["weights"]):
        flip(victim)
    copy(run / FILES["snapshot"], run / "store/snapshots/i0001-control.json")
    (run / "iterations/notes.txt").write_text("mine")
    before = len(contents(run))
    assert f"rewind {run} 1" in refused(run)

    moved = rewind(RunFolder(run), TrajectoryStore(run / "store"), 1)
    assert {"result.json", "iterations/i0001-mppi.json", "iterations/notes.txt"} <= set(moved)
    assert f"segments/{MINE}" in moved and "segments/i0001-control-collect-0000" not in moved
    assert "segments/i0001-mppi-evaluate-0000" in moved, "the model that drove it does not stay"
    assert len(contents(run)) == before, "nothing is lost"
    assert look(run) == []

    Bench(run, **SMALL).turn(resume=True)
    assert outcome(run) == outcome(finished)
    assert look(run) == []


def test_one_does_not_go_back_to_what_is_not_sound_itself(finished, tmp_path):
    folder, store = RunFolder(finished), TrajectoryStore(finished / "store")
    for number in (-1, 3):
        with pytest.raises(RunError, match=f"iterations 0 to 1, and 2 for its end; got {number}"):
            rewind(folder, store, number)
    first = finished / "iterations/i0000-mppi.json"
    with kept(first):
        flip(first)
        before = contents(finished)
        with pytest.raises(RunError, match="Nothing was set aside.*i0000-mppi.*Go back to 0"):
            rewind(folder, store, 1)
        assert contents(finished) == before
    robot = finished / "robot.xml"
    with kept(robot), pytest.raises(RunError, match="robot.xml.*Restore a copy of it"):
        flip(robot)
        rewind(folder, store, 0)
