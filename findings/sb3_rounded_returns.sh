#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" stable-baselines3==2.9.2 gymnasium==1.4.0 torch==2.13.0 numpy==2.4.6
echo "guess:     evaluate_policy tells a controller that is 0.1 mm off from one that is 0.2 mm off, by rewards of minus m2"
echo "behaviour: Monitor rounds returns to six digits after the point: both are 0, and so is a perfect one; without Monitor they differ"
python -W ignore - <<'PYTHON'
import gymnasium
import numpy as np
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor

IDLE = np.zeros(1, np.float32)


class Platform(gymnasium.Env):
    """Ten steps, each with minus the squared distance [m2] from the target as its reward."""

    observation_space = action_space = gymnasium.spaces.Box(-1, 1, (1,))

    def __init__(self, error):
        self.error = error

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.steps = 0
        return IDLE, {}

    def step(self, action):
        self.steps += 1
        return IDLE, -self.error**2, False, self.steps == 10, {}


class Policy:
    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.zeros((len(observation), 1), np.float32), None


def mean_return(env):
    return float(f"{evaluate_policy(Policy(), env, n_eval_episodes=3)[0]:.4g}")


errors = (0.0001, 0.0002, 0.001)
monitored, bare = {error: mean_return(Monitor(Platform(error))) for error in errors}, {error: mean_return(Platform(error)) for error in errors}
print(f"seen:      mean returns by error in metres: with Monitor {monitored}, without {bare}")
assert monitored[0.0001] == monitored[0.0002] == 0 and bare[0.0002] == -4e-7 and monitored[0.001] == bare[0.001] == -1e-5, "this has changed"
PYTHON
