"""Writing into some of N rows: whoever works all rows out and whoever works out the chosen ones get the same."""

import numpy as np
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mimicbench.sim.rows import Rows

masks = st.integers(1, 9).flatmap(lambda n: arrays(bool, n))


@settings(deadline=None)  # how long it takes is the machine's
@given(masks, st.sampled_from([(), (3,), (2, 3)]), st.sampled_from([torch.float32, torch.float64, torch.long]))
def test_whole_and_chosen_rows_give_the_same(mask, shape, dtype):
    mask = torch.from_numpy(mask)
    values = torch.arange(float(np.prod((len(mask), *shape)))).reshape(len(mask), *shape) + 1
    expected = torch.where(mask.reshape(-1, *[1] * len(shape)), values, 0.0).to(dtype)
    for whole in (False, True):
        rows, there = Rows.where(mask, whole), torch.zeros(len(mask), *shape, dtype=dtype)
        assert len(rows) == (len(mask) if whole else mask.sum())
        rows.put(there, values[rows.ids])
        assert torch.equal(there, expected)
        rows.put(there, 7)
        assert (there[mask] == 7).all() and torch.equal(there[~mask], expected[~mask])


def test_rows_by_number_and_all_of_them():
    there = torch.zeros(4)
    Rows.of([3, 1], 4).put(there, torch.tensor([30.0, 10.0]))
    assert there.tolist() == [0, 10, 0, 30], "values go with their numbers, whatever the order"
    assert Rows.of([3, 1], 4).mask.tolist() == [False, True, False, True]
    Rows.every(4).put(there, torch.arange(4.0))
    assert there.tolist() == [0, 1, 2, 3] and len(Rows.of([], 4)) == 0
