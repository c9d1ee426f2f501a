"""Wrong samples that neither leap far nor stretch a rod are found by their surroundings."""

import numpy as np

from flywheel.data.recordings import read_recording
from flywheel.data.recordings.repair.strays import islands, spikes
from tests.unit.data.recordings.conftest import SEED


def test_a_sample_beside_its_path_is_masked_though_no_rod_is_longer_for_it(sheet):
    log = sheet()
    row = int(log.rng.integers(5, 195))
    points, rod = log.positions("s2"), log.positions("s2") - log.positions("s3")
    aside = np.cross(rod[row], log.rng.standard_normal(3))
    points[row] += log.rng.uniform(0.17, 0.22) * aside / np.linalg.norm(aside)
    log.move("s2", points)
    (found,) = read_recording(log.save(), log.robot).report.findings
    assert (found.kind, found.subject, found.count) == ("leap", "s2", 1), SEED
    np.testing.assert_allclose(found.spans, [[log.made.time[row]] * 2], err_msg=str(SEED))


def test_a_marker_that_stays_in_a_wrong_place_is_never_taken_for_right(sheet):
    log = sheet()
    begin, points = int(log.rng.integers(10, 140)), log.positions("s2")
    away = log.rng.standard_normal(3)
    points[begin : begin + 45] = points[begin] + log.rng.uniform(0.6, 1.5) * away / np.sqrt(
        away @ away
    )
    log.move("s2", points)
    kept = read_recording(log.save(), log.robot).episodes[0].trajectory.observations
    assert not kept.valid[begin : begin + 45, 2].any(), SEED
    right = kept.valid[:, 2]
    np.testing.assert_array_equal(kept.points[right, 2], log.made.points[right, 2])
    assert kept.valid[:begin].all(), SEED


def test_a_blow_is_no_spike() -> None:
    rng = np.random.default_rng(SEED)
    time = np.cumsum(rng.uniform(0.008, 0.012, 100))
    before, after = rng.standard_normal((2, 3))
    since = time - time[rng.integers(10, 90)]
    points = np.where(since[:, None] < 0, before * since[:, None], after * since[:, None])
    kick = float(np.linalg.norm(after - before))
    assert not spikes(points[:, None], time, 1.001 * kick, 0.0).any(), SEED
    assert spikes(points[:, None], time, 0.9 * kick, 0.0).sum() == 1, SEED


def test_short_stays_between_wrong_samples_are_islands_unless_the_marker_leapt_there() -> None:
    time = 0.01 * np.arange(200)
    wrong = np.zeros((200, 1), bool)
    wrong[[10, 15, 50, 110]] = True
    seen = ~wrong
    leaping, steady = np.zeros((199, 1), bool), np.ones((199, 1), bool)
    assert not islands(wrong, seen, leaping, time).any()
    expected = [11, 12, 13, 14, *range(16, 50)]
    assert np.flatnonzero(islands(wrong, seen, steady, time)).tolist() == expected
