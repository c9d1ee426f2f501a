"""An error budget of a network: its error if one part of the predicted state were the plant's.

    python -m benchmarks.budget [ROBOT] [--weights FILE]    a minute of one core: results and figure
    python -m benchmarks.tables                             makes the tables of docs/results/budget.md from it

Episodes with random controls that no training has seen are simulated on the plant of the MJCF. The network
predicts 2 s from random starts in them; between its prediction chunks one part of the state is replaced.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from matplotlib.figure import Figure
from numpy.typing import NDArray
from torch import Tensor

from benchmarks.command import parser_of
from benchmarks.rows import RESULTS, other_rows, rows_there, write_rows
from flywheel.dynamics import Persistence, RestartedPlant
from flywheel.dynamics.gnn import ChunkNetwork, Simulator, load_weights, weights_digest
from flywheel.dynamics.gnn.compiled_network import prepared
from flywheel.dynamics.gnn.features import GraphFeatures, MechanicalState
from flywheel.dynamics.gnn.graph import RobotGraph
from flywheel.dynamics.gnn.learned import BLOCK
from flywheel.dynamics.gnn.prediction import Forward, Memory, Prediction
from flywheel.dynamics.gnn.shipped import shipped_weights
from flywheel.dynamics.gnn.simulator import step_of
from flywheel.dynamics.gnn.step import Motion, Parts
from flywheel.dynamics.plant import MeasurementModel
from flywheel.dynamics.plant.poses import FREE_POSITIONS
from flywheel.dynamics.protocol import Dynamics
from flywheel.dynamics.rigid_bodies.ground import Ground
from flywheel.dynamics.threads import shares
from flywheel.errors import ConfigError, FlywheelError
from flywheel.evaluation import HISTORY_SECONDS, ErrorTable, squared_position_error
from flywheel.outputs import write_output
from flywheel.records import Floats, Observation, Past, State
from flywheel.reports import style
from flywheel.reports.pictures import as_file
from flywheel.robots import ROBOTS, Robot, load_robot
from flywheel.rotations import rotate
from flywheel.runtime.config.run_config import RunConfig
from flywheel.runtime.workers.episode_plan import EpisodePlan
from flywheel.runtime.workers.episode_recorder import EpisodeRecorder
from flywheel.validation import validated

Flags = NDArray[np.bool_]
BUDGET_CSV, REGIONS_CSV = RESULTS / "budget.csv", RESULTS / "budget_regions.csv"
FIGURES = Path(__file__).parents[1] / "docs" / "results" / "budget"
EPISODES, SECONDS, STARTS, HORIZON = 40, 15.0, 25, 2.0
FIRST_SEED = 20_000_000  # of the episodes; no run derives them but by chance in 2^32
NOISE = 0.003  # of the points, as in the training of the shipped networks [fraction of the length]
NEAR = 0.01  # lower than this a node touches the ground [fraction of the length]
PAST, MEMORY, GROUND = "past", "memory", "ground"  # what is replaced beside fields of the state
AS_IS, CLEAN, EVERYTHING = "nothing", "the measured past, by one without noise", "everything"
RESTARTED, STILL = "MuJoCo restarted from the same past", "nothing moves"
COASTING = "everything, and nothing accelerates"
EACH_CHUNK = "the same, restarted again from its own points at every chunk"
KEPT = "that, but rods keep their roll"
CASES: dict[str, tuple[str, ...]] = {
    AS_IS: (),
    CLEAN: (PAST,),
    "the LSTM's memory, by an empty one": (MEMORY,),
    "winch positions": ("winch",),
    "rods' roll": ("sides",),
    "distances to the ground": (GROUND,),
    "velocities": ("velocities",),
    "poses": ("frames",),
    "poses and velocities": ("frames", "velocities"),
    EVERYTHING: ("frames", "velocities", "winch", "sides"),
}
DRAWN: dict[str, dict[str, Any]] = {
    AS_IS: {"color": style.INK},
    CLEAN: {"color": style.CONTROL, "linestyle": "--"},
    "rods' roll": {"color": style.FAINT},
    "velocities": {"color": style.MPPI},
    "poses": {"color": style.MISSED},
    EVERYTHING: {"color": style.ORACLE},
    RESTARTED: style.INFORMED_LINE,
    STILL: style.PERSISTENCE_LINE,
}


@dataclass(frozen=True)
class BudgetRow:
    """Errors of the robot's network with one substitution, or of a model beside it.

    `e_pos` is the RMSE of the centres of mass over the horizon [% of the robot's length], `e_rot` the mean
    angle [deg], `first` the RMSE after the first chunk [mm], `later` that of the way in a later one [mm].
    """

    robot: str
    weights: str
    replaced: str
    e_pos: float
    e_rot: float
    first: float
    later: float


@dataclass(frozen=True)
class RegionRow:
    """Shares of the windows in which something happens, and of the squared error there [%].

    `chunks` and `chunk_error` are those of single chunks, each of which begins with the plant's state.
    """

    robot: str
    region: str
    windows: float
    error: float
    chunks: float
    chunk_error: float


class Substituting:
    """A `Step` that replaces parts of the state by those in `truth`, before every chunk but the first."""

    def __init__(self, parts: Parts, replaced: Sequence[str]) -> None:
        self._step, self._replaced = step_of(parts), set(replaced)
        self._millimetres = parts.config.load_features
        self.truth: Iterator[MechanicalState | None] = iter(())

    def features(
        self,
        state: MechanicalState,
        origin: Tensor,
        controls: Tensor,
        dataset: Tensor,
        ground: Ground,
    ) -> GraphFeatures:
        """See `Step`."""
        truth = next(self.truth) or state
        held = {field.name for field in dataclasses.fields(state)} & self._replaced
        known = {name: getattr(truth, name) for name in held if getattr(state, name) is not None}
        self._state = dataclasses.replace(state, **known)
        shown = self._step.features(self._state, origin, controls, dataset, ground)
        if GROUND in self._replaced:
            true = self._step.features(truth, origin, controls, dataset, ground)
            for row in (3, -4) if self._millimetres else (3,):
                shown.nodes["body_node"][row] = true.nodes["body_node"][row]
            shown.edges["contact"][0] = true.edges["contact"][0]
            shown = dataclasses.replace(shown, touching=true.touching)
        return shown

    def advance(
        self, state: MechanicalState, origin: Tensor, said: Prediction, commands: Tensor
    ) -> tuple[MechanicalState, Motion]:
        """See `Step`; continues from the state after the replacement."""
        return self._step.advance(self._state, origin, said, commands)


@dataclass(frozen=True)
class Forgetful:
    """A `Forward` that predicts each chunk with an empty memory."""

    forward: Forward

    def warm_up(self, nodes: Tensor, dataset: Tensor, memory: Memory | None) -> Memory | None:
        """See `Forward`."""
        return self.forward.warm_up(nodes, dataset, memory)

    def __call__(self, features: GraphFeatures, memory: Memory | None) -> Prediction:
        """See `Forward`."""
        return self.forward(features, None)


class Budget:
    """B windows of a plant's episodes, and predictions in them: h steps of past, T ahead.

    Args:
      robot: of the network; all bodies free.
      network: the weights.
      noise: of the points [fraction of the robot's length].
      episodes, starts: how many, and windows in each.

    Attributes:
      seen, known: (B, h + 1, P, 3) measured points, (B, h + 1, W) known winch positions [m].
      points, states: (B, h + T + 1, P, 3) without noise [m], and (B, h + T + 1) of the plant.
      controls: (B, h + T, W).
      truth: (B, T, P, 3) points at the predicted steps, without noise [m].
    """

    def __init__(
        self,
        robot: Robot,
        network: ChunkNetwork,
        noise: float = NOISE,
        episodes: int = EPISODES,
        starts: int = STARTS,
    ) -> None:
        robot.require_free("compared part by part")
        self.robot, self.network, self.config = robot, network, network.config
        self.parts, now = Simulator(robot, self.config).parts(), self.config.history
        seen = validated(
            MeasurementModel, {"noise": noise}, "Points cannot be measured so", ConfigError
        )
        config = RunConfig(model=robot.name, measurement=seen, network=self.config)
        recorder = EpisodeRecorder(config, robot)
        numbers = range(FIRST_SEED, FIRST_SEED + episodes)
        plans = [EpisodePlan(f"budget-{n}", "random", 0, "test", SECONDS, n) for n in numbers]
        recorded = [recorder.record(plan, None, "") for plan in plans]
        tracks, self.plant = [episode.trajectory for episode in recorded], recorder.plant(0)
        states = State.joined([track.states[None] for track in tracks if track.states is not None])
        steps, earliest = (round(each / self.plant.dt) for each in (HORIZON, HISTORY_SECONDS))
        present = np.random.default_rng(FIRST_SEED).integers(
            max(now, earliest), tracks[0].steps - steps + 1, episodes * starts
        )
        which, when = np.repeat(np.arange(episodes), starts)[:, None], np.arange(-now, steps + 1)
        at, past = (which, present[:, None] + when), (which, present[:, None] + when[: now + 1])
        self.seen = np.stack([track.observations.points for track in tracks])[past]
        self.known = np.stack([robot.winches_of(episode) for episode in recorded])[past]
        self.points, self.states = self.plant.observe(states).points[at], states[at]
        self.controls = np.stack([track.controls for track in tracks])[at[0], at[1][:, :-1]]
        self.truth = self.points[:, now + 1 :]

    def cases(self) -> dict[str, tuple[str, ...]]:
        """The substitutions that change something on this robot, with this network."""
        ends = self.config.cable_ends == "attachments" and self.parts.attachments.rolls
        without = set() if ends else {("sides",)}
        without |= set() if self.parts.graph.ground >= 0 else {(GROUND,)}
        without |= set() if self.config.recurrent else {(MEMORY,)}
        return {name: parts for name, parts in CASES.items() if parts not in without}

    @torch.inference_mode()
    def predicted(self, replaced: Sequence[str]) -> Floats:
        """(B, T, P, 3) tracked points by the network with a substitution [m]."""
        step, now = Substituting(self.parts, replaced), self.config.history

        def forward(network: ChunkNetwork, graph: RobotGraph) -> Forward:
            made = prepared(network, graph)
            return Forgetful(made) if MEMORY in replaced else made

        simulator = Simulator(self.robot, self.config, forward, lambda parts: step)
        ready, dataset, found = simulator.prepare(self.network), torch.tensor([0]), []
        for rows in shares(len(self.seen), BLOCK, 1):
            seen = self.points[rows, : now + 1] if PAST in replaced else self.seen[rows]
            given = seen, self.controls[rows], self.known[rows]
            points, controls, winch = (torch.from_numpy(each) for each in given)
            start = simulator.start(points, controls[:, :now], winch)
            later = self.true_states(rows, start.origin)[:: self.config.chunk]
            step.truth = iter([None, *later[1:]])
            found.append(simulator.roll(ready, start, controls[:, now:], dataset).points)
        return torch.cat(found).double().numpy()

    def true_states(self, rows: slice, origin: Tensor) -> list[MechanicalState]:
        """T + 1 states of the plant from the present on, with velocities as they are after a chunk.

        Args:
          rows: the windows.
          origin: (2, B) horizontal position of the states' origin [m].
        """
        now, frames = self.config.history, self.parts.frames
        places = self.points[rows, now - 1 :].copy()
        places[..., :2] -= origin.t().numpy()[:, None, None]
        bodies = frames.of_points(_component_major(places))
        nodes = torch.matmul(frames.to_nodes, bodies)
        speeds = (nodes[:, 1:] - nodes[:, :-1]) / self.config.dt
        states = self.states[rows, now:]
        poses = states.qpos.reshape(*states.qpos.shape[:2], -1, FREE_POSITIONS)
        sides = np.zeros((*poses.shape[:2], len(frames.rods), 3))
        for rod, body in enumerate(frames.rods):  # `across` is linear but for a constant
            arms = [frames.across(body, end)[0] for end in (*np.eye(3), np.zeros(3))]
            sides[:, :, rod] = rotate(poses[:, :, body, 3:], np.array(arms[:3]) - arms[3])
        winch = _component_major(self.plant.winch(states)[..., None])
        parts = (bodies[:, 1:], speeds, winch, _component_major(sides))
        return [
            MechanicalState(f.contiguous(), v.contiguous(), w[0].contiguous(), s.contiguous())
            for f, v, w, s in zip(*(part.unbind(1) for part in parts), strict=True)
        ]

    def beside(self) -> dict[str, Floats]:
        """Predictions (B, T, P, 3) by models beside the network, from the same past [m]."""
        past, ahead = np.split(self.controls, [self.config.history], axis=1)
        seen = Past(Observation(self.seen, self.known), past, self.known)
        models: dict[str, Dynamics] = {
            RESTARTED: RestartedPlant(self.plant, self.config.velocity_window, roll="relaxed"),
            STILL: Persistence(self.robot, self.plant.dt),
        }
        found = {name: model.rollout(seen, ahead).points[:, 1:] for name, model in models.items()}
        found |= {name: self.chained(seen, ahead, name == KEPT) for name in (EACH_CHUNK, KEPT)}
        steps = np.arange(self.truth.shape[1])
        within = steps % self.config.chunk + 1  # of a chunk
        begin = self.config.history + steps + 1 - within
        true, before = self.points[:, begin], self.points[:, begin - 1]
        return {COASTING: true + within[:, None, None] * (true - before), **found}

    def chained(self, seen: Past, ahead: Floats, rolls: bool) -> Floats:
        """(B, T, P, 3) points of the plant, which forgets at every chunk what points do not show [m].

        Args:
          seen: the past.
          ahead: (B, T, W) commands.
          rolls: it keeps the orientations of its bodies.
        """
        first = RestartedPlant(self.plant, self.config.velocity_window, roll="relaxed")
        later = RestartedPlant(self.plant, 1, roll="relaxed")
        state, found = first.estimate(seen), []
        for begin in range(0, ahead.shape[1], self.config.chunk):
            commands = ahead[:, begin : begin + self.config.chunk]
            motion = self.plant.simulate(state, commands)
            points, states = motion.observations.points, motion.states
            assert states is not None
            winch = self.plant.winch(states[:, -2:])
            known = Past(Observation(points[:, -2:], winch), commands[:, -1:], winch)
            state = later.estimate(known)
            if rolls:
                poses, own = (
                    each.qpos.reshape(len(points), -1, FREE_POSITIONS)
                    for each in (state, states[:, -1])
                )
                poses[..., 3:] = own[..., 3:]
            found.append(points[:, 1:])
        return np.concatenate(found, axis=1)

    def happened(self) -> tuple[Flags, Flags]:
        """Nodes that touch the ground (B, T + 1, N), and slack cables (B, T + 1, C)."""
        graph, frames, ends = self.parts.graph, self.parts.frames, self.parts.attachments
        middle = self.points[:, self.config.history, :, :2].mean(axis=1)
        origin, contact, slack = torch.from_numpy(middle.T).float(), [], []
        for state in self.true_states(slice(None), origin):
            height = torch.matmul(frames.to_nodes, state.frames)[2] - graph.radius
            contact.append((height < NEAR * self.robot.length) & (graph.ground >= 0))
            assert state.sides is not None
            places, _ = ends.positions(state.frames, state.sides, origin)
            length = (places[:, 1::2] - places[:, ::2]).norm(dim=0)
            slack.append(length < ends.rest(state.winch))
        touching, loose = (torch.stack(each).permute(2, 0, 1) for each in (contact, slack))
        return touching.numpy(), loose.numpy()

    def way_error(self, predicted: Floats, true_begin: bool) -> float:
        """RMSE of the centres of mass' ways in a chunk, over all but the first [mm].

        Args:
          predicted: (B, T, P, 3) [m].
          true_begin: chunks begin at the true points.
        """
        each = self.config.chunk
        true, said = self.truth[:, each - 1 :: each], predicted[:, each - 1 :: each]
        begin = true if true_begin else said
        ways = true[:, 1:] - true[:, :-1], said[:, 1:] - begin[:, :-1]
        return float(1e3 * np.sqrt(squared_position_error(self.robot, *ways).mean()))


def _component_major(array: Floats) -> Tensor:
    """(D, T, M, B) from (B, T, M, D)."""
    return torch.from_numpy(array).float().permute(3, 1, 2, 0)


def regions(contact: Flags, slack: Flags) -> dict[str, Flags]:
    """Pieces of motion in which something happens: (B,) each.

    Args:
      contact: (B, n + 1, N) of the nodes with the ground.
      slack: (B, n + 1, C) of the cables.
    """
    found = {
        "a contact begins or ends": (contact[:, 1:] != contact[:, :-1]).any(axis=(1, 2)),
        "the robot tips": (contact[:, -1] & ~contact[:, 0]).any(axis=1),
        "a cable is slack": slack.any(axis=(1, 2)),
        "a cable becomes slack or taut": (slack[:, 1:] != slack[:, :-1]).any(axis=(1, 2)),
    }
    none = ~np.any(list(found.values()), axis=0)
    return {"all": np.ones_like(none), **found, "none of these": none}


def shares_of(happened: tuple[Flags, Flags], squared: Floats, steps: int) -> dict[str, Any]:
    """Region -> share of pieces of so many steps, and of the squared errors (B, T) there [%]."""
    firsts = np.arange(0, squared.shape[1] - steps + 1, steps)[:, None]

    def pieces(array: Any, length: int) -> Any:
        return array[:, firsts + np.arange(length)].reshape(-1, length, *array.shape[2:])

    errors = pieces(squared, steps).sum(axis=1)
    inside = regions(*(pieces(each, steps + 1) for each in happened))
    return {
        name: (float(100 * each.mean()), float(100 * errors[each].sum() / errors.sum()))
        for name, each in inside.items()
    }


def measured(budget: Budget) -> tuple[list[BudgetRow], list[RegionRow], Mapping[str, ErrorTable]]:
    """All results about one network, and its errors by lead time."""
    robot, config, cases = budget.robot, budget.config, budget.cases()
    digest, rows, tables = weights_digest(budget.network), [], {}
    predicted = {name: budget.predicted(parts) for name, parts in cases.items()} | budget.beside()
    for name, points in predicted.items():
        tables[name] = table = ErrorTable.between(robot, config.dt, budget.truth, points)
        first = 10 * robot.length * float(table.by_lead_time()["e_pos_rmse"][config.chunk - 1])
        later = budget.way_error(points, name == COASTING or "frames" in cases.get(name, ()))
        errors = table.e_pos_rmse, table.e_rot, first, later
        rows.append(BudgetRow(robot.name, digest, name, *errors))
    happened, begun = budget.happened(), config.chunk  # the first chunk starts from the past
    whole, single = (
        squared_position_error(robot, budget.truth, predicted[name]).mean(axis=-1)
        for name in (AS_IS, EVERYTHING)
    )
    windows = shares_of(happened, whole, whole.shape[1])
    contact, slack = (each[:, begun:] for each in happened)
    chunks = shares_of((contact, slack), single[:, begun:], config.chunk)
    places = [RegionRow(robot.name, name, *windows[name], *chunks[name]) for name in windows]
    return rows, places, tables


def table(robot: str) -> list[str]:
    """Lines of Markdown: a row for each substitution."""
    rows = [row for row in rows_there(BudgetRow, BUDGET_CSV) if row.robot == robot]
    head = "RMSE/L [%] | turn [deg] | after the first chunk [mm] | a later chunk adds [mm]"
    lines = [f"| {robot}, network {rows[0].weights[:12]}: replaced | {head} |", "|---" * 5 + "|"]
    for row in rows:
        cells = f"{row.e_pos:.2f} | {row.e_rot:.2f} | {row.first:.1f} | {row.later:.1f}"
        lines.append(f"| {row.replaced} | {cells} |")
    return lines


def regions_table(robot: str) -> list[str]:
    """Lines of Markdown: a row for each region."""
    lines = [f"| {robot} | windows | their error | chunks | their error |", "|---" * 5 + "|"]
    for row in rows_there(RegionRow, REGIONS_CSV):
        if row.robot == robot:
            cells = (row.windows, row.error, row.chunks, row.chunk_error)
            lines.append(f"| {row.region} | {' | '.join(f'{cell:.0f} %' for cell in cells)} |")
    return lines


def figure(tables: Mapping[str, ErrorTable], chunk: int) -> Figure:
    """Errors by lead time, at the ends of chunks of so many steps."""
    drawn = Figure(figsize=(9.2, 4.2))
    measures = {"e_pos_rmse": "position error, RMSE/L [%]", "e_rot": "turn [deg]"}
    for axes, (measure, label) in zip(drawn.subplots(1, 2), measures.items(), strict=True):
        for name, line in DRAWN.items():
            if name in tables:
                errors = tables[name].by_lead_time()
                ends = (errors[key][chunk - 1 :: chunk] for key in ("seconds", measure))
                axes.plot(*ends, **{"label": name, **line})
        axes.set(xlabel="lead time [s]", ylabel=label, xlim=(0.0, HORIZON))
        style.logarithmic(axes.yaxis)
    drawn.legend(*drawn.axes[0].get_legend_handles_labels(), loc="outside upper left", ncols=3)
    return drawn


def main() -> None:
    """Measure, write what was measured into the tables' files, and draw."""
    parser = parser_of(__file__, __doc__)
    parser.add_argument("robot", nargs="?", default="prism3", choices=ROBOTS)
    parser.add_argument("--weights", type=Path, help="of the network; by default the shipped one")
    parser.add_argument(
        "--noise", type=float, default=NOISE, help="of the points [length of robot]"
    )
    given = parser.parse_args()
    try:
        robot = load_robot(given.robot)
        weights = given.weights or shipped_weights(robot)
        network = load_weights(weights, robot)
        rows, places, tables = measured(Budget(robot, network, given.noise))
    except FlywheelError as error:
        parser.error(str(error))
    old = other_rows(BudgetRow, BUDGET_CSV, ("robot",), {(robot.name,)})
    write_rows(BUDGET_CSV, [*old, *rows])
    there = other_rows(RegionRow, REGIONS_CSV, ("robot",), {(robot.name,)})
    write_rows(REGIONS_CSV, [*there, *places])
    picture = as_file(lambda: figure(tables, network.config.chunk))
    assert picture is not None
    write_output(FIGURES / f"{robot.name}.svg", picture)


if __name__ == "__main__":
    main()
