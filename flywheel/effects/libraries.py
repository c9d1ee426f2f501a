"""Libraries of effects: those of the package, and those of law files."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from flywheel.effects import NAMED, PROBES, Effect
from flywheel.effects.own import LawFile
from flywheel.errors import ConfigError

# Laws by which a diagnosis asks questions, and the one that it learns. They are in no library.
RESERVED = frozenset({*PROBES, "learned_tension"})


def with_laws(files: Iterable[LawFile], library: Mapping[str, Effect] = NAMED) -> dict[str, Effect]:
    """A library extended by the effects of law files.

    Args:
      files: to run.
      library: to extend.

    Raises:
      ConfigError: a file cannot be used, see `LawFile.effects`; or it defines an effect whose name is taken.
    """
    own: dict[str, Effect] = {}
    owner: dict[str, str] = {}
    for file in dict.fromkeys(files):
        for name, effect in file.effects().items():
            if name in NAMED or name in RESERVED:
                raise ConfigError(
                    f"{file.file} defines an effect {name!r}, a name that is taken in flywheel: give it "
                    "another."
                )
            if name in own:
                raise ConfigError(f"Both {owner[name]} and {file.file} define an effect {name!r}.")
            own[name], owner[name] = effect, file.file
    return {**library, **own}
