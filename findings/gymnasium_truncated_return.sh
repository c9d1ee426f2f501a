#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" gymnasium==1.4.0 numpy==2.4.6
echo "guess:     NormalizeReward scales rewards alike whether episodes of ten steps end by a limit on time or by the task"
echo "behaviour: its discounted return starts again only where the task ended: after a limit on time it goes on, and rewards become 5 times smaller"
python - <<'PYTHON'
import gymnasium
import numpy as np
from gymnasium.wrappers import NormalizeReward, TimeLimit

IDLE = np.zeros(1, np.float32)


class Platform(gymnasium.Env):
    """A reward of 1 at each step; `ends` says whether the task is over after ten."""

    observation_space = action_space = gymnasium.spaces.Box(-1, 1, (1,))

    def __init__(self, ends):
        self.ends = ends

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.steps = 0
        return IDLE, {}

    def step(self, action):
        self.steps += 1
        return IDLE, 1.0, self.ends and self.steps == 10, False, {}


def scaled(env):
    """The last reward of 200 episodes, and the mean of the discounted returns."""
    wrapped = NormalizeReward(env, gamma=0.99)
    for _ in range(200):
        wrapped.reset()
        over = False
        while not over:
            _, reward, terminated, truncated, _ = wrapped.step(IDLE)
            over = terminated or truncated
    return round(float(reward), 3), round(float(wrapped.return_rms.mean), 2)


ended, limited = scaled(Platform(True)), scaled(TimeLimit(Platform(False), 10))
print(f"seen:      reward 1 becomes {ended[0]} where the task ends, {limited[0]} where TimeLimit does; mean return {ended[1]} and {limited[1]}, of at most {sum(0.99**step for step in range(10)):.2f}")
assert ended[0] > 5 * limited[0] and ended[1] < 6 and limited[1] > 90, "this has changed"
PYTHON
