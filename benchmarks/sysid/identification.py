"""Fit all of an MJCF's own numbers to recordings with `mujoco.sysid`, the state of the art.

A diagnosis is compared with it. Only this module needs the packages of `pip install
"mujoco[sysid]"`.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np
from mujoco import sysid

from benchmarks.sysid.mjcf_parameters import Block, bare_spec, blocks, open_spec
from flywheel.dynamics.plant.plant import Plant
from flywheel.dynamics.plant.tangent import moved
from flywheel.errors import ConfigError
from flywheel.records import Floats, State
from flywheel.robots.mujoco_warnings import collected_warnings

STEP = 1e-3  # of finite differences, in units of the parameters
Optimizer = Literal["mujoco", "scipy_parallel_fd"]
HOPELESS = 1e6  # residual of what cannot be simulated [sigma]
FARTHEST = 5.0  # standard deviations that a start may move


@dataclass(frozen=True)
class Piece:
    """A stretch of a recording.

    Attributes:
      start: (unbatched) initial state, or a guess of it.
      controls: (T, W) commands.
      points: (T + 1, P, 3) measured [m]; NaN where missing.
    """

    start: State
    controls: Floats
    points: Floats


@dataclass(frozen=True)
class Fitted:
    """A number of the MJCF.

    Attributes:
      name: "<element>.<number>".
      unit: "1" if it is relative to the MJCF's.
      nominal: value in the MJCF.
      value: fitted.
      low, high: sysid's 95 % interval.
    """

    name: str
    unit: str
    nominal: float
    value: float
    low: float
    high: float

    @property
    def surely_changed(self) -> bool:
        """True if the interval excludes the nominal value."""
        return not self.low <= self.nominal <= self.high


@dataclass(frozen=True)
class Identification:
    """Result of sysid.

    Attributes:
      xml: MJCF with the fitted numbers, in six digits: MuJoCo writes no more. Its winches may have
        gains that `read_robot` rejects.
      numbers: of the MJCF.
      ended: reason, in sysid's words.
    """

    xml: str
    numbers: tuple[Fitted, ...]
    ended: str


def identify(
    plant: Plant,
    pieces: Sequence[Piece],
    sigma: float,
    spread: Floats | None = None,
    iterations: int = 20,
    optimizer: Optimizer = "mujoco",
) -> Identification:
    """Free every number of the MJCF, see `mjcf_parameters`, and fit measured points in the least
    squares.

    Args:
      plant: of the model to fit.
      pieces: of one length.
      sigma: noise of a coordinate [m].
      spread: (2 nv,) standard deviations of starts along the tangent, positions and velocities [m,
        rad, m/s, rad/s], to fit starts, too; None to hold them.
      iterations: maximum.
      optimizer: one of sysid's; "scipy_parallel_fd" is SciPy's trust region.

    Raises:
      ConfigError: sysid's packages are not installed.
    """
    if not hasattr(sysid, "optimize"):
        raise ConfigError('mujoco.sysid lacks packages: pip install "mujoco[sysid]".')
    spec = bare_spec(plant.robot.xml)
    free = blocks(spec)
    residuals = _Residuals(plant, spec, pieces, sigma, spread)
    params = sysid.ParameterDict()
    for parameter in (*(block.parameter for block in free), *residuals.starts):
        params.add(parameter)
    said = io.StringIO()
    with collected_warnings(), redirect_stdout(said):  # what is tried may diverge
        best, result = sysid.optimize(
            params.move_off_bounds(),
            residuals,
            optimizer=optimizer,
            verbose=False,
            max_iters=iterations,
            x_scale="jac",
            **{"eps" if optimizer == "mujoco" else "diff_step": STEP},
        )
    left, _, _ = residuals(best.as_vector(), best)
    _, half = sysid.calculate_intervals(left, result.jac)
    whole = open_spec(plant.robot.xml)
    sysid.apply_param_modifiers(best, whole)
    ended = said.getvalue().splitlines()[-2]  # the last line is about time or evaluations
    return Identification(whole.to_xml(), _numbers(free, best, half), ended)


def _numbers(free: Sequence[Block], best: sysid.ParameterDict, half: Floats) -> tuple[Fitted, ...]:
    """Values of all blocks with intervals of so much to either side (n,)."""
    found, first = [], 0
    for block in free:
        value = best[block.parameter.name].as_vector()
        width = half[first : first + len(value)]
        first += len(value)
        nominal = block.parameter.as_nominal_vector()
        with np.errstate(over="ignore"):  # an interval may be infinite
            columns = [block.shown(v) for v in (nominal, value, value - width, value + width)]
        for (name, unit), row in zip(block.labels, zip(*columns, strict=True), strict=True):
            found.append(Fitted(name, unit, *(float(each) for each in row)))
    return tuple(found)


class _Residuals:
    """The residuals of all pieces, as a function that sysid can call.

    A piece depends on the MJCF and on its own start alone: equal columns of a finite difference are
    simulated once, and every model is compiled once.
    """

    def __init__(
        self,
        plant: Plant,
        spec: mujoco.MjSpec,
        pieces: Sequence[Piece],
        sigma: float,
        spread: Floats | None,
    ) -> None:
        self._parts = [
            _Part(plant, spec, piece, sigma, f"start {index}", spread)
            for index, piece in enumerate(pieces)
        ]
        self.starts = [part.start for part in self._parts if part.start is not None]

    def __call__(
        self, x: Floats, params: sysid.ParameterDict
    ) -> tuple[list[Floats], list[object], list[object]]:
        """Residuals (D, n) of each piece for parameters (X, n); (D,) for (X,)."""
        if x.ndim == 1:
            return [each[:, 0] for each in self(x[:, None], params)[0]], [], []
        shared = params.size - sum(start.size for start in self.starts)
        models: dict[bytes, mujoco.MjModel] = {}

        def build(given: sysid.ParameterDict, spec: mujoco.MjSpec) -> mujoco.MjModel:
            key = given.as_vector()[:shared].tobytes()
            if key not in models:
                models[key] = sysid.apply_param_modifiers(given, spec)
            return models[key]

        found, first = [], shared
        for part in self._parts:
            size = 0 if part.start is None else part.start.size
            own = np.concatenate([x[:shared], x[first : first + size]])
            first += size
            _, column, again = np.unique(own, axis=1, return_index=True, return_inverse=True)
            found.append(part.residual(x[:, column], params, build)[:, again])
        return found, [], []


class _Part:
    """One piece, simulated by sysid and compared with the measurements."""

    def __init__(
        self,
        plant: Plant,
        spec: mujoco.MjSpec,
        piece: Piece,
        sigma: float,
        name: str,
        spread: Floats | None,
    ) -> None:
        self._plant, self._name, self._begin = plant, name, piece.start
        self._sigma, self._spread = sigma, spread
        self.start = None
        if spread is not None:
            limit = np.full(len(spread), FARTHEST)
            self.start = sysid.Parameter(name, np.zeros(len(spread)), -limit, limit)
        model = spec.compile()
        # Sensors are read at the beginning of a step, and sysid leaves the last row of controls out.
        commands = np.repeat(plant.commands(piece.controls[None])[0], plant.substeps, axis=0)
        commands = np.concatenate([commands, np.repeat(commands[-1:], 2, axis=0)])
        self._samples = plant.dt * np.arange(len(piece.points))
        points = np.full((len(piece.points), model.nsensordata), np.nan)
        points[:, plant._points] = piece.points
        self._size = points.size + (0 if spread is None else len(spread))
        self._sequence = sysid.ModelSequences(
            "robot",
            spec,
            name,
            plant.packed(_repeated(piece.start, 1))[0],
            sysid.TimeSeries(model.opt.timestep * np.arange(len(commands)), commands),
            sysid.TimeSeries.from_names(self._samples, points, model),
        )

    def residual(self, x: Floats, params: sysid.ParameterDict, build: sysid.BuildModelFn) -> Floats:
        """(D, n) in sigmas, for parameters (X, n); `HOPELESS` where the simulation diverged."""
        try:
            (found,), _, _ = sysid.residual(
                x,
                params,
                [self._sequence],
                build_model=build,
                modify_residual=self._compared,
                custom_rollout=None if self.start is None else self._rolled_out,
                n_threads=1,
                resample_true=False,
            )
        except ValueError as error:
            if "strictly increasing" not in str(error):  # MuJoCo resets the clock when it diverges
                raise
            if x.shape[1] == 1:
                return np.full((self._size, 1), HOPELESS)
            columns = np.split(x, x.shape[1], axis=1)
            return np.concatenate([self.residual(c, params, build) for c in columns], axis=1)
        return np.asarray(found)

    def _compared(  # type: ignore[no-untyped-def]
        self, params, predicted, measured, model, return_all, state
    ):
        """Measured minus predicted; with the prior of the start, if that is fitted."""
        rows = predicted.data[:: self._plant.substeps]
        off = np.nan_to_num((measured.data - rows) / self._sigma, nan=0.0).ravel()
        prior = [] if self.start is None else params[self._name].value
        seen = sysid.TimeSeries(self._samples, rows, measured.signal_mapping)
        return np.concatenate([off, prior]), seen, measured

    def _rolled_out(self, initial_states, param_dicts, **given):  # type: ignore[no-untyped-def]
        """Sysid's own rollout, from starts that are parameters."""
        change = np.stack([each[self._name].value for each in param_dicts]) * self._spread
        starts = _repeated(self._begin, len(change))
        starts = moved(self._plant, starts, *np.split(change, 2, axis=1))
        return sysid.sysid_rollout(initial_states=self._plant.packed(starts), **given)


def _repeated(state: State, n: int) -> State:
    return State(*(np.repeat(a[None], n, axis=0) for a in (state.qpos, state.qvel, state.act)))
