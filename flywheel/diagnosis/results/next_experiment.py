"""The next experiment, given the results so far."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from flywheel.diagnosis.results.evidence import Evidence
from flywheel.diagnosis.results.verdict import Alternative, Verdict
from flywheel.diagnosis.selection.candidates import Candidate
from flywheel.diagnosis.selection.scores import Score
from flywheel.effects import PROBES

SHOWN = 3  # effects whose best experiment is named
SAME = 0.999  # |cosine| from which two candidates are one
AGAIN = (
    "Record the same commands once more from the same start: an error that recurs at the same "
    "moment belongs to the robot, one that does not came from outside or happened once."
)
REST = "Start with the robot lying still for a second, so that its initial state is known."
MORE_TIME = "None yet: diagnose the same recordings again, with more time."
LONGER = (
    "Every effect of the library would have been visible at its typical size; smaller ones need "
    "longer recordings."
)


@dataclass(frozen=True)
class NextExperiment:
    """A recommended recording.

    Attributes:
      aim: purpose of the experiment.
      about: the effects whose best experiments (`Effect.shown_by`) it resembles.
      rivals: to distinguish; empty if nothing is undecided.
    """

    aim: str
    about: tuple[Candidate, ...] = ()
    rivals: tuple[Candidate, ...] = ()

    @property
    def shown_by(self) -> dict[str, str]:
        """Name of each such effect, and the experiment that shows it best."""
        return {each.effect.name: each.effect.shown_by for each in self.about}

    @property
    def command(self) -> str:
        """Command that writes its commands, without the robot; "" if nothing is undecided."""
        names = " ".join(each.name for each in self.rivals)
        return f"flywheel design {names}" if names else ""

    def summary(self) -> dict[str, Any]:
        """In JSON form."""
        return {"aim": self.aim, "shown_by": self.shown_by, "command": self.command}


def next_experiment(
    verdict: Verdict,
    answers: Sequence[Alternative],
    ranking: Sequence[Score],
    evidence: Evidence,
    other_law: str = "",
    interrupted: bool = False,
) -> NextExperiment:
    """The experiment recommended for the verdict.

    Args:
      verdict, answers: results.
      ranking: of all candidates on top of the initial model.
      evidence: similar candidates.
      other_law: a law of no library, whose form an answer without a residual has; "" for none.
      interrupted: the diagnosis was stopped early.
    """
    if verdict is Verdict.NOT_CONVERGED:
        return NextExperiment(MORE_TIME if interrupted else REST)
    if verdict in (Verdict.PARTIAL, Verdict.OUTSIDE_LIBRARY):
        if other_law:
            return _form(other_law)
        if verdict is Verdict.OUTSIDE_LIBRARY or len(answers) == 1:
            return NextExperiment(AGAIN)
    if verdict in (Verdict.NOISE_ONLY, Verdict.DATA_INSUFFICIENT):
        return _unseen(ranking)
    named = [_candidates(answer, ranking) for answer in answers]
    return _confirming(named[0], evidence) if len(named) == 1 else _deciding(named, evidence)


def _form(law: str) -> NextExperiment:
    """Determine the form of the answer."""
    return NextExperiment(
        f"To determine its form, the experiment that shows {law} best: {PROBES[law].shown_by}. An "
        "effect of that form can be added (docs/own_effect.md)."
    )


def _deciding(answers: Sequence[Sequence[Candidate]], evidence: Evidence) -> NextExperiment:
    """Distinguish alternatives, if possible."""
    everyone = list(dict.fromkeys(each for answer in answers for each in answer))
    rivals = tuple(each for each in everyone if not all(each in answer for answer in answers))
    alike = min((_likeness(evidence, rivals[0], other) for other in rivals[1:]), default=0.0)
    if alike > SAME:
        return NextExperiment(
            f"{_listed(rivals)} change these recordings in the same way (|cos| {alike:.4f}): only "
            "measuring one of them by itself distinguishes them.",
            rivals,
        )
    return NextExperiment(f"To be distinguished: {_listed(rivals)}.", rivals, rivals)


def _confirming(answer: Sequence[Candidate], evidence: Evidence) -> NextExperiment:
    """Distinguish an answer from its most similar candidate."""
    pairs = [(own, other) for own in answer for other in evidence.rivals if other not in answer]
    if not pairs:
        return NextExperiment("For a narrower interval, make the effect larger.", tuple(answer))
    own, other = max(pairs, key=lambda pair: _likeness(evidence, *pair))
    return NextExperiment(
        f"Of all others, {other.label} is most similar to {own.label} here (|cos| "
        f"{_likeness(evidence, own, other):.2f}): commands that separate the two test the answer.",
        (own,),
        (own, other),
    )


def _unseen(ranking: Sequence[Score]) -> NextExperiment:
    """Show effects that could exist at their typical size, unseen."""
    unseen: dict[str, Candidate] = {}
    for score in sorted(ranking, key=lambda s: -s.smallest):
        if score.smallest > 1.0:
            unseen.setdefault(score.candidate.effect.name, score.candidate)
    if not unseen:
        return NextExperiment(LONGER)
    return NextExperiment(
        f"Could exist at its typical size without being visible: {', '.join(unseen)}.",
        tuple(unseen.values())[:SHOWN],
    )


def _candidates(answer: Alternative, ranking: Sequence[Score]) -> list[Candidate]:
    """The candidates of an answer's effects."""
    known = {(s.candidate.effect.name, s.candidate.location): s.candidate for s in ranking}
    places = [(each.effect, each.location) for each in answer]
    return [known[place] for place in places if place in known]


def _listed(candidates: Iterable[Candidate]) -> str:
    return ", ".join(each.label for each in candidates)


def _likeness(evidence: Evidence, first: Candidate, second: Candidate) -> float:
    """|cosine| between the changes of two candidates; 0 if one is not among the best."""
    rivals = evidence.rivals
    if first not in rivals or second not in rivals:
        return 0.0
    return float(evidence.likeness[rivals.index(first), rivals.index(second)])
