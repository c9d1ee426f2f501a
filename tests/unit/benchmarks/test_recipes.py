"""What trainings by recipes reached: their rows, table and figure."""

from dataclasses import replace

import pytest

from benchmarks import recipes
from benchmarks.recipes import RecipeRow, figure, keep, table
from benchmarks.rows import read_rows

ROW = RecipeRow("old", "", 36.0, 2.0, 0, 480, 121.4, 2.04, 1.26)


def test_a_training_kept_again_takes_its_place_and_seeds_share_a_row(tmp_path, monkeypatch):
    monkeypatch.setattr(recipes, "RECIPES_CSV", tmp_path / "recipes.csv")
    monkeypatch.setattr(recipes, "CURVE", tmp_path / "curve.svg")
    keep([ROW, replace(ROW, seed=1, e_pos=3.0), replace(ROW, changed="width 96")])
    keep([replace(ROW, e_pos=2.5)])
    rows = read_rows(RecipeRow, tmp_path / "recipes.csv")
    assert [row.e_pos for row in rows] == [2.5, 3.0, 2.04]
    assert table(rows)[2:] == [
        "| old | 2 | 36 |  | 480, 480 | 2.5, 3.0 | 1.3, 1.3 |",
        "| old | 2 | 36 | width 96 | 480 | 2.0 | 1.3 |",
    ]
    assert (tmp_path / "curve.svg").read_bytes().startswith(b"<?xml")


def test_the_curve_shows_seeds_and_their_medians_of_builds_with_their_defaults() -> None:
    seeds = [replace(ROW, seed=n, e_pos=error) for n, error in enumerate((2.0, 5.0, 2.2))]
    later = replace(ROW, minutes=4.0, cpu=240.0, e_pos=1.5)
    other = replace(ROW, build="new", e_pos=1.0)
    left_out = [replace(ROW, data=4.5, e_pos=9.0), replace(ROW, changed="width 96", e_pos=9.0)]
    drawn = figure([*seeds, later, other, *left_out])
    line, dots, *new = drawn.axes[0].get_lines()
    assert list(line.get_ydata()) == [2.2, 1.5]
    assert line.get_xdata()[1] == pytest.approx(4.0)
    assert sorted(dots.get_ydata()) == [1.5, 2.0, 2.2, 5.0]
    assert [list(each.get_ydata()) for each in new] == [[1.0], [1.0]]
