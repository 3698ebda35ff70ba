"""Intervals by hand, the energy-averaged rate by hand, and files that are whole or refused."""

import json
import struct
from dataclasses import replace
from math import inf, nan

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from episodes import EPISODE
from mimicbench.commands.table import table
from mimicbench.core.errors import BadFile, MimicbenchError
from mimicbench.evaluate.intervals import Rate, wilson
from mimicbench.evaluate.rows import group, read_rows, rows_made_from, summarize, write_rows

ROW = replace(EPISODE, policy="act", seed=7, object_id="chair-00001", reference_id="sit-chair-00001", steps=300)


def test_wilson_by_hand():
    # k=8, n=10, z=1.959964: center (0.8 + 0.192073) / 1.384146 = 0.716742,
    # half 1.959964 / 1.384146 * sqrt(0.016 + 0.00960365) = 0.226577
    assert wilson(8, 10) == pytest.approx((0.490162, 0.943318), abs=2e-5)
    # k=0: (0, z^2 / (n + z^2)); k=n is its mirror image
    assert wilson(0, 10) == pytest.approx((0.0, 3.841459 / 13.841459), abs=1e-6)
    assert wilson(10, 10) == pytest.approx((1 - 3.841459 / 13.841459, 1.0), abs=1e-6)
    # half of 400: +- 4.877 points
    assert wilson(200, 400) == pytest.approx((0.451231, 0.548769), abs=2e-5)
    # 99 %: z = 2.575829, center 0.5, half z / 2 / sqrt(n + z^2)
    assert wilson(50, 100, 0.99) == pytest.approx((0.5 - 0.124721, 0.5 + 0.124721), abs=1e-4)
    assert wilson(0, 0) == (0.0, 1.0)


@pytest.mark.parametrize("k", [-1, 11])
def test_wilson_refuses_impossible_counts(k):
    with pytest.raises(MimicbenchError, match="cannot be"):
        wilson(k, 10)


@given(st.integers(1, 5000).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_wilson_axioms(counts):
    k, n = counts
    low, high = wilson(k, n)
    assert 0 <= low <= k / n <= high <= 1
    mirrored = wilson(n - k, n)
    assert (1 - mirrored[1], 1 - mirrored[0]) == pytest.approx((low, high), abs=1e-9)
    more = wilson(4 * k, 4 * n)
    assert more[1] - more[0] < high - low


def test_rate_format():
    assert str(Rate(366, 400)) == "91.5 % [88.4–93.9] (366/400)"
    assert Rate(1.25, 4).counts() == "1.25/4"
    assert Rate(0, 0).percent() == "-" and Rate(0, 0).rate == 0


def test_energy_average_by_hand():
    # K holds in three of four; e = 5e4 passes all limits, 3e6 the last two, 1e9 none; the failure's low energy counts
    # for nothing
    energies = [(True, 5e4), (True, 3e6), (True, 1e9), (False, 1.0)]
    rows = [
        replace(ROW, episode=i, success=k, first_success_time=1.0 if k else None, max_energy=e)
        for i, (k, e) in enumerate(energies)
    ]
    data = summarize(rows).to_dict()
    assert data["kinematic"] == {
        "successes": 3,
        "episodes": 4,
        "rate": 0.75,
        "low": pytest.approx(0.300642, abs=1e-4),
        "high": pytest.approx(0.954413, abs=1e-4),
    }
    assert [(limit["lambda"], limit["successes"]) for limit in data["energy"]["limits"]] == [
        (1e6, 1),
        (2e6, 1),
        (4e6, 2),
        (8e6, 2),
    ]
    assert data["energy"]["rate"] == 1.5 / 4
    assert data["energy"]["successes"] == 1.5
    assert (data["energy"]["low"], data["energy"]["high"]) == wilson(1.5, 4)
    assert list(data)[:6] == ["task", "policy", "preset", "robot", "episodes", "kinematic"]
    json.dumps(data)


def test_energy_limit_is_strict():
    assert not replace(ROW, max_energy=1e6).holds(1e6)
    assert not replace(ROW, max_energy=inf).holds(8e6)


def test_rows_refuse_what_cannot_be():
    with pytest.raises(MimicbenchError, match="energy"):
        replace(ROW, max_energy=nan)
    with pytest.raises(MimicbenchError, match="first fulfilled"):
        replace(ROW, first_success_time=None)


def test_summarize_needs_one_policy():
    with pytest.raises(MimicbenchError, match="no episodes"):
        summarize([])
    rows = [ROW, replace(ROW, policy="bc")]
    with pytest.raises(MimicbenchError, match="several policies"):
        summarize(rows)
    assert [key[2] for key in group(rows)] == ["act", "bc"]
    with pytest.raises(MimicbenchError, match="several policies"):
        summarize([ROW, replace(ROW, robot="g1")])
    assert len(group([ROW, replace(ROW, robot="g1")])) == 2


def test_parquet_round_trip(tmp_path):
    rows = [ROW, replace(ROW, episode=1, success=False, first_success_time=None, seat_height=None, max_energy=inf)]
    write_rows(tmp_path / "a" / "rows.parquet", rows)
    write_rows(tmp_path / "b.parquet", rows)
    assert read_rows(tmp_path / "b.parquet") == rows
    assert (tmp_path / "a" / "rows.parquet").read_bytes() == (tmp_path / "b.parquet").read_bytes()
    assert [path.name for path in tmp_path.iterdir() if path.is_file()] == ["b.parquet"]
    write_rows(tmp_path / "none.parquet", [])
    assert read_rows(tmp_path / "none.parquet") == []


def test_an_episode_that_is_told_of_twice_is_of_two_runs(tmp_path, capsys):
    """Two trainings of one name must not be one rate; other episodes, or other names, may stand in several files."""
    files = [tmp_path / name for name in ("first.parquet", "again.parquet", "more.parquet", "other.parquet")]
    several = [[ROW], [ROW], [replace(ROW, episode=ROW.episode + 1)], [replace(ROW, policy="bc")]]
    for path, rows in zip(files, several, strict=True):
        write_rows(path, rows)
    with pytest.raises(MimicbenchError, match=r"first.parquet and .*again.parquet both tell of episode"):
        table(tuple(files[:2]), ("results",))
    sources = [{"checkpoint": "1", "clips": name, "episodes": 1} for name in "ab"]
    for path, source in zip(files, sources, strict=False):
        write_rows(path, [ROW], source)
    with pytest.raises(MimicbenchError, match=r"of '\w+', of other clips: these are two runs"):
        table(tuple(files[:2]), ("results",))
    table((files[0], *files[2:]), ("results",))
    told = capsys.readouterr().out
    assert "(" in told
    (tmp_path / "link").symlink_to(tmp_path)
    table((*files[2:], files[0], files[0], tmp_path / "link" / files[0].name), ("results",))
    assert capsys.readouterr().out == told, "a file that is named twice counts once"


def test_a_wanted_table_with_nothing_to_show_is_told(tmp_path, capsys):
    """The object is nobody's, so that its size is not known, and no episode failed."""
    write_rows(tmp_path / "rows.parquet", [replace(ROW, stays=True)])
    table((tmp_path / "rows.parquet",), ("sizes", "failed", "results"))
    told = capsys.readouterr()
    assert "100.0 %" in told.out and told.err == "of these episodes there is nothing to show in: sizes, failed\n"


def test_every_cut_and_every_flip_is_refused_or_harmless(tmp_path):
    path = tmp_path / "rows.parquet"
    rows = [replace(ROW, episode=i) for i in range(50)]
    write_rows(path, rows)
    whole = path.read_bytes()
    for size in {0, 3, 100, len(whole) // 2, len(whole) - 1}:
        path.write_bytes(whole[:size])
        with pytest.raises(BadFile, match="run the evaluation again"):
            read_rows(path)
    middle = len(whole) // 4
    path.write_bytes(whole[:middle] + bytes([whole[middle] ^ 0xFF]) + whole[middle + 1 :])
    with pytest.raises(BadFile):
        read_rows(path)


def test_missing_and_foreign_files(tmp_path):
    with pytest.raises(BadFile, match="does not exist"):
        read_rows(tmp_path / "rows.parquet")
    foreign = tmp_path / "foreign.parquet"
    pq.write_table(pa.table({"success": [True]}), foreign)
    with pytest.raises(BadFile, match="not one of mimicbench's"):
        read_rows(foreign)
    for header, message in [
        ({"schema": 99, "type": "episode_rows"}, "schema 99"),
        ({"schema": 2, "type": "other"}, "holds 'other'"),
        ({"schema": 2, "type": "episode_rows"}, "other columns"),
    ]:
        pq.write_table(
            pa.table({"success": [True]}).replace_schema_metadata({"mimicbench": json.dumps(header)}), foreign
        )
        with pytest.raises(BadFile, match=message):
            read_rows(foreign)


def test_an_effort_below_one_is_one_and_rows_are_held_against_their_digest(tmp_path):
    assert replace(ROW, max_energy=0.0).holds(1e6) and replace(ROW, max_energy=0.5).max_energy == 0.5
    path = tmp_path / "rows.parquet"
    write_rows(path, [ROW], {"clips": "a", "episodes": 1})
    table = pq.read_table(path)
    header = json.loads(table.schema.metadata[b"mimicbench"])
    assert rows_made_from(path) == {"clips": "a", "episodes": 1}
    for other in ({**header, "made_from": {"clips": "b", "episodes": 1}}, {**header, "strange": 1}):
        pq.write_table(table.replace_schema_metadata({"mimicbench": json.dumps(other)}), path)
        with pytest.raises(BadFile, match="not as it was written"):
            read_rows(path)
    pq.write_table(table.set_column(table.column_names.index("success"), "success", pa.array([False])), path)
    with pytest.raises(BadFile):
        read_rows(path)


def test_rows_without_a_digest_are_held_against_their_pages(tmp_path):
    path, effort = tmp_path / "rows.parquet", struct.pack("<d", 54321.0)
    write_rows(path, [replace(ROW, max_energy=54321.0)])
    table = pq.read_table(path)
    header = json.loads(table.schema.metadata[b"mimicbench"])
    del header["digest"]
    old = table.replace_schema_metadata({"mimicbench": json.dumps(header)})
    pq.write_table(old, path, compression="none", write_page_checksum=True, write_statistics=False)
    assert read_rows(path)[0].max_energy == 54321.0
    written = path.read_bytes()
    assert written.count(effort) == 1
    path.write_bytes(written.replace(effort, struct.pack("<d", 12345.0)))
    with pytest.raises(BadFile, match="cut off or damaged"):
        read_rows(path)


def test_columns_that_differ_are_named(tmp_path):
    path = tmp_path / "rows.parquet"
    write_rows(path, [ROW])
    table = pq.read_table(path)
    column = table.column_names.index("steps")
    for other, named in (
        (table.set_column(column, "steps", pa.array([300], pa.int32())), "steps"),
        (table.drop_columns(["fell"]), "fell"),
        (table.select(table.column_names[::-1]), "another order"),
    ):
        pq.write_table(other.replace_schema_metadata(table.schema.metadata), path)
        with pytest.raises(BadFile, match=rf"\({named}\)"):
            read_rows(path)


def test_the_order_in_which_something_is_said_changes_no_byte(tmp_path):
    for name, made_from in (("a", {"clips": 1, "policy": 2}), ("b", {"policy": 2, "clips": 1})):
        write_rows(tmp_path / name, [ROW], made_from)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_errors_are_told_with_the_episodes_that_they_ended():
    rows = [replace(ROW, episode=i, error=error) for i, error in enumerate(("", "late", "", "raised", "late"))]
    assert summarize(rows).errors == {"late": (1, 4), "raised": (3,)}


def test_one_long_text_in_every_row_is_not_written_out(tmp_path):
    """Eight kilobytes on the disk would be a gigabyte and more in memory."""
    write_rows(tmp_path / "rows.parquet", [ROW], {})
    table, count = pq.read_table(tmp_path / "rows.parquet"), 1500
    columns = [pa.array([table[name][0].as_py()] * count, table.schema.field(name).type) for name in table.column_names]
    place = table.column_names.index("policy")
    columns[place] = pa.DictionaryArray.from_arrays(pa.array([0] * count, pa.int32()), pa.array(["x" * 1_000_000]))
    fields = zip(table.schema, columns, strict=True)
    schema = pa.schema([pa.field(field.name, column.type, field.nullable) for field, column in fields])
    with pq.ParquetWriter(tmp_path / "bomb.parquet", schema, compression="zstd", store_schema=False) as file:
        file.write_table(pa.Table.from_arrays(columns, schema=schema))
        file.add_key_value_metadata(table.schema.metadata)
    assert (tmp_path / "bomb.parquet").stat().st_size < 10_000
    with pytest.raises(BadFile, match="more text than such a file can"):
        read_rows(tmp_path / "bomb.parquet")
