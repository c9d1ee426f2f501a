"""The only module that imports mlflow, and only once a record is delivered: the import takes seconds.

`MlflowReceiver` executes one record, through a client with explicit run ids. Every action first
checks MLflow's state, or is idempotent there: a number sent again with its own time stamp is the
same row. A record that is delivered twice therefore leaves no duplicates. Runs are found by their
tag `flywheel.run_key`.
"""

from __future__ import annotations

import contextlib
import json
import os
import platform
import re
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flywheel.errors import DataError
from flywheel.runtime.tracking import pyfunc_model
from flywheel.runtime.tracking.dashboard import DATABASE, SETTINGS, damage, database_uri
from flywheel.runtime.tracking.tracker import Record, Tracker, TrackingConfig, forget_delivery

if TYPE_CHECKING:
    from mlflow import MlflowClient

CHAMPION = "champion"
ARTIFACTS = "mlflow-artifacts"


def open_tracker(
    folder: str | Path,
    key: str,
    robot: str,
    config: TrackingConfig | None = None,
    retry_seconds: tuple[float, float] = (1.0, 60.0),
) -> Tracker:
    """The tracker of a run. It also delivers the records left by an earlier tracker of the folder.

    Args:
      folder: of the run; without a server it also contains MLflow's SQLite file and artifacts.
      key: unique name of the run, [A-Za-z0-9._-]+.
      robot: its name, for the model registry.
      config: of the tracking.
      retry_seconds: first and longest pause after a failed delivery [s].

    Raises:
      ConfigError: MLflow cannot have a database in a folder of this name.
    """
    config, database = config or TrackingConfig(), Path(folder) / DATABASE
    if not config.uri:
        database_uri(database)
        if _missing(database):
            forget_delivery(database.parent)  # a new database gets every record
    receiver = MlflowReceiver(Path(folder).absolute(), config, robot)
    return Tracker(folder, key, receiver, config.close_seconds, retry_seconds)


class MlflowReceiver:
    """Executes a record at MLflow; repetition changes nothing.

    Args:
      folder: of the run, absolute.
      config: of the tracking.
      robot: its name, for the model registry.
    """

    def __init__(self, folder: Path, config: TrackingConfig, robot: str) -> None:
        self._folder = folder
        self._config = config
        name = config.registered_model or f"flywheel-{robot}"
        self._registry = re.sub(r"[^A-Za-z0-9._-]", "-", name)
        self._ids: dict[str, str] = {}
        self._client: MlflowClient | None = None
        self._experiment = ""
        self._actions: dict[str, Callable[[MlflowClient, Record], None]] = {
            "open": self._open,
            "log": self._log,
            "describe": self._describe,
            "dataset": self._dataset,
            "artifact": self._artifact,
            "model": self._model,
            "promote": self._promote,
            "end": self._end,
        }

    def deliver(self, record: Record) -> None:
        """Execute one record."""
        self._actions[record["kind"]](self._connected(), record)

    def is_permanent(self, error: Exception) -> bool:
        """True if MLflow will always reject the record, or a file that it names is gone."""
        refused = getattr(error, "error_code", "") == "INVALID_PARAMETER_VALUE"
        return refused or isinstance(error, (FileNotFoundError, LookupError))

    def _connected(self) -> MlflowClient:
        if self._client is None:
            _configure(self._config.request_seconds)
            from mlflow import MlflowClient  # slow to import

            uri = self._config.uri or database_uri(_database(self._folder / DATABASE))
            client = MlflowClient(tracking_uri=uri, registry_uri=uri)
            self._experiment = self._find_experiment(client)
            self._client = client
        return self._client

    def _find_experiment(self, client: MlflowClient) -> str:
        name = self._config.experiment
        if (found := client.get_experiment_by_name(name)) is not None:
            return str(found.experiment_id)
        own = self._config.uri.startswith("http")
        place = None if own else (self._folder / ARTIFACTS).as_uri()
        return str(client.create_experiment(name, artifact_location=place))

    def _id(self, client: MlflowClient, key: str) -> str:
        """MLflow's id of a run that has been opened."""
        if key not in self._ids and not self._find(client, key):
            raise LookupError(
                f"MLflow has no run {key!r} in experiment {self._config.experiment!r}."
            )
        return self._ids[key]

    def _find(self, client: MlflowClient, key: str) -> bool:
        same = f"tags.`flywheel.run_key` = '{key}'"
        for run in client.search_runs([self._experiment], same, max_results=1):
            self._ids[key] = run.info.run_id
        return key in self._ids

    def _open(self, client: MlflowClient, record: Record) -> None:
        key = record["run"]
        if self._find(client, key):
            client.update_run(self._ids[key], status="RUNNING", name=record["name"])
            return
        tags = {"flywheel.run_key": key, "mlflow.source.name": "flywheel", **record["tags"]}
        if record["parent"]:
            tags["mlflow.parentRunId"] = self._id(client, record["parent"])
        run = client.create_run(self._experiment, record["time"], tags, record["name"])
        self._ids[key] = run.info.run_id

    def _log(self, client: MlflowClient, record: Record) -> None:
        from mlflow.entities import Metric  # slow to import

        time = record["time"]
        metrics = [Metric(name, value, time, step) for name, step, value in record["values"]]
        for part in _parts(metrics, 1000):
            client.log_batch(self._id(client, record["run"]), metrics=part)

    def _describe(self, client: MlflowClient, record: Record) -> None:
        from mlflow.entities import Param, RunTag  # slow to import

        run = self._id(client, record["run"])
        have = client.get_run(run).data.params
        params = [
            Param(name[:250], value[:6000])
            for name, value in record["params"].items()
            if name[:250] not in have
        ]
        tags = [RunTag(name[:250], value[:8000]) for name, value in record["tags"].items()]
        for part in _parts(params, 100):
            client.log_batch(run, params=part)
        for part in _parts(tags, 100):
            client.log_batch(run, tags=part)

    def _dataset(self, client: MlflowClient, record: Record) -> None:
        from mlflow.entities import Dataset, DatasetInput, InputTag  # slow to import

        digest = record["digest"]
        dataset = Dataset(
            name=record["name"],
            digest=digest[:36],
            source_type="flywheel",
            source=json.dumps({"snapshot": digest}),
            profile=json.dumps(record["profile"]),
        )
        use = InputTag("mlflow.data.context", "training")
        run = self._id(client, record["run"])
        client.log_inputs(run, [DatasetInput(dataset, [use])])
        client.set_tag(run, "flywheel.snapshot", digest)

    def _artifact(self, client: MlflowClient, record: Record) -> None:
        path = self._folder / record["path"]
        if not path.exists():
            raise FileNotFoundError(f"{path} was to be logged, but is missing")
        client.log_artifact(self._id(client, record["run"]), str(path))

    def _model(self, client: MlflowClient, record: Record) -> None:
        run, key = self._id(client, record["run"]), f"{record['run']}/{record['digest']}"
        same = f"tags.`flywheel.model_key` = '{key}'"
        models = client.search_logged_models([self._experiment], same, max_results=1)
        tags = {"flywheel.model_key": key, "flywheel.model": record["digest"], **record["tags"]}
        model = (
            models[0]
            if models
            else client.create_logged_model(
                self._experiment, record["name"], run, tags, model_type="dynamics"
            )
        )
        if str(model.status) != "READY":
            self._upload(client, record, model.model_id, run)
        self._register(client, model, run, tags)

    def _upload(self, client: MlflowClient, record: Record, model: str, run: str) -> None:
        from mlflow.entities import LoggedModelOutput  # slow to import

        with tempfile.TemporaryDirectory() as folder:
            _write_pyfunc(
                Path(folder), self._folder / record["folder"], record["shape"], model, run
            )
            client.log_model_artifacts(model, folder)
        outputs = client.get_run(run).outputs
        if model not in {output.model_id for output in outputs.model_outputs}:
            client.log_outputs(run, [LoggedModelOutput(model, record["step"])])
        client.finalize_logged_model(model, "READY")

    def _register(self, client: MlflowClient, model: Any, run: str, tags: dict[str, str]) -> None:
        name = self._registry
        if not client.search_registered_models(f"name = '{name}'"):
            client.create_registered_model(name)
        if self._version(client, "flywheel.model_key", tags["flywheel.model_key"]) is None:
            client.create_model_version(
                name, model.artifact_location, run, tags, model_id=model.model_id
            )

    def _version(self, client: MlflowClient, tag: str, value: str) -> str | None:
        same = f"name = '{self._registry}' and tags.`{tag}` = '{value}'"
        versions = client.search_model_versions(same)
        return max((str(v.version) for v in versions), key=int, default=None)

    def _promote(self, client: MlflowClient, record: Record) -> None:
        digest, decision = record["digest"], record["decision"]
        version = self._version(client, "flywheel.model", digest)
        if version is None:
            raise LookupError(f"MLflow has no version of {self._registry} with weights {digest}.")
        for name in ("measure", "number", "reference", "reason"):
            client.set_model_version_tag(
                self._registry, version, f"flywheel.gate.{name}", decision[name]
            )
        client.set_registered_model_alias(self._registry, CHAMPION, version)
        run = self._id(client, record["run"])
        client.set_tag(run, "flywheel.champion", digest)
        client.set_tag(run, "flywheel.champion.number", decision["number"])

    def _end(self, client: MlflowClient, record: Record) -> None:
        client.set_terminated(self._id(client, record["run"]), record["status"], record["time"])


def _configure(request_seconds: int) -> None:
    """Make MLflow's client fail fast and keep quiet, before it is first imported.

    For an error it would print a traceback; the tracker logs one line.
    """
    os.environ["MLFLOW_HTTP_REQUEST_TIMEOUT"] = str(request_seconds)
    os.environ.setdefault("MLFLOW_LOGGING_LEVEL", "CRITICAL")
    for name, value in SETTINGS.items():
        os.environ.setdefault(name, value)


def _database(path: Path) -> Path:
    """The SQLite file, made with its tables in one atomic step.

    If a process is killed while MLflow makes the tables, or two processes do so at once, the file
    can never be opened again.

    Raises:
      DataError: there is a damaged one.
    """
    if problem := damage(path):
        raise DataError(problem)
    if _missing(path):
        path.unlink(missing_ok=True)
        from mlflow import MlflowClient  # slow to import

        with tempfile.TemporaryDirectory(dir=path.parent, prefix=".mlflow-") as folder:
            fresh = Path(folder) / path.name
            MlflowClient(tracking_uri=database_uri(fresh)).search_experiments(max_results=1)
            with contextlib.suppress(FileExistsError):  # another process was faster
                os.link(fresh, path)
    return path


def _missing(path: Path) -> bool:
    """True if the file is missing, or was left empty by a full disk."""
    return not path.exists() or (path.is_file() and path.stat().st_size == 0)


def _write_pyfunc(to: Path, source: Path, shape: list[int], model: str, run: str) -> None:
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


def _parts(items: list[Any], size: int) -> list[list[Any]]:
    return [items[i : i + size] for i in range(0, len(items), size)]
