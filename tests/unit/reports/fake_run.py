"""A made-up run with plausible numbers, for looking at pages and charts. Measured nowhere."""

import hashlib

import numpy as np

from flywheel.effects import WrittenTerm
from flywheel.results import (
    Arm,
    DiagnosisNote,
    ErrorNumbers,
    Errors,
    GateDecision,
    IterationResult,
    LeadTimes,
    Navigation,
    Overlay,
    PooledTest,
    RobotResult,
    RobotScore,
    RunResult,
    TrainingPoint,
    UnseenCourse,
    Walk,
)
from flywheel.robots import load_course

Rng = np.random.Generator


def digest(*words: object) -> str:
    return hashlib.sha256(repr(words).encode()).hexdigest()


def fake_errors(level: float, full: bool = True) -> Errors:
    """`level` 1 is about the floor."""
    seconds = np.arange(0.1, 2.05, 0.1)
    rmse = 3.0 * level * seconds**0.8
    rot = 4.0 * level * seconds**0.7
    lead = LeadTimes(
        seconds=tuple(seconds.round(3).tolist()),
        e_pos_mse=tuple((rmse**2 * 0.0295).tolist()),
        e_pos_rmse=tuple(rmse.tolist()),
        e_rot=tuple(rot.tolist()),
    )
    short = ErrorNumbers(
        e_pos_mse=float(np.mean(rmse**2 * 0.0295)),
        e_pos_rmse=float(np.sqrt(np.mean(rmse**2))),
        e_rot=float(rot.mean()),
        windows=336,
    )
    whole = ErrorNumbers(
        e_pos_mse=9.0 * level**2, e_pos_rmse=17.0 * level, e_rot=15.0 * level, windows=24
    )
    return Errors(short=short, full=whole if full else None, by_lead_time=lead)


def fake_walk(rng: Rng, skill: float) -> Walk:
    angle = rng.uniform(0, 2 * np.pi)
    goal = rng.uniform(5.0, 8.0) * np.array([np.cos(angle), np.sin(angle)])
    reached = bool(rng.random() < skill)
    seconds = float(rng.uniform(22, 55) * (1.2 - 0.3 * skill)) if reached else 60.0
    share = np.linspace(0, 1, max(2, int(2 * seconds)))[:, None]
    end = goal * (0.93 if reached else rng.uniform(0.2, 0.75))
    wiggle = np.cumsum(rng.normal(0, 0.06, (len(share), 2)), axis=0) * np.sin(np.pi * share)
    path = share * end + wiggle
    return Walk(
        path=tuple((float(x), float(y)) for x, y in path),
        goal=(float(goal[0]), float(goal[1])),
        reached=reached,
        seconds=seconds,
        distance=float(np.linalg.norm(goal - path[-1])),
        seed=int(rng.integers(1e6)),
    )


def fake_navigation(
    rng: Rng, skill: float, total: int = 24, controller: str = "mppi"
) -> Navigation:
    return Navigation(
        controller=controller,
        walks=tuple(fake_walk(rng, skill) for _ in range(total)),
        seconds_allowed=60.0,
        tolerance=0.6,
        plan_seconds=tuple(rng.gamma(12.0, 0.02, 800).tolist()),
    )


def fake_overlay(rng: Rng) -> Overlay:
    seconds = np.arange(0, 2.05, 0.1)
    rods = np.array([[[0, 0, 0.2], [1.6, 1.8, 1.6]], [[1.8, 0.1, 0.2], [0.4, 2.3, 0.8]],
                     [[0.9, -0.2, 1.6], [0.1, 2.1, 0.2]]])  # fmt: skip
    drift = np.stack([0.45 * seconds, 0.2 * np.sin(seconds), 0 * seconds], axis=-1)
    measured = rods.reshape(1, 6, 3) + drift[:, None]
    error = np.cumsum(rng.normal(0, 0.012, (len(seconds), 6, 3)), axis=0)
    as_tuples = [[tuple(map(float, p)) for p in frame] for frame in measured]
    guess = [[tuple(map(float, p)) for p in frame] for frame in measured + error]
    return Overlay(
        seconds=tuple(seconds.tolist()),
        measured=as_tuples,
        predicted=guess,
        rods=((0, 1), (2, 3), (4, 5)),
        episode="i0002-mppi-0003",
    )


def fake_unseen(rng: np.random.Generator) -> UnseenCourse:
    """Walks in the maze."""
    boxes = load_course("maze").obstacles

    def among(rate: float, controller: str) -> Navigation:
        found = fake_navigation(rng, rate, controller=controller)
        walks = [walk.model_copy(update={"obstacles": boxes}) for walk in found.walks]
        return found.model_copy(update={"walks": tuple(walks)})

    return UnseenCourse(
        course="maze", navigation=among(0.7, "mppi"), oracle=among(0.9, "mppi on the plant")
    )


def fake_diagnosis(number: int) -> DiagnosisNote:
    """Every iteration finds one effect more."""
    effects = [WrittenTerm(effect=f"effect_{i}", parameters={"size": 1.0}) for i in range(number)]
    return DiagnosisNote(
        verdict="EFFECT",
        effects=tuple(effects),
        adopted=True,
        reason=f"EFFECT: the plant now has effect_{number - 1}.",
        noise=0.009,
        baseline=0.009 + 0.01 / number,
        augmented=0.009 + 0.01 / (number + 1),
        held_out_baseline=0.010 + 0.01 / number,
        held_out_augmented=0.010 + 0.01 / (number + 1),
    )


def fake_iteration(
    number: int, arm: Arm = "mppi", seed: int = 0, video: str = ""
) -> IterationResult:
    rng = np.random.default_rng([seed, number, arm == "control"])
    gain = (1.0, 0.62, 0.5, 0.46)[number] if arm == "mppi" else (1.0, 0.85, 0.8, 0.79)[number]
    level = 2.2 * gain
    steps = np.arange(0, 2001, 50)
    loss = 0.8 * np.exp(-steps / 500) + 0.12 * gain + rng.normal(0, 0.01, len(steps)) ** 2
    curve = tuple(
        TrainingPoint(
            step=int(s),
            loss=float(v),
            learning_rate=float(1e-3 * (1 - s / 2100)),
            validation_e_pos_rmse=float(9 * gain + 12 * np.exp(-s / 400)) if s % 200 == 0 else None,
            validation_e_rot=float(8 * gain + 9 * np.exp(-s / 400)) if s % 200 == 0 else None,
            seconds=float(s * 0.08),
        )
        for s, v in zip(steps, loss, strict=True)
    )
    errors = fake_errors(level)
    skill = (0.2, 0.6, 0.75, 0.8)[number] if arm == "mppi" else (0.2, 0.3, 0.35, 0.4)[number]
    promoted = arm == "mppi" and number != 3
    return IterationResult(
        iteration=number,
        diagnosis=fake_diagnosis(number) if number else None,
        arm=arm,
        snapshot=digest("snapshot", number, arm, seed),
        parent_snapshot=digest("snapshot", number - 1, arm, seed) if number else "",
        model=digest("model", number, arm, seed),
        validation=fake_errors(level * 1.05),
        test=errors,
        navigation=fake_navigation(rng, skill),
        episodes=60 + 24 * number,
        steps=(60 + 24 * number) * 3000,
        new_episodes=24 if number else 60,
        new_steps=72000 if number else 180000,
        restarts=int(number == 1),
        invalid=int(number == 2),
        seconds={
            "collect": 101.0,
            "snapshot": 4.2,
            "train": 160.0,
            "evaluate": 71.0,
            "decide": 0.1,
        },
        curve=curve,
        gate=GateDecision(
            promoted=promoted,
            measure="validation e_rot at 2 s [deg]",
            number=errors.short.e_rot,
            reference=errors.short.e_rot * 1.3 if number else None,
            reason="Lower than the champion's." if promoted else "Not lower than the champion's.",
        ),
        overlay=fake_overlay(rng),
        video=video,
    )


def fake_run(
    iterations: int = 3, seed: int = 0, video: str = "", finished: bool = True
) -> RunResult:
    rng = np.random.default_rng([seed, 99])
    own = [fake_iteration(k, "mppi", seed, video) for k in range(iterations)]
    control = [fake_iteration(k, "control", seed) for k in range(1, iterations)]
    turns = (*own, *control)
    pooled = tuple(
        PooledTest(arm=i.arm, iteration=i.iteration, model=i.model, errors=i.test)
        for i in turns
        if i.test is not None
    )
    return RunResult(
        name="prism3, default",
        key=f"prism3-default-s{seed}",
        config={
            "seed": seed,
            "robot": "prism3",
            "network": {"kind": "lean", "width": 32, "rounds": 2},
            "training": {"steps": 2000, "learning_rate": 0.001},
            "mppi": {"samples": 64, "horizon": 2.0, "beta": 0.05},
        },
        config_digest=digest("config"),
        code="0.1.0+abc1234",
        versions={"mujoco": "4.0.0", "ray": "2.60.0", "torch": "2.13.0", "zarr": "3.1.6"},
        robot="prism3",
        robot_digest=digest("robot"),
        length=2.95,
        iterations=turns,
        pooled=pooled if finished else (),
        floor=fake_errors(0.9) if finished else None,
        informed_floor=fake_errors(0.1) if finished else None,
        persistence=fake_errors(7.0) if finished else None,
        oracle=fake_navigation(rng, 0.9, controller="mppi on the plant") if finished else None,
        unseen=(fake_unseen(rng),) if finished else (),
        finished=finished,
        notes=("Simulation only.",),
    )


def turnless(run: RunResult) -> RunResult:
    """The same run of a robot whose bodies show no rotation."""

    def without(value: object) -> object:
        if isinstance(value, dict):
            return {
                key: lost(v) if key.endswith("e_rot") else without(v) for key, v in value.items()
            }
        return [without(v) for v in value] if isinstance(value, list | tuple) else value

    def lost(value: object) -> object:
        if isinstance(value, list | tuple):
            return [np.nan] * len(value)
        return None if value is None else np.nan

    return RunResult.model_validate(without(run.model_dump()))


def with_robot(run: RunResult) -> RunResult:
    """The same run on a robot that is not its model; every iteration finds one effect more."""
    rng = np.random.default_rng(7)

    def level(number: int) -> dict[str, Errors]:
        levels = {"network": 1.6 - 0.2 * number, "given": 1.5, "plant": 1.5 / (1 + number)}
        return {name: fake_errors(each, full=False) for name, each in levels.items()}

    def on_robot(number: int) -> RobotResult:
        return RobotResult(
            minutes=1.0 + 3.0 * number,
            driven_minutes=3.0,
            errors=level(number),
            noise=ErrorNumbers(e_pos_mse=0.01, e_pos_rmse=0.4, e_rot=0.3),
            drives={p: fake_navigation(rng, 0.5, 8, p) for p in ("network", "plant")},
        )

    turns = tuple(
        i.model_copy(update={"robot": on_robot(i.iteration)}) if i.arm == "mppi" else i
        for i in run.iterations
    )
    scores = tuple(
        RobotScore(iteration=i.iteration, model=name, minutes=i.robot.minutes, errors=errors)
        for i in turns
        if i.robot is not None
        for name, errors in i.robot.errors.items()
        if name != "given" or i.iteration == 0
    )
    noise = ErrorNumbers(e_pos_mse=0.01, e_pos_rmse=0.42, e_rot=0.3)
    return run.model_copy(
        update={"iterations": turns, "on_robot": scores, "robot_noise": noise, "oracle": None}
    )
