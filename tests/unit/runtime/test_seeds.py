"""Seeds depend on what a job is, and on nothing else."""

import numpy as np

from flywheel.runtime.workers.episode_plan import derive_seed


def test_a_seed_depends_on_every_part_of_what_the_job_is():
    seeds = {
        derive_seed(run, kind, iteration, index)
        for run in range(3)
        for kind in ("mppi", "random")
        for iteration in range(3)
        for index in range(50)
    }
    assert len(seeds) == 3 * 2 * 3 * 50
    assert all(0 <= seed < 2**32 for seed in seeds)


def test_a_seed_is_the_same_in_another_process_and_year():
    assert derive_seed(7, "collect", 1, "mppi", 3) == derive_seed(7, "collect", 1, "mppi", 3)
    assert derive_seed(0, "a") == 3729247296


def test_neighbouring_jobs_have_unrelated_streams():
    first, second = (
        np.random.default_rng(derive_seed(0, "x", i)).normal(size=4000) for i in (1, 2)
    )
    assert abs(np.corrcoef(first, second)[0, 1]) < 0.06
