from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest

from flywheel.dynamics.plant import Film, Plant, Scenery, Shot
from flywheel.errors import DataError
from flywheel.records import Plans, State
from flywheel.robots import Box, Robot, load_robot
from flywheel.terrain import with_boxes
from tests.full_disk import complaints, files_end_at

SMALL = Shot(size=(160, 96))


@pytest.fixture(scope="module")
def states(robot: Robot) -> State:
    plant = Plant(robot)
    return plant.simulate(plant.rest(), np.full((1, 40, 6), -0.3)).states[0]


@pytest.mark.slow
@pytest.mark.renders
def test_a_video_has_a_frame_for_each_moment(robot: Robot, states: State, tmp_path: Path) -> None:
    shares: list[float] = []
    film = Film(robot, states, fps=25, shot=SMALL)
    path = film.write(tmp_path / "new" / "a.mp4", shares.append)
    assert shares == pytest.approx(np.arange(1, 12) / 11)
    frames, seconds = imageio_ffmpeg.count_frames_and_secs(str(path))
    assert frames == 11  # 0.4 s and the first
    assert seconds == pytest.approx(11 / 25, abs=0.05)


@pytest.mark.slow
@pytest.mark.renders
def test_a_disk_without_room_for_a_video_is_told_and_no_half_of_it_is_left(
    robot: Robot, states: State, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    with files_end_at(1000), pytest.raises(DataError, match="Is the disk full"):
        Film(robot, states, fps=25).write(tmp_path / "a.mp4")
    assert list(tmp_path.iterdir()) == []
    assert complaints(capfd) == []


@pytest.mark.slow
@pytest.mark.renders
def test_goal_boxes_and_predictions_are_seen(robot: Robot, states: State) -> None:
    def last(**extra: object) -> np.ndarray:
        *_, frame = Film(robot, states[-2:], fps=10, shot=SMALL, **extra).frames()
        return frame.astype(int)

    plain = last()
    assert plain.shape == (96, 160, 3)
    assert plain.std() > 10
    ghosts = Plant(robot).observe(states[-2:]).points + [0.0, 0.0, 1.0]
    for extra in (
        {"scenery": Scenery(goal=np.array([-1.0, 0.5]))},
        {
            "scenery": Scenery(
                terrain=with_boxes(None, [Box(center=(-1.5, 0, 0.5), half_size=(0.3, 0.3, 0.5))])
            )
        },
        {"ghosts": ghosts},
    ):
        changed = np.abs(last(**extra) - plain).max(axis=-1) > 20
        assert 0.002 < changed.mean() < 0.5, extra.keys()


@pytest.mark.slow
@pytest.mark.renders
def test_only_the_plan_in_force_is_seen(robot: Robot, states: State) -> None:
    way = np.array([[[0.0, -2.0], [0.0, 2.0]]])
    later = Plans(np.array([0.2, 0.3]), np.stack([way, way[..., ::-1]]))
    frames = list(Film(robot, states, fps=10, shot=SMALL, plans=later).frames())
    plain = list(Film(robot, states, fps=10, shot=SMALL).frames())
    differ = [np.abs(a.astype(int) - b).max() > 20 for a, b in zip(frames, plain, strict=True)]
    assert differ == [False, False, True, True, True]
    assert (frames[2] != frames[3]).any()


@pytest.mark.slow
@pytest.mark.renders
def test_walls_around_the_robot_do_not_hide_it(robot: Robot, states: State) -> None:
    walls = tuple(
        Box(center=(4 * x, 4 * y, 3.0), half_size=(0.5 + 4 * abs(y), 0.5 + 4 * abs(x), 3.0))
        for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1))
    )

    def moved(shot: Shot | None) -> float:
        among = Scenery(terrain=with_boxes(None, walls))
        first, last = (
            next(Film(robot, states[[i]], among, shot=shot).frames()).astype(int) for i in (0, -1)
        )
        return float((np.abs(first - last).max(axis=-1) > 20).mean())

    assert moved(None) > 0.002
    assert moved(Shot()) < 0.001  # from the side there are only walls, and their shadows


def test_what_does_not_fit_is_refused(robot: Robot, states: State) -> None:
    with pytest.raises(DataError, match=r"states \(T, 21\)"):
        Film(load_robot("prism3"), states[0])
    with pytest.raises(DataError, match=r"goal is \(x, y\)"):
        Film(robot, states, Scenery(goal=np.zeros(3)))
    with pytest.raises(DataError, match=r"must be \(41, 6, 3\)"):
        Film(robot, states, ghosts=np.zeros((40, 6, 3)))
