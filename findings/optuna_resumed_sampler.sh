#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" optuna==5.0.0 numpy==2.4.6
echo "guess:     a study that goes on from its database draws new trials, also with a seeded sampler"
echo "behaviour: it draws the same trials again, as the sampler begins anew; TPE repeats its random beginning, too"
python -W ignore - 2>/dev/null <<'PYTHON'
import optuna

optuna.logging.set_verbosity(optuna.logging.ERROR)


def two_nights(name, sampler, trials):
    """The values tried in two sessions of `trials` each."""
    for _ in range(2):
        study = optuna.create_study(
            study_name=name, storage="sqlite:///tuning.db", load_if_exists=True, sampler=sampler(seed=0)
        )
        study.optimize(lambda trial: (trial.suggest_float("stiffness", 0, 1) - 0.5) ** 2, n_trials=trials)
    return [round(trial.params["stiffness"], 4) for trial in study.trials]


drawn, modelled = two_nights("random", optuna.samplers.RandomSampler, 3), two_nights("tpe", optuna.samplers.TPESampler, 3)
print(f"seen:      3 + 3 trials by RandomSampler(seed=0): {drawn}; by TPESampler(seed=0): {modelled}")
assert drawn[:3] == drawn[3:] and modelled[:3] == modelled[3:], "this has changed"
PYTHON
