"""Labels never cover each other."""

from hypothesis import given
from hypothesis import strategies as st

from plannerforge.engine.rendering.top_view import round_length
from plannerforge.engine.rendering.vehicles import Label, place_labels

FRAME = (0.0, 0.0, 600.0, 400.0)
CHARACTER = (8.0, 14.0)
points = st.tuples(st.floats(0, 600), st.floats(0, 400))


@given(st.lists(points, max_size=40))
def test_every_label_is_placed_or_reported_and_no_two_overlap(places: list[tuple[float, float]]) -> None:
    labels = [Label(number, str(1000 + number), place, (5.0, 5.0)) for number, place in enumerate(places)]
    placed, left_out = place_labels(labels, [], FRAME, CHARACTER)
    assert sorted([*(place.label.key for place in placed), *left_out]) == list(range(len(places)))
    for first in placed:
        assert 0 <= first.center_px[0] <= 600
        assert 0 <= first.center_px[1] <= 400
        for second in placed:
            if first.label.key < second.label.key:
                apart_x = abs(first.center_px[0] - second.center_px[0]) >= 4 * CHARACTER[0] - 1e-6
                apart_y = abs(first.center_px[1] - second.center_px[1]) >= CHARACTER[1] - 1e-6
                assert apart_x or apart_y


@given(st.floats(0.5, 5000))
def test_scale_bars_have_round_lengths(about: float) -> None:
    length = round_length(about)
    assert about / 2.6 < length <= about
    assert f"{length:.0e}"[0] in "125"
