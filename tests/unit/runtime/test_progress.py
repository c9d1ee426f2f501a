"""What people see while they wait."""

from benchmarks.robot import PieceOfStage
from flywheel.runtime.pool.progress import Lines, clock_face


def test_plain_lines_tell_share_rate_and_time_left():
    now = [0.0]
    lines: list[str] = []
    with Lines(lines.append, every=10, clock=lambda: now[0]).stage("collect", 40) as stage:
        stage.update(1)
        now[0] = 30
        stage.update(10, "episode 3")
        now[0] = 31
        stage.update(11)
        now[0] = 120
    assert lines == [
        "collect:  25% after 0:30, 1:30 left, 0.333/s, episode 3",
        "collect: done in 2:00",
    ]


def test_a_stage_that_fails_does_not_claim_to_be_done():
    lines: list[str] = []
    try:
        with Lines(lines.append).stage("train", 1):
            raise ValueError
    except ValueError:
        pass
    assert lines == []


def test_a_piece_of_a_stage_goes_on_where_the_one_before_it_ended():
    now = [0.0]
    lines: list[str] = []
    with Lines(lines.append, every=10, clock=lambda: now[0]).stage("drives", 4) as stage:
        now[0] = 20
        PieceOfStage(stage, 1.0).update(0.5, "drive 2")
    assert lines[0] == "drives:  38% after 0:20, 0:33 left, 0.075/s, drive 2"


def test_times_read_like_a_clock():
    assert [clock_face(s) for s in (0, 59.6, 61, 3661)] == ["0:00", "1:00", "1:01", "1:01:01"]
