"""Success by the size of objects: who is counted where."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mimicbench.objects.registry import make_object
from mimicbench.report.sizes import PARTS, SIZES, by_size, size_of, size_plot
from mimicbench.report.tables.registry import TABLES
from mimicbench.report.tables.spec import Episodes
from test_report import made_up_rows

BEDS = {f"bed-0-{i:05d}": make_object(f"bed-0-{i:05d}") for i in range(40)}


def rows_on(objects, fine):
    row = next(row for row in made_up_rows() if row.success)
    return [replace(row, object_id=name, success=ok, stays=ok) for name, ok in zip(objects, fine, strict=True)]


def test_a_bed_is_as_long_as_its_longer_side_and_as_high_as_one_lies():
    bed = BEDS["bed-0-00000"]
    low, high = bed.bounds()
    length, width, height = size_of(bed)
    assert length == max((high - low)[:2]) and width == min((high - low)[:2]) and length > width
    assert height == bed.seat_height < high[2]  # the head end is higher
    box = make_object("box-0-00000")
    assert size_of(box)[2] == box.bounds()[1][2]


@given(st.lists(st.booleans(), min_size=1, max_size=40))
def test_every_episode_is_in_one_part_of_each_size(fine):
    rows = rows_on(list(BEDS)[: len(fine)], fine)
    for parts in by_size(rows, BEDS).values():
        assert 1 < len(parts) <= PARTS
        assert sum(part.kinematic.episodes for part in parts) == len(rows)
        assert sum(part.stays.successes for part in parts) == sum(fine)
        assert all(one.high < other.low for one, other in zip(parts, parts[1:], strict=False))


def test_who_fails_at_long_beds_is_seen_to():
    longest = sorted(BEDS, key=lambda name: size_of(BEDS[name])[0])
    rows = rows_on(longest, [i < 32 for i in range(40)])
    rates = [part.kinematic.rate for part in by_size(rows, BEDS)["length"]]
    assert rates == [1, 1, 1, 1, 0]
    assert "<svg" in size_plot("sizes", by_size(rows, BEDS))


@pytest.mark.parametrize("count", [0, 3])
def test_a_size_that_all_have_is_left_out(count):
    assert by_size(rows_on(["bed-0-00000"] * count, [True] * count), BEDS) == {}
    assert set(by_size(rows_on(list(BEDS), [True] * 40), BEDS)) == set(SIZES)


def test_the_table_leaves_out_whose_objects_nobody_has():
    """Objects are made again from their ids; own meshes have to be at hand."""
    rows = rows_on(list(BEDS), [True] * 40)
    (table,) = TABLES.get("sizes").of(Episodes(tuple(rows)))
    assert len(table.rows) == PARTS * len(SIZES) and table.rows[0][2].episodes == 8
    own = [replace(row, object_id=f"mine-{row.object_id}") for row in rows]
    assert TABLES.get("sizes").of(Episodes(tuple(own))) == []
    at_hand = {f"mine-{name}": obj for name, obj in BEDS.items()}
    assert TABLES.get("sizes").of(Episodes(tuple(own), at_hand)) == [table]
