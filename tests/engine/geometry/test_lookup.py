"""A lookup returns exactly what numpy's interpolation returns."""

import numpy as np

from plannerforge.engine.geometry.lookup import Lookup


def test_it_equals_numpys_interpolation() -> None:
    random = np.random.default_rng(5)
    places = np.sort(random.uniform(0.0, 100.0, 60))
    values = random.normal(0.0, 10.0, 60)
    lookup = Lookup(places, values)
    wanted = np.concatenate([random.uniform(-10.0, 110.0, 500), places, [places[0], places[-1]]])
    assert [lookup.at(float(place)) for place in wanted] == [
        float(np.interp(place, places, values)) for place in wanted
    ]


def test_a_table_of_one_value_is_constant() -> None:
    assert [Lookup([3.0], [7.0]).at(place) for place in (1.0, 3.0, 9.0)] == [7.0, 7.0, 7.0]
