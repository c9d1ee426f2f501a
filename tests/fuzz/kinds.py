"""What can be spoilt: every kind of input that somebody hands over, and how it is asked about.

A kind draws spoilt inputs from good ones, and says what became of one: None where it was taken, the
message where it was refused on purpose. Anything else that is raised is a fault.
"""

import csv
import io
import json
import random
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import hypothesis.strategies as st
import numpy as np
import yaml
from hypothesis import HealthCheck, Phase, given, seed, settings

from flywheel.dynamics.gnn import load_weights
from flywheel.dynamics.plant import Plant
from flywheel.effects import AdoptedPlant
from flywheel.errors import RobotError
from flywheel.options import AdaptOptions
from flywheel.robots import load_course, load_robot, read_robot
from flywheel.robots.adapt import adapt
from flywheel.robots.problems import listed
from flywheel.runtime.config.run_config import load_config
from tests.fuzz import mutators, samples
from tests.fuzz.asking import Kind, Spoilt, command, refusal
from tests.fuzz.formats import log_formats
from tests.unit.robots.lab_files import ADAPTABLE
from tests.unit.robots.test_structures import NET, PLATFORM


def invented(strategy: st.SearchStrategy[Any], count: int = 300) -> list[Any]:
    """Values that Hypothesis thinks of; the same ones every time."""
    found: list[Any] = []

    @seed(0)
    @settings(
        max_examples=count,
        database=None,
        deadline=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(strategy)
    def collect(value: Any) -> None:
        found.append(value)

    collect()
    return found


SCALARS = (
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20) | st.dates()
)
TREES = st.recursive(
    SCALARS, lambda each: st.lists(each) | st.dictionaries(st.text(max_size=8), each), max_leaves=20
)


def csv_logs(work: Path) -> Kind:
    """Logs as CSV, given to an import that stores nothing."""
    good = samples.log(work)
    with good.open(newline="") as file:
        rows = list(csv.reader(file))
    texts = invented(st.text(alphabet=',;\t"\n\r 0123456789.eE+-naif\0x', max_size=300), 200)

    def draw(rng: random.Random) -> Spoilt:
        how = rng.randrange(8)
        if how == 0:
            return Spoilt(rng.choice(texts).encode())
        if how < 4:
            return Spoilt(mutators.of_bytes(good.read_bytes(), rng))
        out = io.StringIO()
        separator = rng.choice(",,,;\t")
        csv.writer(out, delimiter=separator).writerows(mutators.of_rows(rows, rng))
        return Spoilt(out.getvalue().encode("utf-8", "replace"))

    def ask(spoilt: Spoilt, inside: Path) -> str | None:
        (inside / "log.csv").write_bytes(spoilt.content)
        return command(
            "recordings", "import", "log.csv", "--robot", "prism3", "--store", "st", "--dry-run"
        )

    return Kind("csv", (Spoilt(good.read_bytes()),), draw, ask)


def maps(work: Path) -> Kind:
    """Maps of logs, as YAML."""
    good = samples.MAP
    log = samples.log(work)
    trees = [good, *invented(TREES, 100)]

    def ask(spoilt: Spoilt, inside: Path) -> str | None:
        (inside / "map.yaml").write_bytes(spoilt.content)
        words = ("recordings", "import", str(log), "--robot", "prism3", "--store", "st")
        return command(*words, "--dry-run", "--map", "map.yaml")

    return Kind("map", (_yaml(good),), lambda rng: Spoilt(_spoilt_yaml(trees, rng)), ask)


def configs(work: Path) -> Kind:
    """Configurations of a run, as YAML, and files that they extend."""
    good = [yaml.safe_load(path.read_text()) for path in samples.CONFIGS]
    whole = load_config(samples.CONFIGS[0]).model_dump(mode="json")

    def ask(spoilt: Spoilt, inside: Path) -> str | None:
        for path in samples.CONFIGS:
            shutil.copy(path, inside)
        (inside / "spoilt.yaml").write_bytes(spoilt.content)
        return refusal(lambda: load_config(inside / "spoilt.yaml"))

    trees = [*good, whole, whole]
    return Kind(
        "config", tuple(map(_yaml, trees)), lambda rng: Spoilt(_spoilt_yaml(trees, rng)), ask
    )


def overrides(work: Path) -> Kind:
    """Settings on the command line."""
    whole = load_config(samples.CONFIGS[0]).model_dump(mode="json")
    paths = [".".join(map(str, path)) for path in _paths(whole)]
    texts = invented(st.text(max_size=40), 300)

    def draw(rng: random.Random) -> Spoilt:
        words = []
        for _ in range(rng.choice((1, 1, 2, 5))):
            key = rng.choice(paths) if rng.random() < 0.8 else rng.choice(texts)
            value = rng.choice(mutators.STRANGE_NUMBERS + mutators.STRANGE_TEXTS + tuple(texts))
            words.append(f"{key}={value}" if rng.random() < 0.95 else key)
        return Spoilt(json.dumps(words).encode())

    def ask(spoilt: Spoilt, inside: Path) -> str | None:
        words = json.loads(spoilt.content)
        return refusal(lambda: load_config(samples.CONFIGS[0], words))

    return Kind("overrides", (Spoilt(b'["seed=1"]'),), draw, ask)


def mjcfs(work: Path) -> Kind:
    """Robots, read and let fall for a moment."""
    good = [load_robot(name).xml for name in samples.ROBOTS]

    def ask(spoilt: Spoilt, inside: Path) -> str | None:
        path = inside / "robot.xml"
        path.write_bytes(spoilt.content)

        def used() -> None:
            robot = read_robot(path)
            plant = Plant(robot, dt=robot.timestep)
            hold = robot.holding(plant.winch(plant.rest()))[:, None]
            seen = plant.simulate(plant.rest(), np.repeat(hold, 5, axis=1)).observations.points
            assert np.isfinite(seen).all()

        return refusal(used)

    written = tuple(Spoilt(text.encode()) for text in good)
    return Kind("mjcf", written, lambda rng: Spoilt(_spoilt_mjcf(good, rng)), ask)


def laboratories(work: Path) -> Kind:
    """MJCFs of laboratories, adapted as far as they can be."""
    good = []
    for make in ADAPTABLE:
        text = make(work).read_text()
        if "<include" not in text:
            good.append(text)

    def ask(spoilt: Spoilt, inside: Path) -> str | None:
        path = inside / "lab.xml"
        path.write_bytes(spoilt.content)

        def used() -> None:
            winches = () if b"<actuator" in spoilt.content else ("*",)
            adapted = adapt(path, AdaptOptions(winches))
            if adapted.left:
                raise RobotError(listed(adapted.left))
            read_robot(adapted.xml)

        return refusal(used)

    written = tuple(Spoilt(text.encode()) for text in good)
    return Kind("laboratory", written, lambda rng: Spoilt(_spoilt_mjcf(good, rng)), ask)


def structures(work: Path) -> Kind:
    """Structures in YAML that are no MJCF, to be adapted."""
    good = [NET, PLATFORM]
    trees = [*good, *invented(TREES, 50)]

    def ask(spoilt: Spoilt, inside: Path) -> str | None:
        (inside / "structure.yaml").write_bytes(spoilt.content)
        return refusal(lambda: adapt(inside / "structure.yaml"))

    return Kind(
        "structure", tuple(map(_yaml, good)), lambda rng: Spoilt(_spoilt_yaml(trees, rng)), ask
    )


def courses(work: Path) -> Kind:
    """Obstacle courses, as MJCF."""
    good = [path.read_text() for path in samples.COURSES]

    def ask(spoilt: Spoilt, inside: Path) -> str | None:
        (inside / "course.xml").write_bytes(spoilt.content)
        return refusal(lambda: load_course(str(inside / "course.xml")))

    written = tuple(Spoilt(text.encode()) for text in good)
    return Kind("course", written, lambda rng: Spoilt(_spoilt_mjcf(good, rng)), ask)


def answers(work: Path) -> Kind:
    """Answers of a diagnosis, as JSON, to be adopted."""
    good = samples.answers()
    trees = [*good, *good, *invented(TREES, 60)]

    def ask(spoilt: Spoilt, inside: Path) -> str | None:
        (inside / "answer.json").write_bytes(spoilt.content)
        return command("adopt", "answer.json", "--robot", "prism3", "--out", "plants")

    written = tuple(Spoilt(json.dumps(each).encode()) for each in good)
    return Kind("answer", written, lambda rng: Spoilt(_spoilt_json(trees, rng)), ask)


def plants(work: Path) -> Kind:
    """Adopted plants, as YAML."""
    folder = samples.plant(work)
    good = yaml.safe_load((folder / "plant.yaml").read_text())

    def ask(spoilt: Spoilt, inside: Path) -> str | None:
        shutil.copytree(folder, inside / "plant")
        (inside / "plant" / "plant.yaml").write_bytes(spoilt.content)
        return refusal(lambda: AdoptedPlant.read(inside / "plant"))

    return Kind("plant", (_yaml(good),), lambda rng: Spoilt(_spoilt_yaml([good], rng)), ask)


def weights(work: Path) -> Kind:
    """Weights of a network, and the file beside them that says what they are."""
    robot = load_robot("prism3")
    folder = samples.weights(work)
    about = json.loads((folder / "w.json").read_text())

    def draw(rng: random.Random) -> Spoilt:
        if rng.random() < 0.5:
            return Spoilt(_spoilt_json([about], rng), "w.json")
        if rng.random() < 0.5:
            return Spoilt(mutators.of_bytes((folder / "w.npz").read_bytes(), rng), "w.npz")
        return Spoilt(_spoilt_arrays(folder / "w.npz", rng), "w.npz")

    def ask(spoilt: Spoilt, inside: Path) -> str | None:
        shutil.copytree(folder, inside / "weights")
        (inside / "weights" / spoilt.file).write_bytes(spoilt.content)
        return refusal(lambda: load_weights(inside / "weights" / "w.npz", robot))

    good = tuple(Spoilt((folder / name).read_bytes(), name) for name in ("w.json", "w.npz"))
    return Kind("weights", good, draw, ask)


def runs(work: Path) -> Kind:
    """Any file of a finished run and its store: spoilt, gone, or another of its files in its place.

    What is spoilt has to be found by `data verify`; other commands end as they should.
    """
    folder = samples.run(work)
    files = sorted(path.relative_to(folder) for path in folder.rglob("*") if path.is_file())

    def draw(rng: random.Random) -> Spoilt:
        file = rng.choice(files)
        content = (folder / file).read_bytes()
        if rng.random() < 0.25:
            other = rng.choice([each for each in files if each.suffix == file.suffix])
            return Spoilt((folder / other).read_bytes(), str(file))
        if file.suffix == ".json" and rng.random() < 0.6:
            return Spoilt(_spoilt_json([json.loads(content)], rng), str(file))
        return Spoilt(mutators.of_bytes(content, rng), str(file))

    def ask(spoilt: Spoilt, inside: Path) -> str | None:
        shutil.copytree(folder, inside / "run")
        spoilt_file = inside / "run" / spoilt.file
        same = spoilt_file.read_bytes() == spoilt.content
        spoilt_file.write_bytes(spoilt.content)
        found = command("data", "verify", "run")
        command("summary", "run")
        if found is None and not same:
            raise AssertionError(f"{spoilt.file} was changed, and nothing says so")
        return found

    good = (Spoilt((folder / files[0]).read_bytes(), str(files[0])),)
    return Kind("run", good, draw, ask)


def _yaml(tree: Any) -> Spoilt:
    return Spoilt(yaml.safe_dump(tree, sort_keys=False).encode())


def _spoilt_yaml(trees: Sequence[Any], rng: random.Random) -> bytes:
    tree = rng.choice(trees)
    if rng.random() < 0.5:
        return mutators.of_bytes(yaml.safe_dump(tree, sort_keys=False).encode(), rng)
    return yaml.safe_dump(mutators.of_tree(tree, rng), sort_keys=False).encode("utf-8", "replace")


def _spoilt_mjcf(texts: Sequence[str], rng: random.Random) -> bytes:
    text = rng.choice(texts)
    if rng.random() < 0.25:
        return mutators.of_bytes(text.encode(), rng)
    return mutators.of_xml(text, rng).encode("utf-8", "replace")


def _spoilt_json(trees: Sequence[Any], rng: random.Random) -> bytes:
    tree = rng.choice(trees)
    if rng.random() < 0.4:
        return mutators.of_bytes(json.dumps(tree, default=str).encode(), rng)
    return json.dumps(mutators.of_tree(tree, rng), default=str).encode()


def _spoilt_arrays(path: Path, rng: random.Random) -> bytes:
    """An .npz with arrays that are missing, more, of other shapes, types or values."""
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    for _ in range(rng.choice((1, 1, 3))):
        name = rng.choice(list(arrays))
        how = rng.randrange(7)
        if how == 0 and len(arrays) > 1:
            del arrays[name]
        elif how == 1:
            arrays[rng.choice(mutators.STRANGE_TEXTS[:5])] = arrays[name]
        elif how == 2:
            arrays[name] = arrays[name].astype(rng.choice(("f8", "i4", "c16", "U8", "?", "f2")))
        elif how == 3:
            arrays[name] = arrays[name].ravel()
        elif how == 4:
            arrays[name] = np.zeros((rng.choice((0, 1, 10**6, 10**8)), 1), np.int8)
        elif how == 5:
            arrays[name] = np.array(["x"], dtype=object)
        else:
            arrays[name] = np.full_like(arrays[name], np.nan)
    out = io.BytesIO()
    np.savez_compressed(out, **arrays)
    return out.getvalue()


def _paths(tree: Any, above: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Every node of nested mappings and lists."""
    keys = tree if isinstance(tree, dict) else range(len(tree)) if isinstance(tree, list) else ()
    return [path for key in keys for path in ((*above, key), *_paths(tree[key], (*above, key)))]


KINDS: dict[str, Callable[[Path], Kind]] = {
    "csv": csv_logs,
    "map": maps,
    "formats": log_formats,
    "config": configs,
    "overrides": overrides,
    "mjcf": mjcfs,
    "laboratory": laboratories,
    "structure": structures,
    "course": courses,
    "answer": answers,
    "plant": plants,
    "weights": weights,
    "run": runs,
}
