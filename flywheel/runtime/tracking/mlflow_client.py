"""The only module that imports mlflow, and only when there is something to publish: the import takes seconds.

`Board` does one thing at MLflow at a time, through a client with explicit run ids. Everything can be
repeated: a number that is sent again with its own time stamp is the same row, and runs, models and
versions are looked up by our own tags before they are made.
"""

from __future__ import annotations

import contextlib
import functools
import json
import logging
import os
import platform
import re
import shutil
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec

import numpy as np

from flywheel.errors import DataError
from flywheel.results import GateDecision
from flywheel.runtime.tracking import pyfunc_model
from flywheel.runtime.tracking.dashboard import DATABASE, SETTINGS, damage, database_uri, is_missing
from flywheel.runtime.tracking.tracker import Status, TrackingConfig

if TYPE_CHECKING:
    from mlflow import MlflowClient

log = logging.getLogger(__name__)

CHAMPION = "champion"
ARTIFACTS = "mlflow-artifacts"
P = ParamSpec("P")
Rows = Iterable[tuple[int, Mapping[str, float]]]  # steps, and the numbers there by name


def _unless_refused(
    action: Callable[Concatenate[Board, P], None],
) -> Callable[Concatenate[Board, P], None]:
    """Skip with a warning what MLflow will always refuse, or whose file is gone."""

    @functools.wraps(action)
    def tried(board: Board, *args: P.args, **kwargs: P.kwargs) -> None:
        try:
            action(board, *args, **kwargs)
        except Exception as error:
            refused = getattr(error, "error_code", "") == "INVALID_PARAMETER_VALUE"
            if not refused and not isinstance(error, (FileNotFoundError, LookupError)):
                raise
            log.warning("tracking: left out, because it was refused: %s", error)

    return tried


@dataclass(frozen=True)
class Run:
    """A run at MLflow.

    Attributes:
      id: MLflow's own.
      begun: time of its beginning [ms since 1970].
      tags: when it was found or made.
    """

    id: str
    begun: int
    tags: Mapping[str, str]


class Board:
    """Runs and models at MLflow, which is first contacted when something is published.

    Args:
      folder: of the run, with every published file; without a server it also contains MLflow's
        SQLite file and artifacts.
      config: of the tracking.
      robot: its name, for the model registry.

    Raises:
      ConfigError: MLflow cannot have a database in a folder of this name.
    """

    def __init__(self, folder: str | Path, config: TrackingConfig, robot: str) -> None:
        self._folder, self._config = Path(folder).absolute(), config
        self.uri = config.uri or database_uri(self._folder / DATABASE)
        name = config.registered_model or f"flywheel-{robot}"
        self._registry = re.sub(r"[^A-Za-z0-9._-]", "-", name)
        self._runs: dict[str, Run] = {}

    @functools.cached_property
    def _client(self) -> MlflowClient:
        _configure(self._config.request_seconds)
        from mlflow import MlflowClient  # slow to import

        if not self._config.uri:
            _make_database(self._folder / DATABASE)
        return MlflowClient(tracking_uri=self.uri, registry_uri=self.uri)

    @functools.cached_property
    def _experiment(self) -> str:
        name = self._config.experiment
        if (found := self._client.get_experiment_by_name(name)) is not None:
            return str(found.experiment_id)
        own = self._config.uri.startswith("http")
        place = None if own else (self._folder / ARTIFACTS).as_uri()
        return str(self._client.create_experiment(name, artifact_location=place))

    def run(
        self,
        key: str,
        name: str,
        tags: Mapping[str, str],
        parent: Run | None = None,
        begun: float = 0.0,
    ) -> Run:
        """The run with a key, made if it is not there.

        Args:
          key: tells runs apart, [A-Za-z0-9._-/]+.
          name: for people.
          tags: of a new run.
          parent: of a new run.
          begun: time of its beginning, in seconds since 1970; 0 for now.
        """
        if key not in self._runs:
            same = f"tags.`flywheel.run_key` = '{key}'"
            found = self._client.search_runs([self._experiment], same, max_results=1)
            own = {"flywheel.run_key": key, "mlflow.source.name": "flywheel"}
            own |= {"mlflow.parentRunId": parent.id} if parent else {}
            start = int(1000 * (begun or time.time()))
            one = (
                found[0]
                if found
                else self._client.create_run(self._experiment, start, own | dict(tags), name)
            )
            self._runs[key] = Run(one.info.run_id, one.info.start_time, one.data.tags)
        return self._runs[key]

    def status(self, run: Run, status: Status, at: float = 0.0) -> None:
        """Set the state of a run, since a time in seconds since 1970 (0 for now)."""
        if status == "RUNNING":
            self._client.update_run(run.id, status)
        else:
            self._client.set_terminated(run.id, status, int(1000 * (at or time.time())))

    @_unless_refused
    def log(self, run: Run, rows: Rows, since: Run | None = None) -> None:
        """Log numbers at several steps.

        A number that is not finite would spoil its chart. It becomes a tag `nonfinite/<name>`, and
        the number health/nonfinite becomes 1.

        Args:
          run: of the numbers.
          rows: steps, and the numbers there.
          since: the run whose beginning is their time stamp; the run itself by default.
        """
        from mlflow.entities import Metric  # slow to import

        at, metrics = (since or run).begun, []
        odd: dict[str, str] = {}
        for step, values in rows:
            bad = {name: value for name, value in values.items() if not isfinite(value)}
            odd |= {f"nonfinite/{name}": f"{value} at {step}" for name, value in bad.items()}
            kept = {**values, "health/nonfinite": 1.0} if bad else values
            metrics += [Metric(n, float(v), at, step) for n, v in kept.items() if n not in bad]
        for part in _parts(metrics, 1000):
            self._client.log_batch(run.id, metrics=part)
        if odd:
            self.describe(run, tags=odd)

    @_unless_refused
    def describe(
        self, run: Run, params: Mapping[str, str] = {}, tags: Mapping[str, str] = {}
    ) -> None:
        """Add constant parameters, and changeable tags, to a run."""
        from mlflow.entities import Param, RunTag  # slow to import

        have = self._client.get_run(run.id).data.params if params else {}
        new = [Param(n[:250], v[:6000]) for n, v in params.items() if n[:250] not in have]
        for part in _parts(new, 100):
            self._client.log_batch(run.id, params=part)
        for part in _parts([RunTag(n[:250], v[:8000]) for n, v in tags.items()], 100):
            self._client.log_batch(run.id, tags=part)

    @_unless_refused
    def dataset(self, run: Run, name: str, digest: str, profile: Mapping[str, float]) -> None:
        """Name the snapshot of a run's training data.

        Args:
          run: of the training.
          name: of the data set at MLflow.
          digest: of the snapshot. MLflow keeps 36 characters of it; a tag keeps all.
          profile: numbers about it, e.g. how many episodes.
        """
        from mlflow.entities import Dataset, DatasetInput, InputTag  # slow to import

        dataset = Dataset(
            name=name,
            digest=digest[:36],
            source_type="flywheel",
            source=json.dumps({"snapshot": digest}),
            profile=json.dumps(profile),
        )
        use = InputTag("mlflow.data.context", "training")
        self._client.log_inputs(run.id, [DatasetInput(dataset, [use])])
        self._client.set_tag(run.id, "flywheel.snapshot", digest)

    @_unless_refused
    def artifact(self, run: Run, path: str | Path) -> None:
        """Log a file of the folder."""
        if not (self._folder / path).exists():
            raise FileNotFoundError(f"{self._folder / path} is missing")
        self._client.log_artifact(run.id, str(self._folder / path))

    @_unless_refused
    def model(
        self,
        run: Run,
        key: str,
        name: str,
        digest: str,
        folder: Path,
        shape: tuple[int, int],
        tags: Mapping[str, str],
        step: int = 0,
    ) -> None:
        """Log and register a model.

        Args:
          run: that made it.
          key: tells models apart.
          name: of the model.
          digest: of its weights.
          folder: written by `pyfunc_model.write_model`.
          shape: (tracked points, winches) of its robot, for the signature.
          tags: of the model.
          step: of the run that made it.
        """
        client = self._client
        same = f"tags.`flywheel.model_key` = '{key}'"
        found = client.search_logged_models([self._experiment], same, max_results=1)
        all_tags = {"flywheel.model_key": key, "flywheel.model": digest, **tags}
        model = (
            found[0]
            if found
            else client.create_logged_model(
                self._experiment, name, run.id, all_tags, model_type="dynamics"
            )
        )
        if str(model.status) != "READY":
            self._upload(model.model_id, folder, shape, run.id, step)
        registry = self._registry
        if not client.search_registered_models(f"name = '{registry}'"):
            client.create_registered_model(registry)
        if self._version("flywheel.model_key", key) is None:
            client.create_model_version(
                registry, model.artifact_location, run.id, all_tags, model_id=model.model_id
            )

    def _upload(
        self, model: str, source: Path, shape: tuple[int, int], run: str, step: int
    ) -> None:
        from mlflow.entities import LoggedModelOutput  # slow to import

        with tempfile.TemporaryDirectory() as folder:
            _write_pyfunc(Path(folder), source, shape, model, run)
            self._client.log_model_artifacts(model, folder)
        outputs = self._client.get_run(run).outputs
        if model not in {output.model_id for output in outputs.model_outputs}:
            self._client.log_outputs(run, [LoggedModelOutput(model, step)])
        self._client.finalize_logged_model(model, "READY")

    def _version(self, tag: str, value: str) -> str | None:
        same = f"name = '{self._registry}' and tags.`{tag}` = '{value}'"
        versions = self._client.search_model_versions(same)
        return max((str(v.version) for v in versions), key=int, default=None)

    @_unless_refused
    def promote(self, run: Run, digest: str, decision: GateDecision) -> None:
        """Move the alias `champion` to a logged model; only this moves it.

        A decision against the model, or without a finite number, changes nothing.

        Args:
          run: the parent run.
          digest: of the model's weights.
          decision: of the gate, with its number.
        """
        if not decision.promoted or not isfinite(decision.number):
            return
        version = self._version("flywheel.model", digest)
        if version is None:
            raise LookupError(f"MLflow has no version of {self._registry} with weights {digest}.")
        for name in ("measure", "number", "reference", "reason"):
            self._client.set_model_version_tag(
                self._registry, version, f"flywheel.gate.{name}", str(getattr(decision, name))
            )
        self._client.set_registered_model_alias(self._registry, CHAMPION, version)
        self._client.set_tag(run.id, "flywheel.champion", digest)
        self._client.set_tag(run.id, "flywheel.champion.number", str(decision.number))


def _configure(request_seconds: int) -> None:
    """Make MLflow's client fail fast and keep quiet, before it is first imported.

    For an error it would print a traceback; the tracker logs one line.
    """
    os.environ["MLFLOW_HTTP_REQUEST_TIMEOUT"] = str(request_seconds)
    os.environ.setdefault("MLFLOW_LOGGING_LEVEL", "CRITICAL")
    for name, value in SETTINGS.items():
        os.environ.setdefault(name, value)


def _make_database(path: Path) -> None:
    """Make the SQLite file with its tables in one atomic step, unless it is there.

    If a process is killed while MLflow makes the tables, or two processes do so at once, the file
    can never be opened again.

    Raises:
      DataError: there is a damaged one.
    """
    if problem := damage(path):
        raise DataError(problem)
    if is_missing(path):
        path.unlink(missing_ok=True)
        from mlflow import MlflowClient  # slow to import

        with tempfile.TemporaryDirectory(dir=path.parent, prefix=".mlflow-") as folder:
            fresh = Path(folder) / path.name
            MlflowClient(tracking_uri=database_uri(fresh)).search_experiments(max_results=1)
            with contextlib.suppress(FileExistsError):  # another process was faster
                os.link(fresh, path)


def _write_pyfunc(to: Path, source: Path, shape: tuple[int, int], model: str, run: str) -> None:
    """Wrap the folder of a model as an MLflow pyfunc with a signature, without a pickle."""
    from mlflow.models import Model, ModelSignature  # slow to import
    from mlflow.types import Schema, TensorSpec  # slow to import

    def tensors(names: dict[str, tuple[int, ...]]) -> Schema:
        return Schema(
            [TensorSpec(np.dtype(np.float64), dims, name) for name, dims in names.items()]
        )

    shutil.copytree(source, to / "data")
    inputs, outputs = pyfunc_model.signature(*shape)
    wrapped = Model(model_id=model, run_id=run)
    wrapped.signature = ModelSignature(tensors(inputs), tensors(outputs))
    wrapped.add_flavor(
        "python_function",
        loader_module=pyfunc_model.__name__,
        data="data",
        python_version=platform.python_version(),
    )
    wrapped.save(str(to / "MLmodel"))


def _parts(items: list[Any], size: int) -> Iterator[list[Any]]:
    return (items[i : i + size] for i in range(0, len(items), size))
