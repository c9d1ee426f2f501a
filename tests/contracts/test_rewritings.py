"""One robot written down in two ways is one robot: the same numbers, to the last digit."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import torch

from flywheel.diagnosis import Diagnosis, Verdict, diagnose
from flywheel.dynamics.gnn.config import NetworkConfig
from flywheel.dynamics.gnn.graph import RobotGraph
from flywheel.dynamics.plant import AugmentedPlant, Plant
from flywheel.dynamics.plant.refined import refined
from flywheel.effects import EFFECTS, NAMED, Scales, Term
from flywheel.records import Observation, State, Trajectory
from flywheel.robots import ROBOTS, Box, Robot, load_robot, read_robot
from flywheel.terrain import Terrain, with_boxes
from flywheel.truth_simulator.body_effects import Payload
from flywheel.truth_simulator.ground_effects import RollingResistance
from flywheel.truth_simulator.simulator import TruthSimulator
from tests.contracts.rewritings import ORDERED, WRITTEN, Rewriting, in_pairs, rewritten

SMALL = {
    path.stem: path.read_text() for path in sorted(Path(__file__).with_name("robots").glob("*.xml"))
}
XML = SMALL | {name: load_robot(name).xml for name in ROBOTS}
STEPS, SEED = 12, 7
NAMELESS = ("name", "sensor", "xml", "digest")


def commands(robot: Robot, steps: int) -> np.ndarray:
    """(1, steps, W) that move every winch."""
    rng = np.random.default_rng(SEED)
    return rng.uniform(robot.control_low, robot.control_high, (1, steps, len(robot.winches)))


def surroundings(robot: Robot) -> dict[str, dict[str, Any]]:
    """Nothing; boxes, and hills, of which some reach a little into what is lowest of the robot."""
    plant = Plant(robot)
    points = plant.observe(plant.rest()).points[0]
    bottom = points - np.array([[0.0, 0.0, point.radius] for point in robot.points])
    x, y, z = (float(number) for number in bottom[bottom[:, 2].argmin()])
    top = z + 0.003 * robot.length
    boxes = (
        Box(center=(x, y, top - 0.3), half_size=(0.2, 0.2, 0.3)),
        Box(center=(x + 1.0, y, top - 0.3), half_size=(0.5, 3.0, 0.3)),
    )
    walled = {"terrain": with_boxes(None, boxes)}
    found: dict[str, dict[str, Any]] = {"alone": {}, "among boxes": walled}
    if robot.grounded:
        slope = 0.2 * np.arange(-8, 8.1, 0.4)[:, None] * np.ones(41)
        hills = Terrain(slope - 0.2 * x + top, 0.4, (-8.0, -8.0))
        found["on hills"] = {"terrain": hills}
    return found


def terms_of(robot: Robot, place: int = -1) -> list[tuple[Term, ...]]:
    """Effects of typical size, each on its own, at the last of their places."""
    scales = Scales.of(robot)
    return [
        (Term(e, e.places(robot)[place], tuple(p.typical(scales) for p in e.parameters)),)
        for e in NAMED.values()
    ]


def plain(value: Any) -> Any:
    """A record without names, as nested tuples and arrays."""
    if is_dataclass(value) and not isinstance(value, type):
        return tuple(plain(getattr(value, f.name)) for f in fields(value) if f.name not in NAMELESS)
    if isinstance(value, tuple | list):
        return tuple(plain(each) for each in value)
    return value.numpy() if isinstance(value, torch.Tensor) else value


def leaves(value: Any) -> Iterator[Any]:
    if isinstance(value, tuple):
        for each in value:
            yield from leaves(each)
    else:
        yield value


def numbers(robot: Robot) -> dict[str, Sequence[Any]]:
    """Everything that is made of a robot without its names."""
    graph = RobotGraph(robot, NetworkConfig())
    found: dict[str, Any] = {
        "the robot": plain(robot),
        "its graph": plain((graph.nodes, graph.node_constants, tuple(graph.relations.values()))),
    }
    controls, terms = commands(robot, STEPS), terms_of(robot)
    for where, around in surroundings(robot).items():
        plant = Plant(robot, **around)
        start = plant.rest()
        moved = plant.simulate(start, controls)
        found[f"the plant {where}"] = plain((moved.states, moved.observations))
        augmented = AugmentedPlant(plant)
        many = State(*(np.repeat(a, len(terms), 0) for a in (start.qpos, start.qvel, start.act)))
        told = augmented.commands(np.repeat(controls, len(terms), 0), terms)
        motion = augmented.simulate(many, told, terms)
        found |= {
            f"{term.effect.name} {where}": plain((motion.points[row], motion.states[row]))
            for row, (term,) in enumerate(terms)
        }
    finer = refined(Plant(robot)).simulate(plant.rest(), controls)
    found["in shorter steps"] = plain(finer.states)
    hidden = (Payload(0.3 * Scales.of(robot).mass, len(robot.points) - 1), RollingResistance(0.01))
    truth = TruthSimulator(robot, hidden).run(controls[0], 0.01, settle=0.05)
    found["the hidden simulator"] = plain(truth)
    return {what: tuple(leaves(value)) for what, value in found.items()}


@cache
def original(name: str) -> Mapping[str, Sequence[Any]]:
    return numbers(read_robot(XML[name]))


@pytest.mark.slow
@pytest.mark.parametrize("rewriting", WRITTEN.values(), ids=WRITTEN)
@pytest.mark.parametrize(
    "name",
    [  # small robots that have everything between them, and the first of the shipped ones
        pytest.param(name, marks=[] if name in {*SMALL, "prism3"} else [pytest.mark.nightly])
        for name in XML
    ],
)
def test_a_robot_in_other_words_gives_the_same_numbers(name: str, rewriting) -> None:
    again = numbers(read_robot(rewritten(XML[name], rewriting)))
    differing = [
        what
        for what, values in original(name).items()
        if not all(map(np.array_equal, values, again[what]))
    ]
    assert differing == []


@pytest.mark.parametrize("name", XML)
def test_what_stands_around_is_touched_and_nearly_every_effect_is_felt(name: str) -> None:
    """Else numbers would be the same whatever was wrong."""
    found = original(name)
    wheres = [what.removeprefix("the plant ") for what in found if what.startswith("the plant ")]
    for where in wheres[1:]:
        assert not np.array_equal(found[f"the plant {where}"][0], found["the plant alone"][0])
        felt = [
            each
            for each in NAMED
            if not np.array_equal(found[f"{each} {where}"][0], found[f"the plant {where}"][3][0])
        ]
        assert len(felt) > 0.8 * len(NAMED), set(NAMED) - set(felt)


# --- In another order


@dataclass(frozen=True)
class Order:
    """Where the original's elements are in a robot that is the same in another order.

    Attributes:
      bodies, points, cables, winches: (n,) indices, the original's first element first.
      actuators: (na,) of the activations.
    """

    bodies: np.ndarray
    points: np.ndarray
    cables: np.ndarray
    winches: np.ndarray
    activations: np.ndarray

    @classmethod
    def of(cls, robot: Robot, again: Robot) -> "Order":
        def where(kind: str) -> np.ndarray:
            names = [each.name for each in getattr(again, kind)]
            return np.array([names.index(each.name) for each in getattr(robot, kind)])

        first, second = (mujoco.MjModel.from_xml_string(r.xml) for r in (robot, again))
        active = [a for a in range(first.nu) if first.actuator_actadr[a] >= 0]
        there = [second.actuator(first.actuator(a).name).actadr[0] for a in active]
        here = first.actuator_actadr[active]
        return cls(
            *(where(kind) for kind in ("bodies", "points", "cables", "winches")),
            np.array(there)[np.argsort(here)],
        )

    def state(self, state: State) -> State:
        """The original's states (n,) as those of the other one."""
        poses = state.qpos.reshape(len(state.qpos), -1, 7)
        speeds = state.qvel.reshape(len(state.qvel), -1, 6)
        rows = (_sorted_out(a, by) for a, by in ((poses, self.bodies), (speeds, self.bodies)))
        qpos, qvel = (a.reshape(len(a), -1) for a in rows)
        return State(qpos, qvel, _sorted_out(state.act, self.activations))

    def term(self, term: Term) -> Term:
        """The same effect at the same place."""
        if term.place is None:
            return term
        ends = 2 * self.cables[:, None] + np.arange(2)
        where = {
            "cable": self.cables, "point": self.points, "winch": self.winches, "body": self.bodies,
            "end": ends.ravel(),
        }  # fmt: skip
        return replace(term, place=int(where[term.effect.where][term.place]))


def _sorted_out(values: np.ndarray, order: np.ndarray) -> np.ndarray:
    """Columns (n, k, ...) of the original where the other one has them."""
    there = np.empty_like(values)
    there[:, order] = values
    return there


def edges(robot: Robot) -> list[tuple[Any, ...]]:
    """All edges of a robot's graph by what they connect, and all that the graph knows of them.

    Of the graph only `designated` is left out: it says which rod of several alike shows the heading.
    """
    graph = RobotGraph(robot, NetworkConfig())

    def about(number: int) -> tuple[Any, ...]:
        if number == graph.ground:
            return ("ground",)
        if number >= graph.body_count:
            return ("anchor", *np.round(graph.anchors[:, number - graph.body_count].numpy(), 5))
        node, constants = graph.nodes[number], graph.node_constants[number].numpy()
        point = robot.points[node.point].name if node.point >= 0 else ""
        numbers = (*node.offset, node.radius, node.mass, *np.round(constants, 4) + 0.0)
        return (robot.bodies[node.body].name, point, *np.round(numbers, 6) + 0.0)

    found: list[tuple[Any, ...]] = []
    for kind, relation in graph.relations.items():
        for row, (sender, receiver) in enumerate(
            zip(relation.senders.tolist(), relation.receivers.tolist(), strict=True)
        ):
            more: tuple[Any, ...] = tuple(np.round(relation.constants[row].numpy(), 4) + 0.0)
            if kind == "cable":
                winch = int(graph.cable_winch[row])
                driven = robot.winches[winch].name if winch < len(robot.winches) else ""
                rest = round(float(graph.rest_offset[row]), 5)
                more += (robot.cables[int(relation.origin[row]) // 2].name, driven, rest)
            found.append((kind, about(sender), about(receiver), *more))
    return sorted(found, key=repr)


def stepped(
    plant: Plant, start: State, controls: np.ndarray, terms: list[tuple[Term, ...]]
) -> tuple[State, np.ndarray]:
    """Where a few steps lead, with each of some effects."""
    augmented = AugmentedPlant(plant)
    many = State(*(np.repeat(a, len(terms), 0) for a in (start.qpos, start.qvel, start.act)))
    told = augmented.commands(np.repeat(controls, len(terms), 0), terms)
    motion = augmented.simulate(many, told, terms)
    return motion.states[:, -1], motion.points[:, -1]


@pytest.mark.parametrize("rewriting", ORDERED.values(), ids=ORDERED)
@pytest.mark.parametrize("name", XML)
def test_a_robot_in_another_order_moves_alike(name: str, rewriting) -> None:
    moves_alike(name, rewriting)


@pytest.mark.slow
@pytest.mark.parametrize("name", ROBOTS)
def test_a_robot_whose_contacts_are_listed_in_pairs_moves_alike(name: str) -> None:
    moves_alike(name, in_pairs)


def moves_alike(name: str, rewriting: Rewriting) -> None:
    """Nothing, or any effect, leads the robot to the same place anywhere."""
    robot, again = (read_robot(xml) for xml in (XML[name], rewritten(XML[name], rewriting)))
    order = Order.of(robot, again)
    assert edges(again) == edges(robot)
    terms = [(), *terms_of(robot, 0)]
    ordered = [tuple(order.term(term) for term in each) for each in terms]
    controls = commands(robot, STEPS)
    there = _sorted_out(controls.swapaxes(1, 2), order.winches).swapaxes(1, 2)
    for where, around in surroundings(robot).items():
        plant = Plant(robot, **around)
        moving = plant.simulate(plant.rest(), controls).states[:, -1]
        states, points = stepped(plant, moving, controls[:, :2], terms)
        got, seen = stepped(Plant(again, **around), order.state(moving), there[:, :2], ordered)
        for field in ("qpos", "qvel", "act"):
            wanted = getattr(order.state(states), field)
            np.testing.assert_allclose(getattr(got, field), wanted, 1e-10, 1e-10, err_msg=where)
        np.testing.assert_allclose(seen[:, order.points], points, 1e-10, 1e-10, err_msg=where)


# --- The same answer


def recording(robot: Robot, seconds: float = 1.5) -> Trajectory:
    """A log of a robot that carries more than its MJCF says at its last point."""
    rng = np.random.default_rng(SEED)
    knots = rng.uniform(robot.control_low, robot.control_high, (15, len(robot.winches)))
    controls = np.repeat(knots, round(100 * seconds / len(knots)), axis=0)
    augmented, effect = AugmentedPlant(Plant(robot)), EFFECTS["payload"]
    size = 3.0 * effect.sizes[0].typical(Scales.of(robot))
    terms = [(Term(effect, len(robot.points) - 1, (size,)),)]
    told = augmented.commands(controls[None], terms)
    points = augmented.simulate(augmented.plant.settle(1.0), told, terms).points[0]
    winch = np.full((len(points), len(robot.winches)), np.nan)
    seen = Observation(points + rng.normal(scale=0.001, size=points.shape), winch)
    return Trajectory(seen, controls, augmented.plant.dt)


def answer(found: Diagnosis) -> list[Any]:
    """Verdict, effects, sizes, intervals, and the scores of all candidates; without names."""
    effects = [
        (each.effect, each.term.place, plain(each.values)) for way in found.answers for each in way
    ]
    scores = [(s.candidate.effect.name, s.candidate.place, s.score, s.sizes) for s in found.ranking]
    return [found.verdict, *effects, *scores, found.errors]


def diagnosed(robot: Robot, log: Trajectory) -> Diagnosis:
    asked = ("payload", "marker_offset", "weak_cable", "command_delay", "cable_friction")
    return diagnose(Plant(robot), [log], library={name: EFFECTS[name] for name in asked})


@cache
def original_answer() -> tuple[Trajectory, Diagnosis]:
    robot = read_robot(XML["swing"])
    log = recording(robot)
    return log, diagnosed(robot, log)


@pytest.mark.slow
@pytest.mark.parametrize(
    "rewriting",
    [  # all of them give the same numbers, above; one shows that a diagnosis rests on nothing else
        pytest.param(each, id=name, marks=[pytest.mark.nightly] if number else [])
        for number, (name, each) in enumerate(WRITTEN.items())
    ],
)
def test_a_robot_in_other_words_lacks_the_same_to_the_last_digit(rewriting) -> None:
    log, first = original_answer()
    assert first.verdict is Verdict.EFFECT
    again = diagnosed(read_robot(rewritten(XML["swing"], rewriting)), log)
    assert answer(again) == answer(first)


@pytest.mark.slow
@pytest.mark.parametrize("rewriting", ORDERED.values(), ids=ORDERED)
def test_a_robot_in_another_order_lacks_the_same(rewriting) -> None:
    log, first = original_answer()
    robot = read_robot(XML["swing"])
    again = read_robot(rewritten(XML["swing"], rewriting))
    order, seen = Order.of(robot, again), log.observations
    there = Trajectory(
        Observation(_sorted_out(seen.points, order.points), _sorted_out(seen.winch, order.winches)),
        _sorted_out(log.controls, order.winches),
        log.dt,
    )
    found = diagnosed(again, there)
    assert found.verdict is first.verdict
    (wanted,), (got,) = first.answers[0], found.answers[0]
    assert (got.effect, got.location) == (wanted.effect, wanted.location)
    assert got.values[0].value == pytest.approx(wanted.values[0].value, rel=0.02)
