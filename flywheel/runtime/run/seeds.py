"""One seed per job, derived from the run's seed and what the job is."""

import hashlib

import numpy as np


def derive_seed(run_seed: int, *what: str | int) -> int:
    """A seed that depends on the run's seed and on `what` only, never on order, worker or time.

    Args:
      run_seed: of the whole run.
      what: names the job, e.g. ("collect", 1, "mppi", 3).

    Returns:
      An integer in [0, 2^32), as fit for numpy as for torch.
    """
    words = hashlib.sha256("/".join(str(part) for part in what).encode()).digest()
    entropy = [run_seed, *np.frombuffer(words, dtype=np.uint32).tolist()]
    return int(np.random.SeedSequence(entropy).generate_state(1)[0])
