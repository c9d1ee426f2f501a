"""Law files: Python files outside the package with the user's own effects.

A law file is run only on request: by an option, in a run's configuration, or as the copy in a run.
A reference to one, as in an adopted plant, contains its sha256 and never runs it.

The effects of a law file go to other processes with the text of the file, which is run there again.
"""

from __future__ import annotations

import copyreg
import functools
import hashlib
import inspect
import re
import sys
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any, Self

from pydantic import Field, StringConstraints, model_validator

from flywheel.effects.declaration import wrong_in_declaration
from flywheel.effects.effect import Effect
from flywheel.errors import ConfigError, FlywheelError
from flywheel.files import MB, read_text
from flywheel.quantities import Name
from flywheel.validation import Frozen

CALLED = frozenset({"edit", "command", "rate", "tension"})  # what laws are asked while robots move
LARGEST = 1 * MB  # [bytes]
MOST_FILES = 20  # that are used together
SHORT = 12  # digits of a sha256 in messages
SUFFIX = ".py"
# No folders: a law file is named, and found where somebody says that it is.
FileName = Annotated[Name, StringConstraints(pattern=r"^[^/\\\x00]+\.py$")]
Sha256 = Annotated[Name, StringConstraints(pattern=r"^[0-9a-f]{64}$")]


class LawReference(Frozen):
    """Reference to a law file, without its text.

    Attributes:
      file: its name.
      sha256: of its text.
    """

    file: FileName
    sha256: Sha256

    def __str__(self) -> str:
        return f"{self.file} (sha256 {self.sha256[:SHORT]})"


class LawFile(LawReference):
    """A law file, validated from its path, or from that and its required sha256.

    Attributes:
      text: of the file; not stored in references.
    """

    text: str = Field(exclude=True, repr=False)

    @model_validator(mode="before")
    @classmethod
    def _read(cls, values: Any) -> Any:
        if isinstance(values, str | Path):
            values = {"file": str(values)}
        if (
            not isinstance(values, dict)
            or "text" in values
            or not isinstance(values.get("file"), str)
        ):
            return values
        path = Path(values["file"])
        try:
            if path.suffix != SUFFIX:
                raise ConfigError(f"A law file is Python and ends in {SUFFIX}, got {path}.")
            text = read_text(path, "law file", ConfigError, LARGEST)
        except ConfigError as error:
            raise ValueError(str(error)) from None
        sha256 = hashlib.sha256(text.encode()).hexdigest()
        if values.get("sha256", sha256) != sha256:
            raise ValueError(
                f"The law file {path} was changed: its sha256 is {sha256[:SHORT]}, not "
                f"{str(values['sha256'])[:SHORT]}."
            )
        return {**values, "file": path.name, "sha256": sha256, "text": text}

    @classmethod
    def read(cls, path: str | Path) -> Self:
        """Read a law file, without running it.

        Raises:
          ConfigError: there is none, or it is not text.
        """
        try:
            return cls.model_validate(path)
        except ValueError as error:
            [problem] = error.errors()  # type: ignore[attr-defined]
            raise ConfigError(problem["msg"].removeprefix("Value error, ")) from None

    @property
    def reference(self) -> LawReference:
        """The reference to it."""
        return LawReference(file=self.file, sha256=self.sha256)

    def effects(self) -> Mapping[str, Effect]:
        """Name -> effect, for all effects that the file defines. The file is run once in a process.

        Raises:
          ConfigError: it is not Python, raises on import, defines no effect, or one with a wrong
            declaration.
        """
        key = (self.file, self.sha256)
        if key not in _LOADED:
            _LOADED[key] = _loaded(self)
        return _LOADED[key]


_LOADED: dict[tuple[str, str], dict[str, Effect]] = {}
_FILES: dict[type[Effect], LawFile] = {}


def law_file(effect: Effect) -> LawFile | None:
    """The law file that an effect is from; None for one of the package."""
    return _FILES.get(type(effect))


def law_files(effects: Iterable[Effect]) -> tuple[LawFile, ...]:
    """The law files of effects, each once."""
    found = (law_file(effect) for effect in effects)
    return tuple({file.sha256: file for file in found if file is not None}.values())


def check_different(files: Iterable[LawFile]) -> None:
    """Reject two law files of one name: a plant and a run store them in one folder.

    Raises:
      ConfigError: there are two.
    """
    seen: set[str] = set()
    for file in files:
        if file.file in seen:
            raise ConfigError(f"Two law files are called {file.file}: rename one of them.")
        seen.add(file.file)


def check_given(wanted: Iterable[LawReference], given: Iterable[LawFile], whose: str) -> None:
    """Check that all required law files are given.

    Args:
      wanted: required ones.
      given: available ones.
      whose: the owner of the references, at the beginning of a sentence.

    Raises:
      ConfigError: one is missing, or has another text.
    """
    there = {file.sha256: file for file in given}
    for reference in wanted:
        if reference.sha256 in there:
            continue
        same = [file for file in there.values() if file.file == reference.file]
        if same:
            raise ConfigError(
                f"{whose} has effects of {reference}, but the given {reference.file} differs "
                f"(sha256 {same[0].sha256[:SHORT]}): give the original file."
            )
        raise ConfigError(
            f"{whose} has effects of the law file {reference}, which is missing: add "
            f"--effects-from {reference.file}, or effects_from in a run's configuration."
        )


def line_in(problem: BaseException, file: LawReference) -> str:
    """Line in a law file at which something was raised: " in line 3"; "" if not there."""
    lines, trace = [], problem.__traceback__
    while trace is not None:
        if trace.tb_frame.f_code.co_filename == file.file:
            lines.append(trace.tb_lineno)
        trace = trace.tb_next
    return f" in line {lines[-1]}" if lines else ""


def _guarded(method: Callable[..., Any]) -> Callable[..., Any]:
    """A method of a law, with every exception turned into one sentence about the effect."""

    @functools.wraps(method)
    def called(effect: Effect, *arguments: Any, **named: Any) -> Any:
        try:
            return method(effect, *arguments, **named)
        except FlywheelError:
            raise
        except Exception as problem:
            where = line_in(problem, _FILES[type(effect)])
            raise ConfigError(
                f"{described(effect)} raises {type(problem).__name__}{where}: {_words(problem)}."
            ) from None

    return called


def described(effect: Effect) -> str:
    """An effect at the beginning of a sentence: "cogging of my_laws.py"."""
    file = law_file(effect)
    return effect.name if file is None else f"{effect.name} of {file.file}"


def _words(problem: BaseException) -> str:
    lines = str(problem).strip().splitlines()
    return lines[0].rstrip(".") if lines else "without a word"


def _loaded(file: LawFile) -> dict[str, Effect]:
    """Run a law file, and check its declarations."""
    module = _run(file)
    kinds = [
        kind
        for kind in vars(module).values()
        if inspect.isclass(kind) and issubclass(kind, Effect) and kind.__module__ == module.__name__
    ]
    found: dict[str, Effect] = {}
    for kind in dict.fromkeys(kinds):
        if inspect.isabstract(kind) and not hasattr(kind, "name"):
            continue  # what several laws have in common
        if wrong := wrong_in_declaration(kind):
            raise ConfigError(f"The law {kind.__name__} of {file.file} {wrong}.")
        try:
            effect = kind()
        except Exception as problem:
            raise ConfigError(
                f"The law {kind.__name__} of {file.file} cannot be made without arguments: "
                f"{_words(problem)}."
            ) from None
        if effect.name in found:
            raise ConfigError(f"{file.file} defines two effects of the name {effect.name!r}.")
        found[effect.name] = effect
    if not found:
        raise ConfigError(
            f"{file.file} defines no effect: a class of ModelEffect, CommandEffect, WinchEffect or "
            "TensionEffect, of flywheel.effects, with a name."
        )
    for effect in found.values():
        kind = type(effect)
        _FILES[kind] = file
        copyreg.pickle(kind, _sent)
        for method in CALLED.intersection(dir(kind)):
            setattr(kind, method, _guarded(getattr(kind, method)))
    return found


def _run(file: LawFile) -> ModuleType:
    """Run a law file as a module of its own."""
    stem = re.sub(r"\W", "_", file.file.removesuffix(SUFFIX))
    module = ModuleType(f"_law_file_{file.sha256[:SHORT]}_{stem}")
    module.__file__ = file.file
    try:
        code = compile(file.text, file.file, "exec", dont_inherit=True)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as problem:
        line = f" in line {problem.lineno}" if isinstance(problem, SyntaxError) else ""
        said = problem.msg if isinstance(problem, SyntaxError) else _words(problem)
        raise ConfigError(f"The law file {file.file} is not Python: {said}{line}.") from None
    sys.modules[module.__name__] = module  # where dataclasses look for what annotations name
    try:
        exec(code, vars(module))
    except (Exception, SystemExit) as problem:
        del sys.modules[module.__name__]
        raise ConfigError(
            f"The law file {file.file} raises {type(problem).__name__}{line_in(problem, file)} on "
            f"import: {_words(problem)}."
        ) from None
    return module


def _sent(effect: Effect) -> tuple[Any, ...]:
    """Pickling of an effect of a law file for another process."""
    return _received, (_FILES[type(effect)], effect.name)


def _received(file: LawFile, name: str) -> Effect:
    return file.effects()[name]
