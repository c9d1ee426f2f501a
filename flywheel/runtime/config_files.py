"""From YAML files and `key=value` arguments to a validated model, with errors one can act on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar, get_args

import yaml
from omegaconf import DictConfig, ListConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException
from pydantic import BaseModel, ValidationError

from flywheel.errors import ConfigError

M = TypeVar("M", bound=BaseModel)
EXTENDS = "extends"


def read_config(schema: type[M], path: str | Path, overrides: Sequence[str] = ()) -> M:
    """Read a YAML file, put the overrides on top, and validate.

    A file may begin with `extends: other.yaml`, relative to itself, and hold only what differs; or with
    a list of others, of which later ones win.

    Args:
      schema: what the result must be.
      path: of the YAML file.
      overrides: "a.b=value", the value in YAML; later ones win.

    Raises:
      ConfigError: no such file, not YAML, an unknown key or a wrong value; the message lists every
        problem with its path, what was got and what is allowed.
    """
    merged = OmegaConf.merge(_with_parents(Path(path), ()), _parsed(overrides))
    try:
        plain = OmegaConf.to_container(merged, resolve=True)
    except OmegaConfBaseException as error:
        raise ConfigError(f"{path}: {error}") from None
    return validated(schema, plain, str(path))


def validated(schema: type[M], values: Any, source: str) -> M:
    """Validate plain values, e.g. from a resolved YAML file.

    Raises:
      ConfigError: see `read_config`.
    """
    try:
        return schema.model_validate(values)
    except ValidationError as error:
        problems = "\n".join(f"  {_explained(schema, e)}" for e in error.errors())
        raise ConfigError(f"{source} is not a valid configuration:\n{problems}") from None


def differences(old: Any, new: Any, path: str = "") -> Iterator[str]:
    """Where two plain configurations differ, as "a.b: 1 -> 2"."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in sorted(old.keys() | new.keys()):
            where = f"{path}.{key}" if path else str(key)
            yield from differences(old.get(key, "(not set)"), new.get(key, "(not set)"), where)
    elif old != new:
        yield f"{path}: {old} -> {new}"


def _with_parents(path: Path, children: tuple[Path, ...]) -> DictConfig:
    try:
        loaded = OmegaConf.load(path)
    except FileNotFoundError:
        raise ConfigError(f"There is no configuration {path}.{_near(path)}") from None
    except (OSError, yaml.YAMLError, OmegaConfBaseException) as error:
        raise ConfigError(f"{path} is not a YAML file: {error}") from None
    if not isinstance(loaded, DictConfig):
        raise ConfigError(f"{path} must hold `key: value` lines, got {type(loaded).__name__}.")
    own = (*children, path.resolve())
    parents = [path.parent / name for name in _names(path, loaded.pop(EXTENDS, []))]
    for parent in parents:
        if parent.resolve() in own:
            raise ConfigError(f"{path} extends itself, by way of {parent.resolve()}.")
    merged = OmegaConf.merge(*(_with_parents(parent, own) for parent in parents), loaded)
    assert isinstance(merged, DictConfig)
    return merged


def _names(path: Path, extended: Any) -> list[str]:
    """Of the files that one extends."""
    names = list(extended) if isinstance(extended, list | ListConfig) else [extended]
    if not all(isinstance(name, str) and name for name in names):
        raise ConfigError(
            f"{path}: {EXTENDS} takes another file or a list of them, got {extended!r}."
        )
    return names


def _near(path: Path) -> str:
    folder = path.parent if path.parent.is_dir() else Path()
    known = sorted(p.name for p in folder.glob("*.yaml"))
    return f" There are: {', '.join(known)}." if known else ""


def _parsed(overrides: Sequence[str]) -> DictConfig:
    for override in overrides:
        if "=" not in override or override.startswith("="):
            raise ConfigError(
                f"An override is key=value, e.g. training.steps=500; got {override!r}."
            )
    try:
        return OmegaConf.from_dotlist(list(overrides))
    except (OmegaConfBaseException, yaml.YAMLError, ValueError) as error:
        raise ConfigError(f"Cannot read the overrides {list(overrides)}: {error}") from None


def _explained(schema: type[BaseModel], error: Any) -> str:
    location = error["loc"]
    where = ".".join(str(part) for part in location) or "(the whole)"
    if error["type"] == "extra_forbidden":
        allowed = sorted(_fields_at(schema, location[:-1]))
        near = get_close_matches(str(location[-1]), allowed, n=1)
        hint = f" Did you mean {near[0]!r}?" if near else ""
        return f"{where}: unknown key.{hint} Allowed: {', '.join(allowed)}."
    if error["type"] == "missing":
        return f"{where}: must be given."
    return f"{where}: {error['msg']}; got {error['input']!r}."


def _fields_at(schema: type[BaseModel], location: Sequence[str | int]) -> set[str]:
    found = {schema}
    for part in location:
        fields = [m.model_fields[str(part)].annotation for m in found if part in m.model_fields]
        found = {model for field in fields for model in _models_in(field)} or found
    return {name for model in found for name in model.model_fields}


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from _models_in(part)
