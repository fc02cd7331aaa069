"""Pictures of shapes: what is nearer hides what is farther, and planes and axes lie where they are."""

import numpy as np
import pytest

from training.reproduction.solid_view import SIZE, SolidView, camera, sampled
from training.shapes.solids import box

RED, GREEN, GREY = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]), np.full(3, 0.5)
MIDDLE = SIZE // 2


@pytest.fixture(scope="module")
def view() -> SolidView:
    """A box that is wider than high, about the origin."""
    return SolidView(*sampled(*box((0.5, 0.5, 0.2))))


def _is_background(picture: np.ndarray) -> np.ndarray:
    return (picture == 1.0).all(-1)


def test_the_surface_has_no_gaps_and_ends_where_the_box_ends(view: SolidView):
    there = ~_is_background(view.draw(GREY))
    for row in there:
        inside = np.flatnonzero(row)
        assert len(inside) == 0 or row[inside[0] : inside[-1] + 1].all()
    corners = np.array([[x, y, z] for x in (-0.25, 0.25) for y in (-0.25, 0.25) for z in (-0.1, 0.1)]) @ camera().T
    pixels = (there.any(0).sum(), there.any(1).sum())
    for extent, count in zip(np.ptp(corners[:, :2], axis=0), pixels, strict=True):
        assert count * 1.08 / SIZE == pytest.approx(extent, abs=0.02)


def test_points_take_the_colour_of_the_nearest_surface(view: SolidView):
    towards = view.points @ camera()[2]
    colours = np.where((towards > np.median(towards))[:, None], GREEN, RED)
    picture = view.draw(colours)
    assert picture[MIDDLE, MIDDLE, 1] > 0.3  # the near side
    assert picture[MIDDLE, MIDDLE, 0] == 0.0


def test_a_plane_is_seen_before_and_beside_the_surface_alone(view: SolidView):
    facing = camera()[2]
    before = view.draw(GREY, [(np.array([*facing, -0.4]), RED)])
    behind = view.draw(GREY, [(np.array([*facing, 0.4]), RED)])
    plain = view.draw(GREY)
    assert before[MIDDLE, MIDDLE, 0] > plain[MIDDLE, MIDDLE, 0]
    np.testing.assert_array_equal(behind[MIDDLE, MIDDLE], plain[MIDDLE, MIDDLE])
    beside = _is_background(plain) & ~_is_background(behind)
    assert beside.sum() > SIZE


def test_an_axis_goes_through_its_point_and_is_faint_where_it_is_hidden(view: SolidView):
    upright = np.array([0.0, 0.0, 1.0])
    picture = view.draw(GREY, axes=[(upright, np.array([0.0, 0.0, 3.0]), GREEN)])
    line = np.flatnonzero((picture == GREEN).all(-1).any(1))
    assert len(line) > SIZE // 4  # above and below the box
    assert (picture[line[0]] == GREEN).all(-1)[MIDDLE - 2 : MIDDLE + 2].any()
    hidden = picture[MIDDLE, MIDDLE]
    assert hidden[1] > hidden[0]
    assert not np.array_equal(hidden, GREEN)
